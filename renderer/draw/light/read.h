/* SPDX-License-Identifier: Apache-2.0
 *
 * Reads a field of light at SP_WIDE points.
 */
#ifndef SP_LIGHT_READ_H
#define SP_LIGHT_READ_H

#include "base/wide.h"
#include "draw/light/light.h"

/* Reads openness and transmittance, [0, 255], at cell coordinates. Interpolates linearly between
 * cells and weights each cell by its clearness, so that cells inside matter do not darken the
 * surface. */
static inline void sp_light_read(const struct sp_light_field *field, const sp_wide at[3],
                                 sp_wide out[2]) {
    const sp_wide zero = sp_wide_all(0);
    sp_wide share[3][2], sum[3] = { zero, zero, zero };
    sp_wide_int cell[3];
    for (int a = 0; a < 3; a++) {
        sp_wide last = sp_wide_all((float)(field->dims[a] - 1));
        sp_wide x = sp_wide_min(sp_wide_max(at[a], zero), last);
        /* The last cell is read as the second one of its pair. */
        sp_wide low = sp_wide_min(sp_wide_from_int(sp_wide_to_int(x)), last - 1);
        share[a][1] = x - low;
        share[a][0] = 1 - share[a][1];
        cell[a] = sp_wide_to_int(low);
    }
    const int row = field->dims[0], slice = row * field->dims[1];
    sp_wide_int first = cell[0] + cell[1] * row + cell[2] * slice;
    for (int k = 0; k < 8; k++) {
        sp_wide_int index = first + ((k & 1) + (k >> 1 & 1) * row + (k >> 2) * slice);
        sp_wide_int word = (sp_wide_int)sp_wide_gather((const float *)field->cells, index);
        sp_wide clear = sp_wide_from_int(word >> 16);
        clear *= share[0][k & 1] * share[1][k >> 1 & 1] * share[2][k >> 2];
        sum[0] += clear * sp_wide_from_int(word & 255);
        sum[1] += clear * sp_wide_from_int(word >> 8 & 255);
        sum[2] += clear;
    }
    for (int c = 0; c < 2; c++)
        out[c] = sum[c] / sum[2];
}

#endif
