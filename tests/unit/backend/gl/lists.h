/* SPDX-License-Identifier: Apache-2.0
 *
 * Compares lists of visible voxels that the GPU makes with lists that the CPU makes. Also builds
 * volumes and transfer functions. Every failure fails the test.
 */
#ifndef TEST_GL_LISTS_H
#define TEST_GL_LISTS_H

#include "backend/gl/mip_levels.h"

enum { TYPES = SP_FLOAT64 }; /* sample types that the GPU classifies */

struct rig {
    struct gl_residency residency;
    struct sp_classify_cache cache;
    struct sp_pool *pool;
    unsigned warnings;
};

/* A volume and its properties. */
struct shape {
    enum sp_type type;
    uint32_t dims[3];
    bool is_rectilinear; /* along axes 0 and 2, and sheared */
};

double uniform(double low, double high);

/* Returns a smooth volume with noise; one third of it has a single value. Real types also have NaN
 * and −∞. */
struct sp_volume *make_volume(const struct shape *shape);

/* Returns a function that is visible in the part [from, to] of the range of values. */
struct sp_transfer_function make_function(const struct sp_volume *volume, double from, double to);
void add_gradient_axis(struct sp_transfer_function *tf);
struct sp_classify_job make_job(struct rig *rig, const struct sp_transfer_function *tf,
                                bool normals);

/* Returns the list of level 0, as the backend gets it. */
const struct gl_visible_list *get(struct rig *rig, struct sp_volume *volume,
                                  const struct sp_classify_job *job);

/* Returns the first bytes of a buffer of the GPU. The caller frees them. */
void *read_back(const struct gl_buffer *buffer, uint64_t bytes);

/* Compares two classes: the depths up to rounding, the colours where the depth is above 1e-6. */
void check_class(const float got[4], const struct sp_class *wanted);

/* Compares a list of the GPU with the CPU's: bricks, voxels, keys or classes, normals. Unless
 * is_exact, the GPU may list more voxels than the CPU, if the table by key hides them. */
void check_list(const struct gl_visible_list *list, const struct sp_level *level, bool normals,
                bool is_exact);

/* Classifies level 0 on both and compares the GPU's list with the CPU's. */
void check_against_processor(struct rig *rig, struct sp_volume *volume,
                             const struct sp_classify_job *job, bool is_exact);

/* Evicts the cached data of the volume, and releases the volume. */
void forget(struct rig *rig, struct sp_volume **volume);

/* True if the CPU has made entries of level 0 of the volume. */
bool has_entries(const struct rig *rig, const struct sp_volume *volume);

#endif
