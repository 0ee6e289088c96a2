/* SPDX-License-Identifier: Apache-2.0 */
#include "fuzz/import_fuzz.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "data/import/elements.h"
#include "data/import/shift.h"
#include "data/import/vectors.h"
#include "data/volume/elements.h"
#include "data/volume/volume.h"

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
    void *voxels = calloc(1, header->bytes); /* 0, as shared memory is */
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

static void read_elements(const struct import_format *format, const struct import_file *file,
                          void *reader, const struct import_header *header) {
    const struct import_progress progress = { .report = ignore };
    struct sp_error err = { .code = SP_OK };
    uint64_t folded;
    void *memory = aligned_alloc(64, sp_elements_bytes(&header->elements));
    if (!memory)
        return;
    memset(memory, 0, sp_elements_bytes(&header->elements));
    const struct sp_elements elements = sp_elements_at(&header->elements, memory);
    const size_t count = elements.triangles ? elements.shape.vertex_count : elements.shape.count;
    bool ok = format->read_elements(reader, &elements, &progress, &err);
    while (ok &&
           import_shift_choose(file->shift, elements.positions, sizeof *elements.positions, count))
        ok = format->read_elements(reader, &elements, &progress, &err);
    import_shift_warn(file);
    ok = ok && import_elements_finish(file, header, &elements, &progress, &folded, &err);
    if (!ok && err.code == SP_OK)
        abort();
    free(memory);
}

static void check_header(const struct import_header *header, const char *title) {
    struct sp_error err;
    uint64_t bytes;
    if (header->elements.kind != SP_KIND_GRID && sp_elements_shape_problem(&header->elements))
        abort();
    if (!sp_grid_check(&header->grid, header->type, title, &bytes, &err) ||
        bytes != header->bytes || !memchr(header->unit, 0, sizeof header->unit) ||
        !memchr(header->value_name, 0, sizeof header->value_name) ||
        !memchr(header->vector_name, 0, sizeof header->vector_name) ||
        (header->derived && header->elements.kind == SP_KIND_GRID &&
         !(header->has_vectors && header->type == SP_FLOAT32)))
        abort();
}

int fuzz_import(const struct import_format *format, const char *title, const uint8_t *data,
                size_t size) {
    if (!folder[0])
        make_folder();
    int fd = memfd_create("fuzz", MFD_CLOEXEC);
    if (fd < 0 || write(fd, data, size) != (ssize_t)size || lseek(fd, 0, SEEK_SET) != 0)
        abort();
    struct import_warnings warnings = { .count = 0 };
    struct import_shift shift = { .is_found = false };
    const struct import_file file = { .fd = fd,
                                      .size = size,
                                      .title = title,
                                      .root = folder,
                                      .folder = folder,
                                      .field = size % 2 ? "s" : "v x",
                                      .vectors = "",
                                      .pattern = "",
                                      .selection = { .series = "", .unit = "" },
                                      .step = size % 8 == 7,
                                      .shift = &shift,
                                      .warnings = &warnings };
    struct import_header header = { .bytes = 0 };
    struct sp_error err = { .code = SP_OK };
    void *reader = import_format_open(format, &file, &header, &err);
    if (!reader && err.code == SP_OK)
        abort();
    if (reader) {
        check_header(&header, title);
        if (header.elements.kind == SP_KIND_GRID) {
            if (header.bytes <= READ_MAX)
                read_samples(format, reader, &header);
        } else if (sp_elements_bytes(&header.elements) <= READ_MAX) {
            read_elements(format, &file, reader, &header);
        }
        import_format_close(format, reader);
    }
    close(fd);
    return 0;
}
