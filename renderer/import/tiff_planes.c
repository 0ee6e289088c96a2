/* SPDX-License-Identifier: Apache-2.0 */
#include "import/tiff_planes.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

bool tiff_fail(const struct tiff_file *t, uint32_t page, struct sp_error *err, enum sp_code code,
               const char *format, ...) {
    char place[SP_ERROR_PLACE], text[SP_ERROR_TEXT];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    snprintf(place, sizeof place, "%.180s: page %" PRIu32, t->file->shown, page);
    return sp_fail(err, code, place, "%s", text);
}

bool tiff_planes_allocate(struct tiff_planes *p, const struct import_file *file, uint32_t most,
                          struct sp_error *err) {
    const uint64_t count = (uint64_t)p->slices * p->channels, limit = (uint64_t)most * 100;
    if (p->slices < 1 || p->channels < 1 || p->steps < 1 || count > limit ||
        p->steps > limit / count)
        return sp_fail(err, SP_ERR_FORMAT, file->shown,
                       "%" PRIu32 " slices, %" PRIu32 " channels and %" PRIu32
                       " steps cannot be in the %" PRIu32 " pages of the file",
                       p->slices, p->channels, p->steps, most);
    p->pages = malloc((size_t)(count * p->steps) * sizeof *p->pages);
    for (uint64_t i = 0; p->pages && i < count * p->steps; i++)
        p->pages[i] = TIFF_NO_PAGE;
    return p->pages || sp_fail(err, SP_ERR_MEMORY, file->shown, "out of memory for pages");
}

bool tiff_planes_hide(struct tiff_planes *p, const struct tiff_file *t, uint64_t needed) {
    const struct tiff_page *page = &t->pages[0];
    const uint64_t bytes = tiff_row_bytes(page) * page->height * page->planes;
    p->is_hidden = t->count == 1 && page->pixels_at > 0 && bytes > 0 &&
                   (t->file->size - page->pixels_at) / bytes >= needed &&
                   (page->at < page->pixels_at || page->at >= page->pixels_at + needed * bytes);
    return p->is_hidden;
}

void tiff_planes_finish(struct tiff_planes *p) {
    free(p->pages);
    free(p->names);
    *p = (struct tiff_planes){ .slices = 0 };
}
