/* SPDX-License-Identifier: Apache-2.0
 *
 * Multi-page TIFF: each page is a slice; all have one size, one type and one channel. OpenImageIO
 * reads the pages. Files that it would read wrongly without an error are refused: pages with depth
 * or missing bytes (tiff_chain.c), odd bit depths, and stacks that ImageJ hides behind one
 * directory.
 */
#include <dlfcn.h>
#include <errno.h>
#include <inttypes.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "import/format.h"
#include "import/tiff_bridge.h"
#include "import/tiff_chain.h"
#include "volume/volume.h"

struct tiff {
    const struct import_file *file;
    const struct tiff_bridge_functions *call;
    struct tiff_bridge *bridge;
    uint32_t pages;
    size_t page_bytes;
};

static bool fail_page(struct sp_error *err, enum sp_code code, const struct tiff *t, uint32_t page,
                      const char *text) {
    char place[SP_ERROR_PLACE];
    snprintf(place, sizeof place, "%.180s: page %" PRIu32, t->file->shown, page);
    return sp_fail(err, code, place, "%s", text);
}

/* Checks the first page, which determines size and type. */

static bool take_type(const struct tiff *t, const struct tiff_page *page,
                      struct import_header *header, struct sp_error *err) {
    static const struct {
        int bytes;
        bool floating, is_signed;
        enum sp_type type;
    } types[] = {
        { 1, false, false, SP_UINT8 }, { 1, false, true, SP_INT8 },  { 2, false, false, SP_UINT16 },
        { 2, false, true, SP_INT16 },  { 4, false, true, SP_INT32 }, { 4, true, true, SP_FLOAT32 },
        { 8, true, true, SP_FLOAT64 },
    };
    char text[160];
    if (page->bits && page->bits != page->bytes * 8) {
        snprintf(text, sizeof text,
                 "%d bits per sample are not supported; supported are 8, 16, 32 and 64",
                 page->bits);
        return fail_page(err, SP_ERR_UNSUPPORTED, t, 0, text);
    }
    for (size_t i = 0; i < sizeof types / sizeof types[0]; i++)
        if (page->bytes == types[i].bytes && page->floating == types[i].floating &&
            page->is_signed == types[i].is_signed) {
            header->type = types[i].type;
            return true;
        }
    snprintf(text, sizeof text, "%s samples of %d bits are not supported",
             page->floating    ? "floating-point"
             : page->is_signed ? "signed"
                               : "unsigned",
             page->bytes * 8);
    return fail_page(err, SP_ERR_UNSUPPORTED, t, 0, text);
}

/* Finds a line "KEY=VALUE" in ImageJ's description; NULL if there is none. */
static const char *imagej_value(const char *description, const char *key, char *out,
                                size_t capacity) {
    size_t n = strlen(key);
    for (const char *line = description; line && *line;) {
        const char *end = strchr(line, '\n');
        size_t length = end ? (size_t)(end - line) : strlen(line);
        if (length > n && strncmp(line, key, n) == 0 && line[n] == '=') {
            snprintf(out, capacity, "%.*s", (int)(length - n - 1), line + n + 1);
            return out;
        }
        line = end ? end + 1 : NULL;
    }
    return NULL;
}

static long imagej_count(const char *description, const char *key) {
    char value[32];
    const char *text = imagej_value(description, key, value, sizeof value);
    return text ? strtol(text, NULL, 10) : 1;
}

static bool check_imagej(const struct tiff *t, const char *d, struct sp_error *err) {
    char text[200];
    long images = imagej_count(d, "images"), channels = imagej_count(d, "channels");
    long frames = imagej_count(d, "frames"), slices = imagej_count(d, "slices");
    if (channels > 1 || (frames > 1 && slices > 1)) {
        snprintf(text, sizeof text,
                 "an ImageJ stack of %ld channels, %ld slices, %ld frames; save one channel of one "
                 "frame",
                 channels, slices, frames);
        return fail_page(err, SP_ERR_UNSUPPORTED, t, 0, text);
    }
    if (images != (long)t->pages) {
        snprintf(text, sizeof text,
                 "ImageJ declares %ld images, but the file has %" PRIu32
                 " pages; save it as an image sequence or as NRRD",
                 images, t->pages);
        return fail_page(err, SP_ERR_UNSUPPORTED, t, 0, text);
    }
    return true;
}

/* ImageJ writes pixels per unit into the resolution, and slice distance and unit into the
 * description. Other programs write pixels per inch or centimetre; the distance of slices is then
 * that of columns. */
static void take_spacing(const struct tiff_page *page, bool imagej, struct import_header *header) {
    double *spacing = header->grid.spacing, x = page->x_resolution, y = page->y_resolution;
    bool sane = isfinite(x) && isfinite(y) && x > 1e-9 && y > 1e-9 && x < 1e9 && y < 1e9;
    char value[64];
    if (imagej) {
        const char *unit = imagej_value(page->description, "unit", value, sizeof value);
        if (unit) {
            bool micron = strcmp(unit, "micron") == 0 || strcmp(unit, "microns") == 0 ||
                          strcmp(unit, "\\u00B5m") == 0 || strcmp(unit, "\xc2\xb5m") == 0;
            snprintf(header->unit, sizeof header->unit, "%.31s", micron ? "um" : unit);
        }
        if (sane) {
            spacing[0] = 1 / x;
            spacing[1] = 1 / y;
        }
        const char *between = imagej_value(page->description, "spacing", value, sizeof value);
        double z = between ? fabs(strtod(between, NULL)) : 0;
        spacing[2] = isfinite(z) && z > 0 ? z : spacing[0];
        return;
    }
    double mm = strcmp(page->resolution_unit, "in") == 0   ? 25.4
                : strcmp(page->resolution_unit, "cm") == 0 ? 10
                                                           : 0;
    if (!sane || mm == 0)
        return;
    spacing[0] = spacing[2] = mm / x;
    spacing[1] = mm / y;
    snprintf(header->unit, sizeof header->unit, "mm");
}

static bool same_page(const struct tiff_page *a, const struct tiff_page *b) {
    return a->width == b->width && a->height == b->height && a->depth == b->depth &&
           a->channels == b->channels && a->bytes == b->bytes && a->bits == b->bits &&
           a->floating == b->floating && a->is_signed == b->is_signed;
}

static bool check_page(const struct tiff *t, const struct tiff_page *page, uint32_t n,
                       struct sp_error *err) {
    char text[160];
    if (page->channels != 1 || page->depth > 1) {
        snprintf(text, sizeof text,
                 "%d channels and a depth of %d; only flat grey images are supported",
                 page->channels, page->depth);
        return fail_page(err, SP_ERR_UNSUPPORTED, t, n, text);
    }
    if (page->width < 1 || page->height < 1 || page->width > (int)SP_DIM_MAX ||
        page->height > (int)SP_DIM_MAX) {
        snprintf(text, sizeof text, "%d x %d px, outside [1, %u]", page->width, page->height,
                 SP_DIM_MAX);
        return fail_page(err, SP_ERR_FORMAT, t, n, text);
    }
    return true;
}

static bool check_pages(const struct tiff *t, const struct tiff_page *first, struct sp_error *err) {
    struct tiff_page page;
    char why[SP_ERROR_TEXT];
    for (uint32_t n = 0; n < t->pages; n++) {
        int status = t->call->page(t->bridge, (int)n, &page, why, sizeof why);
        if (status < 0)
            return fail_page(err, SP_ERR_FORMAT, t, n, why);
        if (status == 0)
            return fail_page(err, SP_ERR_UNSUPPORTED, t, n, "OpenImageIO does not find this page");
        if (!same_page(first, &page)) {
            snprintf(why, sizeof why,
                     "%d x %d px of %d channels and %d bits, but page 0 has %d x %d, %d and %d",
                     page.width, page.height, page.channels, page.bytes * 8, first->width,
                     first->height, first->channels, first->bytes * 8);
            return fail_page(err, SP_ERR_UNSUPPORTED, t, n, why);
        }
    }
    return true;
}

static void close_tiff(void *reader) {
    struct tiff *t = reader;
    if (t->bridge)
        t->call->close(t->bridge);
    free(t);
}

/* Loads the module beside this program. */
static bool load_bridge(struct tiff *t, struct sp_error *err) {
    char folder[PATH_MAX], path[PATH_MAX + sizeof TIFF_BRIDGE_MODULE];
    snprintf(path, sizeof path, "%s/" TIFF_BRIDGE_MODULE, import_program_folder(folder));
    void *module = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    t->call = module ? dlsym(module, TIFF_BRIDGE_SYMBOL) : NULL;
    if (t->call)
        return true;
    const char *why = dlerror();
    return sp_fail(err, SP_ERR_UNSUPPORTED, t->file->shown, "the TIFF reader cannot be loaded: %s",
                   why ? why : strerror(errno));
}

static bool open_pages(struct tiff *t, struct import_header *header, struct sp_error *err) {
    char path[40], why[SP_ERROR_TEXT];
    struct tiff_page *page = malloc(sizeof *page);
    if (!page)
        return sp_fail(err, SP_ERR_MEMORY, t->file->shown, "out of memory");
    /* Opens by descriptor, because the name may refer to another file by now. */
    snprintf(path, sizeof path, "/proc/self/fd/%d", t->file->fd);
    bool ok = tiff_chain_check(t->file, &t->pages, err) && load_bridge(t, err);
    if (ok && !(t->bridge = t->call->open(path, why, sizeof why)))
        ok = fail_page(err, SP_ERR_FORMAT, t, 0, why);
    if (ok && t->call->page(t->bridge, 0, page, why, sizeof why) != 1)
        ok = fail_page(err, SP_ERR_FORMAT, t, 0, why);
    bool imagej = ok && strncmp(page->description, "ImageJ=", 7) == 0;
    ok = ok && check_page(t, page, 0, err) && take_type(t, page, header, err) &&
         (!imagej || check_imagej(t, page->description, err)) && check_pages(t, page, err);
    if (ok) {
        import_header_init(header);
        header->grid.dims[0] = (uint32_t)page->width;
        header->grid.dims[1] = (uint32_t)page->height;
        header->grid.dims[2] = t->pages;
        t->page_bytes = (size_t)page->width * (size_t)page->height * (size_t)page->bytes;
        take_spacing(page, imagej, header);
        ok = sp_grid_check(&header->grid, header->type, t->file->shown, &header->bytes, err);
    }
    free(page);
    return ok;
}

static void *open_tiff(const struct import_file *file, struct import_header *header,
                       struct sp_error *err) {
    struct tiff *t = calloc(1, sizeof *t);
    if (!t) {
        sp_fail(err, SP_ERR_MEMORY, file->shown, "out of memory");
        return NULL;
    }
    t->file = file;
    if (open_pages(t, header, err))
        return t;
    close_tiff(t);
    return NULL;
}

static bool read_tiff(void *reader, void *voxels, float (*vectors)[3],
                      const struct import_progress *progress, struct sp_error *err) {
    (void)vectors; /* a TIFF has none */
    struct tiff *t = reader;
    char why[SP_ERROR_TEXT];
    for (uint32_t n = 0; n < t->pages; n++) {
        if (!t->call->read(t->bridge, (int)n, (char *)voxels + n * t->page_bytes, why, sizeof why))
            return fail_page(err, SP_ERR_FORMAT, t, n, why);
        import_report(progress, (n + 1) * t->page_bytes);
    }
    return true;
}

static bool probe_tiff(const uint8_t *start, size_t size, const char *shown) {
    (void)shown;
    return size >= 4 && (memcmp(start, "II*\0", 4) == 0 || memcmp(start, "MM\0*", 4) == 0 ||
                         memcmp(start, "II+\0", 4) == 0 || memcmp(start, "MM\0+", 4) == 0);
}

const struct import_format import_tiff = {
    .name = "TIFF", .probe = probe_tiff, .open = open_tiff, .read = read_tiff, .close = close_tiff
};
