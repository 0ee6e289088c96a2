/* SPDX-License-Identifier: Apache-2.0
 *
 * Multi-page TIFF: each page is a slice, of one channel and one step in time if the file says so
 * (tiff_planes.h); all have one size, type and number of samples. libtiff unpacks strips and tiles;
 * the directories are read by our own code (tiff_chain.c).
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "data/import/conversion.h"
#include "data/import/module.h"
#include "data/import/tiff_bridge.h"
#include "data/import/tiff_planes.h"
#include "data/volume/volume.h"

enum {
    BAND_BYTES = 16 << 20,
    COLORS = 3,
    TAG_DESCRIPTION = 270,
    TAG_SOFTWARE = 305,
    TAG_COLORS = 320
};

struct tiff {
    const struct import_file *file;
    const struct tiff_bridge_functions *call;
    struct tiff_bridge *bridge;
    struct tiff_file pages;
    struct tiff_page page; /* a page of the volume; all have its kind */
    unsigned sample;       /* of a pixel, that is read, unless planes.split */
    unsigned channels;     /* of a pixel, as fields: samples, or the colours of a palette */
    bool are_colors;
    struct import_conversion conversion;
    uint16_t *palette;    /* owned: red, green and blue of each index; NULL = none */
    bool is_palette_wide; /* the colours have 16 bits, else 8 */
    struct tiff_planes planes;
    const uint32_t *chosen; /* the pages of the volume, one per slice */
};

/* The kind of the samples. */

/* Numbers fill the bytes of a row without gaps. */
static bool is_packed(const struct tiff_page *page) {
    return page->bits % 8 != 0;
}

static uint32_t first_page(const struct tiff *t) {
    return t->planes.is_hidden ? 0 : tiff_planes_page(&t->planes, t->planes.pages[0]);
}

static bool choose_number(const struct tiff *t, struct import_number *number,
                          struct sp_error *err) {
    enum { UNSIGNED = 1, SIGNED, FLOATING, UNDEFINED, COMPLEX_WHOLE, COMPLEX };
    const struct tiff_page *page = &t->page;
    const unsigned bits = page->bits, bytes = bits / 8;
    const bool is_size = bits == 8 || bits == 16 || bits == 32 || bits == 64;
    const bool is_unsigned = page->format == UNSIGNED || page->format == UNDEFINED;
    const bool is_complex = page->format == COMPLEX || page->format == COMPLEX_WHOLE;
    number->size = bytes;
    number->kind = is_unsigned                     ? IMPORT_UNSIGNED
                   : page->format == SIGNED        ? IMPORT_SIGNED
                   : page->format == FLOATING      ? IMPORT_FLOAT
                   : page->format == COMPLEX_WHOLE ? IMPORT_COMPLEX_SIGNED
                                                   : IMPORT_COMPLEX;
    if (bits < 16 && is_packed(page) && is_unsigned) {
        *number = import_bits_number(bits);
        return true;
    }
    if ((is_size && (is_unsigned || page->format == SIGNED)) ||
        (is_size && bits > 8 && page->format == FLOATING) ||
        ((bits == 64 || bits == 128) && is_complex) ||
        (bits == 32 && page->format == COMPLEX_WHOLE))
        return true;
    return tiff_fail(
        &t->pages, first_page(t), err, SP_ERR_UNSUPPORTED,
        "%s samples of %u bits are not supported; supported are whole numbers of 1 to "
        "15, 16, 32 and 64 bits, floating-point ones of 16, 32 and 64 and complex ones "
        "of 64 and 128",
        is_complex                 ? "complex"
        : page->format == FLOATING ? "floating-point"
        : page->format == SIGNED   ? "signed"
                                   : "unsigned",
        bits);
}

/* A palette has the reds of all indices, then the greens, then the blues, of 16 bits. */
static bool read_palette(struct tiff *t, uint32_t n, struct sp_error *err) {
    const size_t count = (size_t)1 << t->page.bits;
    double *values = malloc(COLORS * count * sizeof *values), most = 0;
    t->palette = malloc(COLORS * count * sizeof *t->palette);
    bool ok = (values && t->palette) ||
              sp_fail(err, SP_ERR_MEMORY, t->file->title, "out of memory for a palette");
    if (ok &&
        tiff_tag_numbers(&t->pages, &t->page, TAG_COLORS, values, COLORS * count) != COLORS * count)
        ok = tiff_fail(&t->pages, n, err, SP_ERR_FORMAT,
                       "the palette of the page does not have %zu colours", count);
    for (size_t i = 0; ok && i < COLORS * count; i++)
        most = fmax(most, values[i]);
    /* Old programs write 8 bits; others write 8 bits twice, or in the upper byte. */
    for (size_t i = 0; ok && most > 255 && i < COLORS * count; i++)
        t->is_palette_wide |= fmod(values[i], 256) != 0 && fmod(values[i], 257) != 0;
    const double unit = most > 255 && !t->is_palette_wide ? 256 : 1;
    for (size_t i = 0; ok && i < COLORS * count; i++)
        t->palette[i % count * COLORS + i / count] =
            (uint16_t)fmin(fmax(values[i] / unit, 0), UINT16_MAX);
    free(values);
    return ok;
}

/* If 0 is white in the image, the brightness is the largest number less the number. */
static void invert(struct tiff *t) {
    const double most = ldexp(1, (int)t->page.bits) - 1;
    t->conversion.slope = -1;
    t->conversion.offset = most;
    import_conversion_choose(&t->conversion, 0, most);
    import_warn(t->file->warnings,
                "0 is white in this image (MinIsWhite); its numbers were inverted.");
}

static void scale(struct tiff *t) {
    const double slope = t->planes.slope;
    double low, high;
    import_number_range(t->conversion.number, &low, &high);
    if (is_packed(&t->page))
        high = ldexp(1, (int)t->page.bits) - 1;
    t->conversion.slope *= slope;
    t->conversion.offset = slope * t->conversion.offset + t->planes.offset;
    import_conversion_choose(&t->conversion, low, high);
}

/* libtiff ignores a predictor where the codec is not to have one, but some programs use it there.
 */
static bool has_stray_predictor(const struct tiff *t) {
    enum { TAG_PREDICTOR = 317 };
    static const unsigned codecs[] = { 5, 8, 32946, 34925, 50000 }; /* LZW, deflate, LZMA, zstd */
    double predictor = 1;
    tiff_tag_numbers(&t->pages, &t->page, TAG_PREDICTOR, &predictor, 1);
    for (size_t i = 0; i < sizeof codecs / sizeof *codecs; i++)
        if (codecs[i] == t->page.compression)
            return false;
    return predictor != 1 && t->page.compression != TIFF_UNPACKED;
}

static bool choose_type(struct tiff *t, struct import_header *header, struct sp_error *err) {
    const struct tiff_page *page = &t->page;
    const uint32_t n = first_page(t);
    struct import_number number;
    if ((page->photometric == TIFF_YCBCR && page->compression != TIFF_JPEG) ||
        page->compression == TIFF_OLD_JPEG)
        return tiff_fail(&t->pages, n, err, SP_ERR_UNSUPPORTED,
                         "YCbCr colours are supported with JPEG (compression 7) only; save the "
                         "image as RGB");
    if (page->compression == TIFF_JPEG && page->bits != 8)
        return tiff_fail(&t->pages, n, err, SP_ERR_UNSUPPORTED,
                         "JPEG with %u bits is not supported, only with 8; save the image with "
                         "deflate or LZW",
                         page->bits);
    if (has_stray_predictor(t))
        return tiff_fail(&t->pages, n, err, SP_ERR_UNSUPPORTED,
                         "a predictor is not supported with compression %u; save the image with "
                         "deflate or LZW",
                         page->compression);
    if (!choose_number(t, &number, err))
        return false;
    const bool has_palette = page->photometric == TIFF_PALETTE && !t->planes.are_indices &&
                             page->samples == 1 && number.kind == IMPORT_UNSIGNED &&
                             page->bits <= 16;
    if (has_palette && !read_palette(t, n, err))
        return false;
    if (has_palette)
        number = (struct import_number){ IMPORT_UNSIGNED, t->is_palette_wide ? 2 : 1 };
    t->conversion = import_conversion_of(number, t->file->warnings);
    t->channels = has_palette ? COLORS : t->planes.split ? 1 : page->samples;
    t->are_colors = has_palette ||
                    ((page->photometric == TIFF_RGB || page->photometric == TIFF_YCBCR) &&
                     !t->planes.are_channels && t->channels >= COLORS && t->channels <= COLORS + 1);
    if (page->photometric == TIFF_MIN_IS_WHITE && number.kind == IMPORT_UNSIGNED &&
        !t->planes.are_plain)
        invert(t);
    if (t->planes.has_scale && t->channels == 1 && import_number_is_whole(number))
        scale(t);
    if (t->planes.has_missing && t->channels == 1)
        import_conversion_add_missing(&t->conversion, t->planes.missing);
    t->conversion.components = has_palette ? COLORS : page->planes == 1 ? page->samples : 1;
    header->type = t->conversion.type;
    header->bits = !has_palette ? page->bits : t->is_palette_wide ? 16 : 8;
    return true;
}

/* The pages of the volume. */

static bool same_page(const struct tiff_page *a, const struct tiff_page *b) {
    return a->width == b->width && a->height == b->height && a->samples == b->samples &&
           a->planes == b->planes && a->bits == b->bits && a->format == b->format &&
           a->photometric == b->photometric;
}

static bool check_pages(const struct tiff *t, struct sp_error *err) {
    const struct tiff_page *first = &t->page;
    uint32_t missing = 0;
    for (uint32_t k = 0; k < t->planes.slices && !t->planes.is_hidden; k++) {
        const uint32_t n = tiff_planes_page(&t->planes, t->chosen[k]);
        missing += n == TIFF_NO_PAGE;
        if (n == TIFF_NO_PAGE)
            continue;
        const struct tiff_page *page = &t->pages.pages[n];
        if (!same_page(first, page))
            return tiff_fail(&t->pages, n, err, SP_ERR_UNSUPPORTED,
                             "%" PRIu32 " x %" PRIu32
                             " px of %u samples and %u bits, but the first "
                             "page of the volume has %" PRIu32 " x %" PRIu32
                             ", %u and %u, or another layout; save the pages in one way",
                             page->width, page->height, page->samples, page->bits, first->width,
                             first->height, first->samples, first->bits);
    }
    if (missing > 0)
        import_warn(t->file->warnings,
                    "%" PRIu32 " of %" PRIu32 " slices are not in the file; they are 0.", missing,
                    t->planes.slices);
    return missing < t->planes.slices || tiff_fail(&t->pages, 0, err, SP_ERR_FORMAT,
                                                   "the file has no page of this channel and step");
}

/* The name of field n: of a channel with pages of its own, or of one within the pages. */
static void name_field(const struct tiff *t, uint32_t n, char name[SP_FIELD_BYTES]) {
    const struct tiff_planes *p = &t->planes;
    const uint32_t channel = n / t->channels;
    bool is_alone = p->names && p->names[channel][0] && t->channels == 1;
    for (uint32_t i = 0; is_alone && i < channel; i++)
        is_alone = strcmp(p->names[i], p->names[channel]) != 0;
    if (is_alone)
        import_name(name, p->names[channel]);
    else
        snprintf(name, SP_FIELD_BYTES, "channel %" PRIu32, n + 1);
    if (p->channels * t->channels == 1 && !is_alone)
        name[0] = 0;
}

/* Chooses the channel and the step, and with them the pages. */
static bool choose(struct tiff *t, struct import_header *header, struct sp_error *err) {
    const struct tiff_planes *p = &t->planes;
    const uint32_t count = p->channels * t->channels;
    char name[SP_FIELD_BYTES];
    uint32_t chosen = 0;
    if (!import_header_use_steps(header, t->file, p->steps, err))
        return false;
    if (p->steps > 1 && p->times) {
        header->steps.times = p->times;
        memcpy(header->steps.unit, p->time_unit, sizeof header->steps.unit);
    } else if (p->steps > 1) {
        import_header_use_interval(header, 0, p->interval, p->time_unit);
    }
    if (p->channels == 1 && t->are_colors) {
        chosen = import_header_choose_component(header, t->file->field, t->channels, true);
    } else {
        for (uint32_t n = 0; n < count && *t->file->field; n++) {
            name_field(t, n, name);
            if (strcmp(name, t->file->field) == 0)
                chosen = n;
        }
        name_field(t, chosen, header->value_name);
        for (uint32_t n = 0; n < count && n < SP_OTHER_FIELDS_MAX + 2; n++) {
            name_field(t, n, name);
            if (n != chosen)
                import_header_add_other(header, name);
        }
    }
    t->sample = chosen % t->channels;
    t->chosen = p->pages + ((size_t)t->file->step * p->channels + chosen / t->channels) * p->slices;
    return true;
}

/* Sets the place of the grid. Without a distance of slices, they are as far apart as columns. */
static void set_place(const struct tiff *t, struct import_header *header) {
    const struct tiff_planes *p = &t->planes;
    struct sp_grid *grid = &header->grid;
    for (int a = 0; a < 3; a++) {
        if (p->spacing[a] > 0 && isfinite(p->spacing[a]))
            grid->spacing[a] = p->spacing[a];
        else if (a > 0 && p->spacing[0] > 0 && isfinite(p->spacing[0]))
            grid->spacing[a] = p->spacing[0];
        if (p->has_place) {
            grid->origin[a] = p->origin[a];
            memcpy(grid->direction[a], p->direction[a], sizeof p->direction[a]);
        }
    }
    header->lacks_distance = *p->unit && p->spacing[0] > 0 && !(p->spacing[2] > 0);
    memcpy(header->unit, p->unit, sizeof header->unit);
    memcpy(header->value_unit, p->value_unit, sizeof header->value_unit);
    if (p->slices > 1)
        import_warn_distance(header, t->file->warnings);
}

static void close_tiff(void *reader) {
    struct tiff *t = reader;
    if (t->bridge)
        t->call->close(t->bridge);
    tiff_planes_finish(&t->planes);
    tiff_file_close(&t->pages);
    free(t->palette);
}

static bool arrange_pages(struct tiff *t, const char *description, struct import_header *header,
                          struct sp_error *err) {
    struct tiff_planes *p = &t->planes;
    const bool ok = tiff_is_ome(description)
                        ? tiff_ome_parse(p, t->file, description, strlen(description),
                                         t->pages.count, t->pages.pages[0].samples, err)
                        : tiff_layout_parse(p, &t->pages, description, err);
    if (!ok)
        return false;
    p->are_indices |= tiff_is_ome(description) || tiff_is_shaped(description);
    tiff_layout_place(p, &t->pages, description);
    uint64_t first = 0; /* some planes may be missing */
    const uint64_t count = (uint64_t)p->slices * p->channels * p->steps;
    while (first < count && p->pages[first] == TIFF_NO_PAGE)
        first++;
    t->page =
        t->pages.pages[p->is_hidden || first == count ? 0 : tiff_planes_page(p, p->pages[first])];
    if (t->page.width > SP_DIM_MAX || t->page.height > SP_DIM_MAX)
        return tiff_fail(&t->pages, 0, err, SP_ERR_UNSUPPORTED,
                         "%" PRIu32 " x %" PRIu32 " px; at most %u along an axis are supported",
                         t->page.width, t->page.height, SP_DIM_MAX);
    if (!choose_type(t, header, err) ||
        !tiff_planes_choose(p, t->file, t->channels, &t->are_colors, header, err) ||
        !choose(t, header, err) || !check_pages(t, err))
        return false;
    header->grid.dims[0] = t->page.width;
    header->grid.dims[1] = t->page.height;
    header->grid.dims[2] = p->slices;
    set_place(t, header);
    return sp_grid_check(&header->grid, header->type, t->file->title, &header->bytes, err);
}

/* Programs that call every bilevel image MinIsWhite, and mean the numbers as they are. */
static bool are_plain(const struct tiff *t, const char *description, const char *software) {
    return t->pages.pages[0].bits == 1 &&
           (tiff_is_shaped(description) || strncmp(software, "tifffile", 8) == 0);
}

static bool open_tiff(void *reader, const struct import_file *file, struct import_header *header,
                      struct sp_error *err) {
    struct tiff *t = reader;
    t->file = file;
    struct sp_error why;
    if (!tiff_file_open(&t->pages, t->file, err))
        return false;
    char *description = tiff_tag_text(&t->pages, &t->pages.pages[0], TAG_DESCRIPTION);
    char *software = tiff_tag_text(&t->pages, &t->pages.pages[0], TAG_SOFTWARE);
    bool ok = (description && software) ||
              sp_fail(err, SP_ERR_MEMORY, t->file->title, "out of memory for the description");
    if (ok)
        t->planes.are_plain = are_plain(t, description, software);
    ok = ok && arrange_pages(t, description, header, err);
    free(description);
    free(software);
    if (!ok || !(t->call = import_module_load(t->file, TIFF_BRIDGE_MODULE, TIFF_BRIDGE_SYMBOL,
                                              "libtiff", "libtiff6", err)))
        return false;
    t->bridge = t->call->open(t->file->fd, &why);
    return t->bridge || tiff_fail(&t->pages, 0, err, why.code, "%s", why.text);
}

/* Reading. */

struct reading {
    const struct tiff *tiff;
    struct import_conversion conversion; /* of the plane that is read */
    unsigned plane;                      /* of its page */
    size_t row_bytes;                    /* in the file */
    size_t row_numbers;                  /* per row of a plane */
    uint8_t *rows;                       /* owned: a band of rows as in the file */
    void *numbers;                       /* owned: the numbers of a row; NULL = in `rows` */
    char *out;                           /* the samples of a page */
    struct sp_error *err;
};

/* Reads rows of a plane that has no directory. */
static bool read_hidden(const struct reading *r, uint32_t n, uint32_t first, uint32_t count) {
    const struct tiff *t = r->tiff;
    const struct tiff_page *page = &t->page;
    const uint64_t plane_bytes = (uint64_t)page->height * r->row_bytes;
    const uint64_t at = page->pixels_at + ((uint64_t)n * page->planes + r->plane) * plane_bytes +
                        (uint64_t)first * r->row_bytes;
    const size_t size = count * r->row_bytes;
    for (size_t done = 0; done < size;) {
        const ssize_t got = pread(t->file->fd, r->rows + done, size - done, (off_t)(at + done));
        if (got <= 0)
            return import_fail(
                r->err, SP_ERR_IO, t->file->title, at + done, NULL,
                "cannot read the pixels: the file became shorter, or its disk or network fails");
        done += (size_t)got;
    }
    if (t->pages.is_big_endian != (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__) && !is_packed(page))
        import_swap_numbers(r->rows, t->conversion.number, size / t->conversion.number.size);
    return true;
}

/* Replaces indices by colours. */
static void look_up(const struct reading *r, const void *indices, bool are_wide, void *out) {
    const size_t count = (size_t)1 << r->tiff->page.bits;
    const bool is_wide = r->tiff->is_palette_wide;
    for (size_t i = 0; i < r->row_numbers; i++) {
        const size_t index =
            are_wide ? ((const uint16_t *)indices)[i] : ((const uint8_t *)indices)[i];
        const uint16_t *color = r->tiff->palette + (index < count ? index : 0) * COLORS;
        for (size_t c = 0; c < COLORS && is_wide; c++)
            ((uint16_t *)out)[i * COLORS + c] = color[c];
        for (size_t c = 0; c < COLORS && !is_wide; c++)
            ((uint8_t *)out)[i * COLORS + c] = (uint8_t)color[c];
    }
}

static void put_row(const struct reading *r, const uint8_t *row, uint32_t y, uint8_t *indices) {
    const struct tiff *t = r->tiff;
    const size_t at = (size_t)y * t->page.width * sp_type_size(t->conversion.type);
    const void *numbers = row;
    if (is_packed(&t->page)) {
        import_bits_unpack(row, t->page.bits, true, 0, r->row_numbers,
                           t->palette ? indices : r->numbers);
        numbers = t->palette ? indices : r->numbers;
    }
    if (t->palette) {
        look_up(r, numbers, t->page.bits > 8, r->numbers);
        numbers = r->numbers;
    }
    import_conversion_put(&r->conversion, numbers, t->page.width, r->out + at);
}

/* Reads an entry of planes.pages. */
static bool read_page(struct reading *r, uint32_t entry, uint32_t band, uint8_t *indices) {
    const struct tiff *t = r->tiff;
    const uint32_t n = tiff_planes_page(&t->planes, entry);
    const unsigned sample = t->planes.split ? entry % t->planes.split : t->sample;
    struct sp_error why;
    r->plane = t->page.planes > 1 ? sample : 0;
    r->conversion.component = r->conversion.components > 1 ? sample : 0;
    for (uint32_t y = 0; y < t->page.height; y += band) {
        const uint32_t left = t->page.height - y, count = left < band ? left : band;
        if (t->planes.is_hidden) {
            if (!read_hidden(r, n, y, count))
                return false;
        } else if (!t->call->rows(t->bridge, t->pages.pages[n].at, r->plane, y, count, r->row_bytes,
                                  r->rows, &why)) {
            return tiff_fail(&t->pages, n, r->err, why.code, "%s", why.text);
        }
        for (uint32_t row = 0; row < count; row++)
            put_row(r, r->rows + row * r->row_bytes, y + row, indices);
    }
    return true;
}

static const struct tiff_page *page_of(const struct tiff *t, uint32_t k) {
    return &t->pages.pages[tiff_planes_page(&t->planes, t->chosen[k])];
}

/* How many rows are read at once: whole strips or tiles of all pages. */
static uint32_t band_of(const struct tiff *t, size_t row_bytes) {
    uint64_t most = 1;
    for (uint32_t k = 0; k < t->planes.slices && !t->planes.is_hidden; k++)
        if (t->chosen[k] != TIFF_NO_PAGE && page_of(t, k)->piece_rows > most)
            most = page_of(t, k)->piece_rows;
    const uint64_t fit = BAND_BYTES / row_bytes;
    uint64_t rows = fit > most ? fit - fit % most : most;
    for (uint32_t k = 0; k < t->planes.slices && !t->planes.is_hidden; k++)
        if (t->chosen[k] != TIFF_NO_PAGE && rows % page_of(t, k)->piece_rows != 0)
            rows = t->page.height;
    return rows < t->page.height ? (uint32_t)rows : t->page.height;
}

static bool read_pages(struct reading *r, uint8_t *indices, char *voxels,
                       const struct import_progress *progress) {
    const struct tiff *t = r->tiff;
    const uint32_t band = band_of(t, r->row_bytes);
    const size_t bytes = (size_t)t->page.width * t->page.height * sp_type_size(t->conversion.type);
    if (!(r->rows = malloc(band * r->row_bytes)))
        return sp_fail(r->err, SP_ERR_MEMORY, t->file->title,
                       "out of memory for %" PRIu32 " rows of %zu bytes", band, r->row_bytes);
    for (uint32_t k = 0; k < t->planes.slices; k++) {
        r->out = voxels + k * bytes;
        if (t->chosen[k] == TIFF_NO_PAGE)
            memset(r->out, 0, bytes);
        else if (!read_page(r, t->chosen[k], band, indices))
            return false;
        import_report(progress, (k + 1) * bytes);
    }
    return true;
}

static bool read_tiff(void *reader, void *voxels, float (*vectors)[3],
                      const struct import_progress *progress, struct sp_error *err) {
    const struct tiff *t = reader;
    struct reading r = { .tiff = t,
                         .conversion = t->conversion,
                         .row_bytes = (size_t)tiff_row_bytes(&t->page),
                         .row_numbers = (size_t)t->page.width * (t->page.samples / t->page.planes),
                         .err = err };
    (void)vectors; /* a TIFF has none */
    r.numbers = malloc(r.row_numbers * (t->palette ? COLORS * sizeof(uint16_t) : sizeof(uint32_t)));
    uint8_t *indices = malloc(r.row_numbers * sizeof(uint16_t));
    const bool ok = (r.numbers && indices) ||
                    sp_fail(err, SP_ERR_MEMORY, t->file->title, "out of memory for a row");
    const bool done = ok && read_pages(&r, indices, voxels, progress);
    free(r.rows);
    free(r.numbers);
    free(indices);
    return done;
}

static bool probe_tiff(const uint8_t *start, size_t size, const char *title) {
    (void)title;
    return size >= 4 && (memcmp(start, "II*\0", 4) == 0 || memcmp(start, "MM\0*", 4) == 0 ||
                         memcmp(start, "II+\0", 4) == 0 || memcmp(start, "MM\0+", 4) == 0);
}

const struct import_format import_tiff = { .name = "TIFF",
                                           .needs_module = true,
                                           .probe = probe_tiff,
                                           .reader_size = sizeof(struct tiff),
                                           .open = open_tiff,
                                           .read = read_tiff,
                                           .close = close_tiff };
