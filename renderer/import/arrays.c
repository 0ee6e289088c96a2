/* SPDX-License-Identifier: Apache-2.0
 *
 * HDF5 and NetCDF: one array of a file. The libraries are modules (array_bridge.h).
 */
#include "import/arrays.h"

#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "import/module.h"
#include "import/netcdf_size.h"
#include "volume/volume.h"

enum { BOX_BYTES = 32 << 20 }; /* numbers that are read at once, if a row is not larger */

/* The value that NetCDF writes where a program wrote none. */
#define NETCDF_FILL 9.9692099683868690e+36

static bool is_hdf5(const uint8_t *start, size_t size) {
    return size >= 8 && memcmp(start, "\x89HDF\r\n\x1a\n", 8) == 0;
}

static bool has_ending(const char *shown, const char *ending) {
    const size_t n = strlen(shown), m = strlen(ending);
    return n > m && strcasecmp(shown + n - m, ending) == 0;
}

/* NetCDF-4 files are HDF5 files by their first bytes. */
static bool probe_netcdf(const uint8_t *start, size_t size, const char *shown) {
    const bool is_classic = size >= 4 && memcmp(start, "CDF", 3) == 0 &&
                            (start[3] == 1 || start[3] == 2 || start[3] == 5);
    return is_classic ||
           (is_hdf5(start, size) &&
            (has_ending(shown, ".nc") || has_ending(shown, ".nc4") || has_ending(shown, ".cdf")));
}

/* NetCDF-4 files begin in the same way, so only the name tells which of the two it is. */
static bool probe_hdf5(const uint8_t *start, size_t size, const char *shown) {
    (void)shown;
    return is_hdf5(start, size);
}

bool arrays_fail(const struct arrays *a, struct sp_error *err, enum sp_code code,
                 const char *format, ...) {
    char place[SP_ERROR_PLACE], text[SP_ERROR_TEXT];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    snprintf(place, sizeof place, "%.160s: %.80s", a->file->shown, a->info.name);
    return sp_fail(err, code, place, "%s", text);
}

/* Choosing an array. */

/* True for the arrays that only say where others are: coordinates and their bounds. */
static bool is_of_axis(const struct arrays *a, const struct array_info *info) {
    const char *slash = strrchr(info->name, '/'), *own = slash ? slash + 1 : info->name;
    if (!a->is_netcdf)
        return false;
    if (info->rank == 1 && strcmp(own, info->dims[0]) == 0)
        return true;
    const char *last = info->rank > 0 ? info->dims[info->rank - 1] : "";
    return info->rank == 2 && info->shape[1] == 2 &&
           (strcasecmp(last, "bnds") == 0 || strcasecmp(last, "bounds") == 0 ||
            strcasecmp(last, "nv") == 0 || has_ending(own, "_bnds") || has_ending(own, "_bounds"));
}

/* How many dimensions a volume could have; 0 = the array is none. */
static unsigned rank_of(const struct arrays *a, const struct array_info *info) {
    if (!info->is_number || is_of_axis(a, info))
        return 0;
    for (unsigned d = 0; d < info->rank; d++)
        if (info->shape[d] == 0)
            return 0;
    return info->rank < 3 ? info->rank : 3;
}

/* The dimensions that arrays need to be chosen without a name: 3 if one has as many, else 2 or 1.
 */
static unsigned least_rank(const struct arrays *a) {
    struct array_info info;
    unsigned most = 1;
    for (unsigned n = 0; a->call->describe(a->handle, n, &info); n++)
        if (rank_of(a, &info) > most)
            most = rank_of(a, &info);
    return most;
}

/* True if the field names the array, or one of its channels: "NAME 2". *channel gets its number. */
static bool is_wanted(const char *field, const char *name, uint32_t *channel) {
    const char *own = *name == '/' ? name + 1 : name;
    const size_t length = strlen(own);
    field += *field == '/';
    char *end;
    *channel = 0;
    if (strncmp(field, own, length) != 0)
        return false;
    if (!field[length])
        return true;
    const unsigned long number = strtoul(field + length, &end, 10);
    *channel = (uint32_t)(number - 1);
    return field[length] == ' ' && number >= 1 && number <= UINT32_MAX && !*end;
}

static void list_shape(const struct array_info *info, char *out, size_t capacity) {
    size_t used = (size_t)snprintf(out, capacity, "%.60s (", info->name);
    for (unsigned d = 0; d < info->rank && used < capacity; d++)
        used += (size_t)snprintf(out + used, capacity - used, "%s%" PRIu64, d ? " x " : "",
                                 info->shape[d]);
    if (used < capacity)
        snprintf(out + used, capacity - used, ")");
}

/* Names all arrays with their sizes. */
static bool fail_choice(const struct arrays *a, const char *text, struct sp_error *err) {
    struct array_info info;
    char text_and_list[SP_ERROR_TEXT], one[160];
    struct import_list list;
    unsigned found = 0;
    snprintf(text_and_list, sizeof text_and_list, "%s", text);
    import_list_begin(&list, text_and_list, sizeof text_and_list);
    for (unsigned n = 0; a->call->describe(a->handle, n, &info); n++)
        if (info.is_number && info.rank >= 1) {
            list_shape(&info, one, sizeof one);
            import_list_add(&list, found++ ? "; " : " ", one);
        }
    if (found == 0)
        import_list_add(&list, " ", "no arrays of numbers");
    import_list_end(&list);
    return sp_fail(err, *a->file->field ? SP_ERR_NOT_FOUND : SP_ERR_UNSUPPORTED, a->file->shown,
                   "%s", text_and_list);
}

/* MINC files are HDF5 (version 2) or NetCDF (version 1), those of VTKHDF are HDF5. Attributes and
 * other arrays say how their samples are scaled and where they lie, so the array alone would be
 * wrong. */
static const char *refusal_of(const struct arrays *a) {
    struct array_info info;
    for (unsigned n = 0; a->call->describe(a->handle, n, &info); n++) {
        if (strncmp(info.name, "/minc-2.0/", 10) == 0 ||
            (a->is_netcdf && strcmp(info.name, "rootvariable") == 0))
            return "MINC files are not supported; convert the file to NIfTI, for example with "
                   "mnc2nii";
        if (strncmp(info.name, "/VTKHDF/", 8) == 0)
            return "VTKHDF files are not supported; save the data with ParaView or VTK as .vti, "
                   ".vtu or .vtp";
    }
    return NULL;
}

static bool choose(struct arrays *a, struct sp_error *err) {
    const char *field = a->file->field;
    const char *refusal = refusal_of(a);
    if (refusal)
        return sp_fail(err, SP_ERR_UNSUPPORTED, a->file->shown, "%s", refusal);
    const unsigned least = least_rank(a);
    struct array_info info;
    unsigned found = 0;
    uint32_t channel = 0;
    for (unsigned n = 0; a->call->describe(a->handle, n, &info); n++) {
        const bool is_one =
            *field ? is_wanted(field, info.name, &channel) : rank_of(a, &info) >= least;
        if (is_one && found++ == 0) {
            a->chosen = n;
            a->info = info;
            a->channel = channel;
        }
        if (is_one && *field)
            break;
    }
    if (found == 0)
        return fail_choice(a,
                           *field ? "there is no such array; the file has"
                                  : "the file has no array of numbers with samples; it has",
                           err);
    if (found > 1 && !a->is_netcdf)
        return fail_choice(a, "choose one of the arrays, such as FILE.h5:/NAME:", err);
    if (!a->info.is_number)
        return arrays_fail(a, err, SP_ERR_UNSUPPORTED, "the array cannot be read: %s",
                           a->info.problem);
    return true;
}

/* The name of a channel of the array, or of the array if it has none. */
static void name_channel(const struct arrays *a, uint32_t channel, char name[SP_FIELD_BYTES]) {
    char text[ARRAY_NAME_BYTES + 16];
    snprintf(text, sizeof text, a->channels > 1 ? "%s %" PRIu32 : "%s", a->info.name, channel + 1);
    import_name(name, text);
}

static bool take_names(struct arrays *a, struct import_header *header, struct sp_error *err) {
    const unsigned least = a->info.rank < 3 ? a->info.rank : 3;
    struct array_info info;
    char name[SP_FIELD_BYTES];
    a->channels = a->axes.channel < 0 ? 1 : (uint32_t)fmin(a->info.shape[a->axes.channel], 1e9);
    if (a->channel >= a->channels)
        return arrays_fail(a, err, SP_ERR_NOT_FOUND,
                           "there is no channel %" PRIu32 ", only 1 to %u", a->channel + 1,
                           a->channels);
    if (*a->file->field)
        import_name(header->value_name, a->file->field);
    else
        name_channel(a, a->channel, header->value_name);
    for (uint32_t i = 0; i < a->channels && i < SP_OTHER_FIELDS_MAX; i++) {
        name_channel(a, i, name);
        if (i != a->channel)
            import_header_add_other(header, name);
    }
    for (unsigned n = 0; a->call->describe(a->handle, n, &info); n++)
        if (n != a->chosen && info.is_number && info.rank >= least)
            import_header_add_other(header, info.name);
    a->call->text(a->handle, a->chosen, "units", header->value_unit, sizeof header->value_unit);
    return true;
}

/* Numbers. */

static bool is_float(enum sp_type type) {
    return type == SP_FLOAT32 || type == SP_FLOAT64;
}

/* An attribute about the numbers as they are stored. With _Unsigned, it is written as if they had a
 * sign. */
static double stored_value(const struct arrays *a, double value) {
    const struct import_number number = a->conversion.number;
    const bool is_turned =
        number.kind == IMPORT_UNSIGNED && value < 0 && a->info.number.kind == IMPORT_SIGNED;
    return is_turned ? value + ldexp(1, 8 * (int)number.size) : value;
}

/* Numbers that stand for no sample: _FillValue and missing_value, and those outside of valid_range
 * or of valid_min and valid_max. Without a fill value, floating-point numbers have that of NetCDF.
 */
static void take_missing(struct arrays *a) {
    struct import_conversion *c = &a->conversion;
    double values[IMPORT_MISSING_MAX], range[2] = { -INFINITY, INFINITY };
    const bool has_fill = a->call->numbers(a->handle, a->chosen, "_FillValue", values, 1) == 1;
    if (has_fill)
        import_conversion_add_missing(c, stored_value(a, values[0]));
    else if (c->number.kind == IMPORT_FLOAT)
        import_conversion_add_missing(c, NETCDF_FILL);
    const size_t count =
        a->call->numbers(a->handle, a->chosen, "missing_value", values, IMPORT_MISSING_MAX);
    for (size_t i = 0; i < count; i++)
        import_conversion_add_missing(c, stored_value(a, values[i]));
    if (a->call->numbers(a->handle, a->chosen, "valid_range", range, 2) != 2) {
        range[0] = -INFINITY;
        range[1] = INFINITY;
        a->call->numbers(a->handle, a->chosen, "valid_min", &range[0], 1);
        a->call->numbers(a->handle, a->chosen, "valid_max", &range[1], 1);
    }
    range[0] = stored_value(a, range[0]);
    range[1] = stored_value(a, range[1]);
    const bool is_scaled = import_number_is_whole(c->number) && /* the range is of the samples */
                           ((isfinite(range[0]) && trunc(range[0]) != range[0]) ||
                            (isfinite(range[1]) && trunc(range[1]) != range[1]));
    if (!is_scaled && range[0] <= range[1] && (isfinite(range[0]) || isfinite(range[1])))
        import_conversion_set_range(c, range[0], range[1]);
}

/* scale_factor, add_offset, _FillValue and missing_value are conventions of NetCDF. */
static void take_type(struct arrays *a, struct import_header *header) {
    struct import_number number = a->info.number;
    char text[16];
    double value, slope = 1, offset = 0;
    a->call->text(a->handle, a->chosen, "_Unsigned", text, sizeof text);
    if (a->is_netcdf && strcasecmp(text, "true") == 0 && number.kind == IMPORT_SIGNED)
        number.kind = IMPORT_UNSIGNED;
    a->conversion = import_conversion_of(number, a->file->warnings);
    if (a->is_netcdf) {
        if (a->call->numbers(a->handle, a->chosen, "scale_factor", &value, 1) && isfinite(value) &&
            value != 0)
            slope = value;
        if (a->call->numbers(a->handle, a->chosen, "add_offset", &value, 1) && isfinite(value))
            offset = value;
        take_missing(a);
    }
    a->conversion.slope = slope;
    a->conversion.offset = offset;
    if ((slope != 1 || offset != 0) && !is_float(a->conversion.type))
        a->conversion.type = number.size <= 2 ? SP_FLOAT32 : SP_FLOAT64;
    header->type = a->conversion.type;
}

static bool take(struct arrays *a, struct import_header *header, struct sp_error *err) {
    char path[40], why[SP_ERROR_TEXT] = "";
    import_header_init(header);
    a->call = a->is_netcdf ? import_module_load(a->file, NETCDF_BRIDGE_MODULE, NETCDF_BRIDGE_SYMBOL,
                                                "NetCDF", "libnetcdf19", err)
                           : import_module_load(a->file, HDF5_BRIDGE_MODULE, HDF5_BRIDGE_SYMBOL,
                                                "HDF5", "libhdf5-103-1", err);
    if (!a->call || (a->is_netcdf && !netcdf_size_check(a->file, err)))
        return false;
    /* Opens by descriptor, because the name may refer to another file by now. */
    snprintf(path, sizeof path, "/proc/self/fd/%d", a->file->fd);
    a->handle = a->call->open(path, why, sizeof why);
    if (!a->handle)
        return sp_fail(err, SP_ERR_FORMAT, a->file->shown, "%s", why);
    if (!choose(a, err))
        return false;
    for (unsigned d = 0; d < a->info.rank; d++)
        if (a->info.shape[d] == 0)
            return arrays_fail(a, err, SP_ERR_FORMAT, "dimension %u has the length 0", d);
    take_type(a, header);
    return arrays_take_axes(a, header, err) && take_names(a, header, err) &&
           sp_grid_check(&header->grid, header->type, a->file->shown, &header->bytes, err);
}

static void close_arrays(void *reader) {
    struct arrays *a = reader;
    if (a->handle)
        a->call->close(a->handle);
    for (int axis = 0; axis < 3; axis++)
        free(a->positions[axis]);
    free(a->times);
    free(a);
}

static void *open_arrays(const struct import_file *file, bool is_netcdf,
                         struct import_header *header, struct sp_error *err) {
    struct arrays *a = calloc(1, sizeof *a);
    if (!a) {
        sp_fail(err, SP_ERR_MEMORY, file->shown, "out of memory");
        return NULL;
    }
    a->file = file;
    a->is_netcdf = is_netcdf;
    if (take(a, header, err))
        return a;
    close_arrays(a);
    return NULL;
}

static void *open_hdf5(const struct import_file *file, struct import_header *header,
                       struct sp_error *err) {
    return open_arrays(file, false, header, err);
}

static void *open_netcdf(const struct import_file *file, struct import_header *header,
                         struct sp_error *err) {
    return open_arrays(file, true, header, err);
}

/* Reading. */

struct reading {
    const struct arrays *arrays;
    unsigned order[3];   /* dimensions of space in the order of the file */
    unsigned count;      /* of them */
    uint64_t strides[3]; /* of each in the volume [samples] */
    char *numbers;       /* owned: a box */
    char *row;           /* owned: samples of one row of the file */
    char *voxels;
    uint64_t done; /* samples */
};

static void begin(struct reading *r) {
    const struct import_axes *axes = &r->arrays->axes;
    uint64_t stride[IMPORT_RANK_MAX] = { 0 }, step = 1;
    for (int a = 0; a < 3; a++)
        if (axes->space[a] >= 0) {
            stride[axes->space[a]] = step;
            step *= r->arrays->info.shape[axes->space[a]];
        }
    for (unsigned d = 0; d < r->arrays->info.rank; d++)
        if (stride[d]) {
            r->strides[r->count] = stride[d];
            r->order[r->count++] = d;
        }
}

/* Converts a row of numbers and puts it into the volume. */
static void put_row(const struct reading *r, const char *from, uint64_t count, uint64_t at,
                    uint64_t stride) {
    const struct arrays *a = r->arrays;
    const struct import_conversion *c = &a->conversion;
    const size_t size = sp_type_size(c->type);
    char *to = stride == 1 ? r->voxels + at * size : r->row;
    if (import_conversion_is_copy(c))
        memcpy(to, from, count * size);
    else
        import_conversion_put(c, from, count, to);
    for (uint64_t i = 0; stride != 1 && i < count; i++)
        memcpy(r->voxels + (at + i * stride) * size, to + i * size, size);
}

/* A box of the file in the order of its dimensions of space; those that are missing have size 1. */
struct box {
    uint64_t first[3], size[3];
};

static bool read_box(struct reading *r, const struct box *box, struct sp_error *err) {
    const struct arrays *a = r->arrays;
    uint64_t start[IMPORT_RANK_MAX] = { 0 }, count[IMPORT_RANK_MAX], at = 0;
    char why[SP_ERROR_TEXT] = "";
    for (unsigned d = 0; d < a->info.rank; d++)
        count[d] = 1;
    if (a->axes.channel >= 0)
        start[a->axes.channel] = a->channel;
    if (a->axes.time >= 0)
        start[a->axes.time] = a->file->step;
    for (unsigned i = 0; i < r->count; i++) {
        start[r->order[i]] = box->first[i];
        count[r->order[i]] = box->size[i];
        at += box->first[i] * r->strides[i];
    }
    if (!a->call->read(a->handle, a->chosen, start, count, r->numbers, why, sizeof why))
        return arrays_fail(a, err, SP_ERR_FORMAT, "%s", why);
    const unsigned last = r->count - 1;
    const uint64_t rows[2] = { r->count > 2 ? box->size[0] : 1,
                               r->count > 1 ? box->size[last - 1] : 1 };
    const char *from = r->numbers;
    for (uint64_t k = 0; k < rows[0]; k++)
        for (uint64_t j = 0; j < rows[1]; j++, from += box->size[last] * a->conversion.number.size)
            put_row(r, from, box->size[last],
                    at + (r->count > 2 ? k * r->strides[0] : 0) +
                        (r->count > 1 ? j * r->strides[last - 1] : 0),
                    r->strides[last]);
    r->done += rows[0] * rows[1] * box->size[last];
    return true;
}

/* How many numbers along dimension i of the order are read at once, where one takes `bytes`: whole
 * chunks if they fit. */
static uint64_t step_of(const struct reading *r, unsigned i, uint64_t bytes) {
    const struct array_info *info = &r->arrays->info;
    const uint64_t shape = info->shape[r->order[i]], chunk = info->chunk[r->order[i]];
    uint64_t step = bytes < BOX_BYTES ? BOX_BYTES / bytes : 1;
    if (chunk > 0 && step > chunk)
        step -= step % chunk;
    return step < shape ? step : shape;
}

static bool read_boxes(struct reading *r, const uint64_t steps[3],
                       const struct import_progress *progress, struct sp_error *err) {
    uint64_t shape[3] = { 1, 1, 1 };
    struct box box;
    for (unsigned i = 0; i < r->count; i++)
        shape[i] = r->arrays->info.shape[r->order[i]];
    for (box.first[0] = 0; box.first[0] < shape[0]; box.first[0] += steps[0])
        for (box.first[1] = 0; box.first[1] < shape[1]; box.first[1] += steps[1])
            for (box.first[2] = 0; box.first[2] < shape[2]; box.first[2] += steps[2]) {
                for (int i = 0; i < 3; i++) {
                    const uint64_t left = shape[i] - box.first[i];
                    box.size[i] = steps[i] < left ? steps[i] : left;
                }
                if (!read_box(r, &box, err))
                    return false;
                import_report(progress, r->done * sp_type_size(r->arrays->conversion.type));
            }
    return true;
}

static bool read_arrays(void *reader, void *voxels, float (*vectors)[3],
                        const struct import_progress *progress, struct sp_error *err) {
    struct reading r = { .arrays = reader, .voxels = voxels };
    uint64_t steps[3] = { 1, 1, 1 }, bytes = r.arrays->conversion.number.size;
    (void)vectors;
    begin(&r);
    for (unsigned i = r.count; i-- > 0; bytes *= steps[i]) /* all of the fastest ones */
        steps[i] = i + 1 == r.count ? r.arrays->info.shape[r.order[i]] : step_of(&r, i, bytes);
    r.numbers = malloc(bytes);
    r.row = malloc(steps[r.count - 1] * sizeof(double));
    bool ok = (r.numbers && r.row) ||
              sp_fail(err, SP_ERR_MEMORY, r.arrays->file->shown, "out of memory for numbers");
    ok = ok && read_boxes(&r, steps, progress, err);
    free(r.numbers);
    free(r.row);
    return ok;
}

const struct import_format import_hdf5 = { .name = "HDF5",
                                           .needs_module = true,
                                           .probe = probe_hdf5,
                                           .open = open_hdf5,
                                           .read = read_arrays,
                                           .close = close_arrays };
const struct import_format import_netcdf = { .name = "NetCDF",
                                             .needs_module = true,
                                             .probe = probe_netcdf,
                                             .open = open_netcdf,
                                             .read = read_arrays,
                                             .close = close_arrays };
