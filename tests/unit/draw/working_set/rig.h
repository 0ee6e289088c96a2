/* SPDX-License-Identifier: Apache-2.0
 *
 * A volume in memory and the same in a brick file, and images of both. Failures end the test.
 */
#ifndef TESTS_UNIT_SUBVOLUME_RIG_H
#define TESTS_UNIT_SUBVOLUME_RIG_H

#include "sp/view.h"
#include "support/render.h"

enum { NX = 210, NY = 150, NZ = 133, COUNT = NX * NY * NZ, SIDE = 96 };

struct rig {
    struct test_renderer renderer;
    uint8_t *samples;
    float (*vectors)[3]; /* NULL = none */
    double coordinates[NX + NY + NZ];
    struct sp_volume_info info;
    struct sp_volume *whole;
    int file; /* the brick file */
};

/* Fixtures of a group of tests; *state is the rig. Its samples are evenly spaced, on rectilinear
 * axes, or evenly spaced with vectors. */
int rig_setup(void **state);
int rig_setup_rectilinear(void **state);
int rig_setup_vectors(void **state);
int rig_teardown(void **state);

/* Opens the brick file with a budget of `bytes` for subvolumes; 0 = enough for all bricks. */
struct sp_volume *rig_open_file(const struct rig *rig, uint64_t bytes);

struct sp_view rig_make_view(const struct rig *rig);

/* Moves the camera towards its target. */
void rig_zoom(struct sp_view *view, double by);

struct sp_frame *rig_render_level(const struct rig *rig, struct sp_volume *volume,
                                  const struct sp_view *view, double wait_ms, unsigned level);
struct sp_frame *rig_render(const struct rig *rig, struct sp_volume *volume,
                            const struct sp_view *view, double wait_ms);

/* PSNR [dB] of two frames; 200 = they are equal. */
double rig_compare(const struct sp_frame *a, const struct sp_frame *b);

/* Fails unless the image of a brick file is complete and equals the image of rig->whole at the same
 * level to floor_db. */
void rig_expect(const struct rig *rig, struct sp_volume *volume, const struct sp_view *view,
                double floor_db, const char *what);

double rig_mean_of(const struct sp_frame *frame);

#endif
