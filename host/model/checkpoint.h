/* The steps of writing a checkpoint that checkpoint.c, which writes it in one process, shares with
 * checkpoint_parts.c, where all ranks write. model.h says what a checkpoint is and reads it. */
#ifndef CLN_CHECKPOINT_H
#define CLN_CHECKPOINT_H

#include "io/safetensors.h"
#include "model/model.h"

enum { CLN_CHECKPOINT_TENSORS = 15 };

/* Sets *path to RUN/checkpoint/NNNNNNNN.safetensors, for the caller to free, and makes its
 * folder. */
cln_status cln_checkpoint_path(const char *run, const cln_model *model, char **path);

/* Lists the tensors. Their data are the model's arrays and *rows, which the caller frees. */
cln_status cln_checkpoint_tensors(const cln_model *model, cln_tensor *out, int *number,
                                  int32_t **rows);

/* Writes the document and `latest` once the tensors are written, then removes old checkpoints. */
cln_status cln_checkpoint_finish(const char *run, const cln_model *model, uint64_t tensors_digest,
                                 uint64_t model_digest);

#endif
