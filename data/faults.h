/* Capture mistakes, planted into a generated scene one at a time to test what detects them
 * (make-scene --fault): in the poses and cameras that the files state, or in photos. */
#ifndef DATA_FAULTS_H
#define DATA_FAULTS_H

#include <stdint.h>
#include "scene/scene.h"

/* X(name, what is wrong) */
#define FAULT_LIST(X)                                                          \
    X(none, "nothing")                                                         \
    X(axes, "poses have OpenCV's axes instead of OpenGL's")                    \
    X(inverse, "poses are world-to-camera matrices")                           \
    X(focal, "focal lengths are 1.3 times as long")                            \
    X(scale, "camera positions are 8 times as far")                            \
    X(far, "one camera stands 40 times as far away")                           \
    X(pose, "one camera stands on the other side, by a half turn around z")    \
    X(swap, "two photos are exchanged")                                        \
    X(copy, "one photo is stored twice, also under another's name")            \
    X(exposure, "one photo has half of its light")                             \
    X(clouds, "photos get brighter and darker by turns, by one stop each way") \
    X(blur, "one photo is blurred")                                            \
    X(shaken, "poses of training views are off, by 0.3 degrees and 0.5 %")     \
    X(mask, "masks are inverted (with --masks)")                               \
    X(upright, "poses of --held 3 are of turned pixels")

typedef enum {
#define X(name, what) FAULT_##name,
    FAULT_LIST(X)
#undef X
        FAULTS
} fault;

extern const char *const fault_names[FAULTS + 1]; /* and NULL */

/* The faulty training views: FAULT_VIEW; for swap and copy also FAULT_OTHER(train). */
enum { FAULT_VIEW = 2 };
#define FAULT_OTHER(train) ((train) / 2 + 1)

/* Turns a camera into what the files state. view: number of the training view, -1 in other
 * splits. */
void fault_camera(fault which, int view, cln_camera *camera);

/* The view whose photo is stored as that of training view `view`. */
int fault_photo(fault which, int view, int train);

/* Changes the pixels of training view `view` in place: [height][width][channels]. */
cln_status fault_pixels(fault which, int view, int width, int height, int channels,
                        uint8_t *pixels);

#endif
