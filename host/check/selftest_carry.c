/* Checks changes of the tree on the device (pipeline/carry.h): a leaf that is split there and by
 * cln_model_apply must give the same bits. Changes the pipeline's tree, so it comes last. See
 * selftest_checks.h. */
#include "check/selftest_checks.h"

#include <string.h>

#include "pipeline/carry.h"

/* Fills moments or densities with varying bits; any bits can be carried. */
static void fill(void *array, size_t bytes, uint32_t stream)
{
    uint8_t *byte = array;

    for (size_t i = 0; i < bytes; i++)
        byte[i] = (uint8_t)cln_check_uniform(stream, (uint32_t)i, 0, 64);
}

typedef struct sizes {
    size_t params, firsts, moments, density; /* bytes; firsts: of Adam's first moments */
} sizes;

static sizes sizes_of(const cln_model *m)
{
    const size_t leaves = (size_t)m->tree.leaf_count, params = leaves * (size_t)m->net.params;
    const size_t n1 = (size_t)m->config.n1;

    return (sizes){params * sizeof(float), params * cln_first_moment_bytes(&m->config),
                   params * cln_moment_bytes(&m->config), leaves * n1 * n1 * n1 * sizeof(uint16_t)};
}

cln_status cln_check_carry(cln_checks *c)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    uint8_t split[64] = {0, 0, 1}; /* the third leaf */
    cln_model host = {0}, carried = {0};
    cln_octree_change change = {0};
    sizes s;

    CLN_ASSERT(c->model->tree.leaf_count <= (int)sizeof split);
    CLN_TRY(cln_model_create_on(&p->config, &c->model->tree, &host));
    CLN_TRY(cln_model_create_on(&p->config, &c->model->tree, &carried));
    s = sizes_of(&host);
    memcpy(host.params, c->model->params, s.params);
    fill(host.adam_m, s.firsts, 51);
    fill(host.adam_v, s.moments, 52);
    fill(host.density, s.density, 53);
    CLN_TRY(cln_pipeline_upload(p, &host, true));
    CLN_TRY(cln_octree_split(&host.tree, split, &change));
    cln_octree_free(&carried.tree);
    CLN_TRY(cln_octree_copy(&host.tree, &carried.tree));
    CLN_TRY(cln_model_apply(&host, &change));
    CLN_TRY(cln_model_follow(&carried, &change));
    CLN_TRY(cln_pipeline_rebuild(p, host.tree.leaf_count));
    CLN_TRY(cln_pipeline_carry(p, &host.tree, &change));
    CLN_TRY(cln_pipeline_download(p, &carried, true));
    s = sizes_of(&host);
    cln_check_say(c, "carried: weights", memcmp(host.params, carried.params, s.params) == 0,
                  "%d leaves", host.tree.leaf_count);
    cln_check_say(c, "carried: moments",
                  memcmp(host.adam_m, carried.adam_m, s.firsts) == 0 &&
                      memcmp(host.adam_v, carried.adam_v, s.moments) == 0,
                  "%d leaves", host.tree.leaf_count);
    cln_check_say(c, "carried: densities", memcmp(host.density, carried.density, s.density) == 0,
                  "%d leaves", host.tree.leaf_count);
done:
    cln_octree_change_free(&change);
    cln_model_free(&host);
    cln_model_free(&carried);
    return st;
}
