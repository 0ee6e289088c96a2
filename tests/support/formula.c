/* SPDX-License-Identifier: Apache-2.0 */
#include "support/formula.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "support/footprint.h"
#include "support/sample.h"

/* A voxel that is drawn, and its sort key. */
struct entry {
    struct test_footprint foot;
    double key;  /* sheet, distance, or range of distances, front to back */
    size_t list; /* position in the list of bricks, for equal keys */
};

struct formula {
    const struct test_scene *scene;
    struct test_projection projection;
    struct entry *entries; /* sorted */
    size_t count;
    double thickness;   /* of a slab, world units */
    long first, layers; /* index of the first slab or sheet; number of layers */
    double *sums;       /* [layers][height][width][TEST_NUMBERS] */
    struct sp_transfer_function plain,
        scale; /* post: without the gradient axis; with nothing else */
    struct test_image *image;
};

/* Returns the axis whose slices face the view direction best. *rising: the first slice is the
 * nearest one. */
static int major_axis(const struct formula *f, bool *rising) {
    double best = -1, det;
    struct sp_mat3 direction;
    memcpy(direction.m, f->scene->info.grid.direction, sizeof direction.m);
    struct sp_mat3 inverse = sp_mat3_inverse(&direction, &det);
    int axis = 0;
    for (int a = 0; a < 3; a++) {
        /* Row a of the inverse is normal to the slices of axis a. */
        struct sp_vec3 normal = sp_vec3_normalize(sp_vec3_from(inverse.m[a]));
        double facing = sp_vec3_dot(normal, sp_vec3_from(f->projection.w[2]));
        if (fabs(facing) > best) {
            best = fabs(facing);
            axis = a;
            *rising = facing > 0;
        }
    }
    return axis;
}

/* Returns the position in a list of bricks of 16³, with i0 fastest among bricks and inside them. */
static size_t list_place(const uint32_t dims[3], const uint32_t i[3]) {
    size_t brick = 0, inside = 0;
    for (int a = 2; a >= 0; a--) {
        brick = brick * ((dims[a] + 15) / 16) + i[a] / 16;
        inside = inside * 16 + i[a] % 16;
    }
    return brick * 4096 + inside;
}

static int compare(const void *a, const void *b) {
    const struct entry *p = a, *q = b;
    if (p->key != q->key)
        return p->key < q->key ? -1 : 1;
    return p->list < q->list ? -1 : p->list > q->list;
}

/* Fills and sorts the entries; false when out of memory. */
static bool collect(struct formula *f, double range) {
    const uint32_t *dims = f->scene->info.grid.dims;
    enum sp_compositing mode = f->scene->view.compositing.mode;
    bool rising = true;
    int axis = major_axis(f, &rising);
    f->entries = malloc(((size_t)dims[0] * dims[1] * dims[2] + 1) * sizeof *f->entries);
    if (!f->entries)
        return false;
    uint32_t i[3];
    for (i[2] = 0; i[2] < dims[2]; i[2]++)
        for (i[1] = 0; i[1] < dims[1]; i[1]++)
            for (i[0] = 0; i[0] < dims[0]; i[0]++) {
                struct entry *e = &f->entries[f->count];
                if (!test_footprint_init(&f->projection, i, &e->foot))
                    continue;
                e->list = list_place(dims, i);
                e->key = rising ? i[axis] : dims[axis] - 1.0 - i[axis];
                if (mode != SP_COMPOSITE_SHEET)
                    e->key = range > 0 ? floor(e->foot.distance / range) : e->foot.distance;
                f->count++;
            }
    qsort(f->entries, f->count, sizeof *f->entries, compare);
    return true;
}

/* Sets the first and the last slab that a kernel reaches. */
static void slab_range(const struct formula *f, const struct test_footprint *foot, long *first,
                       long *last) {
    *first = (long)floor((foot->distance - foot->reach) / f->thickness);
    *last = (long)floor((foot->distance + foot->reach) / f->thickness);
}

/* Allocates the sums of all layers. */
static bool open_layers(struct formula *f) {
    const struct sp_view *view = &f->scene->view;
    const double *spacing = f->scene->info.grid.spacing;
    long first = 0, last = 0;
    f->thickness = view->compositing.slab * fmin(spacing[0], fmin(spacing[1], spacing[2]));
    for (size_t n = 0; n < f->count; n++) {
        long low = (long)f->entries[n].key, high = low;
        if (view->compositing.mode == SP_COMPOSITE_SLAB)
            slab_range(f, &f->entries[n].foot, &low, &high);
        if (view->compositing.mode == SP_COMPOSITE_SPLAT)
            low = high = 0;
        first = n == 0 || low < first ? low : first;
        last = n == 0 || high > last ? high : last;
    }
    f->first = first;
    f->layers = last - first + 1;
    f->sums =
        calloc((size_t)f->layers * view->size[0] * view->size[1] * TEST_NUMBERS, sizeof *f->sums);
    return f->sums != NULL;
}

static double *sums_at(const struct formula *f, long layer, size_t pixel) {
    size_t pixels = (size_t)f->image->width * f->image->height;
    return f->sums + ((size_t)(layer - f->first) * pixels + pixel) * TEST_NUMBERS;
}

static void add_numbers(double *sums, const double *numbers, double length) {
    for (int k = 0; k < TEST_NUMBERS; k++)
        sums[k] += numbers[k] * length;
}

/* Adds the shares of a kernel to the slabs on the ray of one pixel. */
static void add_slabs(const struct formula *f, const struct test_footprint *foot, const double d[2],
                      const struct test_crossing *c, size_t pixel) {
    const struct test_projection *p = &f->projection;
    double mean = foot->distance + foot->slope[0] * d[0] + foot->slope[1] * d[1];
    double before = isinf(c->low) ? 0 : test_footprint_share(p, c, c->low);
    double all = isinf(c->high) ? 1 : test_footprint_share(p, c, c->high);
    long first, last;
    slab_range(f, foot, &first, &last);
    for (long k = first; k <= last; k++) {
        double face = ((double)(k + 1) * f->thickness - mean) / foot->deviation, share = all;
        if (k < last)
            share = fmin(fmax(test_footprint_share(p, c, face), before), all);
        add_numbers(sums_at(f, k, pixel), foot->numbers, c->length * (share - before));
        before = share;
    }
}

/* Averages the transfer function over the values along the ray within a slab, then applies the
 * gradient axis. */
static void classify_interval(const struct formula *f, double value, double half, double magnitude,
                              double color[3], double *opacity) {
    enum { STEPS = 200 };
    double depth = 0, sum[3] = { 0 }, scale, unused[3];
    for (int i = 0; i < STEPS; i++) {
        double c[3], o;
        test_classify(&f->plain, value + half * (2 * (i + 0.5) / STEPS - 1), 0, c, &o);
        depth += -log1p(-o) / STEPS;
        for (int k = 0; k < 3; k++)
            sum[k] += c[k] * -log1p(-o) / STEPS;
    }
    for (int k = 0; k < 3; k++)
        color[k] = depth > 0 ? sum[k] / depth : 0;
    test_classify(&f->scale, 0, magnitude, unused, &scale); /* half of the gradient's scale */
    *opacity = -expm1(-depth) * 2 * scale;
}

/* Post-classification: converts (N, W, S) of a pixel to (E, T). */
static void classify_pixel(const struct formula *f, size_t pixel, double *sums) {
    const struct sp_view *view = &f->scene->view;
    const struct test_projection *p = &f->projection;
    double color[3], opacity, gradient[3], ahead[3], all = sums[3], u[2] = { 0 }, along = 0;
    if (!(all > 1e-12))
        return;
    for (int c = 0; c < 3; c++)
        gradient[c] = sums[c] / all;
    double magnitude =
        sqrt(gradient[0] * gradient[0] + gradient[1] * gradient[1] + gradient[2] * gradient[2]);
    if (p->perspective) {
        u[0] = ((double)(pixel % f->image->width) + 0.5 - 0.5 * view->size[0]) / p->scale;
        u[1] = ((double)(pixel / f->image->width) + 0.5 - 0.5 * view->size[1]) / p->scale;
    }
    for (int c = 0; c < 3; c++) {
        ahead[c] = (u[0] * p->w[0][c] + u[1] * p->w[1][c] + p->w[2][c]) /
                   sqrt(u[0] * u[0] + u[1] * u[1] + 1);
        along += ahead[c] * gradient[c];
    }
    classify_interval(f, sums[4] / all, 0.5 * f->thickness * fabs(along), magnitude, color,
                      &opacity);
    test_shade(view, ahead, gradient, color);
    sums[3] = -log1p(-opacity) / view->transfer_function.reference_length * all;
    for (int c = 0; c < 3; c++)
        sums[c] = color[c] * sums[3];
}

/* Composites a pixel's sums of one layer and clears them. */
static void close_pixel(const struct formula *f, size_t pixel, double *sums) {
    double *to = f->image->rgba + pixel * 4;
    if (f->projection.post)
        classify_pixel(f, pixel, sums);
    if (sums[3] > 0) {
        bool linear = f->scene->view.compositing.attenuation == SP_ATTENUATION_LINEAR;
        double alpha = (linear ? fmin(sums[3], 1) : -expm1(-sums[3])) * (1 - to[3]);
        for (int c = 0; c < 3; c++)
            to[c] += sums[c] / sums[3] * alpha;
        to[3] += alpha;
    }
    memset(sums, 0, TEST_NUMBERS * sizeof *sums);
}

static void add_pixel(const struct formula *f, const struct entry *e, unsigned x, unsigned y) {
    enum sp_compositing mode = f->scene->view.compositing.mode;
    const struct test_projection *p = &f->projection;
    double d[2] = { x + 0.5 - e->foot.x, y + 0.5 - e->foot.y };
    size_t pixel = x + (size_t)y * f->image->width;
    struct test_crossing c;
    if (!test_footprint_cross(p, &e->foot, d, &c))
        return;
    if (mode == SP_COMPOSITE_SLAB) {
        add_slabs(f, &e->foot, d, &c, pixel);
        return;
    }
    double share = (isinf(c.high) ? 1 : test_footprint_share(p, &c, c.high)) -
                   (isinf(c.low) ? 0 : test_footprint_share(p, &c, c.low));
    double *sums = sums_at(f, mode == SP_COMPOSITE_SHEET ? (long)e->key : f->first, pixel);
    add_numbers(sums, e->foot.numbers, c.length * share);
    if (mode == SP_COMPOSITE_SPLAT)
        close_pixel(f, pixel, sums);
}

static void add_entry(const struct formula *f, const struct entry *e) {
    const struct test_footprint *foot = &e->foot;
    double width = f->image->width, height = f->image->height;
    double x0 = fmax(ceil(foot->x - foot->rx - 0.5), 0);
    double x1 = fmin(foot->x + foot->rx - 0.5, width - 1);
    double y0 = fmax(ceil(foot->y - foot->ry - 0.5), 0);
    double y1 = fmin(foot->y + foot->ry - 0.5, height - 1);
    for (double y = y0; y <= y1; y++)
        for (double x = x0; x <= x1; x++)
            add_pixel(f, e, (unsigned)x, (unsigned)y);
}

bool test_formula_render(const struct test_scene *scene, double range, struct test_image *image) {
    struct formula f = { .scene = scene, .image = image };
    assert(scene->view.filter.mode != SP_FILTER_ADAPTIVE);
    test_projection_init(&f.projection, scene);
    f.plain = f.scale = scene->view.transfer_function;
    f.plain.gradient_count = 0;
    f.scale.point_count = 1;
    f.scale.points[0].opacity = 0.5F;
    if (!test_image_init(image, scene->view.size[0], scene->view.size[1]))
        return false;
    bool ok = collect(&f, range) && open_layers(&f);
    for (size_t n = 0; ok && n < f.count; n++)
        add_entry(&f, &f.entries[n]);
    size_t pixels = (size_t)image->width * image->height;
    for (long k = 0; ok && k < f.layers; k++)
        for (size_t n = 0; n < pixels; n++)
            close_pixel(&f, n, sums_at(&f, f.first + k, n));
    free(f.entries);
    free(f.sums);
    if (!ok)
        test_image_finish(image);
    else
        test_image_over(image, scene->view.background);
    return ok;
}
