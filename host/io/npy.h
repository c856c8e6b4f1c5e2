/* NumPy .npy files. Writes float32, little-endian, in C order; also reads float64 and Fortran
 * order. */
#ifndef CLN_NPY_H
#define CLN_NPY_H

#include <stddef.h>
#include "base/files.h"

#define CLN_NPY_MAX_BYTES ((size_t)1 << 31) /* of data */
#define CLN_NPY_HEAD      128               /* bytes before the data, as it is written here */

/* Writes shape[dims] float32, atomically. */
cln_status cln_npy_write_f32(const char *path, int dims, const int *shape, const float *data);

/* The same for an array of any size that is made in pieces: writes the header; the caller then
 * writes the data with cln_atomic_write, and commits. */
cln_status cln_npy_begin_f32(const char *path, int dims, const int *shape, cln_atomic_file **out);

/* Reads files as the writer makes them (version 1.0, '<f4', C order, up to 4 dimensions, at most
 * 2^31 bytes). The caller frees *data. CLN_INPUT names path and defect. */
cln_status cln_npy_read_f32(const char *path, int *dims, int shape[4], float **data);

/* The same for float32 or float64, in either order, from the bytes of a file, as double in C order;
 * path: for sentences. Values may also be NaN. The caller frees *data. */
cln_status cln_npy_decode(const char *path, const char *file, size_t bytes, int *dims, int shape[4],
                          double **data);

#endif
