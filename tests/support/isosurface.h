/* SPDX-License-Identifier: Apache-2.0
 *
 * Iso-surfaces by brute force, in double precision: rays are intersected with f = v, where f is the
 * trilinear interpolant of the samples. renderer/draw/layers/surface splats the same surface: its
 * points lie on f = v. The normal is the interpolated gradient of the samples. Each intersection is
 * shaded, and the intersections with all surfaces of the view are composited front to back. It
 * shares no code with the renderer.
 *
 * The surface ends at the outermost samples, and where clipping removes it.
 */
#ifndef TESTS_SUPPORT_ISOSURFACE_H
#define TESTS_SUPPORT_ISOSURFACE_H

#include "support/image.h"
#include "support/scene.h"

struct test_isosurface {
    const struct test_scene *scene; /* borrowed */
    double *values;                 /* owned; axis 0 fastest */
    double *slopes;                 /* owned; three per sample, world space */
    double *places[3];              /* owned; of the samples along each axis, world units */
    double inverse[3][3];           /* world → distances along the axes */
};

/* An intersection of a ray with a surface. */
struct test_iso_hit {
    double distance; /* from the start of the ray, world units */
    double world[3];
    double normal[3]; /* the gradient, not of unit length */
};

/* False when out of memory. */
bool test_isosurface_init(struct test_isosurface *iso, const struct test_scene *scene);
void test_isosurface_finish(struct test_isosurface *iso);

/* Finds intersections with f = value at distances of at least `from`, nearest first. Returns their
 * number. `ahead` has unit length. */
int test_isosurface_hits(const struct test_isosurface *iso, const double eye[3],
                         const double ahead[3], double from, double value,
                         struct test_iso_hit *hits, int most);

/* Sets the ray of a place in the image [px] of the scene's view. */
void test_isosurface_ray(const struct test_isosurface *iso, double x, double y, double eye[3],
                         double ahead[3]);

/* Renders the surfaces of the view with rays·rays rays per pixel, over a transparent background,
 * and filters them with a Gaussian of standard deviation `blur` [px]; 0 = the mean of each pixel's
 * rays. False when out of memory. */
bool test_isosurface_render(const struct test_isosurface *iso, int rays, double blur,
                            struct test_image *image);

#endif
