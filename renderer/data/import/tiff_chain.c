/* SPDX-License-Identifier: Apache-2.0
 *
 * Field numbers and types: TIFF 6.0 (Adobe, 1992); BigTIFF: entries of 20 bytes, words of 8.
 *
 * Why this parser is our own: parsers.md.
 */
#include "base/grow.h"
#include "data/import/tiff_file.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum field {
    SUBFILE,
    OLD_SUBFILE,
    WIDTH,
    HEIGHT,
    BITS,
    COMPRESSION,
    PHOTOMETRIC,
    STRIP_OFFSETS,
    SAMPLES,
    ROWS,
    STRIP_COUNTS,
    PLANAR,
    TILE_WIDTH,
    TILE_LENGTH,
    TILE_OFFSETS,
    TILE_COUNTS,
    FORMAT,
    IMAGE_DEPTH,
    TILE_DEPTH,
    FIELD_COUNT
};

static const struct {
    unsigned tag;
    const char *name;
} fields[FIELD_COUNT] = {
    [SUBFILE] = { 254, "NewSubfileType" },
    [OLD_SUBFILE] = { 255, "SubfileType" },
    [WIDTH] = { 256, "ImageWidth" },
    [HEIGHT] = { 257, "ImageLength" },
    [BITS] = { 258, "BitsPerSample" },
    [COMPRESSION] = { 259, "Compression" },
    [PHOTOMETRIC] = { 262, "PhotometricInterpretation" },
    [STRIP_OFFSETS] = { 273, "StripOffsets" },
    [SAMPLES] = { 277, "SamplesPerPixel" },
    [ROWS] = { 278, "RowsPerStrip" },
    [STRIP_COUNTS] = { 279, "StripByteCounts" },
    [PLANAR] = { 284, "PlanarConfiguration" },
    [TILE_WIDTH] = { 322, "TileWidth" },
    [TILE_LENGTH] = { 323, "TileLength" },
    [TILE_OFFSETS] = { 324, "TileOffsets" },
    [TILE_COUNTS] = { 325, "TileByteCounts" },
    [FORMAT] = { 339, "SampleFormat" },
    [IMAGE_DEPTH] = { 32997, "ImageDepth" },
    [TILE_DEPTH] = { 32998, "TileDepth" },
};

enum { BUFFER_BYTES = 4096 }; /* bytes; a multiple of the size of every number type */

struct entry {
    uint64_t at;     /* offset of the entry; 0 = the page does not have it */
    uint64_t values; /* offset of the numbers */
    uint64_t count;
    unsigned bytes;               /* per number */
    uint64_t held_at;             /* offset of the first byte in the buffer */
    unsigned held;                /* bytes in the buffer */
    uint8_t buffer[BUFFER_BYTES]; /* part of the numbers */
};

struct chain {
    const struct import_file *file;
    struct sp_error *err;
    bool big_endian, big;
    uint32_t page;
    uint64_t page_at;
    /* Sums over all pages so far. No byte of a TIFF belongs to two pages, so the file size bounds
     * the first two sums; a circle of pages or shared strips exceeds it. */
    uint64_t directory_bytes, piece_bytes, voxels;
    uint64_t next_piece; /* where the strip after the last one must begin; 0 = they have gaps */
    struct entry entries[FIELD_COUNT];
};

static uint64_t decode(const uint8_t *b, unsigned bytes, bool big_endian) {
    uint64_t out = 0;
    for (unsigned i = 0; i < bytes; i++)
        out |= (uint64_t)b[big_endian ? bytes - 1 - i : i] << (8 * i);
    return out;
}

static bool read_number(const struct chain *c, uint64_t at, unsigned bytes, uint64_t *out) {
    uint8_t b[8];
    *out = 0;
    if (at > INT64_MAX - 8 || pread(c->file->fd, b, bytes, (off_t)at) != (ssize_t)bytes)
        return false;
    *out = decode(b, bytes, c->big_endian);
    return true;
}

__attribute__((format(printf, 5, 6))) static bool refuse(const struct chain *c, enum sp_code code,
                                                         uint64_t at, enum field f,
                                                         const char *format, ...) {
    char place[SP_ERROR_PLACE], text[SP_ERROR_TEXT];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    snprintf(place, sizeof place, "%.160s: page %" PRIu32 ": byte %" PRIu64 ": %s", c->file->title,
             c->page, at, fields[f].name);
    return sp_fail(c->err, code, place, "%s", text);
}

/* Reads number i of an entry; i must be below its count. */
static bool number_at(struct chain *c, enum field f, uint64_t i, uint64_t *out) {
    struct entry *e = &c->entries[f];
    uint64_t at = e->values + i * e->bytes;
    if (at < e->held_at || at + e->bytes > e->held_at + e->held) {
        uint64_t left = (e->count - i) * e->bytes;
        size_t want = left < BUFFER_BYTES ? (size_t)left : BUFFER_BYTES;
        ssize_t got = pread(c->file->fd, e->buffer, want, (off_t)at);
        if (got < (ssize_t)e->bytes)
            return refuse(c, SP_ERR_FORMAT, at, f,
                          "number %" PRIu64 " lies beyond the end of the file", i);
        e->held_at = at;
        e->held = (unsigned)got;
    }
    *out = decode(e->buffer + (at - e->held_at), e->bytes, c->big_endian);
    return true;
}

static bool decode_entry(struct chain *c, uint64_t at, const uint8_t *b, enum field f) {
    static const uint8_t sizes[] = { [1] = 1, [3] = 2, [4] = 4, [16] = 8 };
    struct entry *e = &c->entries[f];
    uint64_t type = decode(b + 2, 2, c->big_endian), size = c->file->size;
    unsigned word = c->big ? 8 : 4;
    if (e->at)
        return refuse(c, SP_ERR_FORMAT, at, f, "occurs twice");
    e->at = at;
    e->held = 0;
    e->bytes = type < sizeof sizes ? sizes[type] : 0;
    e->count = decode(b + 4, word, c->big_endian);
    e->values = at + 4 + word;
    if (e->bytes == 0)
        return refuse(c, SP_ERR_FORMAT, at, f,
                      "is of type %" PRIu64 "; whole numbers are of type 1, 3, 4 or 16", type);
    if (e->count == 0)
        return refuse(c, SP_ERR_FORMAT, at, f, "has no number");
    if (e->count > word / e->bytes)
        e->values = decode(b + 4 + word, word, c->big_endian);
    if (e->count > size / e->bytes || e->values > size - e->count * e->bytes)
        return refuse(c, SP_ERR_FORMAT, at, f,
                      "%" PRIu64 " numbers at byte %" PRIu64 " lie beyond the end of the file of "
                      "%" PRIu64 " bytes: it is cut off or the directory is wrong",
                      e->count, e->values, size);
    return true;
}

static bool read_entries(struct chain *c, uint64_t first, uint64_t count) {
    uint8_t buffer[20 * 64];
    size_t bytes = c->big ? 20 : 12;
    for (int f = 0; f < FIELD_COUNT; f++)
        c->entries[f].at = 0;
    for (uint64_t i = 0; i < count; i++) {
        uint64_t at = first + i * bytes;
        size_t n = (size_t)(count - i < 64 ? count - i : 64) * bytes;
        if (i % 64 == 0 && pread(c->file->fd, buffer, n, (off_t)at) != (ssize_t)n)
            return import_fail(
                c->err, SP_ERR_IO, c->file->title, at, "directory",
                "cannot read the file: the file became shorter, or its disk or network fails");
        const uint8_t *b = buffer + i % 64 * bytes;
        unsigned tag = (unsigned)decode(b, 2, c->big_endian);
        for (int f = 0; f < FIELD_COUNT; f++)
            if (fields[f].tag == tag && !decode_entry(c, at, b, (enum field)f))
                return false;
    }
    return true;
}

/* Reads the first number of a field; `missing` if the page does not have the field. */
static bool read_field(struct chain *c, enum field f, uint64_t missing, uint64_t low, uint64_t high,
                       uint64_t *out) {
    *out = missing;
    if (c->entries[f].at && !number_at(c, f, 0, out))
        return false;
    if (*out < low || *out > high)
        return c->entries[f].at
                   ? refuse(c, SP_ERR_FORMAT, c->entries[f].at, f,
                            "is %" PRIu64 ", outside [%" PRIu64 ", %" PRIu64 "]", *out, low, high)
                   : refuse(c, SP_ERR_FORMAT, c->page_at, f, "the page does not have this field");
    return true;
}

/* The best compression ratio of a codec: bytes that one stored byte can become. */
static uint64_t best_ratio(uint64_t compression) {
    switch (compression) {
    case 1:
        return 1;
    case 5: /* LZW: a 12-bit code for the longest string of the table */
        return 4096;
    case 8: /* deflate: 258 bytes from two codes of one bit */
    case 32946:
        return 1032;
    case 32773: /* PackBits: 128 bytes from two */
        return 128;
    default: /* some codecs store a tile of one value in a few bytes */
        return UINT64_C(1) << 20;
    }
}

struct pieces { /* strips or tiles of a page */
    const char *name;
    enum field offsets, counts;
    uint64_t number, per_plane;       /* of all planes of channels, and of each */
    uint64_t rows, height, row_bytes; /* rows: per piece; the last strip has the remaining rows */
    uint64_t compression;
};

static bool check_piece(struct chain *c, const struct pieces *p, uint64_t i) {
    uint64_t offset, count, size = c->file->size, ratio = best_ratio(p->compression);
    if (!number_at(c, p->offsets, i, &offset) || !number_at(c, p->counts, i, &count))
        return false;
    uint64_t offset_at = c->entries[p->offsets].values + i * c->entries[p->offsets].bytes;
    uint64_t count_at = c->entries[p->counts].values + i * c->entries[p->counts].bytes;
    uint64_t rows = p->rows, need;
    const uint64_t above = i % p->per_plane * p->rows;
    if (p->offsets == STRIP_OFFSETS && p->height - above < rows)
        rows = p->height - above;
    need = rows * p->row_bytes;
    if (count == 0 && offset == 0) { /* not written: its samples are 0 */
        c->next_piece = 0;
        return true;
    }
    if (count > size || offset > size - count)
        return refuse(c, SP_ERR_FORMAT, offset_at, p->offsets,
                      "%s %" PRIu64 " has %" PRIu64 " bytes at byte %" PRIu64
                      ", the file has %" PRIu64 ": it is cut off or the directory is wrong",
                      p->name, i, count, offset, size);
    if (count == 0 || need / ratio > count)
        return ratio == 1 ? refuse(c, SP_ERR_FORMAT, count_at, p->counts,
                                   "%s %" PRIu64 " has %" PRIu64 " bytes, its samples need %" PRIu64
                                   ": the size of the page or this number is wrong",
                                   p->name, i, count, need)
                          : refuse(c, SP_ERR_FORMAT, count_at, p->counts,
                                   "%" PRIu64 " bytes cannot come out of the %" PRIu64
                                   " of %s %" PRIu64 " (compression %" PRIu64
                                   "): the size of the page or this number is wrong",
                                   need, count, p->name, i, p->compression);
    c->piece_bytes += ratio == 1 ? need : count; /* bytes after the samples do not matter */
    c->next_piece = ratio == 1 && (i == 0 || offset == c->next_piece) ? offset + need : 0;
    if (c->piece_bytes > size)
        return refuse(c, SP_ERR_FORMAT, offset_at, p->offsets,
                      "%ss up to number %" PRIu64 " have %" PRIu64
                      " bytes together, the file has %" PRIu64 ": they overlap",
                      p->name, i, c->piece_bytes, size);
    return true;
}

static bool check_pieces(struct chain *c, const struct pieces *p) {
    const enum field both[] = { p->offsets, p->counts };
    for (int i = 0; i < 2; i++) {
        const struct entry *e = &c->entries[both[i]];
        if (!e->at)
            return refuse(c, SP_ERR_FORMAT, c->page_at, both[i],
                          "the page does not have this field");
        if (e->count < p->number)
            return refuse(c, SP_ERR_FORMAT, e->at, both[i],
                          "has %" PRIu64 " numbers, the page has %" PRIu64 " %ss", e->count,
                          p->number, p->name);
    }
    for (uint64_t i = 0; i < p->number; i++)
        if (!check_piece(c, p, i))
            return false;
    return true;
}

/* Reads how many channels a pixel has (`samples`), and in how many planes they are stored
 * (`planes`): 1 if the channels of a pixel lie side by side. */
static bool check_flat(struct chain *c, uint64_t *samples, uint64_t *planes) {
    uint64_t depth, planar;
    for (int f = IMAGE_DEPTH; f <= TILE_DEPTH; f++) {
        if (!read_field(c, (enum field)f, 1, 0, UINT64_MAX, &depth))
            return false;
        if (depth > 1)
            return refuse(c, SP_ERR_UNSUPPORTED, c->entries[f].at, (enum field)f,
                          "page %" PRIu32 " has depth; save the slices as pages", c->page);
    }
    if (!read_field(c, SAMPLES, 1, 1, 65535, samples) || !read_field(c, PLANAR, 1, 1, 2, &planar))
        return false;
    *planes = planar == 2 ? *samples : 1;
    return *samples <= TIFF_SAMPLES_MAX ||
           refuse(c, SP_ERR_UNSUPPORTED, c->entries[SAMPLES].at, SAMPLES,
                  "%" PRIu64 " channels; at most %d are supported", *samples, TIFF_SAMPLES_MAX);
}

/* All samples of a pixel have the same number of bits. */
static bool read_bits(struct chain *c, uint64_t *bits) {
    uint64_t other = 0;
    if (!read_field(c, BITS, 1, 1, 128, bits))
        return false;
    for (uint64_t i = 1; c->entries[BITS].at && i < c->entries[BITS].count; i++) {
        if (!number_at(c, BITS, i, &other))
            return false;
        if (other != *bits)
            return refuse(c, SP_ERR_UNSUPPORTED, c->entries[BITS].at, BITS,
                          "the samples of a pixel have %" PRIu64 " and %" PRIu64
                          " bits; save them with the same number of bits",
                          *bits, other);
    }
    return true;
}

/* Reads what says how the samples are meant. */
static bool read_meaning(struct chain *c, struct tiff_page *page) {
    uint64_t subfile, old_subfile, format, photometric;
    if (!read_field(c, SUBFILE, 0, 0, UINT64_MAX, &subfile) ||
        !read_field(c, OLD_SUBFILE, 1, 0, UINT64_MAX, &old_subfile) ||
        !read_field(c, FORMAT, 1, 1, 6, &format) ||
        !read_field(c, PHOTOMETRIC, 1, 0, 65535, &photometric))
        return false;
    /* Bit 0: a reduced image; bit 2: a mask. 2 was a reduced image before TIFF 6.0. */
    page->is_reduced = (subfile & 5) || old_subfile == 2;
    page->format = (unsigned)format;
    page->photometric = (unsigned)photometric;
    return true;
}

uint64_t tiff_row_bytes(const struct tiff_page *page) {
    const uint64_t numbers = (uint64_t)page->width * (page->samples / page->planes);
    return (numbers * page->bits + 7) / 8;
}

static bool check_page(struct chain *c, struct tiff_page *page) {
    uint64_t width, height, bits, tile_width, tile_length, samples = 1, planes = 1;
    struct pieces p = { .name = "strip", .offsets = STRIP_OFFSETS, .counts = STRIP_COUNTS };
    if (!check_flat(c, &samples, &planes) || !read_field(c, WIDTH, 0, 1, INT32_MAX, &width) ||
        !read_field(c, HEIGHT, 0, 1, INT32_MAX, &height) || !read_bits(c, &bits) ||
        !read_field(c, COMPRESSION, 1, 1, UINT64_MAX, &p.compression) || !read_meaning(c, page))
        return false;
    c->voxels += width * height;
    if (c->voxels > SP_VOXELS_MAX)
        return refuse(c, SP_ERR_FORMAT, c->entries[HEIGHT].at, HEIGHT,
                      "the pages up to this one have more than %" PRIu64 " voxels", SP_VOXELS_MAX);
    p.height = height;
    bits *= samples / planes; /* of a pixel */
    if (c->entries[TILE_WIDTH].at || c->entries[TILE_LENGTH].at) {
        if (!read_field(c, TILE_WIDTH, 0, 1, SP_DIM_MAX, &tile_width) ||
            !read_field(c, TILE_LENGTH, 0, 1, SP_DIM_MAX, &tile_length))
            return false;
        p.name = "tile";
        p.offsets = TILE_OFFSETS;
        p.counts = TILE_COUNTS;
        p.per_plane =
            ((width + tile_width - 1) / tile_width) * ((height + tile_length - 1) / tile_length);
        p.rows = tile_length;
        p.row_bytes = (tile_width * bits + 7) / 8;
    } else {
        if (!read_field(c, ROWS, height, 1, UINT64_MAX, &p.rows))
            return false;
        p.rows = p.rows < height ? p.rows : height;
        p.per_plane = (height + p.rows - 1) / p.rows;
        p.row_bytes = (width * bits + 7) / 8;
    }
    p.number = p.per_plane * planes;
    /* Refuses a page with both strips and tiles: a library may read the other ones. */
    enum field other = p.offsets == STRIP_OFFSETS ? TILE_OFFSETS : STRIP_OFFSETS;
    if (c->entries[other].at)
        return refuse(c, SP_ERR_FORMAT, c->entries[other].at, other,
                      "does not belong to a page of %ss", p.name);
    page->at = c->page_at;
    page->width = (uint32_t)width;
    page->height = (uint32_t)height;
    page->samples = (unsigned)samples;
    page->planes = (unsigned)planes;
    page->bits = (unsigned)(bits * planes / samples);
    page->compression = p.compression < UINT32_MAX ? (unsigned)p.compression : UINT32_MAX;
    page->piece_rows = p.rows;
    c->next_piece = 0;
    if (!check_pieces(c, &p))
        return false;
    if (c->next_piece && p.offsets == STRIP_OFFSETS && p.compression == TIFF_UNPACKED)
        page->pixels_at = c->next_piece - height * planes * p.row_bytes;
    return true;
}

static bool add_page(struct tiff_file *t, struct tiff_page **page) {
    if (!sp_grow(&t->pages, t->count, sizeof *t->pages))
        return false;
    *page = &t->pages[t->count];
    **page = (struct tiff_page){ .at = 0 };
    return true;
}

static bool follow(struct chain *c, struct tiff_file *t) {
    const struct import_file *file = c->file;
    unsigned word = c->big ? 8 : 4, count_bytes = c->big ? 8 : 2, entry_bytes = c->big ? 20 : 12;
    uint64_t at = c->big ? 8 : 4, next, entries;
    struct tiff_page *page;
    if (!read_number(c, at, word, &next))
        return import_fail(c->err, SP_ERR_FORMAT, file->title, at, "first directory",
                           "the file ends before its first directory: it is cut off");
    while (next != 0) {
        at = next;
        c->page = t->count;
        c->page_at = at;
        if (t->count == TIFF_PAGES_MAX)
            return import_fail(c->err, SP_ERR_FORMAT, file->title, at, "directory",
                               "the file has more than %d pages, the limit", TIFF_PAGES_MAX);
        if (!read_number(c, at, count_bytes, &entries) || entries > 65535 ||
            !read_number(c, at + count_bytes + entries * entry_bytes, word, &next))
            return import_fail(c->err, SP_ERR_FORMAT, file->title, at, "directory",
                               "page %" PRIu32 " lies beyond the end: the file of %" PRIu64
                               " bytes is cut off or the directory before it is wrong",
                               t->count, file->size);
        c->directory_bytes += count_bytes + entries * entry_bytes + word;
        if (c->directory_bytes > file->size)
            return import_fail(c->err, SP_ERR_FORMAT, file->title, at, "directory",
                               "the directories up to page %" PRIu32
                               " are longer than the file: the pages form a circle",
                               t->count);
        if (!add_page(t, &page))
            return sp_fail(c->err, SP_ERR_MEMORY, file->title, "out of memory for directories");
        if (!read_entries(c, at + count_bytes, entries) || !check_page(c, page))
            return false;
        t->count++;
    }
    return t->count > 0 || import_fail(c->err, SP_ERR_FORMAT, file->title, at, "first directory",
                                       "the file has no page");
}

bool tiff_file_open(struct tiff_file *t, const struct import_file *file, struct sp_error *err) {
    uint8_t magic[4];
    *t = (struct tiff_file){ .file = file };
    if (pread(file->fd, magic, 4, 0) != 4)
        return import_fail(err, SP_ERR_FORMAT, file->title, 0, "magic",
                           "the file ends in its header: it is cut off");
    struct chain *c = calloc(1, sizeof *c);
    if (!c)
        return sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for directories");
    c->file = file;
    c->err = err;
    t->is_big_endian = c->big_endian = magic[0] == 'M';
    t->is_big = c->big = magic[c->big_endian ? 3 : 2] == 43;
    const bool ok = follow(c, t);
    free(c);
    if (!ok)
        tiff_file_close(t);
    return ok;
}

void tiff_file_close(struct tiff_file *t) {
    free(t->pages);
    t->pages = NULL;
    t->count = 0;
}
