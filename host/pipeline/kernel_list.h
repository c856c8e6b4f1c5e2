/* The lists of the pipeline's programs and kernels: a new one takes a row here. They generate the
 * members of cln_pipeline, the code that builds and releases them, and the bench's check that each
 * kernel is timed. */
#ifndef CLN_KERNEL_LIST_H
#define CLN_KERNEL_LIST_H

/* X(member, file, text, when): kernels/FILE.cl, built after the pipeline's "#define" lines and
 * these:
 *   PLAIN   none
 *   PARTS   layout of arrays of a row per leaf (kernels/leaves.h); built again when they are split
 *   TRAIN, EVAL   PARTS, and whether the pass is for training (mlp_*.cl)
 *   WIDE    64-bit keys (scan.cl)
 *   CROP    PARTS, and rays are cut to a box (walk.h); only if it is asked for by name
 * when (programs.c decides by settings and tuning parameters): ALWAYS; NETWORK or VOXEL: what
 * leaves are; SPLATTING: stage 1 splats; REGULARISED: a regulariser reads points; MEASURED:
 * training measures leaves, which may merge; AVERAGED: pixels are the mean of several rays; SHARED:
 * ranks share the pipeline; HALO: and its leaves have common vertices. */
#define CLN_PROGRAM_LIST(X)                           \
    X(scan, scan, PLAIN, ALWAYS)                      \
    X(sort64, scan, WIDE, SPLATTING)                  \
    X(rays, rays, PLAIN, ALWAYS)                      \
    X(sampling, sampling, PARTS, ALWAYS)              \
    X(splat, splat, PARTS, SPLATTING)                 \
    X(group, group, PLAIN, ALWAYS)                    \
    X(mlp_density, mlp_density, EVAL, NETWORK)        \
    X(mlp_forward_eval, mlp_forward, EVAL, NETWORK)   \
    X(mlp_forward_train, mlp_forward, TRAIN, NETWORK) \
    X(mlp_backward, mlp_backward, TRAIN, NETWORK)     \
    X(voxel_eval, voxel, EVAL, VOXEL)                 \
    X(voxel_train, voxel, TRAIN, VOXEL)               \
    X(decoder, decoder, PLAIN, DECODER)               \
    X(composite, composite, PLAIN, ALWAYS)            \
    X(roulette, roulette, PLAIN, ALWAYS)              \
    X(adam, adam, PARTS, ALWAYS)                      \
    X(stats, stats, PARTS, ALWAYS)                    \
    X(carry, carry, PARTS, ALWAYS)                    \
    X(regularise, regularise, PLAIN, REGULARISED)     \
    X(distil, distil, PLAIN, MEASURED)                \
    X(share, share, PLAIN, SHARED)                    \
    X(stretch, stretch, PLAIN, SHARED)                \
    X(halo, halo, PARTS, HALO)                        \
    X(sampling_crop, sampling, CROP, ALWAYS)

/* X(member, kernel, program, when): created with its program if `when` holds, too. SERIAL: tune.sg
 * is 1. */
#define CLN_KERNEL_LIST(X)                                          \
    X(scan_sums, scan_sums, scan, ALWAYS)                           \
    X(scan_write, scan_write, scan, ALWAYS)                         \
    X(sort_count, sort_count, scan, ALWAYS)                         \
    X(sort_scatter, sort_scatter, scan, ALWAYS)                     \
    X(sort64_varying, sort_varying, sort64, ALWAYS)                 \
    X(sort64_buckets, sort_buckets, sort64, SERIAL)                 \
    X(sort64_count, sort_count, sort64, ALWAYS)                     \
    X(sort64_scatter, sort_scatter, sort64, ALWAYS)                 \
    X(rays_make, rays_make, rays, ALWAYS)                           \
    X(intervals_fill, intervals_fill, sampling, ALWAYS)             \
    X(samples_emit, samples_emit, sampling, ALWAYS)                 \
    X(splat_count, splat_count, splat, ALWAYS)                      \
    X(splat_emit, splat_emit, splat, ALWAYS)                        \
    X(splat_bounds, splat_bounds, splat, ALWAYS)                    \
    X(splat_read, splat_read, splat, ALWAYS)                        \
    X(splat_lengths, splat_lengths, splat, ALWAYS)                  \
    X(splat_pad, splat_pad, splat, ALWAYS)                          \
    X(group_keys, group_keys, group, ALWAYS)                        \
    X(group_bounds, group_bounds, group, ALWAYS)                    \
    X(group_slice_counts, group_slice_counts, group, ALWAYS)        \
    X(group_slices, group_slices, group, ALWAYS)                    \
    X(mlp_density, mlp_density, mlp_density, ALWAYS)                \
    X(mlp_forward_train, mlp_forward, mlp_forward_train, ALWAYS)    \
    X(mlp_forward_eval, mlp_forward, mlp_forward_eval, ALWAYS)      \
    X(mlp_backward, mlp_backward, mlp_backward, ALWAYS)             \
    X(voxel_density, voxel_density, voxel_eval, ALWAYS)             \
    X(voxel_samples, voxel_samples, voxel_eval, ALWAYS)             \
    X(voxel_forward_train, voxel_forward, voxel_train, ALWAYS)      \
    X(voxel_backward, voxel_backward, voxel_train, ALWAYS)          \
    X(voxel_update, voxel_update, voxel_train, ALWAYS)              \
    X(voxel_split, voxel_split, voxel_train, ALWAYS)                \
    X(voxel_join, voxel_join, voxel_train, ALWAYS)                  \
    X(decoder_backward, decoder_backward, decoder, ALWAYS)          \
    X(decoder_update, decoder_update, decoder, ALWAYS)              \
    X(roulette, roulette, roulette, ALWAYS)                         \
    X(composite, composite, composite, ALWAYS)                      \
    X(composite_pixels, composite_pixels, composite, AVERAGED)      \
    X(composite_train, composite_train, composite, ALWAYS)          \
    X(adam_count, adam_count, adam, ALWAYS)                         \
    X(adam, adam, adam, ALWAYS)                                     \
    X(transpose, transpose, adam, ALWAYS)                           \
    X(carry_rows, carry_rows, carry, ALWAYS)                        \
    X(carry_densities, carry_densities, carry, ALWAYS)              \
    X(stats_seen, stats_seen, stats, ALWAYS)                        \
    X(stats_leaf, stats_leaf, stats, ALWAYS)                        \
    X(leaf_measure, leaf_measure, stats, MEASURED)                  \
    X(regularise_points, regularise_points, regularise, ALWAYS)     \
    X(regularise_gradient, regularise_gradient, regularise, ALWAYS) \
    X(distil_gradient, distil_gradient, distil, ALWAYS)             \
    X(share_pack, share_pack, share, ALWAYS)                        \
    X(share_unpack, share_unpack, share, ALWAYS)                    \
    X(walk_pack, walk_pack, share, ALWAYS)                          \
    X(walk_unpack, walk_unpack, share, ALWAYS)                      \
    X(stretch_count, stretch_count, stretch, ALWAYS)                \
    X(stretch_list, stretch_list, stretch, ALWAYS)                  \
    X(stretch_composite, stretch_composite, stretch, ALWAYS)        \
    X(stretch_pixels, stretch_pixels, stretch, AVERAGED)            \
    X(stretch_train, stretch_train, stretch, ALWAYS)                \
    X(halo_mark, halo_mark, halo, ALWAYS)                           \
    X(halo_pack_gradients, halo_pack_gradients, halo, ALWAYS)       \
    X(halo_pack_values, halo_pack_values, halo, ALWAYS)             \
    X(halo_put_gradients, halo_put_gradients, halo, ALWAYS)         \
    X(halo_put_values, halo_put_values, halo, ALWAYS)               \
    X(intervals_crop, intervals_fill, sampling_crop, ALWAYS)

#endif
