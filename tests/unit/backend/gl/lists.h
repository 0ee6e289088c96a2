/* SPDX-License-Identifier: Apache-2.0
 *
 * Lists that the GPU makes, and the processor's to compare them with. Made volumes and functions;
 * all that goes wrong fails the test.
 */
#ifndef TEST_GL_LISTS_H
#define TEST_GL_LISTS_H

#include "backend/gl/mip_levels.h"

enum { TYPES = SP_FLOAT64 }; /* those that the GPU classifies */

struct rig {
    struct gl_residency residency;
    struct sp_classify_cache cache;
    struct sp_pool *pool;
    unsigned warnings;
};

/* A volume, and what it is made of. */
struct shape {
    enum sp_type type;
    uint32_t dims[3];
    bool is_rectilinear; /* along axes 0 and 2, and sheared */
};

double uniform(double low, double high);

/* Smooth with noise; a third of it is one value. Of reals some are none. */
struct sp_volume *make_volume(const struct shape *shape);

/* Visible where the share of the range lies in [from, to]. */
struct sp_transfer_function make_function(const struct sp_volume *volume, double from, double to);
void add_gradient_axis(struct sp_transfer_function *tf);
struct sp_classify_job make_job(struct rig *rig, const struct sp_transfer_function *tf,
                                bool normals);

/* The finest list, as the backend gets it. */
const struct gl_visible_list *get(struct rig *rig, struct sp_volume *volume,
                                  const struct sp_classify_job *job);

/* malloc'ed. */
void *read_back(const struct gl_buffer *buffer, uint64_t bytes);

/* Depths rounded otherwise, and colours of what has a depth. */
void check_class(const float got[4], const struct sp_class *wanted);

/* What of the processor's lists the GPU's differ in is nothing. What is hidden may be missing, of
 * types with a table by key, order pre, unless is_exact. */
void check_list(const struct gl_visible_list *list, const struct sp_level *level, bool normals,
                bool is_exact);

/* Compares with a list that the processor makes of nothing. */
void check_against_processor(struct rig *rig, struct sp_volume *volume,
                             const struct sp_classify_job *job, bool is_exact);

/* Drops what was made of the volume, and the volume. */
void forget(struct rig *rig, struct sp_volume **volume);

/* Whether the processor has made entries of the volume's finest level. */
bool has_entries(const struct rig *rig, const struct sp_volume *volume);

#endif
