/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/splat_list/list.h"

#include <stdlib.h>

static uint32_t row_words(uint32_t rows) {
    return (rows + 63) / 64;
}

/* Bytes of the lists' parts that depend on the grid alone. */
static uint64_t fixed_bytes(const uint32_t dims[3]) {
    return ((uint64_t)dims[1] * dims[2] + 1) * sizeof(uint32_t) +
           ((uint64_t)dims[1] * row_words(dims[2]) + (uint64_t)dims[2] * row_words(dims[1])) *
               sizeof(uint64_t) +
           ((uint64_t)dims[1] + dims[2]) * sizeof(uint32_t);
}

static bool fail_memory(const struct sp_voxel_list *list, struct sp_error *err) {
    return sp_fail(err, SP_ERR_MEMORY, "/layers", "out of memory for a layer of %u voxels",
                   list->count);
}

bool sp_voxel_list_start(struct sp_voxel_list *list, struct sp_error *err) {
    list->first = calloc(sp_voxel_list_rows(list) + 1, sizeof *list->first);
    return list->first || fail_memory(list, err);
}

/* Fills which rows have voxels. */
static bool note_rows(struct sp_voxel_list *list) {
    const uint32_t *dims = list->dims;
    for (int a = 0; a < 2; a++) {
        list->rows[a] = calloc((size_t)dims[a + 1] * row_words(dims[2 - a]), sizeof *list->rows[a]);
        list->slice_counts[a] = calloc(dims[a + 1], sizeof *list->slice_counts[a]);
        if (!list->rows[a] || !list->slice_counts[a])
            return false;
    }
    for (uint32_t z = 0; z < dims[2]; z++)
        for (uint32_t y = 0; y < dims[1]; y++) {
            const uint32_t *first = list->first + (uint64_t)z * dims[1] + y;
            uint32_t n = first[1] - first[0];
            if (n == 0)
                continue;
            list->slice_counts[0][y] += n;
            list->slice_counts[1][z] += n;
            list->rows[0][(size_t)y * row_words(dims[2]) + z / 64] |= UINT64_C(1) << z % 64;
            list->rows[1][(size_t)z * row_words(dims[1]) + y / 64] |= UINT64_C(1) << y % 64;
        }
    return true;
}

/* Turns counts into starts. False if the voxels are too many for P, or for the memory. */
bool sp_voxel_list_sum(struct sp_voxel_list *list, uint64_t bytes_max, const char *remedy,
                       struct sp_error *err) {
    uint64_t sum = 0, rows = sp_voxel_list_rows(list);
    for (uint64_t row = 0; row < rows; row++) {
        sum += list->first[row + 1];
        list->first[row + 1] = (uint32_t)sum;
    }
    uint64_t bytes = fixed_bytes(list->dims) + sum * sizeof *list->voxels;
    if (sum > UINT32_MAX || bytes > bytes_max)
        return sp_fail(err, SP_ERR_BUDGET, "/layers",
                       "a layer of %llu voxels needs %llu bytes, %llu may be used: %s",
                       (unsigned long long)sum, (unsigned long long)bytes,
                       (unsigned long long)bytes_max, remedy);
    list->count = (uint32_t)sum;
    list->voxels = malloc((list->count + (size_t)1) * sizeof *list->voxels);
    return (list->voxels && note_rows(list)) || fail_memory(list, err);
}

void sp_voxel_list_finish(struct sp_voxel_list *list) {
    free(list->first);
    free(list->voxels);
    for (int a = 0; a < 2; a++) {
        free(list->rows[a]);
        free(list->slice_counts[a]);
    }
    *list = (struct sp_voxel_list){ 0 };
}

uint64_t sp_voxel_list_bytes(const struct sp_voxel_list *list) {
    if (!list->first)
        return 0;
    return fixed_bytes(list->dims) + list->count * sizeof *list->voxels;
}
