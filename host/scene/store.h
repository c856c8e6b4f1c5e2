/* The pixels of photos in a file, for sets that --host-mem has no room for. A photo's 8-bit pixels
 * lie there in tiles of TILE x TILE, so that pixels near each other are read together; a cache of
 * fixed size holds the tiles read last. What is read is what was written, so training draws the
 * same bits as from memory. The file is in TMPDIR, or /var/tmp, and has no name: it vanishes with
 * the process.
 *
 * Photos may be written by several threads; reading is for one. */
#ifndef CLN_STORE_H
#define CLN_STORE_H

#include <stddef.h>
#include <stdint.h>
#include "base/status.h"

typedef struct cln_store cln_store;

enum { CLN_STORE_LEAST = 64 * 4104 }; /* bytes of the smallest cache */

/* Room that a photo takes: whole tiles. */
size_t cln_store_room(int width, int height, int channels);

/* The folder in which stores are made. */
const char *cln_store_folder(void);

/* CLN_OUTPUT if that is no folder, takes no file, or its disk has no room for `bytes` bytes. */
cln_status cln_store_possible(double bytes);

/* Makes a file of `bytes` bytes, and a cache of about `cached` bytes. CLN_OUTPUT, as above;
 * CLN_MEMORY. */
cln_status cln_store_create(double bytes, double cached, cln_store **out);
void cln_store_free(cln_store *store); /* accepts NULL */

/* Writes a photo's pixels, [height][width][channels], from byte `place` on. CLN_OUTPUT. */
cln_status cln_store_write(cln_store *store, size_t place, int width, int height, int channels,
                           const uint8_t *pixels);

/* Reads the channels of pixel (x, y) of the photo at `place`, of this width. If it cannot be read,
 * they are 0, and cln_store_check returns CLN_OUTPUT from then on. */
void cln_store_pixel(cln_store *store, size_t place, int width, int channels, int x, int y,
                     uint8_t out[4]);
cln_status cln_store_check(const cln_store *store);

/* Asks the system to read the pixel's tile ahead. */
void cln_store_fetch(cln_store *store, size_t place, int width, int channels, int x, int y);

/* Cached: bytes of the cache. Resize: makes it an empty one of about `cached` bytes; with
 * CLN_MEMORY there is none. */
double cln_store_cached(const cln_store *store);
cln_status cln_store_resize(cln_store *store, double cached);

#endif
