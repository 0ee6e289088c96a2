/* SPDX-License-Identifier: Apache-2.0 */
#include "tile/slab.h"

#include <math.h>

#include "splat/normal.h"
#include "tile/footprint.h"

/* Closes every slab before `layer`. */
static void advance(struct sp_tile *tile, const struct sp_blend *blend, uint32_t layer) {
    if (tile->sheet == SP_NO_SHEET)
        tile->sheet = layer;
    for (uint32_t k = 0; k < blend->slots && tile->sheet < layer; k++, tile->sheet++)
        sp_layer_close(tile, blend, (uint32_t)((uint64_t)tile->sheet % blend->slots));
    if (tile->sheet < layer)
        tile->sheet = layer; /* all were closed on the way */
}

/* The slabs that a splat lies in: first, last. */
struct range {
    uint32_t first, last;
};

static struct range find_slabs(const struct sp_blend *blend, const struct sp_splat *s,
                               const struct sp_span *span) {
    float from = floorf((span->distance - span->reach - blend->nearest) / blend->thickness);
    float to = floorf((span->distance + span->reach - blend->nearest) / blend->thickness);
    float low = (float)s->sheet, high = (float)(s->sheet + blend->slots - 1);
    from = fminf(fmaxf(from, low), high);
    to = fminf(fmaxf(to, from), high);
    return (struct range){ (uint32_t)from, (uint32_t)to };
}

/* Adds n weights, a multiple of SP_WIDE, times what the splat adds; `share` of all of it. */
static inline void add_weights(const struct sp_splat *s, const float *restrict w, int n,
                               float share, bool post, float *restrict sums) {
    enum { P = SP_TILE * SP_TILE_ROW };
    float depth = s->depth * share, e0 = s->emission[0] * share, e1 = s->emission[1] * share,
          e2 = s->emission[2] * share, value = s->value * share;
    n &= -SP_WIDE;
    for (int i = 0; i < n; i++) {
        sums[i] += w[i] * depth;
        sums[P + i] += w[i] * e0;
        sums[2 * P + i] += w[i] * e1;
        sums[3 * P + i] += w[i] * e2;
    }
    for (int i = 0; post && i < n; i++)
        sums[4 * P + i] += w[i] * value;
}

/* Depth of the far face of slab k on the rays of a row's pixels, in standard deviations, no farther
 * than planes let them see. */
static void find_depths(const struct sp_blend *blend, const struct sp_span *span,
                        const struct sp_row *row, uint32_t k, float dx, float dy,
                        float *restrict depth) {
    float face = blend->nearest + (float)(k + 1) * blend->thickness - span->distance;
    float first = (face - span->slope[0] * dx - span->slope[1] * dy) * span->sharpness;
    float step = span->slope[0] * span->sharpness;
    for (int i = 0; i < row->n; i++)
        depth[i] = first - step * (float)i;
    for (int i = 0; row->bounded && i < row->n; i++)
        depth[i] = depth[i] < row->high[i] ? depth[i] : row->high[i];
}

/* Shares of a row's pixels before the far face of slab k, never less than those before its near
 * face. */
static void find_shares(const struct sp_blend *blend, const struct sp_span *span,
                        const struct sp_row *row, uint32_t k, float dx, float dy,
                        float *restrict before) {
    float depth[SP_TILE];
    find_depths(blend, span, row, k, dx, dy, depth);
    if (blend->cubic) {
        for (int i = 0; i < row->n; i++) {
            float share = sp_footprint_share(blend, row->exponent[i], depth[i]);
            before[i] = share > before[i] ? share : before[i];
        }
        return;
    }
    for (int i = 0; i < row->n; i++) {
        float share = sp_normal_share(depth[i]);
        before[i] = share > before[i] ? share : before[i];
    }
}

static void add_row(struct sp_tile *tile, const struct sp_blend *blend, const struct sp_splat *s,
                    const struct sp_span *span, const struct range *slabs, const struct sp_row *row,
                    int x, int y) {
    float before[SP_TILE], share[SP_TILE] = { 0 };
    int whole = (row->n + SP_WIDE - 1) & -SP_WIDE;
    float dx = (float)(x + tile->x) + 0.5f - s->x, dy = (float)(y + tile->y) + 0.5f - s->y;
    for (int i = 0; i < row->n; i++)
        before[i] = row->bounded ? sp_footprint_share(blend, row->exponent[i], row->low[i]) : 0;
    for (uint32_t k = slabs->first; k <= slabs->last; k++) {
        for (int i = 0; i < row->n; i++)
            share[i] = -before[i];
        if (k < slabs->last)
            find_shares(blend, span, row, k, dx, dy, before);
        else
            for (int i = 0; i < row->n; i++) {
                float all =
                    row->bounded ? sp_footprint_share(blend, row->exponent[i], row->high[i]) : 1;
                before[i] = all > before[i] ? all : before[i];
            }
        for (int i = 0; i < row->n; i++)
            share[i] = (share[i] + before[i]) * row->weight[i];
        sp_plane *sums = tile->sums + (size_t)(k % blend->slots) * blend->planes;
        add_weights(s, share, whole, 1, blend->post != NULL, &sums[0][y][x]);
    }
}

/* Whether all rays of a splat meet it at the same depth, within a thousandth of its deviation: so
 * with isotropic kernels, always. */
static bool is_even(const struct sp_blend *blend, const struct sp_splat *s,
                    const struct sp_span *span) {
    float across = fabsf(span->slope[0]) * (float)(s->x1 - s->x0) +
                   fabsf(span->slope[1]) * (float)(s->y1 - s->y0);
    return !blend->cubic && !s->cuts && across * span->sharpness < 1e-3f;
}

/* The same for a splat that is even: its shares are those of every pixel. */
static void add_even(struct sp_tile *tile, const struct sp_blend *blend, const struct sp_splat *s,
                     const struct sp_span *span, const struct range *slabs,
                     const struct sp_box *box) {
    float share[SP_SLOTS_MAX], before = 0;
    for (uint32_t k = slabs->first; k <= slabs->last; k++) {
        float face = blend->nearest + (float)(k + 1) * blend->thickness - span->distance;
        float next = k < slabs->last ? sp_normal_share(face * span->sharpness) : 1;
        share[k - slabs->first] = next - before;
        before = next;
    }
    for (int y = box->y0; y < box->y1; y++) {
        struct sp_row row;
        sp_footprint_row(blend, tile, s, NULL, box, y, &row);
        int whole = (row.n + SP_WIDE - 1) & -SP_WIDE;
        for (uint32_t k = slabs->first; k <= slabs->last; k++) {
            sp_plane *sums = tile->sums + (size_t)(k % blend->slots) * blend->planes;
            add_weights(s, row.weight, whole, share[k - slabs->first], blend->post != NULL,
                        &sums[0][y][box->x0]);
        }
    }
}

void sp_slab_add(struct sp_tile *tile, const struct sp_blend *blend,
                 const struct sp_splats *records, uint32_t n) {
    const struct sp_splat *s = &records->splat[n];
    const struct sp_span *span = &records->span[n];
    const struct sp_cut *cut = records->cut ? &records->cut[n] : NULL;
    advance(tile, blend, s->sheet);
    if (tile->saturated)
        return;
    struct sp_box box = sp_tile_box(tile, s);
    struct range slabs = find_slabs(blend, s, span);
    bool even = is_even(blend, s, span);
    if (even)
        add_even(tile, blend, s, span, &slabs, &box);
    for (int y = box.y0; y < box.y1 && !even; y++) {
        struct sp_row row;
        sp_footprint_row(blend, tile, s, cut, &box, y, &row);
        add_row(tile, blend, s, span, &slabs, &row, box.x0, y);
    }
    for (uint32_t k = slabs.first; k <= slabs.last; k++)
        sp_slot_touch(&tile->dirty[k % blend->slots], &box);
}
