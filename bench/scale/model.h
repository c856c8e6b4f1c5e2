/* Time of a training step by ranks: a model of the division of work in docs/scale-out.md, which
 * measures nothing. Assumptions:
 *
 *   - A step takes the sum of its computing, its messages and its waiting: they hardly overlap.
 *   - Work on samples (placing, sorting, networks, compositing, Adam) costs a constant, a time per
 *     sample and a time per leaf that has samples; S samples at random places fall into
 *     L (1 - exp(-S / L)) of L leaves. Ranks share this work evenly, except for `balance`: the
 *     busiest rank's part over the mean. They share the refresh of densities in the same way: a
 *     time per leaf every `refresh_every` steps.
 *   - From three ranks on, each walks its part of the rays: a time per leaf that a ray passes, of
 *     which there are L^(1/3): leaves as in a grid. Where the tree is fine at surfaces alone, or
 *     rays end there, they pass fewer.
 *   - Every rank repeats all other work (rays, the host): a constant, and a time per ray.
 *   - Messages: each rank receives the sums of the other ranks' stretches of rays, 32 bytes each,
 *     the pixels of their photos, 4 bytes a ray, what their walk found, 8 bytes a ray and 20 a leaf
 *     with samples, and after a refresh the densities of their leaves, at the network's bandwidth.
 *     A step has three messages that wait (counts of the walk, its intervals, the stretches) and a
 *     refresh has another; each takes log2(ranks) times the latency. A rank sends its part to each
 *     of the others; every machine has one rank, and the network carries the traffic of all at once
 *     (no bottleneck between switches).
 *   - Waiting: a rank's computing takes now more, now less time, whatever its work: by a normal
 *     distribution of standard deviation `spread`, a part of the mean, in each step and on each
 *     rank anew. A step ends when the slowest of them does.
 *   - `walk` has two other ways. SCALE_REPEATED: all ranks walk all rays, as two ranks do.
 *     SCALE_OWN_CELLS, which is not in the program: so they do, but each reads densities of its own
 *     leaves alone, keeps them to itself, and tells the others each stretch's optical depth, 4
 *     bytes, in another message that waits. Of the time for a leaf that a ray passes, the part
 *     `cells` is then shared.
 *   - Consecutive leaves of a ray belong to different ranks as often as a leaf's face lies on the
 *     surface of its rank's region: (ranks / leaves)^(1/3) for compact regions.
 *   - Voxels also tell what leaves of two ranks have in common, in two more messages that wait, of
 *     neighbours alone, so that each takes the latency once. Ranks' regions are boxes: halves of
 *     the cube along an axis, quarters, eighths and so on. Of the two leaves at a face between
 *     ranks, the first has the common vertices, (cells + 1)^2 of them, and the other a copy of
 *     each. A copy's gradient travels if samples of its leaf met the vertex, the new numbers if
 *     samples of either did. A leaf's samples lie near each other: of n samples, `places` n count
 *     as at random places. A vertex is met by those in the 4 cells around it in its own leaf, or in
 *     the 8 of both. Vertices that more than two leaves have, and the decoder's gradients, count as
 *     nothing. Where leaves lie on surfaces instead of in a full grid, ranks have less in common.
 *   - Left out: 64 bytes of numbers per step, each rank's work every 16 steps, decisions and
 *     distillation, and the weights of leaves that move, which is rare. */
#ifndef SCALE_MODEL_H
#define SCALE_MODEL_H

typedef struct scale_cost { /* seconds */
    double step, each, leaf;
} scale_cost;

typedef struct scale_machine {
    scale_cost shared;   /* each: a sample; leaf: one with samples */
    scale_cost repeated; /* each: a ray; leaf: one that a ray passes */
    double refresh;      /* a leaf, once */
    double spread;
    double cells; /* part of repeated.leaf */
} scale_machine;

typedef struct scale_network {
    double latency, bandwidth; /* seconds; bytes a second, INFINITY: messages cost only latency */
} scale_network;

typedef enum { SCALE_OWN_RAYS, SCALE_REPEATED, SCALE_OWN_CELLS } scale_walk;

typedef struct scale_work {
    double samples, leaves;      /* of a step; of the tree */
    double rays;                 /* of a step */
    double stretches;            /* of a step's rays; 0: samples are exchanged */
    double density_bytes;        /* of a leaf */
    double refresh_every, ranks; /* steps; > 0 */
    double balance;              /* >= 1; for one rank 1 */
    scale_walk walk;
    double intervals; /* of a step's rays: leaves in which they have samples */
    double cells;     /* of a leaf of voxels along an axis; 0: networks */
    double row_bytes; /* of a vertex in a message */
    double places;    /* of a sample: the part that is at a place of its own */
} scale_work;

typedef struct scale_step {
    double shared, repeated, messages, waiting, total; /* seconds */
    double sent; /* bytes by a rank with the mean share of stretches, leaves and vertices */
} scale_step;

scale_step scale_predict(const scale_machine *machine, const scale_network *network,
                         const scale_work *work);

/* Stretches of a ray that has samples in `passed` leaves, and the inverse. */
double scale_stretches(double passed, double leaves, double ranks);
double scale_passed(double stretches, double leaves, double ranks);

/* The expected largest of n numbers of the standard normal distribution. */
double scale_slowest(double n);

/* Leaves that a ray passes. */
double scale_passes(double leaves);

/* Faces of leaves between all ranks; of rank 0, whose leaves are the first at each of its own. */
double scale_faces(double leaves, double ranks);
double scale_first_faces(double leaves, double ranks);

/* Bytes per step about common vertices of voxels: by the mean rank; by rank 0. */
double scale_vertices(const scale_work *work);
double scale_first_vertices(const scale_work *work);

/* Bytes per step that a rank sends to the ranks - 1 others, without common vertices: `share` of the
 * stretches or samples, an even part of the pixels, and the densities of `leaf_share` of the
 * leaves. */
double scale_sent(const scale_work *work, double share, double leaf_share);

/* Fits cost to n rows by least squares of relative errors, without negative costs. x: [n][3],
 * numbers of steps, of samples or rays, and of leaves; seconds: [n], > 0. */
scale_cost scale_fit(int n, const double (*x)[3], const double *seconds);

#endif
