/* SPDX-License-Identifier: Apache-2.0
 *
 * Reads a field of light at SP_WIDE points.
 */
#ifndef SP_LIGHT_READ_H
#define SP_LIGHT_READ_H

#include "base/fetch.h"
#include "draw/light/light.h"

/* What cells keep, at SP_WIDE points. */
struct sp_light_there {
    sp_wide dark;       /* Ā, [0, 1] */
    sp_wide arrives;    /* transmittance, [0, 1] */
    sp_wide moments[8]; /* as sp_light_field.moments, −128 to 127; valid if occlusion > 0 */
};

/* Eight cells around each point, and their weights: 16-bit integers, twice in each lane, whose sum
 * over the cells is at most 255. Products of bytes and weights are added in 16 bits. */
struct sp_light_corners {
    sp_wide_int cell[8], word[8];
    sp_wide_short weight[8];
    sp_wide sum; /* of the weights */
};

/* Interpolates linearly between cells and weights each cell by its clearness, so that cells inside
 * matter do not darken the surface. */
static inline void sp_light_weigh(const struct sp_light_field *field, const sp_wide at[3],
                                  struct sp_light_corners *c) {
    const float whole = 250; /* rounding adds less than 5 */
    sp_wide share[3][2], weight[8], sum = sp_wide_all(0);
    sp_wide_int cell[3], all = sp_wide_int_all(0);
    for (int a = 0; a < 3; a++) {
        sp_wide last = sp_wide_all((float)(field->dims[a] - 1));
        sp_wide x = sp_wide_min(sp_wide_max(at[a], sp_wide_all(0)), last);
        /* The last cell is read as the second one of its pair. */
        sp_wide low = sp_wide_min(sp_wide_from_int(sp_wide_to_int(x)), last - 1);
        share[a][1] = x - low;
        share[a][0] = 1 - share[a][1];
        cell[a] = sp_wide_to_int(low);
    }
    const int row = field->dims[0], slice = row * field->dims[1];
    sp_wide_int first = cell[0] + cell[1] * row + cell[2] * slice;
    for (int k = 0; k < 8; k++) {
        c->cell[k] = first + ((k & 1) + (k >> 1 & 1) * row + (k >> 2) * slice);
        c->word[k] = (sp_wide_int)sp_wide_gather((const float *)field->cells, c->cell[k]);
        weight[k] = sp_wide_from_int(c->word[k] >> 16) * share[2][k >> 2] *
                    (share[0][k & 1] * share[1][k >> 1 & 1]);
        sum += weight[k];
    }
    sp_wide scale = whole / sum;
    for (int k = 0; k < 8; k++) {
        sp_wide_int rounded = sp_wide_to_int(weight[k] * scale + 0.5f);
        all += rounded;
        c->weight[k] = (sp_wide_short)(rounded | rounded << 16);
    }
    c->sum = sp_wide_from_int(all);
}

/* Returns bytes 0 and 2 of each lane as 16-bit integers. */
static inline sp_wide_short sp_light_split(sp_wide_int word) {
    return (sp_wide_short)(word & 0x00ff00ff);
}

/* Reads at cell coordinates. */
static inline void sp_light_read(const struct sp_light_field *field, const sp_wide at[3],
                                 struct sp_light_there *out) {
    struct sp_light_corners c;
    sp_wide_short light = { 0 }, sums[4] = { { 0 } }; /* sums[k]: bytes k and k + 2 of a word */
    sp_light_weigh(field, at, &c);
    const sp_wide inverse = sp_wide_inverse(c.sum);
    for (int k = 0; k < 8; k++) {
        sp_wide_int word = (c.word[k] & 0xff) | (c.word[k] & 0xff00) << 8;
        light += (sp_wide_short)word * c.weight[k];
    }
    out->dark = 1 - sp_wide_from_int((sp_wide_int)light & 0xffff) * inverse * (1 / 255.0f);
    out->arrives = sp_wide_from_int((sp_wide_int)((sp_wide_bits)light >> 16)) * inverse;
    out->arrives *= 1 / 255.0f;
    if (field->occlusion <= 0)
        return;
    for (int k = 0; k < 8; k++) {
        sp_wide_int words[2];
        sp_fetch_quads((const int16_t *)field->moments, c.cell[k] * 4, words);
        for (int m = 0; m < 4; m++)
            sums[m] += sp_light_split(words[m >> 1] >> 8 * (m & 1)) * c.weight[k];
    }
    for (int m = 0; m < 8; m++) {
        sp_wide_bits sum = (sp_wide_bits)sums[(m & 1) + (m >> 2) * 2];
        sum = m & 2 ? sum >> 16 : sum & 0xffff;
        out->moments[m] = sp_wide_from_int((sp_wide_int)sum) * inverse - 128;
    }
}

/* Returns the occlusion around a normal, [0, 1]. Where firm is 0 there is no surface, and the most
 * light comes from the direction of −D. `cosine`: of the normal and the direction to the eye; the
 * side of the surface that the eye sees is lit. */
static inline sp_wide sp_light_occlusion(const struct sp_light_there *there, const sp_wide n[3],
                                         sp_wide cosine, sp_wide firm) {
    const float grazing = 5; /* 1/cosine from which on the side is certain */
    const sp_wide zero = sp_wide_all(0), one = sp_wide_all(1), *m = there->moments;
    sp_wide odd = (n[0] * m[0] + n[1] * m[1] + n[2] * m[2]) * (2 / LIGHT_DIPOLE);
    sp_wide even = m[3] * (n[0] * n[0] - n[2] * n[2]) + m[4] * (n[1] * n[1] - n[2] * n[2]);
    even += 2 * (m[5] * n[0] * n[1] + m[6] * n[0] * n[2] + m[7] * n[1] * n[2]);
    even *= 15 / 8.0f / LIGHT_QUADRUPOLE;
    /* At an outline the rounded normal may point away from the eye: the brighter side is seen. */
    sp_wide certain = sp_wide_min(sp_wide_abs(cosine) * grazing, one);
    odd = certain * sp_wide_select(sp_wide_lt(cosine, zero), -odd, odd) -
          (1 - certain) * sp_wide_abs(odd);
    sp_wide most = sp_wide_sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2]) * (2 / LIGHT_DIPOLE);
    sp_wide dark = there->dark - most + firm * (odd + even + most);
    return sp_wide_min(sp_wide_max(dark, zero), one);
}

#endif
