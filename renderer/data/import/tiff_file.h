/* SPDX-License-Identifier: Apache-2.0
 *
 * The directories of a TIFF, and the tags in them. This is a parser of our own, because libtiff
 * repairs wrong directories silently and then returns pages that the file does not hold; it only
 * unpacks strips and tiles here (tiff_bridge.h).
 *
 *   tiff_chain.c ─► pages ─► tiff_layout.c, tiff_ome.c (which page is what) ─► tiff.c (samples)
 */
#ifndef SP_IMPORT_TIFF_FILE_H
#define SP_IMPORT_TIFF_FILE_H

#include "data/import/number.h"

enum { TIFF_SAMPLES_MAX = 4096, TIFF_PAGES_MAX = 1 << 20, TIFF_TEXT_MAX = 256 << 20 };

enum { TIFF_MIN_IS_WHITE = 0, TIFF_RGB = 2, TIFF_PALETTE = 3, TIFF_YCBCR = 6 }; /* photometric */
enum { TIFF_UNPACKED = 1, TIFF_OLD_JPEG = 6, TIFF_JPEG = 7 };                   /* compression */

struct tiff_page {
    uint64_t at; /* of its directory [bytes] */
    /* Of its pixels if they lie behind one another, unpacked: other planes may follow without a
     * directory. 0 = they do not. */
    uint64_t pixels_at;
    uint64_t piece_rows;    /* rows of a strip or tile */
    uint32_t width, height; /* px */
    unsigned samples;       /* per pixel */
    unsigned planes;        /* 1 = the samples of a pixel lie side by side; else = samples */
    unsigned bits, format;  /* of a sample, and SampleFormat */
    unsigned compression, photometric;
    bool is_reduced; /* a smaller image of another page, or a mask of it */
};

struct tiff_file {
    const struct import_file *file;
    bool is_big_endian, is_big;
    struct tiff_page *pages; /* owned; at least one */
    uint32_t count;
};

/* Follows the chain of directories of a TIFF or BigTIFF. Every strip or tile must lie in the file
 * and be long enough for the samples of its rows: unpacked samples need all their bytes, packed
 * ones as many as the codec needs at its best ratio; a tile of 0 bytes at byte 0 has the samples 0.
 * All strips together are not longer than the file. Errors name file, page, byte and field. */
bool tiff_file_open(struct tiff_file *tiff, const struct import_file *file, struct sp_error *err);
void tiff_file_close(struct tiff_file *tiff);

/* Bytes of a row of a plane of a page, unpacked. */
uint64_t tiff_row_bytes(const struct tiff_page *page);

struct tiff_tag {
    unsigned type;   /* as in TIFF 6.0: 1 byte, 2 text, 3 short, 4 long, 5 rational, … */
    uint64_t count;  /* numbers */
    uint64_t values; /* offset of the first one */
};

/* False if the page does not have the tag, or its numbers do not lie in the file. */
bool tiff_tag_find(const struct tiff_file *tiff, const struct tiff_page *page, unsigned number,
                   struct tiff_tag *tag);

/* Reads at most `most` numbers of the tag; returns how many. Rationals of denominator 0 become NaN
 * or infinite. */
size_t tiff_tag_numbers(const struct tiff_file *tiff, const struct tiff_page *page, unsigned number,
                        double *out, size_t most);

/* Reads bytes of the tag from byte `from` on; returns how many. */
size_t tiff_tag_bytes(const struct tiff_file *tiff, const struct tiff_page *page, unsigned number,
                      uint64_t from, void *out, size_t most);

/* The text of a tag, which the caller frees; "" if there is none. NULL when out of memory. */
char *tiff_tag_text(const struct tiff_file *tiff, const struct tiff_page *page, unsigned number);

#endif
