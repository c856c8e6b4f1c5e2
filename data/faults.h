/* Mistakes of captures, planted into a generated scene one at a time, for tests of what finds them
 * (make-scene --fault). In poses and cameras as they are written, or in the photo of one view. */
#ifndef DATA_FAULTS_H
#define DATA_FAULTS_H

#include <stdint.h>
#include "scene/scene.h"

/* X(name, what is wrong) */
#define FAULT_LIST(X)                                                       \
    X(none, "nothing")                                                      \
    X(axes, "poses have OpenCV's axes instead of OpenGL's")                 \
    X(inverse, "poses are world-to-camera matrices")                        \
    X(focal, "focal lengths are 1.3 times as long")                         \
    X(scale, "camera positions are 8 times as far")                         \
    X(far, "one camera stands 40 times as far away")                        \
    X(pose, "one camera stands on the other side, by a half turn around z") \
    X(swap, "two photos are exchanged")                                     \
    X(copy, "one photo is there twice, under the name of another one, too") \
    X(exposure, "one photo has half of its light")                          \
    X(blur, "one photo is blurred")                                         \
    X(shaken, "poses of training views are off, by 0.3 degrees and 0.5 %")  \
    X(mask, "masks are inverted (with --masks)")

typedef enum {
#define X(name, what) FAULT_##name,
    FAULT_LIST(X)
#undef X
        FAULTS
} fault;

extern const char *const fault_names[FAULTS + 1]; /* and NULL */

/* The faulty views: training views FAULT_VIEW, of some FAULT_OTHER(train), too. */
enum { FAULT_VIEW = 2 };
#define FAULT_OTHER(train) ((train) / 2 + 1)

/* What the file says instead of the camera of training view `view`; -1: of another split's. */
void fault_camera(fault which, int view, cln_camera *camera);

/* The view whose photo is stored as that of training view `view`. */
int fault_photo(fault which, int view, int train);

/* In place: [height][width][channels] of training view `view`. */
cln_status fault_pixels(fault which, int view, int width, int height, int channels,
                        uint8_t *pixels);

#endif
