/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/postconv/insert.h"

#include <math.h>

#include "draw/postconv/tile.h"

/* The place of a fragment on the ray of pixel (x, y) of the image. */
static float compute_place(const struct sp_postconv_insert *insert, int x, int y, float depth) {
    const double u2 = (double)depth;
    double aside = insert->right * (x + 0.5 - insert->centre[0]) +
                   insert->down * (y + 0.5 - insert->centre[1]);
    double slice =
        insert->offset + u2 * insert->depth + aside * (insert->is_perspective ? u2 : 1.0);
    if (!(slice > 0))
        return 0;
    if (slice >= insert->slices)
        return INFINITY;
    const uint32_t k = (uint32_t)slice;
    return insert->begin[k][0] + insert->begin[k][1] * (float)(slice - k);
}

/* Finds the place of the first of the fragments that are left of a pixel. */
static inline void update_place(const struct sp_postconv_open_tile *t, int y, int column) {
    struct sp_postconv_inserted *own = t->inserted;
    const int x = t->x + column / W * W + sp_postconv_pixel_at(column % W);
    own->place[y][column] = own->left[y][column] ? compute_place(t->postconv->insert, x, t->y + y,
                                                                 own->next[y][column]->depth)
                                                 : INFINITY;
}

static bool has_fragments(const struct sp_postconv_open_tile *t) {
    const struct sp_fragments *all = t->postconv->insert->fragments;
    for (int y = 0; y < t->height; y += SP_FRAGMENT_TILE)
        for (int x = 0; x < t->width; x += SP_FRAGMENT_TILE) {
            const struct sp_fragment *list;
            if (sp_fragments_row(all, t->x + x, t->y + y, &list))
                return true;
        }
    return false;
}

void sp_postconv_open_fragments(struct sp_postconv_open_tile *t) {
    t->inserted = NULL;
    if (!t->postconv->insert || !has_fragments(t))
        return;
    t->inserted = t->scratch->inserted;
    memset(t->inserted->left, 0, sizeof t->inserted->left);
    for (int y = 0; y < POSTCONV_TILE; y++)
        for (int column = 0; column < POSTCONV_TILE; column++) {
            const int x = column / W * W + sp_postconv_pixel_at(column % W);
            uint32_t count = 0;
            if (x < t->width && y < t->height)
                t->inserted->next[y][column] =
                    sp_fragments_at(t->postconv->insert->fragments, t->x + x, t->y + y, &count);
            t->inserted->left[y][column] = (uint8_t)count;
            update_place(t, y, column);
        }
}

/* d − origin of a depth on the ray of a pixel of the tile. */
static float place_of(const struct sp_postconv_open_tile *t, int y, int column, float depth) {
    const int x = t->x + column / W * W + sp_postconv_pixel_at(column % W);
    float base, factor;
    sp_layer_places_row(t->postconv->places, x, t->y + y, 1, &base, &factor);
    return sp_postconv_place(t->scratch, (depth - base) / factor);
}

void sp_postconv_composite_fragments(struct sp_postconv_open_tile *t, int y, int x, unsigned bits) {
    float(*done)[POSTCONV_TILE][POSTCONV_TILE] = t->scratch->done;
    _Alignas(64) float color[3][W] = { { 0 } }, alpha[W] = { 0 }, place[W] = { 0 };
    for (; bits; bits &= bits - 1) {
        const int i = __builtin_ctz(bits);
        const struct sp_fragment *fragment = t->inserted->next[y][x + i]++;
        for (int c = 0; c < 3; c++)
            color[c][i] = fragment->color[c];
        alpha[i] = fragment->alpha;
        if (t->postconv->places)
            place[i] = place_of(t, y, x + i, fragment->depth);
        t->inserted->left[y][x + i]--;
        update_place(t, y, x + i);
    }
    sp_wide through = sp_wide_load(&done[3][y][x]);
    for (int c = 0; c < 3; c++)
        sp_wide_store(&done[c][y][x],
                      sp_wide_load(&done[c][y][x]) + through * sp_wide_load(color[c]));
    sp_wide_store(&done[3][y][x], through * (1 - sp_wide_load(alpha)));
    if (t->postconv->places)
        sp_moments_add(&t->scratch->moment[0][y][x], &t->scratch->moment[1][y][x],
                       through * sp_wide_load(alpha), sp_wide_load(place));
}

/* The pixels of the vector at (x, y) that have fragments left, as bits. */
static unsigned mask_left(const struct sp_postconv_open_tile *t, int y, int x) {
    unsigned bits = 0;
    for (int i = 0; i < W; i++)
        bits |= (unsigned)(t->inserted->left[y][x + i] > 0) << i;
    return bits;
}

void sp_postconv_finish_fragments(struct sp_postconv_open_tile *t) {
    for (int y = 0; t->inserted && y < POSTCONV_TILE; y++)
        for (int x = 0; x < POSTCONV_TILE; x += W)
            for (unsigned left = mask_left(t, y, x); left; left = mask_left(t, y, x))
                sp_postconv_composite_fragments(t, y, x, left);
}
