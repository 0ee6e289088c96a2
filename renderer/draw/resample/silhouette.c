/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/resample/silhouette.h"

#include <math.h>

enum {
    PAIRS_MAX = RESAMPLE_HALVES_MAX * RESAMPLE_HALVES_MAX / 4,
    CORNERS_MAX = 4 + PAIRS_MAX /* a line adds at most one corner to a convex polygon */
};

/* Linear functions of the pixel, as factors of (x, y, 1), in px from the image's centre. */
struct face {
    double gap[3], rise[3];
    bool is_entered, is_joint;
};

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void init_face(struct face *face, const struct sp_resample *r,
                      const struct sp_resample_half *half) {
    const double right = dot(half->normal, r->right), down = dot(half->normal, r->down);
    const bool is_perspective = r->camera->projection == SP_PERSPECTIVE;
    *face = (struct face){ { -right, -down, half->offset - dot(half->normal, r->start) },
                           { 0, 0, dot(half->normal, r->ray) },
                           false,
                           half->is_joint };
    if (is_perspective) {
        face->gap[0] = face->gap[1] = 0;
        face->rise[0] = right;
        face->rise[1] = down;
    }
    face->is_entered = is_perspective ? face->gap[2] > 0 : face->rise[2] > 0;
}

/* True if rays enter the drawn part through this face. A joint counts neither here nor below:
 * behind it, another image shows the rest of the volume. At the joint both images cover whole
 * pixels. If each covered a part of the pixel, the background would show between them. */
static bool is_in_front(const struct face *face) {
    return face->is_entered && !face->is_joint;
}

/* True if rays leave the drawn part through this face. */
static bool is_behind(const struct face *face) {
    return !face->is_entered && !face->is_joint;
}

/* A convex polygon in the image, in px from its corner. */
struct polygon {
    int count;
    double at[CORNERS_MAX][2];
};

static double distance(const double line[3], const double at[2]) {
    return line[0] * at[0] + line[1] * at[1] + line[2];
}

/* Keeps what is inside the line. */
static void clip(struct polygon *polygon, const double line[3]) {
    struct polygon out = { 0 };
    for (int i = 0; i < polygon->count; i++) {
        const double *a = polygon->at[i], *b = polygon->at[(i + 1) % polygon->count];
        const double from = distance(line, a), to = distance(line, b);
        if (from >= 0) {
            out.at[out.count][0] = a[0];
            out.at[out.count++][1] = a[1];
        }
        if ((from < 0) != (to < 0) && out.count < CORNERS_MAX) {
            const double part = from / (from - to);
            for (int c = 0; c < 2; c++)
                out.at[out.count][c] = a[c] + part * (b[c] - a[c]);
            out.count++;
        }
    }
    *polygon = out;
}

/* The line of the edge between two faces. Returns false if the edge is infinitely far away. */
static bool init_line(double line[3], const struct face *in, const struct face *out,
                      const double centre[2]) {
    const double furthest = 1e9; /* px */
    for (int c = 0; c < 3; c++)
        line[c] = in->gap[2] * out->rise[c] - out->gap[2] * in->rise[c];
    for (int c = 0; c < 2; c++) /* of these products, one has a factor of 0 */
        line[c] += in->gap[c] * out->rise[2] - out->gap[c] * in->rise[2];
    const double length = hypot(line[0], line[1]);
    line[2] -= line[0] * centre[0] + line[1] * centre[1];
    if (!(length * furthest > fabs(line[2])))
        return false;
    for (int c = 0; c < 3; c++)
        line[c] /= length;
    return true;
}

static bool is_same(const double a[3], const double b[3], const struct polygon *polygon) {
    const double least = 0.01; /* px */
    for (int i = 0; i < polygon->count; i++)
        if (fabs(distance(a, polygon->at[i]) - distance(b, polygon->at[i])) > least)
            return false;
    return true;
}

/* Adds a side if it may cross a pixel that the polygon meets. Returns false if there are too many.
 */
static bool add(struct sp_silhouette *s, const double line[3], const struct polygon *polygon) {
    double least = INFINITY;
    for (int i = 0; i < polygon->count; i++)
        least = fmin(least, distance(line, polygon->at[i]));
    if (!(least < 1)) /* px; a pixel's diagonal is shorter than twice this */
        return true;
    for (int i = 0; i < s->count; i++)
        if (is_same(s->line[i], line, polygon))
            return true;
    if (s->count == RESAMPLE_SIDES_MAX)
        return false;
    for (int c = 0; c < 3; c++)
        s->line[s->count][c] = line[c];
    s->count++;
    return true;
}

void sp_silhouette_init(struct sp_silhouette *silhouette, const struct sp_resample *r) {
    const double margin = 1; /* px */
    const double right = r->frame->width + margin, below = r->frame->height + margin;
    struct polygon polygon = {
        4, { { -margin, -margin }, { right, -margin }, { right, below }, { -margin, below } }
    };
    struct face face[RESAMPLE_HALVES_MAX];
    double line[PAIRS_MAX][3];
    int count = 0;
    *silhouette = (struct sp_silhouette){ 0 };
    for (uint32_t h = 0; h < r->half_count; h++)
        init_face(&face[h], r, &r->halves[h]);
    for (uint32_t i = 0; i < r->half_count; i++)
        for (uint32_t j = 0; is_in_front(&face[i]) && j < r->half_count; j++)
            if (is_behind(&face[j]) &&
                init_line(line[count], &face[i], &face[j], r->camera->centre))
                clip(&polygon, line[count++]);
    for (int i = 0; polygon.count && i < count; i++)
        if (!add(silhouette, line[i], &polygon)) {
            silhouette->count = 0;
            return;
        }
}

bool sp_silhouette_is_equal(const struct sp_silhouette *a, const struct sp_silhouette *b) {
    const double far = 16384, least = 0.01; /* px */
    if (a->count != b->count)
        return false;
    for (int i = 0; i < a->count; i++) {
        bool is_found = false;
        for (int j = 0; !is_found && j < b->count; j++)
            is_found = fabs(a->line[i][0] - b->line[j][0]) * far < least &&
                       fabs(a->line[i][1] - b->line[j][1]) * far < least &&
                       fabs(a->line[i][2] - b->line[j][2]) < least;
        if (!is_found)
            return false;
    }
    return true;
}
