/* A surface as a mesh in scene units, and its file. */
#ifndef CLN_EXPORT_MESH_H
#define CLN_EXPORT_MESH_H

#include "export/export.h"
#include "export/parts.h"
#include "io/mesh.h"

/* Allocates rows for `vertices` vertices in a zeroed mesh; the caller sets the rest. */
cln_status cln_export_mesh_make(cln_mesh *mesh, size_t vertices);
void cln_export_mesh_free(cln_mesh *mesh); /* not its faces */

/* Tells of the parts of a surface in the result. */
void cln_export_tell_parts(cln_export_job *job, const cln_parts *parts);

/* Results that tell how far the surface can be trusted, and a warning where it is seen through. */
void cln_export_tell_surface(cln_export_job *job, const cln_surface *surface);

/* Turns and scales the mesh as its format wants it, writes the job's file, in the format of its
 * ending (else PLY), and sets the result's counts, size and box. what: the mesh's name in the
 * file's comment (cln_export_comment). */
cln_status cln_export_mesh_write(cln_export_job *job, const char *what, cln_mesh *mesh);

#endif
