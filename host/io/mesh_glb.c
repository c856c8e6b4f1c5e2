/* Meshes as GLB, binary glTF 2.0: a header, a chunk of JSON, a chunk of numbers. See mesh.h.
 * Positions are floats relative to the origin, which is the mesh's node's translation, numbers in
 * the JSON. A root node above it turns and scales the scene to glTF's frame, y up and metres.
 * Colours are linear 16-bit numbers, as in glTF, and the material is unlit, as colours contain the
 * light. */
#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/files.h"
#include "io/mesh.h"

enum {
    FLOAT = 5126,
    UNSIGNED_INT = 5125,
    UNSIGNED_SHORT = 5123,
    ARRAY_BUFFER = 34962,
    ELEMENT_ARRAY_BUFFER = 34963,
    POINTS = 0,
    TRIANGLES = 4,
    COLOUR_BYTES = 8
};

typedef struct part {
    const char *type;
    int component, target;
    bool normalized;
    size_t count, bytes; /* elements; bytes of one */
} part;

static void bounds_of(const cln_mesh *mesh, double low[3], double high[3])
{
    for (int a = 0; a < 3; a++) {
        low[a] = INFINITY;
        high[a] = -INFINITY;
        for (size_t i = 0; i < mesh->vertices; i++) {
            const float at = (float)(mesh->at[i][a] - mesh->origin[a]);

            low[a] = fmin(low[a], at);
            high[a] = fmax(high[a], at);
        }
    }
}

/* Makes the JSON document; *total: bytes of the chunk of numbers. */
static json_t *document_of(const cln_mesh *mesh, const part *parts, int count, size_t *total)
{
    json_t *accessors = json_array(), *views = json_array(), *primitive = NULL;
    double low[3], high[3];

    *total = 0;
    for (int i = 0; i < count; i++) {
        const part *p = &parts[i];
        json_t *accessor = json_pack("{s:i, s:i, s:I, s:s}", "bufferView", i, "componentType",
                                     p->component, "count", (json_int_t)p->count, "type", p->type);

        if (p->normalized)
            json_object_set_new(accessor, "normalized", json_true());
        json_array_append_new(accessors, accessor);
        json_array_append_new(
            views, json_pack("{s:i, s:I, s:I, s:i}", "buffer", 0, "byteOffset", (json_int_t)*total,
                             "byteLength", (json_int_t)(p->count * p->bytes), "target", p->target));
        *total += p->count * p->bytes;
    }
    bounds_of(mesh, low, high);
    json_object_set_new(json_array_get(accessors, 0), "min",
                        json_pack("[f,f,f]", low[0], low[1], low[2]));
    json_object_set_new(json_array_get(accessors, 0), "max",
                        json_pack("[f,f,f]", high[0], high[1], high[2]));
    primitive = json_pack("{s:{s:i, s:i, s:i}, s:i, s:i}", "attributes", "POSITION", 0, "NORMAL", 1,
                          "COLOR_0", 2, "material", 0, "mode", mesh->faces ? TRIANGLES : POINTS);
    if (mesh->faces)
        json_object_set_new(primitive, "indices", json_integer(3));
    return json_pack(
        "{s:{s:s, s:s}, s:[s], s:i, s:[{s:[i]}],"
        " s:[{s:s, s:[i], s:[f,f,f,f], s:[f,f,f]}, {s:i, s:s, s:[f,f,f]}], s:[{s:s, s:[o]}],"
        " s:[{s:s, s:{s:f, s:f}, s:b, s:{s:{}}}], s:o, s:o, s:[{s:I}]}",
        "asset", "version", "2.0", "generator", mesh->comment, "extensionsUsed",
        "KHR_materials_unlit", "scene", 0, "scenes", "nodes", 0, "nodes", "name", "scene",
        "children", 1, "rotation", mesh->turn[0], mesh->turn[1], mesh->turn[2], mesh->turn[3],
        "scale", mesh->scale, mesh->scale, mesh->scale, "mesh", 0, "name", "surface", "translation",
        mesh->origin[0], mesh->origin[1], mesh->origin[2], "meshes", "name", "surface",
        "primitives", primitive, "materials", "name", "colours", "pbrMetallicRoughness",
        "metallicFactor", 0.0, "roughnessFactor", 1.0, "doubleSided", 1, "extensions",
        "KHR_materials_unlit", "accessors", accessors, "bufferViews", views, "buffers",
        "byteLength", (json_int_t)*total);
}

static uint16_t linear_of(uint8_t srgb)
{
    const double c = srgb / 255.0;

    return (uint16_t)lround(65535 * (c <= 0.04045 ? c / 12.92 : pow((c + 0.055) / 1.055, 2.4)));
}

static cln_status write_numbers(cln_atomic_file *file, const cln_mesh *mesh)
{
    cln_status st = CLN_OK;
    uint16_t linear[256];

    for (int i = 0; i < 256; i++)
        linear[i] = linear_of((uint8_t)i);
    for (size_t i = 0; i < mesh->vertices; i++) {
        float at[3];

        for (int a = 0; a < 3; a++)
            at[a] = (float)(mesh->at[i][a] - mesh->origin[a]);
        CLN_TRY(cln_atomic_write(file, at, sizeof at));
    }
    CLN_TRY(cln_atomic_write(file, mesh->normal, mesh->vertices * sizeof mesh->normal[0]));
    for (size_t i = 0; i < mesh->vertices; i++) {
        const uint8_t *c = mesh->colour[i];
        const uint16_t rgba[4] = {linear[c[0]], linear[c[1]], linear[c[2]], 65535};

        CLN_TRY(cln_atomic_write(file, rgba, sizeof rgba));
    }
    CLN_TRY(cln_atomic_write(file, mesh->face, mesh->faces * sizeof mesh->face[0]));
done:
    return st;
}

cln_status cln_mesh_write_glb(const char *path, const cln_mesh *mesh)
{
    cln_status st = CLN_OK;
    const part parts[4] = {
        {"VEC3", FLOAT, ARRAY_BUFFER, false, mesh->vertices, 12},
        {"VEC3", FLOAT, ARRAY_BUFFER, false, mesh->vertices, 12},
        {"VEC4", UNSIGNED_SHORT, ARRAY_BUFFER, true, mesh->vertices, COLOUR_BYTES},
        {"SCALAR", UNSIGNED_INT, ELEMENT_ARRAY_BUFFER, false, 3 * mesh->faces, 4}};
    cln_atomic_file *file = NULL;
    size_t numbers = 0, bytes = 0;
    json_t *document = document_of(mesh, parts, mesh->faces ? 4 : 3, &numbers);
    char *text = document ? json_dumps(document, JSON_COMPACT) : NULL;
    uint32_t head[7];

    if (!text)
        CLN_TRY(cln_fail(CLN_MEMORY, "%s: cannot make JSON", path));
    bytes = (strlen(text) + 3) / 4 * 4;
    if (28 + (double)bytes + (double)numbers > UINT32_MAX)
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: %zu vertices are more than a GLB file can hold; write a PLY file, or "
                         "give a larger --spacing",
                         path, mesh->vertices));
    CLN_TRY(cln_atomic_open(path, &file));
    memcpy(head, "glTF", 4);
    head[1] = 2;
    head[2] = (uint32_t)(28 + bytes + numbers);
    head[3] = (uint32_t)bytes;
    memcpy(&head[4], "JSON", 4);
    head[5] = (uint32_t)numbers;
    memcpy(&head[6], "BIN", 4);
    CLN_TRY(cln_atomic_write(file, head, 20));
    CLN_TRY(cln_atomic_write(file, text, strlen(text)));
    CLN_TRY(cln_atomic_write(file, "   ", bytes - strlen(text)));
    CLN_TRY(cln_atomic_write(file, &head[5], 8));
    CLN_TRY(write_numbers(file, mesh));
    CLN_TRY(cln_atomic_commit(&file));
done:
    cln_atomic_abandon(file);
    json_decref(document);
    free(text);
    return st;
}
