/* The checks of the self-test, in selftest_rays.c, selftest_networks.c, selftest_structure.c and
 * selftest_carry.c; selftest.c runs them on one pipeline after the other. Tests and benches also
 * use the reference's side of a pipeline. */
#ifndef CLN_SELFTEST_CHECKS_H
#define CLN_SELFTEST_CHECKS_H

#include "check/compare.h"
#include "reference/reference.h"

/* The reference's side of a pipeline: the network of leaf `slot`; the losses, of which depth and
 * reach are still each ray's to set; the rules of a batch's samples. */
ref_network cln_check_network(const cln_config *config, const cln_model *model, int slot);
ref_loss cln_check_loss(const cln_pipeline *p);
ref_way cln_check_way(const cln_octree *tree, const cln_config *config, const cln_sampling *s);

/* Compares got and values with a stable sort of keys with the values 0 .. n - 1; *wrong: number of
 * wrong places. */
cln_status cln_check_sorted(const uint64_t *keys, const uint64_t *got, const uint32_t *values,
                            uint32_t n, uint32_t *wrong);

/* Sorts keys of `bits` bits (at most 64 if wide, else 32) with the values 0 .. n - 1 on the device,
 * and compares (cln_check_sorted). */
cln_status cln_check_sort_keys(cln_checks *c, const uint64_t *keys, uint32_t n, int bits, bool wide,
                               uint32_t *wrong);

/* A random point of a box (x, y, z of its lowest corner, side), on a grid of 1/1024 of the side,
 * and a unit direction, from numbers 3 i .. 3 i + 2 of the streams `stream` and `stream` + 1. */
void cln_check_random_ray(const float box[4], uint32_t stream, uint32_t i, float o[4], float d[4]);

/* Voxels (kernels/voxel.cl) share vertices, of which one leaf's copy is updated, the owner. *owner
 * [leaf][params]: index of each parameter's owner among all leaves' parameters; in padding its own.
 * The caller frees it. NULL for networks. CLN_MEMORY. */
cln_status cln_check_owners(const cln_model *model, int **owner);

/* A first step of voxels in float64: an owner steps by the sum of its copies' gradients, and copies
 * take their owner's value. Arrays are [all], the parameters of all leaves; grad changes. */
typedef struct cln_moving {
    int all;
    double *want, *grad, *m, *v;
} cln_moving;
void cln_check_step_voxels(const cln_config *config, const cln_network *net, const int *owner,
                           double lr, cln_moving to);

/* Compare the decoder's gradient of the last backward pass with `want` [decoder_params], and its
 * first step. CLN_MEMORY, device errors. */
cln_status cln_check_decoder_gradient(cln_checks *c, const double *want);
cln_status cln_check_decoder_step(cln_checks *c, const double *grad, double lr);

/* The checks; each reports its verdicts. A status other than CLN_OK: none was possible. */
cln_status cln_check_scan(cln_checks *c);
cln_status cln_check_sort(cln_checks *c, bool wide);
cln_status cln_check_rays(cln_checks *c);
cln_status cln_check_densities(cln_checks *c);
cln_status cln_check_networks(cln_checks *c);
cln_status cln_check_composite(cln_checks *c);
cln_status cln_check_structure(cln_checks *c); /* only if the pipeline has measures */
cln_status cln_check_carry(cln_checks *c);     /* last: changes the tree on the device */

#endif
