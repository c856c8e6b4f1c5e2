/* The halves of a checkpoint, for those who write it: checkpoint.c at once, checkpoint_parts.c by
 * all ranks. What a checkpoint is, and how it is read, is model.h's. */
#ifndef CLN_CHECKPOINT_H
#define CLN_CHECKPOINT_H

#include "io/safetensors.h"
#include "model/model.h"

enum { CLN_CHECKPOINT_TENSORS = 12 };

/* RUN/checkpoint/NNNNNNNN.safetensors, whose folder is made. */
cln_status cln_checkpoint_path(const char *run, const cln_model *model, char **path);

/* Lists the tensors, whose data are the model's and *rows; the caller frees that. */
cln_status cln_checkpoint_tensors(const cln_model *model, cln_tensor *out, int *number,
                                  int32_t **rows);

/* Writes all else once the tensors are there, and removes old checkpoints. */
cln_status cln_checkpoint_finish(const char *run, const cln_model *model, uint64_t tensors_digest,
                                 uint64_t model_digest);

#endif
