/* The test groups. Each tests/ROOM/test_NAME.c has one function, test_group_NAME, which runs its
 * cmocka group and returns the number of failures. make collects them in a table
 * (build/test_groups.c). */
#ifndef CLN_TESTS_H
#define CLN_TESTS_H

int test_group_adam(void);
int test_group_agree(void);
int test_group_arguments(void);
int test_group_base(void);
int test_group_broken_formats(void);
int test_group_camera(void);
int test_group_cameras_file(void);
int test_group_carry(void);
int test_group_carve(void);
int test_group_checkpoint(void);
int test_group_blocks(void);
int test_group_command(void);
int test_group_compare(void);
int test_group_composite(void);
int test_group_config(void);
int test_group_counts(void);
int test_group_coverage(void);
int test_group_exposure(void);
int test_group_exposure_guess(void);
int test_group_float64(void);
int test_group_crop(void);
int test_group_depth_picture(void);
int test_group_devices(void);
int test_group_distil(void);
int test_group_doubts(void);
int test_group_export(void);
int test_group_exports(void);
int test_group_extreme_scenes(void);
int test_group_extremes(void);
int test_group_features(void);
int test_group_field(void);
int test_group_film(void);
int test_group_formats(void);
int test_group_forward(void);
int test_group_frames(void);
int test_group_grow(void);
int test_group_help(void);
int test_group_image(void);
int test_group_inspect(void);
int test_group_integer_program(void);
int test_group_learning(void);
int test_group_lens(void);
int test_group_marks(void);
int test_group_measure(void);
int test_group_mesh(void);
int test_group_metrics_image(void);
int test_group_mlp(void);
int test_group_halo(void);
int test_group_voxel(void);
int test_group_motion(void);
int test_group_missing(void);
int test_group_moved(void);
int test_group_model(void);
int test_group_network(void);
int test_group_octree(void);
int test_group_opaque(void);
int test_group_options(void);
int test_group_orientation(void);
int test_group_gradient(void);
int test_group_normals(void);
int test_group_painter(void);
int test_group_pictures(void);
int test_group_plan(void);
int test_group_plan_ranks(void);
int test_group_progress(void);
int test_group_rays(void);
int test_group_readers(void);
int test_group_reference(void);
int test_group_refine(void);
int test_group_reference_rays(void);
int test_group_regrow(void);
int test_group_regularise(void);
int test_group_report(void);
int test_group_report_clock(void);
int test_group_report_state(void);
int test_group_results(void);
int test_group_roulette(void);
int test_group_run_folder(void);
int test_group_safetensors(void);
int test_group_sampling(void);
int test_group_scale(void);
int test_group_scan_sort(void);
int test_group_scene(void);
int test_group_scene_input(void);
int test_group_seams(void);
int test_group_selftest(void);
int test_group_settings(void);
int test_group_shell(void);
int test_group_shell_rays(void);
int test_group_side_by_side(void);
int test_group_space(void);
int test_group_sight_rays(void);
int test_group_sights(void);
int test_group_splat(void);
int test_group_store(void);
int test_group_structure(void);
int test_group_reduce(void);
int test_group_surface(void);
int test_group_trace(void);
int test_group_training(void);
int test_group_tree_from(void);
int test_group_tune(void);
int test_group_tuner(void);
int test_group_up(void);
int test_group_view_request(void);
int test_group_units(void);
int test_group_watch(void);

/* The table, in the files' order; ends with a NULL name. */
typedef struct test_group {
    const char *name;
    int (*run)(void);
} test_group;

extern const test_group test_groups[];

#endif
