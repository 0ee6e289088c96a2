/* SPDX-License-Identifier: Apache-2.0 */
#include "data/volume/curvilinear.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "data/volume/factor.h"

/* A cell whose edges span less than this part of a box with the same edges is flat: rounded
 * positions give no better value. */
#define FLAT 1e-6

struct lattice {
    const float (*positions)[3];
    const uint32_t *dims;
    bool closed[3];
};

static uint64_t node(const struct lattice *l, const uint32_t at[3]) {
    return ((uint64_t)at[2] * l->dims[1] + at[1]) * l->dims[0] + at[0];
}

static double distance(const float p[3], const float q[3]) {
    double square = 0;
    for (int a = 0; a < 3; a++)
        square += ((double)p[a] - (double)q[a]) * ((double)p[a] - (double)q[a]);
    return sqrt(square);
}

/* The ends coincide to rounding: to a thousandth of the first gap. */
static bool is_closed(const struct lattice *l, int axis) {
    const int b = (axis + 1) % 3, c = (axis + 2) % 3;
    uint32_t at[3], next[3], end[3];
    if (l->dims[axis] < 4)
        return false;
    at[axis] = 0;
    for (at[b] = 0; at[b] < l->dims[b]; at[b]++)
        for (at[c] = 0; at[c] < l->dims[c]; at[c]++) {
            memcpy(end, at, sizeof end);
            memcpy(next, at, sizeof next);
            end[axis] = l->dims[axis] - 1;
            next[axis] = 1;
            const float *p = l->positions[node(l, at)];
            if (!(distance(p, l->positions[node(l, end)]) <=
                  1e-3 * distance(p, l->positions[node(l, next)])))
                return false;
        }
    return true;
}

/* The derivative of the position along an axis with at least two nodes. */
static void derivative(const struct lattice *l, const uint32_t at[3], int axis, double out[3]) {
    const uint32_t last = l->dims[axis] - 1;
    uint32_t low[3], high[3];
    memcpy(low, at, sizeof low);
    memcpy(high, at, sizeof high);
    bool across = l->closed[axis] && (at[axis] == 0 || at[axis] == last);
    low[axis] = across ? last - 1 : at[axis] > 0 ? at[axis] - 1 : 0;
    high[axis] = across ? 1 : at[axis] < last ? at[axis] + 1 : last;
    const double gaps = across ? 2 : (double)(high[axis] - low[axis]);
    const float *p = l->positions[node(l, low)], *q = l->positions[node(l, high)];
    for (int a = 0; a < 3; a++)
        out[a] = ((double)q[a] - (double)p[a]) / gaps;
}

static double length(const double v[3]) {
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

static void cross(const double a[3], const double b[3], double out[3]) {
    for (int i = 0; i < 3; i++)
        out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static void set_length(double v[3], double wanted) {
    double n = length(v);
    for (int i = 0; i < 3; i++)
        v[i] = n > 0 ? v[i] / n * wanted : 0;
}

/* Gives the axes with one node a direction and the smallest gap of the others. */
static void add_missing(const struct lattice *l, double edges[3][3]) {
    double least = INFINITY;
    int present = 0, last = 0;
    for (int axis = 0; axis < 3; axis++) {
        if (l->dims[axis] == 1)
            continue;
        least = fmin(least, length(edges[axis]));
        present++;
        last = axis;
    }
    for (int axis = 0; axis < 3 && present == 0; axis++)
        for (int a = 0; a < 3; a++)
            edges[axis][a] = a == axis;
    if (present == 1) {
        const double *only = edges[last];
        double other[3] = { 0, 0, 0 };
        other[fabs(only[0]) > fabs(only[1])] = 1;
        cross(only, other, edges[(last + 1) % 3]);
        cross(only, edges[(last + 1) % 3], edges[(last + 2) % 3]);
        set_length(edges[(last + 1) % 3], least);
        set_length(edges[(last + 2) % 3], least);
    }
    for (int axis = 0; axis < 3 && present == 2; axis++) {
        if (l->dims[axis] > 1)
            continue;
        cross(edges[(axis + 1) % 3], edges[(axis + 2) % 3], edges[axis]);
        set_length(edges[axis], least);
    }
}

/* Measures the edges of the cell around a node and returns its determinant: 0 = flat. */
static double measure_cell(const struct lattice *l, const uint32_t at[3], double edges[3][3]) {
    double normal[3], box = 1;
    for (int axis = 0; axis < 3; axis++)
        if (l->dims[axis] > 1)
            derivative(l, at, axis, edges[axis]);
    add_missing(l, edges);
    for (int axis = 0; axis < 3; axis++)
        box *= length(edges[axis]);
    cross(edges[1], edges[2], normal);
    double det = edges[0][0] * normal[0] + edges[0][1] * normal[1] + edges[0][2] * normal[2];
    return fabs(det) <= FLAT * box ? 0 : det;
}

static void set_cell(const struct lattice *l, const uint32_t at[3], const double edges[3][3],
                     double det, const struct sp_elements *points, uint64_t i) {
    double m[3][3], volume = fabs(det);
    for (int row = 0; row < 3; row++)
        for (int axis = 0; axis < 3; axis++)
            m[row][axis] = SP_CURVILINEAR_SIGMA * edges[axis][row];
    sp_factor((const double(*)[3])m, points->factors[i]);
    for (int axis = 0; axis < 3; axis++)
        if (l->closed[axis] && (at[axis] == 0 || at[axis] == l->dims[axis] - 1))
            volume /= 2;
    points->volumes[i] = (float)fmin(fmax(volume, (double)FLT_MIN), (double)FLT_MAX);
}

static void compute_node(const uint32_t dims[3], uint64_t i, uint32_t at[3]) {
    at[0] = (uint32_t)(i % dims[0]);
    at[1] = (uint32_t)(i / dims[0] % dims[1]);
    at[2] = (uint32_t)(i / dims[0] / dims[1]);
}

uint64_t sp_curvilinear_finish(const struct sp_elements *points, uint64_t first,
                               const uint32_t dims[3]) {
    struct lattice l = { .positions = (const float(*)[3])points->positions + first, .dims = dims };
    uint64_t count = (uint64_t)dims[0] * dims[1] * dims[2], negative = 0, folded = 0;
    double edges[3][3];
    uint32_t at[3];
    for (int axis = 0; axis < 3; axis++)
        l.closed[axis] = is_closed(&l, axis);
    for (uint64_t i = 0; i < count; i++) {
        compute_node(dims, i, at);
        negative += measure_cell(&l, at, edges) < 0;
    }
    double sign = 2 * negative > count ? -1 : 1;
    for (uint64_t i = 0; i < count; i++) {
        compute_node(dims, i, at);
        double det = sign * measure_cell(&l, at, edges);
        set_cell(&l, at, (const double(*)[3])edges, det, points, first + i);
        folded += det <= 0; /* NaN does not count */
        if (!(det > 0))
            points->values[first + i] = NAN;
    }
    return folded;
}
