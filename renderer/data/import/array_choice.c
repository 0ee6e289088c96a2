/* SPDX-License-Identifier: Apache-2.0
 *
 * Which array of a file is read, and what it is called.
 */
#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "data/import/array_reader.h"
#include "data/import/derived.h"

bool arrays_fail(const struct arrays *a, struct sp_error *err, enum sp_code code,
                 const char *format, ...) {
    char place[SP_ERROR_PLACE], text[SP_ERROR_TEXT];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    snprintf(place, sizeof place, a->info.name[0] ? "%.160s: %.80s" : "%.160s", a->title,
             a->info.name);
    return sp_fail(err, code, place, "%s", text);
}

/* Choosing an array. */

enum { AUXILIARY_BYTES = 1 << 16 };

static const char *own_name(const char *path) {
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

/* Collects the names in the attributes of all arrays that name others: 2-D latitudes, bounds, …
 * Without memory, or if there are too many, the rest is not known. */
static void collect_auxiliary(struct arrays *a) {
    static const char *const attributes[] = { "coordinates", "bounds", "climatology",
                                              "grid_mapping", "ancillary_variables" };
    struct array_info info;
    char text[1024];
    size_t used = 1;
    a->auxiliary = calloc(1, AUXILIARY_BYTES);
    for (unsigned n = 0; a->auxiliary; n++) {
        const bool is_array = a->call->describe(a->handle, n, &info);
        for (size_t i = 0; i < sizeof attributes / sizeof *attributes; i++) {
            a->call->text(a->handle, is_array ? n : ARRAY_OF_FILE, attributes[i], text,
                          sizeof text);
            const size_t length = strlen(text);
            if (length > 0 && used + length + 2 < AUXILIARY_BYTES)
                used += (size_t)snprintf(a->auxiliary + used, AUXILIARY_BYTES - used, "%s ", text);
        }
        if (!is_array)
            break;
    }
    if (a->auxiliary)
        a->auxiliary[0] = ' ';
}

/* True if another array names this one. */
static bool is_auxiliary(const struct arrays *a, const char *name) {
    const size_t length = strlen(name);
    const char *at = length > 0 ? a->auxiliary : NULL;
    for (; at && (at = strstr(at, name)); at += length)
        if (at > a->auxiliary && at[-1] == ' ' && at[length] == ' ')
            return true;
    return false;
}

/* True for the arrays that only say where others are: coordinates and their bounds. */
static bool is_of_axis(const struct arrays *a, const struct array_info *info) {
    const char *own = own_name(info->name);
    if (info->is_scale || is_auxiliary(a, own))
        return true;
    if (info->rank == 1 && *own && strcmp(own, info->dims[0]) == 0)
        return true;
    const char *last = info->rank > 0 ? info->dims[info->rank - 1] : "";
    return info->rank == 2 && info->shape[1] == 2 &&
           (strcasecmp(last, "bnds") == 0 || strcasecmp(last, "bounds") == 0 ||
            strcasecmp(last, "nv") == 0 ||
            (*last && (import_ends_with(own, "_bnds") || import_ends_with(own, "_bounds"))));
}

/* How many dimensions a volume could have; 0 = the array is none. Numbers that cannot be read
 * count, so that no other array is shown in their place. */
static unsigned rank_of(const struct arrays *a, const struct array_info *info) {
    if (info->is_alias || is_of_axis(a, info))
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

static bool are_vectors(const struct arrays *a) {
    return a->file->selection.as == IMPORT_AS_VECTORS;
}

/* What names the array that is read; "" = the reader chooses. Of vectors it may be their name, and
 * "magnitude" is that of any. */
static const char *wanted_of(const struct arrays *a) {
    const char *field = a->file->field;
    if (are_vectors(a) && (!*field || import_derived_of(field, "") != IMPORT_NOT_DERIVED))
        return a->file->vectors;
    return field;
}

/* True if the field names the array, or one of its channels: "NAME 2", or of vectors "NAME x".
 * *channel gets its number. A file that is one array has no name for it; choose_component() reads
 * the field. */
static bool is_wanted(const struct arrays *a, const char *field, const char *name,
                      uint32_t *channel) {
    const char *own = *name == '/' ? name + 1 : name;
    const size_t length = strlen(own);
    field += *field == '/';
    char *end;
    *channel = 0;
    if (!*name)
        return true;
    if (strncmp(field, own, length) != 0)
        return false;
    if (!field[length])
        return true;
    if (are_vectors(a) && import_is_derived_from(field, own))
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
        snprintf(out + used, capacity - used, info->is_number ? ")" : ", cannot be read)");
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
        if (info.rank >= 1 && !info.is_alias) {
            list_shape(&info, one, sizeof one);
            import_list_add(&list, found++ ? "; " : " ", one);
        }
    if (found == 0)
        return sp_fail(err, *a->file->field ? SP_ERR_NOT_FOUND : SP_ERR_UNSUPPORTED, a->title,
                       "the file has no arrays of numbers");
    import_list_end(&list, false);
    return sp_fail(err, *a->file->field ? SP_ERR_NOT_FOUND : SP_ERR_UNSUPPORTED, a->title, "%s",
                   text_and_list);
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

/* Where the array that the file is about may be. */
static void warn_of_links(const struct arrays *a) {
    struct array_info info;
    for (unsigned n = 0; a->call->describe(a->handle, n, &info); n++)
        if (info.is_alias && !info.is_number && info.problem[0]) {
            import_warn(a->file->warnings, "%.60s was left out: %.160s.", info.name, info.problem);
            return;
        }
}

/* A packed chunk is unpacked as a whole, beside the samples. */
static bool check_chunk(const struct arrays *a, struct sp_error *err) {
    uint64_t bytes = a->info.number.size;
    for (unsigned d = 0; d < a->info.rank && a->info.is_packed; d++) {
        const uint64_t chunk = a->info.chunk[d] ? a->info.chunk[d] : 1;
        if (chunk > ARRAY_CHUNK_MAX / bytes)
            return arrays_fail(a, err, SP_ERR_UNSUPPORTED,
                               "a chunk has more than %d MiB; write the array with smaller chunks, "
                               "as h5repack -l CHUNK=16x64x64 and nccopy -c do",
                               ARRAY_CHUNK_MAX >> 20);
        bytes *= chunk;
    }
    return true;
}

bool arrays_choose(struct arrays *a, struct sp_error *err) {
    const char *field = wanted_of(a);
    const char *refusal = refusal_of(a);
    if (refusal)
        return sp_fail(err, SP_ERR_UNSUPPORTED, a->title, "%s", refusal);
    collect_auxiliary(a);
    const unsigned least = least_rank(a);
    struct array_info info;
    unsigned found = 0;
    uint32_t channel = 0;
    for (unsigned n = 0; a->call->describe(a->handle, n, &info); n++) {
        const bool is_one =
            *field ? is_wanted(a, field, info.name, &channel) : rank_of(a, &info) >= least;
        if (is_one && found++ == 0) {
            a->chosen = n;
            a->info = info;
            a->channel = channel;
        }
        if (!*field && info.is_preferred && (info.is_number || info.rank > 0)) {
            a->chosen = n;
            a->info = info;
            found = 1;
        }
        if (found && (*field || info.is_preferred))
            break;
    }
    if (found == 0)
        return fail_choice(a,
                           *field ? "there is no such array; the file has"
                                  : "no array of the file has samples; it has",
                           err);
    if (found > 1 && !a->takes_first && !*field)
        return fail_choice(a, "choose one of the arrays, such as FILE.h5:/NAME:", err);
    if (!a->info.is_number)
        return arrays_fail(a, err, SP_ERR_UNSUPPORTED, "the array cannot be read: %s%s",
                           a->info.problem, *field ? "" : "; ?field=NAME reads another array");
    if (!check_chunk(a, err))
        return false;
    if (!*field)
        warn_of_links(a);
    for (unsigned d = 0; d < a->info.rank; d++)
        if (a->info.shape[d] == 0)
            return arrays_fail(a, err, SP_ERR_FORMAT, "dimension %u has the length 0", d);
    return true;
}

/* The name of a channel of the array, or of the array if it has none. */
static void name_channel(const struct arrays *a, uint32_t channel, char name[SP_FIELD_BYTES]) {
    char text[ARRAY_NAME_BYTES + 16];
    const char *own = a->info.name[0] || a->channels == 1 ? a->info.name : "channel";
    text[0] = 0;
    if (a->call->channel && a->axes.channel >= 0)
        a->call->channel(a->handle, a->chosen, channel, text, sizeof text);
    if (text[0]) {
        import_name(name, text);
        return;
    }
    snprintf(text, sizeof text, a->channels > 1 ? "%s %" PRIu32 : "%s", own, channel + 1);
    import_name(name, text);
}

/* A file that is one array: its field is a colour, "channel 2", or its long name. */
static bool choose_component(struct arrays *a, struct import_header *header, struct sp_error *err) {
    const char *field = a->file->field;
    char long_name[SP_FIELD_BYTES], name[SP_FIELD_BYTES], *end;
    if (a->axes.are_colors) {
        a->channel = import_header_choose_component(header, field, a->channels, true);
        return true;
    }
    a->call->text(a->handle, a->chosen, "long_name", long_name, sizeof long_name);
    if (a->channels == 1)
        import_name(header->value_name, long_name);
    if (!*field || (a->channels == 1 && strcmp(field, header->value_name) == 0))
        return true;
    for (uint32_t i = 0; a->call->channel && i < a->channels; i++) {
        name_channel(a, i, name);
        if (strcmp(name, field) == 0) {
            a->channel = i;
            return true;
        }
    }
    const unsigned long number =
        strncmp(field, "channel ", 8) == 0 ? strtoul(field + 8, &end, 10) : 0;
    if (number < 1 || number > a->channels || *end)
        return arrays_fail(a, err, SP_ERR_NOT_FOUND,
                           a->channels > 1 ? "there is no field %.60s, only channel 1 to channel %u"
                                           : "there is no field %.60s; the array is the only one",
                           field, a->channels);
    a->channel = (uint32_t)(number - 1);
    return true;
}

/* Vectors have the name of the array. The field is this one, for their lengths, or one of
 * derived.h; the '/' before it may be missing. */
static void name_vectors(const struct arrays *a, struct import_header *header) {
    const char *field = a->file->field, *own = a->info.name + (a->info.name[0] == '/');
    const char *name = field + (*field == '/');
    char path[SP_FIELD_BYTES];
    snprintf(path, sizeof path, "%s%s", a->info.name[0] == '/' ? "/" : "", name);
    import_header_add_vectors(header, a->info.name);
    import_header_use_vectors(header, *wanted_of(a) ? path : field);
    if (*field && (strcmp(name, own) == 0 || strcmp(path, header->value_name) == 0))
        import_name(header->value_name, field);
}

/* Lists the arrays that could be read in place of this one, and says what the numbers are. */
static void list_other_arrays(const struct arrays *a, struct import_header *header) {
    char flags[8];
    const unsigned least = a->info.rank < 3 ? a->info.rank : 3;
    struct array_info info;
    for (unsigned n = 0; a->call->describe(a->handle, n, &info); n++)
        if (n != a->chosen && info.is_number && info.rank >= least && !info.is_alias &&
            !is_of_axis(a, &info))
            import_header_add_other(header, info.name);
    a->call->text(a->handle, a->chosen, "flag_meanings", flags, sizeof flags);
    if (*flags && import_number_is_whole(import_number_of(header->type)))
        header->meaning = SP_MEANING_LABELS;
    a->call->text(a->handle, a->chosen, "units", header->value_unit, sizeof header->value_unit);
}

bool arrays_set_names(struct arrays *a, struct import_header *header, struct sp_error *err) {
    char name[SP_FIELD_BYTES];
    if (a->axes.are_vectors) {
        a->channels = 1;
        name_vectors(a, header);
        list_other_arrays(a, header);
        return true;
    }
    a->channels = a->axes.channel < 0 ? 1 : (uint32_t)fmin(a->info.shape[a->axes.channel], 1e9);
    if (!a->info.name[0] && !choose_component(a, header, err))
        return false;
    if (a->channel >= a->channels)
        return arrays_fail(a, err, SP_ERR_NOT_FOUND,
                           "there is no channel %" PRIu32 ", only 1 to %u", a->channel + 1,
                           a->channels);
    const bool has_names = header->value_name[0]; /* from choose_component() */
    if (!has_names && a->info.name[0] && *a->file->field)
        import_name(header->value_name, a->file->field);
    else if (!has_names)
        name_channel(a, a->channel, header->value_name);
    for (uint32_t i = 0; !has_names && i < a->channels && i < SP_OTHER_FIELDS_MAX + 2; i++) {
        name_channel(a, i, name);
        if (i != a->channel)
            import_header_add_other(header, name);
    }
    list_other_arrays(a, header);
    return true;
}

bool arrays_fill_header(struct arrays *a, struct import_header *header, struct sp_error *err) {
    arrays_set_conversion(a, header);
    if (!arrays_read_axes(a, header, err))
        return false;
    if (a->axes.are_vectors) {
        header->type = a->conversion.type = SP_FLOAT32;
        if (!isnan(a->default_fill))
            arrays_use_default_fill(a);
    }
    return arrays_set_names(a, header, err);
}

void arrays_finish(struct arrays *a) {
    for (int axis = 0; axis < 3; axis++)
        free(a->positions[axis]);
    free(a->times);
    free(a->auxiliary);
}
