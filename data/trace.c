/* Intersects rays with spheres, boxes, frusta, capsules and tori by their equations (trace.h), and
 * finds the nearest by a bounding-volume tree with at most two shapes per leaf. Roots of the
 * torus's quartics are bracketed between the roots of their derivatives: slower than Ferrari's
 * formula, but without cancellation. */
#include "trace.h"
#include <stdlib.h>
#include "base/memory.h"

/* fmin and fmax without their rules for NaN, which make them calls; this is the inner loop. */
static inline double lesser(double a, double b)
{
    return a < b ? a : b;
}

static inline double greater(double a, double b)
{
    return a > b ? a : b;
}

/* ---- one shape, local frame: the smallest t in (t_min, t_max) with its outward normal ---- */

static bool in_range(double t, double t_min, double *t_max)
{
    if (!(t > t_min && t < *t_max))
        return false;
    *t_max = t;
    return true;
}

/* Real roots of a t^2 + 2 h t + c, ascending. */
static bool quadratic(double a, double h, double c, double t[2])
{
    double disc = h * h - a * c;
    if (a == 0 || !(disc >= 0))
        return false;
    double q = -(h + copysign(sqrt(disc), h));
    t[0] = q / a;
    t[1] = q != 0 ? c / q : t[0];
    if (t[0] > t[1]) {
        double swap = t[0];
        t[0] = t[1];
        t[1] = swap;
    }
    return true;
}

static bool hit_sphere(vec o, vec d, double r, double t_min, double *t_max, vec *n)
{
    double t[2];
    bool found = false;

    if (!quadratic(1, dot(o, d), dot(o, o) - r * r, t))
        return false;
    for (int i = 0; i < 2 && !found; i++)
        found = in_range(t[i], t_min, t_max);
    if (found)
        *n = scale(along(o, *t_max, d), 1 / r);
    return found;
}

static bool hit_box(const shape *s, vec o, vec d, double t_min, double *t_max, vec *n)
{
    const double po[3] = {o.x, o.y, o.z}, pd[3] = {d.x, d.y, d.z}, h[3] = {s->a, s->b, s->c};
    double near = -INFINITY, far = INFINITY;
    int near_axis = 0, far_axis = 0;

    for (int i = 0; i < 3; i++) {
        if (pd[i] == 0) {
            if (fabs(po[i]) > h[i])
                return false;
            continue;
        }
        double t0 = (-copysign(h[i], pd[i]) - po[i]) / pd[i];
        double t1 = (copysign(h[i], pd[i]) - po[i]) / pd[i];
        if (t0 > near) {
            near = t0;
            near_axis = i;
        }
        if (t1 < far) {
            far = t1;
            far_axis = i;
        }
    }
    if (!(near < far))
        return false;
    int axis = near_axis;
    double sign = -1;
    if (!in_range(near, t_min, t_max)) {
        if (!in_range(far, t_min, t_max))
            return false;
        axis = far_axis;
        sign = 1;
    }
    double value = copysign(sign, sign * pd[axis]);
    *n = vec3(axis == 0 ? value : 0, axis == 1 ? value : 0, axis == 2 ? value : 0);
    return true;
}

static bool hit_frustum(const shape *s, vec o, vec d, double t_min, double *t_max, vec *n)
{
    /* radius(z) = m + k z */
    double m = 0.5 * (s->a + s->b), k = 0.5 * (s->b - s->a) / s->c, t[2];
    double r = m + k * o.z;
    bool found = false;

    if (quadratic(d.x * d.x + d.y * d.y - k * k * d.z * d.z, o.x * d.x + o.y * d.y - k * d.z * r,
                  o.x * o.x + o.y * o.y - r * r, t))
        for (int i = 0; i < 2; i++) {
            double z = o.z + t[i] * d.z;
            if (fabs(z) <= s->c && m + k * z >= 0 && in_range(t[i], t_min, t_max)) {
                vec p = along(o, t[i], d);
                *n = unit(vec3(p.x, p.y, -k * (m + k * z)));
                found = true;
            }
        }
    for (int side = -1; side <= 1 && d.z != 0; side += 2) {
        double cap = side < 0 ? s->a : s->b, at = (side * s->c - o.z) / d.z;
        double x = o.x + at * d.x, y = o.y + at * d.y;
        if (x * x + y * y <= cap * cap && in_range(at, t_min, t_max)) {
            *n = vec3(0, 0, side);
            found = true;
        }
    }
    return found;
}

static bool hit_capsule(const shape *s, vec o, vec d, double t_min, double *t_max, vec *n)
{
    double t[2];
    bool found = false;

    if (quadratic(d.x * d.x + d.y * d.y, o.x * d.x + o.y * d.y, o.x * o.x + o.y * o.y - s->a * s->a,
                  t))
        for (int i = 0; i < 2; i++)
            if (fabs(o.z + t[i] * d.z) <= s->c && in_range(t[i], t_min, t_max)) {
                vec p = along(o, t[i], d);
                *n = scale(vec3(p.x, p.y, 0), 1 / s->a);
                found = true;
            }
    for (int side = -1; side <= 1; side += 2) {
        /* The half of the end's sphere that is outside the cylinder. */
        vec p = vec3(o.x, o.y, o.z - side * s->c);
        if (!quadratic(1, dot(p, d), dot(p, p) - s->a * s->a, t))
            continue;
        for (int i = 0; i < 2; i++)
            if (side * (p.z + t[i] * d.z) >= 0 && in_range(t[i], t_min, t_max)) {
                *n = scale(along(p, t[i], d), 1 / s->a);
                found = true;
            }
    }
    return found;
}

static double polynomial(const double *c, int degree, double t)
{
    double y = c[degree];
    for (int i = degree - 1; i >= 0; i--)
        y = y * t + c[i];
    return y;
}

/* The root in [a, b], where the sign changes: Newton's method, with bisection if a step would leave
 * the bracket. */
static double bracketed_root(const double *c, int degree, double a, double b, bool rising)
{
    double t = 0.5 * (a + b);

    for (int step = 0; step < 60; step++) {
        double y = c[degree], slope = 0;
        for (int i = degree - 1; i >= 0; i--) {
            slope = slope * t + y;
            y = y * t + c[i];
        }
        if ((y < 0) == rising)
            a = t;
        else
            b = t;
        double next = t - y / slope;
        if (!(next > a && next < b))
            next = 0.5 * (a + b);
        if (fabs(next - t) < 1e-14)
            break;
        t = next;
    }
    return t;
}

/* Roots of c[0] + c[1] t + ... in [low, high], ascending: at most one lies between neighbouring
 * roots of the derivative. */
static int polynomial_roots(const double *c, int degree, double low, double high, double *roots)
{
    double slope[4], turns[6];
    int turn_count = 0, count = 0;

    turns[turn_count++] = low;
    if (degree > 1) {
        for (int i = 1; i <= degree; i++)
            slope[i - 1] = i * c[i];
        turn_count += polynomial_roots(slope, degree - 1, low, high, turns + 1);
    }
    turns[turn_count++] = high;
    for (int i = 0; i + 1 < turn_count; i++) {
        double a = turns[i], b = turns[i + 1];
        double ya = polynomial(c, degree, a), yb = polynomial(c, degree, b);
        if ((ya < 0) == (yb < 0))
            continue;
        roots[count++] = bracketed_root(c, degree, a, b, ya < 0);
    }
    return count;
}

static bool hit_torus(const shape *s, vec o, vec d, double t_min, double *t_max, vec *n)
{
    double t[2], roots[4], big = s->a * s->a, small = s->b * s->b, outer = s->a + s->b;

    /* Solve around the point nearest to the middle, inside the bounding sphere, where the quartic's
     * coefficients have similar sizes. */
    double shift = -dot(o, d);
    o = along(o, shift, d);
    if (!quadratic(1, 0, dot(o, o) - outer * outer * 1.0001, t))
        return false;
    /* Clip to the slab that holds the torus. The distance from the axis is convex along a line, so
     * a piece with both ends in the hole hits nothing. */
    if (fabs(d.z) > 1e-12) {
        double half = 1.0001 * s->b / fabs(d.z), middle = -o.z / d.z;
        t[0] = greater(t[0], middle - half);
        t[1] = lesser(t[1], middle + half);
        if (!(t[0] < t[1]))
            return false;
    }
    double hole = s->a - s->b, widest = 0;
    for (int i = 0; i < 2; i++) {
        double x = o.x + t[i] * d.x, y = o.y + t[i] * d.y;
        widest = greater(widest, x * x + y * y);
    }
    if (widest < hole * hole)
        return false;
    /* (|p|^2 + R^2 - r^2)^2 = 4 R^2 (x^2 + y^2), p = o + t d, o.d = 0 */
    double e = dot(o, o) + big - small;
    double c[5] = {e * e - 4 * big * (o.x * o.x + o.y * o.y), -8 * big * (o.x * d.x + o.y * d.y),
                   2 * e - 4 * big * (d.x * d.x + d.y * d.y), 0, 1};
    int count = polynomial_roots(c, 4, t[0], t[1], roots);
    for (int i = 0; i < count; i++)
        if (in_range(roots[i] + shift, t_min, t_max)) {
            vec p = along(o, roots[i], d);
            double ring = s->a / sqrt(p.x * p.x + p.y * p.y);
            *n = scale(vec3(p.x * (1 - ring), p.y * (1 - ring), p.z), 1 / s->b);
            return true;
        }
    return false;
}

static vec to_local(const shape *s, vec a)
{
    return vec3(dot(a, s->u), dot(a, s->v), dot(a, s->w));
}

static bool hit_shape(const shape *s, vec origin, vec direction, double t_min, double *t_max,
                      vec *local_normal)
{
    vec o = to_local(s, sub(origin, s->centre)), d = to_local(s, direction);

    switch (s->kind) {
    case SHAPE_SPHERE:
        return hit_sphere(o, d, s->a, t_min, t_max, local_normal);
    case SHAPE_BOX:
        return hit_box(s, o, d, t_min, t_max, local_normal);
    case SHAPE_FRUSTUM:
        return hit_frustum(s, o, d, t_min, t_max, local_normal);
    case SHAPE_CAPSULE:
        return hit_capsule(s, o, d, t_min, t_max, local_normal);
    case SHAPE_TORUS:
        return hit_torus(s, o, d, t_min, t_max, local_normal);
    }
    return false;
}

/* ---- the tree ---- */

static void shape_bounds(shape *s)
{
    double r = fmax(s->a, s->b);
    vec h = s->kind == SHAPE_SPHERE    ? vec3(s->a, s->a, s->a)
            : s->kind == SHAPE_BOX     ? vec3(s->a, s->b, s->c)
            : s->kind == SHAPE_FRUSTUM ? vec3(r, r, s->c)
            : s->kind == SHAPE_CAPSULE ? vec3(s->a, s->a, s->c + s->a)
                                       : vec3(s->a + s->b, s->a + s->b, s->b);
    vec e = vec3(fabs(s->u.x) * h.x + fabs(s->v.x) * h.y + fabs(s->w.x) * h.z,
                 fabs(s->u.y) * h.x + fabs(s->v.y) * h.y + fabs(s->w.y) * h.z,
                 fabs(s->u.z) * h.x + fabs(s->v.z) * h.y + fabs(s->w.z) * h.z);
    e = add(e, vec3(1e-9, 1e-9, 1e-9));
    s->low = sub(s->centre, e);
    s->high = add(s->centre, e);
}

static double component(vec a, int axis)
{
    return axis == 0 ? a.x : axis == 1 ? a.y : a.z;
}

/* Box around shapes order[first .. first + count). */
static void bound(const shapes *scene, int first, int count, vec *low, vec *high)
{
    *low = vec3(INFINITY, INFINITY, INFINITY);
    *high = scale(*low, -1);
    for (int i = first; i < first + count; i++) {
        const shape *s = &scene->list[scene->order[i]];
        *low = vec3(lesser(low->x, s->low.x), lesser(low->y, s->low.y), lesser(low->z, s->low.z));
        *high = vec3(greater(high->x, s->high.x), greater(high->y, s->high.y),
                     greater(high->z, s->high.z));
    }
}

static double area_of(const shapes *scene, int first, int count)
{
    vec low, high;
    bound(scene, first, count, &low, &high);
    vec d = sub(high, low);
    return d.x * d.y + d.y * d.z + d.z * d.x;
}

/* Insertion sort: for few shapes, with a fixed order of equals. */
static void sort(shapes *scene, int first, int count, int axis)
{
    for (int i = first + 1; i < first + count; i++) {
        int moved = scene->order[i], j = i;
        double key = component(scene->list[moved].centre, axis);
        for (; j > first && component(scene->list[scene->order[j - 1]].centre, axis) > key; j--)
            scene->order[j] = scene->order[j - 1];
        scene->order[j] = moved;
    }
}

/* Splits where the sum of area x shapes over the two halves is least (surface-area heuristic). */
static void build(shapes *scene, int node, int first, int count, int *node_count)
{
    tree_node *n = &scene->nodes[node];
    int best_axis = 0, best_left = count / 2;
    double best = INFINITY;

    bound(scene, first, count, &n->low, &n->high);
    n->first = first;
    n->count = count;
    if (count <= 2)
        return;
    for (int axis = 0; axis < 3; axis++) {
        sort(scene, first, count, axis);
        for (int left = 1; left < count; left++) {
            double cost = left * area_of(scene, first, left) +
                          (count - left) * area_of(scene, first + left, count - left);
            if (cost < best) {
                best = cost;
                best_axis = axis;
                best_left = left;
            }
        }
    }
    sort(scene, first, count, best_axis);
    n->first = *node_count;
    n->count = 0;
    *node_count += 2;
    int children = n->first;
    build(scene, children, first, best_left, node_count);
    build(scene, children + 1, first + best_left, count - best_left, node_count);
}

cln_status shapes_add(shapes *scene, const shape *s)
{
    if (scene->count == scene->capacity) {
        int capacity = scene->capacity ? 2 * scene->capacity : 64;
        shape *list = realloc(scene->list, (size_t)capacity * sizeof *list);
        if (!list)
            return cln_fail(CLN_MEMORY, "no memory for %d shapes", capacity);
        scene->list = list;
        scene->capacity = capacity;
    }
    scene->list[scene->count++] = *s;
    return CLN_OK;
}

cln_status shapes_finish(shapes *scene)
{
    cln_status st = CLN_OK;
    int node_count = 1;

    CLN_TRY(cln_alloc(&scene->order, (size_t)scene->count, sizeof(int), "the shapes' tree"));
    CLN_TRY(cln_alloc(&scene->nodes, 2 * (size_t)scene->count + 1, sizeof(tree_node),
                      "the shapes' tree"));
    for (int i = 0; i < scene->count; i++) {
        scene->order[i] = i;
        shape_bounds(&scene->list[i]);
    }
    build(scene, 0, 0, scene->count, &node_count);
done:
    return st;
}

void shapes_free(shapes *scene)
{
    free(scene->list);
    free(scene->nodes);
    free(scene->order);
    scene->list = NULL;
    scene->nodes = NULL;
    scene->order = NULL;
    scene->count = scene->capacity = 0;
}

/* Distance to the ray's entry into the box, or infinity. */
static inline double entry(const tree_node *n, vec o, vec inverse, double t_min, double t_max)
{
    double x0 = (n->low.x - o.x) * inverse.x, x1 = (n->high.x - o.x) * inverse.x;
    double y0 = (n->low.y - o.y) * inverse.y, y1 = (n->high.y - o.y) * inverse.y;
    double z0 = (n->low.z - o.z) * inverse.z, z1 = (n->high.z - o.z) * inverse.z;
    double near = greater(greater(lesser(x0, x1), lesser(y0, y1)), greater(lesser(z0, z1), t_min));
    double far = lesser(lesser(greater(x0, x1), greater(y0, y1)), lesser(greater(z0, z1), t_max));
    return near <= far ? near : INFINITY;
}

/* Finds the nearest shape, or with `any` the first one it comes across. */
static const shape *walk(const shapes *scene, vec origin, vec direction, double t_min, bool any,
                         double *t_max, vec *local_normal)
{
    struct {
        int node;
        double at;
    } stack[64];
    vec inverse = vec3(1 / direction.x, 1 / direction.y, 1 / direction.z);
    const shape *found = NULL;
    int top = 0;

    stack[0].node = 0;
    stack[0].at = entry(&scene->nodes[0], origin, inverse, t_min, *t_max);
    top = stack[0].at < INFINITY;
    while (top > 0) {
        const tree_node *n = &scene->nodes[stack[--top].node];
        if (stack[top].at >= *t_max)
            continue;
        if (!n->count) {
            double at[2];
            CLN_ASSERT(top < 62);
            for (int i = 0; i < 2; i++)
                at[i] = entry(&scene->nodes[n->first + i], origin, inverse, t_min, *t_max);
            int nearer = at[1] < at[0];
            for (int i = 0; i < 2; i++) { /* the nearer one is pushed last, walked first */
                int child = i ? nearer : !nearer;
                if (at[child] < INFINITY) {
                    stack[top].node = n->first + child;
                    stack[top++].at = at[child];
                }
            }
            continue;
        }
        for (int i = n->first; i < n->first + n->count; i++) {
            const shape *s = &scene->list[scene->order[i]];
            if (hit_shape(s, origin, direction, t_min, t_max, local_normal)) {
                found = s;
                if (any)
                    return found;
            }
        }
    }
    return found;
}

bool shapes_hit(const shapes *scene, vec origin, vec direction, double t_min, double t_max,
                hit *out)
{
    vec n = vec3(0, 0, 1);
    const shape *s = walk(scene, origin, direction, t_min, false, &t_max, &n);

    if (!s)
        return false;
    out->t = t_max;
    out->shape = s;
    out->local = to_local(s, sub(along(origin, t_max, direction), s->centre));
    out->local_normal = n;
    out->normal = add(add(scale(s->u, n.x), scale(s->v, n.y)), scale(s->w, n.z));
    if (dot(out->normal, direction) > 0)
        out->normal = scale(out->normal, -1);
    return true;
}

bool shapes_blocked(const shapes *scene, vec origin, vec direction, double t_min, double t_max)
{
    vec n;
    return walk(scene, origin, direction, t_min, true, &t_max, &n) != NULL;
}
