/* SPDX-License-Identifier: Apache-2.0
 *
 * A brick file. Its checksums are made right first, so that what they protect is reached.
 */
#include <endian.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "data/bricks/file.h"
#include "data/bricks/places.h"

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

/* Finds the numbers `first` and `second`, one after the other, in the header, and replaces the next
 * or the second one: the checksum of `size` bytes at `first`. */
static void seal_part(uint8_t *bytes, uint64_t first, uint64_t second, bool is_next, size_t size) {
    const size_t step = is_next ? 16 : 8;
    for (size_t at = 8; at + step + 8 <= BRICK_HEADER_BYTES - 8; at += 4)
        if (number_at(bytes + at) == first && number_at(bytes + at + 8) == second)
            put_number(bytes + at + step, sp_brick_checksum(bytes + first, size));
}

/* Makes the checksums of the header and of the parts that it names right. */
static void seal(uint8_t *bytes, size_t size) {
    struct sp_brick_header header;
    struct sp_error err;
    put_number(bytes + BRICK_HEADER_BYTES - 8, sp_brick_checksum(bytes, BRICK_HEADER_BYTES - 8));
    if (!sp_brick_header_decode(bytes, size, "input", &header, &err))
        return;
    for (unsigned l = 0; l < header.levels; l++) {
        const struct sp_brick_level *level = &header.level[l];
        const size_t index = sp_brick_count(level) * BRICK_ENTRY_BYTES;
        seal_part(bytes, level->samples.at, level->samples.checksum, false, index);
        if (header.info.vector_bytes)
            seal_part(bytes, level->vectors.at, level->vectors.checksum, false, index);
    }
    const size_t axes = sp_brick_places_first(&header) * sizeof(double);
    if (axes)
        seal_part(bytes, header.axes_at, header.axes_checksum, false, axes);
    if (header.notes_bytes)
        seal_part(bytes, header.notes_at, header.notes_bytes, true, (size_t)header.notes_bytes);
    put_number(bytes + BRICK_HEADER_BYTES - 8, sp_brick_checksum(bytes, BRICK_HEADER_BYTES - 8));
}

/* Places of samples and samples at places, of each level. */
static void visit_axes(const struct sp_brick_header *header) {
    for (unsigned l = 0; l < header->levels; l++)
        for (int a = 0; a < 3; a++) {
            const double last = header->level[l].dims[a] - 1.0;
            for (int i = -1; i <= 4; i++) {
                const double at = 0.33 * i * last, place = sp_brick_distance(header, l, a, at);
                if (!(fabs(sp_brick_sample(header, l, a, place) - at) <= 1e-3 * (1 + last)))
                    abort();
            }
        }
}

static void read_all(const struct sp_brick_file *file) {
    enum { BRICKS_MAX = 64 };
    const struct sp_brick_header *header = sp_brick_file_header(file);
    struct sp_error err;
    void *out = malloc(SAMPLES * (size_t)BRICK_VECTOR_BYTES);
    struct sp_brick_scratch *scratch = sp_brick_scratch_create(&err);
    for (unsigned l = 0; out && scratch && l < header->levels; l++)
        for (uint64_t b = 0; b < sp_brick_count(&header->level[l]) && b < BRICKS_MAX; b++) {
            sp_brick_file_read(file, l, b, scratch, out, &err);
            if (header->info.vector_bytes)
                sp_brick_file_read_vectors(file, l, b, scratch, out, &err);
        }
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
    if (file) {
        visit_axes(sp_brick_file_header(file));
        read_all(file);
    }
    sp_brick_file_close(&file);
    return 0;
}
