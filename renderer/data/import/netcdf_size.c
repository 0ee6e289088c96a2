/* SPDX-License-Identifier: Apache-2.0
 *
 * Tags and types: NetCDF Classic Format Specification (Unidata).
 *
 * Why this parser is our own: parsers.md.
 */
#include "data/import/netcdf_size.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { DIMENSIONS_MAX = 65536, BUFFER_BYTES = 4096 };

struct header {
    const struct import_file *file;
    uint64_t at;
    unsigned count_bytes, offset_bytes; /* of counts and of offsets */
    uint64_t buffer_at;                 /* of the first byte in the buffer */
    size_t buffer_size;
    uint8_t buffer[BUFFER_BYTES];
    uint64_t records;
    uint64_t *dims; /* owned: lengths; 0 = of records */
    uint64_t dim_count;
    bool ok;
};

static uint64_t get(struct header *h, unsigned bytes) {
    uint64_t value = 0;
    for (unsigned i = 0; i < bytes && h->ok; i++, h->at++) {
        if (h->at < h->buffer_at || h->at >= h->buffer_at + h->buffer_size) {
            const ssize_t got = pread(h->file->fd, h->buffer, BUFFER_BYTES, (off_t)h->at);
            h->buffer_at = h->at;
            h->buffer_size = got > 0 ? (size_t)got : 0;
            h->ok = got > 0;
        }
        if (h->ok)
            value = value << 8 | h->buffer[h->at - h->buffer_at];
    }
    return value;
}

static void skip(struct header *h, uint64_t bytes) {
    const uint64_t padded = bytes > h->file->size ? bytes : (bytes + 3) / 4 * 4;
    h->ok = h->ok && padded <= h->file->size - h->at;
    h->at += h->ok ? padded : 0;
}

static uint64_t type_bytes(uint64_t type) {
    static const uint8_t sizes[] = { 0, 1, 1, 2, 4, 4, 8, 1, 2, 4, 8, 8 };
    return type < sizeof sizes ? sizes[type] : 0;
}

/* Begins a list: a tag and a count. */
static uint64_t begin_list(struct header *h) {
    get(h, 4);
    const uint64_t count = get(h, h->count_bytes);
    h->ok = h->ok && count <= h->file->size;
    return h->ok ? count : 0;
}

static void skip_attributes(struct header *h) {
    for (uint64_t i = begin_list(h); i > 0 && h->ok; i--) {
        skip(h, get(h, h->count_bytes)); /* the name */
        const uint64_t size = type_bytes(get(h, 4)), count = get(h, h->count_bytes);
        h->ok = h->ok && count <= h->file->size;
        skip(h, h->ok ? size * count : 0);
    }
}

static bool read_dimensions(struct header *h) {
    h->dim_count = begin_list(h);
    if (h->dim_count > DIMENSIONS_MAX)
        return false;
    h->dims = calloc((size_t)h->dim_count + 1, sizeof *h->dims);
    for (uint64_t i = 0; h->dims && i < h->dim_count && h->ok; i++) {
        skip(h, get(h, h->count_bytes));
        h->dims[i] = get(h, h->count_bytes);
    }
    return h->dims;
}

/* A product that stays below 2^62. */
static uint64_t times(uint64_t a, uint64_t b) {
    return b && a > (UINT64_C(1) << 62) / b ? UINT64_C(1) << 62 : a * b;
}

/* Reads a variable: returns where its numbers begin, *size of them per record, *is_record. */
static uint64_t read_variable(struct header *h, uint64_t *size, bool *is_record) {
    skip(h, get(h, h->count_bytes));
    const uint64_t rank = get(h, h->count_bytes);
    *size = 1;
    *is_record = false;
    for (uint64_t d = 0; d < rank && h->ok; d++) {
        const uint64_t id = get(h, h->count_bytes);
        h->ok = h->ok && id < h->dim_count;
        const uint64_t length = h->ok ? h->dims[id] : 0;
        *is_record |= d == 0 && length == 0;
        *size = times(*size, length ? length : 1);
    }
    skip_attributes(h);
    *size = times(*size, type_bytes(get(h, 4)));
    get(h, h->count_bytes); /* the size, which may not fit */
    return get(h, h->offset_bytes);
}

/* Where the last number ends. */
static uint64_t compute_end(struct header *h) {
    uint64_t end = 0, last_record = 0, record = 0, records = 0, only = 0, size;
    bool is_record;
    for (uint64_t i = begin_list(h); i > 0 && h->ok; i--) {
        const uint64_t begin = read_variable(h, &size, &is_record);
        const uint64_t stop = begin < UINT64_C(1) << 61 ? begin + size : UINT64_C(1) << 62;
        if (!is_record) {
            end = stop > end ? stop : end;
            continue;
        }
        record += (size + 3) / 4 * 4;
        only = size;
        records++;
        last_record = stop > last_record ? stop : last_record;
    }
    if (records == 1)
        record = only; /* without padding between records */
    if (records > 0 && h->records > 0) {
        const uint64_t before = times(record, h->records - 1);
        end = last_record + before > end ? last_record + before : end;
    }
    return end;
}

bool netcdf_size_check(const struct import_file *file, struct sp_error *err) {
    struct header *h = calloc(1, sizeof *h);
    if (!h)
        return sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory");
    *h = (struct header){ .file = file, .ok = true };
    const uint64_t magic = get(h, 4), version = magic & 255;
    bool ok = true;
    if (magic >> 8 == 0x434446) {
        h->count_bytes = version == 5 ? 8 : 4;
        h->offset_bytes = version == 1 ? 4 : 8;
        h->records = get(h, h->count_bytes);
        h->ok = h->ok && read_dimensions(h);
        skip_attributes(h);
        const uint64_t end = compute_end(h);
        if (!h->ok)
            ok = import_fail(err, SP_ERR_FORMAT, file->title, h->at, NULL,
                             "the header of this NetCDF file is damaged or cut off");
        else if (end > file->size)
            ok = import_fail(err, SP_ERR_FORMAT, file->title, file->size, NULL,
                             "the numbers need %" PRIu64 " bytes, the file has %" PRIu64
                             ": it is cut off",
                             end, file->size);
    }
    free(h->dims);
    free(h);
    return ok;
}
