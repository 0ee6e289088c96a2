/* SPDX-License-Identifier: Apache-2.0 */
#include "tile/footprint.h"

#include "splat/normal.h"

float sp_footprint_share(const struct sp_blend *blend, float exponent, float depth) {
    if (blend->cubic)
        return sp_cubic_share(blend->cubic, exponent / blend->cut, depth);
    return sp_normal_share(depth);
}

static void add_plane(const struct sp_blend *blend, const struct sp_cut_plane *plane, float dx,
                      float dy, struct sp_row *row) {
    for (int i = 0; i < row->n; i++) {
        float eta = plane->e + plane->k[0] * (dx + (float)i) + plane->k[1] * dy;
        if (plane->side > 0)
            row->low[i] = row->low[i] > -eta ? row->low[i] : -eta;
        else if (plane->side < 0)
            row->high[i] = row->high[i] < eta ? row->high[i] : eta;
        else
            row->weight[i] *= sp_footprint_share(blend, row->exponent[i], eta);
    }
}

void sp_footprint_row(const struct sp_blend *blend, const struct sp_tile *tile,
                      const struct sp_splat *s, const struct sp_cut *cut, const struct sp_box *box,
                      int y, struct sp_row *row) {
    float dx = (float)(box->x0 + tile->x) + 0.5f - s->x, dy = (float)(y + tile->y) + 0.5f - s->y;
    float l = s->b * dy, q = s->c * dy * dy, scale = 1 / blend->cut;
    row->n = box->x1 - box->x0;
    int whole = (row->n + SP_WIDE - 1) & -SP_WIDE;
    for (int i = 0; i < whole; i++) {
        float x = dx + (float)i, p = (s->a * x + l) * x + q, w = sp_exp2(-p);
        row->exponent[i] = p;
        row->weight[i] = p <= blend->cut ? w : 0.0f;
    }
    for (int i = row->n; i < whole; i++)
        row->weight[i] = 0;
    if (blend->cubic)
        for (int i = 0; i < row->n; i++)
            row->weight[i] = sp_cubic_weight(blend->cubic, row->exponent[i] * scale);
    row->bounded = cut && s->cuts;
    if (!row->bounded)
        return;
    for (int i = 0; i < row->n; i++) {
        row->low[i] = -SP_UNBOUNDED;
        row->high[i] = SP_UNBOUNDED;
    }
    for (uint32_t k = 0; k < s->cuts; k++)
        add_plane(blend, &cut->planes[k], dx, dy, row);
}

void sp_footprint_weights(const struct sp_blend *blend, const struct sp_tile *tile,
                          const struct sp_splat *s, const struct sp_cut *cut,
                          const struct sp_box *box, int y, struct sp_row *row) {
    sp_footprint_row(blend, tile, s, cut, box, y, row);
    if (!row->bounded)
        return;
    for (int i = 0; i < row->n; i++) {
        float share = sp_footprint_share(blend, row->exponent[i], row->high[i]) -
                      sp_footprint_share(blend, row->exponent[i], row->low[i]);
        row->weight[i] *= share > 0 ? share : 0;
    }
}
