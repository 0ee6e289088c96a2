/* SPDX-License-Identifier: Apache-2.0
 *
 * Why this parser is our own: parsers.md.
 */
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "data/import/tiff_file.h"

enum { NUMBERS_MAX = 4096 };

/* The kinds of the types of TIFF 6.0 and BigTIFF; a rational is two of them. */
static const struct {
    struct import_number number;
    unsigned parts;
} types[] = {
    [1] = { { IMPORT_UNSIGNED, 1 }, 1 },  [2] = { { IMPORT_UNSIGNED, 1 }, 1 },
    [3] = { { IMPORT_UNSIGNED, 2 }, 1 },  [4] = { { IMPORT_UNSIGNED, 4 }, 1 },
    [5] = { { IMPORT_UNSIGNED, 4 }, 2 },  [6] = { { IMPORT_SIGNED, 1 }, 1 },
    [7] = { { IMPORT_UNSIGNED, 1 }, 1 },  [8] = { { IMPORT_SIGNED, 2 }, 1 },
    [9] = { { IMPORT_SIGNED, 4 }, 1 },    [10] = { { IMPORT_SIGNED, 4 }, 2 },
    [11] = { { IMPORT_FLOAT, 4 }, 1 },    [12] = { { IMPORT_FLOAT, 8 }, 1 },
    [13] = { { IMPORT_UNSIGNED, 4 }, 1 }, [16] = { { IMPORT_UNSIGNED, 8 }, 1 },
    [17] = { { IMPORT_SIGNED, 8 }, 1 },   [18] = { { IMPORT_UNSIGNED, 8 }, 1 },
};

static size_t size_of(unsigned type) {
    return type < sizeof types / sizeof *types ? types[type].parts * types[type].number.size : 0;
}

static uint64_t whole(const struct tiff_file *t, const uint8_t *bytes, unsigned size) {
    uint64_t out = 0;
    for (unsigned i = 0; i < size; i++)
        out |= (uint64_t)bytes[t->is_big_endian ? size - 1 - i : i] << (8 * i);
    return out;
}

static bool read_at(const struct tiff_file *t, uint64_t at, void *out, size_t size) {
    return at <= t->file->size && size <= t->file->size - at &&
           pread(t->file->fd, out, size, (off_t)at) == (ssize_t)size;
}

/* Decodes an entry of a directory at byte `at`. */
static bool decode_entry(const struct tiff_file *t, const uint8_t *entry, uint64_t at,
                         struct tiff_tag *tag) {
    const unsigned word = t->is_big ? 8 : 4;
    tag->type = (unsigned)whole(t, entry + 2, 2);
    tag->count = whole(t, entry + 4, word);
    const size_t size = size_of(tag->type);
    if (size == 0 || tag->count == 0 || tag->count > t->file->size / size)
        return false;
    tag->values = tag->count * size <= word ? at + 4 + word : whole(t, entry + 4 + word, word);
    return tag->values <= t->file->size && tag->count * size <= t->file->size - tag->values;
}

bool tiff_tag_find(const struct tiff_file *t, const struct tiff_page *page, unsigned number,
                   struct tiff_tag *tag) {
    const unsigned count_bytes = t->is_big ? 8 : 2, entry_bytes = t->is_big ? 20 : 12;
    uint8_t bytes[20];
    if (!read_at(t, page->at, bytes, count_bytes))
        return false;
    const uint64_t count = whole(t, bytes, count_bytes);
    for (uint64_t i = 0; i < count && i < 65536; i++) {
        const uint64_t at = page->at + count_bytes + i * entry_bytes;
        if (!read_at(t, at, bytes, entry_bytes))
            return false;
        if (whole(t, bytes, 2) == number)
            return decode_entry(t, bytes, at, tag);
    }
    return false;
}

size_t tiff_tag_bytes(const struct tiff_file *t, const struct tiff_page *page, unsigned number,
                      uint64_t from, void *out, size_t most) {
    struct tiff_tag tag;
    if (!tiff_tag_find(t, page, number, &tag))
        return 0;
    const uint64_t size = tag.count * size_of(tag.type);
    if (from >= size)
        return 0;
    const size_t n = size - from < most ? (size_t)(size - from) : most;
    return read_at(t, tag.values + from, out, n) ? n : 0;
}

size_t tiff_tag_numbers(const struct tiff_file *t, const struct tiff_page *page, unsigned number,
                        double *out, size_t most) {
    struct tiff_tag tag;
    if (!tiff_tag_find(t, page, number, &tag))
        return 0;
    const struct import_number kind = types[tag.type].number;
    const size_t count = tag.count < most ? (size_t)tag.count : most;
    const unsigned parts = types[tag.type].parts;
    for (size_t i = 0; i < count; i++) {
        uint8_t bytes[16];
        if (!read_at(t, tag.values + i * parts * kind.size, bytes, parts * kind.size))
            return i;
        if (t->is_big_endian != (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__))
            for (unsigned part = 0; part < parts; part++) {
                uint64_t word;
                memcpy(&word, bytes + part * kind.size, kind.size);
                import_swap(&word, kind.size, 1);
                memcpy(bytes + part * kind.size, &word, kind.size);
            }
        out[i] = import_widen(bytes, kind);
        if (parts == 2)
            out[i] /= import_widen(bytes + kind.size, kind);
    }
    return count;
}

char *tiff_tag_text(const struct tiff_file *t, const struct tiff_page *page, unsigned number) {
    struct tiff_tag tag = { .count = 0 };
    if (!tiff_tag_find(t, page, number, &tag) || size_of(tag.type) != 1 ||
        tag.count > TIFF_TEXT_MAX)
        tag.count = 0;
    char *text = malloc((size_t)tag.count + 1);
    if (text) {
        const size_t got =
            tag.count ? tiff_tag_bytes(t, page, number, 0, text, (size_t)tag.count) : 0;
        text[got] = 0;
    }
    return text;
}
