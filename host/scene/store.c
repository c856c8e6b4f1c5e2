/* Tiles of photos in a file. See store.h. */
#include "scene/store.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/files.h"
#include "base/memory.h"
#include "io/disk.h"

/* A tile of four channels has 4,096 bytes, one of three 3,072. The cache is direct-mapped: tile i
 * of the file can be at i % slots alone, so tiles in a row never take each other's place. */
enum { TILE = 32, LEAST_SLOTS = CLN_STORE_LEAST / (32 * 32 * 4 + 8) };
#define TILE_BYTES(channels) ((size_t)TILE * TILE * (size_t)(channels))

struct cln_store {
    int file, failed; /* failed: errno of the first pixel that could not be read */
    size_t slots;
    int64_t *held;                             /* [slots] place of the tile there; -1 */
    uint8_t (*tiles)[(size_t)TILE * TILE * 4]; /* [slots] */
};

static size_t across(int width)
{
    return ((size_t)width + TILE - 1) / TILE;
}

size_t cln_store_room(int width, int height, int channels)
{
    return across(width) * across(height) * TILE_BYTES(channels);
}

const char *cln_store_folder(void)
{
    const char *folder = getenv("TMPDIR");

    return folder && *folder ? folder : "/var/tmp"; /* /tmp is memory on many machines */
}

/* A file without a name. */
static cln_status open_nameless(int *file)
{
    cln_status st = CLN_OK;
    char *path = NULL;

    CLN_TRY(cln_asprintf(&path, "%s/cl-nascent-photos-XXXXXX", cln_store_folder()));
    *file = mkostemp(path, O_CLOEXEC);
    if (*file < 0)
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: no file for the photos can be made there: %s; set TMPDIR to a folder "
                         "that takes one, use --downscale, or raise --host-mem",
                         cln_store_folder(), strerror(errno)));
    unlink(path);
    /* pixels are read in random order: the system need not read ahead */
    (void)posix_fadvise(*file, 0, 0, POSIX_FADV_RANDOM);
done:
    free(path);
    return st;
}

cln_status cln_store_possible(double bytes)
{
    if (cln_is_dir(cln_store_folder()))
        return cln_disk_check(cln_store_folder(), bytes, "the photos");
    return cln_fail(CLN_OUTPUT, "%s%s: no such folder; set TMPDIR to one that is there",
                    cln_store_folder() == getenv("TMPDIR") ? "TMPDIR is " : "", cln_store_folder());
}

cln_status cln_store_create(double bytes, double cached, cln_store **out)
{
    cln_status st = CLN_OK;
    cln_store *store = NULL;

    *out = NULL;
    st = cln_store_possible(bytes);
    if (st != CLN_OK)
        cln_note("finding a place for the photos, for which memory has no room; TMPDIR names "
                 "another folder");
    CLN_TRY(st);
    CLN_TRY(cln_alloc(&store, 1, sizeof *store, "photos"));
    store->file = -1;
    CLN_TRY(cln_store_resize(store, fmin(cached, bytes)));
    CLN_TRY(open_nameless(&store->file));
    *out = store;
    store = NULL;
done:
    cln_store_free(store);
    return st;
}

void cln_store_free(cln_store *store)
{
    if (!store)
        return;
    if (store->file >= 0)
        close(store->file);
    free(store->held);
    free(store->tiles);
    free(store);
}

cln_status cln_store_resize(cln_store *store, double cached)
{
    cln_status st = CLN_OK;

    free(store->held);
    free(store->tiles);
    store->held = NULL;
    store->tiles = NULL;
    store->slots = (size_t)fmax(cached / (double)TILE_BYTES(4), LEAST_SLOTS);
    CLN_TRY(cln_alloc(&store->held, store->slots, sizeof *store->held, "photos"));
    CLN_TRY(cln_alloc(&store->tiles, store->slots, sizeof *store->tiles, "photos"));
    for (size_t i = 0; i < store->slots; i++)
        store->held[i] = -1;
done:
    return st;
}

double cln_store_cached(const cln_store *store)
{
    return (double)store->slots * (double)(TILE_BYTES(4) + sizeof *store->held);
}

/* Writes or reads all of it; 0 or errno. */
static int transfer(int file, uint8_t *bytes, size_t count, size_t place, bool write)
{
    while (count > 0) {
        const ssize_t some = write ? pwrite(file, bytes, count, (off_t)place)
                                   : pread(file, bytes, count, (off_t)place);

        if (some < 0 && errno == EINTR)
            continue;
        if (some <= 0)
            return some < 0 ? errno : EIO;
        bytes += some;
        place += (size_t)some;
        count -= (size_t)some;
    }
    return 0;
}

cln_status cln_store_write(cln_store *store, size_t place, int width, int height, int channels,
                           const uint8_t *pixels)
{
    cln_status st = CLN_OK;
    const size_t pixel = (size_t)channels, row = across(width) * TILE_BYTES(channels);
    uint8_t *tiles = NULL;

    CLN_TRY(cln_alloc(&tiles, row, 1, "photos"));
    for (int top = 0; top < height; top += TILE, place += row) {
        int failed = 0;

        for (int y = top; y < top + TILE && y < height; y++)
            for (int x = 0; x < width; x += TILE) {
                const int wide = width - x < TILE ? width - x : TILE;

                memcpy(tiles + (size_t)(x / TILE) * TILE_BYTES(channels) +
                           (size_t)(y - top) * TILE * pixel,
                       pixels + ((size_t)y * (size_t)width + (size_t)x) * pixel,
                       (size_t)wide * pixel);
            }
        failed = transfer(store->file, tiles, row, place, true);
        if (failed)
            CLN_TRY(cln_fail(CLN_OUTPUT,
                             "%s: the photos cannot be written there: %s; make room, set TMPDIR to "
                             "a folder that has it, use --downscale, or raise --host-mem",
                             cln_store_folder(), strerror(failed)));
    }
done:
    free(tiles);
    return st;
}

/* Where the pixel's tile begins in the file; *slot: where it is if it is in the cache. */
static size_t tile_of(const cln_store *store, size_t place, int width, int channels, int x, int y,
                      size_t *slot)
{
    const size_t tile = (size_t)(y / TILE) * across(width) + (size_t)(x / TILE);

    place += tile * TILE_BYTES(channels);
    *slot = place / TILE_BYTES(channels) % store->slots;
    return place;
}

void cln_store_pixel(cln_store *store, size_t place, int width, int channels, int x, int y,
                     uint8_t out[4])
{
    size_t slot = 0;
    const size_t at = tile_of(store, place, width, channels, x, y, &slot);
    const size_t within = (size_t)(y % TILE * TILE + x % TILE) * (size_t)channels;

    if (store->held[slot] != (int64_t)at) {
        const int failed =
            transfer(store->file, store->tiles[slot], TILE_BYTES(channels), at, false);

        store->held[slot] = failed ? -1 : (int64_t)at;
        if (failed) {
            store->failed = store->failed ? store->failed : failed;
            memset(store->tiles[slot], 0, sizeof store->tiles[slot]);
        }
    }
    memcpy(out, store->tiles[slot] + within, (size_t)channels);
}

cln_status cln_store_check(const cln_store *store)
{
    if (!store->failed)
        return CLN_OK;
    return cln_fail(CLN_OUTPUT,
                    "%s: the photos, which were written there, cannot be read back: %s; set TMPDIR "
                    "to a folder on another disk, use --downscale, or raise --host-mem",
                    cln_store_folder(), strerror(store->failed));
}

void cln_store_fetch(cln_store *store, size_t place, int width, int channels, int x, int y)
{
    size_t slot = 0;
    const size_t at = tile_of(store, place, width, channels, x, y, &slot);

    if (store->held[slot] != (int64_t)at)
        (void)posix_fadvise(store->file, (off_t)at, (off_t)TILE_BYTES(channels),
                            POSIX_FADV_WILLNEED);
}
