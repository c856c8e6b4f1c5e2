/* Features by differences of Gaussians: a pyramid of blurred copies, their differences' extrema
 * over place and scale, the main direction of the gradients there, and histograms of gradients in
 * 4 x 4 cells of a square turned to it. See features.h. */
#include "scene/features.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"

/* Longest sides of a photo: above LONGEST it is reduced, up to SHORT it is doubled. */
enum { LONGEST = 480, SHORT = 240 };
enum { OCTAVES = 4, STEPS = 3, BLURRED = STEPS + 3, SMALLEST = 16, BORDER = 5 };
enum { BINS = 36, CELLS = 4, WAYS = 8 };
static const double SIGMA = 1.6, CAMERA_SIGMA = 0.5;
static const float CONTRAST = 0.008f, EDGE = 10; /* least difference; ratio of its curvatures */
static const double MOSTLY = 0.2; /* share of what is around a feature that tells its grey */
static const double TWO_PI = 6.283185307179586;

typedef struct plane {
    int width, height;
    float *at; /* [height][width] */
} plane;

typedef struct octave {
    plane blurred[BLURRED];
    double pixel; /* side of its pixels, in pixels of the first plane */
} octave;

typedef struct found {
    cln_feature feature;
    float strength, sigma; /* the latter in pixels of the view */
} found;

static float get(const plane *p, int x, int y)
{
    return p->at[(size_t)y * (size_t)p->width + (size_t)x];
}

static cln_status make_plane(int width, int height, plane *out)
{
    out->width = width;
    out->height = height;
    return cln_alloc(&out->at, (size_t)width * (size_t)height, sizeof *out->at, "photo");
}

static int within(int i, int count)
{
    return i < 0 ? 0 : i >= count ? count - 1 : i;
}

/* Straight colours, without the background: transparency must not draw outlines of its own. */
static float grey(const cln_view *view, int x, int y)
{
    uint8_t p[4];

    cln_view_bytes(view, x, y, p);
    return (0.299f * p[0] + 0.587f * p[1] + 0.114f * p[2]) / 255;
}

/* The view in grey, at most LONGEST wide or high, as means of blocks; a small one at twice its
 * size. */
static cln_status first_plane(const cln_view *view, plane *out, double *pixel)
{
    cln_status st = CLN_OK;
    const int wide = view->camera.width, high = view->camera.height;
    const int longest = wide > high ? wide : high;
    const int block = longest > LONGEST ? (longest + LONGEST - 1) / LONGEST : 1;
    const bool doubled = longest <= SHORT;

    *pixel = doubled ? 0.5 : block;
    CLN_TRY(make_plane(doubled ? 2 * wide : wide / block, doubled ? 2 * high : high / block, out));
    for (int y = 0; y < out->height; y++)
        for (int x = 0; x < out->width; x++) {
            float sum = 0;

            if (doubled) { /* between the four nearest pixels' centres */
                const int x0 = (x + 1) / 2 - 1, y0 = (y + 1) / 2 - 1;

                for (int k = 0; k < 4; k++) {
                    const float by =
                        ((x & 1) == (k & 1) ? .25f : .75f) * ((y & 1) == (k >> 1) ? .25f : .75f);

                    sum += by * grey(view, within(x0 + (k & 1), wide), within(y0 + (k >> 1), high));
                }
            } else {
                for (int k = 0; k < block * block; k++)
                    sum += grey(view, x * block + k % block, y * block + k / block);
                sum /= (float)(block * block);
            }
            out->at[(size_t)y * (size_t)out->width + (size_t)x] = sum;
        }
done:
    return st;
}

static void add_row(float weight, const float *restrict from, int width, float *restrict to)
{
    for (int x = 0; x < width; x++)
        to[x] += weight * from[x];
}

/* to[x] += weight from[x + by]; beyond an end, its value goes on. */
static void add_shifted(float weight, const float *from, int width, int by, float *to)
{
    const int first = by < 0 ? within(-by, width) : 0;
    const int last = by > 0 ? width - within(by, width) : width;

    for (int x = 0; x < first; x++)
        to[x] += weight * from[0];
    for (int x = last; x < width; x++)
        to[x] += weight * from[width - 1];
    if (first < last)
        add_row(weight, from + first + by, last - first, to + first);
}

static cln_status blur(const plane *from, double sigma, plane *out)
{
    cln_status st = CLN_OK;
    enum { REACH = 16 };
    const int reach = (int)fmin(REACH, ceil(3 * sigma));
    float weights[REACH + 1], sum = 0;
    plane half = {0};

    CLN_TRY(make_plane(from->width, from->height, &half));
    CLN_TRY(make_plane(from->width, from->height, out));
    for (int i = -reach; i <= reach; i++)
        sum += weights[abs(i)] = (float)exp(-0.5 * i * i / (sigma * sigma));
    for (int pass = 0; pass < 2; pass++) {
        const plane *in = pass ? &half : from;
        plane *to = pass ? out : &half;

        for (int y = 0; y < in->height; y++) {
            float *row = to->at + (size_t)y * (size_t)in->width;

            memset(row, 0, (size_t)in->width * sizeof *row);
            for (int i = -reach; i <= reach; i++) {
                const float weight = weights[abs(i)] / sum;

                if (pass)
                    add_row(weight, in->at + (size_t)within(y + i, in->height) * (size_t)in->width,
                            in->width, row);
                else
                    add_shifted(weight, in->at + (size_t)y * (size_t)in->width, in->width, i, row);
            }
        }
    }
done:
    free(half.at);
    return st;
}

/* Every second pixel. */
static cln_status halve(const plane *from, plane *out)
{
    cln_status st = CLN_OK;

    CLN_TRY(make_plane(from->width / 2, from->height / 2, out));
    for (int y = 0; y < out->height; y++)
        for (int x = 0; x < out->width; x++)
            out->at[(size_t)y * (size_t)out->width + (size_t)x] = get(from, 2 * x, 2 * y);
done:
    return st;
}

static void free_octave(octave *o)
{
    for (int s = 0; s < BLURRED; s++) {
        free(o->blurred[s].at);
        o->blurred[s].at = NULL;
    }
}

static float difference(const octave *o, int s, int x, int y)
{
    return get(&o->blurred[s + 1], x, y) - get(&o->blurred[s], x, y);
}

/* Is the difference larger than its 26 neighbours, or smaller, and no edge? */
static bool is_extremum(const octave *o, int s, int x, int y)
{
    const float here = difference(o, s, x, y), sign = here > 0 ? 1.f : -1.f;
    float xx = 0, yy = 0, xy = 0;

    if (sign * here < CONTRAST)
        return false;
    for (int k = 0; k < 27; k++)
        if (k != 13 &&
            sign * difference(o, s + k / 9 - 1, x + k % 3 - 1, y + k / 3 % 3 - 1) >= sign * here)
            return false;
    xx = difference(o, s, x + 1, y) + difference(o, s, x - 1, y) - 2 * here;
    yy = difference(o, s, x, y + 1) + difference(o, s, x, y - 1) - 2 * here;
    xy = .25f * (difference(o, s, x + 1, y + 1) + difference(o, s, x - 1, y - 1) -
                 difference(o, s, x + 1, y - 1) - difference(o, s, x - 1, y + 1));
    return xx * yy > xy * xy &&
           (xx + yy) * (xx + yy) * EDGE < (EDGE + 1) * (EDGE + 1) * (xx * yy - xy * xy);
}

/* The top of the parabola through three values, -0.5 to 0.5. */
static float top_of(float before, float here, float after)
{
    const float bend = before + after - 2 * here;

    return bend == 0 ? 0 : fmaxf(-.5f, fminf(.5f, .5f * (before - after) / bend));
}

static float gradient(const plane *p, float x, float y, float *angle)
{
    const int i = within((int)lroundf(x), p->width), k = within((int)lroundf(y), p->height);
    const float dx = get(p, within(i + 1, p->width), k) - get(p, within(i - 1, p->width), k);
    const float dy = get(p, i, within(k + 1, p->height)) - get(p, i, within(k - 1, p->height));

    *angle = atan2f(dy, dx);
    return hypotf(dx, dy);
}

/* The direction that most of the gradients around (x, y) have. */
static float main_direction(const plane *p, float x, float y, double sigma)
{
    float bins[BINS] = {0}, smooth[BINS], angle = 0;
    const int reach = (int)ceil(3 * 1.5 * sigma);
    int best = 0;

    for (int dy = -reach; dy <= reach; dy++)
        for (int dx = -reach; dx <= reach; dx++) {
            const double weight = exp(-0.5 * (dx * dx + dy * dy) / (2.25 * sigma * sigma));
            const float size = gradient(p, x + (float)dx, y + (float)dy, &angle);
            const int bin = (int)floor((angle / TWO_PI + 1) * BINS) % BINS;

            bins[bin] += (float)weight * size;
        }
    for (int i = 0; i < BINS; i++)
        smooth[i] =
            .25f * bins[(i + BINS - 1) % BINS] + .5f * bins[i] + .25f * bins[(i + 1) % BINS];
    for (int i = 1; i < BINS; i++)
        best = smooth[i] > smooth[best] ? i : best;
    return (
        float)((best + .5 +
                top_of(smooth[(best + BINS - 1) % BINS], smooth[best], smooth[(best + 1) % BINS])) /
               BINS * TWO_PI);
}

static void describe(const plane *p, float x, float y, double sigma, float turn, uint8_t *out)
{
    float cells[CELLS][CELLS][WAYS] = {0}, *flat = &cells[0][0][0], length = 0, angle = 0;
    const double side = 3 * sigma; /* of a cell */
    const int reach = (int)ceil(side * (CELLS + 1) * 0.7072);
    const double c = cos(turn), s = sin(turn);

    for (int dy = -reach; dy <= reach; dy++)
        for (int dx = -reach; dx <= reach; dx++) {
            const double along = (c * dx + s * dy) / side, across = (c * dy - s * dx) / side;
            const double i = along + CELLS / 2 - .5, k = across + CELLS / 2 - .5;
            double weight = 0, way = 0;

            if (i <= -1 || k <= -1 || i >= CELLS || k >= CELLS)
                continue;
            weight = exp(-(along * along + across * across) / (CELLS * CELLS / 2.0)) *
                     (double)gradient(p, x + (float)dx, y + (float)dy, &angle);
            way = fmod((angle - turn) / TWO_PI + 2, 1) * WAYS;
            for (int n = 0; n < 8; n++) { /* shared with the neighbours, linearly */
                const int ci = (int)floor(i) + (n & 1), ck = (int)floor(k) + (n >> 1 & 1);
                const int cw = (int)floor(way) + (n >> 2);
                const double share = (1 - fabs(i - ci)) * (1 - fabs(k - ck)) * (1 - fabs(way - cw));

                if (ci >= 0 && ck >= 0 && ci < CELLS && ck < CELLS)
                    cells[ck][ci][cw % WAYS] += (float)(share * weight);
            }
        }
    for (int pass = 0; pass < 2; pass++) { /* no single gradient may dominate */
        length = 1e-12f;
        for (int n = 0; n < CLN_FEATURE_BYTES; n++)
            length += flat[n] * flat[n];
        length = sqrtf(length);
        for (int n = 0; n < CLN_FEATURE_BYTES; n++)
            flat[n] = fminf(flat[n] / length, pass ? 1 : .2f);
    }
    for (int n = 0; n < CLN_FEATURE_BYTES; n++)
        out[n] = (uint8_t)fminf(255, 512 * flat[n]);
}

/* Adds a feature to list[], which keeps the CLN_FEATURES_MOST strongest, as a heap with the weakest
 * on top. */
static void keep_strongest(found *list, int *count, const found *one)
{
    int at = 0;

    if (*count == CLN_FEATURES_MOST) {
        if (one->strength <= list[0].strength)
            return;
        list[0] = *one;
        for (int child = 1; child < *count; child = 2 * at + 1) {
            found kept;

            if (child + 1 < *count && list[child + 1].strength < list[child].strength)
                child++;
            if (list[at].strength <= list[child].strength)
                return;
            kept = list[at];
            list[at] = list[child];
            list[child] = kept;
            at = child;
        }
        return;
    }
    at = (*count)++;
    list[at] = *one;
    while (at > 0 && list[(at - 1) / 2].strength > list[at].strength) {
        const found kept = list[at];

        list[at] = list[(at - 1) / 2];
        list[(at - 1) / 2] = kept;
        at = (at - 1) / 2;
    }
}

static bool is_kept(const cln_view *view, int x, int y)
{
    uint8_t bytes[4];

    cln_view_bytes(view, x, y, bytes);
    return cln_view_keeps(view, x, y) && (view->channels < 4 || bytes[3] >= 128);
}

/* Is any of it cut away, within `reach` pixels of a place? */
static bool is_cut(const cln_view *view, const cln_feature *f, double reach)
{
    for (int k = 0; k < 5; k++) { /* beside it, and itself */
        const double du = k == 0 ? -reach : k == 1 ? reach : 0;
        const double dv = k == 2 ? -reach : k == 3 ? reach : 0;
        const int x = within((int)floor((double)f->u + du), view->camera.width);
        const int y = within((int)floor((double)f->v + dv), view->camera.height);

        if (!is_kept(view, x, y))
            return true;
    }
    return false;
}

/* The mean grey around a feature of what is kept: the blurred copies have the backdrop, or the
 * black below transparent pixels, in them, of which each photo has another share beside the same
 * mark. Pixels with such neighbours do not count, as their colours are mixed; NAN if few are
 * left. */
static float kept_value(const cln_view *view, const found *f)
{
    enum { SIDE = 15 };
    const double reach = 2 * (double)f->sigma, beside = fmax(1.5, 0.5 * (double)f->sigma);
    double sum = 0, weights = 0, all = 0;

    for (int i = 0; i < SIDE * SIDE; i++) {
        const double du = reach * (2.0 * (i % SIDE) / (SIDE - 1) - 1);
        const double dv = reach * (2.0 * (i / SIDE) / (SIDE - 1) - 1);
        const cln_feature at = {.u = f->feature.u + (float)du, .v = f->feature.v + (float)dv};
        const int x = (int)floorf(at.u), y = (int)floorf(at.v);
        const double weight = exp(-2 * (du * du + dv * dv) / (reach * reach));

        if (x < 0 || y < 0 || x >= view->camera.width || y >= view->camera.height)
            continue;
        all += weight;
        if (is_cut(view, &at, beside))
            continue;
        sum += weight * (double)grey(view, x, y);
        weights += weight;
    }
    return weights > MOSTLY * all ? (float)(sum / weights) : NAN;
}

/* lists, counts: of what is kept, and of what is cut away. */
static void search(const cln_view *view, const octave *o, double pixel, found *const lists[2],
                   int counts[2])
{
    const plane *p = &o->blurred[0];

    for (int s = 1; s <= STEPS; s++)
        for (int y = BORDER; y < p->height - BORDER; y++)
            for (int x = BORDER; x < p->width - BORDER; x++) {
                const float here = difference(o, s, x, y);
                const double sigma = SIGMA * pow(2, (double)s / STEPS);
                found one = {.strength = fabsf(here)};
                float fx = 0, fy = 0;
                bool cut = false;

                if (!is_extremum(o, s, x, y))
                    continue;
                fx =
                    (float)x + top_of(difference(o, s, x - 1, y), here, difference(o, s, x + 1, y));
                fy =
                    (float)y + top_of(difference(o, s, x, y - 1), here, difference(o, s, x, y + 1));
                /* octaves take every second pixel, so theirs lie on centres of the first plane's
                 * pixels */
                one.feature.u = (float)((fx * o->pixel + .5) * pixel);
                one.feature.v = (float)((fy * o->pixel + .5) * pixel);
                one.feature.value = get(&o->blurred[s], x, y);
                one.sigma = (float)(sigma * o->pixel * pixel);
                cut = is_cut(view, &one.feature, (double)one.sigma);
                describe(&o->blurred[s], fx, fy, sigma,
                         main_direction(&o->blurred[s], fx, fy, sigma), one.feature.about);
                keep_strongest(lists[cut], &counts[cut], &one);
            }
}

cln_status cln_features_find(const cln_view *view, cln_features *out)
{
    cln_status st = CLN_OK;
    plane first = {0}, next = {0};
    octave o = {.pixel = 1};
    found *list = NULL, *lists[2];
    int counts[2] = {0};

    *out = (cln_features){0};
    CLN_TRY(cln_alloc(&list, 2 * CLN_FEATURES_MOST, sizeof *list, "features"));
    lists[0] = list;
    lists[1] = list + CLN_FEATURES_MOST;
    CLN_TRY(first_plane(view, &first, &out->pixel));
    for (int n = 0; n < OCTAVES && first.width >= SMALLEST && first.height >= SMALLEST; n++) {
        double had = n ? SIGMA : CAMERA_SIGMA / fmin(1, out->pixel);

        for (int s = 0; s < BLURRED; s++) {
            const double wanted = SIGMA * pow(2, (double)s / STEPS);
            const plane *from = s ? &o.blurred[s - 1] : &first;

            CLN_TRY(blur(from, sqrt(fmax(wanted * wanted - had * had, .01)), &o.blurred[s]));
            had = wanted;
        }
        search(view, &o, out->pixel, lists, counts);
        CLN_TRY(halve(&o.blurred[STEPS], &next));
        free(first.at);
        first = next;
        next.at = NULL;
        free_octave(&o);
        o.pixel *= 2;
    }
    CLN_TRY(cln_alloc(&out->list, (size_t)(counts[0] + counts[1]), sizeof *out->list, "features"));
    for (int k = 0; k < 2; k++)
        for (int i = 0; i < counts[k]; i++) {
            out->list[k * counts[0] + i] = lists[k][i].feature;
            if (k == 0 && (view->channels == 4 || view->masked))
                out->list[i].value = kept_value(view, &lists[k][i]);
        }
    out->count = counts[0];
    out->cut = counts[1];
done:
    free_octave(&o);
    free(first.at);
    free(list);
    return st;
}

cln_features cln_features_cut(const cln_features *all)
{
    return (cln_features){.count = all->cut, .list = all->list + all->count, .pixel = all->pixel};
}

static int distance(const cln_feature *a, const cln_feature *b)
{
    int sum = 0;

    for (int i = 0; i < CLN_FEATURE_BYTES; i++) {
        const int way = a->about[i] - b->about[i];

        sum += way * way;
    }
    return sum;
}

int cln_features_match(const cln_features *a, const cln_features *b, cln_match *out)
{
    enum { NONE = 1 << 30 };
    static const double NEARER = 0.64; /* squared: 0.8 of the second's distance */
    int nearest[CLN_FEATURES_MOST], back[CLN_FEATURES_MOST], of[CLN_FEATURES_MOST], count = 0;

    for (int k = 0; k < b->count; k++)
        of[k] = NONE;
    for (int i = 0; i < a->count; i++) {
        int first = NONE, second = NONE;

        nearest[i] = -1;
        for (int k = 0; k < b->count; k++) {
            const int d = distance(&a->list[i], &b->list[k]);

            if (d < of[k]) {
                of[k] = d;
                back[k] = i;
            }
            if (d < first) {
                second = first;
                first = d;
                nearest[i] = k;
            } else if (d < second) {
                second = d;
            }
        }
        if (second == NONE || first > NEARER * second)
            nearest[i] = -1;
    }
    for (int i = 0; i < a->count; i++)
        if (nearest[i] >= 0 && back[nearest[i]] == i)
            out[count++] = (cln_match){i, nearest[i]};
    return count;
}
