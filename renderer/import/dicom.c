/* SPDX-License-Identifier: Apache-2.0
 *
 * DICOM: the series of a file, from all files of its folder, or the frames of one file. GDCM reads
 * the files (dicom_bridge.h).
 *
 *   file ─► folder ─► slices of one series, sorted by place ─► grid, conversion ─► pixels
 */
#include <dirent.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/vec.h"
#include "import/confine.h"
#include "import/conversion.h"
#include "import/dicom_bridge.h"
#include "import/module.h"
#include "volume/volume.h"

enum { PREFIX = 132, FILES_MAX = 1 << 16 };

/* Slices lie evenly if each is within this share of the step of its place. */
#define EVEN_SHARE 0.01
#define SAME_PLACE 1e-4 /* mm */

struct slice {
    char *name; /* owned; in the folder of the file */
    struct sp_vec3 position;
    double place; /* along the normal of the slices [mm] */
    double slope, intercept;
    long instance;
};

struct dicom {
    const struct import_file *file;
    const struct dicom_bridge_functions *call;
    struct dicom_image image; /* of the file that was opened */
    struct slice *slices;     /* owned */
    uint32_t count, capacity;
    struct import_conversion conversion; /* of the first slice */
    bool is_copy;
    size_t slice_bytes; /* of the pixels of one file, unpacked */
    double *places;     /* owned; of slices that do not lie evenly */
    unsigned left_out;  /* images of the series that are not part of the volume */
};

static bool has_ending(const char *name) {
    static const char *const endings[] = { ".dcm", ".dicom", ".ima" };
    const char *dot = strrchr(name, '.');
    for (size_t i = 0; dot && i < sizeof endings / sizeof *endings; i++)
        if (strcasecmp(dot, endings[i]) == 0)
            return true;
    return false;
}

/* True for group 8, with which files without a preamble begin: an element, then two letters that
 * name its type, or else its length. */
static bool is_group_8(const uint8_t *start, size_t size) {
    if (size < 8 || start[0] != 8 || start[1] != 0 || start[3] != 0)
        return false;
    const bool has_letters =
        start[4] >= 'A' && start[4] <= 'Z' && start[5] >= 'A' && start[5] <= 'Z';
    const bool is_length =
        start[2] == 0 && start[4] == 4 && start[5] == 0 && start[6] == 0 && start[7] == 0;
    return has_letters || is_length;
}

static bool is_dicom(const uint8_t *start, size_t size) {
    return (size >= PREFIX && memcmp(start + PREFIX - 4, "DICM", 4) == 0) ||
           is_group_8(start, size);
}

static bool probe(const uint8_t *start, size_t size, const char *shown) {
    return is_dicom(start, size) || has_ending(shown);
}

/* The slices. */

static bool fail(const struct dicom *d, enum sp_code code, const char *name, const char *text,
                 struct sp_error *err) {
    char place[SP_ERROR_PLACE];
    const bool is_same = strcmp(name, "") == 0;
    snprintf(place, sizeof place, "%.180s%s%.60s", d->file->shown, is_same ? "" : ": ", name);
    return sp_fail(err, code, place, "%s", text);
}

/* Runs with a path that refers to the file however it is renamed meanwhile. */
static bool describe(const struct dicom *d, int fd, struct dicom_image *image, char *why,
                     size_t capacity) {
    char path[40];
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    return d->call->describe(path, image, why, capacity);
}

static bool is_same_direction(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] > 0.9999;
}

/* A series may have other images, such as an overview, which are not part of the volume. */
static bool belongs(const struct dicom_image *one, const struct dicom_image *other) {
    return strcmp(one->series, other->series) == 0 && other->frames == 1 &&
           one->columns == other->columns && one->rows == other->rows &&
           one->channels == other->channels && one->bytes == other->bytes &&
           one->is_signed == other->is_signed && one->is_float == other->is_float &&
           one->is_placed == other->is_placed &&
           (!one->is_placed || (is_same_direction(one->along[0], other->along[0]) &&
                                is_same_direction(one->along[1], other->along[1])));
}

static bool add_slice(struct dicom *d, const char *name, const struct dicom_image *image) {
    if (d->count == d->capacity) {
        const uint32_t wanted = d->capacity ? 2 * d->capacity : 256;
        struct slice *larger = realloc(d->slices, wanted * sizeof *larger);
        if (!larger)
            return false;
        d->slices = larger;
        d->capacity = wanted;
    }
    struct slice *s = &d->slices[d->count];
    *s = (struct slice){ .name = strdup(name),
                         .position = sp_vec3_from(image->position),
                         .slope = image->slope,
                         .intercept = image->intercept,
                         .instance = image->instance };
    const struct sp_vec3 normal =
        sp_vec3_cross(sp_vec3_from(d->image.along[0]), sp_vec3_from(d->image.along[1]));
    s->place = image->is_placed ? sp_vec3_dot(s->position, normal) : (double)image->instance;
    d->count += s->name != NULL;
    return s->name != NULL;
}

/* Adds a file of the folder if it is a slice of the series. False if there is no memory. */
static bool take_file(struct dicom *d, const char *name) {
    char path[PATH_MAX + NAME_MAX + 2], real[PATH_MAX], why[SP_ERROR_TEXT];
    uint8_t start[PREFIX];
    struct dicom_image image;
    struct sp_error ignored;
    uint64_t size;
    snprintf(path, sizeof path, "%s/%s", d->file->folder, name);
    int fd = sp_open_confined(d->file->root, path, name, real, &size, &ignored);
    if (fd < 0)
        return true;
    const ssize_t got = pread(fd, start, sizeof start, 0);
    const bool is_image = got > 0 && (is_dicom(start, (size_t)got) || has_ending(name)) &&
                          describe(d, fd, &image, why, sizeof why);
    const bool is_slice = is_image && belongs(&d->image, &image);
    close(fd);
    d->left_out += is_image && !is_slice && strcmp(d->image.series, image.series) == 0;
    return !is_slice || add_slice(d, name, &image);
}

static bool scan_folder(struct dicom *d, struct sp_error *err) {
    DIR *folder = opendir(d->file->folder);
    bool ok = true;
    if (!folder)
        return sp_fail(err, SP_ERR_IO, d->file->shown, "cannot list the folder of the file");
    for (const struct dirent *entry; ok && d->count < FILES_MAX && (entry = readdir(folder));)
        if (entry->d_name[0] != '.')
            ok = take_file(d, entry->d_name);
    closedir(folder);
    return ok || sp_fail(err, SP_ERR_MEMORY, d->file->shown, "out of memory for the slices");
}

static int by_place(const void *a, const void *b) {
    const struct slice *p = a, *q = b;
    if (p->place != q->place)
        return p->place < q->place ? -1 : 1;
    return p->instance != q->instance ? (p->instance < q->instance ? -1 : 1)
                                      : strcmp(p->name, q->name);
}

static bool find_slices(struct dicom *d, struct sp_error *err) {
    const bool is_series = d->image.frames == 1 && d->image.series[0];
    if (is_series && !scan_folder(d, err))
        return false;
    if (d->left_out)
        import_warn(d->file->warnings,
                    "Left out %u other %s of the series, whose size, type or direction differs.",
                    d->left_out, d->left_out > 1 ? "images" : "image");
    if (d->count == 0 && !add_slice(d, "", &d->image))
        return sp_fail(err, SP_ERR_MEMORY, d->file->shown, "out of memory for the slices");
    qsort(d->slices, d->count, sizeof *d->slices, by_place);
    return true;
}

static bool is_same_place(const struct slice *a, const struct slice *b) {
    return fabs(a->place - b->place) <= SAME_PLACE;
}

/* If every place has the same number of slices, of different numbers, those are the steps of a time
 * series, or of echoes. Returns how many steps there are. The slices are sorted. */
static uint32_t count_steps(const struct dicom *d) {
    const struct slice *s = d->slices;
    uint32_t steps = 1;
    while (steps < d->count && is_same_place(&s[0], &s[steps]))
        steps++;
    for (uint32_t i = 1; i < d->count; i++) {
        const bool is_next = i % steps != 0;
        if (is_same_place(&s[i - 1], &s[i]) != is_next ||
            (is_next && s[i - 1].instance == s[i].instance))
            return 1;
    }
    return d->image.is_placed && d->count % steps == 0 ? steps : 1;
}

/* Keeps the slices of the wanted step. */
static bool take_step(struct dicom *d, struct import_header *header, struct sp_error *err) {
    const uint32_t steps = count_steps(d), count = d->count;
    header->took_folder = count > 1;
    if (!import_header_use_steps(header, d->file, steps, err))
        return false;
    d->count = 0;
    for (uint32_t i = 0; i < count; i++)
        if (i % steps == d->file->step)
            d->slices[d->count++] = d->slices[i];
        else
            free(d->slices[i].name);
    return true;
}

/* The grid. */

/* Slices of one place belong to several times or echoes. */
static bool check_places(const struct dicom *d, struct sp_error *err) {
    for (uint32_t i = 1; i < d->count; i++) {
        const struct slice *a = &d->slices[i - 1], *b = &d->slices[i];
        char text[SP_ERROR_TEXT];
        if (!is_same_place(a, b) || !(d->image.is_placed || a->instance))
            continue;
        snprintf(text, sizeof text,
                 "%.60s and %.60s show the same place (%.6g): a duplicate, or a series whose "
                 "places have different numbers of times or echoes",
                 a->name, b->name, b->place);
        return fail(d, SP_ERR_UNSUPPORTED, a->name, text, err);
    }
    return true;
}

static int compare_numbers(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Says where slices are missing: a gap there is some times as wide as most gaps. `gaps` is
 * memory for as many numbers as slices. */
static void warn_of_gaps(const struct dicom *d, double *gaps) {
    const uint32_t count = d->count - 1;
    unsigned wide = 0;
    for (uint32_t i = 0; i < count; i++)
        gaps[i] = d->places[i + 1] - d->places[i];
    qsort(gaps, count, sizeof *gaps, compare_numbers);
    const double usual = gaps[(count - 1) / 2];
    for (uint32_t i = 0; i < count; i++) {
        const double gap = d->places[i + 1] - d->places[i], missing = round(gap / usual) - 1;
        if (missing < 1)
            continue;
        wide++;
        import_warn(d->file->warnings,
                    "%.0f %s missing at %.6g mm, between %.60s and %.60s: the gap there is %.6g "
                    "mm, and others are %.6g mm.",
                    missing, missing > 1 ? "slices are" : "slice is", d->slices[i].place + gap / 2,
                    d->slices[i].name, d->slices[i + 1].name, gap, usual);
    }
    if (!wide)
        import_warn(d->file->warnings,
                    "The slices do not lie evenly: their distances are between %.6g and %.6g mm.",
                    gaps[0], gaps[count - 1]);
}

/* The axis of the slices, which need not be perpendicular to them nor even. */
static bool place_slices(struct dicom *d, struct sp_grid *grid, struct sp_error *err) {
    const struct sp_vec3 first = d->slices[0].position;
    const struct sp_vec3 all = sp_vec3_sub(d->slices[d->count - 1].position, first);
    const double step = sp_vec3_length(all) / (d->count - 1);
    const struct sp_vec3 along = sp_vec3_normalize(all);
    bool is_even = true;
    d->places = malloc(d->count * sizeof *d->places);
    if (!d->places)
        return sp_fail(err, SP_ERR_MEMORY, d->file->shown, "out of memory for the slices");
    for (uint32_t i = 0; i < d->count; i++) {
        d->places[i] = sp_vec3_dot(sp_vec3_sub(d->slices[i].position, first), along);
        is_even &= fabs(d->places[i] - i * step) <= EVEN_SHARE * step;
    }
    grid->spacing[2] = step;
    for (int row = 0; row < 3; row++)
        grid->direction[row][2] = along.v[row];
    if (is_even)
        return true;
    double *gaps = malloc(d->count * sizeof *gaps);
    if (!gaps)
        return sp_fail(err, SP_ERR_MEMORY, d->file->shown, "out of memory for the slices");
    warn_of_gaps(d, gaps);
    free(gaps);
    import_grid_place(grid, 2, d->places);
    return true;
}

static bool take_grid(struct dicom *d, struct import_header *header, struct sp_error *err) {
    struct sp_grid *grid = &header->grid;
    const struct dicom_image *image = &d->image;
    const struct sp_vec3 normal =
        sp_vec3_cross(sp_vec3_from(image->along[0]), sp_vec3_from(image->along[1]));
    const bool is_mm = image->spacing[0] > 0 && image->spacing[1] > 0;
    grid->dims[0] = image->columns;
    grid->dims[1] = image->rows;
    grid->dims[2] = image->frames > 1 ? image->frames : d->count;
    for (int axis = 0; axis < 3; axis++)
        grid->spacing[axis] = image->spacing[axis] > 0 ? image->spacing[axis] : 1;
    snprintf(header->unit, sizeof header->unit, "%s", is_mm ? "mm" : "");
    if (!image->is_placed)
        return true;
    for (int row = 0; row < 3; row++) {
        grid->direction[row][0] = image->along[0][row];
        grid->direction[row][1] = image->along[1][row];
        grid->direction[row][2] = normal.v[row];
        grid->origin[row] = d->slices[0].position.v[row];
    }
    if (d->count > 1 && !place_slices(d, grid, err))
        return false;
    import_header_set_anatomy(header, "LPS");
    return true;
}

/* The samples. */

static bool check_pixels(const struct dicom *d, struct sp_error *err) {
    const struct dicom_image *image = &d->image;
    const bool is_number = image->is_float
                               ? image->bytes == 4 || image->bytes == 8
                               : image->bytes == 1 || image->bytes == 2 || image->bytes == 4;
    if (image->is_palette || image->is_other_color)
        return fail(d, SP_ERR_UNSUPPORTED, "",
                    "colours other than red, green and blue (a palette, or luminance and colour "
                    "differences) are not supported",
                    err);
    if (!is_number || image->bits < 1 || image->bits > 8 * image->bytes || image->channels < 1 ||
        image->channels > 4)
        return fail(d, SP_ERR_UNSUPPORTED, "", "the type of the pixels is not supported", err);
    return true;
}

/* The values of a CT are Hounsfield units unless the file says that they are something else. */
static bool is_hounsfield(const struct dicom_image *image) {
    return strcmp(image->modality, "CT") == 0 &&
           (!image->rescale_type[0] || strcmp(image->rescale_type, "HU") == 0);
}

static bool take_type(struct dicom *d, struct import_header *header, struct sp_error *err) {
    const struct dicom_image *image = &d->image;
    struct import_conversion *c = &d->conversion;
    const double values = ldexp(1, (int)image->bits);
    bool is_uniform = true;
    if (!check_pixels(d, err))
        return false;
    *c = (struct import_conversion){ .number = { image->is_float    ? IMPORT_FLOAT
                                                 : image->is_signed ? IMPORT_SIGNED
                                                                    : IMPORT_UNSIGNED,
                                                 image->bytes },
                                     .components = image->channels,
                                     .slope = d->slices[0].slope,
                                     .offset = d->slices[0].intercept };
    for (uint32_t i = 0; i < d->count; i++) {
        const struct slice *s = &d->slices[i];
        if (!isfinite(s->slope) || !isfinite(s->intercept) || s->slope == 0)
            return fail(d, SP_ERR_FORMAT, s->name, "the rescale slope is 0 or no number", err);
        is_uniform &= s->slope == c->slope && s->intercept == c->offset;
    }
    import_conversion_choose(c, image->is_signed ? -values / 2 : 0,
                             image->is_signed ? values / 2 - 1 : values - 1);
    if (!is_uniform && c->type != SP_FLOAT64)
        c->type = SP_FLOAT32;
    if (c->components > 1)
        c->component = import_header_choose_component(header, d->file->field, c->components, true);
    else if (is_hounsfield(image))
        snprintf(header->value_unit, sizeof header->value_unit, "HU");
    d->is_copy = is_uniform && import_conversion_is_copy(c);
    header->type = c->type;
    d->slice_bytes =
        (size_t)image->columns * image->rows * image->frames * image->channels * image->bytes;
    return true;
}

static bool take(struct dicom *d, struct import_header *header, struct sp_error *err) {
    char why[SP_ERROR_TEXT];
    import_header_init(header);
    d->call = import_module_load(d->file, DICOM_BRIDGE_MODULE, DICOM_BRIDGE_SYMBOL, "GDCM",
                                 "libgdcm3.0", err);
    if (!d->call)
        return false;
    if (!describe(d, d->file->fd, &d->image, why, sizeof why))
        return fail(d, SP_ERR_FORMAT, "", why, err);
    return find_slices(d, err) && take_step(d, header, err) && check_places(d, err) &&
           take_type(d, header, err) && take_grid(d, header, err) &&
           sp_grid_check(&header->grid, header->type, d->file->shown, &header->bytes, err);
}

static void close_dicom(void *reader) {
    struct dicom *d = reader;
    for (uint32_t i = 0; i < d->count; i++)
        free(d->slices[i].name);
    free(d->slices);
    free(d->places);
    free(d);
}

static void *open_dicom(const struct import_file *file, struct import_header *header,
                        struct sp_error *err) {
    struct dicom *d = calloc(1, sizeof *d);
    if (!d) {
        sp_fail(err, SP_ERR_MEMORY, file->shown, "out of memory");
        return NULL;
    }
    d->file = file;
    if (take(d, header, err))
        return d;
    close_dicom(d);
    return NULL;
}

/* GDCM reads a file that is cut off without a word, unless the pixels are packed. */
static bool check_size(const struct dicom *d, int fd, char why[SP_ERROR_TEXT]) {
    struct dicom_image image;
    struct stat st;
    if (!describe(d, fd, &image, why, SP_ERROR_TEXT))
        return false;
    snprintf(why, SP_ERROR_TEXT, "the pixels need %zu bytes; the file is cut off", d->slice_bytes);
    return image.is_packed || (fstat(fd, &st) == 0 && image.pixels_at > 0 &&
                               (uint64_t)st.st_size >= image.pixels_at + d->slice_bytes);
}

/* Unpacks the pixels of a file of the folder; "" is the file that was opened. */
static bool read_slice(const struct dicom *d, const char *name, void *out, struct sp_error *err) {
    char path[PATH_MAX + NAME_MAX + 2], real[PATH_MAX], why[SP_ERROR_TEXT];
    uint64_t size;
    int fd = d->file->fd;
    if (*name) {
        snprintf(path, sizeof path, "%s/%s", d->file->folder, name);
        fd = sp_open_confined(d->file->root, path, name, real, &size, err);
    }
    if (fd < 0)
        return false;
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    bool ok = check_size(d, fd, why) && d->call->read(path, out, d->slice_bytes, why, sizeof why);
    if (*name)
        close(fd);
    return ok || fail(d, SP_ERR_FORMAT, name, why, err);
}

static bool read_dicom(void *reader, void *voxels, float (*vectors)[3],
                       const struct import_progress *progress, struct sp_error *err) {
    const struct dicom *d = reader;
    const size_t pixels = d->slice_bytes / (d->image.channels * d->image.bytes);
    const size_t bytes = pixels * sp_type_size(d->conversion.type);
    void *unpacked = d->is_copy ? NULL : malloc(d->slice_bytes);
    bool ok = d->is_copy || unpacked ||
              sp_fail(err, SP_ERR_MEMORY, d->file->shown, "out of memory for a slice");
    (void)vectors;
    for (uint32_t i = 0; ok && i < d->count; i++) {
        char *to = (char *)voxels + i * bytes;
        struct import_conversion c = d->conversion;
        c.slope = d->slices[i].slope;
        c.offset = d->slices[i].intercept;
        ok = read_slice(d, d->slices[i].name, unpacked ? unpacked : to, err);
        if (ok && unpacked)
            import_conversion_put(&c, unpacked, pixels, to);
        import_report(progress, (i + 1) * bytes);
    }
    free(unpacked);
    return ok;
}

const struct import_format import_dicom = { .name = "DICOM",
                                            .probe = probe,
                                            .needs_module = true,
                                            .open = open_dicom,
                                            .read = read_dicom,
                                            .close = close_dicom };
