/* The list of exports: what cln_export can write, and an option of `export` each. To add one: a row
 * here and its function in a file of this room (export.h); api/export.c checks and calls. */
#ifndef CLN_EXPORT_LIST_H
#define CLN_EXPORT_LIST_H

/* X(what, needs, form, help): what = the name in cln_export_desc.what and of the option that takes
 * the file; needs = the parts of the run that are opened for it; form = how help names the file,
 * with the endings of which a name must have one. */
#define CLN_EXPORT_LIST(X)                                                                         \
    X(points, VIEWS, "FILE.ply",                                                                   \
      "write points of the surface that training views see, evenly by area, with colours and "     \
      "normals")                                                                                   \
    X(mesh, VIEWS, "FILE.ply|.obj|.glb|.stl",                                                      \
      "write that surface as triangles with colours and normals (STL has no colours); the ending " \
      "names the format")                                                                          \
    X(volume, CELLS, "FILE.npy",                                                                   \
      "write colour and density on a grid: float32 [z][y][x][r, g, b, density]; FILE.json beside " \
      "it has the grid's place; not of a run with --space ndc or shell")                           \
    X(cameras, SCENE, "FILE.json|FOLDER",                                                          \
      "write the scene's cameras: a transforms JSON file, or for a FOLDER COLMAP's text files; "   \
      "of a run with --refine-poses the corrected ones")                                           \
    X(octree, BOXES, "FILE.ply",                                                                   \
      "write the active leaves to this PLY file, as boxes with level and error; - is standard "    \
      "output; not of a run with --space ndc or shell")                                            \
    X(copy, CHECKPOINT, "FOLDER",                                                                  \
      "write a copy of the run for pictures, the viewer and exports elsewhere: its newest model "  \
      "without what only further training needs, and the scene's cameras; a new folder")

#endif
