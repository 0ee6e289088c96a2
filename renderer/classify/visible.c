/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/visible.h"

#include <stdlib.h>

static void *allocate(uint64_t count, size_t size) {
    return count > SIZE_MAX / 2 / size ? NULL : malloc(count ? count * size : 1);
}

bool sp_visible_init(struct sp_visible *visible, const uint32_t dims[3], uint32_t key_bytes,
                     uint32_t normal_bytes, struct sp_error *err) {
    *visible = (struct sp_visible){ .key_bytes = key_bytes, .normal_bytes = normal_bytes };
    for (int a = 0; a < 3; a++)
        visible->bricks[a] = (dims[a] + SP_BRICK - 1) >> SP_BRICK_SHIFT;
    uint32_t bricks = sp_visible_bricks(visible);
    visible->first = calloc(bricks + (size_t)1, sizeof *visible->first);
    visible->start = calloc(bricks, sizeof *visible->start);
    visible->axis = calloc(bricks, sizeof *visible->axis);
    if (visible->first && visible->start && visible->axis)
        return true;
    sp_visible_finish(visible);
    return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for %u bricks", bricks);
}

void sp_visible_sum(struct sp_visible *visible) {
    uint32_t bricks = sp_visible_bricks(visible);
    for (uint32_t b = 0; b < bricks; b++)
        visible->first[b + 1] += visible->first[b];
    visible->count = visible->first[bricks];
}

bool sp_visible_allocate(struct sp_visible *visible, bool normals, struct sp_error *err) {
    visible->place = allocate(visible->count + SP_PLACES_BEYOND, sizeof *visible->place);
    visible->key = allocate(visible->count, visible->key_bytes);
    if (normals)
        visible->normal = allocate(visible->count, visible->normal_bytes);
    if (visible->place && visible->key && (!normals || visible->normal))
        return true;
    return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for a list of %llu visible voxels",
                   (unsigned long long)visible->count);
}

void sp_visible_finish(struct sp_visible *visible) {
    free(visible->first);
    free(visible->start);
    free(visible->axis);
    free(visible->place);
    free(visible->key);
    free(visible->normal);
    *visible = (struct sp_visible){ 0 };
}

uint64_t sp_visible_entry_bytes(const struct sp_visible *v, uint64_t count, bool normals) {
    return count * (sizeof *v->place + v->key_bytes + (normals ? v->normal_bytes : 0));
}

uint64_t sp_visible_bytes(const struct sp_visible *visible) {
    if (!visible->first)
        return 0;
    uint64_t bricks = sp_visible_bricks(visible);
    return sizeof *visible->first +
           bricks * (sizeof *visible->first + sizeof *visible->start + sizeof *visible->axis) +
           sp_visible_entry_bytes(visible, visible->place ? visible->count : 0,
                                  visible->normal != NULL);
}

void sp_visible_locals(const struct sp_visible *visible, uint32_t brick, const uint16_t *order,
                       uint32_t begin, uint32_t count, uint16_t *local) {
    const uint16_t *start = visible->start[brick];
    const uint8_t *place = visible->place + visible->first[brick];
    unsigned axis = visible->axis[brick];
    uint32_t s = 0;
    for (; !order && s < SP_BRICK; s++) {
        uint32_t from = start[s] > begin ? start[s] : begin;
        uint32_t to = start[s + 1] < begin + count ? start[s + 1] : begin + count;
        for (uint32_t e = from; e < to; e++)
            local[e - begin] = sp_visible_local(axis, s, place[e]);
    }
    s = 0;
    for (uint32_t n = 0; order && n < count; n++) {
        uint32_t e = order[begin + n];
        s = e < start[s] ? 0 : s; /* orders rise inside of a run */
        while (e >= start[s + 1])
            s++;
        local[n] = sp_visible_local(axis, s, place[e]);
    }
}
