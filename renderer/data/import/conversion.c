/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/conversion.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "data/volume/sample.h"

enum { BLOCK = 512 }; /* numbers that are converted at once */
/* float32 holds samples of up to as many slopes with an error of 1/32 of a slope. */
#define FLOAT32_STEPS 0x1p20

struct import_conversion import_conversion_of(struct import_number number,
                                              struct import_warnings *warnings) {
    struct import_conversion c = {
        .number = number, .components = 1, .slope = 1, .warnings = warnings
    };
    double low, high;
    if (import_number_is_complex(number))
        import_warn(warnings, "The samples are complex numbers; their magnitude is shown.");
    import_number_range(number, &low, &high);
    import_conversion_choose(&c, low, high);
    return c;
}

void import_conversion_choose(struct import_conversion *c, double low, double high) {
    static const enum sp_type whole[] = { SP_UINT8, SP_INT8, SP_UINT16, SP_INT16, SP_INT32 };
    const double ends[2] = { c->slope * low + c->offset, c->slope * high + c->offset };
    const bool is_whole = trunc(c->slope) == c->slope && trunc(c->offset) == c->offset;
    if (!import_number_is_whole(c->number)) {
        const struct import_number part = import_number_part(c->number);
        c->type = part.size <= (part.kind == IMPORT_FLOAT ? 4 : 2) ? SP_FLOAT32 : SP_FLOAT64;
        return;
    }
    const double largest = fmax(fabs(ends[0]), fabs(ends[1]));
    const bool is_fine = largest <= FLOAT32_STEPS * fabs(c->slope);
    c->type = c->number.size <= 2 && is_fine ? SP_FLOAT32 : SP_FLOAT64;
    for (size_t i = 0; is_whole && i < sizeof whole / sizeof *whole; i++) {
        double least, most;
        import_number_range(import_number_of(whole[i]), &least, &most);
        if (fmin(ends[0], ends[1]) >= least && fmax(ends[0], ends[1]) <= most) {
            c->type = whole[i];
            return;
        }
    }
}

/* Whole numbers become floating-point ones. */
static void use_floats(struct import_conversion *c) {
    if (import_number_of(c->type).kind != IMPORT_FLOAT)
        c->type = c->number.size <= 2 && c->type != SP_INT32 ? SP_FLOAT32 : SP_FLOAT64;
}

/* A number of a header as the samples store it: 0.1 is not among numbers of 32 bits. */
static double as_stored(const struct import_conversion *c, double number) {
    return c->number.kind == IMPORT_FLOAT && c->number.size == 4 ? (double)(float)number : number;
}

void import_conversion_add_missing(struct import_conversion *c, double number) {
    if (c->missing_count == IMPORT_MISSING_MAX)
        return;
    c->missing[c->missing_count++] = as_stored(c, number);
    use_floats(c);
}

void import_conversion_set_range(struct import_conversion *c, double low, double high) {
    c->has_range = true;
    c->range[0] = as_stored(c, low);
    c->range[1] = as_stored(c, high);
    use_floats(c);
}

bool import_conversion_is_copy(const struct import_conversion *c) {
    const struct import_number same = import_number_of(c->type);
    return c->components == 1 && c->slope == 1 && c->offset == 0 && c->missing_count == 0 &&
           !c->has_range && same.kind == c->number.kind && same.size == c->number.size;
}

/* True if float64 does not hold one of the whole numbers of 8 bytes. */
static bool is_rounded(const char *at, struct import_number number, size_t stride, size_t count,
                       const double *values) {
    for (size_t i = 0; i < count; i++, at += stride) {
        uint64_t bits;
        if (fabs(values[i]) < 0x1p53)
            continue;
        memcpy(&bits, at, sizeof bits);
        if (number.kind == IMPORT_SIGNED
                ? values[i] >= 0x1p63 || (int64_t)values[i] != (int64_t)bits
                : values[i] >= 0x1p64 || (uint64_t)values[i] != bits)
            return true;
    }
    return false;
}

static void mark_missing(const struct import_conversion *c, double *values, size_t count) {
    for (size_t i = 0; i < count; i++) {
        bool is_missing = c->has_range && (values[i] < c->range[0] || values[i] > c->range[1]);
        for (unsigned m = 0; m < c->missing_count; m++)
            is_missing |= values[i] == c->missing[m];
        if (is_missing)
            values[i] = NAN;
    }
}

/* Only colours are floating-point numbers in the file and whole ones in memory. */
static void warn_of_cuts(const struct import_conversion *c, const double *values, size_t count,
                         double least, double most) {
    bool is_cut = false;
    for (size_t i = 0; i < count; i++)
        is_cut |= values[i] >= most + 1 || values[i] <= least - 1;
    if (is_cut)
        import_warn(c->warnings,
                    "Some colours are numbers outside of the range of the format, 0 to %g; they "
                    "were cut.",
                    (most - least) / c->slope);
}

static void put_block(const struct import_conversion *c, const char *at, size_t count, void *out,
                      uint64_t first) {
    const size_t stride = c->components * c->number.size;
    const struct import_number to = import_number_of(c->type);
    double values[BLOCK], least, most;
    import_widen_all(at, c->number, stride, count, values);
    if (c->number.size == 8 && import_number_is_whole(c->number) &&
        is_rounded(at, c->number, stride, count, values))
        import_warn(c->warnings, "Some samples are whole numbers above 2^53; they were rounded.");
    if (c->missing_count > 0 || c->has_range)
        mark_missing(c, values, count);
    if (c->slope != 1 || c->offset != 0)
        for (size_t i = 0; i < count; i++)
            values[i] = c->slope * values[i] + c->offset;
    import_number_range(to, &least, &most);
    if (c->number.kind == IMPORT_FLOAT && to.kind != IMPORT_FLOAT)
        warn_of_cuts(c, values, count, least, most);
    for (size_t i = 0; i < count; i++)
        sp_sample_set(out, c->type, first + i,
                      to.kind == IMPORT_FLOAT ? values[i] : fmin(fmax(values[i], least), most));
}

void import_conversion_put(const struct import_conversion *c, const void *numbers, size_t count,
                           void *out) {
    const char *at = (const char *)numbers + c->component * c->number.size;
    for (size_t i = 0, n; i < count; i += n, at += n * c->components * c->number.size) {
        n = count - i < BLOCK ? count - i : BLOCK;
        put_block(c, at, n, out, i);
    }
}
