/* GLB files read by glTF's own rules, for tests. */
#ifndef CLN_TEST_GLB_H
#define CLN_TEST_GLB_H

#include <jansson.h>
#include <stdlib.h>
#include <string.h>
#include "scratch.h"

typedef struct glb {
    char *data;
    json_t *document;
    const char *numbers; /* of the binary chunk */
    size_t bytes, count; /* of the file; of the chunk */
} glb;

static inline uint32_t glb_word(const char *at)
{
    uint32_t word = 0;

    memcpy(&word, at, sizeof word);
    return word;
}

static inline glb glb_open(const char *path)
{
    glb g = {0};
    size_t json = 0;

    g.data = scratch_get(path, &g.bytes);
    assert_memory_equal(g.data, "glTF", 4);
    assert_int_equal(glb_word(g.data + 4), 2);
    assert_int_equal(glb_word(g.data + 8), g.bytes);
    json = glb_word(g.data + 12);
    assert_int_equal(json % 4, 0);
    assert_memory_equal(g.data + 16, "JSON", 4);
    g.document = json_loadb(g.data + 20, json, 0, NULL);
    assert_non_null(g.document);
    g.count = glb_word(g.data + 20 + json);
    assert_memory_equal(g.data + 24 + json, "BIN", 4);
    assert_int_equal(28 + json + g.count, g.bytes);
    g.numbers = g.data + 28 + json;
    return g;
}

static inline void glb_close(glb *g)
{
    json_decref(g->document);
    free(g->data);
}

static inline const json_t *glb_at(const json_t *in, const char *list, size_t i)
{
    return json_array_get(json_object_get(in, list), i);
}

/* A point of node `number`, or of one below it, as its translation, rotation and scale place it. */
static inline void glb_by_node(const json_t *node, double v[3])
{
    double q[4] = {0, 0, 0, 1}, m[3][3];
    const double at[3] = {v[0], v[1], v[2]};

    if (json_object_get(node, "rotation"))
        for (size_t i = 0; i < 4; i++)
            q[i] = json_number_value(glb_at(node, "rotation", i));
    for (int i = 0; i < 3; i++) /* 2 (q q^T - |q|^2) + 1, and the part across */
        for (int k = 0; k < 3; k++)
            m[i][k] = 2 * q[i] * q[k] + (i == k ? 2 * q[3] * q[3] - 1 : 0) +
                      (i == k             ? 0
                       : k == (i + 1) % 3 ? -2 * q[3] * q[(i + 2) % 3]
                                          : 2 * q[3] * q[(i + 1) % 3]);
    for (size_t i = 0; i < 3; i++) {
        v[i] = json_number_value(glb_at(node, "translation", i));
        for (size_t k = 0; k < 3; k++)
            v[i] +=
                m[i][k] * at[k] *
                (json_object_get(node, "scale") ? json_number_value(glb_at(node, "scale", k)) : 1);
    }
}

/* A point of the only mesh where a viewer of the file's scene has it. */
static inline void glb_place(const glb *g, double v[3])
{
    const json_t *scene = glb_at(g->document, "scenes", 0);
    const json_t *chain[8] = {
        glb_at(g->document, "nodes", (size_t)json_integer_value(glb_at(scene, "nodes", 0)))};
    int n = 0;

    while (n < 7 && !json_object_get(chain[n], "mesh")) {
        const json_t *next = glb_at(chain[n], "children", 0);

        assert_non_null(next);
        chain[++n] = glb_at(g->document, "nodes", (size_t)json_integer_value(next));
    }
    for (; n >= 0; n--)
        glb_by_node(chain[n], v);
}

/* Its vertex i: the first attribute, three floats. */
static inline void glb_vertex(const glb *g, size_t i, double v[3])
{
    float at[3];

    memcpy(at, g->numbers + 12 * i, sizeof at);
    for (int a = 0; a < 3; a++)
        v[a] = (double)at[a];
    glb_place(g, v);
}

#endif
