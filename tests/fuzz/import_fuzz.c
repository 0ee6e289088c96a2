/* SPDX-License-Identifier: Apache-2.0 */
#include "fuzz/import_fuzz.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "import/vectors.h"
#include "volume/volume.h"

enum { READ_MAX = 1 << 20 }; /* bytes of samples */

static char folder[64];

static void remove_folder(void) {
    char path[128];
    snprintf(path, sizeof path, "%s/d.raw", folder);
    unlink(path);
    rmdir(folder);
}

static void make_folder(void) {
    char path[128];
    snprintf(folder, sizeof folder, "/tmp/splat-fuzz-XXXXXX");
    if (!mkdtemp(folder))
        abort();
    snprintf(path, sizeof path, "%s/d.raw", folder);
    FILE *file = fopen(path, "wb");
    if (!file || fwrite(path, 1, 64, file) != 64 || fclose(file) != 0)
        abort();
    atexit(remove_folder);
}

static void ignore(void *user, uint64_t bytes_done) {
    (void)user;
    (void)bytes_done;
}

static void read_samples(const struct import_format *format, void *reader,
                         const struct import_header *header) {
    const struct import_progress progress = { .report = ignore };
    struct sp_error err = { .code = SP_OK };
    uint64_t count = header->bytes / sp_type_size(header->type);
    /* Exact sizes, so that a write past the end is found. */
    void *voxels = malloc(header->bytes);
    float(*vectors)[3] = header->has_vectors ? malloc(count * sizeof *vectors) : NULL;
    if (voxels && (vectors || !header->has_vectors)) {
        bool ok = format->read(reader, voxels, vectors, &progress, &err);
        if (!ok && err.code == SP_OK)
            abort();
        if (ok && vectors)
            import_vectors_finish(header, vectors, voxels);
    }
    free(vectors);
    free(voxels);
}

int fuzz_import(const struct import_format *format, const char *shown, const uint8_t *data,
                size_t size) {
    if (!folder[0])
        make_folder();
    int fd = memfd_create("fuzz", MFD_CLOEXEC);
    if (fd < 0 || write(fd, data, size) != (ssize_t)size || lseek(fd, 0, SEEK_SET) != 0)
        abort();
    const struct import_file file = {
        .fd = fd, .size = size, .shown = shown, .root = folder, .folder = folder
    };
    struct import_header header = { .bytes = 0 };
    struct sp_error err = { .code = SP_OK };
    void *reader = format->open(&file, &header, &err);
    if (!reader && err.code == SP_OK)
        abort();
    if (reader) {
        uint64_t bytes;
        if (!sp_grid_check(&header.grid, header.type, shown, &bytes, &err) ||
            bytes != header.bytes || !memchr(header.unit, 0, sizeof header.unit) ||
            !memchr(header.value_name, 0, sizeof header.value_name) ||
            !memchr(header.vector_name, 0, sizeof header.vector_name) ||
            (header.samples_are_lengths && !(header.has_vectors && header.type == SP_FLOAT32)))
            abort();
        if (bytes <= READ_MAX)
            read_samples(format, reader, &header);
        format->close(reader);
    }
    close(fd);
    return 0;
}
