/* SPDX-License-Identifier: Apache-2.0 */
#include "inspect/part/mask.h"

#include <stdlib.h>
#include <string.h>

#include "base/grow.h"

static uint64_t word_count(const struct sp_mask *mask) {
    return (uint64_t)mask->dims[2] * mask->dims[1] * mask->words;
}

bool sp_mask_init(struct sp_mask *mask, const uint32_t dims[3], struct sp_error *err) {
    memcpy(mask->dims, dims, sizeof mask->dims);
    mask->words = (dims[0] + 63) / 64;
    mask->bits = calloc(word_count(mask), sizeof *mask->bits);
    return mask->bits || sp_fail(err, SP_ERR_MEMORY, "", "out of memory for a connected part");
}

void sp_mask_finish(struct sp_mask *mask) {
    free(mask->bits);
    mask->bits = NULL;
}

/* Runs of a row that are still to be followed. */
struct seeds {
    struct seed {
        uint32_t x, y, z;
    } * list;
    size_t count;
};

static bool push(struct seeds *seeds, uint32_t x, uint32_t y, uint32_t z, struct sp_error *err) {
    if (!sp_grow(&seeds->list, seeds->count, sizeof *seeds->list))
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for a connected part");
    seeds->list[seeds->count++] = (struct seed){ x, y, z };
    return true;
}

/* The run of bits of a row around x: [run[0], run[1]). */
static void extend_run(const uint64_t *row, uint32_t width, uint32_t x, uint32_t run[2]) {
    run[0] = x;
    run[1] = x + 1;
    while (run[0] > 0 && row[(run[0] - 1) / 64] >> (run[0] - 1) % 64 & 1)
        run[0]--;
    while (run[1] < width && row[run[1] / 64] >> run[1] % 64 & 1)
        run[1]++;
}

/* Pushes the first bit of each run of row (y, z) that touches the columns of `run` and is not in
 * the part yet. */
static bool follow(const struct sp_mask *all, const struct sp_mask *part, const uint32_t run[2],
                   uint32_t y, uint32_t z, struct seeds *seeds, struct sp_error *err) {
    const uint64_t *in = sp_mask_row(all, y, z), *done = sp_mask_row(part, y, z);
    bool is_inside = false;
    for (uint32_t x = run[0]; x < run[1]; x++) {
        if (x % 64 == 0 && x + 64 <= run[1] && !(in[x / 64] & ~done[x / 64])) {
            is_inside = false;
            x += 63;
            continue;
        }
        bool is_new = (in[x / 64] & ~done[x / 64]) >> x % 64 & 1;
        if (is_new && !is_inside && !push(seeds, x, y, z, err))
            return false;
        is_inside = is_new;
    }
    return true;
}

/* Adds the run around a seed, and the runs beside it as seeds. */
static bool spread(const struct sp_mask *all, struct sp_mask *part, const struct seed *at,
                   struct seeds *seeds, struct sp_error *err) {
    uint64_t *row = sp_mask_row(part, at->y, at->z);
    uint32_t run[2];
    if (row[at->x / 64] >> at->x % 64 & 1)
        return true;
    extend_run(sp_mask_row(all, at->y, at->z), all->dims[0], at->x, run);
    for (uint32_t x = run[0]; x < run[1]; x++)
        row[x / 64] |= UINT64_C(1) << x % 64;
    return (at->y == 0 || follow(all, part, run, at->y - 1, at->z, seeds, err)) &&
           (at->y + 1 == all->dims[1] || follow(all, part, run, at->y + 1, at->z, seeds, err)) &&
           (at->z == 0 || follow(all, part, run, at->y, at->z - 1, seeds, err)) &&
           (at->z + 1 == all->dims[2] || follow(all, part, run, at->y, at->z + 1, seeds, err));
}

bool sp_mask_connect(const struct sp_mask *all, const uint32_t at[3], struct sp_mask *part,
                     struct sp_error *err) {
    struct seeds seeds = { 0 };
    bool ok = push(&seeds, at[0], at[1], at[2], err);
    while (ok && seeds.count) {
        struct seed seed = seeds.list[--seeds.count];
        ok = spread(all, part, &seed, &seeds, err);
    }
    free(seeds.list);
    return ok;
}

struct growth {
    const struct sp_mask *from;
    struct sp_mask *to;
};

/* Row (y, z) and its neighbours along axis 0. */
static uint64_t grown_word(const uint64_t *row, uint32_t words, uint32_t w) {
    uint64_t before = w > 0 ? row[w - 1] >> 63 : 0;
    uint64_t behind = w + 1 < words ? row[w + 1] << 63 : 0;
    return row[w] | row[w] << 1 | row[w] >> 1 | before | behind;
}

static void grow_rows(void *user, size_t begin, size_t end, unsigned worker) {
    const struct growth *growth = user;
    const struct sp_mask *from = growth->from;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        uint32_t y = (uint32_t)(i % from->dims[1]), z = (uint32_t)(i / from->dims[1]);
        uint64_t *to = sp_mask_row(growth->to, y, z);
        uint64_t last = from->dims[0] % 64 ? (UINT64_C(1) << from->dims[0] % 64) - 1 : UINT64_MAX;
        memset(to, 0, from->words * sizeof *to);
        for (int k = 0; k < 9; k++) {
            uint32_t ny = y + (uint32_t)(k % 3) - 1, nz = z + (uint32_t)(k / 3) - 1;
            if (ny >= from->dims[1] || nz >= from->dims[2])
                continue;
            for (uint32_t w = 0; w < from->words; w++)
                to[w] |= grown_word(sp_mask_row(from, ny, nz), from->words, w);
        }
        to[from->words - 1] &= last;
    }
}

void sp_mask_grow(struct sp_mask *mask, struct sp_mask *from, struct sp_pool *pool) {
    struct growth growth = { from, mask };
    memcpy(from->bits, mask->bits, word_count(mask) * sizeof *mask->bits);
    sp_parallel_for(pool, (size_t)mask->dims[1] * mask->dims[2], 64, grow_rows, &growth);
}
