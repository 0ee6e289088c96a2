/* SPDX-License-Identifier: Apache-2.0
 *
 * Layers of vectors by their definition (renderer/draw/layers/vectors/README.md,
 * renderer/draw/layers/splat_list/streak.h), in double precision: the samples in order of depth,
 * each with its footprint and its texture.
 */
#ifndef TESTS_SUPPORT_STREAKS_H
#define TESTS_SUPPORT_STREAKS_H

#include "sp/view.h"
#include "sp/volume.h"
#include "support/hit.h"

struct test_streaks;

/* Returns the samples of `volume`, a grid or points, that the layer shows. All have this extinction
 * [1/world unit] and colour. Only samples inside the view's clip box are drawn; points are not
 * clipped. NULL when out of memory. */
struct test_streaks *test_streaks_create(const struct sp_volume *volume, const struct sp_view *view,
                                         const struct sp_layer *layer, double extinction,
                                         const float color[3]);
void test_streaks_destroy(struct test_streaks **streaks);
unsigned test_streaks_count(const struct test_streaks *streaks);

/* Fills hits[] with the streaks at a point of the image [px], front to back; returns their number,
 * at most test_streaks_count(). */
unsigned test_streaks_hits(const struct test_streaks *streaks, double x, double y,
                           struct test_hit *hits);

#endif
