/* SPDX-License-Identifier: Apache-2.0
 *
 * Meshes of tests, and their image by brute force in double precision: every ray is intersected
 * with every triangle, each intersection is shaded, and the intersections of a ray are composited
 * front to back. It shares no code with the renderer.
 */
#ifndef TESTS_SUPPORT_MESH_H
#define TESTS_SUPPORT_MESH_H

#include "sp/elements.h"
#include "sp/view.h"
#include "support/hit.h"
#include "support/image.h"

/* Allocates the arrays of a mesh: normals are 0, vertices white and opaque. False when out of
 * memory. */
bool test_mesh_init(struct sp_elements *mesh, uint32_t vertices, uint32_t triangles);
void test_mesh_finish(struct sp_elements *mesh);

/* A ball about the world's origin of rings·2·rings quadrilaterals, with normals. */
bool test_mesh_ball(struct sp_elements *mesh, uint32_t rings, double radius);
/* A torus about the world's z axis: radii of its circle and of its tube, both of n quadrilaterals.
 * With normals, and colours that change along both. */
bool test_mesh_torus(struct sp_elements *mesh, uint32_t n, double circle, double tube);
/* A cube about the world's origin, each face with corners of its own, without normals. */
bool test_mesh_cube(struct sp_elements *mesh, double side);

/* Renders one layer of geometry with rays·rays rays per pixel, over a transparent background.
 * The clip box has fractions of the volume with the grid `grid`. Parts that are clipped or nearer
 * than the near plane are left out. False when out of memory. */
bool test_mesh_render(const struct sp_elements *mesh, const struct sp_layer *layer,
                      const struct sp_view *view, const struct sp_grid *grid, int rays,
                      struct test_image *image);

/* The same mesh before its parts are composited. The arguments must stay valid. NULL when out of
 * memory. */
struct test_mesh_rays *test_mesh_rays_create(const struct sp_elements *mesh,
                                             const struct sp_layer *layer,
                                             const struct sp_view *view,
                                             const struct sp_grid *grid);
void test_mesh_rays_destroy(struct test_mesh_rays **rays);

/* Chooses the pixel of the next rays. */
void test_mesh_rays_pixel(struct test_mesh_rays *rays, unsigned x, unsigned y);

/* Fills hits[TEST_HITS_MAX] with the intersections of a ray through the chosen pixel, front to
 * back; returns their number. */
int test_mesh_rays_hits(const struct test_mesh_rays *rays, double x, double y,
                        struct test_hit *hits);

#endif
