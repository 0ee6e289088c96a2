/* SPDX-License-Identifier: Apache-2.0
 *
 * Draws sheets of interpolated values on software GL and with the scalar kernels of the CPU, and
 * compares the images.
 */
#ifndef TEST_RESAMPLE_RIG_H
#define TEST_RESAMPLE_RIG_H

#include "backend/backend.h"
#include "backend/gl/state.h"
#include "support/image.h"

enum { CPU, GL, BACKENDS, X = 21, Y = 17, Z = 25 };

struct resample_rig {
    const struct sp_backend *backends[BACKENDS];
    void *states[BACKENDS];
    struct sp_frame_pool *pool;
    unsigned drawn;
    unsigned edge_pixels; /* pixels that may differ: a sample of a mesh lies on an edge there */
    double worst;         /* the smallest PSNR, dB */
};

struct resample_shot {
    const struct sp_view *view;
    struct sp_volume *volume;
    unsigned mip_level;
    const atomic_bool *cancel;
    struct sp_volume *const
        *layer_volumes; /* by type of layer, from points on; NULL = there are none */
};

/* False with *err set without software GL; close it nevertheless. */
bool resample_rig_open(struct resample_rig *rig, struct sp_error *err);
void resample_rig_close(struct resample_rig *rig);
struct gl_state *resample_rig_gl(const struct resample_rig *rig);

/* Draws with one of the backends. image, stats: NULL = not wanted. resample_try() may fail. */
bool resample_try(struct resample_rig *rig, int by, const struct resample_shot *shot,
                  struct test_image *image, struct sp_frame_stats *stats, struct sp_error *err);
struct test_image resample_draw(struct resample_rig *rig, int by, const struct resample_shot *shot,
                                struct sp_frame_stats *stats);

/* Draws the shot with both backends and fails unless the images agree. resample_report() prints the
 * smallest PSNR since the last report. */
void resample_check(struct resample_rig *rig, const char *what, const struct resample_shot *shot);
void resample_report(struct resample_rig *rig);

/* A ball of X × Y × Z samples with values from low to high. has_holes: some are not finite. */
struct sp_volume *resample_make_ball(enum sp_type type, double low, double high, bool has_holes,
                                     bool is_rectilinear);

/* A view of the ball: order post, sheets, 40 × 27 px. */
void resample_make_view(struct sp_view *view, const struct sp_volume *volume, double low,
                        double high);

#endif
