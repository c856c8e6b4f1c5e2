/* A reader of zip archives as numpy writes them. See npz.h. The format (APPNOTE.TXT 4.3): files,
 * each after a local header; then the directory, with a header per file; then an end record, which
 * a comment may follow. Uses the directory; reads local headers only for their length. */
#include "io/npz.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>
#include "base/files.h"
#include "base/memory.h"
#include "io/npy.h"

enum {
    LOCAL_BYTES = 30,
    ENTRY_BYTES = 46,
    END_BYTES = 22,
    COMMENT_MAX = 65535,
    NAME_MAX_BYTES = 255,
    ARRAY_MAX_BYTES = 1 << 26
};
static const size_t MAX_BYTES = (size_t)1 << 30;

typedef struct entry {
    char *name;
    size_t local, packed, bytes; /* local header's offset; compressed and full size */
    uint32_t checksum;
    int method;
} entry;

struct cln_npz {
    char *path, *data;
    size_t size;
    int count, next; /* entries; start of the next search */
    entry *entries;
};

static size_t u16_at(const char *p)
{
    return (size_t)(uint8_t)p[0] | (size_t)(uint8_t)p[1] << 8;
}

static size_t u32_at(const char *p)
{
    return u16_at(p) | u16_at(p + 2) << 16;
}

static cln_status broken(const cln_npz *npz, const char *what)
{
    return cln_fail(CLN_INPUT, "%s: not a whole .npz file: %s; copy or save it again", npz->path,
                    what);
}

static cln_status read_entry(cln_npz *npz, size_t *at, size_t end)
{
    cln_status st = CLN_OK;
    const char *p = npz->data + *at;
    entry *e = &npz->entries[npz->count];
    size_t length = 0, all = 0;

    if (end - *at < ENTRY_BYTES || memcmp(p, "PK\1\2", 4) != 0)
        CLN_TRY(broken(npz, "its directory is damaged"));
    length = u16_at(p + 28);
    all = ENTRY_BYTES + length + u16_at(p + 30) + u16_at(p + 32);
    if (all > end - *at || length > NAME_MAX_BYTES)
        CLN_TRY(broken(npz, "its directory is damaged"));
    e->method = (int)u16_at(p + 10);
    e->checksum = (uint32_t)u32_at(p + 16);
    e->packed = u32_at(p + 20);
    e->bytes = u32_at(p + 24);
    e->local = u32_at(p + 42);
    CLN_TRY(cln_asprintf(&e->name, "%.*s", (int)length, p + ENTRY_BYTES));
    npz->count++;
    *at += all;
done:
    return st;
}

static cln_status read_directory(cln_npz *npz)
{
    cln_status st = CLN_OK;
    const char *end = NULL;
    size_t count = 0, at = 0, bytes = 0;

    for (size_t back = END_BYTES; back <= npz->size && back <= END_BYTES + COMMENT_MAX && !end;
         back++)
        if (!memcmp(npz->data + npz->size - back, "PK\5\6", 4))
            end = npz->data + npz->size - back;
    if (!end)
        CLN_TRY(broken(npz, "it has no directory at its end"));
    count = u16_at(end + 10);
    bytes = u32_at(end + 12);
    at = u32_at(end + 16);
    if (at > (size_t)(end - npz->data) || bytes > (size_t)(end - npz->data) - at)
        CLN_TRY(broken(npz, "its directory lies outside of it"));
    CLN_TRY(cln_alloc(&npz->entries, count, sizeof *npz->entries, npz->path));
    while (npz->count < (int)count)
        CLN_TRY(read_entry(npz, &at, (size_t)(end - npz->data)));
done:
    return st;
}

cln_status cln_npz_open(const char *path, cln_npz **out)
{
    cln_status st = CLN_OK;
    cln_npz *npz = NULL;

    *out = NULL;
    CLN_TRY(cln_alloc(&npz, 1, sizeof *npz, path));
    CLN_TRY(cln_strdup(&npz->path, path));
    CLN_TRY(cln_read_file(path, MAX_BYTES, &npz->data, &npz->size));
    CLN_TRY(read_directory(npz));
    *out = npz;
    npz = NULL;
done:
    cln_npz_close(npz);
    return st;
}

void cln_npz_close(cln_npz *npz)
{
    if (!npz)
        return;
    for (int i = 0; i < npz->count; i++)
        free(npz->entries[i].name);
    free(npz->entries);
    free(npz->path);
    free(npz->data);
    free(npz);
}

/* Callers mostly ask in the archive's order: each search starts where the last one ended. */
static const entry *find(cln_npz *npz, const char *name)
{
    const size_t length = strlen(name);

    for (int i = 0; i < npz->count; i++) {
        const int k = (npz->next + i) % npz->count;

        if (!strncmp(npz->entries[k].name, name, length) &&
            !strcmp(npz->entries[k].name + length, ".npy")) {
            npz->next = k + 1;
            return &npz->entries[k];
        }
    }
    return NULL;
}

bool cln_npz_has(cln_npz *npz, const char *name)
{
    return find(npz, name) != NULL;
}

/* Raw deflate of `packed` bytes into exactly e->bytes. */
static bool unpack(const entry *e, const char *packed, char *out)
{
    z_stream z = {.next_in = (Bytef *)(uintptr_t)packed,
                  .avail_in = (uInt)e->packed,
                  .next_out = (Bytef *)out,
                  .avail_out = (uInt)e->bytes};
    bool whole = false;

    if (inflateInit2(&z, -MAX_WBITS) != Z_OK)
        return false;
    whole = inflate(&z, Z_FINISH) == Z_STREAM_END && z.total_out == e->bytes;
    inflateEnd(&z);
    return whole;
}

cln_status cln_npz_read(cln_npz *npz, const char *name, int *dims, int shape[4], double **data)
{
    cln_status st = CLN_OK;
    const entry *e = find(npz, name);
    const char *packed = NULL;
    char *bytes = NULL, *where = NULL;
    size_t start = 0;

    *data = NULL;
    CLN_TRY(cln_asprintf(&where, "%s: %s", npz->path, name));
    if (!e)
        CLN_TRY(
            cln_fail(CLN_INPUT, "%s: there is no such array; save the file again with it", where));
    if (e->method != 0 && e->method != 8)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: packed by method %d; only stored and deflated arrays are read; save "
                         "it with numpy.savez",
                         where, e->method));
    if (e->bytes > ARRAY_MAX_BYTES)
        CLN_TRY(cln_fail(
            CLN_INPUT,
            "%s: an array of %zu bytes is more than the %d that are read; save a smaller one",
            where, e->bytes, ARRAY_MAX_BYTES));
    if (e->local > npz->size || npz->size - e->local < LOCAL_BYTES ||
        memcmp(npz->data + e->local, "PK\3\4", 4) != 0)
        CLN_TRY(broken(npz, name));
    start = e->local + LOCAL_BYTES + u16_at(npz->data + e->local + 26) +
            u16_at(npz->data + e->local + 28);
    if (start > npz->size || e->packed > npz->size - start ||
        (e->method == 0 && e->packed != e->bytes))
        CLN_TRY(broken(npz, name));
    packed = npz->data + start;
    CLN_TRY(cln_alloc(&bytes, e->bytes + 1, 1, where));
    if (e->method == 0)
        memcpy(bytes, packed, e->bytes);
    else if (!unpack(e, packed, bytes))
        CLN_TRY(broken(npz, name));
    if (crc32(0, (const Bytef *)bytes, (uInt)e->bytes) != e->checksum)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: its checksum is wrong; copy or save it again", where));
    CLN_TRY(cln_npy_decode(where, bytes, e->bytes, dims, shape, data));
done:
    free(bytes);
    free(where);
    return st;
}
