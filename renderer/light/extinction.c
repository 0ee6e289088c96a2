/* SPDX-License-Identifier: Apache-2.0
 *
 * The mean extinction of each cell. Between two neighbouring samples the value changes linearly, so
 * the mean of the transfer function is a difference of its integral: a surface that is thinner than
 * a sample keeps its optical depth. A cell takes the mean over its pairs of neighbours along all
 * three axes.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "classify/transfer.h"
#include "light/light.h"
#include "volume/grid.h"
#include "volume/sample.h"

enum { BINS = 4096, PER_CELL_MAX = 4, POSITIONS_MAX = PER_CELL_MAX + 1 };

/* The integral of optical depth over values. Position t = (value − low)·per_unit. */
struct integral {
    double low, per_unit;
    struct {
        double sum, slope; /* at the bin's start; inside of it */
    } bins[BINS + 2];      /* bin −1, which holds what lies below, comes first */
};

/* Mean depth between any two samples of one byte, by their bits. */
struct byte_means {
    float between[256][256];
};

struct half {
    double normal[3], offset; /* cell coordinates; the normal has length 1 */
};

struct extinction {
    struct sp_light_slot *slot;
    const struct sp_volume_info *info;
    const void *voxels;
    const struct sp_interrupt *interrupt;
    struct integral *integral;
    struct byte_means *bytes; /* NULL = of a type that has more values, or with a gradient axis */
    unsigned per_cell;   /* positions per cell and axis; the last one belongs to the next cell */
    uint32_t *sample[3]; /* sample at each position along the axes, owned */
    float *ranges;       /* per worker: two rows of samples, owned */
    struct half halves[6 + SP_CLIP_PLANES_MAX];
    int half_count;
};

static double depth_at(const struct sp_transfer_function *tf, double value) {
    struct sp_class class;
    sp_transfer_function_eval(tf, value, &class);
    return (double)class.depth;
}

static void init_integral(struct integral *f, const struct sp_transfer_function *tf) {
    enum { PARTS = 4 };
    double low = tf->points[0].value, high = tf->points[tf->point_count - 1].value;
    if (!(high > low))
        high = low + fmax(1e-6, fabs(low) * 1e-6);
    double step = high / BINS - low / BINS, sum = 0; /* the difference may overflow */
    f->low = low;
    f->per_unit = 1 / step;
    f->bins[0].sum = 0;
    f->bins[0].slope = depth_at(tf, low);
    for (int i = 0; i < BINS; i++) {
        double mean = 0;
        for (int k = 0; k < PARTS; k++)
            mean += depth_at(tf, low + (i + (k + 0.5) / PARTS) * step) / PARTS;
        f->bins[i + 1].sum = sum;
        f->bins[i + 1].slope = mean;
        sum += mean;
    }
    f->bins[BINS + 1].sum = sum;
    f->bins[BINS + 1].slope = depth_at(tf, high);
}

struct place {
    double t, sum, slope; /* t NaN: the sample is not finite */
};

static inline struct place place_of(const struct integral *f, double value) {
    const double far = 1e9; /* sums stay finite */
    double t = value * f->per_unit - f->low * f->per_unit;
    t = t > -far ? t : -far; /* NaN, too */
    t = t < far ? t : far;
    int i = t < 0 ? -1 : t < BINS ? (int)t : BINS;
    double slope = f->bins[i + 1].slope, start = i < 0 ? 0 : i;
    if (!isfinite(value))
        return (struct place){ NAN, 0, 0 };
    return (struct place){ t, f->bins[i + 1].sum + (t - start) * slope, slope };
}

/* Mean depth between two samples. */
static inline double mean_between(const struct place *a, const struct place *b) {
    double distance = b->t - a->t;
    if (fabs(distance) > 0.01)
        return (b->sum - a->sum) / distance;
    return distance == distance ? 0.5 * (a->slope + b->slope) : 0;
}

/* The share of a cell that clipping keeps. */
static double kept(const struct extinction *x, const uint32_t cell[3]) {
    double share = 1;
    for (int h = 0; h < x->half_count; h++) {
        const struct half *half = &x->halves[h];
        double distance = -half->offset;
        for (int a = 0; a < 3; a++)
            distance += half->normal[a] * cell[a];
        share *= fmin(fmax(distance + 0.5, 0), 1);
    }
    return share;
}

/* Scale of the opacity for the slopes at a sample, as a factor of the depth. */
static double gradient_factor(const struct extinction *x, const double value[4], double depth) {
    const struct sp_transfer_function *tf = &x->slot->tf;
    double square = 0;
    for (int a = 0; a < 3; a++) {
        double width = x->info->grid.spacing[a] * x->slot->side / x->per_cell;
        double slope = (value[a + 1] - value[0]) / width;
        square += isfinite(slope) ? slope * slope : 0;
    }
    double opacity = -expm1(-depth) * sp_transfer_function_scale(tf, sqrt(square));
    return depth > 0 ? -log1p(-fmin(opacity, 1 - 1e-12)) / depth : 0;
}

static void init_byte_means(struct byte_means *means, const struct integral *f, bool is_signed) {
    struct place places[256];
    for (int i = 0; i < 256; i++)
        places[i] = place_of(f, is_signed && i > 127 ? i - 256 : i);
    for (int i = 0; i < 256; i++)
        for (int k = 0; k <= i; k++)
            means->between[i][k] = means->between[k][i] =
                (float)mean_between(&places[k], &places[i]);
}

/* find_cell() for samples of one byte. */
static double find_cell_of_bytes(const struct extinction *x, const uint32_t first[3]) {
    const unsigned n = x->per_cell;
    const uint32_t *dims = x->info->grid.dims, *columns = x->sample[0] + first[0];
    float sum = 0;
    for (unsigned k = 0; k < n; k++)
        for (unsigned j = 0; j < n; j++) {
            const uint8_t *lines[3]; /* this one, and the next ones along both axes */
            for (unsigned i = 0; i < 3; i++) {
                const uint32_t *rows = x->sample[1] + first[1] + j + (i == 1);
                const uint32_t *slices = x->sample[2] + first[2] + k + (i == 2);
                uint64_t line = (uint64_t)*slices * dims[1] + *rows;
                lines[i] = (const uint8_t *)x->voxels + line * dims[0];
            }
            for (unsigned i = 0; i < n; i++) {
                const float *means = x->bytes->between[lines[0][columns[i]]];
                sum += means[lines[0][columns[i + 1]]] + means[lines[1][columns[i]]] +
                       means[lines[2][columns[i]]];
            }
        }
    return (double)sum / (3 * n * n * n);
}

/* The mean over the cell whose first positions are given. */
static double find_cell(const struct extinction *x, const uint32_t first[3]) {
    struct place places[POSITIONS_MAX * POSITIONS_MAX * POSITIONS_MAX];
    double values[POSITIONS_MAX * POSITIONS_MAX * POSITIONS_MAX];
    const unsigned n = x->per_cell, steps[3] = { 1, n + 1, (n + 1) * (n + 1) };
    const uint32_t *dims = x->info->grid.dims;
    unsigned at = 0;
    for (unsigned k = 0; k <= n; k++)
        for (unsigned j = 0; j <= n; j++) {
            uint64_t row =
                ((uint64_t)x->sample[2][first[2] + k] * dims[1] + x->sample[1][first[1] + j]) *
                dims[0];
            for (unsigned i = 0; i <= n; i++, at++) {
                values[at] = sp_sample(x->voxels, x->info->type, row + x->sample[0][first[0] + i]);
                places[at] = place_of(x->integral, values[at]);
            }
        }
    double sum = 0;
    bool is_scaled = x->slot->tf.gradient_count > 0;
    for (unsigned k = 0; k < n; k++)
        for (unsigned j = 0; j < n; j++)
            for (unsigned i = 0; i < n; i++) {
                unsigned p = i + j * steps[1] + k * steps[2];
                double depth = 0, value[4] = { values[p] };
                for (int a = 0; a < 3; a++) {
                    depth += mean_between(&places[p], &places[p + steps[a]]) / 3;
                    value[a + 1] = values[p + steps[a]];
                }
                sum += is_scaled ? depth * gradient_factor(x, value, depth) : depth;
            }
    return sum / (n * n * n);
}

#define RANGE(type)                                                                                \
    for (uint32_t i = 0; i < count; i++) {                                                         \
        float value = (float)((const type *)x->voxels)[row + i];                                   \
        low[i] = value < low[i] ? value : low[i];                                                  \
        high[i] = value > high[i] ? value : high[i];                                               \
    }

/* Joins the ranges of the samples of a row. Values that are not finite change nothing. */
static void join_row(const struct extinction *x, uint64_t row, float *low, float *high) {
    uint32_t count = x->info->grid.dims[0];
    switch (x->info->type) {
    case SP_UINT8:
        RANGE(uint8_t)
        break;
    case SP_INT8:
        RANGE(int8_t)
        break;
    case SP_UINT16:
        RANGE(uint16_t)
        break;
    case SP_INT16:
        RANGE(int16_t)
        break;
    case SP_INT32:
        RANGE(int32_t)
        break;
    case SP_FLOAT32:
        RANGE(float)
        break;
    default:
        for (uint32_t i = 0; i < count; i++) {
            float value = (float)sp_sample(x->voxels, x->info->type, row + i);
            low[i] = value < low[i] ? value : low[i];
            high[i] = value > high[i] ? value : high[i];
        }
    }
}

/* False if the transfer function shows nothing between two values. */
static bool shows(const struct integral *f, float low, float high) {
    if (!(low <= high))
        return false;
    double step = 1 / f->per_unit; /* floats round the larger types */
    struct place a = place_of(f, fmax((double)low - step, -1e300));
    struct place b = place_of(f, fmin((double)high + step, 1e300));
    return b.sum > a.sum || a.slope > 0 || b.slope > 0;
}

/* Fills the means of a row of cells from those of its samples' ranges that show something. */
static void find_shown(const struct extinction *x, uint32_t j, uint32_t k, const float *low,
                       const float *high, float *out) {
    const unsigned n = x->per_cell;
    uint32_t first[3] = { 0, (j - 1) * n, (k - 1) * n };
    for (uint32_t i = 1; i + 1 < x->slot->dims[0]; i++) {
        float least = INFINITY, most = -INFINITY;
        first[0] = (i - 1) * n;
        for (uint32_t s = x->sample[0][first[0]]; s <= x->sample[0][first[0] + n]; s++) {
            least = low[s] < least ? low[s] : least;
            most = high[s] > most ? high[s] : most;
        }
        if (shows(x->integral, least, most))
            out[i] = (float)(find_cell(x, first) * kept(x, (const uint32_t[3]){ i, j, k }));
    }
}

/* The same for samples of one byte; flip: makes them rise like unsigned ones. */
static void find_shown_bytes(const struct extinction *x, uint32_t j, uint32_t k, uint8_t flip,
                             const uint8_t *low, const uint8_t *high, float *out) {
    const unsigned n = x->per_cell;
    uint32_t first[3] = { 0, (j - 1) * n, (k - 1) * n };
    for (uint32_t i = 1; i + 1 < x->slot->dims[0]; i++) {
        uint8_t least = UINT8_MAX, most = 0;
        first[0] = (i - 1) * n;
        for (uint32_t s = x->sample[0][first[0]]; s <= x->sample[0][first[0] + n]; s++) {
            least = low[s] < least ? low[s] : least;
            most = high[s] > most ? high[s] : most;
        }
        if (x->bytes->between[least ^ flip][most ^ flip] > 0)
            out[i] =
                (float)(find_cell_of_bytes(x, first) * kept(x, (const uint32_t[3]){ i, j, k }));
    }
}

/* Joins the ranges of the samples of a row. */
static void join_bytes(const uint8_t *row, uint32_t count, uint8_t flip, uint8_t *low,
                       uint8_t *high) {
    for (uint32_t i = 0; i < count; i++) {
        uint8_t value = row[i] ^ flip;
        low[i] = value < low[i] ? value : low[i];
        high[i] = value > high[i] ? value : high[i];
    }
}

/* A row of cells along the first axis. low, high: rows of samples. */
static void find_row(const struct extinction *x, uint32_t j, uint32_t k, float *low, float *high) {
    const uint32_t *cells = x->slot->dims, *dims = x->info->grid.dims;
    const unsigned n = x->per_cell;
    const uint32_t *rows = x->sample[1] + (j - 1) * n, *slices = x->sample[2] + (k - 1) * n;
    float *out = x->slot->extinction + ((size_t)k * cells[1] + j) * cells[0];
    uint8_t flip = x->info->type == SP_INT8 ? 0x80 : 0;
    if (x->bytes) {
        memset(low, UINT8_MAX, dims[0]);
        memset(high, 0, dims[0]);
    }
    for (uint32_t i = 0; i < dims[0] && !x->bytes; i++) {
        low[i] = INFINITY;
        high[i] = -INFINITY;
    }
    for (unsigned l = 0; l <= n; l++)
        for (unsigned m = 0; m <= n; m++) {
            uint64_t row = ((uint64_t)slices[l] * dims[1] + rows[m]) * dims[0];
            if (x->bytes)
                join_bytes((const uint8_t *)x->voxels + row, dims[0], flip, (uint8_t *)low,
                           (uint8_t *)high);
            else
                join_row(x, row, low, high);
        }
    if (x->bytes)
        find_shown_bytes(x, j, k, flip, (const uint8_t *)low, (const uint8_t *)high, out);
    else
        find_shown(x, j, k, low, high, out);
}

static void find_rows(void *user, size_t begin, size_t end, unsigned worker) {
    const struct extinction *x = user;
    const uint32_t *cells = x->slot->dims;
    size_t length = x->info->grid.dims[0];
    float *range = x->ranges + worker * 2 * length;
    for (size_t r = begin; r < end && !sp_interrupt_is_cancelled(x->interrupt); r++)
        find_row(x, (uint32_t)(r % (cells[1] - 2)) + 1, (uint32_t)(r / (cells[1] - 2)) + 1, range,
                 range + length);
}

/* The samples at evenly spaced coordinates. */
static bool find_positions(struct extinction *x) {
    const struct sp_grid *grid = &x->info->grid;
    for (unsigned a = 0; a < 3; a++) {
        uint32_t count = (x->slot->dims[a] - 2) * x->per_cell + 1, last = grid->dims[a] - 1, s = 0;
        x->sample[a] = malloc(count * sizeof *x->sample[a]);
        if (!x->sample[a])
            return false;
        for (uint32_t i = 0; i < count; i++) {
            double at = (double)i * x->slot->side / x->per_cell * grid->spacing[a];
            while (s < last && sp_grid_distance(grid, a, s + 1) <= at * (1 + 1e-9))
                s++;
            x->sample[a][i] = s;
        }
    }
    return true;
}

static void add_half(struct extinction *x, const double normal[3], double offset) {
    double length = sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    struct half *half = &x->halves[x->half_count++];
    for (int a = 0; a < 3; a++)
        half->normal[a] = normal[a] / length;
    half->offset = offset / length;
}

/* What clipping keeps, in cell coordinates: world = origin + direction·distance, and
 * distance = ((cell − ½)·side − ½)·spacing. */
static void find_halves(struct extinction *x) {
    const struct sp_grid *grid = &x->info->grid;
    const struct sp_clip *clip = &x->slot->clip;
    double side = x->slot->side;
    for (unsigned a = 0; a < 3; a++)
        for (int end = 0; end < 2; end++) {
            double extent[2], normal[3] = { 0 }, sign = end ? -1 : 1;
            if (clip->box[end][a] == end)
                continue;
            sp_grid_extent(grid, a, extent);
            double distance = extent[0] + clip->box[end][a] * (extent[1] - extent[0]);
            normal[a] = sign;
            add_half(x, normal, sign * ((distance / grid->spacing[a] + 0.5) / side + 0.5));
        }
    for (uint32_t i = 0; i < clip->plane_count; i++) {
        const double *n = clip->planes[i].normal;
        double largest = fmax(fabs(n[0]), fmax(fabs(n[1]), fabs(n[2]))), normal[3] = { 0 };
        double offset = clip->planes[i].offset / largest;
        for (int r = 0; r < 3; r++) {
            offset -= n[r] / largest * grid->origin[r];
            for (int a = 0; a < 3; a++)
                normal[a] += n[r] / largest * grid->direction[r][a] * grid->spacing[a] * side;
        }
        for (int a = 0; a < 3; a++)
            offset += normal[a] * (0.5 + 0.5 / side);
        add_half(x, normal, offset);
    }
}

bool sp_extinction_find(struct sp_light_slot *slot, const struct sp_light_job *job,
                        struct sp_error *err) {
    struct extinction x = { .slot = slot,
                            .info = sp_volume_info(job->volume),
                            .voxels = sp_volume_voxels(job->volume),
                            .interrupt = &job->interrupt,
                            .per_cell = slot->side < PER_CELL_MAX ? slot->side : PER_CELL_MAX };
    memset(slot->extinction, 0,
           sizeof *slot->extinction * slot->dims[0] * slot->dims[1] * slot->dims[2]);
    x.integral = malloc(sizeof *x.integral);
    size_t floats = 2 * (size_t)x.info->grid.dims[0] * sp_pool_threads(job->pool);
    x.ranges = malloc(floats * sizeof *x.ranges);
    bool has_bytes = sp_type_size(x.info->type) == 1 && slot->tf.gradient_count == 0;
    x.bytes = has_bytes ? malloc(sizeof *x.bytes) : NULL;
    bool ok = x.integral && x.ranges && (x.bytes || !has_bytes) && find_positions(&x);
    if (ok) {
        init_integral(x.integral, &slot->tf);
        if (has_bytes)
            init_byte_means(x.bytes, x.integral, x.info->type == SP_INT8);
        find_halves(&x);
        sp_parallel_for(job->pool, (size_t)(slot->dims[1] - 2) * (slot->dims[2] - 2), 16, find_rows,
                        &x);
    }
    free(x.integral);
    free(x.bytes);
    free(x.ranges);
    for (int a = 0; a < 3; a++)
        free(x.sample[a]);
    if (!ok)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the volume's extinction");
    return !sp_interrupt_is_cancelled(&job->interrupt) ||
           sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
}
