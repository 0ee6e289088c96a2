/* SPDX-License-Identifier: Apache-2.0 */
#include "data/bricks/file.h"

#include <endian.h>
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zstd.h>

#include "data/bricks/places.h"
#include "data/volume/grid.h"

struct sp_brick_file {
    int fd; /* −1 = it is made of chunks */
    struct sp_chunk_source chunks;
    struct sp_brick_learned *learned[BRICK_LEVELS_MAX]; /* owned; NULL = read from a file */
    pthread_rwlock_t *lock; /* owned, guards the entries; NULL = read from a file */
    uint64_t bytes;         /* of the file when it was opened */
    char title[SP_ERROR_PLACE];
    struct sp_brick_header header;
    struct sp_brick_entry *entries[BRICK_LEVELS_MAX];
    struct sp_brick_entry *vectors[BRICK_LEVELS_MAX]; /* of their bricks; NULL = there are none */
    double *times;                                    /* of the steps; NULL = unknown */
    double *places;                                   /* of the levels; NULL = all axes are even */
};

struct sp_brick_scratch {
    ZSTD_DCtx *context;
    unsigned char *packed;
    size_t capacity;
};

bool sp_brick_file_is(int fd) {
    char start[BRICK_MAGIC_BYTES];
    return pread(fd, start, sizeof start, 0) == (ssize_t)sizeof start &&
           memcmp(start, sp_brick_magic, sizeof start) == 0;
}

/* Reads all of it, or fails. */
static bool read_at(const struct sp_brick_file *file, void *out, size_t size, uint64_t at,
                    struct sp_error *err) {
    for (size_t done = 0; done < size;) {
        ssize_t n = pread(file->fd, (char *)out + done, size - done, (off_t)(at + done));
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0)
            return sp_fail(err, SP_ERR_IO, file->title, "cannot read %zu bytes at %" PRIu64 ": %s",
                           size, at, strerror(errno));
        if (n == 0)
            return sp_fail(err, SP_ERR_FORMAT, file->title, "the file ends at byte %" PRIu64,
                           at + done);
        done += (size_t)n;
    }
    return true;
}

/* Reads the index of a level into new entries. */
static bool read_index(struct sp_brick_file *file, unsigned l, const struct sp_brick_index *index,
                       struct sp_brick_entry **entries, struct sp_error *err) {
    uint64_t count = sp_brick_count(&file->header.level[l]);
    size_t size = count * BRICK_ENTRY_BYTES;
    unsigned char *bytes = malloc(size);
    bool ok = (*entries = malloc(count * sizeof **entries)) && bytes;
    if (!ok)
        sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for the index");
    ok = ok && read_at(file, bytes, size, index->at, err);
    if (ok && sp_brick_checksum(bytes, size) != index->checksum)
        ok = sp_fail(err, SP_ERR_FORMAT, file->title,
                     "the brick file is damaged, convert the volume again: the checksum of the "
                     "index of level %u",
                     l);
    for (uint64_t i = 0; ok && i < count; i++)
        ok = sp_brick_entry_decode(bytes + i * BRICK_ENTRY_BYTES, file->bytes, file->title,
                                   &(*entries)[i], err);
    free(bytes);
    return ok;
}

/* Numbers of the file, little-endian. */
static double decode_double(const unsigned char *bytes) {
    uint64_t bits;
    double value;
    memcpy(&bits, bytes, sizeof bits);
    bits = le64toh(bits);
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* Reads the rectilinear axes, and checks them with the rest of the grid. */
static bool read_axes(struct sp_brick_file *file, struct sp_error *err) {
    struct sp_brick_header *header = &file->header;
    const size_t first = sp_brick_places_first(header), size = first * sizeof(double);
    uint64_t voxel_bytes;
    if (!header->rectilinear)
        return true;
    unsigned char *bytes = malloc(size);
    file->places = malloc(sp_brick_places_count(header) * sizeof *file->places);
    bool ok = bytes && file->places;
    if (!ok)
        sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for the axes");
    ok = ok && read_at(file, bytes, size, header->axes_at, err);
    if (ok && sp_brick_checksum(bytes, size) != header->axes_checksum)
        ok = sp_fail(
            err, SP_ERR_FORMAT, file->title,
            "the brick file is damaged, convert the volume again: the checksum of its axes");
    for (size_t i = 0; ok && i < first; i++)
        file->places[i] = decode_double(bytes + i * sizeof(double));
    free(bytes);
    if (!ok)
        return false;
    sp_brick_places_fill(header, file->places);
    return sp_grid_check(&header->info.grid, header->info.type, file->title, &voxel_bytes, err);
}

static bool read_notes(struct sp_brick_file *file, struct sp_error *err) {
    const size_t size = file->header.notes_bytes;
    unsigned char *bytes = size ? malloc(size) : NULL;
    if (!size)
        return true;
    bool ok = (file->times = malloc(size)) && bytes;
    if (!ok)
        sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for the notes");
    ok = ok && read_at(file, bytes, size, file->header.notes_at, err);
    if (ok && sp_brick_checksum(bytes, size) != file->header.notes_checksum)
        ok = sp_fail(
            err, SP_ERR_FORMAT, file->title,
            "the brick file is damaged, convert the volume again: the checksum of its notes");
    ok =
        ok && sp_brick_notes_decode(bytes, size, file->title, &file->header.info, file->times, err);
    free(bytes);
    return ok;
}

static bool read_header(struct sp_brick_file *file, struct sp_error *err) {
    unsigned char bytes[BRICK_HEADER_BYTES];
    struct stat st;
    if (fstat(file->fd, &st) != 0)
        return sp_fail(err, SP_ERR_IO, file->title, "cannot read the size: %s", strerror(errno));
    file->bytes = (uint64_t)st.st_size;
    if (!read_at(file, bytes, sizeof bytes, 0, err) ||
        !sp_brick_header_decode(bytes, file->bytes, file->title, &file->header, err))
        return false;
    for (unsigned l = 0; l < file->header.levels; l++) {
        const struct sp_brick_level *level = &file->header.level[l];
        if (!read_index(file, l, &level->samples, &file->entries[l], err) ||
            (file->header.info.vector_bytes &&
             !read_index(file, l, &level->vectors, &file->vectors[l], err)))
            return false;
    }
    return read_axes(file, err) && read_notes(file, err);
}

struct sp_brick_file *sp_brick_file_open(int fd, const char *title, struct sp_error *err) {
    struct sp_brick_file *file = calloc(1, sizeof *file);
    if (!file) {
        close(fd);
        sp_fail(err, SP_ERR_MEMORY, title, "out of memory for a brick file");
        return NULL;
    }
    file->fd = fd;
    snprintf(file->title, sizeof file->title, "%s", title);
    if (!read_header(file, err))
        sp_brick_file_close(&file);
    return file;
}

/* Nothing is known of the bricks yet. */
static bool init_level(struct sp_brick_file *file, unsigned l, struct sp_error *err) {
    const struct sp_chunk_level *from = &file->chunks.level[l];
    struct sp_brick_level *level = &file->header.level[l];
    memcpy(level->dims, from->dims, sizeof level->dims);
    memcpy(level->step, from->step, sizeof level->step);
    memcpy(level->offset, from->offset, sizeof level->offset);
    sp_brick_level_divide(level);
    const uint64_t count = sp_brick_count(level);
    file->entries[l] = malloc(count * sizeof *file->entries[l]);
    file->learned[l] = sp_brick_learned_create(level);
    if (!file->entries[l] || !file->learned[l])
        return sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for the index");
    for (uint64_t i = 0; i < count; i++)
        file->entries[l][i] = (struct sp_brick_entry){ .range = { -INFINITY, INFINITY } };
    return true;
}

struct sp_brick_file *sp_brick_file_of_chunks(const struct sp_chunk_source *source,
                                              const char *title, struct sp_error *err) {
    struct sp_brick_file *file = calloc(1, sizeof *file);
    pthread_rwlock_t *lock = malloc(sizeof *lock);
    if (!file || !lock || pthread_rwlock_init(lock, NULL) != 0) {
        free(file);
        free(lock);
        source->close(source->user);
        sp_fail(err, SP_ERR_MEMORY, title, "out of memory for its chunks");
        return NULL;
    }
    file->fd = -1;
    file->lock = lock;
    file->chunks = *source;
    file->header.info = source->info;
    file->header.info.voxel_bytes = sp_type_size(source->info.type);
    for (int a = 0; a < 3; a++)
        file->header.info.voxel_bytes *= source->info.grid.dims[a];
    file->header.levels = source->levels;
    snprintf(file->title, sizeof file->title, "%s", title);
    for (unsigned l = 0; l < source->levels; l++)
        if (!init_level(file, l, err)) {
            sp_brick_file_close(&file);
            return NULL;
        }
    return file;
}

const struct sp_chunk_source *sp_brick_file_chunks(const struct sp_brick_file *file) {
    return file->lock ? &file->chunks : NULL;
}

void sp_brick_file_begin(const struct sp_brick_file *file) {
    if (file->lock)
        pthread_rwlock_rdlock(file->lock);
}

void sp_brick_file_end(const struct sp_brick_file *file) {
    if (file->lock)
        pthread_rwlock_unlock(file->lock);
}

void sp_brick_file_learn(struct sp_brick_file *file, unsigned level, uint64_t number,
                         const struct sp_brick_ranges *ranges) {
    pthread_rwlock_wrlock(file->lock);
    sp_brick_learned_add(file->learned[level], &file->header.level[level], number, ranges,
                         file->entries[level]);
    pthread_rwlock_unlock(file->lock);
}

void sp_brick_file_close(struct sp_brick_file **pointer) {
    struct sp_brick_file *file = *pointer;
    *pointer = NULL;
    if (!file)
        return;
    if (file->fd >= 0)
        close(file->fd);
    if (file->lock) {
        file->chunks.close(file->chunks.user);
        pthread_rwlock_destroy(file->lock);
        free(file->lock);
    }
    for (int l = 0; l < BRICK_LEVELS_MAX; l++) {
        free(file->entries[l]);
        free(file->vectors[l]);
        sp_brick_learned_destroy(&file->learned[l]);
    }
    free(file->times);
    free(file->places);
    free(file);
}

const struct sp_brick_header *sp_brick_file_header(const struct sp_brick_file *file) {
    return &file->header;
}

const struct sp_brick_entry *sp_brick_file_entries(const struct sp_brick_file *file,
                                                   unsigned level) {
    return file->entries[level];
}

uint64_t sp_brick_file_bytes(const struct sp_brick_file *file) {
    uint64_t bytes = sizeof *file;
    if (file->places)
        bytes += sp_brick_places_count(&file->header) * sizeof *file->places;
    for (unsigned l = 0; l < file->header.levels; l++) {
        bytes += sp_brick_count(&file->header.level[l]) * sizeof *file->entries[l] *
                 (file->vectors[l] ? 2 : 1);
        bytes += file->lock ? sp_brick_learned_bytes(&file->header.level[l]) : 0;
    }
    return bytes + (file->lock ? file->chunks.bytes : 0);
}

struct sp_brick_scratch *sp_brick_scratch_create(struct sp_error *err) {
    struct sp_brick_scratch *s = calloc(1, sizeof *s);
    if (s && (s->context = ZSTD_createDCtx()))
        return s;
    free(s);
    sp_fail(err, SP_ERR_MEMORY, "", "out of memory for reading bricks");
    return NULL;
}

void sp_brick_scratch_destroy(struct sp_brick_scratch **scratch) {
    if (!*scratch)
        return;
    ZSTD_freeDCtx((*scratch)->context);
    free((*scratch)->packed);
    free(*scratch);
    *scratch = NULL;
}

/* Fills with the sample of a constant brick, whose bytes are the lowest ones of `sample`. */
static void fill_constant(uint64_t sample, size_t size, size_t count, void *out) {
    uint64_t stored = htole64(sample);
    if (size == 1) {
        memset(out, (int)(sample & 0xff), count);
        return;
    }
    for (size_t i = 0; i < count; i++)
        memcpy((char *)out + i * size, &stored, size);
}

static bool grow(struct sp_brick_scratch *scratch, size_t size, const char *title,
                 struct sp_error *err) {
    if (size <= scratch->capacity)
        return true;
    unsigned char *packed = realloc(scratch->packed, size);
    if (!packed)
        return sp_fail(err, SP_ERR_MEMORY, title, "out of memory for a brick");
    scratch->packed = packed;
    scratch->capacity = size;
    return true;
}

/* Unpacks the `size` bytes of an entry: brick `number` of a level. */
static bool unpack(const struct sp_brick_file *file, const struct sp_brick_entry *entry,
                   unsigned level, uint64_t number, struct sp_brick_scratch *scratch, void *out,
                   size_t size, struct sp_error *err) {
    const uint32_t *bricks = file->header.level[level].bricks;
    if (!grow(scratch, entry->bytes, file->title, err) ||
        !read_at(file, scratch->packed, entry->bytes, entry->at, err))
        return false;
    const size_t got =
        ZSTD_decompressDCtx(scratch->context, out, size, scratch->packed, entry->bytes);
    if (got == size)
        return true;
    return sp_fail(err, SP_ERR_FORMAT, file->title,
                   "brick (%" PRIu64 ", %" PRIu64 ", %" PRIu64
                   ") of level %u is damaged, convert the volume again: %s",
                   number % bricks[0], number / bricks[0] % bricks[1],
                   number / bricks[0] / bricks[1], level,
                   ZSTD_isError(got) ? ZSTD_getErrorName(got) : "it is too small");
}

static size_t count_samples(const struct sp_brick_file *file, unsigned level, uint64_t number) {
    uint32_t first[3], size[3];
    sp_brick_box(&file->header.level[level], number, first, size);
    return (size_t)size[0] * size[1] * size[2];
}

bool sp_brick_file_read(const struct sp_brick_file *file, unsigned level, uint64_t number,
                        struct sp_brick_scratch *scratch, void *out, struct sp_error *err) {
    const struct sp_brick_entry *entry = &file->entries[level][number];
    const size_t sample = sp_type_size(file->header.info.type);
    const size_t count = count_samples(file, level, number);
    if (entry->bytes)
        return unpack(file, entry, level, number, scratch, out, count * sample, err);
    fill_constant(entry->at, sample, count, out);
    return true;
}

bool sp_brick_file_read_vectors(const struct sp_brick_file *file, unsigned level, uint64_t number,
                                struct sp_brick_scratch *scratch, float (*out)[3],
                                struct sp_error *err) {
    const struct sp_brick_entry *entry = &file->vectors[level][number];
    const size_t size = count_samples(file, level, number) * sizeof *out;
    if (entry->bytes)
        return unpack(file, entry, level, number, scratch, out, size, err);
    memset(out, 0, size);
    return true;
}
