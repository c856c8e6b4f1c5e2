/* Support of tests of models: a small model in the middle of training. Its step determines every
 * byte: models of the same step are equal, those of different steps differ everywhere. */
#ifndef CLN_TESTS_MODEL_FIXTURE_H
#define CLN_TESTS_MODEL_FIXTURE_H

#include <stdio.h>
#include <string.h>
#include "base/config.h"
#include "base/rng.h"
#include "model/model.h"

enum { N1 = 3 };

static inline uint32_t draw(uint32_t *counter)
{
    uint32_t c[4] = {(*counter)++, 1, 0, 0}, key[2] = {77, 0}, out[4];

    cln_philox(c, key, out);
    return out[0];
}

/* Random bits except NaN, whose payload may change in a copy. */
static inline void fill(float *out, size_t count, uint32_t *counter)
{
    for (size_t i = 0; i < count; i++) {
        uint32_t bits = draw(counter) & 0xff7fffff;
        memcpy(&out[i], &bits, sizeof bits);
    }
}

/* Bytes of one of a leaf's moments: a whole number of floats. */
static inline size_t moment_bytes(const cln_model *model)
{
    return (size_t)model->net.params * cln_moment_bytes(&model->config);
}

/* One leaf culled, one split; moments have 32 bits after odd steps, 16 after even ones. */
static inline void make_model(int64_t step, cln_model *model)
{
    cln_config config;
    cln_octree_change change;
    uint8_t marks[16] = {0, 0, 0, 1}, second[16] = {0, 1};
    uint32_t counter = (uint32_t)step * 1000003u;
    size_t leaves = 0;

    assert_int_equal(cln_config_preset("fast", &config), CLN_OK);
    config.start_level = 1;
    config.width = 16;
    config.depth = 2;
    config.view_width = 16;
    config.bands = 2;
    config.n1 = N1;
    config.lr = 1.0 / 3;
    config.antialias = 2;
    config.moments = step % 2 ? CLN_MOMENTS_FLOAT32 : CLN_MOMENTS_BFLOAT16;
    snprintf(config.background, sizeof config.background, "0.1,0.2,0.7");
    assert_int_equal(cln_model_create(&config, model), CLN_OK);
    assert_int_equal(cln_octree_cull(&model->tree, marks, &change), CLN_OK);
    assert_int_equal(cln_model_apply(model, &change), CLN_OK);
    cln_octree_change_free(&change);
    assert_int_equal(cln_octree_split(&model->tree, second, &change), CLN_OK);
    assert_int_equal(cln_model_apply(model, &change), CLN_OK);
    cln_octree_change_free(&change);
    leaves = (size_t)model->tree.leaf_count;
    assert_int_equal(leaves, 14);
    fill(model->params, leaves * (size_t)model->net.params, &counter);
    fill(model->adam_m, leaves * moment_bytes(model) / sizeof(float), &counter);
    fill(model->adam_v, leaves * moment_bytes(model) / sizeof(float), &counter);
    for (size_t i = 0; i < leaves; i++)
        model->adam_steps[i] = (int32_t)draw(&counter);
    for (size_t i = 0; i < leaves * N1 * N1 * N1; i++)
        model->density[i] = (uint16_t)draw(&counter);
    fill(model->sums, leaves * CLN_MEASURES * 2, &counter);
    fill(model->error, leaves, &counter);
    fill(model->saved, leaves, &counter);
    for (size_t i = 0; i < leaves; i++)
        model->met[i] = (int32_t)draw(&counter);
    model->sum_rays = step * 3;
    model->sum_square = 1.0 / 7;
    model->last_square = 2.0 / 7;
    model->decisions = 5;
    model->row = (cln_row_sums){3, 3 * 64, 3 * 640, 0.1, 0.3, 1.0 / 3};
    model->tree.strikes[model->tree.leaf[0]] = 1;
    model->space.centre[0] = 0.1 + 0.2;
    model->space.centre[1] = -1.0 / 3;
    model->space.centre[2] = 5e-324;
    model->space.half = 1e-4 / 7;
    model->space.forward = step % 2;
    model->space.shell = step % 4 == 2;
    for (int i = 0; i < 11 && model->space.forward; i++)
        *(i < 9 ? &model->space.axes[i] : &model->space.scale[i - 9]) = 1.0 / (3 + i);
    model->background[0] = 0.1f;
    model->background[2] = 1;
    model->has_distortion = true;
    model->step = step;
    model->refresh_step = step - 1;
    model->growth_step = step / 2;
    model->drawn = 3 * step + 1;
    model->averaged = step % 2;
    model->in_parts = step % 2;
    model->exposed = step % 2;
    model->training_names = step % 2 ? 0xfedcba9876543210 : 0;
    model->train_seconds = 1234.5678901234567;
    model->rays = 4711;
    model->level = 2;
}

static inline void same_bytes(const void *a, const void *b, size_t bytes)
{
    if (bytes)
        assert_memory_equal(a, b, bytes);
}

#endif
