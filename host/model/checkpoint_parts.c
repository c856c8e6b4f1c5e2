/* A checkpoint written by all ranks. The file of tensors is that of one process, byte for byte:
 *
 *   rank 0     makes the file under a temporary name, with a number in it that no other file has
 *   each       opens it and looks for that number: without it, they share no file system
 *   each       writes its rows of the weights and of Adam's state to their places, and syncs them;
 *              rank 0 also writes what all ranks have
 *   in turn    each adds its bytes to the digest, which covers all bytes in order
 *   rank 0     writes the head, renames, then writes the document
 *
 * After each step all ranks know whether one has failed. If so, nothing is renamed, and the earlier
 * checkpoints stay whole. */
#include "model/checkpoint.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "base/log.h"
#include "base/memory.h"
#include "ranks/ranks.h"

enum { TEXT_BYTES = 512, PATH_BYTES = 4096 };

/* The file that all ranks write. */
typedef struct shared_file {
    const char *run;
    const cln_model *model;
    const int *first; /* [ranks + 1] leaves */
    cln_tensor tensors[CLN_CHECKPOINT_TENSORS];
    int count;
    int32_t *rows;             /* of one of the tensors */
    cln_atomic_file *file;     /* rank 0's */
    char temp[PATH_BYTES];     /* its path until the commit */
    int fd;                    /* -1: not open */
    uint64_t digest, of_model; /* rank 0's, in the end */
} shared_file;

/* ---- one outcome for all ---- */

/* If one rank has failed, all fail with its error sentence, so that rank 0 cleans up and reports
 * it. */
static cln_status same_end(cln_status st)
{
    double failed = st != CLN_OK;
    const size_t ranks = (size_t)cln_ranks_count();
    int first[CLN_RANKS_MOST + 1];
    char *texts = NULL;

    cln_ranks_largest(&failed, 1);
    if (failed == 0)
        return CLN_OK;
    if (cln_alloc(&texts, ranks, TEXT_BYTES, "errors of ranks") != CLN_OK)
        return CLN_MEMORY; /* and so this rank ends all */
    if (st != CLN_OK)
        snprintf(texts + (size_t)cln_ranks_me() * TEXT_BYTES, TEXT_BYTES, "%s", cln_error_text());
    for (int r = 0; r <= cln_ranks_count(); r++)
        first[r] = r;
    cln_ranks_gather(texts, TEXT_BYTES, first, true);
    for (size_t r = 0; r < ranks && st == CLN_OK; r++)
        if (texts[r * TEXT_BYTES])
            st = cln_fail(CLN_OUTPUT, "rank %zu: %s", r, texts + r * TEXT_BYTES);
    free(texts);
    return st;
}

/* ---- writing at offsets ---- */

static cln_status cannot_write(const char *path)
{
    return cln_fail(CLN_OUTPUT, "%s: cannot write: %s; make room or choose another folder", path,
                    strerror(errno));
}

static cln_status write_at(int fd, const char *path, const void *data, size_t bytes, size_t at)
{
    const char *from = data;

    while (bytes > 0) {
        const ssize_t done = pwrite(fd, from, bytes, (off_t)at);

        if (done < 0 && errno == EINTR)
            continue;
        if (done <= 0)
            return cannot_write(path);
        from += done;
        at += (size_t)done;
        bytes -= (size_t)done;
    }
    return CLN_OK;
}

/* Is each row of this tensor on its leaf's rank alone? */
static bool is_dealt(const cln_tensor *t)
{
    static const char *const names[] = {"params", "adam_m", "adam_v", "adam_steps"};

    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (strcmp(t->name, names[i]) == 0)
            return true;
    return false;
}

/* The bytes of a tensor that this rank writes: [*at, *at + *bytes). */
static void own_bytes(const cln_tensor *t, const int *first, size_t *at, size_t *bytes)
{
    const int me = cln_ranks_me();
    const size_t all = cln_tensor_bytes(t), row = t->shape[0] > 0 ? all / (size_t)t->shape[0] : 0;

    *at = is_dealt(t) ? (size_t)first[me] * row : 0;
    *bytes = is_dealt(t) ? (size_t)(first[me + 1] - first[me]) * row : me == 0 ? all : 0;
}

static cln_status write_own(const shared_file *f)
{
    cln_status st = CLN_OK;
    size_t offsets[CLN_CHECKPOINT_TENSORS], at = 0, bytes = 0;
    char *head = NULL;

    CLN_TRY(cln_safetensors_head(f->count, f->tensors, 0, &head, &bytes, offsets));
    for (int i = 0; i < f->count; i++) {
        own_bytes(&f->tensors[i], f->first, &at, &bytes);
        CLN_TRY(write_at(f->fd, f->temp, (const char *)f->tensors[i].data + at, bytes,
                         offsets[i] + at));
    }
    if (fsync(f->fd) != 0)
        CLN_TRY(cannot_write(f->temp));
done:
    free(head);
    return st;
}

/* ---- digests ---- */

/* Digests all bytes in order. All ranks call it; rank 0 gets the digests. */
static void digest_all(shared_file *f)
{
    struct {
        cln_digest_part tensor, model;
    } baton = {0};

    f->digest = CLN_DIGEST_START;
    for (int i = 0; i < f->count; i++) {
        const cln_tensor *t = &f->tensors[i];
        const bool weights = t->data == f->model->params;
        size_t at = 0, bytes = 0;

        if (!is_dealt(t) && cln_ranks_me() > 0)
            continue;
        own_bytes(t, f->first, &at, &bytes);
        cln_safetensors_digest_begin(t, f->digest, &baton.tensor);
        if (weights)
            cln_model_digest_begin(f->model, &baton.model);
        if (is_dealt(t))
            cln_ranks_take(&baton, sizeof baton);
        cln_digest_more(&baton.tensor, (const char *)t->data + at, bytes);
        if (weights)
            cln_digest_more(&baton.model, (const char *)t->data + at, bytes);
        if (is_dealt(t))
            cln_ranks_hand(&baton, sizeof baton);
        f->digest = cln_digest_end(&baton.tensor);
        if (weights)
            f->of_model = cln_digest_end(&baton.model);
    }
}

/* ---- the file ---- */

/* Rank 0 makes the file, and all ranks open it. *one: all of them see the same file. */
static cln_status open_one(shared_file *f, bool *one)
{
    cln_status st = CLN_OK;
    const bool makes = cln_ranks_me() == 0;
    struct {
        uint64_t number;
        char temp[PATH_BYTES];
    } told = {0};
    uint64_t found = 0;
    struct timespec now;
    char *path = NULL;
    double other = 0;
    int reading = -1;

    if (makes) {
        CLN_TRY(cln_checkpoint_path(f->run, f->model, &path));
        CLN_TRY(cln_atomic_open(path, &f->file));
        if (snprintf(told.temp, sizeof told.temp, "%s", cln_atomic_temp(f->file)) >= PATH_BYTES)
            CLN_TRY(cln_fail(CLN_OUTPUT, "%s: the path is too long; choose another folder", path));
        clock_gettime(CLOCK_REALTIME, &now);
        told.number = cln_digest(CLN_DIGEST_START, &now, sizeof now) + (uint64_t)getpid();
        CLN_TRY(cln_atomic_write(f->file, &told.number, sizeof told.number));
        /* synced, as other machines see only what the file server has */
        if (fflush(cln_atomic_stream(f->file)) != 0 ||
            fsync(fileno(cln_atomic_stream(f->file))) != 0)
            CLN_TRY(cannot_write(path));
    }
done:
    free(path);
    st = same_end(st);
    if (st != CLN_OK)
        return st;
    cln_ranks_tell(&told, sizeof told);
    memcpy(f->temp, told.temp, sizeof told.temp);
    reading = open(f->temp, O_RDONLY | O_CLOEXEC);
    other = reading < 0 || pread(reading, &found, sizeof found, 0) != sizeof found ||
            found != told.number;
    if (reading >= 0)
        close(reading);
    /* not for reading: an NFS client would then write whole pages back, with outdated rows of other
     * ranks in them */
    f->fd = other == 0 ? open(f->temp, O_WRONLY | O_CLOEXEC) : -1;
    other = f->fd < 0;
    cln_ranks_largest(&other, 1);
    *one = other == 0;
    return CLN_OK;
}

/* Rank 0's last step, when all rows are written. */
static cln_status finish(shared_file *f)
{
    cln_status st = CLN_OK;
    size_t offsets[CLN_CHECKPOINT_TENSORS], bytes = 0;
    char *head = NULL;

    CLN_TRY(cln_safetensors_head(f->count, f->tensors, f->digest, &head, &bytes, offsets));
    CLN_TRY(write_at(f->fd, f->temp, head, bytes, 0));
    CLN_TRY(cln_atomic_commit(&f->file));
    CLN_TRY(cln_checkpoint_finish(f->run, f->model, f->digest, f->of_model));
done:
    free(head);
    return st;
}

cln_status cln_checkpoint_write_parts(const char *run, const cln_model *model, const int *first,
                                      uint64_t *model_digest, bool *written)
{
    cln_status st = CLN_OK;
    shared_file f = {.run = run, .model = model, .first = first, .fd = -1};

    *written = false;
    CLN_TRY(open_one(&f, written));
    if (!*written) {
        cln_debug("not all ranks see %s: rank 0 writes the checkpoint", f.temp);
        goto done;
    }
    st = cln_checkpoint_tensors(model, f.tensors, &f.count, &f.rows);
    if (st == CLN_OK)
        st = write_own(&f);
    CLN_TRY(same_end(st));
    digest_all(&f);
    *model_digest = f.of_model;
    if (cln_ranks_me() == 0)
        st = finish(&f);
    CLN_TRY(same_end(st));
done:
    if (st != CLN_OK)
        cln_note("writing a checkpoint of step %" PRId64, model->step);
    if (f.fd >= 0)
        close(f.fd);
    cln_atomic_abandon(f.file);
    free(f.rows);
    return st;
}
