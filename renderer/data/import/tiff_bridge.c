/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/tiff_bridge.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <tiffio.h>
#include <unistd.h>

enum { WHY_BYTES = 256 };

struct tiff_bridge {
    TIFF *tiff;
    int fd;
    uint64_t at, size; /* bytes */
    uint64_t page;     /* of the directory that is open; 0 = none */
    bool is_damaged;   /* what was read last */
    char why[WHY_BYTES];
    uint8_t *tile; /* owned */
    size_t tile_bytes;
};

/* The file, by its descriptor. */

static tmsize_t read_bytes(thandle_t handle, void *out, tmsize_t size) {
    struct tiff_bridge *b = handle;
    const ssize_t got = pread(b->fd, out, (size_t)size, (off_t)b->at);
    b->at += got > 0 ? (uint64_t)got : 0;
    return got;
}

static tmsize_t refuse_write(thandle_t handle, void *bytes, tmsize_t size) {
    (void)handle;
    (void)bytes;
    (void)size;
    return -1;
}

static toff_t seek_to(thandle_t handle, toff_t offset, int whence) {
    struct tiff_bridge *b = handle;
    b->at = whence == SEEK_SET ? offset : whence == SEEK_CUR ? b->at + offset : b->size + offset;
    return b->at;
}

static int leave_open(thandle_t handle) {
    (void)handle;
    return 0;
}

static toff_t size_of(thandle_t handle) {
    return ((struct tiff_bridge *)handle)->size;
}

/* libtiff tells the most important reason last. */
__attribute__((format(printf, 3, 0))) static void note_error(thandle_t handle, const char *module,
                                                             const char *format, va_list args) {
    struct tiff_bridge *b = handle;
    (void)module;
    vsnprintf(b->why, sizeof b->why, format, args);
}

/* libjpeg fills what is cut off or damaged with grey, and only warns. */
__attribute__((format(printf, 3, 0))) static void note_warning(thandle_t handle, const char *module,
                                                               const char *format, va_list args) {
    struct tiff_bridge *b = handle;
    if (strcmp(module, "JPEGLib") == 0) {
        vsnprintf(b->why, sizeof b->why, format, args);
        b->is_damaged = true;
    }
}

static bool fail(const struct tiff_bridge *b, const char *what, struct sp_error *err) {
    return sp_fail(err, SP_ERR_FORMAT, "", "%s: %s", what,
                   b->why[0] ? b->why : "the data is damaged");
}

static void close_file(struct tiff_bridge *b) {
    if (b->tiff)
        TIFFClose(b->tiff);
    free(b->tile);
    free(b);
}

static struct tiff_bridge *open_file(int fd, struct sp_error *err) {
    struct tiff_bridge *b = calloc(1, sizeof *b);
    struct stat st;
    if (!b) {
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
        return NULL;
    }
    b->fd = fd;
    b->size = fstat(fd, &st) == 0 ? (uint64_t)st.st_size : 0;
    TIFFSetWarningHandler(NULL);
    TIFFSetErrorHandler(NULL);
    TIFFSetErrorHandlerExt(note_error);
    TIFFSetWarningHandlerExt(note_warning);
    /* "m": no mapping, which would count against the memory of this process. */
    b->tiff = TIFFClientOpen("file", "rm", b, read_bytes, refuse_write, seek_to, leave_open,
                             size_of, NULL, NULL);
    if (b->tiff)
        return b;
    fail(b, "the file cannot be opened", err);
    close_file(b);
    return NULL;
}

static bool explain_codec(unsigned compression, struct sp_error *err) {
    static const struct {
        unsigned compression;
        const char *name;
    } known[] = { { 33003, "JPEG 2000 of Aperio" },
                  { 33005, "JPEG 2000 of Aperio" },
                  { 34712, "JPEG 2000" },
                  { 34887, "LERC" },
                  { 34892, "lossy JPEG of DNG" },
                  { 34925, "LZMA" },
                  { 34933, "PNG" },
                  { 34934, "JPEG XR" },
                  { 48124, "JPEG XL" },
                  { 50000, "Zstandard" },
                  { 50001, "WebP" },
                  { 50002, "JPEG XL" } };
    const char *name = "unknown";
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (known[i].compression == compression)
            name = known[i].name;
    return sp_fail(err, SP_ERR_FORMAT, "",
                   "compression %u (%s) is not supported; save the file with deflate or LZW",
                   compression, name);
}

static bool use_page(struct tiff_bridge *b, uint64_t page, struct sp_error *err) {
    uint16_t compression = COMPRESSION_NONE, photometric = 0;
    if (b->page == page)
        return true;
    b->page = 0;
    if (!TIFFSetSubDirectory(b->tiff, page))
        return fail(b, "the directory of a page cannot be read", err);
    TIFFGetFieldDefaulted(b->tiff, TIFFTAG_COMPRESSION, &compression);
    TIFFGetFieldDefaulted(b->tiff, TIFFTAG_PHOTOMETRIC, &photometric);
    if (!TIFFIsCODECConfigured(compression))
        return explain_codec(compression, err);
    if (compression == COMPRESSION_JPEG && photometric == PHOTOMETRIC_YCBCR)
        TIFFSetField(b->tiff, TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB);
    b->page = page;
    return true;
}

/* A strip or tile that was not written has 0 bytes; its samples are 0. */
static bool is_empty(TIFF *tiff, uint32_t piece) {
    return TIFFGetStrileByteCount(tiff, piece) == 0;
}

static bool read_strips(struct tiff_bridge *b, unsigned plane, uint32_t first, uint32_t count,
                        size_t row_bytes, uint8_t *out) {
    uint32_t rows = 0, height = 0;
    TIFFGetFieldDefaulted(b->tiff, TIFFTAG_ROWSPERSTRIP, &rows);
    TIFFGetField(b->tiff, TIFFTAG_IMAGELENGTH, &height);
    if (rows == 0 || rows > height)
        rows = height;
    if ((uint64_t)TIFFScanlineSize64(b->tiff) != row_bytes || rows == 0)
        return false;
    for (uint32_t row = first; row < first + count; row += rows) {
        const uint32_t left = first + count - row, n = left < rows ? left : rows;
        const uint32_t strip = TIFFComputeStrip(b->tiff, row, (uint16_t)plane);
        const tmsize_t size = (tmsize_t)(n * row_bytes);
        uint8_t *to = out + (size_t)(row - first) * row_bytes;
        if (is_empty(b->tiff, strip))
            memset(to, 0, (size_t)size);
        else if (TIFFReadEncodedStrip(b->tiff, strip, to, size) != size)
            return false;
    }
    return true;
}

static bool reserve_tile(struct tiff_bridge *b) {
    const size_t size = (size_t)TIFFTileSize(b->tiff);
    if (size > b->tile_bytes) {
        free(b->tile);
        b->tile = malloc(size);
        b->tile_bytes = b->tile ? size : 0;
    }
    return size > 0 && b->tile;
}

static bool read_tiles(struct tiff_bridge *b, unsigned plane, uint32_t first, uint32_t count,
                       size_t row_bytes, uint8_t *out) {
    uint32_t width = 0, tile_width = 0, tile_length = 0;
    TIFFGetField(b->tiff, TIFFTAG_IMAGEWIDTH, &width);
    TIFFGetField(b->tiff, TIFFTAG_TILEWIDTH, &tile_width);
    TIFFGetField(b->tiff, TIFFTAG_TILELENGTH, &tile_length);
    const size_t bytes = (size_t)TIFFTileRowSize(b->tiff);
    if (!reserve_tile(b) || tile_width == 0 || tile_length == 0)
        return false;
    for (uint32_t y = first; y < first + count; y += tile_length)
        for (uint32_t x = 0; x < width; x += tile_width) {
            const uint32_t tile = TIFFComputeTile(b->tiff, x, y, 0, (uint16_t)plane);
            const uint32_t left = first + count - y, rows = left < tile_length ? left : tile_length;
            const size_t at = x / tile_width * bytes;
            const size_t n = at >= row_bytes ? 0 : row_bytes - at < bytes ? row_bytes - at : bytes;
            if (is_empty(b->tiff, tile))
                memset(b->tile, 0, b->tile_bytes);
            else if (TIFFReadEncodedTile(b->tiff, tile, b->tile, (tmsize_t)b->tile_bytes) < 0)
                return false;
            for (uint32_t row = 0; row < rows; row++)
                memcpy(out + (size_t)(y - first + row) * row_bytes + at, b->tile + row * bytes, n);
        }
    return true;
}

static bool read_rows(struct tiff_bridge *b, uint64_t page, unsigned plane, uint32_t first,
                      uint32_t count, size_t row_bytes, void *out, struct sp_error *err) {
    b->why[0] = 0;
    b->is_damaged = false;
    if (!use_page(b, page, err))
        return false;
    const bool ok = TIFFIsTiled(b->tiff) ? read_tiles(b, plane, first, count, row_bytes, out)
                                         : read_strips(b, plane, first, count, row_bytes, out);
    return (ok && !b->is_damaged) || fail(b, "the samples cannot be unpacked", err);
}

/* The module's only symbol. */
__attribute__((visibility("default")))
const struct tiff_bridge_functions splat_tiff_bridge = { open_file, close_file, read_rows };
