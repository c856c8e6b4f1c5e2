/* PLY, binary little-endian: a text header with elements and their properties, then all vertices,
 * then all faces. Vertex i of a box has the upper x if bit 0 of i is set, the upper y for bit 1,
 * the upper z for bit 2; a face's vertices run counter-clockwise as seen from outside. */
#include "io/ply.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include "base/files.h"

/* Numbers are written as they are in memory. */
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "ply.c is for little-endian hosts");

enum {
    VERTICES = 8,
    FACES = 6,
    VERTEX_BYTES = 3 * 8 + 3 + 1 + 4, /* with doubles */
    FACE_BYTES = 1 + 4 * 4,
    HEADER_BYTES = 1024
};

static const int faces[FACES][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                                    {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};

static cln_status write_header(cln_atomic_file *file, int count, bool wide, const char *comment)
{
    const char *real = wide ? "double" : "float";
    char text[HEADER_BYTES];
    const int bytes =
        snprintf(text, sizeof text,
                 "ply\n"
                 "format binary_little_endian 1.0\n"
                 "comment %.512s\n"
                 "element vertex %lld\n"
                 "property %s x\n"
                 "property %s y\n"
                 "property %s z\n"
                 "property uchar red\n"
                 "property uchar green\n"
                 "property uchar blue\n"
                 "property uchar level\n"
                 "property float error\n"
                 "element face %lld\n"
                 "property list uchar int vertex_indices\n"
                 "end_header\n",
                 comment, (long long)VERTICES * count, real, real, real, (long long)FACES * count);

    CLN_ASSERT(bytes > 0 && bytes < HEADER_BYTES);
    return cln_atomic_write(file, text, (size_t)bytes);
}

static void put(uint8_t **to, const void *data, size_t bytes)
{
    memcpy(*to, data, bytes);
    *to += bytes;
}

static cln_status write_vertices(cln_atomic_file *file, const cln_ply_box *box, bool wide)
{
    uint8_t bytes[VERTICES * VERTEX_BYTES], *to = bytes;

    for (int i = 0; i < VERTICES; i++) {
        for (int a = 0; a < 3; a++) {
            const double at = (i >> a) & 1 ? box->max[a] : box->min[a];
            const float narrow = (float)at;

            if (wide)
                put(&to, &at, sizeof at);
            else
                put(&to, &narrow, sizeof narrow);
        }
        put(&to, box->colour, 3);
        put(&to, &box->level, 1);
        put(&to, &box->error, sizeof(float));
    }
    return cln_atomic_write(file, bytes, (size_t)(to - bytes));
}

static cln_status write_faces(cln_atomic_file *file, int32_t first)
{
    uint8_t bytes[FACES * FACE_BYTES], *to = bytes;
    const uint8_t corners = 4;

    for (int f = 0; f < FACES; f++) {
        put(&to, &corners, 1);
        for (int k = 0; k < 4; k++) {
            const int32_t vertex = first + faces[f][k];

            put(&to, &vertex, sizeof vertex);
        }
    }
    return cln_atomic_write(file, bytes, sizeof bytes);
}

static bool fit_floats(int count, const cln_ply_box *boxes, double fine)
{
    double largest = 0;

    for (int i = 0; i < count; i++)
        for (int a = 0; a < 3; a++)
            largest = fmax(largest, fmax(fabs(boxes[i].min[a]), fabs(boxes[i].max[a])));
    return largest * 0x1p-24 <= fine / 100;
}

cln_status cln_ply_write_boxes(const char *path, int count, const cln_ply_box *boxes, double fine,
                               const char *comment)
{
    cln_status st = CLN_OK;
    const bool wide = !fit_floats(count, boxes, fine);
    cln_atomic_file *file = NULL;

    CLN_ASSERT(count >= 0 && count <= INT32_MAX / VERTICES && !strchr(comment, '\n'));
    CLN_TRY(cln_atomic_open(path, &file));
    CLN_TRY(write_header(file, count, wide, comment));
    for (int i = 0; i < count; i++)
        CLN_TRY(write_vertices(file, &boxes[i], wide));
    for (int i = 0; i < count; i++)
        CLN_TRY(write_faces(file, VERTICES * i));
    CLN_TRY(cln_atomic_commit(&file));
done:
    cln_atomic_abandon(file);
    return st;
}
