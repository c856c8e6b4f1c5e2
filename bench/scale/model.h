/* What a training step by ranks takes: a model of docs/scale-out.md's division of work, without
 * measuring. Assumptions:
 *
 *   - A step's time is compute and messages one after the other: what overlaps is small.
 *   - Samples and what is done with them (placing, sorting, networks, compositing, Adam) cost a
 *     constant, a time a sample and a time a leaf that has samples; S samples that fall anywhere
 *     meet L (1 - exp(-S / L)) of L leaves. Ranks share this evenly but for `balance`, the busiest
 *     one's part over the mean. So they do the refresh of densities, a time a leaf every
 *     `refresh_every` steps.
 *   - All else (rays, intervals, the host) is repeated on every rank: a constant, a time a sample,
 *     a time a leaf.
 *   - Messages: each rank receives the sums of the other ranks' stretches of rays, 32 bytes each,
 *     and densities of their leaves after a refresh, at the network's bandwidth; a message takes
 *     its latency log2(ranks) times, one a step (stretches; the numbers beside them do not wait)
 *     and one a refresh. A rank sends its part to each of the others; the network carries all
 *     ranks' traffic at once (no bottleneck between switches), one rank a machine.
 *   - Two leaves that follow each other on a ray are of different ranks as often as a face of a
 *     leaf is one of its rank's region, if regions are compact: (ranks / leaves)^(1/3).
 *     Left out: 64 bytes of numbers a step, each rank's work every 16 steps, decisions and
 *     distillation, and the weights of leaves that move, which is seldom.
 *   - Photos cost no time in a step; every rank keeps all of them in host memory. */
#ifndef SCALE_MODEL_H
#define SCALE_MODEL_H

typedef struct scale_cost { /* seconds */
    double step, sample, leaf;
} scale_cost;

typedef struct scale_machine {
    scale_cost shared, repeated; /* shared: a leaf with samples; repeated: any leaf */
    double refresh;              /* a leaf, once */
} scale_machine;

typedef struct scale_network {
    double latency, bandwidth; /* seconds; bytes a second, INFINITY: messages cost latency alone */
} scale_network;

typedef struct scale_work {
    double samples, leaves;      /* of a step; of the tree */
    double stretches;            /* of a step's rays; 0: samples are exchanged */
    double density_bytes;        /* of a leaf */
    double refresh_every, ranks; /* steps; > 0 */
    double balance;              /* >= 1; of one rank 1 */
} scale_work;

typedef struct scale_step {
    double shared, repeated, messages, total; /* seconds */
    double sent; /* bytes by a rank with the mean share of stretches and leaves */
} scale_step;

scale_step scale_predict(const scale_machine *machine, const scale_network *network,
                         const scale_work *work);

/* Stretches of a ray that has samples in `passed` leaves, and the inverse. */
double scale_stretches(double passed, double leaves, double ranks);
double scale_passed(double stretches, double leaves, double ranks);

/* Bytes of `share` of the stretches or samples, and of densities of `leaf_share` of the leaves, to
 * the ranks - 1 others, a step. */
double scale_sent(const scale_work *work, double share, double leaf_share);

/* Fits cost to n rows by least squares of relative errors, without negative costs. x: [n][3], the
 * factors of step, sample and leaf; seconds: [n], > 0. */
scale_cost scale_fit(int n, const double (*x)[3], const double *seconds);

#endif
