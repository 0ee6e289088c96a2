/* SPDX-License-Identifier: Apache-2.0
 *
 * The rays of the blocks of a tile: where they cross the slices, and between which they are inside.
 */
#include "draw/resample/insert.h"
#include "draw/resample/kernels.h"
#include "draw/resample/quads.h"
#include "draw/resample/rays.h"

/* Keeps the part of SP_WIDE rays inside half space h. face: the cut by which they enter. */
static inline void cut_rays(const struct sp_resample_open_tile *t, uint32_t h, const sp_wide at[4],
                            sp_wide *begin, sp_wide *end, sp_wide *face) {
    const struct sp_resample_half *half = &t->r->halves[h];
    const sp_wide zero = sp_wide_all(0), far = sp_wide_all(1e9f);
    float n[3];
    for (int a = 0; a < 3; a++)
        n[a] = (float)half->normal[t->axis[a]];
    sp_wide rise = n[0] * at[2] + n[1] * at[3] + (t->is_backwards ? -n[2] : n[2]);
    sp_wide gap = (float)(half->offset - half->normal[t->axis[2]] * (double)t->reference) -
                  (n[0] * at[0] + n[1] * at[1]);
    sp_wide s = gap / rise;
    sp_wide_mask rises = sp_wide_lt(zero, rise), falls = sp_wide_lt(rise, zero);
    *face = sp_wide_select(rises & sp_wide_lt(*begin, s), sp_wide_all(half->is_cut ? (float)h : -1),
                           *face);
    *begin = sp_wide_select(rises, sp_wide_max(*begin, s), *begin);
    *end = sp_wide_select(falls, sp_wide_min(*end, s), *end);
    sp_wide_mask is_outside = ~(rises | falls) & sp_wide_lt(zero, gap);
    *end = sp_wide_select(is_outside, -far, *end);
}

/* Computes the unit vectors to the eye from SP_WIDE pixels whose centres are at (x, y). */
static inline void compute_eye(const struct sp_resample *r, sp_wide x, sp_wide y,
                               sp_wide to_eye[3]) {
    const struct sp_camera_transform *camera = r->camera;
    const sp_wide zero = sp_wide_all(0);
    const float inverse = 1 / (float)camera->scale;
    sp_wide eye[3] = { zero, zero, zero - 1 };
    if (camera->projection == SP_PERSPECTIVE) {
        sp_wide right = (x - (float)camera->centre[0]) * inverse;
        sp_wide down = (y - (float)camera->centre[1]) * inverse;
        eye[2] = -sp_wide_inverse_sqrt(right * right + down * down + 1);
        eye[0] = right * eye[2];
        eye[1] = down * eye[2];
    }
    sp_shade_eye(r->shade, eye, to_eye);
}

void sp_resample_open_block(const struct sp_resample_open_tile *t,
                            struct sp_resample_block *block) {
    for (int k = 0; k < 4; k++)
        block->value_sheet[k] = -1;
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE) {
        block->entry_sheet[i] = -1;
        for (int k = 0; t->r->has_depth && k < 2; k++)
            sp_wide_store(block->moment[k] + i, sp_wide_all(0));
        sp_wide_store(block->light + i, sp_wide_all(1));
        sp_wide_store(block->face_opacity + i, sp_wide_all(0));
        for (int c = 0; c < 3; c++) {
            sp_wide_store(block->color[c] + i, sp_wide_all(0));
            sp_wide_store(block->normal[c] + i, sp_wide_all(0));
        }
    }
    sp_resample_open_fragments(t, block);
    if (t->r->reduction.is_on)
        sp_resample_reduce_open(t->r, block);
}

/* Computes where SP_WIDE rays are, x and y px from the centre of `rays`: u, v, du, dv. */
static inline void place_rays(const struct sp_resample_open_tile *t,
                              const struct sp_resample_rays *rays, sp_wide x, sp_wide y,
                              sp_wide place[4]) {
    bool is_perspective = t->r->camera->projection == SP_PERSPECTIVE;
    sp_wide fall = 1 + x * (float)rays->fall[0] + y * (float)rays->fall[1];
    sp_wide inverse = 1 / sp_wide_max(fall, sp_wide_all(0.05f));
    for (int a = 0; a < 2; a++) {
        sp_wide moved = (x * (float)rays->right[a] + y * (float)rays->down[a]) * inverse;
        place[a] = (float)rays->at[a] + moved * (float)rays->lever;
        place[a + 2] = sp_wide_all((float)rays->change[a]);
        if (is_perspective)
            place[a + 2] += t->is_backwards ? -moved : moved;
    }
}

static void init_pixels(const struct sp_resample_open_tile *t, const struct sp_resample_rays *rays,
                        struct sp_resample_block *block, int i) {
    const struct sp_resample *r = t->r;
    const double *m = r->metric;
    const int *axis = t->axis, *at = block->at;
    sp_wide x = sp_wide_from_int((sp_wide_int_count() + i) & (RESAMPLE_BLOCK - 1));
    sp_wide y = sp_wide_from_int((sp_wide_int_count() + i) >> 3);
    if (block->is_crossed) {
        x += sp_wide_load(block->moved[0] + i);
        y += sp_wide_load(block->moved[1] + i);
    }
    if (r->shade) {
        sp_wide to_eye[3];
        compute_eye(r, x + ((float)(t->x + at[0]) + 0.5f), y + ((float)(t->y + at[1]) + 0.5f),
                    to_eye);
        for (int c = 0; c < 3; c++)
            sp_wide_store(block->to_eye[c] + i, to_eye[c]);
    }
    x += (float)(t->x + at[0] + 0.5 - rays->centre[0]);
    y += (float)(t->y + at[1] + 0.5 - rays->centre[1]);
    sp_wide place[4];
    place_rays(t, rays, x, y, place);
    sp_wide begin = sp_wide_all(-1e9f), end = sp_wide_all(1e9f), face = sp_wide_all(-1);
    for (uint32_t h = 0; h < r->half_count; h++)
        cut_rays(t, h, place, &begin, &end, &face);
    float forward = t->is_backwards ? -1 : 1;
    sp_wide square = (float)m[axis[0]] * place[2] * place[2] +
                     (float)m[axis[1]] * place[3] * place[3] + (float)m[axis[2]] +
                     2 * ((float)m[6 - axis[1] - axis[2]] * place[3] * forward +
                          (float)m[6 - axis[0] - axis[2]] * place[2] * forward +
                          (float)m[6 - axis[0] - axis[1]] * place[2] * place[3]);
    sp_wide_store(block->u + i, place[0]);
    sp_wide_store(block->v + i, place[1]);
    sp_wide_store(block->du + i, place[2]);
    sp_wide_store(block->dv + i, place[3]);
    sp_wide_store(block->begin + i, begin);
    sp_wide_store(block->end + i, end);
    sp_wide_store(block->length + i, sp_wide_sqrt(square));
    sp_wide_store(block->face + i, face);
    block->has_faces |=
        r->shade && sp_wide_any(sp_wide_lt(begin, end) & ~sp_wide_lt(face, sp_wide_all(0)));
}

/* Sets the mean rays of quads. */
static void init_quads(struct sp_resample_block *block) {
    const float *rays[4] = { block->u, block->v, block->du, block->dv };
    for (int k = 0; k < 4; k++)
        sp_quads_mean(rays[k], block->quad_ray[k]);
    for (int c = 0; c < 3; c++)
        sp_quads_mean(block->to_eye[c], block->quad_eye[c]);
}

/* Sets the four outermost rays of the block. If a side of the silhouette crosses the block, rays
 * may have moved, but stay inside their pixels: then these go through the corners of the block. */
static void init_corners(const struct sp_resample_open_tile *t, const struct sp_resample_rays *rays,
                         int b) {
    const struct sp_resample_block *block = &t->scratch->blocks[b];
    struct sp_resample_bounds *bounds = &t->scratch->bounds;
    const float beyond = block->is_crossed ? 0.5f : 0, side = RESAMPLE_BLOCK - 1 + 2 * beyond;
    const double middle = 0.5 - (double)beyond;
    sp_wide x = sp_wide_from_int(sp_wide_int_count() & 1) * side;
    sp_wide y = sp_wide_from_int(sp_wide_int_count() >> 1 & 1) * side;
    sp_wide place[4];
    x += (float)(t->x + block->at[0] + middle - rays->centre[0]);
    y += (float)(t->y + block->at[1] + middle - rays->centre[1]);
    place_rays(t, rays, x, y, place);
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < 4; i++)
            bounds->corner[k][i][b] = place[k][i];
}

/* Returns false if no ray of the block meets the volume. */
static bool init_block(const struct sp_resample_open_tile *t, const struct sp_resample_rays *rays,
                       int b, const int at[2]) {
    struct sp_resample_block *block = &t->scratch->blocks[b];
    struct sp_resample_bounds *bounds = &t->scratch->bounds;
    const sp_wide far = sp_wide_all(INFINITY);
    sp_wide inside[2] = { -far, far }, span[2] = { far, -far };
    block->at[0] = at[0];
    block->at[1] = at[1];
    block->has_faces = false;
    block->origin = NAN;
    block->is_crossed = sp_resample_is_crossed(t, at);
    if (block->is_crossed)
        sp_resample_open_cover(t, block);
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE) {
        init_pixels(t, rays, block, i);
        sp_wide begin = sp_wide_load(block->begin + i), end = sp_wide_load(block->end + i);
        sp_wide_mask meets = sp_wide_lt(begin, end);
        inside[0] = sp_wide_max(inside[0], begin);
        inside[1] = sp_wide_min(inside[1], end);
        span[0] = sp_wide_select(meets, sp_wide_min(span[0], begin), span[0]);
        span[1] = sp_wide_select(meets, sp_wide_max(span[1], end), span[1]);
    }
    block->inside[0] = sp_wide_largest(inside[0]);
    block->inside[1] = -sp_wide_largest(-inside[1]);
    bounds->span[0][b] = -sp_wide_largest(-span[0]);
    bounds->span[1][b] = sp_wide_largest(span[1]);
    if (t->r->has_quads)
        init_quads(block);
    sp_resample_open_block(t, block);
    init_corners(t, rays, b);
    return bounds->span[0][b] < bounds->span[1][b];
}

uint64_t sp_resample_init_blocks(struct sp_resample_open_tile *t,
                                 const struct sp_resample_rays *rays) {
    t->alive = 0;
    sp_resample_open_sides(t);
    for (int v = 0; v < t->height; v += RESAMPLE_BLOCK)
        for (int u = 0; u < t->width; u += RESAMPLE_BLOCK) {
            int b = v / RESAMPLE_BLOCK * RESAMPLE_ACROSS_MAX + u / RESAMPLE_BLOCK;
            if (init_block(t, rays, b, (const int[2]){ u, v }))
                t->alive |= UINT64_C(1) << b;
        }
    return t->alive;
}
