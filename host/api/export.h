/* The list of exports: what cln_export can write, and an option of `export` each. To add one: a row
 * here and its function in export.c. */
#ifndef CLN_EXPORT_H
#define CLN_EXPORT_H

/* X(what, form, help): what = the name in cln_export_desc.what and of the option that takes the
 * file, form = how help names the file, with the ending that a name must have if it has any. */
#define CLN_EXPORT_LIST(X)                                                                      \
    X(octree, "FILE.ply",                                                                       \
      "write the active leaves to this PLY file, as boxes with level and error; - is standard " \
      "output")

#endif
