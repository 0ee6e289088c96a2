/* SPDX-License-Identifier: Apache-2.0
 *
 * splat-march: the truth for real scans. Renders one camera of a scene by brute force: a
 * cubic B-spline through all samples and its analytic gradient, many rays per pixel, small steps.
 * Coefficients are stored as float32; everything else is double. It shares no drawing code with the
 * renderer.
 *
 *   samples ──► B-spline coefficients ──► per ray: value, gradient, transfer function, light
 *               (prefilter per axis)      ──► mean of the rays of each pixel ──► float32 RGB
 *
 * Regions of 4³ cells whose coefficients are all transparent are skipped: a B-spline is a convex
 * combination of its coefficients.
 */
#include <getopt.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/scene.h"
#include "data/volume/grid.h"
#include "support/image.h"
#include "support/interpolant.h"
#include "support/interpolated.h"
#include "support/sample.h"

enum { EXIT_USAGE = 2, REGION = 4, THREADS_MAX = 64 };

static const char usage[] =
    "usage: splat-march --out FILE [OPTION]... SCENE.json\n"
    "Renders one camera of a scene by brute force, for comparisons. Writes float32 RGB, row by\n"
    "row, over the background of the view.\n\n"
    "  --data DIR       folder that contains the volume\n"
    "  --camera K       camera of the scene, from 0 (default)\n"
    "  --size N         width and height in px; default from the scene\n"
    "  --rays N         N x N rays per pixel; default 4\n"
    "  --steps N        steps per smallest spacing; default 8\n"
    "  --threads N      default 2\n"
    "  --shading S      none, phong; default from the scene\n";

/* The field, and where it may be visible. */
struct field {
    const struct sp_grid *grid;
    uint32_t dims[3], regions[3];
    float *coefficients; /* dims, axis 0 fastest */
    bool *is_visible;    /* by region of REGION³ cells */
    double inverse[3][3];
};

/* Turns `count` values, `stride` apart, into coefficients of the cubic B-spline through them, with
 * mirrored ends (Unser 1999, boxes 2 and 3). */
static void prefilter(double *v, uint32_t count) {
    const double pole = sqrt(3) - 2;
    if (count < 2)
        return;
    const uint32_t period = 2 * count - 2;
    double first = 0, power = 1;
    for (uint32_t i = 0; fabs(power) > 1e-12; i = (i + 1) % period, power *= pole)
        first += v[i < count ? i : period - i] * power;
    v[0] = first;
    for (uint32_t i = 1; i < count; i++)
        v[i] += pole * v[i - 1];
    v[count - 1] = pole / (pole * pole - 1) * (v[count - 1] + pole * v[count - 2]);
    for (uint32_t i = count - 1; i-- > 0;)
        v[i] = pole * (v[i + 1] - v[i]);
    for (uint32_t i = 0; i < count; i++)
        v[i] *= 6;
}

static bool make_coefficients(struct field *f, const struct sp_volume_info *info,
                              const void *voxels) {
    const uint32_t *n = f->dims;
    size_t count = (size_t)n[0] * n[1] * n[2];
    uint32_t longest = n[0] > n[1] ? n[0] : n[1];
    longest = longest > n[2] ? longest : n[2];
    double *line = malloc(longest * sizeof *line);
    f->coefficients = malloc(count * sizeof *f->coefficients);
    if (!line || !f->coefficients) {
        free(line);
        return false;
    }
    for (size_t i = 0; i < count; i++)
        f->coefficients[i] = (float)test_sample(voxels, info->type, i);
    const size_t stride[3] = { 1, n[0], (size_t)n[0] * n[1] };
    for (int a = 0; a < 3; a++)
        for (size_t i = 0; i < count; i++) {
            if (i / stride[a] % n[a])
                continue;
            for (uint32_t k = 0; k < n[a]; k++)
                line[k] = (double)f->coefficients[i + k * stride[a]];
            prefilter(line, n[a]);
            for (uint32_t k = 0; k < n[a]; k++)
                f->coefficients[i + k * stride[a]] = (float)line[k];
        }
    free(line);
    return true;
}

static uint32_t clamp_index(int64_t i, uint32_t count) {
    return i < 0 ? 0 : i >= count ? count - 1 : (uint32_t)i;
}

/* Returns the index that the mirrored continuation has outside of [0, count). */
static uint32_t mirror_index(int64_t i, uint32_t count) {
    if (i < 0)
        i = -i;
    if (i >= count)
        i = 2 * (int64_t)count - 2 - i;
    return clamp_index(i, count);
}

/* True if the transfer function shows something of [low, high]. */
static bool shows(const struct sp_transfer_function *tf, double low, double high) {
    double color[3], opacity;
    test_classify(tf, low, 0, color, &opacity);
    if (opacity > 0)
        return true;
    test_classify(tf, high, 0, color, &opacity);
    if (opacity > 0)
        return true;
    for (uint32_t i = 0; i < tf->point_count; i++)
        if (tf->points[i].value >= low && tf->points[i].value <= high && tf->points[i].opacity > 0)
            return true;
    return false;
}

static bool find_visible(struct field *f, const struct sp_transfer_function *tf) {
    for (int a = 0; a < 3; a++)
        f->regions[a] = f->dims[a] / REGION + 1;
    f->is_visible = calloc((size_t)f->regions[0] * f->regions[1] * f->regions[2], 1);
    if (!f->is_visible)
        return false;
    bool *out = f->is_visible;
    for (uint32_t z = 0; z < f->regions[2]; z++)
        for (uint32_t y = 0; y < f->regions[1]; y++)
            for (uint32_t x = 0; x < f->regions[0]; x++) {
                const uint32_t at[3] = { x, y, z };
                uint32_t from[3], to[3];
                double low = INFINITY, high = -INFINITY;
                for (int a = 0; a < 3; a++) {
                    from[a] = clamp_index((int64_t)at[a] * REGION - 2, f->dims[a]);
                    to[a] = clamp_index((int64_t)at[a] * REGION + REGION + 2, f->dims[a]);
                }
                for (uint32_t k = from[2]; k <= to[2]; k++)
                    for (uint32_t j = from[1]; j <= to[1]; j++)
                        for (uint32_t i = from[0]; i <= to[0]; i++) {
                            double v =
                                (double)
                                    f->coefficients[((size_t)k * f->dims[1] + j) * f->dims[0] + i];
                            low = fmin(low, v);
                            high = fmax(high, v);
                        }
                *out++ = shows(tf, low, high);
            }
    return true;
}

static void weigh(double t, double w[4], double d[4]) {
    double s = 1 - t;
    w[0] = s * s * s / 6;
    w[1] = (4 - 6 * t * t + 3 * t * t * t) / 6;
    w[2] = (4 - 6 * s * s + 3 * s * s * s) / 6;
    w[3] = t * t * t / 6;
    d[0] = -0.5 * s * s;
    d[1] = 1.5 * t * t - 2 * t;
    d[2] = 2 * s - 1.5 * s * s;
    d[3] = 0.5 * t * t;
}

/* The value at a sample index, and the gradient per sample. */
static double evaluate(const struct field *f, const double index[3], double gradient[3]) {
    double w[3][4], d[3][4], value = 0;
    uint32_t at[3][4];
    for (int a = 0; a < 3; a++) {
        double base = floor(index[a]);
        weigh(index[a] - base, w[a], d[a]);
        for (int k = 0; k < 4; k++)
            at[a][k] = mirror_index((int64_t)base + k - 1, f->dims[a]);
    }
    memset(gradient, 0, 3 * sizeof *gradient);
    for (int k = 0; k < 4; k++)
        for (int j = 0; j < 4; j++) {
            const float *row =
                f->coefficients + ((size_t)at[2][k] * f->dims[1] + at[1][j]) * f->dims[0];
            double sum = 0, slope = 0;
            for (int i = 0; i < 4; i++) {
                sum += w[0][i] * (double)row[at[0][i]];
                slope += d[0][i] * (double)row[at[0][i]];
            }
            value += w[2][k] * w[1][j] * sum;
            gradient[0] += w[2][k] * w[1][j] * slope;
            gradient[1] += w[2][k] * d[1][j] * sum;
            gradient[2] += d[2][k] * w[1][j] * sum;
        }
    return value;
}

struct march {
    const struct field *field;
    const struct sp_view *view;
    double low, high; /* range of the samples: values are kept inside */
};

static bool find_index(const struct field *f, const double world[3], double index[3]) {
    for (int a = 0; a < 3; a++) {
        index[a] = 0;
        for (int r = 0; r < 3; r++)
            index[a] += f->inverse[a][r] * (world[r] - f->grid->origin[r]);
        if (index[a] < -0.5 || index[a] > f->dims[a] - 0.5)
            return false;
        index[a] = fmin(fmax(index[a], 0), f->dims[a] - 1.0);
    }
    return true;
}

static bool may_show(const struct field *f, const double index[3]) {
    size_t at = 0;
    for (int a = 2; a >= 0; a--)
        at = at * f->regions[a] + (uint32_t)index[a] / REGION;
    return f->is_visible[at];
}

static void follow(void *user, const double eye[3], const double ahead[3], double from, double to,
                   double step, double *rgba) {
    const struct march *m = user;
    const struct sp_view *view = m->view;
    double light = 1;
    memset(rgba, 0, 4 * sizeof *rgba);
    for (double l = from + step / 2; l < to && light > 1e-4; l += step) {
        double world[3], index[3], slope[3], gradient[3] = { 0 }, color[3], opacity;
        for (int r = 0; r < 3; r++)
            world[r] = eye[r] + l * ahead[r];
        if (!find_index(m->field, world, index) || !may_show(m->field, index))
            continue;
        double value = fmin(fmax(evaluate(m->field, index, slope), m->low), m->high);
        for (int r = 0; r < 3; r++)
            for (int a = 0; a < 3; a++)
                gradient[r] += m->field->inverse[a][r] * slope[a];
        double length =
            sqrt(gradient[0] * gradient[0] + gradient[1] * gradient[1] + gradient[2] * gradient[2]);
        test_classify(&view->transfer_function, value, length, color, &opacity);
        if (!(opacity > 0))
            continue;
        double alpha = 1 - pow(1 - opacity, step / view->transfer_function.reference_length);
        test_shade(view, ahead, gradient, color);
        for (int c = 0; c < 3; c++)
            rgba[c] += light * alpha * color[c];
        light *= 1 - alpha;
    }
    rgba[3] = 1 - light;
}

/* A band of rows of the image, for a thread. */
struct band {
    struct march march;
    struct sp_volume_info info;
    struct sp_view view; /* `rays` times as large */
    unsigned rays, steps, rows;
    unsigned *next; /* guarded by `lock`: the next row of pixels */
    pthread_mutex_t *lock;
    float *image;
    bool has_failed;
};

/* Draws one row of pixels: `rays` rows of the large view. */
static bool draw_row(struct band *b, unsigned row) {
    const unsigned width = b->view.size[0] / b->rays, n = b->rays;
    struct test_image image;
    struct test_scene scene = { .info = b->info, .view = b->view };
    if (!test_ray_rows(&scene, b->steps, row * n, (row + 1) * n, follow, &b->march, &image))
        return false;
    for (unsigned x = 0; x < width; x++)
        for (int c = 0; c < 3; c++) {
            double sum = 0;
            for (unsigned j = 0; j < n; j++)
                for (unsigned i = 0; i < n; i++) {
                    const double *p = test_image_at(&image, x * n + i, j);
                    sum += p[c] + (1 - p[3]) * (double)b->view.background[c]; /* associated */
                }
            b->image[((size_t)row * width + x) * 3 + (size_t)c] = (float)(sum / (n * n));
        }
    test_image_finish(&image);
    return true;
}

static void *draw_rows(void *pointer) {
    struct band *b = pointer;
    for (;;) {
        pthread_mutex_lock(b->lock);
        unsigned row = (*b->next)++;
        pthread_mutex_unlock(b->lock);
        if (row >= b->rows)
            return NULL;
        if (!draw_row(b, row)) {
            b->has_failed = true;
            return NULL;
        }
    }
}

struct options {
    const char *data, *out, *shading;
    unsigned camera, size, rays, steps, threads;
};

static bool render(const struct options *o, struct bench_scene *scene, struct sp_error *err) {
    const struct sp_volume_info *info = sp_volume_info(scene->volume);
    struct sp_view view = scene->view;
    struct field field = { .grid = &info->grid };
    double m[3][3];
    if (sp_grid_is_rectilinear(&info->grid))
        return sp_fail(err, SP_ERR_INVALID, "", "splat-march draws evenly spaced grids only");
    if (o->camera >= scene->camera_count)
        return sp_fail(err, SP_ERR_INVALID, "--camera", "the scene has no such camera");
    memcpy(field.dims, info->grid.dims, sizeof field.dims);
    for (int a = 0; a < 3; a++)
        for (int r = 0; r < 3; r++)
            m[r][a] = info->grid.direction[r][a] * info->grid.spacing[a];
    test_invert(m, field.inverse);
    view.camera = scene->cameras[o->camera];
    view.background[3] = 1;
    const unsigned width = view.size[0], height = view.size[1];
    view.size[0] *= o->rays;
    view.size[1] *= o->rays;
    float *image = calloc((size_t)width * height * 3, sizeof *image);
    pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
    pthread_t threads[THREADS_MAX];
    struct band bands[THREADS_MAX];
    unsigned next = 0;
    bool ok = image && make_coefficients(&field, info, sp_volume_voxels(scene->volume)) &&
              find_visible(&field, &view.transfer_function);
    if (!ok)
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
    for (unsigned t = 0; ok && t < o->threads; t++) {
        bands[t] = (struct band){ .march = { .field = &field,
                                             .view = &bands[t].view,
                                             .low = info->range[0],
                                             .high = info->range[1] },
                                  .info = *info,
                                  .view = view,
                                  .rays = o->rays,
                                  .steps = o->steps,
                                  .rows = height,
                                  .next = &next,
                                  .lock = &lock,
                                  .image = image };
        if (pthread_create(&threads[t], NULL, draw_rows, &bands[t]) != 0)
            abort();
    }
    for (unsigned t = 0; ok && t < o->threads; t++)
        pthread_join(threads[t], NULL);
    for (unsigned t = 0; ok && t < o->threads; t++)
        if (bands[t].has_failed)
            ok = sp_fail(err, SP_ERR_MEMORY, "", "out of memory for a row");
    FILE *file = ok ? fopen(o->out, "wb") : NULL;
    if (ok && (!file || fwrite(image, 3 * sizeof *image, (size_t)width * height, file) !=
                            (size_t)width * height))
        ok = sp_fail(err, SP_ERR_IO, o->out, "cannot be written");
    if (file && fclose(file) != 0)
        ok = sp_fail(err, SP_ERR_IO, o->out, "cannot be written");
    free(image);
    free(field.coefficients);
    free(field.is_visible);
    return ok;
}

static unsigned number(const char *text, unsigned most) {
    char *end;
    unsigned long n = strtoul(text, &end, 10);
    if (*end || n > most) {
        fprintf(stderr, "splat-march: '%s' is not a number up to %u\n", text, most);
        exit(EXIT_USAGE);
    }
    return (unsigned)n;
}

int main(int argc, char **argv) {
    static const struct option names[] = { { "data", required_argument, NULL, 'd' },
                                           { "camera", required_argument, NULL, 'k' },
                                           { "size", required_argument, NULL, 's' },
                                           { "rays", required_argument, NULL, 'r' },
                                           { "steps", required_argument, NULL, 'n' },
                                           { "threads", required_argument, NULL, 't' },
                                           { "shading", required_argument, NULL, 'l' },
                                           { "out", required_argument, NULL, 'o' },
                                           { 0 } };
    struct options o = { .data = ".", .rays = 4, .steps = 8, .threads = 2 };
    for (int c; (c = getopt_long(argc, argv, "", names, NULL)) != -1;)
        switch (c) {
        case 'd':
            o.data = optarg;
            break;
        case 'k':
            o.camera = number(optarg, BENCH_CAMERAS_MAX);
            break;
        case 's':
            o.size = number(optarg, 4096);
            break;
        case 'r':
            o.rays = number(optarg, 8);
            break;
        case 'n':
            o.steps = number(optarg, 64);
            break;
        case 't':
            o.threads = number(optarg, THREADS_MAX);
            break;
        case 'l':
            o.shading = optarg;
            break;
        case 'o':
            o.out = optarg;
            break;
        default:
            fputs(usage, stderr);
            return EXIT_USAGE;
        }
    if (optind + 1 != argc || !o.out || !o.rays || !o.steps || !o.threads) {
        fputs(usage, stderr);
        return EXIT_USAGE;
    }
    struct bench_scene scene;
    struct sp_error err = { 0 };
    const struct bench_overrides overrides = { .size = o.size, .shading = o.shading };
    bool ok = bench_scene_open(&scene, argv[optind], o.data, &overrides, &err);
    if (ok && scene.skipped[0])
        ok = sp_fail(&err, SP_ERR_IO, argv[optind], "%s", scene.skipped);
    ok = ok && render(&o, &scene, &err);
    if (!ok)
        fprintf(stderr, "splat-march: %s: %s\n", err.place, err.text);
    bench_scene_close(&scene);
    return ok ? EXIT_SUCCESS : EXIT_FAILURE;
}
