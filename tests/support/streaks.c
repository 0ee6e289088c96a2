/* SPDX-License-Identifier: Apache-2.0 */
#include "support/streaks.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/volume/grid.h"
#include "support/sample.h"

/* A sample in the image. */
struct streak {
    double depth, x, y, radius; /* px: no pixel farther away is covered */
    double map[2][2];           /* px from the centre → standard deviations along and across */
    double peak;                /* optical depth at the centre */
    double periods, contrast, phase, shift;
};

struct test_streaks {
    const struct sp_view *view;
    const struct sp_layer *layer;
    double color[3], w[3][3], scale;
    struct streak *list;
    unsigned count;
};

/* The finalizer of MurmurHash3: the upper 16 bits decide whether a sample is drawn, the lower ones
 * are its phase. */
static uint32_t hash_of(uint64_t n) {
    n = (n ^ n >> 33) * 0xff51afd7ed558ccd;
    n = (n ^ n >> 33) * 0xc4ceb9fe1a85ec53;
    return (uint32_t)(n ^ n >> 33);
}

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* The first two rows of J·W; returns |det J|. */
static double project(const struct test_streaks *s, const double u[3], double m[2][3]) {
    const bool is_perspective = s->view->camera.projection == SP_PERSPECTIVE;
    const double f = is_perspective ? s->scale / u[2] : s->scale;
    for (int i = 0; i < 2; i++)
        for (int a = 0; a < 3; a++)
            m[i][a] = f * (s->w[i][a] - (is_perspective ? u[i] / u[2] * s->w[2][a] : 0));
    return is_perspective ? f * f * sqrt(dot(u, u)) / u[2] : f * f;
}

/* The map from pixels to standard deviations, turned so that the vector lies along its first axis.
 */
static void orient(const double v[3], const double e[2], double length, struct streak *k) {
    const double angle = 0.5 * atan2(2 * v[1], v[0] - v[2]), c = cos(angle), s = sin(angle);
    const double first = sqrt(v[0] * c * c + 2 * v[1] * c * s + v[2] * s * s);
    const double second = sqrt(v[0] * s * s - 2 * v[1] * c * s + v[2] * c * c);
    const double root[2][2] = { { c / first, s / first }, { -s / second, c / second } };
    const double at[2] = { root[0][0] * e[0] + root[0][1] * e[1],
                           root[1][0] * e[0] + root[1][1] * e[1] };
    const double size = hypot(at[0], at[1]);
    const double cosine = size > 0 ? at[0] / size : 1, sine = size > 0 ? at[1] / size : 0;
    for (int a = 0; a < 2; a++) {
        k->map[0][a] = cosine * root[0][a] + sine * root[1][a];
        k->map[1][a] = cosine * root[1][a] - sine * root[0][a];
    }
    k->periods = 1 / fmax(length * size, 0.33);
    const double rows = size > 0 ? 1 / hypot(k->map[1][0], k->map[1][1]) - 1 : 0;
    k->contrast = fmin(fmax(rows, 0), 1);
}

/* A sample of a grid, or a point. */
struct sample {
    uint64_t number;
    double place[3];     /* world */
    double kernel[3][3]; /* rows of a matrix whose product with its transpose is the variance */
    double volume;       /* of the cell */
    double sigma;        /* of the kernel along the vector, world units */
    const float *vector;
};

static double length_of(const float v[3]) {
    return sqrt((double)v[0] * (double)v[0] + (double)v[1] * (double)v[1] +
                (double)v[2] * (double)v[2]);
}

static bool init_streak(const struct test_streaks *s, const struct sample *sample,
                        double extinction, struct streak *k) {
    const struct sp_filter *filter = &s->view->filter;
    const double stretch = s->layer->stretch, r = filter->cutoff;
    const double longest = length_of(sample->vector);
    const uint32_t hash = hash_of(sample->number);
    double away[3], u[3], m[2][3], v[3] = { 0 }, e[2] = { 0 };
    const bool has_direction = longest > 0;
    if ((!has_direction && s->layer->style == SP_VECTORS_MODULATE) ||
        (hash >> 16) / 65536.0 >= s->layer->density)
        return false;
    for (int a = 0; a < 3; a++)
        away[a] = sample->place[a] - s->view->camera.position[a];
    for (int i = 0; i < 3; i++)
        u[i] = dot(s->w[i], away);
    const double det_j = project(s, u, m);
    for (int a = 0; a < 3; a++) {
        double column[2] = { 0, 0 };
        for (int i = 0; i < 2; i++) {
            for (int c = 0; c < 3; c++)
                column[i] += m[i][c] * sample->kernel[c][a];
            e[i] +=
                has_direction ? m[i][a] * (double)sample->vector[a] / longest * sample->sigma : 0;
        }
        v[0] += column[0] * column[0];
        v[1] += column[0] * column[1];
        v[2] += column[1] * column[1];
    }
    const double widen = stretch * stretch - 1;
    v[0] += filter->lowpass * filter->lowpass + widen * e[0] * e[0];
    v[1] += widen * e[0] * e[1];
    v[2] += filter->lowpass * filter->lowpass + widen * e[1] * e[1];
    *k = (struct streak){ .depth = u[2] };
    k->x = 0.5 * s->view->size[0];
    k->y = 0.5 * s->view->size[1];
    k->x += s->scale * u[0] / (s->view->camera.projection == SP_PERSPECTIVE ? u[2] : 1);
    k->y += s->scale * u[1] / (s->view->camera.projection == SP_PERSPECTIVE ? u[2] : 1);
    k->radius = r * sqrt(v[0] + v[2]);
    orient(v, e, 2 * stretch, k);
    k->peak = extinction * sample->volume * det_j / (2 * M_PI * sqrt(v[0] * v[2] - v[1] * v[1])) /
              -expm1(-0.5 * r * r);
    k->phase = (hash & 0xffff) / 65536.0 + s->layer->phase;
    k->shift = ((hash & 0xffff) * 40503u >> 8 & 255) / 256.0;
    return true;
}

/* The deviation along a direction of the normal distribution that a line through its middle meets:
 * (dᵀ·V⁻¹·d)^(−1/2), by the cofactors of V. */
static double deviation_along(const double kernel[3][3], const float vector[3]) {
    double v[3][3] = { { 0 } }, form = 0, det = 0;
    const double length = length_of(vector);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            v[r][c] = dot(kernel[r], kernel[c]);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            const int r1 = (r + 1) % 3, r2 = (r + 2) % 3, c1 = (c + 1) % 3, c2 = (c + 2) % 3;
            const double cofactor = v[r1][c1] * v[r2][c2] - v[r1][c2] * v[r2][c1];
            form += cofactor * (double)vector[r] * (double)vector[c];
            det += r == 0 ? v[0][c] * cofactor : 0;
        }
    return length > 0 ? length * sqrt(det / form) : 0;
}

/* False if the sample is clipped. */
static bool read_sample(const struct test_streaks *s, const struct sp_grid *grid, uint64_t n,
                        struct sample *sample) {
    const double sigma = s->view->filter.sigma;
    const uint32_t at[3] = { (uint32_t)(n % grid->dims[0]),
                             (uint32_t)(n / grid->dims[0] % grid->dims[1]),
                             (uint32_t)(n / grid->dims[0] / grid->dims[1]) };
    double mean[3][3], cube = 1; /* the kernel and the volume of a mean cell */
    sample->volume = 1;
    for (int a = 0; a < 3; a++) {
        const double spacing = sp_grid_local_spacing(grid, a, at[a]);
        const double share = (at[a] + 0.5) / grid->dims[a];
        if (share < s->view->clip.box[0][a] || share > s->view->clip.box[1][a])
            return false;
        sample->volume *= spacing;
        cube *= grid->spacing[a];
        for (int c = 0; c < 3; c++) {
            sample->kernel[c][a] = grid->direction[c][a] * spacing * sigma;
            mean[c][a] = grid->direction[c][a] * grid->spacing[a] * sigma;
        }
    }
    test_sample_place(grid, at, sample->place);
    const double usual = deviation_along((const double(*)[3])mean, sample->vector);
    const double own = deviation_along((const double(*)[3])sample->kernel, sample->vector);
    sample->sigma = sigma * cbrt(cube) * (usual > 0 ? own / usual : 1);
    return true;
}

static void read_point(const struct sp_elements *points, uint64_t n, struct sample *sample) {
    const float *l = points->factors[n];
    const double kernel[3][3] = { { (double)l[0], 0, 0 },
                                  { (double)l[1], (double)l[2], 0 },
                                  { (double)l[3], (double)l[4], (double)l[5] } };
    for (int a = 0; a < 3; a++)
        sample->place[a] = (double)points->positions[n][a];
    memcpy(sample->kernel, kernel, sizeof kernel);
    sample->volume = (double)points->volumes[n];
    sample->sigma = deviation_along(kernel, sample->vector);
}

static int compare_depths(const void *a, const void *b) {
    const double x = ((const struct streak *)a)->depth, y = ((const struct streak *)b)->depth;
    return (x > y) - (x < y);
}

struct test_streaks *test_streaks_create(const struct sp_volume *volume, const struct sp_view *view,
                                         const struct sp_layer *layer, double extinction,
                                         const float color[3]) {
    const struct sp_grid *grid = &sp_volume_info(volume)->grid;
    const struct sp_elements *points = sp_volume_elements(volume);
    const uint64_t count =
        points ? points->shape.count : (uint64_t)grid->dims[0] * grid->dims[1] * grid->dims[2];
    const float(*vectors)[3] = sp_volume_vectors(volume);
    struct test_streaks *s = calloc(1, sizeof *s);
    struct streak *list = malloc(count * sizeof *list);
    if (!s || !list) {
        free(s);
        free(list);
        return NULL;
    }
    *s = (struct test_streaks){
        .view = view, .layer = layer, .scale = test_camera_scale(view), .list = list
    };
    test_camera_axes(&view->camera, s->w);
    for (int c = 0; c < 3; c++)
        s->color[c] = (double)color[c];
    for (uint64_t n = 0; n < count; n++) {
        struct sample sample = { .number = n, .vector = vectors[n] };
        if (points)
            read_point(points, n, &sample);
        else if (!read_sample(s, grid, n, &sample))
            continue;
        s->count += init_streak(s, &sample, extinction, &list[s->count]);
    }
    qsort(list, s->count, sizeof *list, compare_depths);
    return s;
}

void test_streaks_destroy(struct test_streaks **streaks) {
    if (*streaks)
        free((*streaks)->list);
    free(*streaks);
    *streaks = NULL;
}

unsigned test_streaks_count(const struct test_streaks *streaks) {
    return streaks->count;
}

static double bump(double x, double width) {
    const double y = 2 * x / width;
    return fabs(y) < 1 ? (1 - y * y) * (1 - y * y) : 0;
}

/* The texture over its mean. */
static double intensity_at(const struct streak *k, double along, double across) {
    const double row = rint(across + k->shift), golden = 0.61803399;
    const double u = along * k->periods - k->phase + row * golden;
    return bump(u - rint(u), 0.7) * bump(across + k->shift - row, 0.8) / (0.56 * 64 / 225);
}

unsigned test_streaks_hits(const struct test_streaks *s, double x, double y,
                           struct test_hit *hits) {
    const double r = s->view->filter.cutoff, mean = 0.56 * 64 / 225;
    unsigned found = 0;
    for (unsigned i = 0; i < s->count; i++) {
        const struct streak *k = &s->list[i];
        const double dx = x - k->x, dy = y - k->y;
        if (fabs(dx) > k->radius || fabs(dy) > k->radius)
            continue;
        const double along = k->map[0][0] * dx + k->map[0][1] * dy;
        const double across = k->map[1][0] * dx + k->map[1][1] * dy;
        const double square = along * along + across * across;
        if (square > r * r)
            continue;
        struct test_hit *hit = &hits[found++];
        const double texture = 1 + k->contrast * (intensity_at(k, along, across) - 1);
        const bool blends = s->layer->style == SP_VECTORS_BLEND;
        const double share = blends ? exp(-0.25 * square) * mean * texture : 0;
        hit->depth = k->depth;
        hit->alpha = -expm1(-k->peak * exp(-0.5 * square) * (blends ? 1 : texture));
        for (int c = 0; c < 3; c++)
            hit->color[c] = s->color[c] + share * ((double)s->layer->color[c] - s->color[c]);
    }
    return found;
}
