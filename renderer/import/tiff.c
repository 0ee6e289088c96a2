/* SPDX-License-Identifier: Apache-2.0
 *
 * Multi-page TIFF: each page is a slice, of one channel and one step in time if the file says so
 * (tiff_planes.h); all have one size, type and number of channels. OpenImageIO reads the pages.
 * Files that it would read wrongly without an error are refused: pages with depth or missing bytes
 * (tiff_chain.c), odd bit depths, and stacks that ImageJ hides behind one directory.
 */
#include <errno.h>
#include <inttypes.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "import/conversion.h"
#include "import/image_bridge.h"
#include "import/module.h"
#include "import/tiff_chain.h"
#include "import/tiff_planes.h"
#include "volume/volume.h"

struct tiff {
    const struct import_file *file;
    const struct image_bridge_functions *call;
    struct image_bridge *bridge;
    uint32_t pages;
    size_t pixels; /* of a page */
    struct import_conversion conversion;
    struct tiff_planes planes;
    const uint32_t *chosen; /* the pages of the volume, one per slice */
};

static bool fail_page(struct sp_error *err, enum sp_code code, const struct tiff *t, uint32_t page,
                      const char *text) {
    char place[SP_ERROR_PLACE];
    snprintf(place, sizeof place, "%.180s: page %" PRIu32, t->file->shown, page);
    return sp_fail(err, code, place, "%s", text);
}

/* Checks the first page, which determines size and type. */

static bool take_type(const struct tiff *t, const struct image_page *page,
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

/* All pages are slices. */
static bool take_slices(struct tiff *t, struct sp_error *err) {
    t->planes.slices = t->pages;
    t->planes.channels = t->planes.steps = 1;
    if (!tiff_planes_allocate(&t->planes, t->file, t->pages, err))
        return false;
    for (uint32_t i = 0; i < t->pages; i++)
        t->planes.pages[i] = i;
    return true;
}

/* Channels are the fastest in a hyperstack of ImageJ, then slices. Frames without slices are read
 * as slices: many programs write stacks like that. */
static bool take_imagej(struct tiff *t, const char *d, struct sp_error *err) {
    char text[200], value[32];
    long images = imagej_count(d, "images"), channels = imagej_count(d, "channels");
    long frames = imagej_count(d, "frames"), slices = imagej_count(d, "slices");
    if (images != (long)t->pages) {
        snprintf(text, sizeof text,
                 "ImageJ declares %ld images, but the file has %" PRIu32
                 " pages; save it as an image sequence or as NRRD",
                 images, t->pages);
        return fail_page(err, SP_ERR_UNSUPPORTED, t, 0, text);
    }
    if (channels <= 1 && (frames <= 1 || slices <= 1))
        return take_slices(t, err);
    if (channels < 1 || frames < 1 || slices < 1 || channels > images || slices > images ||
        frames > images || channels * slices * frames != images) {
        snprintf(text, sizeof text,
                 "ImageJ declares %ld channels, %ld slices and %ld frames in %ld images", channels,
                 slices, frames, images);
        return fail_page(err, SP_ERR_FORMAT, t, 0, text);
    }
    t->planes.slices = (uint32_t)slices;
    t->planes.channels = (uint32_t)channels;
    t->planes.steps = (uint32_t)frames;
    const char *interval = imagej_value(d, "finterval", value, sizeof value);
    t->planes.interval = interval ? strtod(interval, NULL) : 0;
    snprintf(t->planes.time_unit, sizeof t->planes.time_unit, "s");
    if (!tiff_planes_allocate(&t->planes, t->file, t->pages, err))
        return false;
    for (uint32_t i = 0; i < t->pages; i++) {
        const uint32_t c = i % t->planes.channels, kt = i / t->planes.channels;
        const uint32_t k = kt % t->planes.slices, step = kt / t->planes.slices;
        t->planes.pages[(step * t->planes.channels + c) * t->planes.slices + k] = i;
    }
    return true;
}

static bool take_ome(struct tiff *t, unsigned samples, struct sp_error *err) {
    const size_t size = t->call->description(t->bridge, NULL, 0);
    char *xml = size < INT_MAX ? malloc(size + 1) : NULL;
    if (!xml)
        return sp_fail(err, SP_ERR_MEMORY, t->file->shown, "out of memory for OME-XML");
    t->call->description(t->bridge, xml, size + 1);
    const bool ok = tiff_ome_parse(&t->planes, t->file, xml, strlen(xml), t->pages, samples, err);
    free(xml);
    return ok;
}

/* ImageJ writes pixels per unit into the resolution, and slice distance and unit into the
 * description. Other programs write pixels per inch or centimetre; the distance of slices is then
 * that of columns. */
static void take_spacing(const struct image_page *page, bool imagej, struct import_header *header) {
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

/* Without a distance of slices, it is that of columns. */
static void take_ome_spacing(const struct tiff *t, struct import_header *header) {
    const struct tiff_planes *p = &t->planes;
    if (!(p->spacing[0] > 0))
        return;
    for (int a = 0; a < 3; a++)
        header->grid.spacing[a] = p->spacing[a] > 0 ? p->spacing[a] : p->spacing[0];
    memcpy(header->unit, p->unit, sizeof header->unit);
}

static bool same_page(const struct image_page *a, const struct image_page *b) {
    return a->width == b->width && a->height == b->height && a->depth == b->depth &&
           a->channels == b->channels && a->bytes == b->bytes && a->bits == b->bits &&
           a->floating == b->floating && a->is_signed == b->is_signed;
}

static bool check_page(const struct tiff *t, const struct image_page *page, uint32_t n,
                       struct sp_error *err) {
    char text[160];
    if (page->channels < 1 || page->channels > TIFF_SAMPLES_MAX || page->depth > 1) {
        snprintf(text, sizeof text,
                 "%d channels and a depth of %d; flat images of 1 to %d channels are supported",
                 page->channels, page->depth, TIFF_SAMPLES_MAX);
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

/* Checks the pages that are chosen. */
static bool check_pages(const struct tiff *t, const struct image_page *first,
                        struct sp_error *err) {
    struct image_page page;
    char why[SP_ERROR_TEXT];
    uint32_t missing = 0;
    for (uint32_t k = 0; k < t->planes.slices; k++) {
        const uint32_t n = t->chosen[k];
        missing += n == TIFF_NO_PAGE;
        if (n == TIFF_NO_PAGE)
            continue;
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
    if (missing > 0)
        import_warn(t->file->warnings,
                    "%" PRIu32 " of %" PRIu32 " slices are not in the file; they are 0.", missing,
                    t->planes.slices);
    return missing < t->planes.slices ||
           fail_page(err, SP_ERR_FORMAT, t, 0, "the file has no page of this channel and step");
}

/* The name of field n: of a channel with pages of its own, or of one within the pages. */
static void name_field(const struct tiff *t, uint32_t n, char name[SP_FIELD_BYTES]) {
    const struct tiff_planes *p = &t->planes;
    const uint32_t samples = t->conversion.components, channel = n / samples;
    bool is_alone = p->names && p->names[channel][0] && samples == 1;
    for (uint32_t i = 0; is_alone && i < channel; i++)
        is_alone = strcmp(p->names[i], p->names[channel]) != 0;
    if (is_alone)
        import_name(name, p->names[channel]);
    else
        snprintf(name, SP_FIELD_BYTES, "channel %" PRIu32, n + 1);
    if (p->channels * samples == 1 && !is_alone)
        name[0] = 0;
}

/* Chooses the channel and the step, and with them the pages. */
static bool choose(struct tiff *t, struct import_header *header, struct sp_error *err) {
    const struct tiff_planes *p = &t->planes;
    const uint32_t samples = t->conversion.components, count = p->channels * samples;
    char name[SP_FIELD_BYTES];
    uint32_t chosen = 0;
    if (!import_header_use_steps(header, t->file, p->steps, err))
        return false;
    if (p->steps > 1)
        import_header_use_interval(header, 0, p->interval, p->time_unit);
    if (p->channels == 1 && samples > 1) {
        chosen = import_header_choose_component(header, t->file->field, samples, samples > 2);
    } else {
        for (uint32_t n = 0; n < count && *t->file->field; n++) {
            name_field(t, n, name);
            if (strcmp(name, t->file->field) == 0)
                chosen = n;
        }
        name_field(t, chosen, header->value_name);
        for (uint32_t n = 0; n < count && n <= SP_OTHER_FIELDS_MAX; n++) {
            name_field(t, n, name);
            if (n != chosen)
                import_header_add_other(header, name);
        }
    }
    t->conversion.component = chosen % samples;
    t->chosen = p->pages + ((size_t)t->file->step * p->channels + chosen / samples) * p->slices;
    return true;
}

static void close_tiff(void *reader) {
    struct tiff *t = reader;
    if (t->bridge)
        t->call->close(t->bridge);
    tiff_planes_finish(&t->planes);
    free(t);
}

static bool take_pages(struct tiff *t, const struct image_page *page, struct import_header *header,
                       struct sp_error *err) {
    const bool is_ome = tiff_is_ome(page->description);
    const bool is_imagej = strncmp(page->description, "ImageJ=", 7) == 0;
    if (!check_page(t, page, 0, err) || !take_type(t, page, header, err))
        return false;
    import_header_init(header);
    t->conversion = import_conversion_of(import_number_of(header->type), t->file->warnings);
    t->conversion.components = (unsigned)page->channels;
    if (!(is_ome      ? take_ome(t, (unsigned)page->channels, err)
          : is_imagej ? take_imagej(t, page->description, err)
                      : take_slices(t, err)) ||
        !choose(t, header, err) || !check_pages(t, page, err))
        return false;
    header->grid.dims[0] = (uint32_t)page->width;
    header->grid.dims[1] = (uint32_t)page->height;
    header->grid.dims[2] = t->planes.slices;
    t->pixels = (size_t)page->width * (size_t)page->height;
    take_spacing(page, is_imagej, header);
    if (is_ome)
        take_ome_spacing(t, header);
    return sp_grid_check(&header->grid, header->type, t->file->shown, &header->bytes, err);
}

static bool open_pages(struct tiff *t, struct import_header *header, struct sp_error *err) {
    char path[40], why[SP_ERROR_TEXT];
    struct image_page *page = malloc(sizeof *page);
    if (!page)
        return sp_fail(err, SP_ERR_MEMORY, t->file->shown, "out of memory");
    /* Opens by descriptor, because the name may refer to another file by now. */
    snprintf(path, sizeof path, "/proc/self/fd/%d", t->file->fd);
    bool ok = tiff_chain_check(t->file, &t->pages, err) &&
              (t->call = import_module_load(t->file, IMAGE_BRIDGE_MODULE, IMAGE_BRIDGE_SYMBOL,
                                            "OpenImageIO", "libopenimageio2.4", err)) != NULL;
    if (ok && !(t->bridge = t->call->open(path, "tiff", why, sizeof why)))
        ok = fail_page(err, SP_ERR_FORMAT, t, 0, why);
    if (ok && t->call->page(t->bridge, 0, page, why, sizeof why) != 1)
        ok = fail_page(err, SP_ERR_FORMAT, t, 0, why);
    ok = ok && take_pages(t, page, header, err);
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
    struct tiff *t = reader;
    const struct import_conversion *c = &t->conversion;
    const size_t bytes = t->pixels * sp_type_size(c->type);
    char why[SP_ERROR_TEXT];
    void *pixels = c->components > 1 ? malloc(bytes * c->components) : NULL;
    (void)vectors; /* a TIFF has none */
    bool ok = c->components == 1 || pixels ||
              sp_fail(err, SP_ERR_MEMORY, t->file->shown, "out of memory for a page");
    for (uint32_t k = 0; ok && k < t->planes.slices; k++) {
        const uint32_t n = t->chosen[k];
        char *to = (char *)voxels + k * bytes;
        if (n == TIFF_NO_PAGE)
            memset(to, 0, bytes);
        else if (!t->call->read(t->bridge, (int)n, pixels ? pixels : to, why, sizeof why))
            ok = fail_page(err, SP_ERR_FORMAT, t, n, why);
        else if (pixels)
            import_conversion_put(c, pixels, t->pixels, to);
        import_report(progress, (k + 1) * bytes);
    }
    free(pixels);
    return ok;
}

static bool probe_tiff(const uint8_t *start, size_t size, const char *shown) {
    (void)shown;
    return size >= 4 && (memcmp(start, "II*\0", 4) == 0 || memcmp(start, "MM\0*", 4) == 0 ||
                         memcmp(start, "II+\0", 4) == 0 || memcmp(start, "MM\0+", 4) == 0);
}

const struct import_format import_tiff = { .name = "TIFF",
                                           .needs_module = true,
                                           .probe = probe_tiff,
                                           .open = open_tiff,
                                           .read = read_tiff,
                                           .close = close_tiff };
