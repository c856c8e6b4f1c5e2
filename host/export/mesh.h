/* A surface as a mesh in scene units, and its file. */
#ifndef CLN_EXPORT_MESH_H
#define CLN_EXPORT_MESH_H

#include "export/export.h"
#include "export/surface.h"
#include "io/mesh.h"

/* Rows for `vertices` in a zeroed mesh; its faces, comment and numbers are the caller's. */
cln_status cln_export_mesh_make(cln_mesh *mesh, size_t vertices);
void cln_export_mesh_free(cln_mesh *mesh); /* not its faces */

/* Writes to the job's file, in the format of its ending (PLY without one), and counts. comment: of
 * what (cln_export_comment). */
cln_status cln_export_mesh_write(cln_export_job *job, const char *what, cln_mesh *mesh);

#endif
