/* SPDX-License-Identifier: Apache-2.0 */
#include "data/default_view/orient.h"

#include <math.h>
#include <string.h>

#include "data/volume/anatomy.h"
#include "data/volume/grid.h"

/* Opacity of one taken sample, by bin. */
static void compute_opacity(const struct sp_default_samples *s,
                            const double extinction[SP_FIRST_BINS], float opacity[SP_FIRST_BINS]) {
    double cell = cbrt(s->cell[0] * s->cell[1] * s->cell[2]);
    for (int b = 0; b < SP_FIRST_BINS; b++)
        opacity[b] = (float)(1 - exp(-extinction[b] * cell));
}

/* The opacity of each layer of samples across each axis, summed. */
struct profiles {
    double layer[3][SP_FIRST_SIDE];
    double total;
};

static void add_profiles(const struct sp_default_samples *s, const float opacity[SP_FIRST_BINS],
                         struct profiles *p) {
    const uint16_t *bin = s->bins;
    memset(p, 0, sizeof *p);
    for (uint32_t k = 0; k < s->count[2]; k++)
        for (uint32_t j = 0; j < s->count[1]; j++) {
            double row = 0;
            for (uint32_t i = 0; i < s->count[0]; i++, bin++) {
                double o = *bin == SP_FIRST_NONE ? 0 : (double)opacity[*bin];
                p->layer[0][i] += o;
                row += o;
            }
            p->layer[1][j] += row;
            p->layer[2][k] += row;
            p->total += row;
        }
}

/* The first and last layer of an axis between which all but 0.5 % of the opacity lies on each
 * side. */
static void compute_ends(const struct sp_default_samples *s, const struct profiles *p,
                         unsigned axis, uint32_t ends[2]) {
    double sum = 0;
    ends[0] = 0;
    ends[1] = s->count[axis] - 1;
    for (uint32_t i = 0; i < s->count[axis]; i++) {
        if (sum <= 0.005 * p->total)
            ends[0] = i;
        sum += p->layer[axis][i];
        if (sum >= 0.995 * p->total) {
            ends[1] = i;
            break;
        }
    }
}

/* A world axis as a unit vector; the column of the grid's direction, with a sign. */
static struct sp_vec3 grid_axis(const struct sp_default_samples *s, unsigned axis, double sign) {
    struct sp_vec3 v;
    for (int r = 0; r < 3; r++)
        v.v[r] = sign * s->info->grid.direction[r][axis];
    return v;
}

/* The unit vector of a sum of three directions. */
static struct sp_vec3 mix(struct sp_vec3 side, struct sp_vec3 front, struct sp_vec3 up,
                          const double weight[3]) {
    struct sp_vec3 level =
        sp_vec3_add(sp_vec3_scale(side, weight[0]), sp_vec3_scale(front, weight[1]));
    return sp_vec3_normalize(sp_vec3_add(level, sp_vec3_scale(up, weight[2])));
}

static bool is_real(enum sp_type type) {
    return type == SP_FLOAT32 || type == SP_FLOAT64;
}

/* The extent of the visible matter along each axis, and how much of it lies in the layers at its
 * ends, relative to the mean layer. */
struct shape {
    double size[3], end[3][2];
};

static void measure_shape(const struct sp_default_samples *s,
                          const double extinction[SP_FIRST_BINS], struct shape *shape) {
    float opacity[SP_FIRST_BINS];
    struct profiles p;
    compute_opacity(s, extinction, opacity);
    add_profiles(s, opacity, &p);
    for (unsigned a = 0; a < 3; a++) {
        uint32_t ends[2];
        compute_ends(s, &p, a, ends);
        uint32_t n = ends[1] - ends[0] + 1, depth = 1 + n / 32;
        shape->size[a] = n * s->cell[a];
        for (int side = 0; side < 2; side++) {
            double sum = 0;
            for (uint32_t i = 0; i < depth && i < n; i++)
                sum += p.layer[a][side ? ends[1] - i : ends[0] + i];
            shape->end[a][side] = p.total > 0 ? sum / depth / (p.total / n) : 0;
        }
    }
}

/* The size of the grid, whatever its samples are. */
static void measure_grid(const struct sp_grid *grid, struct shape *shape) {
    *shape = (struct shape){ 0 };
    for (unsigned a = 0; a < 3; a++) {
        double extent[2];
        sp_grid_extent(grid, a, extent);
        shape->size[a] = extent[1] - extent[0];
    }
}

/* The axis across a flat object; 3 if it is not flat. */
static unsigned find_flat_axis(const struct shape *shape) {
    unsigned thin = 0;
    for (unsigned a = 1; a < 3; a++)
        if (shape->size[a] < shape->size[thin])
            thin = a;
    double other = fmin(shape->size[(thin + 1) % 3], shape->size[(thin + 2) % 3]);
    return shape->size[thin] < 0.45 * other ? thin : 3;
}

/* What stands on something is broad at its foot: a pot, a plate, the face at which a scan ends.
 * Finds the axis and the side of such a foot; false if no end is much broader than the other. */
static bool find_foot(const struct shape *shape, unsigned *axis, int *side) {
    double best = 1.5;
    bool found = false;
    for (unsigned a = 0; a < 3; a++)
        for (int end = 0; end < 2; end++) {
            double longest = fmax(shape->size[(a + 1) % 3], shape->size[(a + 2) % 3]);
            if (shape->end[a][end] > best && shape->end[a][!end] < 0.4 * shape->end[a][end] &&
                longest < 1.8 * shape->size[a]) {
                best = shape->end[a][end];
                *axis = a;
                *side = end;
                found = true;
            }
        }
    return found;
}

/* The share of a face that shows values from a bin on. */
static double seen_on_face(const uint64_t counts[SP_FIRST_BINS], int least) {
    double seen = 0, all = 0;
    for (int b = 0; b < SP_FIRST_BINS; b++) {
        all += (double)counts[b];
        seen += b >= least ? (double)counts[b] : 0;
    }
    return all > 0 ? seen / all : 0;
}

/* The lowest bin whose values are visible. */
static int least_seen(const double extinction[SP_FIRST_BINS]) {
    int least = 0;
    while (least < SP_FIRST_BINS - 1 && !(extinction[least] > 0))
        least++;
    return least;
}

/* True if the object is cut by one face across an axis, and not by the opposite one. */
static bool is_cut(const struct sp_default_samples *s, const double extinction[SP_FIRST_BINS],
                   unsigned axis, int side) {
    const int least = least_seen(extinction);
    const double seen = seen_on_face(s->faces[2 * axis + (unsigned)side], least);
    return seen > 0.1 && seen_on_face(s->faces[2 * axis + (unsigned)!side], least) < 0.35 * seen;
}

/* A scan that ends inside a body shows it on its last slice: a neck, a thigh. There is down. If
 * both ends show it, or none does, the broader end may tell: a skull ends in a dome. */
static bool find_cut(const struct sp_default_samples *s, const double extinction[SP_FIRST_BINS],
                     const struct shape *shape, unsigned axis, int *side) {
    const double dome = 0.25, broad = 0.4;
    double seen[2];
    for (int end = 0; end < 2; end++)
        seen[end] = /* also matter that is too thin to be visible */
            seen_on_face(s->faces[2 * axis + (unsigned)end], least_seen(extinction) / 2);
    int most = seen[1] > seen[0];
    if (seen[most] >= 0.05 && seen[!most] <= 0.35 * seen[most]) {
        *side = most;
        return true;
    }
    most = shape->end[axis][1] > shape->end[axis][0];
    if (shape->end[axis][most] < broad || shape->end[axis][!most] > dome)
        return false;
    *side = most;
    return true;
}

/* From the front, a little from the left and above. A few axial slices are seen from below, as
 * radiologists do, with the front above; a few sagittal slices from the left. */
static bool orient_patient(const struct sp_default_samples *s, unsigned flat,
                           struct sp_default_orientation *o) {
    static const char letters[3] = { 'L', 'A', 'S' };
    struct sp_vec3 to[3];
    for (int i = 0; i < 3; i++)
        if (!sp_anatomy_find(s->info->anatomy, letters[i], to[i].v))
            return false;
    int across = 1;
    for (int i = 0; i < 3 && flat < 3; i++)
        if (fabs(sp_vec3_dot(grid_axis(s, flat, 1), to[i])) > 0.7)
            across = i;
    o->up = to[across == 2 ? 1 : 2];
    if (across == 2)
        o->away = mix(to[0], to[2], o->up, (double[]){ 0.3, -0.85, 0.4 });
    else if (across == 0)
        o->away = mix(to[1], to[0], o->up, (double[]){ 0.3, 0.85, 0.2 });
    else
        o->away = mix(to[0], to[1], o->up, (double[]){ 0.45, 0.82, 0.2 });
    return true;
}

/* A flat object is seen from its broad side. Integers are images: the first slice is in front, and
 * the first row above. Real numbers are maps: the last axis points to the camera, the second one
 * up. */
static struct sp_default_orientation orient_flat(const struct sp_default_samples *s,
                                                 unsigned axis) {
    bool is_image = sp_anatomy_is_plain_stack(s->info) && !is_real(s->info->type);
    unsigned right = axis == 0 ? 1 : 0, up = axis == 2 ? 1 : 2;
    double towards = axis == 0 ? 1 : axis == 1 || is_image ? -1 : 1;
    double rise =
        axis == 2 && !is_image ? -0.55 : 0.4; /* a map lies and is seen from its lower edge */
    struct sp_default_orientation o = { .up = grid_axis(s, up, axis == 2 && is_image ? -1 : 1) };
    o.away = mix(grid_axis(s, right, 1), grid_axis(s, axis, towards), o.up,
                 (double[]){ 0.3, 0.85, rise });
    return o;
}

/* Up along an axis of the grid, and in front of it. A face that cuts the object is not shown: it is
 * seen from its side, and a little from behind. */
static struct sp_default_orientation orient_upright(const struct sp_default_samples *s,
                                                    const double extinction[SP_FIRST_BINS],
                                                    const struct shape *shape, unsigned axis,
                                                    int foot) {
    unsigned right = axis == 0 ? 1 : 0, front = 3 - axis - right;
    double towards = axis == 2 ? -1 : 1; /* low y is in front where z is up, high z else */
    if (shape->size[front] > 1.8 * shape->size[right]) { /* see the broader side */
        unsigned swap = right;
        right = front;
        front = swap;
    }
    struct sp_default_orientation o = { .up = grid_axis(s, axis, foot ? -1 : 1) };
    const double aside = is_cut(s, extinction, right, 1) ? -1 : 1;
    const bool is_turned = is_cut(s, extinction, front, towards > 0);
    o.away = mix(grid_axis(s, right, aside), grid_axis(s, front, is_turned ? -towards : towards),
                 o.up, (double[]){ is_turned ? 0.82 : 0.45, is_turned ? 0.45 : 0.82, 0.35 });
    return o;
}

/* The default of a world whose axes say nothing: z is up, low y is in front. */
static struct sp_default_orientation orient_world(void) {
    return (struct sp_default_orientation){
        { { 0, 0, 1 } }, sp_vec3_normalize((struct sp_vec3){ { 0.45, -0.82, 0.35 } })
    };
}

struct sp_default_orientation sp_default_orient(const struct sp_default_samples *s,
                                                const double extinction[SP_FIRST_BINS]) {
    struct sp_default_orientation o;
    struct shape shape;
    bool has_fields = s->info->others[0][0] != 0; /* the same camera shows each of them */
    if (has_fields)
        measure_grid(&s->info->grid, &shape);
    else
        measure_shape(s, extinction, &shape);
    unsigned axis = find_flat_axis(&shape);
    if (orient_patient(s, axis, &o))
        return o;
    if (axis < 3)
        return orient_flat(s, axis);
    if (has_fields || !sp_anatomy_is_plain_stack(s->info))
        return orient_world();
    const double *spacing = s->info->grid.spacing;
    bool is_scan = spacing[2] != spacing[0] && spacing[0] == spacing[1];
    int foot = is_scan || !is_real(s->info->type); /* scans are stored from the head down */
    axis = 2;
    if (is_scan || !find_foot(&shape, &axis, &foot))
        find_cut(s, extinction, &shape, axis, &foot);
    return orient_upright(s, extinction, &shape, axis, foot);
}
