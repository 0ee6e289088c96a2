/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/shell/masks.h"

#include <stdlib.h>
#include <string.h>

#include "classify/gradient.h"
#include "data/volume/sample.h"

static uint32_t parts(uint32_t n, uint32_t size) {
    return (n + size - 1) / size;
}

static uint64_t word_count(const uint32_t dims[3]) {
    return (uint64_t)parts(dims[0], SP_SHELL_WORD) * dims[1] * dims[2];
}

static uint64_t block_count(const uint32_t dims[3]) {
    return (uint64_t)parts(dims[0], SP_SHELL_WORD) * parts(dims[1], SP_SHELL_SIDE) *
           parts(dims[2], SP_SHELL_SIDE);
}

uint64_t sp_shell_masks_bytes(const uint32_t dims[3]) {
    return 2 * word_count(dims) * sizeof(uint64_t) +
           block_count(dims) * sizeof(struct sp_shell_range);
}

bool sp_shell_masks_init(struct sp_shell_masks *masks, const uint32_t dims[3],
                         struct sp_error *err) {
    *masks = (struct sp_shell_masks){ .dims = { dims[0], dims[1], dims[2] },
                                      .words = parts(dims[0], SP_SHELL_WORD),
                                      .sides = { parts(dims[1], SP_SHELL_SIDE),
                                                 parts(dims[2], SP_SHELL_SIDE) } };
    masks->ranges = malloc(block_count(dims) * sizeof *masks->ranges);
    for (int i = 0; i < 2; i++)
        masks->bits[i] = calloc(word_count(dims), sizeof *masks->bits[i]);
    if (masks->ranges && masks->bits[0] && masks->bits[1])
        return true;
    sp_shell_masks_finish(masks);
    return sp_fail(err, SP_ERR_MEMORY, "/layers", "out of memory for the shell's masks: %llu bytes",
                   (unsigned long long)sp_shell_masks_bytes(dims));
}

void sp_shell_masks_finish(struct sp_shell_masks *masks) {
    free(masks->ranges);
    free(masks->bits[0]);
    free(masks->bits[1]);
    *masks = (struct sp_shell_masks){ 0 };
}

struct pass {
    struct sp_shell_masks *masks;
    const void *voxels;
    enum sp_type type;
    const struct sp_shell_states *from, *to;
    struct sp_gradient_grid gradient; /* only with a gradient axis */
    uint8_t *changed;
    const struct sp_interrupt *interrupt;
};

static void init_pass(struct pass *pass, struct sp_shell_masks *masks,
                      const struct sp_volume *volume, const struct sp_interrupt *interrupt) {
    *pass = (struct pass){ .masks = masks,
                           .voxels = sp_volume_voxels(volume),
                           .type = sp_volume_info(volume)->type,
                           .interrupt = interrupt };
    sp_gradient_grid_init(&pass->gradient, volume);
}

/* The voxels of block (w, j, k): [begin, end) per axis. */
struct extent {
    uint32_t begin[3], end[3];
};

static struct extent compute_extent(const struct sp_shell_masks *m, uint32_t w, uint32_t j,
                                    uint32_t k) {
    struct extent e = { .begin = { w * SP_SHELL_WORD, j * SP_SHELL_SIDE, k * SP_SHELL_SIDE } };
    for (int a = 0; a < 3; a++) {
        uint32_t left = m->dims[a] - e.begin[a], size = a ? SP_SHELL_SIDE : SP_SHELL_WORD;
        e.end[a] = e.begin[a] + (left < size ? left : size);
    }
    return e;
}

static uint64_t row_start(const struct sp_shell_masks *m, uint32_t x, uint32_t y, uint32_t z) {
    return ((uint64_t)z * m->dims[1] + y) * m->dims[0] + x;
}

#define MEASURE(type)                                                                              \
    do {                                                                                           \
        const type *row = (const type *)voxels + at;                                               \
        type least = row[0], most = row[0];                                                        \
        for (uint32_t i = 1; i < count; i++) {                                                     \
            least = row[i] < least ? row[i] : least;                                               \
            most = row[i] > most ? row[i] : most;                                                  \
        }                                                                                          \
        range->low = fminf(range->low, (float)least);                                              \
        range->high = fmaxf(range->high, (float)most);                                             \
    } while (0)

static void measure_reals(const void *voxels, enum sp_type type, uint64_t at, uint32_t count,
                          struct sp_shell_range *range) {
    for (uint32_t i = 0; i < count; i++) {
        double x = sp_sample(voxels, type, at + i);
        float low = (float)x, high = low;
        if (!isfinite(x)) {
            range->has_nonfinite = 1;
            continue;
        }
        if ((double)low > x)
            low = nextafterf(low, -INFINITY);
        if ((double)high < x)
            high = nextafterf(high, INFINITY);
        range->low = fminf(range->low, low);
        range->high = fmaxf(range->high, high);
    }
}

/* Joins `count` samples of a row to a range. */
static void measure_row(const void *voxels, enum sp_type type, uint64_t at, uint32_t count,
                        struct sp_shell_range *range) {
    switch (type) {
        SP_SHORT_CASES(MEASURE)
    default:
        measure_reals(voxels, type, at, count, range);
    }
}

static void measure_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    const struct pass *pass = user;
    struct sp_shell_masks *m = pass->masks;
    (void)worker;
    for (size_t n = begin; n < end && !sp_interrupt_is_cancelled(pass->interrupt); n++)
        for (uint32_t w = 0; w < m->words; w++) {
            struct extent e =
                compute_extent(m, w, (uint32_t)(n % m->sides[0]), (uint32_t)(n / m->sides[0]));
            struct sp_shell_range range = { INFINITY, -INFINITY, 0 };
            for (uint32_t z = e.begin[2]; z < e.end[2]; z++)
                for (uint32_t y = e.begin[1]; y < e.end[1]; y++)
                    measure_row(pass->voxels, pass->type, row_start(m, e.begin[0], y, z),
                                e.end[0] - e.begin[0], &range);
            m->ranges[n * m->words + w] = range;
        }
}

void sp_shell_masks_measure(struct sp_shell_masks *masks, const struct sp_volume *volume,
                            struct sp_pool *pool, const struct sp_interrupt *interrupt) {
    struct pass pass;
    init_pass(&pass, masks, volume, interrupt);
    sp_parallel_for(pool, (size_t)masks->sides[0] * masks->sides[1], 4, measure_blocks, &pass);
}

#define LOOK_UP(type)                                                                              \
    for (uint32_t i = 0; i < count; i++)                                                           \
    state[i] = table[((const type *)voxels)[at + i] - first]

/* The state of a voxel by its own value and gradient. */
static uint8_t state_of_voxel(const struct pass *pass, uint64_t at, const uint32_t i[3]) {
    const struct sp_transfer *transfer = pass->to->transfer;
    struct sp_class c = sp_transfer_value_class(transfer, sp_sample(pass->voxels, pass->type, at));
    if (transfer->scale && c.depth > 0 && sp_shell_state(pass->to, c.depth)) {
        double gradient[3];
        sp_gradient_at(&pass->gradient, i, gradient);
        c = sp_transfer_scale_class(transfer, c, sp_gradient_pack(&pass->gradient, gradient));
    }
    return sp_shell_state(pass->to, c.depth);
}

/* Computes the states of `count` voxels of a row from (x, y, z) on. */
static void compute_states(const struct pass *pass, uint32_t x, uint32_t y, uint32_t z,
                           uint32_t count, uint8_t state[SP_SHELL_WORD]) {
    const void *voxels = pass->voxels;
    const uint8_t *table = pass->to->state;
    const int32_t first = pass->to->transfer->first;
    uint64_t at = row_start(pass->masks, x, y, z);
    if (!table || pass->to->transfer->scale) {
        for (uint32_t i = 0; i < count; i++)
            state[i] = state_of_voxel(pass, at + i, (const uint32_t[3]){ x + i, y, z });
        return;
    }
    switch (pass->type) {
    case SP_UINT8:
        LOOK_UP(uint8_t);
        break;
    case SP_INT8:
        LOOK_UP(int8_t);
        break;
    case SP_UINT16:
        LOOK_UP(uint16_t);
        break;
    default:
        LOOK_UP(int16_t);
    }
}

/* Bit i = bit `which` of state[i]. */
static uint64_t pack_bits(const uint8_t state[SP_SHELL_WORD], int which) {
    uint64_t word = 0;
    for (int byte = 0; byte < 8; byte++) {
        uint64_t eight;
        memcpy(&eight, state + 8 * byte, sizeof eight);
        eight = eight >> which & UINT64_C(0x0101010101010101);
        word |= (eight * UINT64_C(0x0102040810204080) >> 56) << (8 * byte);
    }
    return word;
}

static void fill_block(const struct pass *pass, const struct extent *e, uint32_t w,
                       unsigned uniform) {
    struct sp_shell_masks *m = pass->masks;
    uint32_t count = e->end[0] - e->begin[0];
    uint64_t all = count < SP_SHELL_WORD ? (UINT64_C(1) << count) - 1 : UINT64_MAX;
    uint8_t state[SP_SHELL_WORD] = { 0 };
    for (uint32_t z = e->begin[2]; z < e->end[2]; z++)
        for (uint32_t y = e->begin[1]; y < e->end[1]; y++) {
            uint64_t at = ((uint64_t)z * m->dims[1] + y) * m->words + w;
            if (uniform == SP_STATE_MIXED)
                compute_states(pass, e->begin[0], y, z, count, state);
            for (int which = 0; which < 2; which++)
                m->bits[which][at] = uniform == SP_STATE_MIXED ? pack_bits(state, which)
                                     : uniform >> which & 1    ? all
                                                               : 0;
        }
}

static void update_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    const struct pass *pass = user;
    struct sp_shell_masks *m = pass->masks;
    (void)worker;
    for (size_t n = begin; n < end && !sp_interrupt_is_cancelled(pass->interrupt); n++) {
        pass->changed[n] = 0;
        for (uint32_t w = 0; w < m->words; w++) {
            const struct sp_shell_range *range = &m->ranges[n * m->words + w];
            if (pass->from && !sp_shell_states_differ(pass->from, pass->to, range))
                continue;
            struct extent e =
                compute_extent(m, w, (uint32_t)(n % m->sides[0]), (uint32_t)(n / m->sides[0]));
            fill_block(pass, &e, w, sp_shell_states_of(pass->to, range));
            pass->changed[n] = 1;
        }
    }
}

void sp_shell_masks_update(struct sp_shell_masks *masks, const struct sp_volume *volume,
                           const struct sp_shell_states *from, const struct sp_shell_states *to,
                           uint8_t *changed, struct sp_pool *pool,
                           const struct sp_interrupt *interrupt) {
    struct pass pass;
    init_pass(&pass, masks, volume, interrupt);
    pass.from = from;
    pass.to = to;
    pass.changed = changed;
    sp_parallel_for(pool, (size_t)masks->sides[0] * masks->sides[1], 4, update_blocks, &pass);
}
