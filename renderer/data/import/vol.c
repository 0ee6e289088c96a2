/* SPDX-License-Identifier: Apache-2.0
 *
 * Three kinds of ".vol", told apart by their first bytes:
 *
 *   grids of Mitsuba     "VOL", 3, int32 type, int32 dims[3], int32 channels, float box[6], numbers
 *   volumes of DGtal     "X: 64" … lines, a line ".", then bytes (Version 2) or zlib (Version 3)
 *   scans of VGStudio    ".vgi": a text that names the raw file and says what is in it
 *
 * Why this parser is our own: parsers.md.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "data/import/samples.h"
#include "data/volume/volume.h"

enum { HEADER_MAX = 1 << 16, MITSUBA_BYTES = 48 };

struct vol {
    struct import_sampled sampled; /* the first: read() is that of samples.h */
    const struct import_file *file;
};

static bool is_mitsuba(const uint8_t *start, size_t size) {
    return size >= 4 && memcmp(start, "VOL\3", 4) == 0;
}

static bool is_dgtal(const uint8_t *start, size_t size) {
    static const char *const keys[] = { "X: ", "Center-X: ", "Alpha-Color: ", "Int-Endian: ",
                                        "Version: " };
    for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
        if (size > strlen(keys[i]) && memcmp(start, keys[i], strlen(keys[i])) == 0)
            return true;
    return false;
}

static bool probe(const uint8_t *start, size_t size, const char *title) {
    return is_mitsuba(start, size) || is_dgtal(start, size) || import_ends_with(title, ".vol") ||
           import_ends_with(title, ".longvol") || import_ends_with(title, ".vgi");
}

/* Sets what follows from dims, numbers and components. */
static bool finish_header(struct vol *v, struct import_number number, unsigned components,
                          struct import_header *header, struct sp_error *err) {
    struct import_samples *s = &v->sampled.samples;
    v->sampled.conversion = import_conversion_of(number, v->file->warnings);
    v->sampled.conversion.components = components;
    if (components > 1)
        v->sampled.conversion.component =
            import_header_choose_component(header, v->file->field, components, components > 2);
    header->type = v->sampled.conversion.type;
    if (!sp_grid_check(&header->grid, header->type, v->file->title, &header->bytes, err))
        return false;
    s->file = v->file;
    s->number = number;
    s->bytes = header->bytes / sp_type_size(header->type) * number.size * components;
    s->conversion =
        import_conversion_is_copy(&v->sampled.conversion) ? NULL : &v->sampled.conversion;
    return import_samples_check(s, err);
}

static bool fail_size(const struct vol *v, const char *field, double value, struct sp_error *err) {
    return import_fail(err, SP_ERR_FORMAT, v->file->title, 0, field, "%g is outside [1, %u]", value,
                       SP_DIM_MAX);
}

/* Mitsuba: numbers are little-endian, channels alternate; the box has the centres of the outer
 * samples. */
static bool parse_mitsuba(struct vol *v, const uint8_t *text, size_t size,
                          struct import_header *header, struct sp_error *err) {
    static const struct import_number numbers[] = {
        [1] = { IMPORT_FLOAT, 4 }, [2] = { IMPORT_FLOAT, 2 }, [3] = { IMPORT_UNSIGNED, 1 }
    };
    int32_t fields[5];
    float box[6];
    if (size < MITSUBA_BYTES)
        return import_fail(err, SP_ERR_FORMAT, v->file->title, size, NULL, "the header is cut off");
    memcpy(fields, text + 4, sizeof fields);
    memcpy(box, text + 24, sizeof box);
#if __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__
    import_swap(fields, 4, 5);
    import_swap(box, 4, 6);
#endif
    if (fields[0] < 1 || fields[0] > 3)
        return import_fail(
            err, SP_ERR_UNSUPPORTED, v->file->title, 4, "encoding",
            "%" PRId32 " is not supported; supported are 1 (float32), 2 (float16) and 3 (uint8)",
            fields[0]);
    if (fields[4] < 1 || fields[4] > 4)
        return import_fail(err, SP_ERR_UNSUPPORTED, v->file->title, 20, "channels",
                           "%" PRId32 " is outside [1, 4]", fields[4]);
    for (int a = 0; a < 3; a++) {
        if (fields[1 + a] < 1 || fields[1 + a] > (int32_t)SP_DIM_MAX)
            return fail_size(v, "size", fields[1 + a], err);
        header->grid.dims[a] = (uint32_t)fields[1 + a];
    }
    for (int a = 0; a < 3; a++) {
        const double extent = (double)box[3 + a] - (double)box[a];
        const uint32_t gaps = header->grid.dims[a] - 1;
        if (!isfinite(extent) || !(extent > 0))
            continue; /* a box that is not set */
        header->grid.origin[a] = (double)box[a];
        header->grid.spacing[a] = gaps ? extent / gaps : extent;
    }
    v->sampled.samples.start = MITSUBA_BYTES;
    v->sampled.samples.field = "size";
    return finish_header(v, numbers[fields[0]], (unsigned)fields[4], header, err);
}

/* Finds "KEY: value" at the beginning of a line; NULL = there is none. */
static const char *find_line(const char *text, const char *key) {
    const size_t n = strlen(key);
    for (const char *line = text; line; line = strchr(line, '\n')) {
        line += *line == '\n';
        if (strncasecmp(line, key, n) == 0)
            return line + n;
    }
    return NULL;
}

static double number_of(const char *text, double missing) {
    return text ? strtod(text, NULL) : missing;
}

/* DGtal: voxels of Voxel-Size bytes; the bytes of larger ones are in the order of Voxel-Endian. */
static bool parse_dgtal(struct vol *v, char *text, struct import_header *header,
                        struct sp_error *err) {
    static const char *const axes[] = { "X: ", "Y: ", "Z: " };
    char *end = strstr(text, "\n.\n");
    if (!end)
        return import_fail(err, SP_ERR_FORMAT, v->file->title, 0, NULL,
                           "the header does not end with a line that has a dot alone");
    *end = 0;
    const double size = number_of(find_line(text, "Voxel-Size: "), 1);
    const double version = number_of(find_line(text, "Version: "), 2);
    const char *endian = find_line(text, "Voxel-Endian: ");
    for (int a = 0; a < 3; a++) {
        const double dim = number_of(find_line(text, axes[a]), 0);
        if (!(dim >= 1 && dim <= SP_DIM_MAX && trunc(dim) == dim))
            return fail_size(v, axes[a], dim, err);
        header->grid.dims[a] = (uint32_t)dim;
    }
    if (size != 1 && size != 2 && size != 4 && size != 8)
        return import_fail(err, SP_ERR_UNSUPPORTED, v->file->title, 0, "Voxel-Size",
                           "%g bytes are not supported; supported are 1, 2, 4 and 8", size);
    v->sampled.samples.start = (uint64_t)(end - text) + 3;
    v->sampled.samples.encoding = version >= 3 ? IMPORT_GZIP : IMPORT_RAW;
    v->sampled.samples.big_endian = endian && strncmp(endian, "0", 1) != 0;
    v->sampled.samples.field = "X, Y, Z";
    return finish_header(v, (struct import_number){ IMPORT_UNSIGNED, (size_t)size }, 1, header,
                         err);
}

/* Copies the value of "key = value", without blanks around it. */
static bool vgi_value(const char *text, const char *key, char *out, size_t capacity) {
    for (const char *at = find_line(text, key); at; at = find_line(at, key)) {
        const char *value = at + strspn(at, " \t");
        if (*value != '=')
            continue;
        value += 1 + strspn(value + 1, " \t");
        size_t n = strcspn(value, "\r\n");
        while (n > 0 && strchr(" \t", value[n - 1]))
            n--;
        snprintf(out, capacity, "%.*s", (int)n, value);
        return true;
    }
    return false;
}

/* VGStudio: the first [file1] of the text. */
static bool parse_vgi(struct vol *v, const char *text, struct import_header *header,
                      struct sp_error *err) {
    const char *section = strcasestr(text, "[file1]");
    char value[256], name[256];
    double bits = 0, dims[3] = { 0 }, spacing[3];
    if (!section || !vgi_value(section, "Size", value, sizeof value) ||
        sscanf(value, "%lf %lf %lf", &dims[0], &dims[1], &dims[2]) != 3 ||
        !vgi_value(section, "Name", name, sizeof name) || !*name)
        return import_fail(err, SP_ERR_FORMAT, v->file->title, 0, "[file1]",
                           "the section with Size and Name is missing");
    for (int a = 0; a < 3; a++) {
        if (!(dims[a] >= 1 && dims[a] <= SP_DIM_MAX && trunc(dims[a]) == dims[a]))
            return fail_size(v, "Size", dims[a], err);
        header->grid.dims[a] = (uint32_t)dims[a];
    }
    if (vgi_value(section, "BitsPerElement", value, sizeof value))
        bits = strtod(value, NULL);
    const bool has_type = vgi_value(section, "Datatype", value, sizeof value);
    const bool is_float = has_type && strcasestr(value, "float");
    const bool is_signed = has_type && !strcasestr(value, "unsigned");
    if ((bits != 8 && bits != 16 && bits != 32) || (is_float && bits != 32))
        return import_fail(err, SP_ERR_UNSUPPORTED, v->file->title, 0, "BitsPerElement",
                           "%g bits are not supported; supported are 8, 16 and 32", bits);
    if (vgi_value(text, "resolution", value, sizeof value) &&
        sscanf(value, "%lf %lf %lf", &spacing[0], &spacing[1], &spacing[2]) == 3) {
        for (int a = 0; a < 3; a++)
            if (isfinite(spacing[a]) && spacing[a] > 0)
                header->grid.spacing[a] = spacing[a];
        if (vgi_value(text, "unit", value, sizeof value))
            snprintf(header->unit, sizeof header->unit, "%.31s", value);
    }
    /* The name may be the path of another computer. */
    const char *slash = strrchr(name, '/'), *back = strrchr(name, '\\');
    const char *file = slash > back ? slash + 1 : back ? back + 1 : name;
    if (!import_samples_add(&v->sampled.samples, file, strlen(file)))
        return sp_fail(err, SP_ERR_MEMORY, v->file->title, "out of memory");
    v->sampled.samples.field = "Size";
    const struct import_number number = { is_float    ? IMPORT_FLOAT
                                          : is_signed ? IMPORT_SIGNED
                                                      : IMPORT_UNSIGNED,
                                          (size_t)bits / 8 };
    return finish_header(v, number, 1, header, err);
}

static bool open_vol(void *reader, const struct import_file *file, struct import_header *header,
                     struct sp_error *err) {
    struct vol *v = reader;
    v->file = file;
    char *text = malloc(HEADER_MAX + 1);
    if (!text)
        return sp_fail(err, SP_ERR_MEMORY, v->file->title, "out of memory");
    const ssize_t got = pread(v->file->fd, text, HEADER_MAX, 0);
    const size_t size = got > 0 ? (size_t)got : 0;
    bool ok;
    text[size] = 0;
    v->sampled.samples.file = file;
    if (is_mitsuba((const uint8_t *)text, size))
        ok = parse_mitsuba(v, (const uint8_t *)text, size, header, err);
    else if (is_dgtal((const uint8_t *)text, size))
        ok = parse_dgtal(v, text, header, err);
    else if (import_ends_with(v->file->title, ".vgi"))
        ok = parse_vgi(v, text, header, err);
    else
        ok = import_fail(err, SP_ERR_UNSUPPORTED, v->file->title, 0, NULL,
                         "this kind of .vol is not supported; supported are grids of Mitsuba (VOL, "
                         "version 3), volumes of DGtal (text header), and raw samples that a .vgi "
                         "of VGStudio or a JSON sidecar describes (open that file)");
    free(text);
    return ok;
}

const struct import_format import_vol = { .name = ".vol and .vgi",
                                          .probe = probe,
                                          .reader_size = sizeof(struct vol),
                                          .open = open_vol,
                                          .read = import_sampled_read,
                                          .close = import_sampled_close };
