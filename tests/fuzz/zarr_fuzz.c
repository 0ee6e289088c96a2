/* SPDX-License-Identifier: Apache-2.0
 *
 * A Zarr hierarchy in memory. The input is a list of objects: the length of the key (1 byte), the
 * length of the object (2 bytes, little-endian), the key, the object. The compressors are linked,
 * so the target also runs them.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/module.h"
#include "data/import/zarr.h"
#include "data/import/zarr_bridge.h"
#include "data/volume/volume.h"

enum { READ_MAX = 1 << 20 };

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

struct input {
    const uint8_t *data;
    size_t size;
};

/* Finds an object; NULL = there is none. */
static const uint8_t *find_object(const struct input *in, const char *key, size_t *size) {
    for (size_t at = 0; at + 3 <= in->size;) {
        const size_t name = in->data[at], bytes = in->data[at + 1] + 256U * in->data[at + 2];
        const uint8_t *start = in->data + at + 3;
        if (in->size - at - 3 < name + bytes)
            return NULL;
        if (strlen(key) == name && memcmp(start, key, name) == 0) {
            *size = bytes;
            return start + name;
        }
        at += 3 + name + bytes;
    }
    return NULL;
}

static enum zarr_found size_of(void *user, const char *key, uint64_t *size, struct sp_error *err) {
    size_t bytes = 0;
    const bool is_there = find_object(user, key, &bytes) != NULL;
    (void)err;
    *size = bytes;
    return is_there ? ZARR_FOUND : ZARR_MISSING;
}

static enum zarr_found read_from(void *user, const char *key, uint64_t offset, void *out,
                                 size_t size, size_t *got, struct sp_error *err) {
    size_t bytes = 0;
    const uint8_t *object = find_object(user, key, &bytes);
    (void)err;
    *got = 0;
    if (!object)
        return ZARR_MISSING;
    if (offset < bytes) {
        *got = bytes - (size_t)offset < size ? bytes - (size_t)offset : size;
        memcpy(out, object + offset, *got);
    }
    return ZARR_FOUND;
}

static void list(void *user, const char *key, bool (*visit)(void *to, const char *name), void *to) {
    (void)user;
    (void)key;
    if (visit(to, "0"))
        visit(to, "s");
}

/* In place of module.c. */
const void *import_module_load(const struct import_file *file, const char *module,
                               const char *symbol, const char *library, const char *package,
                               struct sp_error *err) {
    (void)module;
    (void)symbol;
    (void)library;
#ifdef SPLATD_ZARR_BRIDGE
    (void)file;
    (void)package;
    (void)err;
    return &splat_zarr_bridge;
#else
    sp_fail(err, SP_ERR_UNSUPPORTED, file->title, "needs %s", package);
    return NULL;
#endif
}

static void ignore(void *user, uint64_t bytes_done) {
    (void)user;
    (void)bytes_done;
}

/* As for a volume that is shown from its chunks: the outer chunks of each level. */
static void read_chunks(void *reader, enum sp_type type) {
    struct sp_chunk_source source = { .info = { .type = type } };
    source.levels = import_zarr.levels(reader, source.level, BRICK_LEVELS_MAX);
    const uint64_t bytes = sp_chunk_bytes_max(&source);
    void *chunk = bytes > 0 && bytes <= READ_MAX ? malloc(bytes) : NULL;
    for (unsigned l = 0; chunk && l < source.levels; l++)
        for (uint32_t last = 0; last < 2; last++) {
            const struct sp_chunk_level *level = &source.level[l];
            uint32_t place[3];
            struct sp_error err = { .code = SP_OK };
            for (int a = 0; a < 3; a++)
                place[a] = last * ((level->dims[a] - 1) / level->chunk[a]);
            if (!import_zarr.read_chunk(reader, l, place, chunk, &err) && err.code == SP_OK)
                abort();
        }
    free(chunk);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct input input = { data, size };
    const struct zarr_store store = {
        .user = &input, .title = "input", .size = size_of, .read = read_from, .list = list
    };
    const struct import_file file = {
        .fd = -1, .title = "input", .folder = "/image/0", .field = "s", .level = -1
    };
    const struct import_progress progress = { .report = ignore };
    struct import_header header = { .bytes = 0 };
    struct sp_error err = { .code = SP_OK };
    uint64_t bytes;
    void *reader = calloc(1, import_zarr.reader_size);
    import_header_init(&header);
    if (!reader || !zarr_open(reader, &store, &file, &header, &err)) {
        if (!reader || err.code == SP_OK)
            abort();
        zarr_close(reader);
        free(reader);
        return 0;
    }
    if (!sp_grid_check(&header.grid, header.type, "input", &bytes, &err) || bytes != header.bytes)
        abort();
    void *voxels = header.bytes <= READ_MAX ? malloc(header.bytes) : NULL;
    err.code = SP_OK;
    if (voxels && !zarr_read(reader, voxels, NULL, &progress, &err) && err.code == SP_OK)
        abort();
    free(voxels);
    read_chunks(reader, header.type);
    zarr_close(reader);
    free(reader);
    return 0;
}
