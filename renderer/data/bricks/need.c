/* SPDX-License-Identifier: Apache-2.0 */
#include "data/bricks/need.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/volume/volume.h"

uint64_t sp_brick_need_at(const struct sp_brick_need *need, const struct sp_brick_level *level,
                          uint64_t i) {
    const uint64_t x = need->first[0] + i % need->count[0];
    const uint64_t y = need->first[1] + i / need->count[0] % need->count[1];
    const uint64_t z = need->first[2] + i / need->count[0] / need->count[1];
    return (z * level->bricks[1] + y) * level->bricks[0] + x;
}

void sp_brick_need_box(const struct sp_brick_need *need, const struct sp_brick_level *level,
                       uint32_t first[3], uint32_t size[3]) {
    for (int a = 0; a < 3; a++) {
        uint32_t end = (need->first[a] + need->count[a]) * BRICK_SIDE;
        first[a] = need->first[a] * BRICK_SIDE;
        size[a] = (end < level->dims[a] ? end : level->dims[a]) - first[a];
    }
}

uint64_t sp_brick_need_samples(const struct sp_brick_file *file, const struct sp_brick_need *need) {
    uint32_t first[3], size[3];
    sp_brick_need_box(need, &sp_brick_file_header(file)->level[need->level], first, size);
    return (uint64_t)size[0] * size[1] * size[2];
}

uint64_t sp_brick_need_bytes(const struct sp_brick_file *file, const struct sp_brick_need *need) {
    const uint64_t count = sp_brick_need_samples(file, need);
    const uint64_t bytes = count * sp_type_size(sp_brick_file_header(file)->info.type);
    uint64_t vectors_at;
    return need->has_vectors ? sp_volume_layout(bytes, count, true, &vectors_at) : bytes;
}

uint64_t sp_brick_need_vectors_at(const struct sp_brick_file *file,
                                  const struct sp_brick_need *need) {
    const uint64_t count = sp_brick_need_samples(file, need);
    uint64_t vectors_at;
    sp_volume_layout(count * sp_type_size(sp_brick_file_header(file)->info.type), count, true,
                     &vectors_at);
    return vectors_at;
}

double sp_brick_value(const struct sp_brick_entry *entry, enum sp_type type) {
    static const double ends[SP_TYPE_COUNT][2] = {
        { 0, UINT8_MAX },         { INT8_MIN, INT8_MAX },   { 0, UINT16_MAX },
        { INT16_MIN, INT16_MAX }, { INT32_MIN, INT32_MAX }, { -INFINITY, INFINITY },
        { -INFINITY, INFINITY }
    };
    const double low = entry->range[0], high = entry->range[1];
    if (low > high)
        return type < SP_FLOAT32 ? 0 : (double)NAN;
    if (low <= 0 && high >= 0)
        return 0;
    return fmin(fmax(low, ends[type][0]), ends[type][1]); /* the file may say anything */
}

bool sp_brick_need_find(const struct sp_brick_need *need, uint64_t i,
                        const struct sp_brick_need *in, uint64_t *at) {
    const uint64_t place[3] = { i % need->count[0], i / need->count[0] % need->count[1],
                                i / need->count[0] / need->count[1] };
    *at = 0;
    for (int a = 2; a >= 0; a--) {
        uint64_t global = need->first[a] + place[a];
        if (global < in->first[a] || global - in->first[a] >= in->count[a])
            return false;
        *at = *at * in->count[a] + (global - in->first[a]);
    }
    return true;
}

/* True if each brick of `need` has in `have` at least its number, or `most`. */
static bool has_all(const struct sp_brick_need *need, const struct sp_brick_need *have,
                    uint16_t most) {
    uint64_t at;
    if (need->level != have->level || (have->is_sparse && !need->is_sparse) ||
        (need->has_vectors && !have->has_vectors))
        return false;
    for (uint64_t i = 0; i < sp_brick_need_count(need); i++) {
        const uint16_t least = need->wanted[i] < most ? need->wanted[i] : most;
        if (least && !(sp_brick_need_find(need, i, have, &at) && have->wanted[at] >= least))
            return false;
    }
    return true;
}

bool sp_brick_need_is_in(const struct sp_brick_need *need, const struct sp_brick_need *have) {
    return has_all(need, have, BRICK_WANTED);
}

bool sp_brick_need_is_covered(const struct sp_brick_need *need, const struct sp_brick_need *have) {
    return has_all(need, have, BRICK_COARSE);
}

bool sp_brick_need_copy(const struct sp_brick_need *need, struct sp_brick_need *copy) {
    *copy = *need;
    if (!sp_brick_need_allocate(copy, 0))
        return false;
    memcpy(copy->wanted, need->wanted, sp_brick_need_count(need) * sizeof *need->wanted);
    return true;
}

bool sp_brick_need_allocate(struct sp_brick_need *need, uint16_t number) {
    const uint64_t count = sp_brick_need_count(need);
    need->wanted = malloc(count * sizeof *need->wanted);
    for (uint64_t i = 0; need->wanted && i < count; i++)
        need->wanted[i] = number;
    return need->wanted != NULL;
}

uint64_t sp_brick_need_wanted(const struct sp_brick_need *need) {
    uint64_t count = 0;
    for (uint64_t i = 0; i < sp_brick_need_count(need); i++)
        count += need->wanted[i] >= BRICK_WANTED;
    return count;
}

uint64_t sp_brick_need_coarse(const struct sp_brick_need *need) {
    uint64_t count = 0;
    for (uint64_t i = 0; i < sp_brick_need_count(need); i++)
        count += need->wanted[i] == BRICK_COARSE;
    return count;
}

uint32_t *sp_brick_order(const uint16_t *numbers, uint64_t length, size_t *count) {
    uint32_t *begin = calloc(UINT16_MAX + 1, sizeof *begin), *order = NULL;
    *count = 0;
    for (uint64_t i = 0; i < length; i++)
        *count += numbers[i] >= BRICK_WANTED;
    if (begin)
        order = malloc((*count ? *count : 1) * sizeof *order);
    if (order) { /* a counting sort: begin[n] is where number n begins */
        for (uint64_t i = 0; i < length; i++)
            begin[numbers[i]]++;
        for (uint32_t n = UINT16_MAX, at = 0; n >= BRICK_WANTED; n--) {
            const uint32_t next = at + begin[n];
            begin[n] = at;
            at = next;
        }
        for (uint64_t i = 0; i < length; i++)
            if (numbers[i] >= BRICK_WANTED)
                order[begin[numbers[i]]++] = (uint32_t)i;
    }
    free(begin);
    return order;
}
