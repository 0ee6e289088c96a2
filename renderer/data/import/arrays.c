/* SPDX-License-Identifier: Apache-2.0
 *
 * HDF5 and NetCDF: one array of a file. The libraries are modules (array_bridge.h).
 */
#include "data/import/array_reader.h"

#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "data/import/confine.h"
#include "data/import/hdf5_grids.h"
#include "data/import/imaris.h"
#include "data/import/itk_hdf5.h"
#include "data/import/module.h"
#include "data/import/netcdf_size.h"
#include "data/volume/volume.h"

enum { BOX_BYTES = 32 << 20 }; /* numbers that are read at once, if a row is not larger */

/* Before the signature there may be a block of the user of 512, 1024, … bytes; MATLAB writes its
 * name there. */
static bool is_hdf5(const uint8_t *start, size_t size) {
    static const char signature[] = "\x89HDF\r\n\x1a\n";
    for (size_t at = 0; at + 8 <= size; at = at == 0 ? 512 : 2 * at)
        if (memcmp(start + at, signature, 8) == 0)
            return true;
    return false;
}

/* NetCDF-4 files are HDF5 files by their first bytes. */
static bool probe_netcdf(const uint8_t *start, size_t size, const char *title) {
    const bool is_classic = size >= 4 && memcmp(start, "CDF", 3) == 0 &&
                            (start[3] == 1 || start[3] == 2 || start[3] == 5);
    return is_classic || (is_hdf5(start, size) &&
                          (import_ends_with(title, ".nc") || import_ends_with(title, ".nc4") ||
                           import_ends_with(title, ".cdf")));
}

/* NetCDF-4 files begin in the same way, so only the name tells which of the two it is. */
static bool probe_hdf5(const uint8_t *start, size_t size, const char *title) {
    (void)title;
    return is_hdf5(start, size);
}

/* Reading. */

struct reading {
    const struct arrays *arrays;
    unsigned order[3];   /* dimensions of space in the order of the file */
    unsigned count;      /* of them */
    uint64_t strides[3]; /* of each in the volume [samples] */
    char *numbers;       /* owned: a box */
    char *row;           /* owned: samples of one row of the file */
    float (*vectors)[3]; /* NULL = reads samples */
    uint32_t channel;    /* or component of the vectors */
    char *voxels;        /* NULL = looks for default fill values only */
    bool has_fill;       /* and has found one */
    uint64_t done;       /* samples */
};

static void begin(struct reading *r) {
    const struct import_axes *axes = &r->arrays->axes;
    uint64_t stride[IMPORT_RANK_MAX] = { 0 }, step = 1;
    for (int a = 0; a < 3; a++)
        if (axes->space[a] >= 0) {
            stride[axes->space[a]] = step;
            step *= r->arrays->info.shape[axes->space[a]];
        }
    for (unsigned d = 0; d < r->arrays->info.rank; d++)
        if (stride[d]) {
            r->strides[r->count] = stride[d];
            r->order[r->count++] = d;
        }
}

/* Numbers of 8 bytes are compared by their bits, which float64 does not hold. */
static bool is_default_fill(const struct arrays *a, const char *at) {
    const struct import_number number = a->conversion.number;
    const bool is_signed = a->info.number.kind == IMPORT_SIGNED; /* whatever _Unsigned says */
    uint64_t bits = 0;
    if (number.size < sizeof bits)
        return import_widen(at, number) == a->default_fill;
    memcpy(&bits, at, sizeof bits);
    return bits ==
           (is_signed ? (uint64_t)INT64_C(-9223372036854775806) : UINT64_C(18446744073709551614));
}

/* Converts a row of numbers and puts it into the volume. */
static void put_row(struct reading *r, const char *from, uint64_t count, uint64_t at,
                    uint64_t stride) {
    const struct arrays *a = r->arrays;
    const struct import_conversion *c = &a->conversion;
    const size_t size = sp_type_size(c->type);
    if (!r->voxels && !r->vectors) {
        for (uint64_t i = 0; i < count && !r->has_fill; i++)
            r->has_fill = is_default_fill(a, from + i * c->number.size);
        return;
    }
    char *to = stride == 1 && !r->vectors ? r->voxels + at * size : r->row;
    if (import_conversion_is_copy(c))
        memcpy(to, from, count * size);
    else
        import_conversion_put(c, from, count, to);
    for (uint64_t i = 0; r->vectors && i < count; i++)
        memcpy(&r->vectors[at + i * stride][r->channel], to + i * size, size);
    for (uint64_t i = 0; !r->vectors && stride != 1 && i < count; i++)
        memcpy(r->voxels + (at + i * stride) * size, to + i * size, size);
}

/* A box of the file in the order of its dimensions of space; those that are missing have size 1. */
struct box {
    uint64_t first[3], size[3];
};

static bool read_box(struct reading *r, const struct box *box, struct sp_error *err) {
    const struct arrays *a = r->arrays;
    uint64_t start[IMPORT_RANK_MAX] = { 0 }, count[IMPORT_RANK_MAX], at = 0;
    struct sp_error why;
    for (unsigned d = 0; d < a->info.rank; d++)
        count[d] = 1;
    if (a->axes.channel >= 0)
        start[a->axes.channel] = r->channel;
    if (a->axes.time >= 0)
        start[a->axes.time] = a->file->step;
    for (unsigned i = 0; i < r->count; i++) {
        start[r->order[i]] = box->first[i];
        count[r->order[i]] = box->size[i];
        at += box->first[i] * r->strides[i];
    }
    if (!a->call->read(a->handle, a->chosen, start, count, r->numbers, &why))
        return arrays_fail(a, err, why.code, "%s", why.text);
    const unsigned last = r->count - 1;
    const uint64_t rows[2] = { r->count > 2 ? box->size[0] : 1,
                               r->count > 1 ? box->size[last - 1] : 1 };
    const char *from = r->numbers;
    for (uint64_t k = 0; k < rows[0]; k++)
        for (uint64_t j = 0; j < rows[1]; j++, from += box->size[last] * a->conversion.number.size)
            put_row(r, from, box->size[last],
                    at + (r->count > 2 ? k * r->strides[0] : 0) +
                        (r->count > 1 ? j * r->strides[last - 1] : 0),
                    r->strides[last]);
    r->done += rows[0] * rows[1] * box->size[last];
    return true;
}

/* How many numbers along dimension i of the order are read at once, where one takes `bytes`: whole
 * chunks if they fit. */
static uint64_t step_of(const struct reading *r, unsigned i, uint64_t bytes) {
    const struct array_info *info = &r->arrays->info;
    const uint64_t shape = info->shape[r->order[i]], chunk = info->chunk[r->order[i]];
    uint64_t step = bytes < BOX_BYTES ? BOX_BYTES / bytes : 1;
    if (chunk > 0 && step > chunk)
        step -= step % chunk;
    return step < shape ? step : shape;
}

static bool read_boxes(struct reading *r, const uint64_t steps[3],
                       const struct import_progress *progress, struct sp_error *err) {
    uint64_t shape[3] = { 1, 1, 1 };
    struct box box;
    for (unsigned i = 0; i < r->count; i++)
        shape[i] = r->arrays->info.shape[r->order[i]];
    for (box.first[0] = 0; box.first[0] < shape[0] && !r->has_fill; box.first[0] += steps[0])
        for (box.first[1] = 0; box.first[1] < shape[1]; box.first[1] += steps[1])
            for (box.first[2] = 0; box.first[2] < shape[2]; box.first[2] += steps[2]) {
                for (int i = 0; i < 3; i++) {
                    const uint64_t left = shape[i] - box.first[i];
                    box.size[i] = steps[i] < left ? steps[i] : left;
                }
                if (!read_box(r, &box, err))
                    return false;
                import_report(progress, r->done * sp_type_size(r->arrays->conversion.type));
            }
    return true;
}

static bool read_all(struct reading *r, const struct import_progress *progress,
                     struct sp_error *err) {
    uint64_t steps[3] = { 1, 1, 1 }, bytes = r->arrays->conversion.number.size;
    begin(r);
    for (unsigned i = r->count; i-- > 0; bytes *= steps[i]) /* all of the fastest ones */
        steps[i] = i + 1 == r->count ? r->arrays->info.shape[r->order[i]] : step_of(r, i, bytes);
    r->numbers = malloc(bytes);
    r->row = malloc(steps[r->count - 1] * sizeof(double));
    bool ok = (r->numbers && r->row) ||
              sp_fail(err, SP_ERR_MEMORY, r->arrays->file->title, "out of memory for numbers");
    ok = ok && read_boxes(r, steps, progress, err);
    free(r->numbers);
    free(r->row);
    return ok;
}

static bool read_arrays(void *reader, void *voxels, float (*vectors)[3],
                        const struct import_progress *progress, struct sp_error *err) {
    const struct arrays *a = reader;
    bool ok = true;
    for (uint32_t c = 0; ok && c < (a->axes.are_vectors ? 3 : 1); c++) {
        struct reading r = { .arrays = a, .voxels = voxels, .channel = a->channel };
        if (a->axes.are_vectors) {
            r.vectors = vectors;
            r.channel = c;
        }
        ok = read_all(&r, progress, err);
    }
    return ok;
}

/* Opening. */

/* Whole numbers without a fill value of their own: reads them to find out whether some were never
 * written. All steps of a series have one type, so they are floating-point numbers in any case. */
static bool look_for_default_fill(struct arrays *a, const struct import_header *header,
                                  struct sp_error *err) {
    const bool is_series = header->steps.count > 1;
    struct reading r = { .arrays = a, .channel = a->channel, .has_fill = is_series };
    if (isnan(a->default_fill))
        return true;
    if (!is_series && !read_all(&r, NULL, err))
        return false;
    if (r.has_fill && !is_series)
        import_warn(a->file->warnings,
                    "Samples of %.0f were left out: NetCDF has this number where nothing was "
                    "written, and the array has no _FillValue of its own.",
                    a->default_fill);
    if (r.has_fill)
        arrays_use_default_fill(a);
    return true;
}

static bool can_open(const char *root, const char *path, char real[PATH_MAX]) {
    uint64_t size;
    struct sp_error ignored;
    const int fd = sp_open_confined(root, path, path, real, &size, &ignored);
    if (fd >= 0)
        close(fd);
    return fd >= 0;
}

/* A file that this one names. HDF5 tries an absolute name first and then its last part, beside this
 * file. It must not reach a file outside of the root by the first, which Landlock prevents: there
 * no such file opens, whether it exists or not. */
static bool find_source(const struct array_place *place, const char *name, char real[PATH_MAX]) {
    const struct arrays *a = place->user;
    char path[2 * PATH_MAX];
    if (*name == '/') {
        if (can_open(a->file->root, name, real))
            return true;
        const int fd = open(name, O_RDONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
        if (fd >= 0) {
            close(fd);
            return false;
        }
        name = strrchr(name, '/') + 1;
    }
    snprintf(path, sizeof path, "%s/%s", place->folder, name);
    return can_open(a->file->root, path, real);
}

static bool open_arrays(struct arrays *a, const struct import_file *file,
                        struct import_header *header, struct sp_error *err) {
    a->file = file;
    a->title = file->title;
    struct sp_error why;
    a->call = a->is_netcdf ? import_module_load(a->file, NETCDF_BRIDGE_MODULE, NETCDF_BRIDGE_SYMBOL,
                                                "NetCDF", "libnetcdf19", err)
                           : import_module_load(a->file, HDF5_BRIDGE_MODULE, HDF5_BRIDGE_SYMBOL,
                                                "HDF5", "libhdf5-103-1", err);
    if (!a->call || (a->is_netcdf && !netcdf_size_check(a->file, err)))
        return false;
    /* Opens by descriptor, because the name may refer to another file by now. */
    snprintf(a->path, sizeof a->path, "/proc/self/fd/%d", a->file->fd);
    a->place = (struct array_place){
        .path = a->path, .folder = a->file->folder, .find = find_source, .user = a
    };
    a->handle = a->call->open(&a->place, &why);
    if (!a->handle)
        return sp_fail(err, why.code, a->file->title, "%s", why.text);
    struct imaris *imaris;
    if (!imaris_open(a, &imaris, err) || !arrays_choose(a, err))
        return false;
    itk_hdf5_name_dimensions(a);
    hdf5_grids_name_dimensions(a);
    if (!arrays_fill_header(a, header, err) || (imaris && !imaris_place(imaris, a, header, err)))
        return false;
    itk_hdf5_place(a, header);
    hdf5_grids_place(a, header);
    if (!sp_grid_check(&header->grid, header->type, a->file->title, &header->bytes, err) ||
        !look_for_default_fill(a, header, err))
        return false;
    header->type = a->conversion.type;
    return sp_grid_check(&header->grid, header->type, a->file->title, &header->bytes, err);
}

static void close_arrays(void *reader) {
    struct arrays *a = reader;
    if (a->handle)
        a->call->close(a->handle);
    arrays_finish(a);
}

static bool open_hdf5(void *reader, const struct import_file *file, struct import_header *header,
                      struct sp_error *err) {
    return open_arrays(reader, file, header, err);
}

static bool open_netcdf(void *reader, const struct import_file *file, struct import_header *header,
                        struct sp_error *err) {
    struct arrays *a = reader;
    a->is_netcdf = a->takes_first = true;
    return open_arrays(a, file, header, err);
}

const struct import_format import_hdf5 = { .name = "HDF5",
                                           .needs_module = true,
                                           .probe = probe_hdf5,
                                           .reader_size = sizeof(struct arrays),
                                           .open = open_hdf5,
                                           .read = read_arrays,
                                           .close = close_arrays };
const struct import_format import_netcdf = { .name = "NetCDF",
                                             .needs_module = true,
                                             .probe = probe_netcdf,
                                             .reader_size = sizeof(struct arrays),
                                             .open = open_netcdf,
                                             .read = read_arrays,
                                             .close = close_arrays };
