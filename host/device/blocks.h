/* Host memory of a CPU device's buffers, in huge pages. A block that a buffer gives up is kept for
 * a later one: its pages are there already, while the system clears every new one, which took a
 * sixth of a minute's processor time on a capture (docs/devices.md). Safe to use from several
 * threads. */
#ifndef CLN_BLOCKS_H
#define CLN_BLOCKS_H

#include <stddef.h>
#include "base/status.h"

typedef struct cln_blocks cln_blocks;
typedef struct cln_block {
    cln_blocks *owner;
    void *memory;    /* [capacity] bytes, aligned to a huge page, not zeroed */
    size_t capacity; /* what it may grow to without moving; more than a buffer's bytes only where
                        address space costs nothing (cln_address_space_is_free) */
    size_t used;     /* bytes of the buffer that has it, or had it last: their pages are there */
    struct cln_block *next;
} cln_block;

cln_status cln_blocks_create(cln_blocks **out); /* CLN_MEMORY */

/* A block of at least so many bytes; NULL if memory is short, or if they are too few for it. */
cln_block *cln_blocks_take(cln_blocks *blocks, size_t bytes);

/* Keeps a block for a later cln_blocks_take; after cln_blocks_close it is freed. */
void cln_block_give_back(cln_block *block);

/* Frees kept blocks, those of fewest pages first, until no more than `most` bytes are kept, and
 * returns how many are. */
size_t cln_blocks_trim(cln_blocks *blocks, size_t most);

/* Frees what is kept, and the rest once the last block is given back. Accepts NULL. */
void cln_blocks_close(cln_blocks *blocks);

#endif
