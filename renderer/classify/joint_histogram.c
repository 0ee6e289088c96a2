/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "classify/gradient.h"
#include "data/volume/bins.h"
#include "data/volume/sample.h"
#include "sp/histogram.h"

/* Mixes the bits of a counter (the finaliser of SplitMix64, Steele et al. 2014). */
static uint64_t mix(uint64_t x) {
    x = (x ^ x >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    x = (x ^ x >> 27) * UINT64_C(0x94d049bb133111eb);
    return x ^ x >> 31;
}

/* Returns the index of the sample that is taken from part `i` of `parts`. */
static uint64_t sample_of_part(uint64_t i, uint64_t parts, uint64_t voxels) {
    uint64_t begin = i * voxels / parts, size = (i + 1) * voxels / parts - begin;
    return size > 1 ? begin + mix(i + 1) % size : begin;
}

static double magnitude_at(const struct sp_gradient_grid *grid, uint64_t at) {
    const uint32_t *dims = grid->grid->dims;
    const uint32_t i[3] = { (uint32_t)(at % dims[0]), (uint32_t)(at / dims[0] % dims[1]),
                            (uint32_t)(at / dims[0] / dims[1]) };
    double g[3];
    sp_gradient_at(grid, i, g);
    return sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]) / grid->scale;
}

bool sp_joint_histogram_count(const struct sp_volume *volume, struct sp_joint_histogram *h,
                              struct sp_error *err) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    const uint32_t *dims = info->grid.dims;
    const void *voxels = sp_volume_voxels(volume);
    uint64_t count = (uint64_t)dims[0] * dims[1] * dims[2];
    uint64_t parts = count < SP_JOINT_SAMPLES ? count : SP_JOINT_SAMPLES;
    struct sp_gradient_grid grid;
    *h = (struct sp_joint_histogram){ .values = { info->data[0], info->data[1] } };
    double *magnitudes = malloc(parts * sizeof *magnitudes);
    if (!magnitudes)
        return sp_fail(err, SP_ERR_MEMORY, info->source, "out of memory for the histogram");

    sp_gradient_grid_init(&grid, volume);
    for (uint64_t p = 0; p < parts; p++) {
        uint64_t at = sample_of_part(p, parts, count);
        double value = sp_sample(voxels, info->type, at);
        bool is_data = value >= info->data[0] && value <= info->data[1];
        magnitudes[p] = is_data ? magnitude_at(&grid, at) : NAN;
        if (isfinite(magnitudes[p]))
            h->gradients[1] = fmax(h->gradients[1], magnitudes[p]);
    }
    if (!(h->gradients[1] > 0))
        h->gradients[1] = 1;
    const struct sp_bins values = sp_bins_between(h->values[0], h->values[1], SP_JOINT_VALUES);
    const struct sp_bins gradients = sp_bins_between(0, h->gradients[1], SP_JOINT_GRADIENTS);
    for (uint64_t p = 0; p < parts; p++) {
        if (!isfinite(magnitudes[p]))
            continue;
        const double value = sp_sample(voxels, info->type, sample_of_part(p, parts, count));
        h->counts[sp_bin_of(&gradients, magnitudes[p])][sp_bin_of(&values, value)]++;
        h->samples++;
    }
    free(magnitudes);
    return true;
}
