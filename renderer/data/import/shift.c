/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/shift.h"

#include <float.h>
#include <string.h>

#include "data/import/format.h"

/* A rounding below this part of a typical distance between elements is not seen. */
#define SEEN (1.0 / 64)

struct box {
    double middle[3], longest; /* side */
    double step;               /* of float32 at the corner that is farthest from 0 */
};

static bool compute_box(const void *positions, size_t stride, size_t count, struct box *box) {
    double farthest = 0;
    *box = (struct box){ .longest = 0 };
    for (int a = 0; a < 3; a++) {
        double low = INFINITY, high = -INFINITY;
        for (size_t i = 0; i < count; i++) {
            float p[3];
            memcpy(p, (const char *)positions + i * stride, sizeof p);
            if (!isfinite(p[a]))
                continue;
            low = fmin(low, (double)p[a]);
            high = fmax(high, (double)p[a]);
        }
        if (!(low <= high))
            return false;
        box->middle[a] = 0.5 * (low + high);
        box->longest = fmax(box->longest, high - low);
        farthest = fmax(farthest, fmax(fabs(low), fabs(high)));
    }
    box->step = farthest * (double)FLT_EPSILON;
    return true;
}

/* Elements fill a surface at least, as a rule: their distance is the side by the root of their
 * number. */
static bool is_coarse(const struct box *box, size_t count) {
    return box->step > SEEN * box->longest / sqrt((double)count);
}

bool import_shift_choose(struct import_shift *shift, const void *positions, size_t stride,
                         size_t count) {
    struct box box;
    bool is_moved = false;
    if (!shift || !compute_box(positions, stride, count, &box))
        return false;
    if (shift->is_found) { /* of elements at one place, float32 has all that is to be seen */
        is_moved = box.longest == 0 && import_shift_is_there(shift);
        if (is_moved)
            memset(shift->offset, 0, sizeof shift->offset);
        return is_moved;
    }
    shift->is_found = true;
    if (!shift->is_rounded || !is_coarse(&box, count))
        return false;
    /* A round number, which the steps of a time series have in common, as a rule. */
    const double round_to = pow(10, 1 + ceil(log10(fmax(box.longest, box.step))));
    for (int a = 0; a < 3; a++) {
        if (fabs(box.middle[a]) > 2 * box.longest)
            shift->offset[a] = round_to * round(box.middle[a] / round_to);
        is_moved |= shift->offset[a] != 0;
    }
    return is_moved;
}

bool import_shift_is_there(const struct import_shift *shift) {
    return shift && (shift->offset[0] != 0 || shift->offset[1] != 0 || shift->offset[2] != 0);
}

void import_shift_warn(const struct import_file *file) {
    const double *o = file->shift ? file->shift->offset : NULL;
    if (import_shift_is_there(file->shift))
        import_warn(file->warnings,
                    "The positions were moved by (%.12g, %.12g, %.12g), because so far from 0 "
                    "they would be rounded visibly; add (%.12g, %.12g, %.12g) for the coordinates "
                    "of the file.",
                    0 - o[0], 0 - o[1], 0 - o[2], o[0], o[1], o[2]);
}

void import_shift_warn_of_steps(const struct import_file *file, const void *positions,
                                size_t stride, size_t count) {
    struct box box;
    if (count > 1 && compute_box(positions, stride, count, &box) && is_coarse(&box, count))
        import_warn(file->warnings,
                    "So far from 0, positions are rounded to steps of about %.2g. Subtract a "
                    "constant from them before they are written, or write PLY with double "
                    "coordinates.",
                    box.step);
}
