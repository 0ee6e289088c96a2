/* SPDX-License-Identifier: Apache-2.0
 *
 * Small scenes: voxels from a formula, and a view. They are small enough for the integrator to
 * finish in about a second. Together they use every sample type.
 */
#ifndef TESTS_SUPPORT_SCENE_H
#define TESTS_SUPPORT_SCENE_H

#include <stdbool.h>

#include "sp/view.h"
#include "sp/volume.h"

struct test_scene {
    struct sp_volume_info info; /* grid, type and name; range and histogram are not filled */
    void *voxels;               /* owned */
    double *coordinates[3];     /* owned; of rectilinear axes, info.grid points to them */
    struct sp_view view;
};

/* A view with every field at its documented default, except: 64×64 px, transparent background,
 * filter.mode ewa, shading none, camera at (0,0,-100) looking along +z with -y up, a transfer
 * function of two white points (0 → opacity 0, 1 → opacity 0.1). */
void test_view_init(struct sp_view *view);

/* Returns the value at the index coordinates (x,y,z), in the unit of the data. */
typedef double test_value_fn(const void *user, double x, double y, double z);

/* Fills scene->info and scene->voxels on a grid with identity direction, centred on the world's
 * origin. Values are rounded and clamped to the range of the type. False when out of memory. Does
 * not set the view: call test_view_init(). */
bool test_scene_voxels(struct test_scene *scene, const char *name, const uint32_t dims[3],
                       const double spacing[3], enum sp_type type, test_value_fn *value,
                       const void *user);

/* The same on a rectilinear grid: coordinates[a] as in sp_grid (copied), NULL = uniform with a
 * spacing of 1. `value` gets the distances along the axes from the grid's middle, world units. */
bool test_scene_rectilinear(struct test_scene *scene, const char *name, const uint32_t dims[3],
                            const double *const coordinates[3], enum sp_type type,
                            test_value_fn *value, const void *user);
void test_scene_finish(struct test_scene *scene);

/* Sets the grid's direction to rotation·diag(1, 1, mirror) (angles in degrees about the world's x,
 * y, z axes, applied in that order; mirror is 1 or -1), the third axis sheared by `shear` times the
 * first, and moves the origin so that the middle of the volume stays at the world's origin. */
void test_scene_direction(struct test_scene *scene, const double degrees[3], double mirror,
                          double shear);

/* Places the camera at `distance` from `target` (NULL = the world's origin), in the direction given
 * by azimuth (about the world's y axis) and elevation, in degrees. The world's y axis points up. */
void test_scene_orbit(struct test_scene *scene, const double *target, double azimuth,
                      double elevation, double distance);

/* Sets the points of the transfer function; each row is value, r, g, b, opacity. */
void test_scene_points(struct test_scene *scene, const double (*points)[5], unsigned count);

/* Appends a clip plane through a point. The normal need not have length 1. */
void test_scene_cut(struct test_scene *scene, const double normal[3], const double point[3]);

/* Creates a volume of the renderer from the scene. Returns one reference, or NULL with *err set. */
struct sp_volume *test_scene_volume(const struct test_scene *scene, struct sp_error *err);

/* The scenes. Each returns false when out of memory. */
typedef bool test_scene_fn(struct test_scene *scene);
bool test_scene_constant_cube(struct test_scene *scene); /* 24³, one value, seen over an edge */
bool test_scene_thin_shells(struct test_scene *scene);   /* concentric shells of three colours */
bool test_scene_anisotropic(struct test_scene *scene);   /* 1×1×4, thin layers */
bool test_scene_checkerboard(struct test_scene *scene);  /* minified: a voxel is half a pixel */
bool test_scene_phantom(struct test_scene *scene);       /* magnified: a voxel is five pixels */
bool test_scene_oblique(struct test_scene *scene);       /* wide angle, grazing, close */
bool test_scene_blobs(struct test_scene *scene);         /* smooth, 40³ */
bool test_scene_orthographic(struct test_scene *scene);  /* blobs, parallel rays */
bool test_scene_rotated(struct test_scene *scene);       /* blobs, rotated direction, 1×1.5×2 */
bool test_scene_left_handed(struct test_scene *scene);   /* the same, mirrored */
bool test_scene_sheared(struct test_scene *scene);       /* a direction matrix not orthogonal */
bool test_scene_inside(struct test_scene *scene);        /* the eye in the middle of a shell */
bool test_scene_wide_kernel(struct test_scene *scene);   /* σ 1, cutoff 4, coloured background */
bool test_scene_lit_shell(struct test_scene *scene);     /* Phong, two lights */
bool test_scene_layers(struct test_scene *scene);        /* 1×1×3, thin layers, oblique */
bool test_scene_near_shell(struct test_scene *scene);    /* from one radius above it, 50° */
bool test_scene_rectilinear_blobs(struct test_scene *scene); /* two graded axes, turned */
bool test_scene_clip_plane(struct test_scene *scene);        /* blobs, cut obliquely */
bool test_scene_clip_box(struct test_scene *scene);          /* blobs, four faces cut */
bool test_scene_clip_edge(struct test_scene *scene);         /* blobs, a plane through the eye */
bool test_scene_clip_corner(struct test_scene *scene);       /* blobs, a corner of three planes */
bool test_scene_gradient_axis(struct test_scene *scene);     /* walls alone, by their gradient */
bool test_scene_post_peak(struct test_scene *scene);         /* order post, a narrow peak; slab */
bool test_scene_post_lit(struct test_scene *scene);          /* the same with Phong and gradients */
bool test_scene_cubic(struct test_scene *scene);             /* thin shells, kernel cubic */

#endif
