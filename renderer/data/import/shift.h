/* SPDX-License-Identifier: Apache-2.0
 *
 * Positions of elements are float32, which far from 0 has few digits: with the coordinates of a map
 * (5 400 000 m) its steps are 0.5 m. Where the file has more digits, the elements are moved near 0
 * before they are rounded, and a warning names the shift.
 *
 *   read without a shift ─► import_shift_choose() ─► true: read once more
 */
#ifndef SP_IMPORT_SHIFT_H
#define SP_IMPORT_SHIFT_H

#include <math.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct import_file;

/* All zero at first. */
struct import_shift {
    double offset[3]; /* subtracted from the positions, world units */
    /* A position was rounded; threads may set it. */
    atomic_bool is_rounded;
    bool is_found; /* the offset is final */
};

/* Returns a coordinate of the file as a coordinate of an element. `shift` may be NULL: none. */
static inline float import_shift_put(struct import_shift *shift, int axis, double coordinate) {
    const double moved = coordinate - (shift ? shift->offset[axis] : 0);
    const float rounded = (float)moved;
    if (shift && fabs((double)rounded - moved) > 0 &&
        !atomic_load_explicit(&shift->is_rounded, memory_order_relaxed))
        atomic_store_explicit(&shift->is_rounded, true, memory_order_relaxed);
    return rounded;
}

/* True if the positions must be read once more, with another offset: they were rounded, and the
 * steps of float32 there are not small against the distances of `count` elements. The positions lie
 * `stride` bytes apart; positions that are not finite do not count. */
bool import_shift_choose(struct import_shift *shift, const void *positions, size_t stride,
                         size_t count);

/* True if the elements are moved. `shift` may be NULL. */
bool import_shift_is_there(const struct import_shift *shift);

/* Warns if the elements were moved. */
void import_shift_warn(const struct import_file *file);

/* Warns if the positions, which a library has read as float32, may have been rounded. */
void import_shift_warn_of_steps(const struct import_file *file, const void *positions,
                                size_t stride, size_t count);

#endif
