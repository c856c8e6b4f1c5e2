/* Says what lies at a path: knows folders of other programs by what they have (markers), everything
 * else by the endings of names (kinds), in the folder and in the folders in it. See found.h. */
#include "scene/found.h"

#include <ctype.h>
#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/run_folder.h"
#include "scene/dataset.h"

#define WITH_POSES "with `cl-nascent poses PHOTOS -o SCENE` or COLMAP"

#define OWN_POSES "write them as a transforms.json: docs/formats.md, \"Your own poses\""

#define POLYCAM \
    "turn Polycam's Developer mode on, process the scan again, and export it as Raw data"

/* Folders of other programs, by a file or folder in them. */
static const struct {
    const char *name, *what, *advice;
} markers[] = {
    {"keyframes", "a Polycam capture", POLYCAM},
    {"mesh_info.json", "a Polycam capture", POLYCAM},
    {"EXR_RGBD", "a Record3D capture", "export it again, as EXR + JPG"},
    {"pose", "files of poses as NeRF++ and ScanNet have them", OWN_POSES},
    {"run.json", "a run", "continue it with train --resume, or give the folder of its scene"},
    {"checkpoint/latest", "a run without its run.json", "copy the run again, all of it"},
};

#define METASHAPE                                                                               \
    "export from Metashape what is read: File > Export > Export Cameras, type Agisoft XML, or " \
    "Colmap (2.2 or later)"
#define REALITY "export its registration from there in COLMAP's format, which is read"

/* Files of other programs, by the endings of names and by what they hold near the beginning (NULL:
 * not looked at). */
static const struct {
    const char *endings, *holds, *what, *advice;
} programs[] = {
    {" psx psz ", NULL, "a project of Metashape", METASHAPE},
    {" xml ", "<chunk", "cameras of Metashape", "give that file, or the folder that it is in"},
    {" rcproj rsproj ", NULL, "a project of RealityCapture", REALITY},
    {" csv ", "#name,x,y,alt", "cameras of RealityCapture", REALITY},
    {" out txt ", "# Bundle file", "cameras in Bundler's format",
     "export them in COLMAP's, which is read; " METASHAPE},
    {" txt ", "Omega, Phi, Kappa", "angles of Metashape's cameras", METASHAPE},
    {" txt ", "\"frames\"", "a transforms JSON with an ending more",
     "its name must end in .json; Windows hides endings that an editor appended: rename it, "
     "without "
     "its .txt"},
    {" json ", "\"sfm_data_version\"", "a scene of OpenMVG", CLN_OPENMVG},
};

#define GIVE_SCENE                                                                      \
    "give the folder of a scene: photos with their poses, by transforms.json, COLMAP, " \
    "LLFF, NeuS, NSVF, OpenSfM, Metashape, Polycam or Record3D"

#define IMAGE_ALONE GIVE_SCENE "; of photos without poses find these first, " WITH_POSES

#define GIVE_RUN "give the folder that `cl-nascent train SCENE -o RUN` made"

enum { RUN_DEPTH = 3 }; /* folders of a run's files, as RUN/eval/STEP/FILE */
enum { ENDING_BYTES = 16, HEAD_BYTES = 4096, MOST_READ = 64 << 20 };
enum { JSON, IMAGE, VIDEO, ARCHIVE, MODEL, FILE_OF_ANY, FOLDER, KINDS };

/* Kinds of files, with the advice for a folder that has some; the advice of an earlier kind goes
 * first. */
static const struct {
    const char *one, *many, *extensions, *advice;
} kinds[KINDS] = {
    [JSON] = {"a JSON file", "JSON files", " json ",
              "if the frames are in a JSON file of another name, give that file"},
    [IMAGE] =
        {"an image", "images",
         " png jpg jpeg jpe tif tiff webp heic heif avif bmp gif exr dng cr2 nef arw ",
         "photos alone do not say where the cameras stood: find their poses first, " WITH_POSES},
    [VIDEO] = {"a video", "videos", CLN_VIDEO_ENDINGS,
               "give the video to `cl-nascent poses`, which takes pictures from it and finds their "
               "poses"},
    [ARCHIVE] = {"an archive", "archives", " zip tar tgz 7z rar r3d ",
                 "unpack the archive (an .r3d is a zip) and give the folder in it"},
    [MODEL] = {"a mesh or point cloud", "meshes or point clouds",
               " ply obj glb gltf stl splat spz usdz las laz e57 ",
               "give the photos that it was made from, with their cameras"},
    [FILE_OF_ANY] = {"a file", "files", "", GIVE_SCENE},
    [FOLDER] = {"a folder", "folders", "", GIVE_SCENE},
};

typedef struct survey {
    int count[KINDS];
    int program;        /* the first of programs[] that is there, if of_it is */
    char *of_it;        /* the first of its files, in natural order */
    char *first[KINDS]; /* name of the first of each, in natural order */
    int scenes;         /* folders that are a scene */
    char *scene;        /* the first of them */
    int deeper;         /* the same of folders in its folders */
    char *deep;
    int runs; /* folders that are a run */
    char *run;
} survey;

static void free_survey(survey *found)
{
    for (int kind = 0; kind < KINDS; kind++)
        free(found->first[kind]);
    free(found->scene);
    free(found->deep);
    free(found->run);
    free(found->of_it);
}

/* " ending " of a name, in small letters, as lists of endings have it; false if it has none. */
static bool ending_of(const char *name, char word[ENDING_BYTES])
{
    const char *dot = strrchr(name, '.');
    size_t length = dot ? strlen(dot + 1) : 0;

    if (!length || length > ENDING_BYTES - 3)
        return false;
    word[0] = ' ';
    for (size_t i = 0; i < length; i++)
        word[1 + i] = (char)tolower((unsigned char)dot[1 + i]);
    strcpy(word + 1 + length, " ");
    return true;
}

static int kind_of(const char *name)
{
    char word[ENDING_BYTES];

    if (!ending_of(name, word))
        return FILE_OF_ANY;
    if (strstr(name, ".tar."))
        return ARCHIVE;
    for (int kind = 0; kind < KINDS; kind++)
        if (strstr(kinds[kind].extensions, word))
            return kind;
    return FILE_OF_ANY;
}

/* Which of programs[] the file at `path` is of, or -1; one that cannot be read is of none. */
static int program_of(const char *path)
{
    char word[ENDING_BYTES], head[HEAD_BYTES + 1] = "";
    FILE *file = NULL;

    if (!ending_of(path, word))
        return -1;
    for (int i = 0; i < (int)(sizeof programs / sizeof *programs); i++) {
        if (!strstr(programs[i].endings, word))
            continue;
        if (!programs[i].holds)
            return i;
        file = cln_is_file(path) ? fopen(path, "rb") : NULL; /* a pipe would hold us up */
        if (!file)
            return -1;
        head[fread(head, 1, HEAD_BYTES, file)] = 0;
        fclose(file);
        if (strstr(head, programs[i].holds))
            return i;
    }
    return -1;
}

static cln_status keep_first(char **first, const char *name)
{
    if (*first && cln_natural_compare(*first, name) <= 0)
        return CLN_OK;
    free(*first);
    return cln_strdup(first, name);
}

bool cln_found_run(const char *path)
{
    return (cln_has_file(path, "run.json") && !cln_run_is_of_others(path)) ||
           cln_has_file(path, "checkpoint/latest");
}

/* Counts what is in `folder`, and in the folders in it; within: the name of `folder` if it is one
 * of those, else NULL. */
static cln_status look(const char *folder, const char *within, bool (*is_scene)(const char *path),
                       survey *found)
{
    cln_status st = CLN_OK;
    DIR *dir = opendir(folder);
    char *path = NULL, *name = NULL;

    if (!dir && within)
        return CLN_OK; /* a folder that may not be read is still counted */
    if (!dir)
        return cln_fail(CLN_INPUT, "%s: %s", folder, strerror(errno));
    for (struct dirent *entry = NULL; (entry = readdir(dir));) {
        int kind = FOLDER;

        if (entry->d_name[0] == '.')
            continue;
        free(path);
        free(name);
        path = name = NULL;
        CLN_TRY(cln_path_join(&path, folder, entry->d_name));
        CLN_TRY(cln_path_join(&name, within ? within : "", entry->d_name));
        if (!cln_is_dir(path)) {
            const int program = program_of(path);

            kind = kind_of(name);
            if (program >= 0 && found->of_it && program < found->program) {
                free(found->of_it);
                found->of_it = NULL;
            }
            if (program >= 0 && (!found->of_it || program == found->program)) {
                found->program = program;
                CLN_TRY(keep_first(&found->of_it, name));
            }
        } else if (!within && is_scene(path)) {
            found->scenes++;
            CLN_TRY(keep_first(&found->scene, name));
        } else if (!within && cln_found_run(path)) {
            found->runs++;
            CLN_TRY(keep_first(&found->run, name));
        } else if (!within) {
            CLN_TRY(look(path, name, is_scene, found));
        } else if (is_scene(path)) {
            found->deeper++;
            CLN_TRY(keep_first(&found->deep, name));
        }
        found->count[kind]++;
        CLN_TRY(keep_first(&found->first[kind], name));
    }
done:
    closedir(dir);
    free(path);
    free(name);
    return st;
}

/* Appends ", " and `more` to *text, or begins it with "it holds " and `more`. Frees `more`. */
static cln_status append(char **text, char *more)
{
    const cln_status st = cln_append(text, "%s%s", *text ? ", " : "it holds ", more);

    free(more);
    return st;
}

/* Names the first marker, or else a file of another program, and the images; without one all kinds,
 * and folders if there is nothing else. *advice: that of the first one named. */
static cln_status describe_folder(const char *path, const survey *found, char **what,
                                  const char **advice)
{
    cln_status st = CLN_OK;
    char *part = NULL, *file = NULL;
    bool marked = false;

    for (size_t i = 0; i < sizeof markers / sizeof *markers && !*what; i++) {
        free(file);
        file = NULL;
        CLN_TRY(cln_path_join(&file, path, markers[i].name));
        if (!cln_is_file(file) && !cln_is_dir(file))
            continue;
        *advice = markers[i].advice;
        CLN_TRY(cln_asprintf(&part, "%s (%s)", markers[i].what, markers[i].name));
        CLN_TRY(append(what, part));
        marked = true;
    }
    if (found->of_it && !*what) {
        *advice = programs[found->program].advice;
        CLN_TRY(cln_asprintf(&part, "%s ('%s')", programs[found->program].what, found->of_it));
        CLN_TRY(append(what, part));
        marked = true;
    }
    for (int kind = 0; kind < KINDS; kind++) {
        if (!found->count[kind] || (marked && kind != IMAGE) || (kind == FOLDER && *what))
            continue;
        if (!*advice)
            *advice = kinds[kind].advice;
        if (found->count[kind] == 1)
            CLN_TRY(cln_asprintf(&part, "%s ('%s')", kinds[kind].one, found->first[kind]));
        else
            CLN_TRY(cln_asprintf(&part, "%d %s (the first is '%s')", found->count[kind],
                                 kinds[kind].many, found->first[kind]));
        CLN_TRY(append(what, part));
    }
    if (!*what)
        CLN_TRY(cln_strdup(what, "it is empty"));
    if (!*advice)
        *advice = kinds[FOLDER].advice;
done:
    free(file);
    return st;
}

/* Finds the folder that `path` is in, if that is a scene or a run (*run); else *out stays NULL. */
static cln_status find_around(const char *path, bool (*is_scene)(const char *path), char **out,
                              bool *run)
{
    cln_status st = CLN_OK;
    char *around = NULL, *file = NULL;

    CLN_TRY(cln_path_absolute(&around, path));
    *strrchr(around, '/') = 0;
    if (!*around)
        goto done;
    CLN_TRY(cln_path_join(&file, around, "run.json"));
    *run = cln_is_file(file);
    if (*run || is_scene(around)) {
        *out = around;
        around = NULL;
    }
done:
    free(around);
    free(file);
    return st;
}

/* May the JSON file have frames? What is too large to be looked at, or cannot be read, may. */
static bool may_have_frames(const char *folder, const char *name)
{
    char *path = NULL, *text = NULL;
    size_t bytes = 0;
    bool may = true;

    if (cln_path_join(&path, folder, name) == CLN_OK && cln_is_file(path) &&
        cln_read_file(path, MOST_READ, &text, &bytes) == CLN_OK)
        may = strstr(text, "\"frames\"") != NULL;
    cln_clear_error();
    free(path);
    free(text);
    return may;
}

cln_status cln_found_at(const char *path, bool (*is_scene)(const char *path), char **what,
                        char **advice)
{
    cln_status st = CLN_OK;
    const char *known = NULL;
    char *around = NULL;
    bool run = false, plain = false;
    survey found = {0};

    *what = *advice = NULL;
    CLN_TRY(find_around(path, is_scene, &around, &run));
    if (around)
        CLN_TRY(cln_asprintf(advice, "the folder around it, '%s', is a %s: give that one", around,
                             run ? "run" : "scene"));
    if (!cln_is_dir(path)) {
        const int kind = kind_of(path), program = program_of(path);

        CLN_TRY(cln_asprintf(what, "it is %s%s",
                             program >= 0 ? programs[program].what : kinds[kind].one,
                             program < 0 && kind == FILE_OF_ANY ? " of another kind" : ""));
        if (program >= 0)
            known = programs[program].advice;
        else
            known = kind == IMAGE ? IMAGE_ALONE : kinds[kind].advice;
        if (!*advice)
            CLN_TRY(cln_strdup(advice, known));
        goto done;
    }
    CLN_TRY(look(path, NULL, is_scene, &found));
    CLN_TRY(describe_folder(path, &found, what, &known));
    if (*advice)
        goto done;
    for (int kind = 0; kind < KINDS; kind++) /* what is marked as something else is not */
        plain = plain || known == kinds[kind].advice;
    if (!found.scenes && found.deeper && plain) {
        found.scenes = found.deeper;
        found.scene = found.deep;
        found.deep = NULL;
    }
    if (found.scenes)
        CLN_TRY(cln_asprintf(advice, "its folder '%s' is a scene: give that one%s", found.scene,
                             found.scenes > 1 ? ", or another of its folders" : ""));
    else if (found.runs && plain)
        CLN_TRY(cln_asprintf(advice, "its folder '%s' is a run, which eval, render and info take",
                             found.run));
    else if (known == kinds[JSON].advice && found.count[JSON] == 1 &&
             !may_have_frames(path, found.first[JSON]))
        CLN_TRY(cln_strdup(advice, "no frames are in that; if poses are, " OWN_POSES));
    else if (known == kinds[JSON].advice && found.count[JSON] == 1)
        CLN_TRY(cln_asprintf(advice, "if its frames are in that, give the file: '%s/%s'", path,
                             found.first[JSON]));
    else if (known == kinds[IMAGE].advice && cln_dataset_is_unread(found.first[IMAGE]))
        CLN_TRY(cln_asprintf(advice,
                             "photos such as '%s' are not read: make JPEG or PNG of them%s, then "
                             "find their poses, " WITH_POSES,
                             found.first[IMAGE], cln_dataset_converter(found.first[IMAGE])));
    else
        CLN_TRY(cln_strdup(advice, known));
done:
    free_survey(&found);
    free(around);
    return st;
}

/* Finds the run around `path`, at most so many folders up; else *out stays NULL. */
static cln_status find_run_around(const char *path, char **out)
{
    cln_status st = CLN_OK;
    char *around = NULL, *slash = NULL;

    CLN_TRY(cln_strdup(&around, path));
    for (int up = 0; up < RUN_DEPTH && !*out; up++) {
        for (size_t n = strlen(around); n > 1 && around[n - 1] == '/'; n--)
            around[n - 1] = 0;
        slash = strrchr(around, '/');
        if (!slash || slash == around)
            break;
        *slash = 0;
        if (cln_found_run(around))
            CLN_TRY(cln_strdup(out, around));
    }
done:
    free(around);
    return st;
}

cln_status cln_found_no_run(const char *path, bool (*is_scene)(const char *path), char **what)
{
    cln_status st = CLN_OK;
    char *around = NULL, *holds = NULL, *advice = NULL, quoted[CLN_QUOTED_BYTES];
    const bool folder = cln_is_dir(path);
    survey found = {0};

    *what = NULL;
    CLN_TRY(find_run_around(path, &around));
    if (around)
        CLN_TRY(cln_asprintf(what, "not a run, but in one: give %s", around));
    else if (is_scene(path))
        CLN_TRY(cln_asprintf(what,
                             "a scene, not a run: train on it first, by `cl-nascent train %s "
                             "-o RUN`, and give that RUN",
                             cln_shell_quote(path, quoted, sizeof quoted)));
    else if (cln_found_run(path))
        CLN_TRY(cln_strdup(what, "a run without its run.json; copy the run again, all of it"));
    if (*what)
        goto done;
    if (folder)
        CLN_TRY(look(path, NULL, is_scene, &found));
    if (found.runs)
        CLN_TRY(cln_asprintf(what, "not a run, but its folder '%s' is one: give that one%s",
                             found.run, found.runs > 1 ? ", or another of its folders" : ""));
    else if (folder || cln_is_file(path))
        CLN_TRY(cln_found_at(path, is_scene, &holds, &advice));
    if (holds)
        CLN_TRY(cln_asprintf(what, "not a run%s: %s; " GIVE_RUN,
                             folder ? ", as there is no run.json in it" : "", holds));
    else if (!*what)
        CLN_TRY(cln_strdup(what, "no such folder; " GIVE_RUN));
done:
    free_survey(&found);
    free(around);
    free(holds);
    free(advice);
    return st;
}
