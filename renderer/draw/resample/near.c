/* SPDX-License-Identifier: Apache-2.0
 *
 * Close to the eye, a block of pixels sees only a few samples of a sheet. Finding their range is
 * cheaper than reading the values at the pixels, and the range shows that most intervals are
 * invisible. A region is too coarse for this test there: it is wider than several blocks.
 *
 * Ranges are found for SP_WIDE blocks at a time, from pairs of samples.
 */
#include "base/fetch.h"
#include "draw/resample/kernels.h"

enum { NEAR = 8 }; /* refined samples between the first and the last one of a block, per axis */

/* The refined samples around the pixels of SP_WIDE blocks: first and last, per axis. */
struct extent {
    sp_wide first[2], last[2];
    sp_wide_mask is_near;
    int largest[2]; /* last − first, of blocks that are near */
};

static inline void compute_extent(const struct sp_resample_open_tile *t,
                                  const struct sp_resample_sheet *sheet, int begin,
                                  struct extent *extent) {
    sp_wide min[2], max[2], size[2];
    sp_resample_extents(t, begin, sp_wide_all(sheet->s), min, max);
    for (int a = 0; a < 2; a++) {
        const sp_wide first = sp_wide_all(sheet->first[a]), last = sp_wide_all(sheet->last[a]);
        sp_wide low = 2 * min[a] + sheet->shift[a], high = 2 * max[a] + sheet->shift[a];
        low = sp_wide_min(sp_wide_max(low, first), last);
        high = sp_wide_min(sp_wide_max(high, first), last);
        extent->first[a] = sp_wide_floor(low);
        extent->last[a] = sp_wide_floor(high) + 1;
        size[a] = extent->last[a] - extent->first[a];
    }
    const sp_wide most = sp_wide_all(NEAR);
    extent->is_near = sp_wide_le(size[0], most) & sp_wide_le(size[1], most);
    for (int a = 0; a < 2; a++)
        extent->largest[a] = (int)sp_wide_largest(sp_wide_keep(extent->is_near, size[a]));
}

/* Pairs of samples of 16 bits are compared as such. */
static inline void compute_range(const struct sp_resample_sheet *sheet, const struct extent *extent,
                                 sp_wide range[2]) {
    sp_wide_short low = sp_wide_short_all(UINT16_MAX), high = sp_wide_short_all(0);
    for (int j = 0; j <= extent->largest[1]; j++)
        for (int i = 0; i <= extent->largest[0]; i += 2) {
            sp_wide row = sp_wide_min(extent->first[1] + (float)j, extent->last[1]);
            sp_wide column = sp_wide_min(extent->first[0] + (float)i, extent->last[0] - 1);
            sp_wide at = sp_wide_fma(row, sp_wide_all((float)sheet->width), column);
            sp_wide_short pair = (sp_wide_short)sp_fetch_pairs(sheet->refined, sp_wide_to_int(at));
            low = sp_wide_short_min(low, pair);
            high = sp_wide_short_max(high, pair);
        }
    sp_wide_int least = (sp_wide_int)low, most = (sp_wide_int)high;
    range[0] = sp_wide_min(sp_wide_from_int(least & 0xffff), sp_wide_from_int(least >> 16));
    range[1] = sp_wide_max(sp_wide_from_int(most & 0xffff), sp_wide_from_int(most >> 16));
}

void sp_resample_near_ranges(const struct sp_resample_open_tile *t, struct sp_resample_sheet *sheet,
                             uint64_t need) {
    const uint64_t group = (UINT64_C(1) << SP_WIDE) - 1;
    const sp_wide far = sp_wide_all(INFINITY);
    for (int b = 0; b < RESAMPLE_BLOCKS; b += SP_WIDE) {
        struct extent extent;
        sp_wide range[2] = { -far, far };
        if (!(need >> b & group))
            continue;
        compute_extent(t, sheet, b, &extent);
        if (extent.largest[0] > 0)
            compute_range(sheet, &extent, range);
        sp_wide_store(sheet->range[0] + b, sp_wide_select(extent.is_near, range[0], -far));
        sp_wide_store(sheet->range[1] + b, sp_wide_select(extent.is_near, range[1], far));
    }
}

uint64_t sp_resample_near_visible(const struct sp_resample_open_tile *t, int number,
                                  uint64_t blocks) {
    const uint64_t group = (UINT64_C(1) << SP_WIDE) - 1;
    const float *visible = t->r->curve.visible;
    /* Reading rounds, and the value half way overshoots by an eighth of the difference from the
     * outer sheets. */
    const float rounding = 1, overshoot = 0.125f;
    uint64_t seen = 0;
    for (int b = 0; b < RESAMPLE_BLOCKS; b += SP_WIDE) {
        sp_wide low[4], high[4];
        if (!(blocks >> b & group))
            continue;
        for (int k = 0; k < 4; k++) {
            const struct sp_resample_sheet *sheet =
                &t->scratch->sheets[(number - 1 + k) % RESAMPLE_SHEETS];
            low[k] = sp_wide_load(sheet->range[0] + b) - rounding;
            high[k] = sp_wide_load(sheet->range[1] + b) + rounding;
        }
        sp_wide least = sp_wide_min(low[1], low[2]), most = sp_wide_max(high[1], high[2]);
        most = sp_wide_max(most, sp_wide_all(t->r->lowest));
        sp_wide above = sp_wide_max(sp_wide_max(high[0], high[3]) - least, sp_wide_all(0));
        sp_wide below = sp_wide_max(most - sp_wide_min(low[0], low[3]), sp_wide_all(0));
        sp_wide_mask shows = sp_wide_lt(least - overshoot * above, sp_wide_all(visible[1])) &
                             sp_wide_lt(sp_wide_all(visible[0]), most + overshoot * below);
        seen |= (uint64_t)sp_wide_mask_bits(shows) << b;
    }
    return seen & blocks;
}
