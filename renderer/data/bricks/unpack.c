/* SPDX-License-Identifier: Apache-2.0 */
#include "data/bricks/unpack.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/transfer.h"
#include "data/bricks/file.h"
#include "data/volume/grid.h"
#include "data/volume/volume.h"

struct unpacking {
    struct sp_brick_file *file;
    struct sp_brick_scratch *scratch;
    const char *title;
    const struct sp_brick_level *level;
    bool is_vectors;    /* the array that is read now: samples, or vectors */
    size_t sample;      /* bytes of its samples */
    uint64_t at;        /* in the output */
    double from, share; /* of the progress */
    char *brick;        /* its samples */
    char *row;          /* samples of all bricks that lie side by side along x */
    int out;
};

/* Reads a brick and copies it to its place in the row. */
static bool read_brick(struct unpacking *u, uint64_t number, struct sp_error *err) {
    uint32_t first[3], size[3];
    sp_brick_box(u->level, number, first, size);
    if (!(u->is_vectors ? sp_brick_file_read_vectors(u->file, 0, number, u->scratch,
                                                     (float(*)[3])(void *)u->brick, err)
                        : sp_brick_file_read(u->file, 0, number, u->scratch, u->brick, err)))
        return false;
    const size_t line = size[0] * u->sample;
    const char *from = u->brick;
    for (uint32_t z = 0; z < size[2]; z++)
        for (uint32_t y = 0; y < size[1]; y++, from += line)
            memcpy(u->row + (((size_t)z * size[1] + y) * u->level->dims[0] + first[0]) * u->sample,
                   from, line);
    return true;
}

static bool write_row(const struct unpacking *u, uint64_t number, struct sp_error *err) {
    const uint32_t *dims = u->level->dims;
    uint32_t first[3], size[3];
    sp_brick_box(u->level, number, first, size);
    const size_t part = (size_t)size[1] * dims[0] * u->sample;
    for (uint32_t z = 0; z < size[2]; z++) {
        const uint64_t at = ((uint64_t)(first[2] + z) * dims[1] + first[1]) * dims[0] * u->sample;
        if (!sp_write_sparse(u->out, u->row + z * part, part, u->at + at))
            return sp_fail(err, SP_ERR_IO, u->title, "cannot write its samples: %s",
                           strerror(errno));
    }
    return true;
}

static bool unpack(struct unpacking *u, const struct sp_load_options *options,
                   struct sp_error *err) {
    const uint32_t *bricks = u->level->bricks;
    const uint64_t rows = (uint64_t)bricks[1] * bricks[2];
    for (uint64_t row = 0; row < rows; row++) {
        const double done = u->from + u->share * (double)row / (double)rows;
        if (options->progress && !options->progress(options->user, done))
            return sp_fail(err, SP_ERR_CANCELLED, u->title, "cancelled");
        for (uint32_t b = 0; b < bricks[0]; b++)
            if (!read_brick(u, row * bricks[0] + b, err))
                return false;
        if (!write_row(u, row * bricks[0], err))
            return false;
    }
    return true;
}

/* Unpacks the samples, then the vectors. */
static bool unpack_all(struct unpacking *u, const struct sp_volume_info *info,
                       const struct sp_load_options *options, struct sp_error *err) {
    const double all = (double)info->voxel_bytes + (double)info->vector_bytes;
    const size_t sample = sp_type_size(info->type);
    u->sample = sample;
    u->share = (double)info->voxel_bytes / all;
    if (!unpack(u, options, err))
        return false;
    u->is_vectors = true;
    u->sample = BRICK_VECTOR_BYTES;
    u->from = u->share;
    u->share = 1 - u->share;
    sp_volume_layout(info->voxel_bytes, info->voxel_bytes / sample, true, &u->at);
    return !info->vector_bytes || unpack(u, options, err);
}

static bool start(struct unpacking *u, const struct sp_volume_info *info, const char *folder,
                  struct sp_error *err) {
    const size_t side = BRICK_SIDE, item = sp_brick_item_max(info);
    const uint64_t voxels = info->voxel_bytes / sp_type_size(info->type);
    uint64_t vectors_at;
    const uint64_t size =
        sp_volume_layout(info->voxel_bytes, voxels, info->vector_bytes > 0, &vectors_at);
    u->brick = malloc(side * side * side * item);
    u->row = malloc(side * side * info->grid.dims[0] * item);
    if (!u->brick || !u->row)
        return sp_fail(err, SP_ERR_MEMORY, u->title, "out of memory for a row of bricks");
    u->scratch = sp_brick_scratch_create(err);
    u->out = u->scratch ? sp_temporary_file(folder, err) : -1;
    return u->out >= 0 &&
           (ftruncate(u->out, (off_t)size) == 0 ||
            sp_fail(err, SP_ERR_IO, u->title, "cannot write its samples: %s", strerror(errno)));
}

/* Copies the coordinates, which the file owns. */
static bool copy_axes(struct sp_volume_info *info, double **numbers, const char *title,
                      struct sp_error *err) {
    *numbers = malloc(sp_grid_axes_max(&info->grid) * sizeof **numbers);
    if (!*numbers)
        return sp_fail(err, SP_ERR_MEMORY, title, "out of memory for the axes");
    sp_grid_copy_axes(&info->grid, *numbers);
    return true;
}

int sp_bricks_unpack(int file, const char *title, const char *folder, bool keeps_axes,
                     const struct sp_load_options *options, struct sp_volume_info *info,
                     double **numbers, struct sp_error *err) {
    struct unpacking u = { .title = title, .out = -1 };
    u.file = sp_brick_file_open(file, title, err);
    if (!u.file)
        return -1;
    *info = sp_brick_file_header(u.file)->info;
    info->steps.times = NULL; /* the file has them */
    u.level = &sp_brick_file_header(u.file)->level[0];
    const bool is_refused = !keeps_axes && sp_grid_is_rectilinear(&info->grid);
    const bool ok = sp_grid_require_even(is_refused, title, err) &&
                    copy_axes(info, numbers, title, err) && start(&u, info, folder, err) &&
                    unpack_all(&u, info, options, err);
    if (!ok && u.out >= 0) {
        close(u.out);
        u.out = -1;
    }
    sp_brick_scratch_destroy(&u.scratch);
    sp_brick_file_close(&u.file);
    free(u.brick);
    free(u.row);
    return u.out;
}
