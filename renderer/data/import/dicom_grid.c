/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/dicom_grid.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/compare.h"
#include "base/vec.h"

/* Slices within EVEN_SHARE of a step of their even place are shown evenly. Beyond EXACT_SHARE a
 * warning says so. */
#define EVEN_SHARE 0.05
#define EXACT_SHARE 0.002
/* A gap lacks whole slices if it is a multiple of the step within this share of the step. */
#define MULTIPLE_SHARE 0.1
/* They lie above one another within this share of a pixel. */
#define SHIFT_SHARE 0.05

/* What warnings call the first slice of a plane. The slices are sorted. */
static void name_plane(const struct dicom_slices *slices, uint32_t plane, char out[80]) {
    uint32_t low = 0, high = slices->count;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (slices->items[middle].plane < plane)
            low = middle + 1;
        else
            high = middle;
    }
    if (low < slices->count && slices->items[low].plane == plane)
        dicom_slice_name(&slices->items[low], out);
    else
        snprintf(out, 80, "none");
}

/* Says where slices are missing: a gap of n usual distances lacks n − 1 slices. `gaps` is memory
 * for as many numbers as planes. */
static void warn_of_gaps(const struct dicom_slices *slices, const double *places, double *gaps,
                         struct import_warnings *warnings) {
    const uint32_t count = slices->planes - 1;
    unsigned wide = 0;
    bool is_uneven = false;
    for (uint32_t i = 0; i < count; i++)
        gaps[i] = places[i + 1] - places[i];
    qsort(gaps, count, sizeof *gaps, sp_compare_doubles);
    const double usual = gaps[(count - 1) / 2];
    for (uint32_t i = 0; i < count; i++) {
        const double gap = places[i + 1] - places[i], missing = round(gap / usual) - 1;
        const bool is_multiple = fabs(gap / usual - missing - 1) <= MULTIPLE_SHARE;
        char before[80], after[80];
        is_uneven |= !is_multiple;
        if (!(missing >= 1) || !is_multiple)
            continue;
        wide++;
        name_plane(slices, i, before);
        name_plane(slices, i + 1, after);
        import_warn(warnings,
                    "%.0f %s missing at %.6g mm, between %s and %s: the gap there is %.6g "
                    "mm, and others are %.6g mm.",
                    missing, missing > 1 ? "slices are" : "slice is",
                    (slices->is_falling ? -1 : 1) * (slices->plane[i].place + gap / 2), before,
                    after, gap, usual);
    }
    if (!wide || is_uneven)
        import_warn(warnings,
                    "The slices do not lie evenly: their distances are between %.6g and %.6g mm.",
                    gaps[0], gaps[count - 1]);
}

/* Says that the slices do not lie above one another: a grid cannot show that. */
static void warn_of_shift(const struct dicom_slices *slices, const struct sp_grid *grid,
                          struct import_warnings *warnings) {
    const struct sp_vec3 first = sp_vec3_from(slices->plane[0].position);
    double most = 0;
    for (uint32_t i = 1; i < slices->planes; i++) {
        const struct sp_vec3 at = sp_vec3_sub(sp_vec3_from(slices->plane[i].position), first);
        const struct sp_vec3 along = { { grid->direction[0][2], grid->direction[1][2],
                                         grid->direction[2][2] } };
        const struct sp_vec3 aside = sp_vec3_sub(at, sp_vec3_scale(along, sp_vec3_dot(at, along)));
        most = fmax(most, sp_vec3_length(aside));
    }
    if (most > SHIFT_SHARE * fmin(grid->spacing[0], grid->spacing[1]))
        import_warn(warnings,
                    "The slices do not lie on a line: some are up to %.4g mm beside their place "
                    "in the volume.",
                    most);
}

/* The axis of the slices, which need not be perpendicular to them nor even. */
static bool place_slices(const struct dicom_slices *slices, struct import_warnings *warnings,
                         struct sp_grid *grid, double **out) {
    const uint32_t count = slices->planes;
    const struct sp_vec3 first = sp_vec3_from(slices->plane[0].position);
    const struct sp_vec3 last = sp_vec3_from(slices->plane[count - 1].position);
    const struct sp_vec3 all = sp_vec3_sub(last, first), along = sp_vec3_normalize(all);
    const double step = sp_vec3_length(all) / (count - 1);
    double *places = malloc(count * sizeof *places);
    double *gaps = malloc(count * sizeof *gaps);
    double off = 0;
    *out = places;
    for (uint32_t i = 0; places && gaps && i < count; i++) {
        const struct sp_vec3 at = sp_vec3_from(slices->plane[i].position);
        places[i] = sp_vec3_dot(sp_vec3_sub(at, first), along);
        off = fmax(off, fabs(places[i] - i * step));
    }
    grid->spacing[2] = step;
    for (int row = 0; row < 3; row++)
        grid->direction[row][2] = along.v[row];
    if (places && gaps) {
        warn_of_shift(slices, grid, warnings);
        if (off > EXACT_SHARE * step && off <= EVEN_SHARE * step)
            import_warn(warnings,
                        "The slices are not quite even: they are up to %.3g mm (%.2g %% of the "
                        "step) off, and are shown %.6g mm apart.",
                        off, 100 * off / step, step);
        if (off > EVEN_SHARE * step) {
            warn_of_gaps(slices, places, gaps, warnings);
            import_grid_set_positions(grid, 2, places);
        }
    }
    const bool ok = places && gaps;
    free(gaps);
    return ok;
}

static bool is_of_body(const struct dicom_image *image) {
    return strcmp(image->modality, "CT") == 0 || strcmp(image->modality, "MR") == 0 ||
           strcmp(image->modality, "PT") == 0;
}

/* Says what the file does not tell about places, and what is shown instead. dicom_folder.c says it
 * of files without positions. */
static void warn_of_missing(const struct dicom_slices *slices, const struct dicom_source *source) {
    struct import_warnings *warnings = source->file->warnings;
    const struct dicom_frame *first = &slices->items[0].is;
    const bool is_stack = slices->planes > 1, is_body = is_of_body(&source->image);
    const bool has_pixels = first->spacing[0] > 0 && first->spacing[1] > 0 && !first->is_ratio;
    if (!first->is_placed && (slices->count == 1 ? is_body : source->image.frames > 1 && is_stack))
        import_warn(warnings, "The file does not say where its images lie: they are shown in the "
                              "order of the file, and left, right, front and back are not known.");
    if (!has_pixels && (is_stack || is_body))
        import_warn(warnings, "The file does not say how far apart its pixels are: they are shown "
                              "1 apart, without a unit.");
    if (is_stack && (first->is_assumed || (!first->is_placed && first->spacing[2] == 0)))
        import_warn(warnings,
                    "The file does not say how far apart its slices are: they are shown 1%s apart.",
                    has_pixels ? " mm" : "");
    if (first->is_contradicted)
        import_warn(warnings, "The first number of GridFrameOffsetVector is neither 0 nor the "
                              "height of the image: the numbers are taken as distances from "
                              "ImagePositionPatient. Check the heights of the slices.");
}

bool dicom_grid_fill(const struct dicom_slices *slices, const struct dicom_source *source,
                     struct import_header *header, double **places, struct sp_error *err) {
    struct sp_grid *grid = &header->grid;
    const struct dicom_frame *first = &slices->items[0].is;
    const struct sp_vec3 normal =
        sp_vec3_cross(sp_vec3_from(first->along[0]), sp_vec3_from(first->along[1]));
    const bool is_mm = first->spacing[0] > 0 && first->spacing[1] > 0 && !first->is_ratio;
    *places = NULL;
    grid->dims[0] = source->image.columns;
    grid->dims[1] = source->image.rows;
    grid->dims[2] = slices->planes;
    for (int axis = 0; axis < 3; axis++)
        grid->spacing[axis] = first->spacing[axis] != 0 ? fabs(first->spacing[axis]) : 1;
    snprintf(header->unit, sizeof header->unit, "%s", is_mm ? "mm" : "");
    warn_of_missing(slices, source);
    if (!first->is_placed)
        return true;
    for (int row = 0; row < 3; row++) {
        grid->direction[row][0] = first->along[0][row];
        grid->direction[row][1] = first->along[1][row];
        grid->direction[row][2] = normal.v[row];
        grid->origin[row] = slices->plane[0].position[row];
    }
    if (slices->planes > 1 && !place_slices(slices, source->file->warnings, grid, places))
        return sp_fail(err, SP_ERR_MEMORY, source->file->title, "out of memory for the slices");
    if (source->image.is_in_patient)
        import_header_set_anatomy(header, "LPS");
    return true;
}

void dicom_grid_warn_of_sides(const struct dicom_slices *slices,
                              const struct dicom_source *source) {
    double most = 0;
    for (uint32_t i = 1; i < slices->count; i++) {
        const struct dicom_slice *a = &slices->items[i - 1], *b = &slices->items[i];
        if (a->plane == b->plane && a->is.is_placed)
            most = fmax(most, sp_vec3_length(sp_vec3_sub(sp_vec3_from(a->is.position),
                                                         sp_vec3_from(b->is.position))));
    }
    const struct dicom_frame *first = &slices->items[0].is;
    if (most > fmax(first->spacing[0], first->spacing[1]))
        import_warn(source->file->warnings,
                    "Images of one height lie up to %.4g mm beside each other, such as two knees: "
                    "the fields or steps are different places.",
                    most);
}
