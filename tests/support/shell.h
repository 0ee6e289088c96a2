/* SPDX-License-Identifier: Apache-2.0
 *
 * A shell, or a layer of vectors, in tests: drawn with the kernels of any instruction set, and by
 * brute force from the definition (renderer/draw/layers/splat_list/list.h) and from rays that are
 * marched through the cells of voxels.
 */
#ifndef TESTS_SUPPORT_SHELL_H
#define TESTS_SUPPORT_SHELL_H

#include "draw/layers/shell/cache.h"
#include "draw/layers/splat_list/draw.h"
#include "draw/layers/vectors/cache.h"
#include "support/image.h"
#include "support/scene.h"

struct test_shell {
    struct test_scene scene;
    struct sp_volume *volume;
    struct sp_pool *pool;
    struct sp_arena arena;
    struct sp_shell_cache cache;
    struct sp_vectors_cache vectors;
    struct sp_voxel_kernels kernels;
    struct sp_camera_transform camera;
    struct sp_shade shade;
    struct sp_layer layer;
    struct sp_voxel_input input; /* of the last call of test_shell_start() */
};

/* Takes the scene, whose voxels and view are filled. Uses the kernels of the scalar reference. */
void test_shell_open(struct test_shell *rig, struct test_scene *scene, unsigned threads);
void test_shell_close(struct test_shell *rig);

/* Gives the volume a vector per sample. */
void test_shell_add_vectors(struct test_shell *rig,
                            void (*vector_at)(const void *user, const double at[3], float v[3]),
                            const void *user);

/* Fills rig->input from the scene's view and the layer. frame may be NULL. */
const struct sp_voxel_input *test_shell_start(struct test_shell *rig, struct sp_frame *frame);

/* Returns the job that a frame of this shell gives to the cache. */
struct sp_shell_job test_shell_job(const struct test_shell *rig);

/* Draws the shell. False with *err set on failure. */
bool test_shell_draw(struct test_shell *rig, struct test_image *image, struct sp_error *err);

/* Draws the fragments of the shell and composites them in order of depth. */
bool test_shell_draw_fragments(struct test_shell *rig, struct test_image *image,
                               struct sp_error *err);

/* Returns for each voxel of the volume its code by the definition in list.h, or −1 if the voxel is
 * not in the shell. malloc'ed. */
int *test_shell_codes(const struct test_shell *rig);

/* A ray through the middle of pixel (x, y), in distances along the axes of the grid from sample 0:
 * origin + t·direction, where t is the depth behind the eye's plane. */
struct test_ray {
    double origin[3], direction[3];
};
struct test_ray test_shell_ray(const struct test_shell *rig, double x, double y);

/* Where the ray is in the cell of voxel i: [t[0], t[1]]. False if it misses. */
bool test_shell_hit(const struct test_shell *rig, const struct test_ray *ray, const uint32_t i[3],
                    double t[2]);

/* Returns for each pixel the index of the opaque voxel of the shell whose cell the pixel's ray
 * meets first, or −1. codes: test_shell_codes(). malloc'ed, [height][width]. */
int64_t *test_shell_march(const struct test_shell *rig, const int *codes);

#endif
