/* SPDX-License-Identifier: Apache-2.0 */
#include "data/volume/noise.h"

#include <math.h>
#include <stdlib.h>

#include "base/compare.h"
#include "data/volume/sample.h"

enum { MARGIN = 3, GRAIN = 1024, PLACES_MIN = 1 << 12, PLACES_MAX = 1 << 15, SHARE = 2048 };

struct estimate {
    const struct sp_volume_info *info;
    const void *voxels;
    double scale[3];         /* of a gradient along each axis, so that space is isotropic */
    size_t count;            /* of places */
    double *smooth, *across; /* [count]; smooth 0: the place does not count */
};

/* The sample of the axis at a share [0, 1) of its length, without its margins. */
static uint32_t place_at(uint32_t dim, double share) {
    return MARGIN + (uint32_t)(share * (dim - 2 * MARGIN));
}

/* Places that fill space evenly for any number of them (the R3 sequence, M. Roberts 2018). */
static void choose_place(const uint32_t dims[3], size_t number, uint32_t at[3]) {
    const double golden = 1.22074408460575947536; /* g⁴ = g + 1 */
    double step = 1;
    for (int a = 0; a < 3; a++) {
        step /= golden;
        const double x = 0.5 + step * (double)number;
        at[a] = place_at(dims[a], x - floor(x));
    }
}

/* Returns a sample; NaN if it stands for no data. */
static double sample_at(const struct estimate *e, uint64_t at) {
    const double x = sp_sample(e->voxels, e->info->type, at);
    return x >= e->info->data[0] && x <= e->info->data[1] ? x : NAN;
}

/* Reads the 3³ samples around a place; false if all are equal. */
static bool read_cube(const struct estimate *e, uint64_t at, const uint64_t stride[3],
                      double cube[3][3][3]) {
    bool differs = false;
    at -= stride[0] + stride[1] + stride[2];
    for (uint64_t k = 0; k < 3; k++)
        for (uint64_t j = 0; j < 3; j++)
            for (uint64_t i = 0; i < 3; i++) {
                cube[k][j][i] = sample_at(e, at + i + j * stride[1] + k * stride[2]);
                differs = differs || cube[k][j][i] != cube[0][0][0];
            }
    return differs;
}

static void compute_smooth(double cube[3][3][3], double gradient[3]) {
    static const double mean[3] = { 0.25, 0.5, 0.25 }, change[3] = { -0.5, 0, 0.5 };
    for (int a = 0; a < 3; a++)
        gradient[a] = 0;
    for (int k = 0; k < 3; k++)
        for (int j = 0; j < 3; j++)
            for (int i = 0; i < 3; i++) {
                gradient[0] += mean[k] * mean[j] * change[i] * cube[k][j][i];
                gradient[1] += mean[k] * change[j] * mean[i] * cube[k][j][i];
                gradient[2] += change[k] * mean[j] * mean[i] * cube[k][j][i];
            }
}

/* The difference of the values half a sample behind and before the place, each from the polynomial
 * of degree 5 through six samples. */
static double compute_fine(const struct estimate *e, uint64_t at, uint64_t stride) {
    static const double weight[MARGIN] = { 175.0 / 256, -28.0 / 256, 3.0 / 256 };
    double sum = 0;
    for (uint64_t n = 1; n <= MARGIN; n++)
        sum += weight[n - 1] * (sample_at(e, at + n * stride) - sample_at(e, at - n * stride));
    return sum;
}

static void measure_place(const struct estimate *e, size_t number) {
    const uint32_t *dims = e->info->grid.dims;
    const uint64_t stride[3] = { 1, dims[0], (uint64_t)dims[0] * dims[1] };
    uint32_t place[3];
    double cube[3][3][3], smooth[3], fine[3], square = 0, along = 0, across = 0;
    choose_place(dims, number, place);
    const uint64_t at = place[0] + place[1] * stride[1] + place[2] * stride[2];
    e->smooth[number] = 0;
    if (!read_cube(e, at, stride, cube))
        return;
    compute_smooth(cube, smooth);
    for (int a = 0; a < 3; a++) {
        smooth[a] *= e->scale[a];
        fine[a] = e->scale[a] * compute_fine(e, at, stride[a]);
        square += smooth[a] * smooth[a];
        along += smooth[a] * fine[a];
    }
    if (!(square > 0)) /* also NaN */
        return;
    along = along > 0 ? along / square : 0;
    for (int a = 0; a < 3; a++)
        across += pow(fine[a] - along * smooth[a], 2);
    if (!isfinite(across)) /* without data */
        return;
    e->smooth[number] = sqrt(square);
    e->across[number] = sqrt(across);
}

static void measure_places(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    for (size_t i = begin; i < end; i++)
        measure_place(user, i);
}

/* The median of `across` at the quarter of the places with the longest smooth gradients. */
static double compute_median(const struct estimate *e, double *sorted) {
    size_t count = 0, kept = 0;
    for (size_t i = 0; i < e->count; i++)
        if (e->smooth[i] > 0)
            sorted[count++] = e->smooth[i];
    if (count < 4)
        return 0;
    qsort(sorted, count, sizeof *sorted, sp_compare_doubles);
    const double least = sorted[count - count / 4];
    for (size_t i = 0; i < e->count; i++)
        if (e->smooth[i] >= least)
            sorted[kept++] = e->across[i];
    qsort(sorted, kept, sizeof *sorted, sp_compare_doubles);
    return sorted[kept / 2];
}

bool sp_noise_estimate(const struct sp_volume_info *info, const void *voxels, struct sp_pool *pool,
                       double *noise) {
    const double white = 0.95; /* noise per `across` of white noise (measured) */
    struct estimate e = { .info = info, .voxels = voxels };
    const uint32_t *dims = info->grid.dims;
    double inverse = 0;
    *noise = 0;
    for (int a = 0; a < 3; a++) {
        if (dims[a] <= 2 * MARGIN)
            return true;
        e.scale[a] = 1 / info->grid.spacing[a];
        inverse = fmax(inverse, e.scale[a]);
    }
    if (info->meaning == SP_MEANING_LABELS || !(info->data[1] > info->data[0]))
        return true;
    double mean = 0;
    for (int a = 0; a < 3; a++)
        mean += pow(e.scale[a] / inverse, 2) / 3;
    for (int a = 0; a < 3; a++)
        e.scale[a] /= inverse * sqrt(mean);
    const uint64_t share = (uint64_t)dims[0] * dims[1] * dims[2] / SHARE;
    e.count = share < PLACES_MIN ? PLACES_MIN : share < PLACES_MAX ? (size_t)share : PLACES_MAX;
    double *memory = malloc(3 * e.count * sizeof *memory);
    if (!memory)
        return false;
    e.smooth = memory;
    e.across = memory + e.count;
    sp_parallel_for(pool, e.count, GRAIN, measure_places, &e);
    *noise = white * compute_median(&e, memory + 2 * e.count);
    free(memory);
    return true;
}
