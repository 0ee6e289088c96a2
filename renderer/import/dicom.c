/* SPDX-License-Identifier: Apache-2.0
 *
 * DICOM: the series of a file, from all files of its folder, or the frames of one file. GDCM reads
 * the files (dicom_bridge.h).
 *
 *   file ─► slices of one series or frames (dicom_slices.h) ─► grid, conversion ─► pixels
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "import/conversion.h"
#include "import/dicom_folder.h"
#include "import/dicom_frames.h"
#include "import/dicom_grid.h"
#include "import/module.h"
#include "volume/volume.h"

struct dicom {
    struct dicom_source source;
    struct dicom_slices slices;
    struct import_conversion conversion; /* of the first slice */
    bool is_copy;
    size_t frame_bytes; /* of the pixels of one frame, unpacked */
    double *places;     /* owned; of slices that do not lie evenly */
};

static bool probe(const uint8_t *start, size_t size, const char *shown) {
    return dicom_is_file(start, size) || dicom_has_ending(shown);
}

static bool find_slices(struct dicom *d, struct import_header *header, struct sp_error *err) {
    const struct dicom_source *source = &d->source;
    const bool is_series = source->image.frames == 1 && source->image.series[0];
    if (is_series && !dicom_folder_list(source, &d->slices, err))
        return false;
    if (d->slices.count == 0 && !dicom_frames_list(source, &d->slices, err))
        return false;
    header->took_folder = is_series && d->slices.count > 1;
    dicom_slices_sort(&d->slices);
    return dicom_slices_take_step(&d->slices, source, header, err);
}

static bool check_pixels(const struct dicom *d, struct sp_error *err) {
    const struct dicom_image *image = &d->source.image;
    const bool is_number = image->is_float
                               ? image->bytes == 4 || image->bytes == 8
                               : image->bytes == 1 || image->bytes == 2 || image->bytes == 4;
    if (image->is_palette || image->is_other_color)
        return dicom_fail(
            &d->source, SP_ERR_UNSUPPORTED, "",
            "colours other than red, green and blue (a palette, or luminance and colour "
            "differences) are not supported",
            err);
    if (!is_number || image->bits < 1 || image->bits > 8 * image->bytes || image->channels < 1 ||
        image->channels > 4)
        return dicom_fail(&d->source, SP_ERR_UNSUPPORTED, "",
                          "the type of the pixels is not supported", err);
    return true;
}

/* The values of a CT are Hounsfield units unless the file says that they are something else. */
static bool is_hounsfield(const struct dicom_image *image) {
    return strcmp(image->modality, "CT") == 0 &&
           (!image->rescale_type[0] || strcmp(image->rescale_type, "HU") == 0);
}

static bool take_type(struct dicom *d, struct import_header *header, struct sp_error *err) {
    const struct dicom_image *image = &d->source.image;
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
                                     .slope = d->slices.items[0].is.slope,
                                     .offset = d->slices.items[0].is.intercept };
    for (uint32_t i = 0; i < d->slices.count; i++) {
        const struct dicom_slice *s = &d->slices.items[i];
        if (!isfinite(s->is.slope) || !isfinite(s->is.intercept) || s->is.slope == 0)
            return dicom_fail(&d->source, SP_ERR_FORMAT, s->name,
                              "the rescale slope is 0 or no number", err);
        is_uniform &= s->is.slope == c->slope && s->is.intercept == c->offset;
    }
    import_conversion_choose(c, image->is_signed ? -values / 2 : 0,
                             image->is_signed ? values / 2 - 1 : values - 1);
    if (!is_uniform && c->type != SP_FLOAT64)
        c->type = SP_FLOAT32;
    if (c->components > 1)
        c->component =
            import_header_choose_component(header, d->source.file->field, c->components, true);
    else if (is_hounsfield(image))
        snprintf(header->value_unit, sizeof header->value_unit, "HU");
    d->is_copy = is_uniform && import_conversion_is_copy(c);
    header->type = c->type;
    d->frame_bytes = (size_t)image->columns * image->rows * image->channels * image->bytes;
    return true;
}

static bool take(struct dicom *d, struct import_header *header, struct sp_error *err) {
    struct dicom_source *source = &d->source;
    char why[SP_ERROR_TEXT];
    import_header_init(header);
    source->call = import_module_load(source->file, DICOM_BRIDGE_MODULE, DICOM_BRIDGE_SYMBOL,
                                      "GDCM", "libgdcm3.0", err);
    if (!source->call)
        return false;
    if (!dicom_describe(source, source->file->fd, &source->image, why))
        return dicom_fail(source, SP_ERR_FORMAT, "", why, err);
    return find_slices(d, header, err) && take_type(d, header, err) &&
           dicom_grid_take(&d->slices, source, header, &d->places, err) &&
           sp_grid_check(&header->grid, header->type, source->file->shown, &header->bytes, err);
}

static void close_dicom(void *reader) {
    struct dicom *d = reader;
    dicom_slices_finish(&d->slices);
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
    d->source.file = file;
    if (take(d, header, err))
        return d;
    close_dicom(d);
    return NULL;
}

/* GDCM reads a file that is cut off without a word, unless the pixels are packed. */
static bool check_size(const struct dicom *d, int fd, size_t bytes, char why[SP_ERROR_TEXT]) {
    struct dicom_image image;
    struct stat st;
    if (!dicom_describe(&d->source, fd, &image, why))
        return false;
    snprintf(why, SP_ERROR_TEXT, "the pixels need %zu bytes; the file is cut off", bytes);
    return image.is_packed || (fstat(fd, &st) == 0 && image.pixels_at > 0 &&
                               (uint64_t)st.st_size >= image.pixels_at + bytes);
}

/* Unpacks the pixels of all frames of a file. */
static bool read_file(const struct dicom *d, const char *name, void *out, size_t bytes,
                      struct sp_error *err) {
    char path[40], why[SP_ERROR_TEXT];
    int fd = dicom_open(&d->source, name, err);
    if (fd < 0)
        return false;
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    const bool ok =
        check_size(d, fd, bytes, why) && d->source.call->read(path, out, bytes, why, sizeof why);
    dicom_close(&d->source, fd);
    return ok || dicom_fail(&d->source, SP_ERR_FORMAT, name, why, err);
}

/* Slices are files, or else all of them are frames of the file that was opened. */
static bool read_dicom(void *reader, void *voxels, float (*vectors)[3],
                       const struct import_progress *progress, struct sp_error *err) {
    const struct dicom *d = reader;
    const uint32_t frames = d->source.image.frames;
    const size_t pixels = d->frame_bytes / (d->source.image.channels * d->source.image.bytes);
    const size_t bytes = pixels * sp_type_size(d->conversion.type);
    char *unpacked = d->is_copy && frames == 1 ? NULL : malloc(frames * d->frame_bytes);
    bool ok = (d->is_copy && frames == 1) || unpacked ||
              sp_fail(err, SP_ERR_MEMORY, d->source.file->shown, "out of memory for the pixels");
    (void)vectors;
    if (ok && frames > 1)
        ok = read_file(d, "", unpacked, frames * d->frame_bytes, err);
    for (uint32_t i = 0; ok && i < d->slices.count; i++) {
        const struct dicom_slice *s = &d->slices.items[i];
        char *to = (char *)voxels + i * bytes;
        const char *from = unpacked ? unpacked + s->frame * d->frame_bytes : to;
        struct import_conversion c = d->conversion;
        c.slope = s->is.slope;
        c.offset = s->is.intercept;
        if (frames == 1)
            ok = read_file(d, s->name, unpacked ? unpacked : to, d->frame_bytes, err);
        if (ok && !d->is_copy)
            import_conversion_put(&c, from, pixels, to);
        else if (ok && from != to)
            memcpy(to, from, bytes);
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
