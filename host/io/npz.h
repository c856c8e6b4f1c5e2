/* NumPy .npz files: a zip archive of .npy files, stored (numpy.savez) or deflated
 * (numpy.savez_compressed). Reading only; no ZIP64, no encryption. */
#ifndef CLN_NPZ_H
#define CLN_NPZ_H

#include "base/status.h"

typedef struct cln_npz cln_npz;

/* Reads the file and its directory; at most 2^30 bytes. CLN_INPUT with the path and the error. */
cln_status cln_npz_open(const char *path, cln_npz **out);
void cln_npz_close(cln_npz *npz); /* accepts NULL */

bool cln_npz_has(cln_npz *npz, const char *name);

/* The array `name` (name.npy in the archive) as from cln_npy_decode. CLN_INPUT if it is missing,
 * has a wrong checksum or exceeds 2^26 bytes. The caller frees *data. */
cln_status cln_npz_read(cln_npz *npz, const char *name, int *dims, int shape[4], double **data);

#endif
