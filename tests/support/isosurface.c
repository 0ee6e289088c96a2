/* SPDX-License-Identifier: Apache-2.0 */
#include "support/isosurface.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "support/sample.h"

static void invert(const double m[3][3], double out[3][3]) {
    double det = 0;
    for (int c = 0; c < 3; c++)
        det += m[0][c] *
               (m[1][(c + 1) % 3] * m[2][(c + 2) % 3] - m[1][(c + 2) % 3] * m[2][(c + 1) % 3]);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            out[c][r] = (m[(r + 1) % 3][(c + 1) % 3] * m[(r + 2) % 3][(c + 2) % 3] -
                         m[(r + 1) % 3][(c + 2) % 3] * m[(r + 2) % 3][(c + 1) % 3]) /
                        det;
}

static size_t index_of(const struct test_isosurface *iso, const int i[3]) {
    const uint32_t *dims = iso->scene->info.grid.dims;
    return ((size_t)i[2] * dims[1] + (size_t)i[1]) * dims[0] + (size_t)i[0];
}

/* Along one axis: of the parabola through three samples, one-sided at a border. */
static double slope_at(const struct test_isosurface *iso, const int i[3], int a) {
    const int last = (int)iso->scene->info.grid.dims[a] - 1;
    double slope[2], gap[2], here = iso->values[index_of(iso, i)];
    bool has[2];
    for (int side = 0; side < 2; side++) {
        int at[3] = { i[0], i[1], i[2] };
        at[a] += side ? 1 : -1;
        has[side] = at[a] >= 0 && at[a] <= last && isfinite(iso->values[index_of(iso, at)]);
        if (!has[side])
            continue;
        gap[side] = fabs(iso->places[a][at[a]] - iso->places[a][i[a]]);
        slope[side] = (side ? 1 : -1) * (iso->values[index_of(iso, at)] - here) / gap[side];
    }
    if (has[0] && has[1])
        return (slope[0] * gap[1] + slope[1] * gap[0]) / (gap[0] + gap[1]);
    return has[0] ? slope[0] : has[1] ? slope[1] : 0;
}

bool test_isosurface_init(struct test_isosurface *iso, const struct test_scene *scene) {
    const struct sp_grid *grid = &scene->info.grid;
    const size_t count = (size_t)grid->dims[0] * grid->dims[1] * grid->dims[2];
    *iso = (struct test_isosurface){ .scene = scene };
    invert(grid->direction, iso->inverse);
    iso->values = malloc(count * sizeof *iso->values);
    iso->slopes = malloc(count * 3 * sizeof *iso->slopes);
    bool fits = iso->values && iso->slopes;
    for (int a = 0; a < 3 && fits; a++) {
        iso->places[a] = malloc(grid->dims[a] * sizeof *iso->places[a]);
        fits = iso->places[a];
        for (uint32_t i = 0; fits && i < grid->dims[a]; i++)
            iso->places[a][i] =
                grid->coordinates[a] ? grid->coordinates[a][i] : grid->spacing[a] * i;
    }
    for (size_t i = 0; fits && i < count; i++)
        iso->values[i] = test_sample(scene->voxels, scene->info.type, i);
    for (size_t k = 0; fits && k < count; k++) {
        const int i[3] = { (int)(k % grid->dims[0]), (int)(k / grid->dims[0] % grid->dims[1]),
                           (int)(k / grid->dims[0] / grid->dims[1]) };
        double along[3];
        for (int a = 0; a < 3; a++)
            along[a] = slope_at(iso, i, a);
        for (int r = 0; r < 3; r++)
            iso->slopes[3 * k + (size_t)r] = iso->inverse[0][r] * along[0] +
                                             iso->inverse[1][r] * along[1] +
                                             iso->inverse[2][r] * along[2];
    }
    if (!fits)
        test_isosurface_finish(iso);
    return fits;
}

void test_isosurface_finish(struct test_isosurface *iso) {
    free(iso->values);
    free(iso->slopes);
    for (int a = 0; a < 3; a++)
        free(iso->places[a]);
    *iso = (struct test_isosurface){ 0 };
}

/* A place among eight samples. */
struct place {
    size_t corner[8];
    double weight[8];
};

/* False outside of the samples. */
static bool compute_place(const struct test_isosurface *iso, const double world[3],
                          struct place *place) {
    const struct sp_grid *grid = &iso->scene->info.grid;
    int low[3];
    double share[3];
    for (int a = 0; a < 3; a++) {
        const double *p = iso->places[a];
        int last = (int)grid->dims[a] - 1, i;
        double at = 0;
        for (int r = 0; r < 3; r++)
            at += iso->inverse[a][r] * (world[r] - grid->origin[r]);
        if (last < 1 || !(at >= 0 && at <= p[last]))
            return false;
        i = (int)fmin(at / p[last] * last, last - 1);
        while (i > 0 && p[i] > at)
            i--;
        while (i < last - 1 && p[i + 1] <= at)
            i++;
        low[a] = i;
        share[a] = (at - p[i]) / (p[i + 1] - p[i]);
    }
    for (int c = 0; c < 8; c++) {
        const int i[3] = { low[0] + (c & 1), low[1] + (c >> 1 & 1), low[2] + (c >> 2) };
        place->corner[c] = index_of(iso, i);
        place->weight[c] = 1;
        for (int a = 0; a < 3; a++)
            place->weight[c] *= c >> a & 1 ? share[a] : 1 - share[a];
    }
    return true;
}

/* NaN outside of the samples. */
static double value_at(const struct test_isosurface *iso, const double world[3]) {
    struct place place;
    double sum = 0;
    if (!compute_place(iso, world, &place))
        return NAN;
    for (int c = 0; c < 8; c++)
        sum += place.weight[c] * iso->values[place.corner[c]];
    return sum;
}

static bool is_clipped(const struct test_isosurface *iso, const double world[3]) {
    const struct sp_clip *clip = &iso->scene->view.clip;
    const struct sp_grid *grid = &iso->scene->info.grid;
    for (uint32_t i = 0; i < clip->plane_count; i++) {
        double dot = 0;
        for (int r = 0; r < 3; r++)
            dot += clip->planes[i].normal[r] * world[r];
        if (dot < clip->planes[i].offset)
            return true;
    }
    for (int a = 0; a < 3; a++) {
        const double *p = iso->places[a];
        const uint32_t last = grid->dims[a] - 1;
        double at = 0, low = -0.5 * (p[1] - p[0]), high = p[last] + 0.5 * (p[last] - p[last - 1]);
        for (int r = 0; r < 3; r++)
            at += iso->inverse[a][r] * (world[r] - grid->origin[r]);
        double share = (at - low) / (high - low);
        if (share < clip->box[0][a] || share > clip->box[1][a])
            return true;
    }
    return false;
}

static void along(const double eye[3], const double ahead[3], double distance, double world[3]) {
    for (int r = 0; r < 3; r++)
        world[r] = eye[r] + distance * ahead[r];
}

/* The distances between which a ray is inside of the samples, by slabs. */
static bool compute_span(const struct test_isosurface *iso, const double eye[3],
                         const double ahead[3], double span[2]) {
    const struct sp_grid *grid = &iso->scene->info.grid;
    span[0] = -INFINITY;
    span[1] = INFINITY;
    for (int a = 0; a < 3; a++) {
        double at = 0, step = 0, end = iso->places[a][grid->dims[a] - 1];
        for (int r = 0; r < 3; r++) {
            at += iso->inverse[a][r] * (eye[r] - grid->origin[r]);
            step += iso->inverse[a][r] * ahead[r];
        }
        double t0 = -at / step, t1 = (end - at) / step;
        if (fabs(step) < 1e-12) {
            if (at < 0 || at > end)
                return false;
            continue;
        }
        span[0] = fmax(span[0], fmin(t0, t1));
        span[1] = fmin(span[1], fmax(t0, t1));
    }
    return span[0] < span[1];
}

static double smallest_gap(const struct test_isosurface *iso) {
    double least = INFINITY;
    for (int a = 0; a < 3; a++)
        for (uint32_t i = 1; i < iso->scene->info.grid.dims[a]; i++)
            least = fmin(least, iso->places[a][i] - iso->places[a][i - 1]);
    return least;
}

static void set_hit(const struct test_isosurface *iso, const double eye[3], const double ahead[3],
                    double distance, struct test_iso_hit *hit) {
    struct place place;
    hit->distance = distance;
    memset(hit->normal, 0, sizeof hit->normal);
    along(eye, ahead, distance, hit->world);
    if (compute_place(iso, hit->world, &place))
        for (int c = 0; c < 8; c++)
            for (int r = 0; r < 3; r++)
                hit->normal[r] += place.weight[c] * iso->slopes[3 * place.corner[c] + (size_t)r];
}

int test_isosurface_hits(const struct test_isosurface *iso, const double eye[3],
                         const double ahead[3], double from, double value,
                         struct test_iso_hit *hits, int most) {
    const double step = 0.4 * smallest_gap(iso);
    double span[2], last = NAN, world[3];
    int count = 0;
    if (!compute_span(iso, eye, ahead, span))
        return 0;
    double start = fmax(span[0], from) + 1e-9, end = span[1];
    for (double t = start; t < end && count < most; t += step) {
        along(eye, ahead, t, world);
        double f = value_at(iso, world) - value;
        if ((f >= 0 && last < 0) || (f < 0 && last >= 0)) {
            double low = t - step, high = t;
            for (int i = 0; i < 30; i++) {
                double middle = 0.5 * (low + high);
                along(eye, ahead, middle, world);
                bool is_inside = value_at(iso, world) - value >= 0;
                *(is_inside == (f >= 0) ? &high : &low) = middle;
            }
            along(eye, ahead, high, world);
            if (!is_clipped(iso, world))
                set_hit(iso, eye, ahead, high, &hits[count++]);
        }
        last = f;
    }
    return count;
}

void test_isosurface_ray(const struct test_isosurface *iso, double x, double y, double eye[3],
                         double ahead[3]) {
    const struct sp_view *view = &iso->scene->view;
    double w[3][3], scale = test_camera_scale(view), length = 0;
    double a = (x - 0.5 * view->size[0]) / scale, b = (y - 0.5 * view->size[1]) / scale;
    bool is_perspective = view->camera.projection == SP_PERSPECTIVE;
    test_camera_axes(&view->camera, w);
    for (int r = 0; r < 3; r++) {
        eye[r] = view->camera.position[r] + (is_perspective ? 0 : a * w[0][r] + b * w[1][r]);
        ahead[r] = w[2][r] + (is_perspective ? a * w[0][r] + b * w[1][r] : 0);
        length += ahead[r] * ahead[r];
    }
    for (int r = 0; r < 3; r++)
        ahead[r] /= sqrt(length);
}

enum { HITS = 24 };
struct colored {
    double distance, color[3], opacity;
};

static int by_distance(const void *a, const void *b) {
    double x = ((const struct colored *)a)->distance, y = ((const struct colored *)b)->distance;
    return (x > y) - (x < y);
}

/* The colour of one ray, premultiplied. */
static void trace(const struct test_isosurface *iso, double x, double y, double rgba[4]) {
    const struct sp_view *view = &iso->scene->view;
    struct test_iso_hit hits[HITS];
    struct colored all[HITS * SP_LAYERS_MAX];
    double eye[3], ahead[3], w[3][3], cosine = 0;
    int count = 0;
    test_isosurface_ray(iso, x, y, eye, ahead);
    test_camera_axes(&view->camera, w);
    for (int r = 0; r < 3; r++)
        cosine += w[2][r] * ahead[r];
    for (uint32_t l = 0; l < view->layer_count; l++) {
        const struct sp_layer *layer = &view->layers[l];
        if (layer->type != SP_LAYER_SURFACE)
            continue;
        /* Nothing behind an opaque surface is seen. */
        int n = test_isosurface_hits(iso, eye, ahead, view->camera.near / cosine, layer->value,
                                     hits, layer->opacity < 1 ? HITS : 1);
        for (int i = 0; i < n; i++) {
            struct colored *c = &all[count++];
            c->distance = hits[i].distance;
            c->opacity = (double)layer->opacity;
            for (int k = 0; k < 3; k++)
                c->color[k] = (double)layer->color[k];
            test_shade(view, ahead, hits[i].normal, c->color);
        }
    }
    qsort(all, (size_t)count, sizeof *all, by_distance);
    for (int i = 0; i < count; i++) {
        double through = 1 - rgba[3];
        for (int k = 0; k < 3; k++)
            rgba[k] += through * all[i].opacity * all[i].color[k];
        rgba[3] += through * all[i].opacity;
    }
}

/* The sum of `from` along an axis around sample `at`, with the weights of a Gaussian or of a box.
 */
static void gather(const struct test_image *from, const double at[2], int axis, double deviation,
                   int box, double rgba[4]) {
    const int reach = deviation > 0 ? (int)ceil(4 * deviation) : box / 2 + 1;
    const int size = (int)(axis ? from->height : from->width);
    double total = 0;
    memset(rgba, 0, 4 * sizeof *rgba);
    for (int k = (int)floor(at[axis]) - reach; k <= (int)floor(at[axis]) + reach; k++) {
        double d = k + 0.5 - at[axis];
        double weight = deviation > 0 ? exp(-0.5 * d * d / (deviation * deviation))
                                      : (fabs(d) < 0.5 * box ? 1 : 0);
        int inside = k < 0 ? 0 : k < size ? k : size - 1;
        const double *p = test_image_at(from, axis ? (unsigned)at[0] : (unsigned)inside,
                                        axis ? (unsigned)inside : (unsigned)at[1]);
        for (int c = 0; c < 4; c++)
            rgba[c] += weight * p[c];
        total += weight;
    }
    for (int c = 0; c < 4; c++)
        rgba[c] /= total;
}

/* Filters along one axis while it makes that axis `rays` times shorter. */
static bool reduce(const struct test_image *from, int axis, int rays, double blur,
                   struct test_image *to) {
    unsigned width = axis ? from->width : from->width / (unsigned)rays;
    unsigned height = axis ? from->height / (unsigned)rays : from->height;
    if (!test_image_init(to, width, height))
        return false;
    for (unsigned y = 0; y < height; y++)
        for (unsigned x = 0; x < width; x++) {
            double at[2] = { x, y };
            at[axis] = (at[axis] + 0.5) * rays;
            gather(from, at, axis, blur * rays, rays, test_image_at(to, x, y));
        }
    return true;
}

bool test_isosurface_render(const struct test_isosurface *iso, int rays, double blur,
                            struct test_image *image) {
    const uint32_t *size = iso->scene->view.size;
    struct test_image fine = { 0 }, half = { 0 };
    bool fits = test_image_init(&fine, size[0] * (unsigned)rays, size[1] * (unsigned)rays);
    for (unsigned y = 0; fits && y < fine.height; y++)
        for (unsigned x = 0; x < fine.width; x++)
            trace(iso, (x + 0.5) / rays, (y + 0.5) / rays, test_image_at(&fine, x, y));
    fits = fits && reduce(&fine, 0, rays, blur, &half) && reduce(&half, 1, rays, blur, image);
    test_image_finish(&fine);
    test_image_finish(&half);
    return fits;
}
