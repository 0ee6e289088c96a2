/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/postconv/tile.h"
#include "splat/exp2.h"
#include "splat/pieces.h"

enum { PHASE_BITS = 8 };
_Static_assert(POSTCONV_PHASES == 1 << PHASE_BITS, "phases are the low bits of a place");

typedef int32_t ivec4 __attribute__((vector_size(16)));

struct chunk {
    _Alignas(64) int32_t column[CHUNK], row[CHUNK]; /* the first sample that each voxel reaches */
    _Alignas(64) int32_t at[CHUNK];                 /* index of that sample in the grid [floats] */
    _Alignas(64) int32_t phase[2][CHUNK];           /* row of the tables [floats] */
    _Alignas(64) float gain[CHUNK];
    _Alignas(64) float delta[3][CHUNK]; /* variance: xx, yy, xy [samples²] */
    _Alignas(64) float to_eye[3][CHUNK];
    uint32_t own; /* bit per voxel inside the tile, which no other tile counts */
    _Alignas(64) struct sp_class class[CHUNK]; /* of each voxel, if a table does not suffice */
};

/* Neighbours in a list are neighbours in the image. A voxel that adds to samples which the previous
 * voxel is still writing would wait, so they are taken four apart. */
static const uint8_t chunk_order[CHUNK] = { 0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15 };

/* Constants of a run. */
struct run_frame {
    const struct sp_visible *list;
    const struct sp_transfer *transfer;
    float base[3], step[2][3]; /* u of place (0, 0) of the slice, and along its axes */
    /* Column and row, from the first that matters on, 1/POSTCONV_PHASES samples. */
    float focal[2], centre[2];
    int32_t low[2], columns,
        rows;       /* the first sample that matters, and the number of samples that matter */
    int32_t own[4]; /* of the tile itself: first column and row, number of columns and rows */
    float scale, ratio_max[2], gram[6]; /* products of the kernel's rows: 00, 11, 01, 02, 12, 22 */
    float variance[3], rest[3];
    float gain, near, range[2];
    bool perspective, is_part;
};

static void start_run(const struct sp_postconv_open_tile *t, const struct sp_postconv_run *run,
                      bool all, struct run_frame *r) {
    const struct sp_postconv_brick *b = &t->postconv->bricks[run->brick];
    const struct sp_level *level = sp_postconv_level(t->postconv, b);
    const struct sp_ewa_frame *f = sp_postconv_ewa(t->postconv, b);
    const struct sp_postconv_group *g = &t->group;
    unsigned axis = t->postconv->axis, first = axis == 0, second = axis == 2 ? 1 : 2;
    r->list = &level->visible;
    r->transfer = &level->transfer;
    r->perspective = f->projection == SP_PERSPECTIVE;
    r->near = f->near;
    /* At the brick's own ends the range is open, so that rounding leaves no voxel out. */
    bool is_first = run->range[0] <= b->range[0];
    r->range[0] = is_first ? 0 : run->range[0];
    r->range[1] = all ? INFINITY : g->range[1];
    r->is_part = !is_first || !all;
    static const int pairs[6][2] = { { 0, 0 }, { 1, 1 }, { 0, 1 }, { 0, 2 }, { 1, 2 }, { 2, 2 } };
    for (int k = 0; k < 6; k++) {
        const float *p = f->kernel[pairs[k][0]], *q = f->kernel[pairs[k][1]];
        r->gram[k] = p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    }
    r->scale = f->scale;
    memcpy(r->ratio_max, f->ratio_max, sizeof r->ratio_max);
    for (int i = 0; i < 3; i++) {
        r->base[i] = b->base[i] + f->step[i][axis] * (float)run->slice;
        r->step[0][i] = f->step[i][first];
        r->step[1][i] = f->step[i][second];
    }
    int corner[2] = { t->x, t->y };
    for (int a = 0; a < 2; a++) {
        float first_sample = (f->centre[a] - (float)corner[a]) * g->per_px[a] + g->offset[a];
        r->focal[a] = f->scale * g->per_px[a] * POSTCONV_PHASES;
        r->centre[a] = (first_sample - g->low[a]) * POSTCONV_PHASES;
        r->low[a] = (int32_t)(g->low[a] * POSTCONV_PHASES);
        r->own[a] = (int32_t)((g->offset[a] - g->low[a]) * POSTCONV_PHASES);
        r->own[2 + a] = (int32_t)((g->end[a] - g->offset[a]) * POSTCONV_PHASES);
        r->variance[a] = b->scale * g->per_px[a] * g->per_px[a];
        r->rest[a] = b->lowpass2 * g->per_px[a] * g->per_px[a] - g->base[a];
    }
    r->columns = (int32_t)((g->high[0] - g->low[0]) * POSTCONV_PHASES);
    r->rows = (int32_t)((g->high[1] - g->low[1]) * POSTCONV_PHASES);
    r->variance[2] = b->scale * g->per_px[0] * g->per_px[1];
    r->rest[2] = -g->cross;
    r->gain = f->gain * g->per_px[0] * g->per_px[1];
}

/* Returns the elements of a chunk that hold the first n entries. */
static inline uint32_t elements(uint32_t n) {
    /* Element 4·column + row holds entry 4·row + column. */
    uint32_t m = 0, full = n / 4, left = n % 4;
    for (uint32_t c = 0; c < 4; c++)
        m |= ((UINT32_C(1) << (full + (c < left))) - 1) << 4 * c;
    return m;
}

/* 0 ≤ a < end. */
static inline sp_wide_mask in_range(sp_wide_int a, int32_t end) {
    return sp_wide_int_lt(sp_wide_int_all(-1), a) & sp_wide_int_lt(a, sp_wide_int_all(end));
}

/* Computes u of W voxels at places of the slice; returns 1/u2. */
static inline sp_wide locate(const struct run_frame *r, sp_wide_int at, sp_wide u[3]) {
    sp_wide i0 = sp_wide_from_int(at & 15), i1 = sp_wide_from_int(at >> 4);
    for (int a = 0; a < 3; a++)
        u[a] = r->base[a] + r->step[0][a] * i0 + r->step[1][a] * i1;
    return r->perspective ? sp_wide_fast_inverse(sp_wide_max(u[2], sp_wide_all(r->near)))
                          : sp_wide_all(1);
}

/* True for voxels in the range of 1/u2. The test is exact: each voxel is in the range of one group.
 */
static inline sp_wide_mask in_part(const struct run_frame *r, sp_wide inv) {
    return sp_wide_le(sp_wide_all(r->range[0]), inv) & sp_wide_lt(inv, sp_wide_all(r->range[1]));
}

/* Computes positions and footprints of a chunk. Returns a bit per voxel that matters to the tile.
 */
static inline uint32_t place_chunk(const struct run_frame *r, const struct sp_postconv_open_tile *t,
                                   const uint8_t *places, uint32_t n, bool shaded,
                                   struct chunk *c) {
    c->own = 0;
    uint32_t inside = 0;
    for (int v = 0; v < CHUNK; v += W) {
        sp_wide u[3], inv = locate(r, sp_wide_int_pick(places, chunk_order, v), u);
        sp_wide t0 = u[0] * inv, t1 = u[1] * inv;
        sp_wide x = r->focal[0] * t0 + r->centre[0], y = r->focal[1] * t1 + r->centre[1];
        /* Relative to the first sample that matters; values far outside are out of range. */
        sp_wide_int column = sp_wide_to_int(x), row = sp_wide_to_int(y);
        sp_wide_mask mask = sp_wide_le(sp_wide_all(r->near), u[2]) & in_range(column, r->columns) &
                            in_range(row, r->rows);
        if (r->is_part)
            mask = mask & in_part(r, inv);
        uint32_t in = sp_wide_mask_bits(mask);
        if (!in)
            continue;
        sp_wide_mask own =
            in_range(column - r->own[0], r->own[2]) & in_range(row - r->own[1], r->own[3]);
        c->own |= sp_wide_mask_bits(own) << v;
        column += r->low[0];
        row += r->low[1];
        if (t->has_dead) {
            in &= sp_wide_test_bits(t->wanted, column >> (PHASE_BITS + 2), row >> (PHASE_BITS + 2));
            if (!in)
                continue;
        }
        inside |= in << v;
        sp_wide_int first = (column >> PHASE_BITS) - 1, top = (row >> PHASE_BITS) - 1;
        sp_wide_int_store(&c->column[v], first);
        sp_wide_int_store(&c->row[v], top);
        sp_wide_int_store(&c->at[v], (top * POSTCONV_PITCH + first) * 4);
        sp_wide_int_store(&c->phase[0][v], (column & (POSTCONV_PHASES - 1)) * 8);
        sp_wide_int_store(&c->phase[1][v], (row & (POSTCONV_PHASES - 1)) * 8);
        sp_wide fx = r->scale * inv, fx2 = fx * fx, lengths = sp_wide_all(1);
        if (r->perspective) {
            sp_wide most0 = sp_wide_all(r->ratio_max[0]), most1 = sp_wide_all(r->ratio_max[1]);
            t0 = sp_wide_max(sp_wide_min(t0, most0), -most0);
            t1 = sp_wide_max(sp_wide_min(t1, most1), -most1);
            lengths = sp_wide_fast_sqrt(1.0f + t0 * t0 + t1 * t1);
        } else {
            t0 = t1 = sp_wide_all(0);
        }
        /* (k0 − t0·k2)·(k0 − t0·k2) and so on, of the kernel's rows. */
        sp_wide v00 = r->gram[0] + t0 * (t0 * r->gram[5] - 2 * r->gram[3]);
        sp_wide v11 = r->gram[1] + t1 * (t1 * r->gram[5] - 2 * r->gram[4]);
        sp_wide v01 = r->gram[2] + t0 * (t1 * r->gram[5] - r->gram[4]) - t1 * r->gram[3];
        sp_wide_store(&c->gain[v], fx2 * lengths * r->gain);
        sp_wide_store(&c->delta[0][v], v00 * fx2 * r->variance[0] + r->rest[0]);
        sp_wide_store(&c->delta[1][v], v11 * fx2 * r->variance[1] + r->rest[1]);
        if (t->group.has_cross)
            sp_wide_store(&c->delta[2][v], v01 * fx2 * r->variance[2] + r->rest[2]);
        if (!shaded)
            continue;
        sp_wide far = sp_wide_all(0);
        if (r->perspective)
            far = -sp_wide_fast_inverse(sp_wide_sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]));
        for (int a = 0; a < 3; a++)
            sp_wide_store(&c->to_eye[a][v],
                          r->perspective ? u[a] * far : sp_wide_all(a == 2 ? -1 : 0));
    }
    return inside & elements(n);
}

/* Adds voxel i of a chunk. */
static inline void deposit(const struct sp_postconv_tables *tables, const struct chunk *c, int i,
                           const struct sp_class *class, bool cross, float *grid) {
    enum { STRIDE = POSTCONV_PITCH * 4 };
    const float *spline = (const float *)tables->spline; /* phases index floats, not rows */
    const float *slope = (const float *)tables->slope;
    const float *sx = spline + c->phase[0][i];
    const float *sy = spline + c->phase[1][i];
    sp_quad wx = sp_quad_load(sx) + c->delta[0][i] * sp_quad_load(sx + 4);
    sp_quad wy = sp_quad_load(sy) + c->delta[1][i] * sp_quad_load(sy + 4);
    sp_quad sums;
    memcpy(&sums, class, sizeof sums); /* red, green, blue, depth */
    float depth = sums[3];
    sums = (sp_quad)(((ivec4)sums & (ivec4){ -1, -1, -1, 0 }) | (ivec4)(sp_quad){ 0, 0, 0, 1 });
    sp_wide value = sp_quad_repeat(sums * depth);
    wy *= c->gain[i];
    sp_quad dx = wx, dy = wy;
    if (cross) {
        dx = c->delta[2][i] * sp_quad_load(slope + c->phase[0][i] / 2);
        dy = sp_quad_load(slope + c->phase[1][i] / 2) * c->gain[i];
    }
    float *to = grid + c->at[i];
    for (int p = 0; p < VECTORS; p++) {
        sp_wide part = value * sp_quad_spread(wx, p),
                slant = cross ? value * sp_quad_spread(dx, p) : part;
        for (int y = 0; y < 4; y++) {
            sp_wide sum = sp_wide_load(to + y * STRIDE + p * W) + part * wy[y];
            sp_wide_store(to + y * STRIDE + p * W, cross ? sum + slant * dy[y] : sum);
        }
    }
}

/* A list may contain voxels that are not visible. */
static inline uint32_t has_depth(const struct sp_class *class) {
    int32_t bits; /* a float ≥ 0 is compared as an integer, without a vector register */
    memcpy(&bits, &class->depth, sizeof bits);
    return bits > 0;
}

/* 1 << n of each lane, n in [0, 30]: by way of a float's exponent. */
static inline sp_wide_int power_of_two(sp_wide_int n) {
    return sp_wide_to_int((sp_wide)((n + 127) << 23));
}

/* Marks the blocks that a chunk's voxels reach, in units of four rows. */
static inline void mark(struct sp_postconv_open_tile *t, const struct chunk *c, uint32_t inside) {
    sp_wide_int columns = sp_wide_int_all(0), rows = columns;
    for (int v = 0; v < CHUNK; v += W) {
        sp_wide_int in = power_of_two(sp_wide_int_count() + v) & (int32_t)inside;
        sp_wide_int x = sp_wide_int_load(&c->column[v]), y = sp_wide_int_load(&c->row[v]);
        sp_wide_int keep = (sp_wide_int)(in != 0);
        columns |= (power_of_two(x >> 2) | power_of_two((x + 3) >> 2)) & keep;
        rows |= (power_of_two(y >> 2) | power_of_two((y + 3) >> 2)) & keep;
    }
    uint32_t blocks = (uint32_t)sp_wide_int_or(columns), quads = (uint32_t)sp_wide_int_or(rows);
    int first = 4 * __builtin_ctz(quads), last = 4 * (31 - __builtin_clz(quads)) + 4;
    t->row0 = first < t->row0 ? first : t->row0;
    t->row1 = last > t->row1 ? last : t->row1;
    for (; quads; quads &= quads - 1) {
        uint32_t *row = &t->deposited[4 * __builtin_ctz(quads)];
        for (int k = 0; k < 4; k++)
            row[k] |= blocks;
    }
}

/* The loop over a chunk's voxels, for one width of keys. */
static inline uint32_t deposit_keys(const struct sp_postconv_open_tile *t, const struct chunk *c,
                                    uint32_t inside, const struct run_frame *r, uint64_t first,
                                    uint32_t key_bytes, bool cross) {
    const struct sp_class *table = r->transfer->table;
    const uint8_t *key1 = (const uint8_t *)r->list->key + first;
    const uint16_t *key2 = (const uint16_t *)r->list->key + first;
    const uint32_t *key4 = (const uint32_t *)r->list->key + first;
    uint32_t count = 0;
    for (uint32_t m = inside; m; m &= m - 1) {
        int i = __builtin_ctz(m), k = chunk_order[i];
        uint32_t key = key_bytes == 1 ? key1[k] : key_bytes == 2 ? key2[k] : key4[k];
        deposit(t->postconv->tables, c, i, &table[key], cross, t->scratch->grid[0][0]);
        count += has_depth(&table[key]) & c->own >> i;
    }
    return count;
}

/* Deposits a chunk with classes from the table; returns how many voxels of the tile are visible. */
static uint32_t deposit_chunk(const struct sp_postconv_open_tile *t, const struct chunk *c,
                              uint32_t inside, const struct run_frame *r, uint64_t first) {
    if (r->list->key_bytes == 1)
        return deposit_keys(t, c, inside, r, first, 1, false);
    if (r->list->key_bytes == 2)
        return deposit_keys(t, c, inside, r, first, 2, false);
    return deposit_keys(t, c, inside, r, first, 4, false);
}

/* The same for a group with covariance. */
static uint32_t deposit_chunk_across(const struct sp_postconv_open_tile *t, const struct chunk *c,
                                     uint32_t inside, const struct run_frame *r, uint64_t first) {
    return deposit_keys(t, c, inside, r, first, r->list->key_bytes, true);
}

/* The same for a chunk with its own classes. */
static uint32_t deposit_classes(const struct sp_postconv_open_tile *t, const struct chunk *c,
                                uint32_t inside) {
    uint32_t count = 0;
    for (uint32_t m = inside; m; m &= m - 1) {
        int i = __builtin_ctz(m);
        if (t->group.has_cross)
            deposit(t->postconv->tables, c, i, &c->class[i], true, t->scratch->grid[0][0]);
        else
            deposit(t->postconv->tables, c, i, &c->class[i], false, t->scratch->grid[0][0]);
        count += has_depth(&c->class[i]) & c->own >> i;
    }
    return count;
}

/* log2 of a > 0, as sp_log2(). */
static inline sp_wide log2_of(sp_wide a) {
    sp_wide_int bits = (sp_wide_int)a, power = (bits - 0x3f3504f3) >> 23;
    sp_wide m = (sp_wide)(bits - (power << 23));
    sp_wide s = (m - 1.0f) * sp_wide_fast_inverse(m + 1.0f), q = s * s;
    return sp_wide_from_int(power) +
           s * (2.88539008f + q * (0.961796694f + q * (0.577078016f + q * 0.412198583f)));
}

static inline sp_wide dot3(const float a[3], const sp_wide b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Unpacks gradients to unit vectors in camera space; 0 if there is no gradient. */
static inline void unpack_normals(const struct sp_shade *shade, sp_wide_int packed, sp_wide n[3]) {
    sp_wide u = sp_wide_from_int((packed & 2047) - SP_GRADIENT_STEPS) * (1.0f / SP_GRADIENT_STEPS);
    sp_wide v =
        sp_wide_from_int((packed >> 11 & 2047) - SP_GRADIENT_STEPS) * (1.0f / SP_GRADIENT_STEPS);
    sp_wide w = 1.0f - sp_wide_abs(u) - sp_wide_abs(v), none = sp_wide_all(0);
    sp_wide fold = sp_wide_max(-w, none);
    u += sp_wide_select(sp_wide_lt(u, none), fold, -fold);
    v += sp_wide_select(sp_wide_lt(v, none), fold, -fold);
    sp_wide scale = sp_wide_fast_inverse(sp_wide_sqrt(u * u + v * v + w * w));
    scale = sp_wide_keep(sp_wide_int_lt(sp_wide_int_all(0), packed >> 22 & 1023), scale);
    sp_wide world[3] = { u * scale, v * scale, w * scale };
    for (int a = 0; a < 3; a++)
        n[a] = dot3(shade->to_camera[a], world);
}

/* Computes the factors of W voxels' colours and the highlights to add, as sp_shade_direction(). */
static inline void light(const struct sp_shade *shade, const sp_wide n[3], const sp_wide to_eye[3],
                         sp_wide lit[3], sp_wide shine[3]) {
    sp_wide none = sp_wide_all(0);
    sp_wide_mask has_side = sp_wide_lt(none, n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    for (int c = 0; c < 3; c++) {
        lit[c] = sp_wide_all(shade->ambient);
        shine[c] = none;
    }
    for (int i = 0; i < shade->light_count; i++) {
        const float *l = shade->lights[i].direction, *strength = shade->lights[i].color;
        sp_wide facing = sp_wide_select(has_side, sp_wide_abs(dot3(l, n)), sp_wide_all(1));
        sp_wide along = none, length2 = none;
        for (int a = 0; a < 3; a++) {
            sp_wide h = l[a] + to_eye[a];
            along += h * n[a];
            length2 += h * h;
        }
        sp_wide_mask glints = has_side & sp_wide_lt(sp_wide_all(1e-12f), length2) &
                              sp_wide_lt(sp_wide_all(1e-6f), sp_wide_abs(along));
        sp_wide square =
            along * along * sp_wide_fast_inverse(sp_wide_max(length2, sp_wide_all(1e-12f)));
        sp_wide glint =
            sp_wide_keep(glints, sp_wide_exp2(0.5f * shade->exponent *
                                              log2_of(sp_wide_max(square, sp_wide_all(1e-30f)))));
        for (int c = 0; c < 3; c++) {
            lit[c] += shade->diffuse * strength[c] * facing;
            shine[c] += shade->specular * strength[c] * glint;
        }
    }
}

/* Classifies a chunk's voxels of a type without a table. */
static void classify_values(const struct run_frame *r, uint64_t first, uint32_t inside,
                            const int32_t *packed, struct chunk *c) {
    _Alignas(64) float value[CHUNK] = { 0 };
    for (uint32_t m = inside; m; m &= m - 1) {
        int i = __builtin_ctz(m);
        value[i] = sp_transfer_value(r->transfer,
                                     ((const uint32_t *)r->list->key)[first + chunk_order[i]]);
    }
    for (int v = 0; v < CHUNK; v += W)
        sp_pieces_classify(r->transfer->pieces, sp_wide_load(&value[v]), &c->class[v]);
    for (uint32_t m = r->transfer->scale ? inside : 0; m; m &= m - 1) {
        struct sp_class *class = &c->class[__builtin_ctz(m)];
        *class = sp_transfer_scale_class(r->transfer, *class, (uint32_t)packed[__builtin_ctz(m)]);
    }
}

/* Classifies and shades a chunk's voxels, if the table alone does not suffice. */
static void classify_chunk(const struct sp_postconv_open_tile *t, const struct run_frame *r,
                           uint64_t first, uint32_t inside, struct chunk *c) {
    const struct sp_shade *shade = t->postconv->shade;
    bool has_microflakes = sp_visible_has_microflakes(r->list);
    bool has_normals = !has_microflakes && (shade || r->transfer->scale);
    _Alignas(64) int32_t packed[CHUNK] = { 0 }, microflakes[2][CHUNK] = { 0 };
    for (uint32_t m = inside; m; m &= m - 1) {
        int i = __builtin_ctz(m);
        uint64_t e = first + chunk_order[i];
        if (has_normals)
            packed[i] = (int32_t)sp_visible_normal(r->list, e);
        for (int k = 0; has_microflakes && k < 2; k++)
            microflakes[k][i] = (int32_t)sp_visible_microflakes(r->list, e)->word[k];
        if (!r->transfer->pieces)
            c->class[i] =
                sp_transfer_class_at(r->transfer, sp_visible_key(r->list, e), (uint32_t)packed[i]);
    }
    if (r->transfer->pieces)
        classify_values(r, first, inside, packed, c);
    for (int v = 0; shade && v < CHUNK; v += W) {
        sp_wide n[3], to_eye[3], in[4], lit[4], shine[4];
        for (int a = 0; a < 3; a++)
            to_eye[a] = sp_wide_load(&c->to_eye[a][v]);
        if (has_microflakes) {
            const sp_wide_int word[2] = { sp_wide_int_load(&microflakes[0][v]),
                                          sp_wide_int_load(&microflakes[1][v]) };
            sp_shade_microflakes(shade, word, to_eye, in, shine);
        } else {
            unpack_normals(shade, sp_wide_int_load(&packed[v]), n);
            light(shade, n, to_eye, in, shine);
        }
        in[3] = sp_wide_all(1);
        sp_quad_transpose(in, lit);
        in[0] = shine[0];
        in[1] = shine[1];
        in[2] = shine[2];
        in[3] = sp_wide_all(0);
        sp_quad_transpose(in, shine);
        /* Element 4·L + k of the planes is part L of vector k. */
        for (int k = 0; k < 4; k++) {
            float factor[W], added[W];
            sp_wide_store(factor, lit[k]);
            sp_wide_store(added, shine[k]);
            for (int l = 0; l < PX; l++) {
                float *class = c->class[v + 4 * l + k].color;
                for (int a = 0; a < 3; a++)
                    class[a] = class[a] * factor[4 * l + a] + added[4 * l + a];
            }
        }
    }
}

void sp_postconv_add_run(struct sp_postconv_open_tile *t, const struct sp_postconv_run *run,
                         bool all) {
    struct run_frame r;
    start_run(t, run, all, &r);
    uint64_t first = r.list->first[t->postconv->bricks[run->brick].brick];
    bool has_table = r.transfer->table && !r.transfer->scale && !t->postconv->shade;
    uint32_t count = 0;
    for (uint64_t e = first + run->begin; e < first + run->end; e += CHUNK) {
        uint64_t left = first + run->end - e;
        struct chunk c;
        uint32_t inside =
            place_chunk(&r, t, r.list->place + e, left < CHUNK ? (uint32_t)left : CHUNK,
                        t->postconv->shade, &c);
        if (!inside)
            continue;
        mark(t, &c, inside);
        if (!has_table) {
            classify_chunk(t, &r, e, inside, &c);
            count += deposit_classes(t, &c, inside);
        } else if (t->group.has_cross) {
            count += deposit_chunk_across(t, &c, inside, &r, e);
        } else {
            count += deposit_chunk(t, &c, inside, &r, e);
        }
    }
    t->scratch->splats += count;
    t->scratch->fragments += count * (uint64_t)(t->group.area + 0.5f);
}

/* Adds one footprint to the layer's sum. */
static void add_footprint(struct sp_postconv_open_tile *t, const struct sp_splat *splat,
                          float cut) {
    int x0 = splat->x0 - t->x, y0 = splat->y0 - t->y, x1 = splat->x1 - t->x, y1 = splat->y1 - t->y;
    x0 = x0 < 0 ? 0 : x0 / BLOCK * BLOCK;
    y0 = y0 < 0 ? 0 : y0;
    x1 = x1 > POSTCONV_TILE ? POSTCONV_TILE : x1;
    y1 = y1 > POSTCONV_TILE ? POSTCONV_TILE : y1;
    if (x0 >= x1 || y0 >= y1)
        return;
    sp_quad sums = { splat->emission[0], splat->emission[1], splat->emission[2], splat->depth };
    sp_wide value = sp_quad_repeat(sums);
    uint32_t blocks = (UINT32_C(2) << (x1 - 1) / BLOCK) - (UINT32_C(1) << x0 / BLOCK);
    for (int y = y0; y < y1; y++) {
        float dy = (float)(y + t->y) + 0.5f - splat->y;
        for (int x = x0; x < x1; x += BLOCK)
            for (int p = 0; p < VECTORS; p++) {
                float left = (float)(x + p * PX + t->x) + 0.5f - splat->x;
                sp_wide dx = left + sp_wide_from_int(sp_wide_int_count() >> 2);
                sp_wide e = (splat->a * dx + splat->b * dy) * dx + splat->c * dy * dy;
                sp_wide weight = sp_wide_keep(sp_wide_le(e, sp_wide_all(cut)), sp_wide_exp2(-e));
                float *to = &t->scratch->sum[y][x][0] + p * W;
                sp_wide_store(to, sp_wide_load(to) + weight * value);
            }
        t->summed[y] |= blocks;
    }
    int right = splat->x < (float)(t->x + POSTCONV_TILE) && splat->x >= (float)t->x;
    if (right && splat->y < (float)(t->y + POSTCONV_TILE) && splat->y >= (float)t->y) {
        t->scratch->splats++;
        t->scratch->fragments += (uint64_t)(splat->area + 0.5f);
    }
}

/* Lists the entries of the brick that are not drawn yet, from *at on; at most `most`, a multiple of
 * CHUNK. */
static uint32_t list_entries(const struct run_frame *r, const struct sp_postconv_run *run,
                             uint64_t first, uint32_t *at, uint32_t most, uint16_t *entries) {
    uint32_t count = 0;
    for (; *at < run->end && count + CHUNK <= most; *at += CHUNK) {
        uint32_t left = run->end - *at, wanted = elements(left < CHUNK ? left : CHUNK), part = 0;
        for (int v = 0; v < CHUNK; v += W) {
            sp_wide u[3],
                inv = locate(r, sp_wide_int_pick(r->list->place + first + *at, chunk_order, v), u);
            part |= sp_wide_mask_bits(in_part(r, inv)) << v;
        }
        if (r->is_part)
            wanted &= part;
        for (; wanted; wanted &= wanted - 1)
            entries[count++] = (uint16_t)(*at + chunk_order[__builtin_ctz(wanted)]);
    }
    return count;
}

void sp_postconv_add_footprints(struct sp_postconv_open_tile *t,
                                const struct sp_postconv_run *run) {
    enum { COUNT = 4 * CHUNK };
    const struct sp_postconv_brick *b = &t->postconv->bricks[run->brick];
    const struct sp_level *level = sp_postconv_level(t->postconv, b);
    const struct sp_ewa_frame *ewa = sp_postconv_ewa(t->postconv, b);
    struct sp_splat splats[COUNT];
    struct sp_splats out = { .splat = splats };
    const struct sp_visible *list = &level->visible;
    uint16_t local[COUNT], entries[COUNT];
    struct sp_ewa_run r = { .list = list,
                            .local = local,
                            .transfer = &level->transfer,
                            .shade = t->postconv->shade,
                            .first = list->first[b->brick],
                            .order = entries,
                            .mode = (enum sp_filter_mode)b->mode };
    struct run_frame frame;
    start_run(t, run, true, &frame);
    sp_visible_brick_corner(list->bricks, b->brick, r.brick);
    /* Footprints may be wide. Few are drawn at a time, so that a cancelled frame ends soon. */
    for (uint32_t at = run->begin;
         at < run->end && !sp_interrupt_is_cancelled(&t->postconv->interrupt);) {
        r.count = list_entries(&frame, run, r.first, &at, COUNT, entries);
        sp_visible_locals(list, b->brick, entries, 0, r.count, local);
        uint32_t n = sp_ewa_set_up(ewa, &r, &out);
        for (uint32_t i = 0; i < n; i++)
            add_footprint(t, &splats[i], ewa->cut);
    }
}
