/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/tiff_planes.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/meaning.h"
#include "data/volume/unit.h"

bool tiff_fail(const struct tiff_file *t, uint32_t page, struct sp_error *err, enum sp_code code,
               const char *format, ...) {
    char place[SP_ERROR_PLACE], text[SP_ERROR_TEXT];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    snprintf(place, sizeof place, "%.180s: page %" PRIu32, t->file->title, page);
    return sp_fail(err, code, place, "%s", text);
}

bool tiff_planes_allocate(struct tiff_planes *p, const struct import_file *file, uint32_t most,
                          struct sp_error *err) {
    const uint64_t count = (uint64_t)p->slices * p->channels, limit = (uint64_t)most * 100;
    if (p->slices < 1 || p->channels < 1 || p->steps < 1 || count > limit ||
        p->steps > limit / count)
        return sp_fail(err, SP_ERR_FORMAT, file->title,
                       "%" PRIu32 " slices, %" PRIu32 " channels and %" PRIu32
                       " steps cannot be in the %" PRIu32 " pages of the file",
                       p->slices, p->channels, p->steps, most);
    p->pages = malloc((size_t)(count * p->steps) * sizeof *p->pages);
    for (uint64_t i = 0; p->pages && i < count * p->steps; i++)
        p->pages[i] = TIFF_NO_PAGE;
    return p->pages || sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for pages");
}

bool tiff_planes_hide(struct tiff_planes *p, const struct tiff_file *t, uint64_t needed) {
    const struct tiff_page *page = &t->pages[0];
    const uint64_t bytes = tiff_row_bytes(page) * page->height * page->planes;
    p->is_hidden = t->count == 1 && page->pixels_at > 0 && bytes > 0 &&
                   (t->file->size - page->pixels_at) / bytes >= needed &&
                   (page->at < page->pixels_at || page->at >= page->pixels_at + needed * bytes);
    return p->is_hidden;
}

void tiff_planes_convert(struct tiff_planes *p, const struct import_file *file, int axis,
                         const char *unit) {
    if (!(p->spacing[axis] > 0) || strcmp(unit, p->unit) == 0)
        return;
    const struct sp_unit *from = sp_unit_find(unit), *to = sp_unit_find(p->unit);
    if (from && to)
        p->spacing[axis] *= from->meters / to->meters;
    else
        import_warn(
            file->warnings,
            "The spacing along %c (%g%s%.20s) was not converted to \"%.20s\", the unit of the "
            "others.",
            'x' + axis, p->spacing[axis], *unit ? " " : "", unit, p->unit);
}

static void forget_times(struct tiff_planes *p) {
    p->interval = 0;
    free(p->times);
    p->times = NULL;
}

static bool name_colors(struct tiff_planes *p, const struct import_file *file,
                        struct sp_error *err) {
    static const char *const colors[] = { "red", "green", "blue", "alpha" };
    p->names = calloc(p->channels, sizeof *p->names);
    for (uint32_t c = 0; p->names && c < p->channels; c++)
        import_name(p->names[c], colors[c]);
    return p->names || sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for colours");
}

/* Only one of the axes of which `*from` and `*to` are lengths is longer than 1, so that the order
 * of the pages stays. */
static void move_axis(uint32_t *from, uint32_t *to) {
    const uint32_t count = *from;
    *from = 1;
    *to = count;
}

bool tiff_planes_choose(struct tiff_planes *p, const struct import_file *file, unsigned samples,
                        bool *are_colors, struct import_header *header, struct sp_error *err) {
    const enum import_as wanted = file->selection.as;
    uint32_t *const from = p->channels > 1 ? &p->channels : p->steps > 1 ? &p->steps : &p->slices;
    const bool are_samples =
        samples > 1 && (wanted == IMPORT_AS_RGB || wanted == IMPORT_AS_CHANNELS || *from == 1);
    const struct import_extra extra = { .count = are_samples ? samples : *from,
                                        .no_vectors = true,
                                        .are_parts =
                                            are_samples || (p->channels > 1 && p->steps > 1) };
    enum import_as as;
    if (!import_as_is_axis(wanted))
        return true;
    if (!import_meaning_choose(file, &extra, header, &as, err))
        return false;
    if (are_samples) {
        *are_colors = as == IMPORT_AS_RGB;
        return true;
    }
    if (as == IMPORT_AS_TIME && from != &p->steps)
        forget_times(p); /* the times belong to the other axis */
    if (as == IMPORT_AS_RGB || from != &p->channels) {
        free(p->names);
        p->names = NULL;
    }
    move_axis(from, as == IMPORT_AS_TIME ? &p->steps : &p->channels);
    return as != IMPORT_AS_RGB || name_colors(p, file, err);
}

void tiff_planes_finish(struct tiff_planes *p) {
    free(p->pages);
    free(p->names);
    free(p->times);
    *p = (struct tiff_planes){ .slices = 0 };
}
