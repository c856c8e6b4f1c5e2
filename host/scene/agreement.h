/* What agree.h finds: ties, what agrees, and what else was tried. Shared by agree.c, which finds
 * ties, trials.c and brightness.c, which read them. */
#ifndef CLN_AGREEMENT_H
#define CLN_AGREEMENT_H

#include "scene/scene.h"

/* A feature in two views. */
typedef struct cln_tie {
    int a, b; /* views */
    float ua, va, ub, vb, value_a, value_b;
    float tolerance;  /* angle up to which its rays meet, rad; with focal lengths as given */
    bool cut, agrees; /* cut: masks or alpha cut it away */
} cln_tie;

/* Where a quaternion's w is in the numbers that a pose was made of, if not where it was read. */
typedef enum cln_reading_w { CLN_W_IS_RIGHT, CLN_W_IS_LAST, CLN_W_IS_FIRST } cln_reading_w;

/* Other readings of the poses that are tried, besides the given one. */
typedef struct cln_reading {
    const char *name, *advice;
    double axes[9];  /* row-major; the camera's axes are turned by it */
    bool inverse;    /* the matrix is inverted first */
    cln_reading_w w; /* the quaternion's w is moved first */
} cln_reading;

enum { CLN_READINGS = 12, CLN_ORDERS = 7 }; /* the first reading is the given one */
extern const cln_reading cln_readings[CLN_READINGS];

/* The pose that a reading makes of a given one; 3x4, row-major, camera (x right, y down, z forward)
 * to scene. out is another than given. */
void cln_reading_pose(const cln_reading *reading, const double given[12], double out[12]);

extern const double cln_exposure_jump; /* stops: views that jump by more may be faulty */

typedef struct cln_agree_view {
    bool looked_at;     /* false: the set was too large */
    int features;       /* of its photo */
    int ties, agreeing; /* with other views */
    int partners;       /* other views with which several ties agree */
    double exposure;    /* brightness relative to all others, in stops; or NaN */
    double jump;        /* the same, to those it was compared with that do not jump; or NaN */
    double around;      /* the most that these differ from others without a jump: their median */
    bool over;   /* no view agrees with it, but many ties would were it turned by 180 degrees */
    bool bad;    /* its pose does not fit its photo, while others' do */
    int pose_of; /* the view whose pose fits this photo better; -1 */
} cln_agree_view;

/* Photos, of one folder or every second one by name, that other focal lengths fit, not the rest. */
typedef struct cln_agree_part {
    bool *has;           /* [view]; NULL: there is none */
    char name[160];      /* "photos in right" */
    double focal;        /* factor on their focal lengths */
    double share, given; /* of the ties with them: those that agree exactly with it, without it */
} cln_agree_part;

/* Photos whose poses fit each other, but are of another frame than most photos' (merged.h). */
typedef struct cln_agree_merged {
    bool *has;      /* [view] */
    int parts;      /* whose frames are others; 0: none is */
    int marks;      /* that the largest of them and most photos show, */
    int fitting;    /* and of these, that a similarity takes from one frame to the other */
    double scale;   /* of that similarity: units of most photos' frame for one of the part's */
    double degrees; /* its angle */
} cln_agree_merged;

#define CLN_FOOT 0.3048 /* metres */

/* Positions of cameras with other axes, or another unit along one, and rotations as given. */
typedef struct cln_agree_place {
    int axis[3];      /* of the given positions, for x, y, z, */
    double factor[3]; /* and what it is multiplied by */
    double exact;     /* share of the ties that agree exactly with it; 0: none does clearly more */
} cln_agree_place;

typedef struct cln_agreement {
    cln_agree_view *views; /* [view_count] */
    int tie_count;
    cln_tie *ties;
    int looked_at, pairs;
    int agreeing;                      /* ties */
    double share;                      /* of the ties that agree; NaN if there are too few ties */
    int reading;                       /* the one that most ties agree with */
    double reading_share, given_share; /* of that one, and of the given one; from a few ties on */
    double focal;        /* the factor on all focal lengths that most ties agree with */
    double focal_share;  /* share of ties that agree with it, within a quarter of the tolerance */
    double focal_exact;  /* that share over the one of ties that agree with it at all */
    double strict_share; /* as focal_share, with focal lengths as given */
    cln_agree_part part;
    cln_agree_merged merged;
    const char *order;  /* "each has the pose that ...": what fits better; NULL: nothing does */
    double order_exact; /* share of the ties that agree exactly in that order */
    cln_agree_place place;
    double tilt;         /* degrees by which all cameras are raised around what they look at, so
                            that most ties agree exactly; 0: as they are */
    double tilt_exact;   /* share of the ties that then do */
    double falloff;      /* power of its distance from the camera with which a mark fades, as the
                            light goes along; 0: it does not */
    double kept_share;   /* of what agrees in photos with masks or alpha: what these keep; or NaN */
    int turned, stored;  /* of photos that EXIF data turn and that are taken as stored: ties that
                            agree if these are turned, and as they are */
    int still;           /* ties left out, as what they are of stands still in the pictures */
    double still_share;  /* of all ties */
    int point_count;     /* places where the rays of agreeing ties meet at some angle */
    double (*points)[3]; /* scene units */
} cln_agreement;

#endif
