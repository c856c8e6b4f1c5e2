/* See blocks.h. */
#include "device/blocks.h"

#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>
#include "base/memory.h"

/* A block can grow to GROWTH times its first buffer, as trees grow. */
enum { GROWTH = 8 };

struct cln_blocks {
    pthread_mutex_t lock;
    cln_block *kept; /* the one of fewest used bytes first */
    size_t kept_bytes;
    int lent;
    bool closed;
};

cln_status cln_blocks_create(cln_blocks **out)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_alloc(out, 1, sizeof **out, "device memory"));
    if (pthread_mutex_init(&(*out)->lock, NULL) != 0) {
        free(*out);
        *out = NULL;
        CLN_TRY(cln_fail(CLN_MEMORY, "device memory: no lock"));
    }
done:
    return st;
}

static void free_blocks(cln_blocks *blocks)
{
    pthread_mutex_destroy(&blocks->lock);
    free(blocks);
}

static void free_block(cln_block *block)
{
    free(block->memory);
    free(block);
}

/* Gives the system what a buffer of so many bytes does not need, as it is counted nowhere. */
static void give_up_pages(const cln_block *block, size_t bytes)
{
    const size_t begin = (bytes + CLN_HUGE_PAGE - 1) / CLN_HUGE_PAGE * CLN_HUGE_PAGE;
    const size_t page = (size_t)sysconf(_SC_PAGESIZE);

    /* whole pages: the rest of the last one may be another block's */
    if (block->used > begin && block->used - begin >= page)
        (void)madvise((char *)block->memory + begin, (block->used - begin) / page * page,
                      MADV_DONTNEED);
}

/* Takes a kept block out that holds so many bytes, the one with the most pages that they use. */
static cln_block *take_kept(cln_blocks *blocks, size_t bytes)
{
    cln_block **best = NULL, *block = NULL;

    for (cln_block **at = &blocks->kept; *at; at = &(*at)->next)
        if ((*at)->capacity >= bytes && (*at)->used / 3 <= bytes / 2) /* else many pages are lost */
            best = !best || (*best)->used < bytes ? at : best;
    if (!best)
        return NULL;
    block = *best;
    *best = block->next;
    blocks->kept_bytes -= block->used;
    give_up_pages(block, bytes);
    return block;
}

static cln_block *make_block(cln_blocks *blocks, size_t bytes)
{
    cln_block *block = malloc(sizeof *block);
    const bool grows = bytes <= SIZE_MAX / GROWTH && cln_address_space_is_free();
    const size_t capacity = grows ? bytes * GROWTH : bytes;

    if (!block)
        return NULL;
    *block = (cln_block){.owner = blocks, .memory = cln_huge_pages(capacity), .capacity = capacity};
    if (!block->memory) {
        block->capacity = bytes;
        block->memory = cln_huge_pages(bytes);
    }
    if (!block->memory) {
        free(block);
        return NULL;
    }
    return block;
}

cln_block *cln_blocks_take(cln_blocks *blocks, size_t bytes)
{
    cln_block *block = NULL;

    if (bytes < CLN_HUGE_PAGE)
        return NULL;
    pthread_mutex_lock(&blocks->lock);
    block = take_kept(blocks, bytes);
    if (!block)
        block = make_block(blocks, bytes);
    if (block) {
        block->used = bytes;
        blocks->lent++;
    }
    pthread_mutex_unlock(&blocks->lock);
    return block;
}

void cln_block_give_back(cln_block *block)
{
    cln_blocks *blocks = block->owner;
    cln_block **at = &blocks->kept;
    bool last = false;

    pthread_mutex_lock(&blocks->lock);
    blocks->lent--;
    last = blocks->closed && blocks->lent == 0;
    if (blocks->closed) {
        free_block(block);
    } else {
        while (*at && (*at)->used < block->used)
            at = &(*at)->next;
        block->next = *at;
        *at = block;
        blocks->kept_bytes += block->used;
    }
    pthread_mutex_unlock(&blocks->lock);
    if (last)
        free_blocks(blocks);
}

/* Its caller has the lock. */
static void trim(cln_blocks *blocks, size_t most)
{
    while (blocks->kept && blocks->kept_bytes > most) {
        cln_block *block = blocks->kept;

        blocks->kept = block->next;
        blocks->kept_bytes -= block->used;
        free_block(block);
    }
}

size_t cln_blocks_trim(cln_blocks *blocks, size_t most)
{
    size_t kept = 0;

    pthread_mutex_lock(&blocks->lock);
    trim(blocks, most);
    kept = blocks->kept_bytes;
    pthread_mutex_unlock(&blocks->lock);
    return kept;
}

void cln_blocks_close(cln_blocks *blocks)
{
    bool last = false;

    if (!blocks)
        return;
    pthread_mutex_lock(&blocks->lock);
    trim(blocks, 0); /* at once with `closed`: one that is given back in between would be kept */
    blocks->closed = true;
    last = blocks->lent == 0;
    pthread_mutex_unlock(&blocks->lock);
    if (last)
        free_blocks(blocks);
}
