/* SPDX-License-Identifier: Apache-2.0
 *
 * A brick file. Its checksums are made right first, so that what they protect is reached.
 */
#include <endian.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "bricks/file.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

enum { SAMPLES = BRICK_SIDE * BRICK_SIDE * BRICK_SIDE };

static uint64_t number_at(const uint8_t *bytes) {
    uint64_t number;
    memcpy(&number, bytes, sizeof number);
    return le64toh(number);
}

static void put_number(uint8_t *bytes, uint64_t number) {
    uint64_t stored = htole64(number);
    memcpy(bytes, &stored, sizeof stored);
}

/* Makes the checksums of the indices and of the header right. */
static void seal(uint8_t *bytes, size_t size) {
    struct sp_brick_header header;
    struct sp_error err;
    put_number(bytes + BRICK_HEADER_BYTES - 8, sp_brick_checksum(bytes, BRICK_HEADER_BYTES - 8));
    if (!sp_brick_header_decode(bytes, size, "input", &header, &err))
        return;
    for (unsigned l = 0; l < header.levels; l++) {
        const size_t index = sp_brick_count(&header.level[l]) * BRICK_ENTRY_BYTES;
        for (size_t at = 8; at + 16 <= BRICK_HEADER_BYTES - 8; at += 8)
            if (number_at(bytes + at) == header.level[l].index_at &&
                number_at(bytes + at + 8) == header.level[l].checksum)
                put_number(bytes + at + 8,
                           sp_brick_checksum(bytes + header.level[l].index_at, index));
    }
    const size_t notes = (size_t)header.notes_bytes;
    for (size_t at = 8; notes && at + 24 <= BRICK_HEADER_BYTES - 8; at += 8)
        if (number_at(bytes + at) == header.notes_at && number_at(bytes + at + 8) == notes)
            put_number(bytes + at + 16, sp_brick_checksum(bytes + header.notes_at, notes));
    put_number(bytes + BRICK_HEADER_BYTES - 8, sp_brick_checksum(bytes, BRICK_HEADER_BYTES - 8));
}

static void read_all(const struct sp_brick_file *file) {
    enum { BRICKS_MAX = 64 };
    const struct sp_brick_header *header = sp_brick_file_header(file);
    struct sp_error err;
    void *out = malloc(SAMPLES * sp_type_size(header->info.type));
    struct sp_brick_scratch *scratch = sp_brick_scratch_create(&err);
    for (unsigned l = 0; out && scratch && l < header->levels; l++)
        for (uint64_t b = 0; b < sp_brick_count(&header->level[l]) && b < BRICKS_MAX; b++)
            sp_brick_file_read(file, l, b, scratch, out, &err);
    sp_brick_scratch_destroy(&scratch);
    free(out);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct sp_error err;
    uint8_t *copy = malloc(size ? size : 1);
    int fd = memfd_create("bricks", MFD_CLOEXEC);
    if (!copy || fd < 0)
        abort();
    memcpy(copy, data, size);
    if (size >= BRICK_HEADER_BYTES)
        seal(copy, size);
    if (write(fd, copy, size) != (ssize_t)size)
        abort();
    free(copy);
    struct sp_brick_file *file = sp_brick_file_open(fd, "input", &err);
    if (file)
        read_all(file);
    sp_brick_file_close(&file);
    return 0;
}
