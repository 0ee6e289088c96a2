/* SPDX-License-Identifier: Apache-2.0
 *
 * How the numbers of an array become samples, by the attributes of NetCDF and CF.
 */
#include <math.h>
#include <string.h>
#include <strings.h>

#include "data/import/array_reader.h"

/* The value that NetCDF writes where a program wrote none. */
#define NETCDF_FILL 9.9692099683868690e+36

static bool is_float(enum sp_type type) {
    return type == SP_FLOAT32 || type == SP_FLOAT64;
}

/* An attribute about the numbers as they are stored. With _Unsigned, it is written as if they had a
 * sign, or none. */
static double stored_value(struct import_number number, const struct array_info *info,
                           double value) {
    const double turn = ldexp(1, 8 * (int)number.size);
    if (number.kind == info->number.kind)
        return value;
    if (number.kind == IMPORT_UNSIGNED)
        return value < 0 ? value + turn : value;
    return value >= turn / 2 ? value - turn : value;
}

/* The number that NetCDF writes where a program wrote none (NC_FILL_SHORT and others). Bytes have
 * none: all of them may be samples. */
static bool default_fill(struct import_number number, double *fill) {
    const bool is_signed = number.kind == IMPORT_SIGNED;
    switch (number.kind == IMPORT_FLOAT ? 0 : number.size) {
    case 0:
        *fill = NETCDF_FILL;
        return true;
    case 2:
        *fill = is_signed ? -32767.0 : 65535.0;
        return true;
    case 4:
        *fill = is_signed ? -2147483647.0 : 4294967295.0;
        return true;
    case 8:
        *fill = is_signed ? -9223372036854775806.0 : 18446744073709551614.0;
        return true;
    default:
        return false;
    }
}

/* Numbers that stand for no sample: _FillValue and missing_value, and those outside of valid_range
 * or of valid_min and valid_max. Returns whether there is a _FillValue. */
static bool read_missing(const struct arrays *a, unsigned n, const struct array_info *info,
                         struct import_conversion *c) {
    double values[IMPORT_MISSING_MAX], range[2] = { -INFINITY, INFINITY };
    const bool has_fill = a->call->numbers(a->handle, n, "_FillValue", values, 1) == 1;
    if (has_fill)
        import_conversion_add_missing(c, stored_value(c->number, info, values[0]));
    const size_t count =
        a->call->numbers(a->handle, n, "missing_value", values + 1, IMPORT_MISSING_MAX - 1);
    for (size_t i = 1; i <= count; i++)
        import_conversion_add_missing(c, stored_value(c->number, info, values[i]));
    if (a->call->numbers(a->handle, n, "valid_range", range, 2) != 2) {
        range[0] = -INFINITY;
        range[1] = INFINITY;
        a->call->numbers(a->handle, n, "valid_min", &range[0], 1);
        a->call->numbers(a->handle, n, "valid_max", &range[1], 1);
    }
    range[0] = stored_value(c->number, info, range[0]);
    range[1] = stored_value(c->number, info, range[1]);
    const bool is_scaled = import_number_is_whole(c->number) && /* the range is of the samples */
                           ((isfinite(range[0]) && trunc(range[0]) != range[0]) ||
                            (isfinite(range[1]) && trunc(range[1]) != range[1]));
    if (!is_scaled && range[0] <= range[1] && (isfinite(range[0]) || isfinite(range[1])))
        import_conversion_set_range(c, range[0], range[1]);
    return has_fill;
}

static struct import_number number_of(const struct arrays *a, unsigned n,
                                      const struct array_info *info) {
    struct import_number number = info->number;
    char text[16];
    a->call->text(a->handle, n, "_Unsigned", text, sizeof text);
    if (strcasecmp(text, "true") == 0 && number.kind == IMPORT_SIGNED)
        number.kind = IMPORT_UNSIGNED;
    else if (strcasecmp(text, "false") == 0 && number.kind == IMPORT_UNSIGNED)
        number.kind = IMPORT_SIGNED;
    return number;
}

bool arrays_read_packing(const struct arrays *a, unsigned n, const struct array_info *info,
                         struct import_conversion *c) {
    double value;
    *c = import_conversion_of(number_of(a, n, info), a->file->warnings);
    const bool has_fill = read_missing(a, n, info, c);
    if (a->call->numbers(a->handle, n, "scale_factor", &value, 1) && isfinite(value) && value != 0)
        c->slope = value;
    if (a->call->numbers(a->handle, n, "add_offset", &value, 1) && isfinite(value))
        c->offset = value;
    return has_fill;
}

void arrays_set_conversion(struct arrays *a, struct import_header *header) {
    struct import_conversion *c = &a->conversion;
    double fill;
    const bool has_fill = arrays_read_packing(a, a->chosen, &a->info, c);
    a->default_fill = NAN;
    if (!has_fill && a->info.has_default_fill && default_fill(a->info.number, &fill))
        a->default_fill = stored_value(c->number, &a->info, fill);
    if ((c->slope != 1 || c->offset != 0) && !is_float(c->type))
        c->type = c->number.size <= 2 ? SP_FLOAT32 : SP_FLOAT64;
    /* Whole numbers stay so unless a sample is missing, and float64 does not tell all of 8 bytes
     * apart: the caller looks for them. */
    const bool is_exact = is_float(c->type) &&
                          (!import_number_is_whole(c->number) || c->number.size < sizeof(double));
    if (is_exact && !isnan(a->default_fill))
        arrays_use_default_fill(a);
    header->type = c->type;
}

void arrays_use_default_fill(struct arrays *a) {
    import_conversion_add_missing(&a->conversion, a->default_fill);
    a->default_fill = NAN;
}

bool arrays_read_numbers(const struct arrays *a, const char *path, unsigned rank, unsigned side,
                         double *out) {
    const unsigned count = rank == 1 ? side : side * side;
    char bytes[ARRAYS_SIDE_MAX * ARRAYS_SIDE_MAX * IMPORT_NUMBER_BYTES];
    const uint64_t start[IMPORT_RANK_MAX] = { 0 };
    struct array_info info;
    for (unsigned n = 0; a->call->describe(a->handle, n, &info); n++) {
        if (strcmp(info.name, path) != 0)
            continue;
        if (!info.is_number || info.rank != rank || info.shape[0] != side ||
            info.shape[rank - 1] != side)
            return false;
        bool ok = a->call->read(a->handle, n, start, info.shape, bytes, NULL);
        for (unsigned i = 0; ok && i < count; i++) {
            out[i] = import_widen(bytes + i * info.number.size, info.number);
            ok = isfinite(out[i]);
        }
        return ok;
    }
    return false;
}
