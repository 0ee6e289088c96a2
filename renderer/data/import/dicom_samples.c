/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/dicom_samples.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/transfer.h"
#include "data/volume/sample.h"

static bool is_color(const struct dicom_image *image) {
    return image->colors != DICOM_GRAY && image->colors != DICOM_PALETTE;
}

bool dicom_samples_type(const struct dicom_source *source, const struct dicom_image *image,
                        const char *name, struct import_number *number, unsigned *channels,
                        struct sp_error *err) {
    const unsigned bytes = image->bytes;
    const bool is_number = image->is_float ? bytes == 4 || bytes == 8
                                           : bytes == 1 || bytes == 2 || bytes == 4 || bytes == 8;
    char text[SP_ERROR_TEXT];
    snprintf(text, sizeof text,
             "%u bits of %u bytes are not supported: pixels have 1, 8, 16, 32 or 64 bits",
             image->bits, bytes);
    if (!is_number || image->bits < 1 || image->bits > 8 * bytes)
        return dicom_fail(source, SP_ERR_UNSUPPORTED, name, text, err);
    snprintf(text, sizeof text, "HighBit is %u; it must be less than BitsAllocated (%u)",
             image->high_bit, 8 * bytes);
    if (image->high_bit >= 8 * bytes)
        return dicom_fail(source, SP_ERR_UNSUPPORTED, name, text, err);
    snprintf(text, sizeof text, "%u channels are not supported: colours have 3 or 4",
             image->channels);
    if (image->channels < 1 || image->channels > 4 || (image->channels > 1) != is_color(image))
        return dicom_fail(source, SP_ERR_UNSUPPORTED, name, text, err);
    snprintf(text, sizeof text,
             "YBR_FULL_422 with %" PRIu32 " columns is not supported: two pixels of a row share "
             "their colour, so the number of columns must be even; convert the file to RGB",
             image->columns);
    if (image->colors == DICOM_YBR_422 && !image->is_packed && image->columns % 2 != 0)
        return dicom_fail(source, SP_ERR_UNSUPPORTED, name, text, err);
    const bool is_ybr = image->colors == DICOM_YBR_FULL || image->colors == DICOM_YBR_422;
    if ((is_ybr || image->colors == DICOM_PALETTE) &&
        (bytes > 2 || (is_ybr && image->channels != 3) ||
         (bytes > 1 && image->colors != DICOM_PALETTE) || image->is_float))
        return dicom_fail(source, SP_ERR_UNSUPPORTED, name,
                          "these colours are not supported: YBR has three channels of 8 bits, a "
                          "palette whole numbers of up to 16 bits; decompress the file to RGB",
                          err);
    if (image->is_bits && (image->is_packed || image->colors != DICOM_GRAY || bytes > 1))
        return dicom_fail(source, SP_ERR_UNSUPPORTED, name,
                          "pixels of one bit are supported only if they are neither compressed nor "
                          "colours; decompress the file, for example with gdcmconv --raw",
                          err);
    if (image->is_packed && image->high_bit + 1 != image->bits)
        return dicom_fail(source, SP_ERR_UNSUPPORTED, name,
                          "compressed pixels whose high bit is not the highest of the bits stored "
                          "are not supported; decompress the file, for example with gdcmconv "
                          "--raw",
                          err);
    *channels = image->colors == DICOM_PALETTE ? 3 : image->channels;
    *number = (struct import_number){ image->is_float    ? IMPORT_FLOAT
                                      : image->is_signed ? IMPORT_SIGNED
                                                         : IMPORT_UNSIGNED,
                                      bytes };
    if (is_ybr || image->colors == DICOM_PALETTE)
        *number = (struct import_number){ IMPORT_UNSIGNED, 1 };
    return true;
}

static uint64_t pixels_of(const struct dicom_image *image) {
    return (uint64_t)image->columns * image->rows;
}

/* Bytes of a frame that is not packed; of bits, rounded up. */
static uint64_t frame_bytes(const struct dicom_image *image) {
    if (image->is_bits)
        return (pixels_of(image) + 7) / 8 + 1;
    if (image->colors == DICOM_YBR_422 && !image->is_packed)
        return pixels_of(image) * 2;
    return pixels_of(image) * image->channels * image->bytes;
}

/* Packed pixels are a list of fragments, each a tag and a length, up to a delimiter. */
static bool check_packed(const struct dicom_image *image, int fd, uint64_t size,
                         struct sp_error *err) {
    uint64_t at = image->pixels_at;
    uint8_t item[8];
    while (at + sizeof item <= size && pread(fd, item, sizeof item, (off_t)at) == sizeof item) {
        const uint64_t length = item[4] | item[5] << 8 | item[6] << 16 | (uint64_t)item[7] << 24;
        if (memcmp(item, "\xfe\xff\xdd\xe0", 4) == 0)
            return true;
        if (memcmp(item, "\xfe\xff\x00\xe0", 4) != 0)
            break;
        at += sizeof item + length;
    }
    return sp_fail(err, SP_ERR_FORMAT, "", "the packed pixels have no end: the file is cut off");
}

/* The image as the file stores it. */
static struct dicom_image stored_of(const struct dicom_image *image) {
    struct dicom_image stored = *image;
    if (image->is_mosaic) {
        stored.columns *= image->tiles;
        stored.rows *= image->tiles;
        stored.frames = 1;
    }
    return stored;
}

static bool refuse_tiles(const struct dicom_image *image, struct sp_error *err) {
    char size[48] = "";
    if (image->planes > 1)
        return sp_fail(err, SP_ERR_UNSUPPORTED, "",
                       "%u frames of one tile of a slide, such as planes of focus, are not "
                       "supported; export them as a TIFF stack",
                       image->planes);
    if (image->tiled[0] >= 1 && image->tiled[1] >= 1)
        snprintf(size, sizeof size, " of %.0f x %.0f px", image->tiled[0], image->tiled[1]);
    return sp_fail(err, SP_ERR_UNSUPPORTED, "",
                   "%" PRIu32 " tiles of a whole-slide image%s are not joined; export the part of "
                   "interest as TIFF, PNG or JPEG",
                   image->frames, size);
}

static bool refuse_mosaic(struct sp_error *err) {
    return sp_fail(
        err, SP_ERR_UNSUPPORTED, "",
        "a mosaic whose number of slices (NumberOfImagesInMosaic) is missing or does not fit "
        "its size; convert it with dcm2niix");
}

static bool refuse_colors(const struct dicom_image *image, struct sp_error *err) {
    return sp_fail(
        err, SP_ERR_UNSUPPORTED, "",
        "colours of the kind %.19s (PhotometricInterpretation) are not supported; supported are "
        "RGB, YBR_FULL, YBR_FULL_422, YBR_RCT, YBR_ICT and PALETTE COLOR; convert the file to "
        "RGB",
        image->color_name);
}

bool dicom_samples_check(const struct dicom_image *described, int fd, struct sp_error *err) {
    const struct dicom_image stored = stored_of(described), *image = &stored;
    const uint64_t needed = image->is_bits ? (pixels_of(image) * image->frames + 7) / 8
                                           : frame_bytes(image) * image->frames;
    struct stat st;
    const uint64_t size = fstat(fd, &st) == 0 ? (uint64_t)st.st_size : 0;
    const uint64_t has = image->pixels_at < size ? size - image->pixels_at : 0;
    if (image->is_tiled)
        return refuse_tiles(image, err);
    if (image->is_mosaic && image->tiles == 0)
        return refuse_mosaic(err);
    if (image->colors == DICOM_OTHER_COLORS)
        return refuse_colors(image, err);
    if (image->is_packed)
        return image->pixels_at == 0 || check_packed(image, fd, size, err);
    if (image->pixels_at == 0)
        return sp_fail(err, SP_ERR_FORMAT, "", "the file has no pixels");
    if (has < needed)
        return sp_fail(err, SP_ERR_FORMAT, "",
                       "the pixels need %" PRIu64 " bytes, the file has %" PRIu64
                       ": the file is cut off",
                       needed, has);
    return image->pixels_bytes >= needed ||
           sp_fail(err, SP_ERR_FORMAT, "",
                   "the pixels need %" PRIu64 " bytes, the element has %" PRIu64
                   ": the size or the number of frames is wrong",
                   needed, image->pixels_bytes);
}

/* The list of slices comes from an earlier look at the file. */
static bool is_like(const struct dicom_image *a, const struct dicom_image *b) {
    return a->columns == b->columns && a->rows == b->rows && a->channels == b->channels &&
           a->colors == b->colors;
}

static bool fail(const struct dicom_samples *s, const char *text, struct sp_error *err) {
    return dicom_fail(s->source, SP_ERR_FORMAT, s->name, text, err);
}

/* Adds the place to an error. */
static bool fail_with(const struct dicom_samples *s, const struct sp_error *why,
                      struct sp_error *err) {
    return dicom_fail(s->source, why->code, s->name, why->text, err);
}

bool dicom_samples_open(struct dicom_samples *s, const struct dicom_source *source,
                        const char *name, struct sp_error *err) {
    char path[40];
    struct sp_error why;
    *s = (struct dicom_samples){ .source = source, .name = name };
    s->fd = dicom_open(source, name, err);
    if (s->fd < 0)
        return false;
    snprintf(path, sizeof path, "/proc/self/fd/%d", s->fd);
    if (!dicom_describe(source, s->fd, &s->image, &why))
        return fail_with(s, &why, err);
    if (!is_like(&s->image, &source->image))
        return fail(s, "the pixels differ in type or size from those of the other slices", err);
    if (!dicom_samples_check(&s->image, s->fd, &why))
        return fail_with(s, &why, err);
    if (!dicom_samples_type(source, &s->image, name, &s->number, &s->channels, err))
        return false;
    s->tiles = s->image.is_mosaic ? s->image.tiles : 0;
    s->image = stored_of(&s->image);
    s->raw_bytes = (size_t)frame_bytes(&s->image);
    s->raw = malloc(s->raw_bytes + 2);
    if (!s->raw)
        return sp_fail(err, SP_ERR_MEMORY, source->file->title, "out of memory for a frame");
    if (s->image.colors == DICOM_PALETTE && !source->call->read_palette(path, &s->palette, &why))
        return fail_with(s, &why, err);
    if (s->palette.is_rounded)
        import_warn(source->file->warnings,
                    "The palette has colours of 16 bits; they were rounded to 8 bits.");
    if (!s->image.is_packed)
        return true;
    s->image.note[0] = 0; /* that of the header is told elsewhere */
    s->packed = source->call->open_pixels(path, &s->image, &why);
    if (s->image.note[0])
        import_warn(source->file->warnings, "%s", s->image.note);
    return s->packed || fail_with(s, &why, err);
}

void dicom_samples_close(struct dicom_samples *s) {
    if (s->packed)
        s->source->call->close_pixels(s->packed);
    if (s->source)
        dicom_close(s->source, s->fd);
    free(s->palette.colors);
    free(s->raw);
    free(s->mosaic);
    *s = (struct dicom_samples){ .fd = -1 };
}

/* Bits begin anywhere in a byte, the lowest first. */
static void spread_bits(const struct dicom_image *image, const uint8_t *raw, unsigned first,
                        uint8_t *out) {
    const size_t pixels = pixels_of(image);
    for (size_t i = 0; i < pixels; i++)
        out[i] = raw[(first + i) / 8] >> (first + i) % 8 & 1;
}

static void swap_bytes(uint8_t *numbers, size_t count, unsigned bytes) {
    for (size_t i = 0; i < count; i++, numbers += bytes)
        for (unsigned a = 0, b = bytes - 1; a < b; a++, b--) {
            const uint8_t other = numbers[a];
            numbers[a] = numbers[b];
            numbers[b] = other;
        }
}

/* Puts the channels of each pixel side by side. */
static void interleave(const struct dicom_image *image, const uint8_t *raw, uint8_t *out) {
    const size_t pixels = pixels_of(image), bytes = image->bytes;
    for (unsigned channel = 0; channel < image->channels; channel++)
        for (size_t i = 0; i < pixels; i++, raw += bytes)
            memcpy(out + (i * image->channels + channel) * bytes, raw, bytes);
}

/* Removes bits that are not used, such as overlays, and extends the sign. `shift`: bits below. */
static void clean_bits(const struct dicom_image *image, uint8_t *numbers, size_t count,
                       unsigned shift) {
    const unsigned bytes = image->bytes, bits = image->bits;
    const uint64_t mask = bits < 64 ? (UINT64_C(1) << bits) - 1 : UINT64_MAX;
    if (image->is_float || (bits == 8 * bytes && shift == 0))
        return;
    if (bytes == 2) { /* nearly all files */
        uint16_t *n = (uint16_t *)(void *)numbers;
        const unsigned unused = 16 - bits;
        for (size_t i = 0; i < count; i++) {
            const uint16_t top = (uint16_t)((n[i] >> shift) << unused);
            n[i] =
                image->is_signed ? (uint16_t)((int16_t)top >> unused) : (uint16_t)(top >> unused);
        }
        return;
    }
    for (size_t i = 0; i < count; i++, numbers += bytes) {
        uint64_t number = 0;
        memcpy(&number, numbers, bytes); /* little endian */
        number = number >> shift & mask;
        if (image->is_signed && number >> (bits - 1))
            number |= ~mask;
        memcpy(numbers, &number, bytes);
    }
}

static uint8_t to_byte(double number) {
    return (uint8_t)fmin(fmax(floor(number + 0.5), 0), 255);
}

/* Luminance and colour differences as in JFIF (ITU-T T.871). */
static void to_rgb(double y, double cb, double cr, uint8_t *out) {
    out[0] = to_byte(y + 1.402 * (cr - 128));
    out[1] = to_byte(y - 0.344136286 * (cb - 128) - 0.714136286 * (cr - 128));
    out[2] = to_byte(y + 1.772 * (cb - 128));
}

/* Two pixels of a row are Y, Y, Cb, Cr. */
static void convert_422(const struct dicom_image *image, const uint8_t *raw, uint8_t *out) {
    const size_t pixels = pixels_of(image);
    for (size_t i = 0; i + 1 < pixels; i += 2, raw += 4, out += 6) {
        to_rgb(raw[0], raw[2], raw[3], out);
        to_rgb(raw[1], raw[2], raw[3], out + 3);
    }
}

static void look_up(const struct dicom_samples *s, size_t pixels, uint8_t *out) {
    const struct dicom_palette *palette = &s->palette;
    for (size_t i = 0; i < pixels; i++, out += 3) {
        const struct import_number number = { s->image.is_signed ? IMPORT_SIGNED : IMPORT_UNSIGNED,
                                              s->image.bytes };
        const double entry = import_widen(s->raw + i * s->image.bytes, number) - palette->first;
        const double last = palette->count - 1;
        memcpy(out, palette->colors[(size_t)fmin(fmax(entry, 0), last)], 3);
    }
}

static bool read_raw(struct dicom_samples *s, uint32_t frame, unsigned *first_bit,
                     struct sp_error *err) {
    const struct dicom_image *image = &s->image;
    const uint64_t bit = pixels_of(image) * frame;
    const uint64_t at = image->pixels_at + (image->is_bits ? bit / 8 : frame_bytes(image) * frame);
    const uint64_t bytes =
        image->is_bits ? (bit % 8 + pixels_of(image) + 7) / 8 : frame_bytes(image);
    /* Bytes in words: one more before and behind, so that all words are whole. */
    const bool has_words = image->has_words && image->bytes == 1 && !image->is_bits;
    const size_t before = has_words ? (at - image->pixels_at) % 2 : 0;
    const size_t all = (size_t)bytes + before + (has_words ? (bytes + before) % 2 : 0);
    *first_bit = bit % 8;
    if (!sp_read_at(s->fd, s->raw, all, at - before))
        return fail(s, "the file cannot be read, or is cut off", err);
    if (has_words) {
        swap_bytes(s->raw, all / 2, 2);
        memmove(s->raw, s->raw + before, (size_t)bytes);
    }
    return true;
}

/* The frame as numbers of the file in native byte order; colours and palettes are not yet
 * converted. `to` is the raw buffer or `out`. */
static bool read_numbers(struct dicom_samples *s, uint32_t frame, uint8_t *to,
                         struct sp_error *err) {
    const struct dicom_image *image = &s->image;
    const size_t count = pixels_of(image) * image->channels;
    const unsigned unused = image->high_bit + 1 - image->bits;
    struct sp_error why;
    unsigned first_bit;
    if (s->packed) {
        if (!s->source->call->read_frame(s->packed, frame, to, count * image->bytes, &why))
            return fail_with(s, &why, err);
        clean_bits(image, to, count, 0);
        return true;
    }
    if (!read_raw(s, frame, &first_bit, err))
        return false;
    if (image->is_bits) {
        spread_bits(image, s->raw, first_bit, to);
        return true;
    }
    if (image->is_swapped && image->bytes > 1)
        swap_bytes(s->raw, count, image->bytes);
    if (image->is_planar)
        interleave(image, s->raw, to);
    else if (to != s->raw)
        memcpy(to, s->raw, count * image->bytes);
    clean_bits(image, to, count, image->high_bit + 1 >= image->bits ? unused : 0);
    return true;
}

static bool read_stored(struct dicom_samples *s, uint32_t frame, void *out, struct sp_error *err) {
    const struct dicom_image *image = &s->image;
    const size_t pixels = pixels_of(image);
    unsigned first_bit;
    if (frame >= image->frames)
        return fail(s, "the file was changed while it was read: it has fewer frames now", err);
    if (image->colors == DICOM_YBR_422 && !image->is_packed) {
        if (!read_raw(s, frame, &first_bit, err))
            return false;
        convert_422(image, s->raw, out);
        return true;
    }
    if (image->colors == DICOM_PALETTE) {
        if (!read_numbers(s, frame, s->raw, err))
            return false;
        look_up(s, pixels, out);
        return true;
    }
    if (!read_numbers(s, frame, out, err))
        return false;
    if (image->colors == DICOM_YBR_FULL || image->colors == DICOM_YBR_422)
        for (size_t i = 0; i < pixels; i++) {
            uint8_t *at = (uint8_t *)out + 3 * i;
            to_rgb(at[0], at[1], at[2], at);
        }
    return true;
}

/* Tiles of a mosaic lie row by row. */
static bool read_tile(struct dicom_samples *s, uint32_t tile, char *out, struct sp_error *err) {
    const struct dicom_image *image = &s->image;
    const size_t pixel = s->number.size * s->channels, row = pixel * image->columns;
    const size_t rows = image->rows / s->tiles, bytes = row / s->tiles;
    if (tile / s->tiles >= s->tiles)
        return fail(s, "the file was changed while it was read: it has fewer tiles now", err);
    if (!s->mosaic) {
        s->mosaic = malloc(row * image->rows);
        if (!s->mosaic)
            return sp_fail(err, SP_ERR_MEMORY, s->source->file->title,
                           "out of memory for a mosaic");
        if (!read_stored(s, 0, s->mosaic, err))
            return false;
    }
    const char *from = s->mosaic + tile / s->tiles * rows * row + tile % s->tiles * bytes;
    for (size_t i = 0; i < rows; i++)
        memcpy(out + i * bytes, from + i * row, bytes);
    return true;
}

bool dicom_samples_read(struct dicom_samples *s, uint32_t frame, void *out, struct sp_error *err) {
    return s->tiles ? read_tile(s, frame, out, err) : read_stored(s, frame, out, err);
}
