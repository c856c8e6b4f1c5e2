/* The memory plan. See plan.h; shapes are those of stages.h. */
#include "engine/plan.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/memory.h"
#include "io/progress.h"

static void row(cln_plan *plan, const char *purpose, double bytes, double largest,
                const char *way_out)
{
    CLN_ASSERT(plan->count < CLN_PLAN_ROWS);
    plan->rows[plan->count].purpose = purpose;
    plan->rows[plan->count].bytes = bytes;
    plan->rows[plan->count].largest = largest;
    plan->rows[plan->count++].way_out = way_out;
    plan->total += bytes;
}

void cln_plan_make(const cln_device *device, const cln_config *config, const cln_network *net,
                   const cln_tune *tune, int leaves, int views, bool training, cln_plan *out)
{
    const double n = leaves, params = 4.0 * net->params,
                 cells = (double)config->n1 * config->n1 * config->n1;
    const double room_for = device->info.max_alloc / (4.0 * cln_pipeline_acts(net));
    const double wanted = training ? 2.0 * config->batch_samples : config->batch_samples;
    const double samples = training && wanted > room_for ? floor(room_for) : wanted;
    const double rays = config->rays > 16384 ? config->rays : 16384;
    const double slices = n + samples / tune->sl;
    /* of the sort: bytes an element, and at least */
    const double scratch = 4.0 / CLN_SORT_PER_DIGIT, table = 4.0 * ((1 << tune->db) + 1);

    memset(out, 0, sizeof *out);
    out->limit = 0.9 * device->info.global_mem;
    if (config->device_mem > 0)
        out->limit = fmin(config->device_mem, device->info.global_mem);
    out->cells = n * cells;
    out->max_samples = (size_t)samples;
    out->batch_samples = (size_t)fmin(config->batch_samples, 0.75 * samples);
    row(out, "network weights", n * params, n * params, "--width, --depth or --view-width");
    if (training) {
        row(out, "optimiser state", n * (2 * params + 4.0 * cln_pipeline_transposed(net) + 8),
            n * params, "--width, --depth or --view-width");
        row(out, "weight gradients", slices * params, slices * params,
            "--width, --depth or --batch-samples");
        row(out, "activations", samples * 4.0 * cln_pipeline_acts(net),
            samples * 4.0 * cln_pipeline_acts(net), "--batch-samples, --width or --depth");
    }
    if (training && cln_pipeline_measures(config) > 0)
        row(out, "measures",
            n * (8.0 * CLN_MEASURES + 4) + samples * 4 * cln_pipeline_measures(config),
            samples * 4 * cln_pipeline_measures(config), "--batch-samples, or --no-adaptive");
    row(out, "stage-1 densities", n * cells * (training ? 3 : 2), 2 * n * cells, "--n1");
    row(out, "samples", samples * (16 + 32 + 16 + scratch) + table, samples * 16,
        "--batch-samples");
    row(out, "rays", rays * (16 * 5 + 32 + 20 + 16.0 * 96) + 96.0 * views + n * 36, rays * 16 * 96,
        "--rays");
    if (config->stage1 == CLN_STAGE1_SPLAT) {
        /* Keys and values twice, t and sigma: 32 bytes an entry; padded lists are checked as made. */
        const double room = out->limit - out->total;
        const double most = device->info.max_alloc / fmax(8, scratch);
        double entries = 0.5 * (room - table) / (32 + scratch);

        entries = entries < 1 ? 1 : entries > most ? most : entries;
        entries = entries > (double)(1u << 28) ? (double)(1u << 28) : entries;
        out->max_entries = (size_t)entries;
        row(out, "projected samples", entries * (32 + scratch) + table, entries * fmax(8, scratch),
            "--n1, or --stage1 gather");
    }
}

void cln_plan_text(const cln_plan *plan, char *out, size_t bytes)
{
    size_t used = 0;
    char amount[32], limit[32];

    for (int i = 0; i < plan->count && used < bytes; i++) {
        cln_format_bytes(plan->rows[i].bytes, amount);
        used += (size_t)snprintf(out + used, bytes - used, "%s%s %s", i ? ", " : "",
                                 plan->rows[i].purpose, amount);
    }
    cln_format_bytes(plan->total, amount);
    cln_format_bytes(plan->limit, limit);
    if (used < bytes)
        snprintf(out + used, bytes - used, " = %s of %s", amount, limit);
}

cln_status cln_plan_check(const cln_device *device, const cln_plan *plan)
{
    char text[1024], amount[32], largest[32];
    int worst = 0;

    for (int i = 0; i < plan->count; i++)
        worst = plan->rows[i].bytes > plan->rows[worst].bytes ? i : worst;
    cln_plan_text(plan, text, sizeof text);
    if (plan->total > plan->limit)
        return cln_fail(CLN_MEMORY,
                        "the plan needs more device memory than there is: %s; lower %s, or raise "
                        "--device-mem",
                        text, plan->rows[worst].way_out);
    if (plan->cells >= 4294967296.0)
        return cln_fail(CLN_MEMORY,
                        "%.3g stage-1 samples over all leaves, 4.29e9 can be counted; lower --n1",
                        plan->cells);
    for (int i = 0; i < plan->count; i++) {
        if (plan->rows[i].largest > (double)device->max_alloc) {
            cln_format_bytes(plan->rows[i].largest, amount);
            cln_format_bytes((double)device->max_alloc, largest);
            return cln_fail(CLN_MEMORY,
                            "%s: %s in one buffer, %s allows %s; lower %s (the plan: %s)",
                            plan->rows[i].purpose, amount, device->info.name, largest,
                            plan->rows[i].way_out, text);
        }
    }
    return CLN_OK;
}

cln_status cln_plan_json(const cln_plan *plan, json_t **out)
{
    *out = json_object();
    for (int i = 0; *out && i < plan->count; i++)
        json_object_set_new(*out, plan->rows[i].purpose, json_real(plan->rows[i].bytes));
    if (*out) {
        json_object_set_new(*out, "total", json_real(plan->total));
        json_object_set_new(*out, "limit", json_real(plan->limit));
    }
    return *out ? CLN_OK : cln_fail(CLN_MEMORY, "memory plan: cannot make JSON");
}
