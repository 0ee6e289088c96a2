/* SPDX-License-Identifier: Apache-2.0
 *
 * Which page is what, from the tags of Zeiss (LSM) and MetaMorph (STK) and the sizes of the pages;
 * and the size of a pixel.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/tiff_planes.h"

enum {
    TAG_ORIENTATION = 274,
    TAG_X_RESOLUTION = 282,
    TAG_Y_RESOLUTION = 283,
    TAG_RESOLUTION_UNIT = 296
};
enum { TAG_PIXEL_SCALE = 33550, TAG_STK_PLANES = 33629, TAG_TIEPOINT = 33922 };
enum { RESOLUTIONS_MAX = 4096 }; /* pages whose resolution is compared */
enum { GROUPS_MAX = 32 };        /* kinds of pages */
enum { TAG_LSM = 34412, TAG_TRANSFORMATION = 34264, TAG_GEO_KEYS = 34735, TAG_NO_DATA = 42113 };

/* All pages of the list are slices. */
static bool assign_slices(struct tiff_planes *p, const struct tiff_file *t, const uint32_t *pages,
                          uint32_t count, struct sp_error *err) {
    p->slices = count;
    p->channels = p->steps = 1;
    if (!tiff_planes_allocate(p, t->file, count, err))
        return false;
    for (uint32_t i = 0; i < count; i++)
        p->pages[i] = pages ? pages[i] : i;
    return true;
}

/* Zeiss LSM: a structure in the first page. Its pages alternate with small copies. */

struct lsm {
    uint32_t dims[5];  /* x, y, z, channels, time */
    double spacing[3]; /* [m] */
};

static bool read_lsm(const struct tiff_file *t, struct lsm *lsm) {
    uint8_t bytes[64];
    if (tiff_tag_bytes(t, &t->pages[0], TAG_LSM, 0, bytes, sizeof bytes) != sizeof bytes)
        return false;
    memcpy(lsm->dims, bytes + 8, sizeof lsm->dims);
    memcpy(lsm->spacing, bytes + 40, sizeof lsm->spacing);
    if (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__) { /* LSM files are little-endian */
        import_swap(lsm->dims, sizeof *lsm->dims, 5);
        import_swap(lsm->spacing, sizeof *lsm->spacing, 3);
    }
    return lsm->dims[0] == t->pages[0].width && lsm->dims[1] == t->pages[0].height &&
           lsm->dims[2] >= 1 && lsm->dims[3] >= 1 && lsm->dims[4] >= 1;
}

/* Channels are samples of a pixel. Slices vary faster than time steps. */
static bool apply_lsm(struct tiff_planes *p, const struct tiff_file *t, const struct lsm *lsm,
                      const uint32_t *pages, uint32_t count, struct sp_error *err) {
    p->slices = lsm->dims[2];
    p->steps = lsm->dims[4];
    p->channels = 1;
    if ((uint64_t)p->slices * p->steps != count)
        return tiff_fail(t, 0, err, SP_ERR_UNSUPPORTED,
                         "the LSM header has %" PRIu32 " slices and %" PRIu32
                         " times, but the file has %" PRIu32
                         " pages: it is cut off, or a scan of lines or tiles; save it as OME-TIFF",
                         p->slices, p->steps, count);
    for (int a = 0; a < 3; a++)
        p->spacing[a] = lsm->spacing[a] > 0 ? lsm->spacing[a] * 1e6 : 0;
    snprintf(p->unit, sizeof p->unit, "um");
    if (!tiff_planes_allocate(p, t->file, count, err))
        return false;
    memcpy(p->pages, pages, count * sizeof *pages);
    return true;
}

/* MetaMorph: a stack behind one directory, with a tag of as many values as planes. */
static bool apply_stk(struct tiff_planes *p, const struct tiff_file *t, uint64_t planes,
                      struct sp_error *err) {
    if (planes > UINT32_MAX || !tiff_planes_hide(p, t, planes))
        return tiff_fail(t, 0, err, SP_ERR_UNSUPPORTED,
                         "MetaMorph declares %" PRIu64
                         " planes, but the file is shorter or packed; "
                         "save it as OME-TIFF",
                         planes);
    import_warn(t->file->warnings,
                "The planes of the MetaMorph stack are read as slices; its calibration is not "
                "read, so the spacing is 1 unless the resolution tags give it.");
    return assign_slices(p, t, NULL, (uint32_t)planes, err);
}

/* Pages of one size. */

static bool same_kind(const struct tiff_page *a, const struct tiff_page *b) {
    return a->width == b->width && a->height == b->height && a->samples == b->samples &&
           a->bits == b->bits && a->format == b->format;
}

static bool fits(const struct tiff_page *page) {
    return page->width <= SP_DIM_MAX && page->height <= SP_DIM_MAX;
}

static bool is_larger(const struct tiff_page *a, const struct tiff_page *b) {
    return (uint64_t)a->width * a->height > (uint64_t)b->width * b->height;
}

struct group { /* pages of one kind */
    const struct tiff_page *page;
    uint64_t count;
};

static unsigned list_groups(const struct tiff_file *t, struct group groups[GROUPS_MAX]) {
    unsigned used = 0;
    for (uint32_t i = 0; i < t->count; i++) {
        const struct tiff_page *page = &t->pages[i];
        unsigned g = 0;
        while (g < used &&
               !(same_kind(groups[g].page, page) && groups[g].page->is_reduced == page->is_reduced))
            g++;
        if (g == used && used < GROUPS_MAX)
            groups[used++] = (struct group){ .page = page };
        if (g < used)
            groups[g].count++;
    }
    return used;
}

/* Chooses the pages that are the volume: those like the first page if it has others like it, as
 * tifffile does. Else the pages with most pixels, so that a thumbnail in front and the smaller
 * levels of a slide do not count. Pages that do not fit, and reduced ones, come last. */
static const struct tiff_page *choose_main(const struct tiff_file *t) {
    struct group groups[GROUPS_MAX] = { { .page = &t->pages[0] } };
    const unsigned count = list_groups(t, groups);
    const struct group *best = &groups[0];
    if (best->count > 1 && fits(best->page) && !best->page->is_reduced)
        return best->page;
    for (unsigned g = 1; g < count; g++) {
        const struct tiff_page *page = groups[g].page;
        const int order =
            (fits(page) - fits(best->page)) * 2 - (page->is_reduced - best->page->is_reduced);
        const double pixels = (double)page->width * page->height * (double)groups[g].count;
        if (order > 0 || (order == 0 && pixels > (double)best->page->width * best->page->height *
                                                     (double)best->count))
            best = &groups[g];
    }
    return best->page;
}

/* Lists the pages of the kind of `best`. Warns of the others: thumbnails, smaller levels of detail,
 * labels of slides. Returns how many. */
static uint32_t list_pages(const struct tiff_file *t, const struct tiff_page *best, uint32_t *out) {
    const struct tiff_page *other = NULL;
    uint32_t count = 0;
    for (uint32_t i = 0; i < t->count; i++)
        if (same_kind(&t->pages[i], best) && t->pages[i].is_reduced == best->is_reduced)
            out[count++] = i;
        else if (!other || is_larger(&t->pages[i], other))
            other = &t->pages[i];
    if (other && !fits(other))
        import_warn(t->file->warnings,
                    "The largest image of the file, %" PRIu32 " x %" PRIu32
                    " px, has more than %u px along an axis; a smaller one, %" PRIu32 " x %" PRIu32
                    " px, was read.",
                    other->width, other->height, SP_DIM_MAX, best->width, best->height);
    else if (other && !other->is_reduced)
        import_warn(t->file->warnings,
                    "%" PRIu32 " of %" PRIu32 " pages, of %" PRIu32 " x %" PRIu32 " px with %u "
                    "samples of %u bits, were left out: they differ from the others, of %" PRIu32
                    " x %" PRIu32 " px.",
                    t->count - count, t->count, other->width, other->height, other->samples,
                    other->bits, best->width, best->height);
    return count;
}

static bool assign_pages(struct tiff_planes *p, const struct tiff_file *t, struct sp_error *err) {
    struct lsm lsm;
    struct tiff_tag planes;
    uint32_t *pages = malloc(t->count * sizeof *pages);
    if (!pages)
        return sp_fail(err, SP_ERR_MEMORY, t->file->title, "out of memory for pages");
    const uint32_t count = list_pages(t, choose_main(t), pages);
    const bool ok = read_lsm(t, &lsm) ? apply_lsm(p, t, &lsm, pages, count, err)
                    : tiff_tag_find(t, &t->pages[0], TAG_STK_PLANES, &planes) && t->count == 1 &&
                            planes.count > 1
                        ? apply_stk(p, t, planes.count, err)
                        : assign_slices(p, t, pages, count, err);
    free(pages);
    return ok;
}

/* The size of a pixel. */

bool tiff_resolution(const struct tiff_file *t, const struct tiff_page *page, double *x, double *y,
                     double *unit) {
    *x = *y = 0;
    *unit = 2;
    tiff_tag_numbers(t, page, TAG_X_RESOLUTION, x, 1);
    tiff_tag_numbers(t, page, TAG_Y_RESOLUTION, y, 1);
    tiff_tag_numbers(t, page, TAG_RESOLUTION_UNIT, unit, 1);
    return isfinite(*x) && isfinite(*y) && *x > 1e-9 && *y > 1e-9 && *x < 1e9 && *y < 1e9;
}

/* Warns if other slices have another resolution than the first. */
static void compare_resolutions(const struct tiff_planes *p, const struct tiff_file *t,
                                const struct tiff_page *page) {
    const uint64_t count = (uint64_t)p->slices * p->channels * p->steps;
    double x, y, unit, other[3];
    if (p->is_hidden || !tiff_resolution(t, page, &x, &y, &unit))
        return;
    for (uint64_t i = 0; i < count && i < RESOLUTIONS_MAX; i++) {
        const uint32_t n = tiff_planes_page(p, p->pages[i]);
        if (n == TIFF_NO_PAGE ||
            !tiff_resolution(t, &t->pages[n], &other[0], &other[1], &other[2]) ||
            (fabs(other[0] / x - 1) < 1e-6 && fabs(other[1] / y - 1) < 1e-6 && other[2] == unit))
            continue;
        import_warn(t->file->warnings,
                    "The pages have several resolutions; that of the first one was used, %g x %g "
                    "pixels per %s. Page %" PRIu32 " has %g x %g.",
                    x, y, unit == 2 ? "inch" : "centimetre", n + 1, other[0], other[1]);
        return;
    }
}

/* Pixels per inch or centimetre; without a unit they are only a ratio. The description may have
 * given the distance of slices, in a unit of its own. */
static void read_resolution(struct tiff_planes *p, const struct tiff_file *t,
                            const struct tiff_page *page) {
    double x, y, unit;
    if (!tiff_resolution(t, page, &x, &y, &unit) || (unit != 2 && unit != 3))
        return;
    p->spacing[0] = (unit == 2 ? 25.4 : 10) / x;
    p->spacing[1] = (unit == 2 ? 25.4 : 10) / y;
    char own[SP_UNIT_BYTES];
    memcpy(own, p->unit, sizeof own);
    snprintf(p->unit, sizeof p->unit, "mm");
    tiff_planes_convert(p, t->file, 2, own);
    compare_resolutions(p, t, page);
}

/* GeoTIFF 1.1: from pixels to the world. */

struct geo {
    double model, raster, linear; /* kinds of the coordinates and of the pixels, and the unit */
};

static struct geo read_geo_keys(const struct tiff_file *t, const struct tiff_page *page) {
    struct geo geo = { .raster = 1 };
    double keys[256];
    const size_t count = tiff_tag_numbers(t, page, TAG_GEO_KEYS, keys, 256);
    for (size_t i = 4; i + 3 < count; i += 4) {
        double *key = keys[i] == 1024   ? &geo.model
                      : keys[i] == 1025 ? &geo.raster
                      : keys[i] == 3076 ? &geo.linear
                                        : NULL;
        if (key && keys[i + 1] == 0)
            *key = keys[i + 3];
    }
    return geo;
}

static void set_geo_unit(struct tiff_planes *p, struct geo geo) {
    snprintf(p->unit, sizeof p->unit, "%s",
             geo.model == 2                                              ? "degrees"
             : geo.model == 1 && geo.linear == 9002                      ? "ft"
             : geo.model == 1 && (geo.linear == 0 || geo.linear == 9001) ? "m"
                                                                         : "");
}

/* A matrix from columns, rows and slices to the world, of 4 rows. Without a step of slices they lie
 * along z. */
static bool read_matrix(struct tiff_planes *p, const struct tiff_file *t,
                        const struct tiff_page *page, struct geo geo) {
    const double centre = geo.raster == 2 ? 0 : 0.5; /* of a pixel, from its corner */
    double m[16];
    if (tiff_tag_numbers(t, page, TAG_TRANSFORMATION, m, 16) != 16)
        return false;
    for (int i = 0; i < 12; i++)
        if (!isfinite(m[i]))
            return false;
    if (m[12] != 0 || m[13] != 0 || m[14] != 0 || m[15] != 1)
        return false;
    const bool is_flat = m[2] == 0 && m[6] == 0 && m[10] == 0;
    double spacing[3], direction[3][3];
    for (int a = 0; a < 3; a++)
        spacing[a] = is_flat && a == 2 ? 1 : hypot(hypot(m[a], m[4 + a]), m[8 + a]);
    for (int a = 0; a < 3; a++)
        for (int to = 0; to < 3; to++)
            direction[to][a] = is_flat && a == 2 ? to == 2 : m[4 * to + a] / spacing[a];
    if (!(spacing[0] > 0) || !(spacing[1] > 0) || !(spacing[2] > 0))
        return false;
    memcpy(p->direction, direction, sizeof direction);
    for (int a = 0; a < 3; a++) {
        p->spacing[a] = is_flat && a == 2 ? 0 : spacing[a];
        p->origin[a] = m[4 * a + 3] + centre * (m[4 * a] + m[4 * a + 1]);
    }
    p->has_place = true;
    return true;
}

/* The size of a pixel, and the place of one. Rows go to the south. */
static bool read_scale(struct tiff_planes *p, const struct tiff_file *t,
                       const struct tiff_page *page, struct geo geo) {
    const double centre = geo.raster == 2 ? 0 : 0.5;
    double scale[3] = { 0 }, tie[6] = { 0 };
    if (tiff_tag_numbers(t, page, TAG_PIXEL_SCALE, scale, 3) < 2 || !(scale[0] > 0) ||
        !(scale[1] > 0) || !isfinite(scale[0]) || !isfinite(scale[1]))
        return false;
    for (int a = 0; a < 3; a++)
        p->spacing[a] = scale[a] > 0 && isfinite(scale[a]) ? scale[a] : 0;
    if (tiff_tag_numbers(t, page, TAG_TIEPOINT, tie, 6) != 6 || !isfinite(tie[3]) ||
        !isfinite(tie[4]))
        return true;
    p->has_place = true;
    p->origin[0] = tie[3] + (centre - tie[0]) * scale[0];
    p->origin[1] = tie[4] - (centre - tie[1]) * scale[1];
    p->origin[2] = isfinite(tie[5]) ? tie[5] : 0;
    memset(p->direction, 0, sizeof p->direction);
    p->direction[0][0] = p->direction[2][2] = 1;
    p->direction[1][1] = -1;
    return true;
}

/* A scale or a matrix that cannot be used, or control points, leave the image without a place. */
static void warn_of_geography(const struct tiff_file *t, const struct tiff_page *page) {
    struct tiff_tag tag;
    if (tiff_tag_find(t, page, TAG_TRANSFORMATION, &tag))
        import_warn(t->file->warnings,
                    "The ModelTransformation of GeoTIFF is not a matrix of 16 finite numbers that "
                    "is affine; the image is not placed on the map.");
    else if (tiff_tag_find(t, page, TAG_PIXEL_SCALE, &tag))
        import_warn(t->file->warnings,
                    "The ModelPixelScale of GeoTIFF does not have two numbers above 0; the image "
                    "is not placed on the map.");
    else if (tiff_tag_find(t, page, TAG_TIEPOINT, &tag))
        import_warn(t->file->warnings,
                    "The image has %" PRIu64 " control points (ModelTiepoint) and no scale. They "
                    "are not applied: the image is not placed on the map. Warp it with gdalwarp.",
                    tag.count / 6);
}

static bool read_geography(struct tiff_planes *p, const struct tiff_file *t,
                           const struct tiff_page *page) {
    const struct geo geo = read_geo_keys(t, page);
    if (!read_scale(p, t, page, geo) && !read_matrix(p, t, page, geo)) {
        warn_of_geography(t, page);
        return false;
    }
    set_geo_unit(p, geo);
    return true;
}

/* The number that GDAL writes where there is no sample. */
static void read_missing(struct tiff_planes *p, const struct tiff_file *t,
                         const struct tiff_page *page) {
    struct tiff_tag tag;
    if (!tiff_tag_find(t, page, TAG_NO_DATA, &tag))
        return;
    char *text = tiff_tag_text(t, page, TAG_NO_DATA), *end = text;
    if (text)
        p->missing = strtod(text, &end);
    p->has_missing = end > text && isfinite(p->missing);
    free(text);
}

/* Aperio writes "|MPP = 0.499": micrometres per pixel. */
static void parse_slide_scale(struct tiff_planes *p, const char *description) {
    const char *scale =
        strncmp(description, "Aperio", 6) == 0 ? strstr(description, "|MPP = ") : NULL;
    const double size = scale ? strtod(scale + 7, NULL) : 0;
    if (!(size > 0) || !isfinite(size))
        return;
    p->spacing[0] = p->spacing[1] = size;
    snprintf(p->unit, sizeof p->unit, "um");
}

bool tiff_layout_parse(struct tiff_planes *p, const struct tiff_file *t, const char *description,
                       struct sp_error *err) {
    return tiff_is_imagej(description)   ? tiff_imagej_parse(p, t, description, err)
           : tiff_is_shaped(description) ? tiff_shaped_parse(p, t, description, err)
                                         : assign_pages(p, t, err);
}

/* Samples stay in the order of the file. */
static void warn_of_orientation(const struct tiff_file *t, const struct tiff_page *page) {
    double orientation = 1;
    tiff_tag_numbers(t, page, TAG_ORIENTATION, &orientation, 1);
    if (orientation >= 2 && orientation <= 8)
        import_warn(t->file->warnings,
                    "The tag Orientation is %g: the file asks viewers to mirror or turn the image. "
                    "It is drawn as stored.",
                    orientation);
}

void tiff_layout_place(struct tiff_planes *p, const struct tiff_file *t, const char *description) {
    const uint32_t n =
        p->is_hidden || p->pages[0] == TIFF_NO_PAGE ? 0 : tiff_planes_page(p, p->pages[0]);
    read_missing(p, t, &t->pages[n]);
    warn_of_orientation(t, &t->pages[n]);
    if (!(p->spacing[0] > 0) && !p->has_own_unit && !read_geography(p, t, &t->pages[n]))
        read_resolution(p, t, &t->pages[n]);
    parse_slide_scale(p, description);
}
