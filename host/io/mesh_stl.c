/* Meshes as binary STL, which slicers read: 80 bytes of text, the number of triangles, and for each
 * of them its normal, its corners and two bytes of 0, all little-endian whatever the host is;
 * floats of 32 bits, no colours and no shared vertices. */
#include <stdio.h>
#include <string.h>
#include "base/files.h"
#include "io/mesh.h"

enum { HEADER = 80, ROW = 50 };

static void put_word(uint8_t **to, uint32_t word)
{
    for (int byte = 0; byte < 4; byte++)
        *(*to)++ = (uint8_t)(word >> 8 * byte);
}

static void put_three(uint8_t **to, const double v[3])
{
    for (int a = 0; a < 3; a++) {
        const float narrow = (float)v[a];
        uint32_t word = 0;

        memcpy(&word, &narrow, sizeof word);
        put_word(to, word);
    }
}

/* Are two of its corners one in 32 bits? Readers find edges by places: such a triangle has an edge
 * that is none, and two that are one. Without it those that it lay between meet. */
static bool is_nothing(const cln_mesh *mesh, size_t f)
{
    for (int k = 0; k < 3; k++) {
        const double *a = mesh->at[mesh->face[f][k]], *b = mesh->at[mesh->face[f][(k + 1) % 3]];

        if ((float)a[0] == (float)b[0] && (float)a[1] == (float)b[1] && (float)a[2] == (float)b[2])
            return true;
    }
    return false;
}

/* Unit, outwards; 0 of a triangle without area. */
static void find_normal(const cln_mesh *mesh, size_t f, double normal[3])
{
    const double area = cln_mesh_area(mesh, f, normal);

    for (int a = 0; a < 3 && area > 0; a++)
        normal[a] /= area;
}

cln_status cln_mesh_write_stl(const char *path, const cln_mesh *mesh)
{
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL;
    uint8_t bytes[HEADER + 4] = {0}, *to = bytes + HEADER;
    char *cut = NULL;
    size_t faces = 0;

    if (mesh->faces > UINT32_MAX)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %zu triangles are more than an STL file can count", path,
                         mesh->faces));
    /* readers take a file that begins with "solid" for one of text */
    if (snprintf((char *)bytes, HEADER, "%s%s", strncmp(mesh->comment, "solid", 5) == 0 ? "a " : "",
                 mesh->comment) >= HEADER &&
        (cut = strrchr((char *)bytes, ';'))) /* no half digest */
        memset(cut, 0, (size_t)((char *)bytes + HEADER - cut));
    for (size_t f = 0; f < mesh->faces; f++)
        faces += !is_nothing(mesh, f);
    put_word(&to, (uint32_t)faces);
    CLN_TRY(cln_atomic_open(path, &file));
    CLN_TRY(cln_atomic_write(file, bytes, HEADER + 4));
    for (size_t f = 0; f < mesh->faces; f++) {
        double normal[3];
        uint8_t row[ROW] = {0};

        if (is_nothing(mesh, f))
            continue;
        to = row;
        find_normal(mesh, f, normal);
        put_three(&to, normal);
        for (int k = 0; k < 3; k++)
            put_three(&to, mesh->at[mesh->face[f][k]]);
        CLN_TRY(cln_atomic_write(file, row, ROW));
    }
    CLN_TRY(cln_atomic_commit(&file));
done:
    cln_atomic_abandon(file);
    return st;
}
