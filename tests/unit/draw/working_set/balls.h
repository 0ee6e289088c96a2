/* SPDX-License-Identifier: Apache-2.0
 *
 * Two balls in opposite corners of a volume that is empty otherwise, and a renderer. Failures end
 * the test.
 */
#ifndef TESTS_UNIT_SUBVOLUME_BALLS_H
#define TESTS_UNIT_SUBVOLUME_BALLS_H

#include "unit/draw/working_set/rig.h"

enum { WIDE = 330, HIGH = 200, DEEP = 140, SAMPLES = WIDE * HIGH * DEEP };

/* Fixtures of a group of tests; *state is a rig without a volume. */
int balls_setup(void **state);
int balls_teardown(void **state);

/* Makes the volume in memory and as a brick file, both as members of the rig. Bricks without a ball
 * are noise that the rig's transfer function leaves out. */
void balls_make(struct rig *rig, enum sp_type type);
void balls_finish(struct rig *rig);

/* A view of all samples of the finest level. */
struct sp_view balls_view(const struct rig *rig);

#endif
