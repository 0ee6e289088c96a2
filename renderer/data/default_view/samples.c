/* SPDX-License-Identifier: Apache-2.0 */
#include "data/default_view/samples.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/compare.h"
#include "data/volume/bins.h"
#include "data/volume/grid.h"
#include "data/volume/sample.h"

enum { FINE_BINS = 1024, ZOOMS = 16 };
static const double tail = 0.0005; /* share of the samples beyond each end of the range */

/* The index of sample i of n in an even choice from `dim` voxels. */
static uint64_t choose(uint64_t dim, uint64_t n, uint64_t i) {
    return (2 * i + 1) * dim / (2 * n);
}

/* The index in the volume of sample i of an axis. */
static uint64_t index_of(const struct sp_default_samples *s, unsigned axis, uint32_t i) {
    return s->begin[axis] + choose(s->dims[axis], s->count[axis], i);
}

static bool place_samples(struct sp_default_samples *s) {
    const struct sp_grid *grid = &s->info->grid;
    for (unsigned a = 0; a < 3; a++) {
        uint32_t dim = s->dims[a], first = s->begin[a], last = first + dim - 1,
                 step = (dim + SP_FIRST_SIDE - 1) / SP_FIRST_SIDE;
        uint32_t n = s->count[a] = dim / step;
        if (!(s->along[a] = malloc(n * sizeof *s->along[a])))
            return false;
        for (uint32_t i = 0; i < n; i++)
            s->along[a][i] = sp_grid_distance(grid, a, (uint32_t)index_of(s, a, i));
        s->cell[a] = (sp_grid_distance(grid, a, last) - sp_grid_distance(grid, a, first) +
                      sp_grid_local_spacing(grid, a, last)) /
                     n;
    }
    return true;
}

/* Also false for values that stand for missing data. */
static bool is_data(const struct sp_default_samples *s, double value) {
    return value >= s->info->data[0] && value <= s->info->data[1];
}

static void read_values(const struct sp_default_samples *s, const void *voxels, double *values) {
    const uint32_t *dims = s->info->grid.dims;
    for (uint32_t k = 0; k < s->count[2]; k++)
        for (uint32_t j = 0; j < s->count[1]; j++) {
            uint64_t row = (index_of(s, 2, k) * dims[1] + index_of(s, 1, j)) * dims[0];
            for (uint32_t i = 0; i < s->count[0]; i++) {
                const double value = sp_sample(voxels, s->info->type, row + index_of(s, 0, i));
                *values++ = is_data(s, value) ? value : NAN;
            }
        }
}

/* Counts values in [low, high], except those that equal `common`. */
static uint64_t count_fine(const double *values, size_t n, double low, double high, double common,
                           uint64_t fine[FINE_BINS]) {
    uint64_t total = 0;
    const struct sp_bins bins = sp_bins_between(low, high, FINE_BINS);
    memset(fine, 0, FINE_BINS * sizeof *fine);
    for (size_t i = 0; i < n; i++)
        if (values[i] >= low && values[i] <= high && values[i] != common) {
            fine[sp_bin_of(&bins, values[i])]++;
            total++;
        }
    return total;
}

/* Narrows [low, high] while nearly all samples lie in a small part of it: a few wild samples, or a
 * value that stands for "no data", must not take the whole scale. The surroundings are often one
 * constant value; they do not count. */
static void narrow_range(struct sp_default_samples *s, const double *values, size_t n) {
    uint64_t fine[FINE_BINS], lowest = 0;
    s->low = s->info->data[0];
    s->high = s->info->data[1];
    for (size_t i = 0; i < n; i++)
        lowest += values[i] == s->low;
    double common = lowest * 2 > n ? s->low : NAN;
    for (int zoom = 0; zoom < ZOOMS; zoom++) {
        uint64_t total = count_fine(values, n, s->low, s->high, common, fine), sum = 0;
        int first = -1, last = 0;
        for (int b = 0; b < FINE_BINS; b++) {
            sum += fine[b];
            if (first < 0 && (double)sum > tail * (double)total)
                first = b;
            if (!((double)sum > (1 - tail) * (double)total))
                last = b + 1;
        }
        last = last < FINE_BINS ? last : FINE_BINS - 1;
        if (total < 64 || last - first >= FINE_BINS / 2)
            return;
        double low = s->low, bin = (s->high - low) / FINE_BINS, end = low + bin * (last + 1);
        double begin = isnan(common) ? low + bin * first : low;
        if (!(end - begin > 1e-12 * fmax(fabs(begin), fabs(end)))) /* all samples are alike */
            return;
        s->low = begin;
        s->high = end;
        if (last - first >= FINE_BINS / 32)
            return;
    }
}

/* Real numbers that are never negative and span many powers of ten, such as densities of galaxies
 * and orbitals, have most of their structure in a small part of a linear range. Their bins have
 * equal ratios, from the highest value down to where little more is to be seen. */
static void choose_log_range(struct sp_default_samples *s, const double *values, size_t n) {
    const bool is_real = s->info->type == SP_FLOAT32 || s->info->type == SP_FLOAT64;
    const double steep = 300, decades = 1e4;
    const size_t few = 1024;
    double *sorted = is_real && s->info->data[0] >= 0 ? malloc(n * sizeof *sorted) : NULL;
    size_t count = 0;
    for (size_t i = 0; sorted && i < n; i++)
        if (values[i] > 0 && isfinite(values[i]))
            sorted[count++] = values[i];
    if (count >= few && count * 4 >= n) {
        qsort(sorted, count, sizeof *sorted, sp_compare_doubles);
        const double top = sorted[count - 1 - count / 1000], middle = sorted[count / 2];
        if (top > steep * middle && middle > 0) {
            s->is_log = true;
            s->high = fmin(s->info->data[1], 10 * top);
            s->low = fmax(s->high / decades, sorted[count / 100]);
        }
    }
    free(sorted);
}

/* A scanner leaves the corners outside of its circle at the lowest value. That is no measurement,
 * so it becomes NaN: true if every line along the last axis has that value throughout or not at
 * all, and most lines do not have it. */
static bool drop_padding(const struct sp_default_samples *s, double *values) {
    size_t area = (size_t)s->count[0] * s->count[1], empty = 0, mixed = 0;
    double lowest = s->info->data[0];
    for (size_t at = 0; at < area; at++) {
        uint32_t n = 0;
        for (uint32_t k = 0; k < s->count[2]; k++)
            n += values[k * area + at] == lowest;
        empty += n == s->count[2];
        mixed += n > 0 && n < s->count[2];
    }
    if (s->count[2] < 4 || empty * 20 < area || empty * 5 > area * 2 || mixed * 50 > area)
        return false;
    for (size_t i = 0; i < area * s->count[2]; i++)
        if (values[i] == lowest)
            values[i] = NAN;
    return true;
}

static uint16_t bin_of(const struct sp_default_samples *s, double value) {
    if (!isfinite(value))
        return SP_FIRST_NONE;
    double t = s->is_log ? log(fmax(value, s->low) / s->low) / log(s->high / s->low)
                         : (value - s->low) / (s->high - s->low);
    t *= SP_FIRST_BINS;
    return t < 0 ? 0 : t < SP_FIRST_BINS ? (uint16_t)t : SP_FIRST_BINS - 1;
}

static void read_faces(struct sp_default_samples *s, const void *voxels, double padding) {
    enum { SIDE = SP_FIRST_SIDE };
    const uint32_t *dims = s->info->grid.dims;
    const uint64_t stride[3] = { 1, dims[0], (uint64_t)dims[0] * dims[1] };
    for (unsigned a = 0; a < 3; a++) {
        unsigned b = (a + 1) % 3, c = (a + 2) % 3;
        for (int side = 0; side < 2 && dims[a] >= 4; side++)
            for (uint64_t k = 0; k < SIDE && k < dims[c]; k++)
                for (uint64_t j = 0; j < SIDE && j < dims[b]; j++) {
                    uint64_t at = (side ? dims[a] - 1 : 0) * stride[a] +
                                  choose(dims[b], dims[b] < SIDE ? dims[b] : SIDE, j) * stride[b] +
                                  choose(dims[c], dims[c] < SIDE ? dims[c] : SIDE, k) * stride[c];
                    double value = sp_sample(voxels, s->info->type, at);
                    uint16_t bin = is_data(s, value) ? bin_of(s, value) : SP_FIRST_NONE;
                    if (bin != SP_FIRST_NONE && value != padding)
                        s->faces[2 * a + (unsigned)side][bin]++;
                }
    }
}

static bool sample_volume(struct sp_default_samples *s, const void *voxels) {
    if (!(s->info->data[1] > s->info->data[0]) || !place_samples(s))
        return false;
    size_t n = (size_t)s->count[0] * s->count[1] * s->count[2];
    double *values = calloc(n, sizeof *values);
    s->bins = malloc(n * sizeof *s->bins);
    bool ok = values && s->bins && isfinite(s->info->data[1] - s->info->data[0]);
    if (ok) {
        read_values(s, voxels, values);
        bool is_padded = drop_padding(s, values);
        narrow_range(s, values, n);
        choose_log_range(s, values, n);
        for (size_t i = 0; i < n; i++) {
            s->bins[i] = bin_of(s, values[i]);
            if (s->bins[i] != SP_FIRST_NONE)
                s->histogram[s->bins[i]]++;
        }
        read_faces(s, voxels, is_padded ? s->info->data[0] : NAN);
    }
    free(values);
    return ok;
}

bool sp_default_samples_init(struct sp_default_samples *samples, const struct sp_volume *volume,
                             const uint32_t begin[3], const uint32_t dims[3]) {
    *samples = (struct sp_default_samples){ .info = sp_volume_info(volume) };
    for (int a = 0; a < 3; a++) {
        samples->begin[a] = begin ? begin[a] : 0;
        samples->dims[a] = begin ? dims[a] : samples->info->grid.dims[a];
    }
    if (sample_volume(samples, sp_volume_voxels(volume)))
        return true;
    sp_default_samples_finish(samples);
    return false;
}

void sp_default_samples_finish(struct sp_default_samples *samples) {
    for (int a = 0; a < 3; a++)
        free(samples->along[a]);
    free(samples->bins);
    *samples = (struct sp_default_samples){ 0 };
}

double sp_default_value(const struct sp_default_samples *samples, double bin) {
    if (samples->is_log)
        return samples->low * pow(samples->high / samples->low, bin / SP_FIRST_BINS);
    return samples->low + (samples->high - samples->low) * bin / SP_FIRST_BINS;
}

void sp_default_position(const struct sp_default_samples *samples, const uint32_t at[3],
                         double position[3]) {
    const struct sp_grid *grid = &samples->info->grid;
    for (int r = 0; r < 3; r++) {
        position[r] = grid->origin[r];
        for (int a = 0; a < 3; a++)
            position[r] += grid->direction[r][a] * samples->along[a][at[a]];
    }
}
