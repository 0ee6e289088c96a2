/* SPDX-License-Identifier: Apache-2.0
 *
 * One tile: where its rays cross the slices, which blocks may see something in which slab of
 * regions, and the slices front to back.
 */
#include <math.h>
#include <string.h>

#include "frame/resolve.h"
#include "resample/kernels.h"

enum { ALL_INTERVALS = (1 << SAMPLES_REGION) - 1 };

struct batch {
    uint64_t need[RESAMPLE_BATCH]; /* by sheet: blocks that sample it */
    uint64_t now[RESAMPLE_BATCH];  /* by sheet n: blocks that composite interval n − 2 */
};

/* Rays that go farther than this from slice to slice need a sheet between them: in samples, and in
 * distances of slices. */
static const double steep = 1.3;

/* u, v, du and dv of the ray through the tile's centre, in double precision, and how they change
 * from pixel to pixel: (x·right + y·down)/(1 + x·fall[0] + y·fall[1]). */
struct rays {
    double at[2], change[2];
    double right[2], down[2], fall[2];
    double lever; /* perspective: slices from the eye to s = 0; orthographic: 1 */
    double centre[2];
};

/* The direction of the ray (x, y) px from the image's centre [samples per unit of depth]. */
static void find_direction(const struct sp_resample *r, double x, double y, double out[3]) {
    for (int a = 0; a < 3; a++)
        out[a] = r->ray[a] + x * r->right[a] + y * r->down[a];
}

/* The axis to which the ray has the smallest angle, in world space. */
static int nearest_axis(const struct sp_resample *r, const double direction[3]) {
    int best = 0;
    for (int a = 1; a < 3; a++)
        if (fabs(direction[a]) * sqrt(r->metric[a]) >=
            fabs(direction[best]) * sqrt(r->metric[best]))
            best = a;
    return best;
}

static void set_axis(struct sp_resample_open_tile *t, int best, const double direction[3]) {
    const struct sp_samples *samples = t->r->samples;
    const size_t strides[3] = { 1, samples->dims[0], (size_t)samples->dims[0] * samples->dims[1] };
    const size_t turned[3] = { 1, samples->dims[1], (size_t)samples->dims[1] * samples->dims[2] };
    t->axis[0] = best == 0 ? 1 : 0;
    t->axis[1] = best == 2 ? 1 : 2;
    t->axis[2] = best;
    bool is_turned = best == 0 && samples->turned;
    t->voxels = is_turned ? samples->turned : samples->voxels;
    for (int a = 0; a < 3; a++) {
        t->stride[a] = is_turned ? turned[a] : strides[t->axis[a]];
        t->dims[a] = (int)samples->dims[t->axis[a]];
        t->map[a] = t->r->axes[t->axis[a]].place ? &t->r->axes[t->axis[a]] : NULL;
    }
    t->is_backwards = direction[best] < 0;
    t->reference = sp_resample_place(t, 0.5f * (float)(t->dims[2] - 1));
}

/* 1/cos of the angle between the ray and the slices' axis, in world space. */
static double slant(const struct sp_resample *r, const double direction[3], int axis) {
    const double *m = r->metric, *d = direction;
    double square = m[0] * d[0] * d[0] + m[1] * d[1] * d[1] + m[2] * d[2] * d[2] +
                    2 * (m[3] * d[1] * d[2] + m[4] * d[0] * d[2] + m[5] * d[0] * d[1]);
    return sqrt(square / (m[axis] * d[axis] * d[axis]));
}

static void init_rays(struct sp_resample_open_tile *t, struct rays *rays) {
    const struct sp_resample *r = t->r;
    bool is_perspective = r->camera->projection == SP_PERSPECTIVE;
    double direction[3], centre[3];
    rays->centre[0] = t->x + 0.5 * t->width;
    rays->centre[1] = t->y + 0.5 * t->height;
    double x = rays->centre[0] - r->camera->centre[0], y = rays->centre[1] - r->camera->centre[1];
    memcpy(direction, r->ray, sizeof direction);
    if (is_perspective)
        find_direction(r, x, y, direction);
    /* One axis for the whole image, so that there are no seams; but its own axis for a tile whose
     * rays would hardly cross those slices. */
    set_axis(t, r->axis, r->ray);
    if (slant(r, direction, t->axis[2]) > 2.5 || direction[t->axis[2]] * r->ray[t->axis[2]] <= 0)
        set_axis(t, nearest_axis(r, direction), direction);
    const int *axis = t->axis;
    double forward = direction[axis[2]], sign = t->is_backwards ? -1 : 1;
    for (int a = 0; a < 3; a++)
        centre[a] = is_perspective ? r->eye[a] : r->start[a] + x * r->right[a] + y * r->down[a];
    double ahead = (double)t->reference - centre[axis[2]]; /* slices from the start to s = 0 */
    for (int a = 0; a < 2; a++) {
        rays->change[a] = direction[axis[a]] / forward;
        rays->at[a] = centre[axis[a]] + ahead * rays->change[a];
        rays->right[a] = r->right[axis[a]] - r->right[axis[2]] * rays->change[a];
        rays->down[a] = r->down[axis[a]] - r->down[axis[2]] * rays->change[a];
        if (is_perspective) {
            rays->right[a] /= forward;
            rays->down[a] /= forward;
        }
        rays->change[a] *= sign;
    }
    rays->fall[0] = is_perspective ? r->right[axis[2]] / forward : 0;
    rays->fall[1] = is_perspective ? r->down[axis[2]] / forward : 0;
    rays->lever = is_perspective ? ahead : 1;
    double speed = sqrt(1 + rays->change[0] * rays->change[0] + rays->change[1] * rays->change[1]);
    bool is_steep = speed > steep || slant(r, direction, axis[2]) > steep;
    t->sheets_per_slice = is_steep || r->is_fine ? 2 : 1;
}

/* Keeps the part of SP_WIDE rays inside a half space. */
static inline void cut_rays(const struct sp_resample_open_tile *t,
                            const struct sp_resample_half *half, const sp_wide at[4],
                            sp_wide *begin, sp_wide *end) {
    const sp_wide zero = sp_wide_all(0), far = sp_wide_all(1e9f);
    float n[3];
    for (int a = 0; a < 3; a++)
        n[a] = (float)half->normal[t->axis[a]];
    sp_wide rise = n[0] * at[2] + n[1] * at[3] + (t->is_backwards ? -n[2] : n[2]);
    sp_wide gap = (float)(half->offset - half->normal[t->axis[2]] * (double)t->reference) -
                  (n[0] * at[0] + n[1] * at[1]);
    sp_wide s = gap / rise;
    sp_wide_mask rises = sp_wide_lt(zero, rise), falls = sp_wide_lt(rise, zero);
    *begin = sp_wide_select(rises, sp_wide_max(*begin, s), *begin);
    *end = sp_wide_select(falls, sp_wide_min(*end, s), *end);
    sp_wide_mask is_outside = ~(rises | falls) & sp_wide_lt(zero, gap);
    *end = sp_wide_select(is_outside, -far, *end);
}

static void init_pixels(const struct sp_resample_open_tile *t, const struct rays *rays,
                        struct sp_resample_block *block, const int at[2], int i) {
    const struct sp_resample *r = t->r;
    const double *m = r->metric;
    const int *axis = t->axis;
    sp_wide x = sp_wide_from_int((sp_wide_int_count() + i) & (RESAMPLE_BLOCK - 1));
    sp_wide y = sp_wide_from_int((sp_wide_int_count() + i) >> 3);
    x += (float)(t->x + at[0] + 0.5 - rays->centre[0]);
    y += (float)(t->y + at[1] + 0.5 - rays->centre[1]);
    sp_wide fall = 1 + x * (float)rays->fall[0] + y * (float)rays->fall[1];
    sp_wide inverse = 1 / sp_wide_max(fall, sp_wide_all(0.05f));
    sp_wide place[4];
    bool is_perspective = r->camera->projection == SP_PERSPECTIVE;
    for (int a = 0; a < 2; a++) {
        sp_wide moved = (x * (float)rays->right[a] + y * (float)rays->down[a]) * inverse;
        place[a] = (float)rays->at[a] + moved * (float)rays->lever;
        place[a + 2] = sp_wide_all((float)rays->change[a]);
        if (is_perspective)
            place[a + 2] += t->is_backwards ? -moved : moved;
    }
    sp_wide begin = sp_wide_all(-1e9f), end = sp_wide_all(1e9f);
    for (uint32_t h = 0; h < r->half_count; h++)
        cut_rays(t, &r->halves[h], place, &begin, &end);
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
}

/* Returns false if no ray of the block meets the volume. */
static bool init_block(const struct sp_resample_open_tile *t, const struct rays *rays,
                       struct sp_resample_block *block, const int at[2]) {
    static const int corners[4] = { 0, RESAMPLE_BLOCK - 1, RESAMPLE_PIXELS - RESAMPLE_BLOCK,
                                    RESAMPLE_PIXELS - 1 };
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE)
        init_pixels(t, rays, block, at, i);
    block->inside[0] = -INFINITY;
    block->inside[1] = INFINITY;
    block->span[0] = INFINITY;
    block->span[1] = -INFINITY;
    for (int i = 0; i < RESAMPLE_PIXELS; i++) {
        float begin = block->begin[i], end = block->end[i];
        block->light[i] = 1;
        for (int c = 0; c < 3; c++)
            block->color[c][i] = 0;
        block->inside[0] = begin > block->inside[0] ? begin : block->inside[0];
        block->inside[1] = end < block->inside[1] ? end : block->inside[1];
        if (begin < end) {
            block->span[0] = begin < block->span[0] ? begin : block->span[0];
            block->span[1] = end > block->span[1] ? end : block->span[1];
        }
    }
    for (int i = 0; i < 4; i++) {
        block->corner[i][0] = block->u[corners[i]];
        block->corner[i][1] = block->v[corners[i]];
        block->corner[i][2] = block->du[corners[i]];
        block->corner[i][3] = block->dv[corners[i]];
    }
    return block->span[0] < block->span[1];
}

static uint32_t region_at(float sample, uint32_t regions) {
    if (!(sample > 0))
        return 0;
    uint32_t i = (uint32_t)sample / SAMPLES_REGION;
    return i < regions ? i : regions - 1;
}

/* The intervals of slab `slab` of regions in which the block may see something, as bits. */
static unsigned sees(const struct sp_resample_open_tile *t, const struct sp_resample_block *block,
                     uint32_t slab) {
    const struct sp_samples *samples = t->r->samples;
    const uint32_t *regions = samples->regions;
    float near = (float)(slab * SAMPLES_REGION), far = near + SAMPLES_REGION;
    if (slab == 0)
        near = -1;
    if (slab + 1 == regions[t->axis[2]])
        far = (float)t->dims[2];
    float s[2] = { sp_resample_s(t, t->is_backwards ? far : near),
                   sp_resample_s(t, t->is_backwards ? near : far) };
    if (s[1] <= block->span[0] || s[0] >= block->span[1])
        return 0;
    s[0] = fmaxf(s[0], block->span[0]);
    s[1] = fminf(s[1], block->span[1]);
    float min[2][2], max[2][2];
    uint32_t low[2], high[2];
    for (int k = 0; k < 2; k++)
        sp_resample_extent(t, block, s[k], min[k], max[k]);
    for (int a = 0; a < 2; a++) {
        low[a] = region_at(fminf(min[0][a], min[1][a]), regions[t->axis[a]]);
        high[a] = region_at(fmaxf(max[0][a], max[1][a]), regions[t->axis[a]]);
    }
    const size_t strides[3] = { 1, regions[0], (size_t)regions[0] * regions[1] };
    const uint8_t *visible = t->r->class->visible + slab * strides[t->axis[2]];
    unsigned seen = 0;
    for (uint32_t j = low[1]; j <= high[1]; j++)
        for (uint32_t i = low[0]; i <= high[0]; i++)
            seen |= visible[i * strides[t->axis[0]] + j * strides[t->axis[1]]];
    /* The bits are for the axis of most tiles. */
    return seen && (unsigned)t->axis[2] != t->r->class->axis ? ALL_INTERVALS : seen;
}

/* Interval n lies between sheets n and n + 1. */
static uint64_t active_at(const struct sp_resample_open_tile *t, int n, int count) {
    if (n < 1 || n >= count)
        return 0;
    int last = (int)t->r->samples->regions[t->axis[2]] * SAMPLES_REGION - 1;
    int i = (int)floorf(0.5f * (sp_resample_slice(t, n) + sp_resample_slice(t, n + 1)));
    return t->scratch->active[i < 0 ? 0 : i < last ? i : last];
}

/* Blocks that need sheet n: those of the two intervals before it and of the two behind it. */
static uint64_t need_of(const struct sp_resample_open_tile *t, int n, int count) {
    return t->alive & (active_at(t, n - 2, count) | active_at(t, n - 1, count) |
                       active_at(t, n, count) | active_at(t, n + 1, count));
}

/* Draws sheets `first` to `last` in a block: interval n − 2 can be composited when sheet n is
 * there. */
static void draw_block(struct sp_resample_open_tile *t, int b, int first, int last,
                       const struct batch *batch) {
    const int at[2] = { b % RESAMPLE_ACROSS_MAX * RESAMPLE_BLOCK,
                        b / RESAMPLE_ACROSS_MAX * RESAMPLE_BLOCK };
    struct sp_resample_block *block = &t->scratch->blocks[b];
    for (int n = first; n <= last; n++) {
        if (batch->need[n - first] >> b & 1)
            sp_resample_sample(t, block, n);
        if (batch->now[n - first] >> b & 1 && !sp_resample_integrate(t, block, n - 2, at)) {
            t->alive &= ~(UINT64_C(1) << b);
            return;
        }
    }
}

/* Sheets from two slices before the first one to two slices behind the last one, which equal it. A
 * few are drawn at a time in each block, whose state then stays in the nearest cache. */
static void draw_sheets(struct sp_resample_open_tile *t) {
    int count = (t->dims[2] + 2) * t->sheets_per_slice; /* intervals; number 0 is empty */
    for (int first = 0; first <= count + 1 && t->alive; first += RESAMPLE_BATCH) {
        int last = first + RESAMPLE_BATCH - 1 < count + 1 ? first + RESAMPLE_BATCH - 1 : count + 1;
        struct batch batch;
        uint64_t any = 0;
        if (sp_interrupt_is_cancelled(&t->r->interrupt))
            return;
        for (int n = first; n <= last; n++) {
            struct sp_resample_sheet *sheet = &t->scratch->sheets[n % RESAMPLE_SHEETS];
            uint64_t need = need_of(t, n, count);
            batch.need[n - first] = need;
            batch.now[n - first] = t->alive & active_at(t, n - 2, count);
            any |= need;
            sheet->s = sp_resample_sheet_s(t, n);
            if (need)
                sp_resample_refine(t, sheet, need, sp_resample_slice(t, n));
        }
        for (uint64_t left = any; left; left &= left - 1)
            draw_block(t, __builtin_ctzll(left), first, last, &batch);
    }
}

static void resolve(const struct sp_resample_open_tile *t, uint64_t drawn) {
    struct sp_frame *frame = t->r->frame;
    const float *background = t->r->view->background;
    _Alignas(64) float row[4][RESAMPLE_TILE];
    const float *const planes[4] = { row[0], row[1], row[2], row[3] };
    for (int y = 0; y < t->height; y++) {
        unsigned char *out =
            (unsigned char *)frame->pixels + (size_t)(t->y + y) * frame->stride_bytes;
        for (int x = 0; x < t->width; x++) {
            int b = y / RESAMPLE_BLOCK * RESAMPLE_ACROSS_MAX + x / RESAMPLE_BLOCK;
            int i = y % RESAMPLE_BLOCK * RESAMPLE_BLOCK + x % RESAMPLE_BLOCK;
            const struct sp_resample_block *block = &t->scratch->blocks[b];
            bool is_drawn = drawn >> b & 1;
            row[0][x] = is_drawn ? block->light[i] : 1;
            for (int c = 0; c < 3; c++)
                row[c + 1][x] = is_drawn ? block->color[c][i] : 0;
        }
        if (frame->format == SP_RGBA8)
            sp_resolve_rgba8(planes, (uint32_t)t->width, background, out + 4 * (size_t)t->x);
        else
            sp_resolve_rgbaf32(planes, (uint32_t)t->width, background,
                               (float *)(void *)out + 4 * (size_t)t->x);
    }
}

/* The corners and the span of a set of blocks. */
static void join_blocks(const struct sp_resample_open_tile *t, uint64_t set,
                        struct sp_resample_block *all) {
    const struct sp_resample_block *blocks = t->scratch->blocks;
    int first[2] = { RESAMPLE_ACROSS_MAX, RESAMPLE_ACROSS_MAX }, last[2] = { 0, 0 };
    all->span[0] = INFINITY;
    all->span[1] = -INFINITY;
    for (uint64_t left = set; left; left &= left - 1) {
        int b = __builtin_ctzll(left);
        const int at[2] = { b % RESAMPLE_ACROSS_MAX, b / RESAMPLE_ACROSS_MAX };
        for (int a = 0; a < 2; a++) {
            first[a] = at[a] < first[a] ? at[a] : first[a];
            last[a] = at[a] > last[a] ? at[a] : last[a];
        }
        all->span[0] = fminf(all->span[0], blocks[b].span[0]);
        all->span[1] = fmaxf(all->span[1], blocks[b].span[1]);
    }
    for (int i = 0; set && i < 4; i++) {
        int b = (i & 1 ? last[0] : first[0]) + (i & 2 ? last[1] : first[1]) * RESAMPLE_ACROSS_MAX;
        memcpy(all->corner[i], blocks[b].corner[i], sizeof all->corner[i]);
    }
}

/* Fills `active` and returns the blocks that may see something. */
static uint64_t find_active(const struct sp_resample_open_tile *t) {
    struct sp_resample_block all;
    uint64_t any = 0;
    join_blocks(t, t->alive, &all);
    for (uint32_t s = 0; s < t->r->samples->regions[t->axis[2]]; s++) {
        uint64_t *active = t->scratch->active + (size_t)s * SAMPLES_REGION;
        memset(active, 0, SAMPLES_REGION * sizeof *active);
        for (uint64_t left = sees(t, &all, s) ? t->alive : 0; left; left &= left - 1) {
            unsigned seen = sees(t, &t->scratch->blocks[__builtin_ctzll(left)], s);
            for (int k = 0; k < SAMPLES_REGION; k++)
                active[k] |= seen >> k & 1 ? left & -left : 0;
            any |= seen ? left & -left : 0;
        }
    }
    return any;
}

/* Does the memory hold what a set of blocks sees of a sheet? The extent of straight rays is largest
 * at one of their ends. */
static bool fits(const struct sp_resample_open_tile *t, uint64_t set) {
    struct sp_resample_block all;
    size_t refined = 1;
    join_blocks(t, set, &all);
    float margin = t->map[2] ? 3 * t->map[2]->widest : 3; /* sheets are read beyond the span */
    for (int a = 0; a < 2; a++) {
        float extent = 0;
        for (int k = 0; k < 2; k++) {
            float s = all.span[k] + (k ? margin : -margin), low = INFINITY, high = -INFINITY;
            for (int i = 0; i < 4; i++) {
                float at = all.corner[i][a] + s * all.corner[i][a + 2];
                low = fminf(low, at);
                high = fmaxf(high, at);
            }
            extent = fmaxf(extent, t->map[a] ? (high - low) / t->map[a]->narrowest : high - low);
        }
        refined *= 2 * (size_t)(fminf(extent, (float)t->dims[a]) + 4 * RESAMPLE_CELL_ACROSS);
    }
    return refined <= t->r->refined_max;
}

/* Draws a set of blocks, in parts if need be. */
static void draw_blocks(struct sp_resample_open_tile *t, uint64_t set) {
    uint64_t part = set;
    if (!set)
        return;
    if (fits(t, set)) {
        t->alive = set;
        draw_sheets(t);
        return;
    }
    for (int i = __builtin_popcountll(set) / 2; i > 0; i--)
        part &= part - 1;
    if (part == set) {
        t->scratch->is_too_wide = true;
        return;
    }
    draw_blocks(t, set & ~part);
    draw_blocks(t, part);
}

/* Draws a square of the tile. A wide view's rays may differ so much that some never cross the
 * slices which the middle one crosses; then in four parts. */
static void draw_square(const struct sp_resample *r, struct sp_resample_scratch *scratch, int x,
                        int y, int side) {
    int right = (int)r->frame->width - x, below = (int)r->frame->height - y;
    struct sp_resample_open_tile t = { .r = r,
                                       .scratch = scratch,
                                       .x = x,
                                       .y = y,
                                       .width = right < side ? right : side,
                                       .height = below < side ? below : side };
    struct rays rays;
    if (right <= 0 || below <= 0)
        return;
    init_rays(&t, &rays);
    if (fabs(rays.fall[0]) * t.width + fabs(rays.fall[1]) * t.height > 1.7 &&
        side > RESAMPLE_BLOCK) {
        for (int i = 0; i < 4; i++)
            draw_square(r, scratch, x + (i & 1) * side / 2, y + (i >> 1) * side / 2, side / 2);
        return;
    }
    for (int v = 0; v < t.height; v += RESAMPLE_BLOCK)
        for (int u = 0; u < t.width; u += RESAMPLE_BLOCK) {
            int b = v / RESAMPLE_BLOCK * RESAMPLE_ACROSS_MAX + u / RESAMPLE_BLOCK;
            if (init_block(&t, &rays, &scratch->blocks[b], (const int[2]){ u, v }))
                t.alive |= UINT64_C(1) << b;
        }
    uint64_t drawn = find_active(&t);
    draw_blocks(&t, drawn);
    resolve(&t, drawn);
}

void sp_resample_tile(const struct sp_resample *r, struct sp_resample_scratch *scratch,
                      uint32_t number) {
    draw_square(r, scratch, (int)number % r->columns * RESAMPLE_TILE,
                (int)number / r->columns * RESAMPLE_TILE, RESAMPLE_TILE);
}
