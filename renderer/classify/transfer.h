/* SPDX-License-Identifier: Apache-2.0
 *
 * Classification finds the voxels of a volume that are visible under a transfer function, and their
 * colours, extinctions and gradients. Results are cached; after a change only the affected parts
 * are computed again.
 *
 *   volume ─┬► transfer (value → colour, optical depth) ─► visible (lists slice by slice) ─► splat/
 *           └► gradient (quantised, of visible voxels, when shading asks) ───────┘
 *
 * This header evaluates transfer functions fast. A list stores the value of a voxel as a *key*: for
 * 8- and 16-bit types an index into an exact table, for other types the bits of the float
 * (value − base). The function of such a float is evaluated exactly when a splat is set up.
 */
#ifndef SP_CLASSIFY_TRANSFER_H
#define SP_CLASSIFY_TRANSFER_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/status.h"
#include "sp/view.h"
#include "sp/volume.h"

/* One classified value. depth = −ln(1 − opacity) is the optical depth over one reference length, so
 * that the extinction is depth / reference_length [1/world unit]; 0 = transparent. */
struct sp_class {
    float color[3], depth;
};

/* The transfer function in single precision, as linear pieces. Piece s holds the values from
 * start[s] on, relative to the base. The red, green, blue and opacity (c = 0 … 3) of a value are
 * at[c][s] + (value − start[s])·slope[c][s]. Piece 0 holds the values below the first point. See
 * splat/pieces.h. */
struct sp_pieces {
    uint32_t count;
    float start[SP_TF_POINTS_MAX + 1], at[4][SP_TF_POINTS_MAX + 1], slope[4][SP_TF_POINTS_MAX + 1];
};

struct sp_transfer {
    struct sp_transfer_function tf; /* a copy of the function */
    enum sp_type type;
    struct sp_class *table;   /* [value − first], owned; NULL for types without a table */
    uint8_t *is_visible;      /* parallel to the table, owned: 1 = depth > 0 */
    int32_t first;            /* value of table[0]: sp_transfer_first() */
    uint32_t count;           /* entries */
    double base;              /* value of key 0.0f; types without a table */
    struct sp_pieces *pieces; /* owned; NULL for types with a table */
    float *scale; /* factor of the opacity, by packed magnitude (gradient.h), owned; NULL = no
                     gradient axis */
};

/* Returns the first value of the table: the smallest value of the volume. If the volume is larger
 * than memory: the smallest value of its type. Only for types with a table. */
int32_t sp_transfer_first(const struct sp_volume_info *info);

/* Computes the table for the values of the volume. `like`: a transfer of the same volume; parts of
 * its table that are equal are copied; NULL = nothing is copied. SP_ERR_MEMORY; *transfer is then
 * all zero. */
bool sp_transfer_init(struct sp_transfer *transfer, const struct sp_transfer_function *tf,
                      const struct sp_volume_info *info, const struct sp_transfer *like,
                      struct sp_error *err);
void sp_transfer_finish(struct sp_transfer *transfer);

/* Returns the factor of the opacity at a gradient magnitude [data units per world unit]: linear
 * between the points of the gradient axis, constant beyond its ends; 1 without a gradient axis. */
double sp_transfer_function_scale(const struct sp_transfer_function *tf, double magnitude);

/* True if both functions have the same gradient axis: the same factor of the opacity at every
 * gradient. */
bool sp_transfer_function_equal_scale(const struct sp_transfer_function *a,
                                      const struct sp_transfer_function *b);

/* True if both give each voxel of a volume the same key and visibility. A list made for one then
 * serves the other. */
bool sp_transfer_same_voxels(const struct sp_transfer *a, const struct sp_transfer *b);

/* Evaluates the transfer function: linear between points, constant beyond the ends; a value that is
 * not finite is transparent. */
void sp_transfer_function_eval(const struct sp_transfer_function *tf, double value,
                               struct sp_class *out);

/* Computes the keys of the samples [begin, begin + count) of the array. visible[i] = 1 if sample
 * begin + i is visible, else 0. */
void sp_transfer_keys(const struct sp_transfer *transfer, const void *voxels, size_t begin,
                      size_t count, uint32_t *keys, uint8_t *visible);

/* The zero point of sp_transfer_value() [data unit]. */
static inline double sp_transfer_base(const struct sp_transfer *transfer) {
    return transfer->table ? (double)transfer->first : transfer->base;
}

/* Bytes per key: 1 or 2 with a table, otherwise 4. */
static inline uint32_t sp_transfer_key_bytes(const struct sp_transfer *transfer) {
    if (!transfer->table)
        return 4;
    return transfer->type == SP_UINT8 || transfer->type == SP_INT8 ? 1 : 2;
}

/* True if lists need the magnitudes of gradients. */
static inline bool sp_transfer_wants_magnitudes(const struct sp_transfer_function *tf) {
    return tf->gradient_count > 0 || tf->order == SP_TF_POST;
}

/* Returns the value of a key, relative to the base. */
static inline float sp_transfer_value(const struct sp_transfer *transfer, uint32_t key) {
    union {
        uint32_t bits;
        float value;
    } u = { .bits = key };
    return transfer->table ? (float)key : u.value;
}

/* Returns the class of a value of the volume [data unit]. */
static inline struct sp_class sp_transfer_value_class(const struct sp_transfer *transfer,
                                                      double value) {
    struct sp_class c;
    if (transfer->table)
        return transfer->table[(int32_t)value - transfer->first];
    sp_transfer_function_eval(&transfer->tf, value, &c);
    return c;
}

/* Returns the class of a key. */
static inline struct sp_class sp_transfer_class(const struct sp_transfer *transfer, uint32_t key) {
    struct sp_class c;
    if (transfer->table)
        return transfer->table[key];
    union {
        uint32_t bits;
        float value;
    } u = { .bits = key };
    sp_transfer_function_eval(&transfer->tf, transfer->base + (double)u.value, &c);
    return c;
}

/* Returns the class at a packed gradient: scales the opacity, not the depth. */
static inline struct sp_class sp_transfer_scale_class(const struct sp_transfer *transfer,
                                                      struct sp_class c, uint32_t gradient) {
    float scale = transfer->scale ? transfer->scale[gradient >> 22] : 1;
    if (scale < 1)
        c.depth = scale > 0 ? -log1pf(scale * expm1f(-c.depth)) : 0;
    return c;
}

/* Returns the class of a key at a packed gradient. */
static inline struct sp_class sp_transfer_class_at(const struct sp_transfer *transfer, uint32_t key,
                                                   uint32_t gradient) {
    return sp_transfer_scale_class(transfer, sp_transfer_class(transfer, key), gradient);
}

#endif
