/* SPDX-License-Identifier: Apache-2.0 */
#include "data/bricks/samples.h"

#include <math.h>
#include <string.h>

#include "data/volume/bins.h"
#include "data/volume/majority.h"
#include "data/volume/sample.h"

static inline size_t row_at(const struct sp_brick_view *v, uint32_t y, uint32_t z) {
    return ((v->first[2] + z) * v->height + v->first[1] + y) * v->width + v->first[0];
}

/* Integers are compared as they are. */
#define INTEGER_RANGE(name, element)                                                               \
    static void range_##name(const struct sp_brick_view *v, struct sp_brick_range *range) {        \
        const element *samples = v->samples;                                                       \
        element least = samples[row_at(v, 0, 0)], most = least;                                    \
        for (uint32_t z = 0; z < v->size[2]; z++)                                                  \
            for (uint32_t y = 0; y < v->size[1]; y++) {                                            \
                const element *row = samples + row_at(v, y, z);                                    \
                for (uint32_t x = 0; x < v->size[0]; x++) {                                        \
                    least = row[x] < least ? row[x] : least;                                       \
                    most = row[x] > most ? row[x] : most;                                          \
                }                                                                                  \
            }                                                                                      \
        *range = (struct sp_brick_range){ least, most, 0, least == most };                         \
    }

#define REAL_RANGE(name, element)                                                                  \
    static void range_##name(const struct sp_brick_view *v, struct sp_brick_range *range) {        \
        const element *samples = v->samples, *start = samples + row_at(v, 0, 0);                   \
        element least = (element)INFINITY, most = (element)-INFINITY;                              \
        uint64_t nonfinite = 0;                                                                    \
        bool is_constant = true;                                                                   \
        for (uint32_t z = 0; z < v->size[2]; z++)                                                  \
            for (uint32_t y = 0; y < v->size[1]; y++) {                                            \
                const element *row = samples + row_at(v, y, z);                                    \
                for (uint32_t x = 0; x < v->size[0]; x++) {                                        \
                    bool is_finite = isfinite(row[x]);                                             \
                    nonfinite += !is_finite;                                                       \
                    least = is_finite && row[x] < least ? row[x] : least;                          \
                    most = is_finite && row[x] > most ? row[x] : most;                             \
                    is_constant = is_constant && memcmp(row + x, start, sizeof *row) == 0;         \
                }                                                                                  \
            }                                                                                      \
        *range = (struct sp_brick_range){ (double)least, (double)most, nonfinite, is_constant };   \
    }

INTEGER_RANGE(uint8, uint8_t)
INTEGER_RANGE(int8, int8_t)
INTEGER_RANGE(uint16, uint16_t)
INTEGER_RANGE(int16, int16_t)
INTEGER_RANGE(int32, int32_t)
REAL_RANGE(float32, float)
REAL_RANGE(float64, double)

struct sp_brick_range sp_brick_measure_range(const struct sp_brick_view *view) {
    static void (*const measure[SP_TYPE_COUNT])(
        const struct sp_brick_view *,
        struct sp_brick_range *) = { range_uint8, range_int8,    range_uint16, range_int16,
                                     range_int32, range_float32, range_float64 };
    struct sp_brick_range range;
    measure[view->type](view, &range);
    return range;
}

void sp_brick_copy(const struct sp_brick_view *v, void *out) {
    const size_t sample = sp_type_size(v->type), row = v->size[0] * sample;
    char *to = out;
    for (uint32_t z = 0; z < v->size[2]; z++)
        for (uint32_t y = 0; y < v->size[1]; y++, to += row)
            memcpy(to, (const char *)v->samples + row_at(v, y, z) * sample, row);
}

/* Offsets of the samples that one sample of the next level replaces. */
struct eight {
    size_t at[8];
    int count;
};

static inline struct eight list_eight(const struct sp_brick_view *v, uint32_t x, uint32_t y,
                                      uint32_t z) {
    struct eight e = { .count = 0 };
    for (uint32_t k = 0; k < 8; k++) {
        uint32_t i = 2 * x + (k & 1), j = 2 * y + (k >> 1 & 1), l = 2 * z + (k >> 2);
        if (i < v->size[0] && j < v->size[1] && l < v->size[2])
            e.at[e.count++] = row_at(v, j, l) + i;
    }
    return e;
}

/* A mean of fewer than eight samples, at the far ends of a volume. */
#define EDGE_AVERAGE(name, element)                                                                \
    static element edge_##name(const struct sp_brick_view *v, uint32_t x, uint32_t y,              \
                               uint32_t z) {                                                       \
        struct eight e = list_eight(v, x, y, z);                                                   \
        double sum = 0;                                                                            \
        for (int k = 0; k < e.count; k++)                                                          \
            sum += ((const element *)v->samples)[e.at[k]];                                         \
        return (element)lrint(sum / e.count);                                                      \
    }

/* Of eight integers: sum / 8, and halves to the even neighbour, as lrint() rounds. `total` has at
 * least three bits more than `element`. */
#define INTEGER_AVERAGE(name, element, total)                                                      \
    EDGE_AVERAGE(name, element)                                                                    \
    static void average_##name(const struct sp_brick_view *v, uint32_t y, uint32_t z,              \
                               uint32_t width, void *out) {                                        \
        const bool is_whole = 2 * y + 1 < v->size[1] && 2 * z + 1 < v->size[2];                    \
        const uint32_t pairs = is_whole ? v->size[0] / 2 : 0;                                      \
        const element *a = (const element *)v->samples + row_at(v, 2 * y, 2 * z);                  \
        const element *b = pairs ? a + v->width : a, *c = pairs ? a + v->height * v->width : a;    \
        const element *d = pairs ? c + v->width : a;                                               \
        element *means = out;                                                                      \
        for (uint32_t x = 0; x < pairs; x++) {                                                     \
            const uint32_t i = 2 * x, j = i + 1;                                                   \
            const total sum = (total)a[i] + a[j] + b[i] + b[j] + c[i] + c[j] + d[i] + d[j];        \
            means[x] = (element)((sum + 3 + ((sum >> 3) & 1)) >> 3);                               \
        }                                                                                          \
        for (uint32_t x = pairs; x < width; x++)                                                   \
            means[x] = edge_##name(v, x, y, z);                                                    \
    }

#define REAL_AVERAGE(name, element)                                                                \
    static void average_##name(const struct sp_brick_view *v, uint32_t y, uint32_t z,              \
                               uint32_t width, void *out) {                                        \
        for (uint32_t x = 0; x < width; x++) {                                                     \
            struct eight e = list_eight(v, x, y, z);                                               \
            double sum = 0;                                                                        \
            int count = 0;                                                                         \
            for (int k = 0; k < e.count; k++) {                                                    \
                double value = (double)((const element *)v->samples)[e.at[k]];                     \
                sum += isfinite(value) ? value : 0;                                                \
                count += isfinite(value);                                                          \
            }                                                                                      \
            ((element *)out)[x] = (element)(count ? sum / count : (double)NAN);                    \
        }                                                                                          \
    }

INTEGER_AVERAGE(uint8, uint8_t, int32_t)
INTEGER_AVERAGE(int8, int8_t, int32_t)
INTEGER_AVERAGE(uint16, uint16_t, int32_t)
INTEGER_AVERAGE(int16, int16_t, int32_t)
INTEGER_AVERAGE(int32, int32_t, int64_t)
REAL_AVERAGE(float32, float)
REAL_AVERAGE(float64, double)

/* Copies the sample that the most of the eight have. */
static void choose_label(const struct sp_brick_view *v, uint32_t x, uint32_t y, uint32_t z,
                         char *out) {
    const size_t sample = sp_type_size(v->type);
    const struct eight e = list_eight(v, x, y, z);
    const char *chosen = (const char *)v->samples + e.at[0] * sample;
    double values[8];
    size_t at[8];
    int count = 0;
    for (int k = 0; k < e.count; k++) {
        const double value = sp_sample(v->samples, v->type, e.at[k]);
        at[count] = e.at[k];
        values[count] = value;
        count += isfinite(value);
    }
    const double found = count ? sp_majority(values, count) : 0;
    for (int k = 0; k < count; k++)
        if (values[k] == found) {
            chosen = (const char *)v->samples + at[k] * sample;
            break;
        }
    memcpy(out, chosen, sample);
}

static void choose_labels(const struct sp_brick_view *v, uint32_t y, uint32_t z, uint32_t width,
                          void *out) {
    for (uint32_t x = 0; x < width; x++)
        choose_label(v, x, y, z, (char *)out + x * sp_type_size(v->type));
}

void sp_brick_average(const struct sp_brick_view *v, void *out) {
    static void (*const average[SP_TYPE_COUNT])(
        const struct sp_brick_view *, uint32_t, uint32_t, uint32_t,
        void *) = { average_uint8, average_int8,    average_uint16, average_int16,
                    average_int32, average_float32, average_float64 };
    const uint32_t width = (v->size[0] + 1) / 2, height = (v->size[1] + 1) / 2;
    const size_t row = width * sp_type_size(v->type);
    char *to = out;
    for (uint32_t z = 0; 2 * z < v->size[2]; z++)
        for (uint32_t y = 0; y < height; y++, to += row)
            (v->are_labels ? choose_labels : average[v->type])(v, y, z, width, to);
}

/* The mean of up to eight vectors: cell (x, y, z) of the next level. */
static void average_vector(const struct sp_brick_view *v, uint32_t x, uint32_t y, uint32_t z,
                           float out[3]) {
    const float *numbers = v->samples;
    double sum[3] = { 0, 0, 0 };
    int count = 0;
    for (uint32_t k = 0; k < 8; k++) {
        const uint32_t i = 2 * x + (k & 1), j = 2 * y + (k >> 1 & 1), l = 2 * z + (k >> 2);
        if (3 * i >= v->size[0] || j >= v->size[1] || l >= v->size[2])
            continue;
        const float *one = numbers + row_at(v, j, l) + (size_t)3 * i;
        if (!isfinite(one[0]) || !isfinite(one[1]) || !isfinite(one[2]))
            continue;
        for (int c = 0; c < 3; c++)
            sum[c] += (double)one[c];
        count++;
    }
    for (int c = 0; c < 3; c++)
        out[c] = count ? (float)(sum[c] / count) : NAN;
}

void sp_brick_average_vectors(const struct sp_brick_view *v, float (*out)[3]) {
    const uint32_t width = (v->size[0] / 3 + 1) / 2, height = (v->size[1] + 1) / 2;
    for (uint32_t z = 0; 2 * z < v->size[2]; z++)
        for (uint32_t y = 0; y < height; y++)
            for (uint32_t x = 0; x < width; x++)
                average_vector(v, x, y, z, *out++);
}

double sp_brick_longest(const float (*vectors)[3], size_t count) {
    double longest = 0;
    for (size_t i = 0; i < count; i++) {
        const double x = (double)vectors[i][0], y = (double)vectors[i][1],
                     z = (double)vectors[i][2], square = x * x + y * y + z * z;
        if (isfinite(square) && square > longest)
            longest = square;
    }
    return sqrt(longest);
}

#define COUNT(element)                                                                             \
    for (size_t i = 0; i < count; i++) {                                                           \
        const double value = (double)((const element *)samples)[i];                                \
        if (isfinite(value))                                                                       \
            histogram[sp_bin_of(&bins, value)]++;                                                  \
    }

void sp_brick_count_values(const void *samples, enum sp_type type, size_t count,
                           const double range[2], uint64_t histogram[SP_HISTOGRAM_BINS]) {
    const struct sp_bins bins = sp_bins_between(range[0], range[1], SP_HISTOGRAM_BINS);
    switch (type) { SP_TYPE_CASES(COUNT) }
}
