/* SPDX-License-Identifier: Apache-2.0
 *
 * The slabs of a tile, front to back: each layer is deposited once, and a slab is filtered when all
 * sheets that reach into it are there (slab.h).
 */
#include <math.h>

#include "draw/postconv/slab.h"
#include "draw/postconv/tile.h"

struct slabs {
    struct sp_postconv_open_tile *tile;
    struct sp_slab_tile constants;
    struct sp_slab_sheet *sheets; /* by layer modulo `slots` */
    int slots;                    /* as few as needed, which stay in the cache */
    struct sp_postconv_filter filter[2];
    int open; /* layers to begin until the last sheet is out of reach */
};

static struct sp_slab_sheet *sheet_of(const struct slabs *s, int layer) {
    return &s->sheets[(layer + s->slots) % s->slots];
}

static bool is_empty(const struct sp_slab_sheet *sheet) {
    return sheet->row0 >= sheet->row1;
}

static void clear_sheet(struct sp_slab_sheet *sheet) {
    for (int y = sheet->row0; y < sheet->row1; y++) {
        for (uint32_t m = sheet->deposited[y]; m; m &= m - 1)
            memset(sheet->grid[y][__builtin_ctz(m) * BLOCK], 0, BLOCK * 16);
        sheet->deposited[y] = 0;
    }
    sheet->row0 = POSTCONV_GRID;
    sheet->row1 = 0;
}

/* Takes the tile's deposits for a sheet, and leaves its own samples, which are zero. */
static void take_deposits(struct sp_postconv_open_tile *t, struct sp_slab_sheet *sheet) {
    float(*grid)[POSTCONV_PITCH][4] = sheet->grid;
    sheet->grid = t->scratch->grid;
    t->scratch->grid = grid;
    sheet->row0 = t->row0;
    sheet->row1 = t->row1;
    for (int y = t->row0; y < t->row1; y++) {
        sheet->deposited[y] = t->deposited[y];
        t->deposited[y] = 0;
    }
    t->row0 = POSTCONV_GRID;
    t->row1 = 0;
}

/* The largest integer that is not above x, and the rest in steps that deposits can tell apart. */
static int split(double x, float *part) {
    int whole = (int)floor(x);
    *part = (float)(int)((x - whole) * POSTCONV_PHASES) / POSTCONV_PHASES;
    return whole;
}

/* Deposits the runs of a layer into its sheet. */
static void deposit_runs(const struct slabs *s, struct sp_slab_sheet *sheet,
                         const struct sp_postconv_run *runs, uint32_t count) {
    struct sp_postconv_open_tile *t = s->tile;
    struct sp_postconv_group *g = &t->group;
    *g = sheet->layer.group;
    for (int a = 0; a < 2; a++) {
        float part;
        split(sheet->place[a], &part);
        g->offset[a] -= part;
        g->end[a] -= part;
    }
    sp_postconv_find_wanted(t);
    for (uint32_t i = 0; i < count && !sp_interrupt_is_cancelled(&t->postconv->interrupt); i++)
        sp_postconv_add_run(t, &runs[i], true);
    take_deposits(t, sheet);
}

static int count_layers(const struct sp_postconv *postconv) {
    int slices = postconv->slab_slices;
    return ((int)postconv->layers + slices - 1) / slices;
}

/* Begins a layer. Returns false if nothing is open and the layer is empty. */
static bool start_layer(struct slabs *s, int layer) {
    struct sp_postconv_open_tile *t = s->tile;
    struct sp_slab_sheet *sheet = sheet_of(s, layer), *last = sheet_of(s, layer - 1);
    int layers = count_layers(t->postconv), place = layer < layers ? layer : layers - 1;
    uint32_t count = 0;
    struct sp_postconv_run *runs = NULL;
    clear_sheet(sheet);
    if (layer < layers) {
        runs = t->scratch->runs + t->scratch->starts[layer];
        count = sp_postconv_sift(t, runs, t->scratch->ends[layer] - t->scratch->starts[layer]);
    }
    bool is_first = count && !s->open;
    const int reach = s->constants.reach;
    s->open = count ? 2 * reach + 1 : s->open - (s->open > 0);
    if (!s->open)
        return false;
    float w = sp_slab_layer_place(t->postconv, &s->constants, (uint32_t)place);
    if (!sp_slab_layer_init(t->postconv, &s->constants, w, &sheet->layer))
        sp_slab_layer_init(t->postconv, &s->constants, s->constants.range[0], &sheet->layer);
    for (int a = 0; a < 2; a++)
        sheet->place[a] =
            is_first ? 0 : last->place[a] + 0.5 * (last->layer.step[a] + sheet->layer.step[a]);
    for (int j = 1; is_first && j <= reach + 1; j++) { /* its kernels reach before it */
        struct sp_slab_sheet *before = sheet_of(s, layer - j);
        before->layer = sheet->layer;
        for (int a = 0; a < 2; a++)
            before->place[a] = -j * sheet->layer.step[a];
    }
    if (count)
        deposit_runs(s, sheet, runs, count);
    return true;
}

/* A sheet as a slab reads it. */
struct source {
    const struct sp_slab_sheet *sheet;
    float share;
    int shift[2]; /* columns and rows */
};

/* The blocks whose samples, moved by `shift` columns, touch blocks that are not zero. */
static inline uint32_t move_blocks(uint32_t blocks, int shift) {
    int whole = shift >= 0 ? shift / BLOCK : -((BLOCK - 1 - shift) / BLOCK);
    uint32_t first = whole >= 0 ? blocks >> whole : blocks << -whole;
    if (shift == whole * BLOCK)
        return first;
    return first | (whole >= -1 ? blocks >> (whole + 1) : blocks << -(whole + 1));
}

/* The blocks that can be read with this shift. */
static inline uint32_t readable(int shift) {
    int first = shift < 0 ? (BLOCK - 1 - shift) / BLOCK : 0;
    int last = (POSTCONV_PITCH - BLOCK - shift) / BLOCK;
    last = last < POSTCONV_GRID / BLOCK ? last : POSTCONV_GRID / BLOCK - 1;
    return (UINT32_C(2) << last) - (UINT32_C(1) << first);
}

/* Finds the sheets that reach into a slab around `place` [samples]. */
static int find_sources(const struct slabs *s, int layer, const float share[SLAB_SLOTS],
                        const int place[2], struct source from[SLAB_SLOTS]) {
    int count = 0;
    int reach = sheet_of(s, layer)->layer.reach;
    for (int j = -reach; j <= reach; j++) {
        const struct sp_slab_sheet *sheet = sheet_of(s, layer + j);
        struct source *source = &from[count];
        if (is_empty(sheet))
            continue;
        *source = (struct source){ .sheet = sheet, .share = share[j + reach] };
        for (int a = 0; a < 2; a++) {
            float part;
            source->shift[a] = split(sheet->place[a], &part) - place[a];
        }
        count++;
    }
    return count;
}

/* Rows of sheets that are added. */
struct rows {
    const float *grid[SLAB_SLOTS];
    ptrdiff_t first[SLAB_SLOTS]; /* of block 0 [floats]; it may lie outside of the grid */
    float share[SLAB_SLOTS];
};

/* Adds the rows' shares, for some blocks. */
static inline void add_rows(const struct rows *rows, int count, uint32_t blocks, float *to) {
    for (; blocks; blocks &= blocks - 1) {
        int at = __builtin_ctz(blocks) * BLOCK * 4;
        sp_wide sum[VECTORS];
        for (int p = 0; p < VECTORS; p++)
            sum[p] = sp_wide_load(rows->grid[0] + (rows->first[0] + at + p * W)) * rows->share[0];
        for (int i = 1; i < count; i++)
            for (int p = 0; p < VECTORS; p++)
                sum[p] +=
                    sp_wide_load(rows->grid[i] + (rows->first[i] + at + p * W)) * rows->share[i];
        for (int p = 0; p < VECTORS; p++)
            sp_wide_store(to + at + p * W, sum[p]);
    }
}

/* Adds the sheets' shares of a slab to the tile's samples. */
static void combine(struct sp_postconv_open_tile *t, const struct source *from, int count) {
    const struct sp_postconv_group *g = &t->group;
    int reach[2];
    for (int a = 0; a < 2; a++)
        reach[a] = g->filter[a]->taps + (g->diagonal ? g->diagonal->taps : 0) + 2;
    int left = ORIGIN - reach[0], right = ORIGIN + (POSTCONV_TILE >> g->scale[0]) + reach[0];
    int low = ORIGIN - reach[1], high = ORIGIN + (POSTCONV_TILE >> g->scale[1]) + reach[1] + 1;
    left = left < 0 ? 0 : left;
    right = right < POSTCONV_GRID ? right : POSTCONV_GRID - 1;
    const uint32_t needed = (UINT32_C(2) << right / BLOCK) - (UINT32_C(1) << left / BLOCK);
    t->row0 = POSTCONV_GRID;
    t->row1 = 0;
    for (int y = low < 0 ? 0 : low; y < high && y < POSTCONV_GRID; y++) {
        struct rows rows;
        uint32_t all = 0, can = needed & (t->has_dead ? t->wanted[y / BLOCK] : UINT32_MAX);
        int n = 0;
        for (int i = 0; i < count && can; i++) {
            int row = y + from[i].shift[1];
            if (row < from[i].sheet->row0 || row >= from[i].sheet->row1 ||
                !from[i].sheet->deposited[row])
                continue;
            uint32_t read = readable(from[i].shift[0]);
            all |= move_blocks(from[i].sheet->deposited[row], from[i].shift[0]) & read;
            can &= read;
            rows.grid[n] = (const float *)from[i].sheet->grid;
            rows.first[n] = ((ptrdiff_t)row * POSTCONV_PITCH + from[i].shift[0]) * 4;
            rows.share[n++] = from[i].share;
        }
        all &= can;
        t->deposited[y] = all;
        if (!all)
            continue;
        switch (n) { /* counts that the compiler knows */
        case 1:
            add_rows(&rows, 1, all, t->scratch->grid[y][0]);
            break;
        case 3:
            add_rows(&rows, 3, all, t->scratch->grid[y][0]);
            break;
        case 5:
            add_rows(&rows, 5, all, t->scratch->grid[y][0]);
            break;
        default:
            add_rows(&rows, n, all, t->scratch->grid[y][0]);
        }
        t->row0 = y < t->row0 ? y : t->row0;
        t->row1 = y + 1;
    }
}

/* Composites the slabs of a layer; all sheets that reach into it are there. */
static void draw_layer(struct slabs *s, int layer) {
    struct sp_postconv_open_tile *t = s->tile;
    const struct sp_slab_sheet *sheet = sheet_of(s, layer);
    const struct sp_slab_layer *l = &sheet->layer;
    int parts = t->postconv->slab_parts;
    for (int k = 0; k < parts; k++) {
        struct source from[SLAB_SLOTS];
        int place[2];
        t->group = l->group;
        t->layer = layer * parts + k;
        for (int a = 0; a < 2; a++) {
            double middle = ((k + 0.5) / parts - 0.5) * l->step[a];
            float part;
            place[a] = split(sheet->place[a] + middle, &part);
            t->group.part[a] = l->group.scale[a] ? part : 0;
            if (l->group.scale[a])
                continue;
            sp_slab_filter_init(t->postconv, &l->group, a, part, &s->filter[a]);
            t->group.filter[a] = &s->filter[a];
        }
        int count = find_sources(s, layer, l->share[k], place, from);
        if (!count)
            continue;
        sp_postconv_find_wanted(t);
        combine(t, from, count);
        if (t->row0 >= t->row1)
            continue;
        sp_postconv_start_filters(t);
        sp_postconv_close_group(t, true);
    }
    if (++t->closed % CHECK_EVERY == 0)
        sp_postconv_check_cells(t);
}

void sp_postconv_draw_slabs(struct sp_postconv_open_tile *t, uint32_t number) {
    struct slabs s = { .tile = t, .sheets = t->scratch->sheets };
    if (!sp_slab_tile_init(t->postconv, number, &s.constants))
        return;
    const int reach = s.constants.reach, last = count_layers(t->postconv) - 1 + 2 * reach;
    s.slots = 2 * reach + 2;
    for (int l = 0; l <= last && t->alive; l++) {
        if (sp_interrupt_is_cancelled(&t->postconv->interrupt))
            break;
        if (start_layer(&s, l))
            draw_layer(&s, l - reach);
    }
    for (int i = 0; i < s.slots; i++)
        clear_sheet(&s.sheets[i]);
}
