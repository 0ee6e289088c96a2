/* SPDX-License-Identifier: Apache-2.0
 *
 * Which share of a measurement lies outside of the volume. The volume is a box in distances along
 * the axes of the grid, and these are linear in world positions. So shares of a line and of an area
 * of a plane are the same there, and clipping against six planes gives them:
 *
 *   line a ─── b          the interval of t in [0, 1] that is inside
 *   rectangle, ellipse    the polygon in (s, t) = shares of the sides, cut at six lines
 *                         (Sutherland, Hodgman: Reentrant Polygon Clipping, CACM 1974)
 */
#include "inspect/measure/outside.h"

#include <math.h>

#include "data/volume/interpolate.h"

#define ON_BORDER 1e-9 /* share of the volume's extent that rounding may move a point by */
enum { ELLIPSE_CORNERS = 256, POLYGON_MAX = ELLIPSE_CORNERS + 6 };

/* f(s, t) = at + ds·s + dt·t, which is at least 0 on the inner side of a face of the volume. */
struct face {
    double at, ds, dt;
};

struct polygon {
    unsigned count;
    double points[POLYGON_MAX][2];
};

static void faces_of(const struct sp_interpolator *to, const double corner[3], const double b[3],
                     const double c[3], struct face faces[6]) {
    double from[3], ends[2][3];
    sp_interpolator_distances(to, corner, from);
    sp_interpolator_distances(to, b, ends[0]);
    sp_interpolator_distances(to, c, ends[1]);
    for (unsigned axis = 0; axis < 3; axis++) {
        const double *extent = to->extent[axis], ds = ends[0][axis] - from[axis],
                     dt = ends[1][axis] - from[axis];
        const double slack = ON_BORDER * (extent[1] - extent[0]);
        faces[2 * axis] = (struct face){ from[axis] - extent[0] + slack, ds, dt };
        faces[2 * axis + 1] = (struct face){ extent[1] + slack - from[axis], -ds, -dt };
    }
}

static double height_of(const struct face *face, const double p[2]) {
    return face->at + face->ds * p[0] + face->dt * p[1];
}

/* Returns the share of the line from a to b that is inside; of a point: 0 or 1. */
static double line_inside(const struct sp_interpolator *to, const double a[3], const double b[3]) {
    struct face faces[6];
    double low = 0, high = 1;
    faces_of(to, a, b, a, faces);
    for (unsigned f = 0; f < 6; f++) {
        const double at = faces[f].at, slope = faces[f].ds;
        if (slope == 0 && at < 0)
            return 0;
        if (slope > 0)
            low = fmax(low, -at / slope);
        else if (slope < 0)
            high = fmin(high, at / -slope);
    }
    return fmax(high - low, 0);
}

static void add_corner(struct polygon *polygon, double s, double t) {
    if (polygon->count == POLYGON_MAX) /* a cut of a convex polygon adds one corner at most */
        return;
    polygon->points[polygon->count][0] = s;
    polygon->points[polygon->count++][1] = t;
}

static void cut(struct polygon *polygon, const struct face *face) {
    struct polygon kept = { .count = 0 };
    for (unsigned i = 0; i < polygon->count; i++) {
        const double *from = polygon->points[i], *next = polygon->points[(i + 1) % polygon->count];
        const double here = height_of(face, from), there = height_of(face, next);
        if (here >= 0)
            add_corner(&kept, from[0], from[1]);
        if ((here >= 0) == (there >= 0))
            continue;
        const double share = here / (here - there);
        add_corner(&kept, from[0] + (next[0] - from[0]) * share,
                   from[1] + (next[1] - from[1]) * share);
    }
    *polygon = kept;
}

static double area_of(const struct polygon *polygon) {
    double twice = 0;
    for (unsigned i = 0; i < polygon->count; i++) {
        const double *p = polygon->points[i], *q = polygon->points[(i + 1) % polygon->count];
        twice += p[0] * q[1] - p[1] * q[0];
    }
    return fabs(twice) / 2;
}

/* Returns the share of the area that is inside. */
static double region_inside(const struct sp_interpolator *to, const struct sp_measure *region) {
    struct polygon polygon = { 4, { { 0, 0 }, { 1, 0 }, { 1, 1 }, { 0, 1 } } };
    struct face faces[6];
    faces_of(to, region->points[0], region->points[1], region->points[2], faces);
    if (region->kind == SP_MEASURE_ELLIPSE) {
        polygon.count = ELLIPSE_CORNERS;
        for (unsigned i = 0; i < ELLIPSE_CORNERS; i++) {
            const double angle = 2 * 3.14159265358979323846 * i / ELLIPSE_CORNERS;
            polygon.points[i][0] = cos(angle);
            polygon.points[i][1] = sin(angle);
        }
    }
    const double whole = area_of(&polygon);
    bool is_cut = false;
    for (unsigned f = 0; f < 6 && polygon.count > 0; f++)
        for (unsigned i = 0; i < polygon.count; i++)
            if (height_of(&faces[f], polygon.points[i]) < 0) {
                cut(&polygon, &faces[f]);
                is_cut = true;
                break;
            }
    return is_cut ? area_of(&polygon) / whole : 1;
}

/* Returns the share of the lines from point to point that is inside, by their lengths. */
static double lines_inside(const struct sp_interpolator *to, const struct sp_measure *measure) {
    const unsigned lines = sp_measure_point_count(measure->kind) - 1;
    double whole = 0, inside = 0;
    for (unsigned i = 0; i < lines; i++) {
        const double *a = measure->points[i], *b = measure->points[i + 1];
        /* Two equal points count as one place. */
        const double length =
            fmax(hypot(hypot(b[0] - a[0], b[1] - a[1]), b[2] - a[2]), lines > 1 ? 0 : 1e-300);
        whole += length;
        inside += length * line_inside(to, a, b);
    }
    return inside / whole;
}

double sp_measure_outside(const struct sp_volume *volume, const struct sp_measure *measure) {
    struct sp_interpolator to;
    double inside = 1;
    if (sp_volume_elements(volume)) /* it ends nowhere */
        return 0;
    sp_interpolator_init(&to, volume);
    switch (measure->kind) {
    case SP_MEASURE_RECTANGLE:
    case SP_MEASURE_ELLIPSE:
        inside = region_inside(&to, measure);
        break;
    case SP_MEASURE_MARKER:
        inside = line_inside(&to, measure->points[0], measure->points[0]);
        break;
    case SP_MEASURE_PART:
    case SP_MEASURE_PATH:
        break;
    case SP_MEASURE_DISTANCE:
    case SP_MEASURE_PROFILE:
    case SP_MEASURE_ANGLE:
    case SP_MEASURE_KINDS:
        inside = lines_inside(&to, measure);
    }
    return fmin(fmax(1 - inside, 0), 1);
}
