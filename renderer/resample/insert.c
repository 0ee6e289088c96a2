/* SPDX-License-Identifier: Apache-2.0
 *
 * Fragments of other layers between the intervals of a block's rays. An interval that holds a
 * fragment is cut there: each part has the interval's mean colour, and its share of the optical
 * depth is its share of the length. Hence no step of a sheet shows on a surface.
 */
#include "resample/insert.h"

#include <math.h>

/* s of a fragment on the ray of pixel (x, y) of the image. */
static float find_s(const struct sp_resample_open_tile *t, int x, int y, float depth) {
    const struct sp_resample *r = t->r;
    const int axis = t->axis[2];
    double aside = (x + 0.5 - r->camera->centre[0]) * r->right[axis] +
                   (y + 0.5 - r->camera->centre[1]) * r->down[axis];
    double place = r->eye[axis] + (double)depth * r->ray[axis];
    place += r->camera->projection == SP_PERSPECTIVE ? (double)depth * aside : aside;
    double s = place - (double)t->reference;
    return (float)(t->is_backwards ? -s : s);
}

/* The fragments of pixel i of the block at `at`. */
static const struct sp_fragment *find(const struct sp_resample_open_tile *t, const int at[2], int i,
                                      uint32_t *count) {
    int x = at[0] + i % RESAMPLE_BLOCK, y = at[1] + i / RESAMPLE_BLOCK;
    *count = 0;
    if (x >= t->width || y >= t->height)
        return NULL;
    return sp_fragments_at(t->r->fragments, t->x + x, t->y + y, count);
}

static void set_next(const struct sp_resample_open_tile *t, struct sp_resample_block *block, int i,
                     uint8_t next) {
    uint32_t count;
    const struct sp_fragment *list = find(t, block->at, i, &count);
    block->next[i] = next;
    block->next_s[i] = next < count
                           ? find_s(t, t->x + block->at[0] + i % RESAMPLE_BLOCK,
                                    t->y + block->at[1] + i / RESAMPLE_BLOCK, list[next].depth)
                           : INFINITY;
}

void sp_resample_open_fragments(const struct sp_resample_open_tile *t,
                                struct sp_resample_block *block) {
    block->has_fragments = false;
    for (int i = 0; t->r->fragments && i < RESAMPLE_PIXELS; i++) {
        set_next(t, block, i, 0);
        block->has_fragments = block->has_fragments || block->next_s[i] < INFINITY;
    }
}

/* Composites the next fragment of pixel i. */
static void insert(const struct sp_resample_open_tile *t, struct sp_resample_block *block, int i) {
    uint32_t count;
    const struct sp_fragment *fragment = find(t, block->at, i, &count) + block->next[i];
    for (int c = 0; c < 3; c++)
        block->color[c][i] += block->light[i] * fragment->color[c];
    block->light[i] *= 1 - fragment->alpha;
    set_next(t, block, i, (uint8_t)(block->next[i] + 1));
}

/* The opacity of a part of an interval. */
static float part_of(const struct sp_resample *r, float opacity, float share) {
    return r->is_linear ? opacity * share : 1 - powf(1 - opacity, share);
}

void sp_resample_insert(const struct sp_resample_open_tile *t, struct sp_resample_block *block,
                        int i, float begin, float end, float opacity, const float color[3]) {
    float from = fmaxf(begin, block->begin[i]), to = fminf(end, block->end[i]);
    float at = from, left = 1; /* of the interval's length */
    while (left > 0) {
        float next = block->next_s[i] < to ? fmaxf(block->next_s[i], at) : to;
        float share = to > from ? fminf((next - at) / (to - from), left) : 0;
        bool is_last = !(block->next_s[i] < to);
        float part = part_of(t->r, opacity, is_last ? left : share);
        for (int c = 0; c < 3; c++)
            block->color[c][i] += block->light[i] * part * color[c];
        block->light[i] *= 1 - part;
        if (is_last)
            return;
        insert(t, block, i);
        left -= share;
        at = next;
    }
    while (block->next_s[i] < to)
        insert(t, block, i);
}

void sp_resample_insert_before(const struct sp_resample_open_tile *t,
                               struct sp_resample_block *block, float s) {
    for (int i = 0; i < RESAMPLE_PIXELS; i++)
        while (block->next_s[i] < s)
            insert(t, block, i);
}
