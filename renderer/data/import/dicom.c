/* SPDX-License-Identifier: Apache-2.0
 *
 * DICOM: the series of a file, from all files of its folder, or the frames of one file. GDCM reads
 * the files (dicom_bridge.h).
 *
 *   file ─► slices of one series or frames (dicom_slices.h) ─► grid, conversion ─► pixels
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/conversion.h"
#include "data/import/dicom_folder.h"
#include "data/import/dicom_frames.h"
#include "data/import/dicom_grid.h"
#include "data/import/dicom_samples.h"
#include "data/import/dicom_times.h"
#include "data/import/module.h"
#include "data/volume/sample.h"
#include "data/volume/volume.h"

struct dicom {
    struct dicom_source source;
    struct dicom_slices slices;
    struct import_conversion conversion; /* to the type in memory; each file has its own numbers */
    double *places;                      /* owned; of slices that do not lie evenly */
};

static bool probe(const uint8_t *start, size_t size, const char *title) {
    return dicom_is_file(start, size) || dicom_has_ending(title);
}

/* Loads the module, and describes the file unless it is a folder. An image, or a DICOMDIR, is
 * complete. */
static bool open_source(struct dicom_source *source, struct sp_error *err) {
    const struct import_file *file = source->file;
    const struct dicom_image *image = &source->image;
    struct sp_error why;
    source->call = import_module_load(file, DICOM_BRIDGE_MODULE, DICOM_BRIDGE_SYMBOL, "GDCM",
                                      "libgdcm3.0", err);
    if (!source->call)
        return false;
    if (file->is_folder)
        return true;
    bool ok = dicom_describe(source, file->fd, &source->image, &why);
    source->is_named = ok && !source->image.is_directory;
    if (source->is_named && image->columns == 0)
        ok = sp_fail(
            &why, SP_ERR_FORMAT, "",
            image->has_empty_image
                ? "the image has no pixels: Rows or Columns is 0 (modality %s); export it again"
                : "the file has no image (modality %s); open the series that it belongs to",
            *image->modality ? image->modality : "not known");
    else if (source->is_named)
        ok = dicom_samples_check(image, file->fd, &why);
    return ok || dicom_fail(source, why.code, "", why.text, err);
}

/* Lists the frames of the file, and of other files that make one stack with it. */
static bool list_slices(struct dicom *d, struct import_header *header, struct sp_error *err) {
    struct dicom_source *source = &d->source;
    struct dicom_slices *slices = &d->slices;
    header->used_series = source->image.frames <= 1 || source->image.has_places;
    header->used_as =
        header->used_series && source->is_named && source->file->selection.as == IMPORT_AS_SLICE;
    if (header->used_series && !header->used_as
            ? !dicom_folder_list(source, slices, err)
            : !dicom_frames_add(source, "", &source->image, slices, err))
        return false;
    bool has_frames = false;
    for (uint32_t i = 0; i < slices->count; i++) {
        has_frames |= slices->items[i].frame > 0;
        header->took_folder |= strcmp(slices->items[i].name, slices->items[0].name) != 0;
    }
    return !has_frames || dicom_frames_choose(source, slices, err);
}

static bool prepare_slices(struct dicom *d, struct import_header *header, struct sp_error *err) {
    struct dicom_source *source = &d->source;
    struct dicom_slices *slices = &d->slices;
    if (!list_slices(d, header, err))
        return false;
    dicom_times_pass_midnight(slices);
    slices->has_gaps = slices->items[0].is.segment || source->image.has_labels;
    const bool is_sorted = dicom_slices_rank(slices) && dicom_slices_sort(slices);
    if (is_sorted && slices->count > slices->planes)
        dicom_grid_warn_of_sides(slices, source);
    if (source->image.has_labels)
        import_name(header->value_name, "labels");
    return (is_sorted ||
            sp_fail(err, SP_ERR_MEMORY, source->file->title, "out of memory for the slices")) &&
           dicom_slices_choose_field(slices, source, header, err) &&
           dicom_slices_choose_step(slices, source, header, err);
}

/* Slope, intercept and unit of all slices. */
static bool check_rescale(struct dicom *d, struct import_header *header, bool *is_uniform,
                          struct sp_error *err) {
    const struct dicom_frame *first = &d->slices.items[0].is;
    bool has_unit = first->unit[0], has_zero = false;
    *is_uniform = true;
    for (uint32_t i = 0; i < d->slices.count; i++) {
        struct dicom_slice *s = &d->slices.items[i];
        if (!isfinite(s->is.slope) || !isfinite(s->is.intercept))
            return dicom_fail(
                &d->source, SP_ERR_FORMAT, s->name,
                "RescaleSlope or RescaleIntercept is not a number; correct it in the file", err);
        if (s->is.slope == 0) {
            has_zero = true;
            s->is.slope = 1;
        }
        *is_uniform &= s->is.slope == first->slope && s->is.intercept == first->intercept;
        has_unit &= strcmp(s->is.unit, first->unit) == 0;
    }
    if (has_zero)
        import_warn(d->source.file->warnings,
                    "The rescale slope is 0, which would remove all values: it is taken as 1.");
    if (has_unit && d->conversion.components == 1)
        snprintf(header->value_unit, sizeof header->value_unit, "%s", first->unit);
    return true;
}

/* Segments that lie in one volume: each pixel has the label of its segment, or 0. */
static void choose_label_type(struct dicom *d) {
    uint32_t most = 0;
    for (uint32_t i = 0; i < d->slices.count; i++)
        if (d->slices.items[i].is.segment > most)
            most = d->slices.items[i].is.segment;
    d->conversion.type = most > UINT8_MAX ? SP_UINT16 : SP_UINT8;
}

/* The type in memory of whole numbers: slices may differ in their bits and in their scale. */
static void choose_type(struct dicom *d, bool is_uniform) {
    struct import_conversion *c = &d->conversion;
    double low = INFINITY, high = -INFINITY;
    for (uint32_t i = 0; i < d->slices.count; i++) {
        low = fmin(low, d->slices.items[i].is.low);
        high = fmax(high, d->slices.items[i].is.high);
    }
    const bool is_wide = low < INT16_MIN || high > UINT16_MAX;
    if (c->number.kind != IMPORT_FLOAT)
        c->number.size = is_wide ? 8 : 2;
    import_conversion_choose(c, low, high);
    if (!is_uniform && c->type != SP_FLOAT64)
        c->type = is_wide ? SP_FLOAT64 : SP_FLOAT32;
}

static bool set_type(struct dicom *d, struct import_header *header, struct sp_error *err) {
    const struct dicom_frame *first = &d->slices.items[0].is;
    struct import_conversion *c = &d->conversion;
    bool is_uniform;
    *c = (struct import_conversion){ .slope = 1 };
    if (!dicom_samples_type(&d->source, &d->source.image, "", &c->number, &c->components, err) ||
        !check_rescale(d, header, &is_uniform, err))
        return false;
    c->slope = first->slope;
    c->offset = first->intercept;
    if (c->components > 1)
        import_conversion_choose(c, 0, ldexp(1, 8 * (int)c->number.size) - 1);
    else
        choose_type(d, is_uniform);
    if (c->components > 1)
        c->component =
            import_header_choose_component(header, d->source.file->field, c->components, true);
    if (d->slices.are_together)
        choose_label_type(d);
    header->type = c->type;
    return true;
}

static bool open_dicom(void *reader, const struct import_file *file, struct import_header *header,
                       struct sp_error *err) {
    struct dicom *d = reader;
    d->source.file = file;
    struct dicom_source *source = &d->source;
    if (!open_source(source, err) || !prepare_slices(d, header, err))
        return false;
    if (source->image.note[0])
        import_warn(source->file->warnings, "%s", source->image.note);
    return set_type(d, header, err) &&
           dicom_grid_fill(&d->slices, source, header, &d->places, err) &&
           sp_grid_check(&header->grid, header->type, source->file->title, &header->bytes, err);
}

static void close_dicom(void *reader) {
    struct dicom *d = reader;
    dicom_slices_finish(&d->slices);
    free(d->places);
}

/* Writes the label of a segment where its pixels are not 0. Returns the number of these
 * pixels that already had another label. */
static uint64_t put_label(const struct dicom *d, const uint8_t *mask, size_t pixels, uint32_t label,
                          char *out) {
    const size_t size = sp_type_size(d->conversion.type);
    uint64_t shared = 0;
    for (size_t i = 0; i < pixels; i++) {
        if (!mask[i])
            continue;
        shared += import_widen(out + i * size, import_number_of(d->conversion.type)) != 0;
        sp_sample_set(out, d->conversion.type, i, label);
    }
    return shared;
}

struct reading {
    struct dicom_samples samples;
    const char *name; /* of the file that is open; NULL = none */
    char *unpacked;   /* owned; a frame */
    uint64_t shared;  /* pixels of several segments */
    /* Slices whose pixels cannot be unpacked, while others can. */
    bool *is_damaged; /* owned; of each plane */
    uint32_t damaged;
    char names[160];     /* of the first ones */
    struct sp_error why; /* of the first one */
};

static bool open_file(const struct dicom *d, const char *name, size_t pixels, struct reading *r,
                      struct sp_error *err) {
    dicom_samples_close(&r->samples);
    r->name = NULL;
    if (!dicom_samples_open(&r->samples, &d->source, name, err))
        return false;
    char *larger = realloc(r->unpacked, pixels * r->samples.channels * r->samples.number.size);
    if (!larger)
        return sp_fail(err, SP_ERR_MEMORY, d->source.file->title, "out of memory for a frame");
    r->unpacked = larger;
    r->name = name;
    return true;
}

static bool read_slice(const struct dicom *d, const struct dicom_slice *slice, size_t pixels,
                       char *to, struct reading *r, struct sp_error *err) {
    if ((!r->name || strcmp(r->name, slice->name) != 0) &&
        !open_file(d, slice->name, pixels, r, err))
        return false;
    struct import_conversion c = d->conversion;
    c.number = r->samples.number;
    c.slope = slice->is.slope;
    c.offset = slice->is.intercept;
    const bool is_copy = !d->slices.are_together && import_conversion_is_copy(&c);
    if (!dicom_samples_read(&r->samples, slice->frame, is_copy ? to : r->unpacked, err))
        return false;
    if (d->slices.are_together)
        r->shared += put_label(d, (const uint8_t *)r->unpacked, pixels, slice->is.segment, to);
    else if (!is_copy)
        import_conversion_put(&c, r->unpacked, pixels, to);
    return true;
}

/* True for the file that was opened by its name. */
static bool is_opened(const struct dicom *d, const struct dicom_slice *slice) {
    return d->source.is_named && (!*slice->name || strcmp(slice->name, d->source.name) == 0);
}

/* Counts a slice that is damaged, also if it asks for more memory than there is. False if the error
 * ends the import: an error of another kind, of the file that was asked for by its name, or of the
 * last sound slice. */
static bool pass_over(const struct dicom *d, const struct dicom_slice *slice, struct reading *r,
                      const struct sp_error *why) {
    char name[80];
    if ((why->code != SP_ERR_FORMAT && why->code != SP_ERR_MEMORY) || d->slices.are_together ||
        is_opened(d, slice) || r->damaged + 1 >= d->slices.planes)
        return false;
    if (r->damaged == 0)
        r->why = *why;
    dicom_slice_name(slice, name);
    const size_t used = strlen(r->names);
    if (used + strlen(name) + 8 < sizeof r->names)
        snprintf(r->names + used, sizeof r->names - used, "%s%s", used ? ", " : "", name);
    r->is_damaged[slice->plane] = true;
    r->damaged++;
    return true;
}

/* Gives damaged planes the smallest sample of the others, which mostly is the background. */
static void fill_damaged(const struct dicom *d, const struct reading *r, size_t pixels,
                         char *voxels) {
    const enum sp_type type = d->conversion.type;
    const size_t size = sp_type_size(type);
    double least = INFINITY;
    for (uint32_t plane = 0; plane < d->slices.planes; plane++)
        for (size_t i = 0; i < pixels && !r->is_damaged[plane]; i++)
            least = fmin(
                least, import_widen(voxels + (plane * pixels + i) * size, import_number_of(type)));
    for (uint32_t plane = 0; plane < d->slices.planes; plane++)
        for (size_t i = 0; i < pixels && r->is_damaged[plane]; i++)
            sp_sample_set(voxels + plane * pixels * size, type, i, least);
    import_warn(d->source.file->warnings,
                "%u %s damaged and shown as %.6g, the smallest value of the others: %s. %.80s.",
                r->damaged, r->damaged > 1 ? "slices are" : "slice is", least, r->names,
                r->why.text);
}

/* Planes without a slice stay 0. */
static bool read_dicom(void *reader, void *voxels, float (*vectors)[3],
                       const struct import_progress *progress, struct sp_error *err) {
    const struct dicom *d = reader;
    const size_t pixels = (size_t)d->source.image.columns * d->source.image.rows;
    const size_t bytes = pixels * sp_type_size(d->conversion.type);
    struct reading r = { .samples = { .fd = -1 } };
    (void)vectors;
    r.is_damaged = calloc(d->slices.planes, sizeof *r.is_damaged);
    bool ok = r.is_damaged ||
              sp_fail(err, SP_ERR_MEMORY, d->source.file->title, "out of memory for the pixels");
    for (uint32_t i = 0; ok && i < d->slices.count; i++) {
        const struct dicom_slice *s = &d->slices.items[i];
        struct sp_error why;
        ok = read_slice(d, s, pixels, (char *)voxels + s->plane * bytes, &r, &why) ||
             pass_over(d, s, &r, &why);
        if (!ok && err)
            *err = why;
        import_report(progress, (s->plane + 1) * bytes);
    }
    if (ok && r.shared)
        import_warn(d->source.file->warnings,
                    "%" PRIu64 " voxels are in several segments; each has the label of the last "
                    "one. The fields are the segments one by one.",
                    r.shared);
    if (ok && r.damaged)
        fill_damaged(d, &r, pixels, voxels);
    dicom_samples_close(&r.samples);
    free(r.is_damaged);
    free(r.unpacked);
    return ok;
}

static bool list_series(const struct import_file *file, struct import_series_list *list,
                        struct sp_error *err) {
    struct dicom_source *source = calloc(1, sizeof *source);
    if (!source)
        return sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory");
    source->file = file;
    const bool ok = open_source(source, err) && dicom_list_series(source, list, err);
    free(source);
    return ok;
}

const struct import_format import_dicom = { .name = "DICOM",
                                            .probe = probe,
                                            .needs_module = true,
                                            .reader_size = sizeof(struct dicom),
                                            .open = open_dicom,
                                            .read = read_dicom,
                                            .close = close_dicom,
                                            .list = list_series };
