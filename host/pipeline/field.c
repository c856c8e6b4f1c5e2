/* The field at points. See field.h. A point is the origin of a ray with one sample at t = 0, so
 * grouping and networks work as in rendering. */
#include "pipeline/field.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "pipeline/stages.h"

enum { MOST_POINTS = 65536 };

/* One batch of at most p->max_samples points. samples, answers: room for as many. */
static cln_status ask(cln_pipeline *p, const cln_octree *tree, size_t n,
                      const float (*positions)[4], const float (*directions)[4],
                      cln_sample *samples, float (*answers)[4], float (*out)[4])
{
    cln_status st = CLN_OK;
    uint32_t count = 0;

    for (size_t i = 0; i < n; i++) {
        const double point[3] = {positions[i][0], positions[i][1], positions[i][2]};
        const int slot = cln_octree_find(tree, point);

        memset(out[i], 0, sizeof out[i]);
        if (slot >= 0)
            samples[count++] = (cln_sample){.ray = (cln_u32)i, .slot = slot};
    }
    if (count == 0)
        return CLN_OK;
    CLN_TRY(cln_pipeline_points(p, positions[0], directions[0], NULL, (uint32_t)n));
    CLN_TRY(cln_pipeline_samples(p, samples, count));
    CLN_TRY(cln_stage_evaluate(p, count));
    CLN_TRY(cln_buffer_read(p->device, &p->out, 0, answers, count * sizeof *answers));
    for (uint32_t i = 0; i < count; i++)
        memcpy(out[samples[i].ray], answers[i], sizeof answers[i]);
done:
    return st;
}

cln_status cln_field_points(cln_pipeline *p, const cln_octree *tree, size_t n,
                            const float (*positions)[4], const float (*directions)[4],
                            float (*out)[4])
{
    cln_status st = CLN_OK;
    const size_t room =
        p->max_samples > 0 && p->max_samples < MOST_POINTS ? p->max_samples : MOST_POINTS;
    const size_t most = n < room ? n : room;
    cln_sample *samples = NULL;
    float(*answers)[4] = NULL;

    CLN_TRY(cln_alloc(&samples, most, sizeof *samples, "points"));
    CLN_TRY(cln_alloc(&answers, most, sizeof *answers, "points"));
    for (size_t first = 0; first < n; first += most)
        CLN_TRY(ask(p, tree, n - first < most ? n - first : most, positions + first,
                    directions + first, samples, answers, out + first));
done:
    free(samples);
    free(answers);
    return st;
}
