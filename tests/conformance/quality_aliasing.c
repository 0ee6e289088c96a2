/* SPDX-License-Identifier: Apache-2.0
 *
 * Aliasing on planes that recede to the horizon: how much energy of an image lies above the Nyquist
 * rate, and how much the image flickers when the camera moves slowly.
 *
 * The pattern on the plane is periodic, so moving the camera by a period along the plane gives the
 * same image. In between, the value of a pixel is a function p(s, t) of the two moves. It is
 * periodic in both, so its Fourier series separates the components of the pattern:
 *
 *   p(s, t) = Σ c_kl e^{2πi (k s + l t)}     component (k, l) of the pattern, after the filter
 *
 *   frequency of (k, l) in the image = k ∇s(x) + l ∇t(x)     [1/px], from the geometry alone
 *
 * An image cannot show a component of more than half a cycle per pixel, along either side of the
 * pixel: the component aliases to a lower frequency. The test counts its energy |c_kl|² as above
 * the Nyquist rate, and the energy of the others, the remaining contrast, as below. This is the
 * condition of Swan et al., section 4.2, eq. 2 (sampling frequency ≥ 2·highest frequency), for each
 * pixel. It needs no reference image and holds for any filter and for non-linear compositing. Moves
 * of less than a voxel also show the components of the voxels themselves.
 *
 * Flicker is the mean change between successive images along the moves, minus the true motion: the
 * mean change of the same images without the components above the Nyquist rate.
 *
 * Claims. On the checkerboards of Swan et al. (498×398×1, 270×157 px) and Chen et al. (512×512×3),
 * swan and ewa leave almost no energy above the Nyquist rate and do not flicker; reconstruction and
 * none leave energy there and flicker. On the square zebras of Zwicker et al., figure 8 (1024×512×3
 * and 1024×256×3: kernels of 2:1 and 4:1, 400×150 px), ewa keeps more contrast than swan and does
 * not alias more. The zebras have a low opacity: where opacity saturates, the near side of a filter
 * hides its far side. This sharpens the image equally for every filter and would hide the
 * difference.
 */
#include <complex.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "conformance/quality.h"

enum { MOVES_MAX = 8 };

struct plane {
    const char *name;
    uint32_t dims[3];
    double spacing[3];
    test_value_fn *value;
    unsigned ahead;    /* the axis that the camera looks along, 0 or 1; the other is sideways */
    double period[2];  /* of the pattern sideways and ahead, world units */
    unsigned moves[2]; /* images per period, at most MOVES_MAX */
    unsigned size[2];  /* px */
    double focal;      /* focal length, px */
    double height;     /* of the camera above the plane, world units */
    double opacity;    /* per world unit */
};

static double squares(const void *user, double x, double y, double z) {
    (void)user, (void)z;
    return (((int)x >> 1) + ((int)y >> 1)) & 1 ? 255 : 0;
}

/* Stripes across the line of sight that wave sideways, with a period of 32 world units in both
 * directions. They are sinusoidal, so that few of their components exceed the number of moves. */
static double zebra(const void *user, double x, double y, double z) {
    (void)z;
    double ahead = x / 32, sideways = y * *(const double *)user / 32;
    return 127.5 + 127.5 * sin(2 * M_PI * (ahead + 0.25 * sin(2 * M_PI * sideways)));
}

/* The point where the ray of an image point hits the plane, and its derivatives per px to the right
 * and downwards. Each is { sideways, ahead } in world units, from the point below the camera. */
struct hit {
    double at[2], right[2], down[2];
};

/* Returns the pitch of the camera [rad] that puts the horizon a sixteenth of the height below the
 * top of the image. */
static double pitch(const struct plane *p) {
    return atan(0.4375 * p->size[1] / p->focal);
}

static void hit_plane(const struct plane *p, double x, double y, double at[2]) {
    double a = pitch(p), sine = sin(a), cosine = cos(a);
    x -= 0.5 * p->size[0];
    y -= 0.5 * p->size[1];
    double along = p->height / (y * cosine + p->focal * sine);
    at[0] = along * x;
    at[1] = along * (p->focal * cosine - y * sine);
}

static struct hit hit_around(const struct plane *p, double x, double y) {
    const double h = 1e-4;
    struct hit hit;
    double a[2], b[2], c[2], d[2];
    hit_plane(p, x, y, hit.at);
    hit_plane(p, x - h, y, a);
    hit_plane(p, x + h, y, b);
    hit_plane(p, x, y - h, c);
    hit_plane(p, x, y + h, d);
    for (int i = 0; i < 2; i++) {
        hit.right[i] = (b[i] - a[i]) / (2 * h);
        hit.down[i] = (d[i] - c[i]) / (2 * h);
    }
    return hit;
}

/* Returns the distance ahead of the camera at which the plane begins, just below the lowest row. */
static double begin(const struct plane *p) {
    double at[2];
    hit_plane(p, 0.5 * p->size[0], p->size[1], at);
    return at[1] - 5 * p->spacing[p->ahead];
}

static void look(const struct plane *p, struct sp_camera *camera, double sideways, double ahead) {
    unsigned f = p->ahead, s = 1 - f;
    double near = -0.5 * p->spacing[f] * p->dims[f];
    camera->position[f] = near - begin(p) + ahead;
    camera->position[s] = f ? sideways : -sideways; /* to the right */
    camera->position[2] = p->height;
    for (int a = 0; a < 3; a++)
        camera->target[a] = camera->position[a];
    camera->target[f] += cos(pitch(p));
    camera->target[2] -= sin(pitch(p));
    camera->up[0] = camera->up[1] = 0;
    camera->up[2] = 1;
    camera->fov_y = 360 / M_PI * atan(0.5 * p->size[1] / p->focal);
}

static bool build(const struct plane *p, struct test_scene *scene) {
    test_view_init(&scene->view);
    test_scene_points(
        scene, (const double[][5]){ { 0, 0, 0, 0, p->opacity }, { 255, 1, 1, 1, p->opacity } }, 2);
    scene->view.size[0] = p->size[0];
    scene->view.size[1] = p->size[1];
    return test_scene_voxels(scene, p->name, p->dims, p->spacing, SP_UINT8, p->value,
                             &p->spacing[1]);
}

/* The images of all moves, one value per pixel. */
struct images {
    const struct plane *plane;
    float *value; /* [moves ahead][moves sideways][height][width] */
};

static float *image_at(const struct images *p, unsigned s, unsigned t) {
    const struct plane *plane = p->plane;
    return p->value + (size_t)(t * plane->moves[0] + s) * plane->size[0] * plane->size[1];
}

static struct images render_images(const struct quality *q, const struct plane *p,
                                   struct sp_volume *volume, struct sp_view *view) {
    size_t pixels = (size_t)p->size[0] * p->size[1];
    struct images all = { p, malloc(pixels * p->moves[0] * p->moves[1] * sizeof(float)) };
    if (!all.value)
        exit(EXIT_FAILURE);
    for (unsigned t = 0; t < p->moves[1]; t++)
        for (unsigned s = 0; s < p->moves[0]; s++) {
            look(p, &view->camera, p->period[0] * s / p->moves[0], p->period[1] * t / p->moves[1]);
            struct test_image image = quality_render(q, volume, view);
            for (size_t i = 0; i < pixels; i++)
                image_at(&all, s, t)[i] = (float)image.rgba[4 * i];
            test_image_finish(&image);
        }
    return all;
}

/* Discrete Fourier transform of n rows and m columns, in place, unscaled. sign: -1 forward, 1
 * inverse. */
static void transform(double complex *v, unsigned n, unsigned m, int sign) {
    for (unsigned axis = 0; axis < 2; axis++) {
        unsigned length = axis ? n : m, lines = axis ? m : n, step = axis ? m : 1;
        double complex root[MOVES_MAX], sum[MOVES_MAX];
        for (unsigned i = 0; i < length; i++)
            root[i] = cexp(sign * 2 * M_PI * I * i / length);
        for (unsigned line = 0; line < lines; line++) {
            double complex *at = v + (axis ? line : line * m);
            for (unsigned k = 0; k < length; k++) {
                sum[k] = 0;
                for (unsigned i = 0; i < length; i++)
                    sum[k] += at[i * step] * root[i * k % length];
            }
            for (unsigned k = 0; k < length; k++)
                at[k * step] = sum[k];
        }
    }
}

/* Returns the signed order of a component. The highest order of an even number is ambiguous; it is
 * positive here. */
static int order(unsigned k, unsigned n) {
    return 2 * k <= n ? (int)k : (int)k - (int)n;
}

static bool is_above(const struct plane *p, const struct hit *hit, unsigned k, unsigned l) {
    double s = order(k, p->moves[0]) / p->period[0], t = order(l, p->moves[1]) / p->period[1];
    return fabs(s * hit->right[0] + t * hit->right[1]) > 0.5 ||
           fabs(s * hit->down[0] + t * hit->down[1]) > 0.5;
}

struct spectrum {
    double above, below; /* mean energy per pixel, above and below the Nyquist rate */
    double flicker;      /* mean change between successive images, minus motion */
    double motion;       /* mean change by true motion */
    unsigned pixels;
};

static double change(const double complex *v, const struct plane *p) {
    unsigned n = p->moves[1], m = p->moves[0];
    double sum = 0;
    for (unsigned t = 0; t < n; t++)
        for (unsigned s = 0; s < m; s++)
            sum += fabs(creal(v[t * m + s] - v[t * m + (s + 1) % m])) +
                   fabs(creal(v[t * m + s] - v[(t + 1) % n * m + s]));
    return sum / (2 * n * m);
}

static void add_pixel(const struct images *all, unsigned x, unsigned y, const struct hit *hit,
                      struct spectrum *sum) {
    const struct plane *p = all->plane;
    unsigned n = p->moves[1], m = p->moves[0];
    double complex v[MOVES_MAX * MOVES_MAX] = { 0 };
    for (unsigned t = 0; t < n; t++)
        for (unsigned s = 0; s < m; s++)
            v[t * m + s] = (double)image_at(all, s, t)[(size_t)y * p->size[0] + x];
    double all_change = change(v, p);
    transform(v, n, m, -1);
    for (unsigned l = 0; l < n; l++)
        for (unsigned k = 0; k < m; k++) {
            double complex *c = &v[l * m + k];
            *c /= n * m;
            double energy = creal(*c * conj(*c));
            if (is_above(p, hit, k, l)) {
                sum->above += energy;
                *c = 0;
            } else if (k || l) {
                sum->below += energy;
            }
        }
    transform(v, n, m, 1);
    sum->motion += change(v, p);
    sum->flicker += all_change;
    sum->pixels++;
}

/* Measures over the pixels that see the inside of the plane during all moves. */
static struct spectrum measure_spectrum(const struct images *all) {
    const struct plane *p = all->plane;
    unsigned f = p->ahead, s = 1 - f;
    double side = 0.5 * p->spacing[s] * p->dims[s] - p->period[0] - 5 * p->spacing[s];
    double far = begin(p) + p->spacing[f] * p->dims[f] - p->period[1] - 5 * p->spacing[f];
    struct spectrum sum = { 0 };
    for (unsigned y = 0; y < p->size[1]; y++)
        for (unsigned x = 0; x < p->size[0]; x++) {
            struct hit hit = hit_around(p, x + 0.5, y + 0.5);
            if (hit.at[1] > 0 && hit.at[1] < far && fabs(hit.at[0]) < side)
                add_pixel(all, x, y, &hit, &sum);
        }
    sum.above /= sum.pixels;
    sum.below /= sum.pixels;
    sum.motion /= sum.pixels;
    sum.flicker = sum.flicker / sum.pixels - sum.motion;
    return sum;
}

static struct spectrum run(const struct quality *q, const struct plane *p, struct sp_volume *volume,
                           struct sp_view *view) {
    struct images all = render_images(q, p, volume, view);
    struct spectrum spectrum = measure_spectrum(&all);
    free(all.value);
    printf("  %-10s %-14s %4.2f  %9.2f  %9.1f  %9.1f  %9.1f\n", p->name,
           quality_filter_name(view->filter.mode), view->filter.lowpass, 1e6 * spectrum.above,
           1e6 * spectrum.below, 1e6 * spectrum.flicker, 1e6 * spectrum.motion);
    fflush(stdout);
    return spectrum;
}

/* Checks the claims about the checkerboards. */
static void check_squares(struct quality *q, const struct plane *p, const struct spectrum by[]) {
    const struct spectrum *none = &by[SP_FILTER_NONE], *kernel = &by[SP_FILTER_RECONSTRUCTION],
                          *swan = &by[SP_FILTER_SWAN], *ewa = &by[SP_FILTER_EWA];
    quality_expect(q, none->above > 20 * kernel->above,
                   "%s: energy above the Nyquist rate: none %g, reconstruction %g", p->name,
                   none->above, kernel->above);
    quality_expect(q, swan->above < kernel->above / 10,
                   "%s: energy above the Nyquist rate: swan %g, reconstruction %g", p->name,
                   swan->above, kernel->above);
    quality_expect(q, ewa->above < kernel->above / 50,
                   "%s: energy above the Nyquist rate: ewa %g, reconstruction %g", p->name,
                   ewa->above, kernel->above);
    quality_expect(q, swan->flicker < kernel->flicker / 5,
                   "%s: flicker: swan %g, reconstruction %g", p->name, swan->flicker,
                   kernel->flicker);
    quality_expect(q, ewa->flicker < kernel->flicker / 5, "%s: flicker: ewa %g, reconstruction %g",
                   p->name, ewa->flicker, kernel->flicker);
}

/* Checks the claims about the zebras. */
static void check_zebra(struct quality *q, const struct plane *p, const struct spectrum by[]) {
    const struct spectrum *swan = &by[SP_FILTER_SWAN], *ewa = &by[SP_FILTER_EWA];
    double gain = p->spacing[1] > 3 ? 1.5 : 1.1;
    quality_expect(q, ewa->above <= swan->above * 1.02,
                   "%s: energy above the Nyquist rate: ewa %g, swan %g", p->name, ewa->above,
                   swan->above);
    quality_expect(q, ewa->below > swan->below * gain,
                   "%s: energy below the Nyquist rate: ewa %g, swan %g", p->name, ewa->below,
                   swan->below);
}

/* Checks that narrower low-pass filters keep more energy above and below the Nyquist rate.
 * by[SP_FILTER_EWA] is the spectrum with a low-pass filter of 1 px. */
static void check_lowpass(struct quality *q, const struct plane *p, struct sp_volume *volume,
                          struct sp_view *view, const struct spectrum by[]) {
    static const double radii[] = { 0.7, 0.55, 0.4 };
    struct spectrum last = by[SP_FILTER_EWA];
    for (size_t i = 0; i < sizeof radii / sizeof *radii; i++) {
        view->filter.lowpass = radii[i];
        struct spectrum now = run(q, p, volume, view);
        quality_expect(q, now.above > last.above && now.below > last.below,
                       "%s: a low-pass filter of %g px keeps %g above and %g below the Nyquist "
                       "rate, the next wider one %g and %g",
                       p->name, radii[i], now.above, now.below, last.above, last.below);
        last = now;
    }
    view->filter.lowpass = 1;
}

static const struct plane planes[] = {
    { "swan", .dims = { 498, 398, 1 }, .spacing = { 1, 1, 1 }, .value = squares, .ahead = 1,
      .period = { 4, 4 }, .moves = { 5, 5 }, .size = { 270, 157 }, .focal = 135, .height = 40,
      .opacity = 0.9 },
    { "chen", .dims = { 512, 512, 3 }, .spacing = { 1, 1, 1 }, .value = squares, .ahead = 1,
      .period = { 4, 4 }, .moves = { 3, 3 }, .size = { 256, 160 }, .focal = 128, .height = 40,
      .opacity = 0.9 },
    { "zebra 2:1", .dims = { 1024, 512, 3 }, .spacing = { 1, 2, 1 }, .value = zebra, .ahead = 0,
      .period = { 32, 32 }, .moves = { 7, 3 }, .size = { 400, 150 }, .focal = 200, .height = 150,
      .opacity = 0.03 },
    { "zebra 4:1", .dims = { 1024, 256, 3 }, .spacing = { 1, 4, 1 }, .value = zebra, .ahead = 0,
      .period = { 32, 32 }, .moves = { 7, 3 }, .size = { 400, 150 }, .focal = 200, .height = 150,
      .opacity = 0.03 },
};

static void measure(struct quality *q) {
    static const enum sp_filter_mode modes[] = { SP_FILTER_NONE, SP_FILTER_RECONSTRUCTION,
                                                 SP_FILTER_SWAN, SP_FILTER_EWA };
    printf("  energy per pixel above and below the Nyquist rate, 1e-6; mean change, 1e-6\n"
           "  plane      filter         h, px      above      below    flicker     motion\n");
    for (size_t i = 0; i < sizeof planes / sizeof *planes; i++) {
        const struct plane *p = &planes[i];
        struct spectrum by[SP_FILTER_NONE + 1] = { { 0 } };
        struct test_scene scene;
        if (!build(p, &scene))
            exit(EXIT_FAILURE);
        struct sp_volume *volume = quality_volume(&scene);
        for (int m = p->value == zebra ? 2 : 0; m < 4; m++) {
            scene.view.filter.mode = modes[m];
            by[modes[m]] = run(q, p, volume, &scene.view);
        }
        if (i == 0)
            check_lowpass(q, p, volume, &scene.view, by);
        if (p->value == zebra)
            check_zebra(q, p, by);
        else
            check_squares(q, p, by);
        quality_evict(q, &volume);
        test_scene_finish(&scene);
    }
}

int main(void) {
    return quality_main(measure);
}
