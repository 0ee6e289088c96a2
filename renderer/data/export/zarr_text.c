/* SPDX-License-Identifier: Apache-2.0 */
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "data/export/zarr.h"
#include "data/volume/unit.h"

#define ALMOST 1e-6

/* The anatomical direction of each axis of the grid: false unless all point along an axis of the
 * world. */
static bool choose_letters(const struct sp_volume_info *info, char letters[4]) {
    static const char opposites[] = "RLAPSI";
    for (int axis = 0; axis < 3; axis++) {
        letters[axis] = 0;
        for (int row = 0; row < 3 && info->anatomy[0]; row++) {
            const double along = info->grid.direction[row][axis];
            const size_t letter = (size_t)(strchr(opposites, info->anatomy[row]) - opposites);
            if (fabs(along) > 1 - ALMOST)
                letters[axis] = opposites[along > 0 ? letter : letter ^ 1];
        }
        if (!letters[axis])
            return false;
    }
    letters[3] = 0;
    return true;
}

/* OME-Zarr has a scale and a translation, no directions; but its axes may have an orientation. */
static bool set_place(struct sp_zarr_image *image, struct sp_error *err) {
    double direction[3][3];
    if (!choose_letters(image->job->info, image->anatomy))
        image->anatomy[0] = 0;
    sp_export_place(image->job->info,
                    image->anatomy[0] ? image->anatomy : image->job->info->anatomy, direction,
                    image->level[0].origin);
    for (int row = 0; row < 3; row++)
        for (int axis = 0; axis < 3; axis++)
            if (fabs(direction[row][axis] - (row == axis)) > ALMOST)
                return sp_fail(err, SP_ERR_UNSUPPORTED, image->job->title,
                               "the axes of OME-Zarr are those of the world, and those of this "
                               "volume are turned; write .nrrd or .nii.gz, which keep that");
    return true;
}

bool sp_zarr_image_init(struct sp_zarr_image *image, const struct sp_export_job *job,
                        struct sp_error *err) {
    const struct sp_grid *grid = &job->info->grid;
    *image = (struct sp_zarr_image){ .job = job };
    memcpy(image->level[0].dims, grid->dims, sizeof grid->dims);
    memcpy(image->level[0].spacing, grid->spacing, sizeof grid->spacing);
    if (!set_place(image, err))
        return false;
    for (bool is_last = false; !is_last;) {
        struct sp_zarr_level *level = &image->level[image->levels++];
        is_last = true;
        for (int a = 0; a < 3; a++) {
            level->chunk[a] = level->dims[a] < ZARR_CHUNK ? level->dims[a] : ZARR_CHUNK;
            is_last = is_last && level->dims[a] <= ZARR_CHUNK;
        }
        for (int a = 0; a < 3 && !is_last; a++) {
            /* A coarse sample lies in the middle of the fine samples that it replaces. */
            const bool is_halved = level->dims[a] > 1;
            level[1].dims[a] = (level->dims[a] + 1) / 2;
            level[1].spacing[a] = level->spacing[a] * (is_halved ? 2 : 1);
            level[1].origin[a] = level->origin[a] + (is_halved ? level->spacing[a] / 2 : 0);
        }
    }
    return true;
}

/* Length of the character in UTF-8 that begins here; 0 = this is none. */
static size_t character(const unsigned char *c) {
    const size_t n = c[0] < 0x80                    ? 1
                     : c[0] >= 0xc2 && c[0] < 0xe0  ? 2
                     : (c[0] & 0xf0) == 0xe0        ? 3
                     : c[0] >= 0xf0 && c[0] <= 0xf4 ? 4
                                                    : 0;
    for (size_t i = 1; i < n; i++)
        if ((c[i] & 0xc0) != 0x80)
            return 0;
    return n;
}

static void put_text(FILE *file, const char *text) {
    const unsigned char *c = (const unsigned char *)text;
    fputc('"', file);
    while (*c) {
        const size_t n = character(c);
        if (n == 1 && (*c < 0x20 || *c == '"' || *c == '\\'))
            fprintf(file, "\\u%04x", *c);
        else if (n > 0)
            fwrite(c, 1, n, file);
        else
            fputc('?', file);
        c += n > 0 ? n : 1;
    }
    fputc('"', file);
}

/* Arrays are z, y, x. */
static void put_counts(FILE *file, const char *key, const uint32_t n[3]) {
    fprintf(file, "  \"%s\": [%u, %u, %u],\n", key, n[2], n[1], n[0]);
}

static void put_transformation(FILE *file, const char *type, const double n[3]) {
    fprintf(file, "{ \"type\": \"%s\", \"%s\": [%.17g, %.17g, %.17g] }", type, type, n[2], n[1],
            n[0]);
}

/* RFC-4 of OME-Zarr: readers of 0.4 pass over what they do not know. */
static void put_orientation(FILE *file, char toward) {
    static const char letters[] = "RLAPSI";
    static const char *const names[] = { "right",     "left",     "anterior",
                                         "posterior", "superior", "inferior" };
    const size_t i = (size_t)(strchr(letters, toward) - letters);
    fprintf(file, ", \"orientation\": { \"type\": \"anatomical\", \"value\": \"%s-to-%s\" }",
            names[i ^ 1], names[i]);
}

static void put_axes(FILE *file, const struct sp_zarr_image *image) {
    const char *name = image->job->info->unit;
    const struct sp_unit *unit = sp_unit_find(name);
    for (int a = 2; a >= 0; a--) {
        fprintf(file, "        { \"name\": \"%c\", \"type\": \"space\"", "xyz"[a]);
        if (*name) {
            fprintf(file, ", \"unit\": ");
            put_text(file, unit ? sp_unit_full_name(unit) : name);
        }
        if (image->anatomy[0])
            put_orientation(file, image->anatomy[a]);
        fprintf(file, " }%s\n", a ? "," : "");
    }
}

static void put_channel(FILE *file, const struct sp_zarr_image *image) {
    const bool has_range = image->range[0] <= image->range[1];
    const double low = has_range ? image->range[0] : 0, high = has_range ? image->range[1] : 0;
    if (image->job->info->meaning == SP_MEANING_LABELS)
        fprintf(file, "  \"image-label\": { \"version\": \"0.4\" },\n");
    fprintf(file, "  \"omero\": {\n    \"channels\": [\n      {\n");
    if (image->job->info->value_name[0]) {
        fprintf(file, "        \"label\": ");
        put_text(file, image->job->info->value_name);
        fprintf(file, ",\n");
    }
    fprintf(file,
            "        \"active\": true,\n        \"color\": \"FFFFFF\",\n"
            "        \"window\": { \"min\": %.17g, \"max\": %.17g, \"start\": %.17g, \"end\": "
            "%.17g }\n      }\n    ]\n  }\n}\n",
            low, high, low, high);
}

static void put_attributes(FILE *file, const struct sp_zarr_image *image) {
    fprintf(file, ZARR_ATTRIBUTES_START "  \"multiscales\": [\n    {\n"
                                        "      \"version\": \"0.4\",\n      \"name\": ");
    put_text(file, image->job->info->name);
    fprintf(file, ",\n      \"axes\": [\n");
    put_axes(file, image);
    fprintf(file, "      ],\n      \"datasets\": [\n");
    for (unsigned l = 0; l < image->levels; l++) {
        fprintf(file, "        { \"path\": \"%u\", \"coordinateTransformations\": [\n          ",
                l);
        put_transformation(file, "scale", image->level[l].spacing);
        fprintf(file, ",\n          ");
        put_transformation(file, "translation", image->level[l].origin);
        fprintf(file, "\n        ] }%s\n", l + 1 < image->levels ? "," : "");
    }
    fprintf(file, "      ],\n      \"type\": \"mean\"\n    }\n  ],\n");
    put_channel(file, image);
}

static void put_array(FILE *file, const struct sp_zarr_level *level, enum sp_type type) {
    static const char *const types[SP_TYPE_COUNT] = { "u1", "i1", "u2", "i2", "i4", "f4", "f8" };
    const char order = sp_type_size(type) == 1                  ? '|'
                       : __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__ ? '>'
                                                                : '<';
    fprintf(file, "{\n  \"zarr_format\": 2,\n");
    put_counts(file, "shape", level->dims);
    put_counts(file, "chunks", level->chunk);
    fprintf(file,
            "  \"dtype\": \"%c%s\",\n  \"compressor\": { \"id\": \"zstd\", \"level\": %d },\n"
            "  \"fill_value\": 0,\n  \"order\": \"C\",\n  \"filters\": null,\n"
            "  \"dimension_separator\": \"/\"\n}\n",
            order, types[type], ZARR_ZSTD_LEVEL);
}

/* Closes a file of text; false with *err set if it could not be written. */
static bool finish(FILE *file, const struct sp_zarr_image *image, struct sp_error *err) {
    const bool is_written = file && fflush(file) == 0 && !ferror(file);
    const int why = errno;
    const bool is_closed = file && fclose(file) == 0;
    return (is_written && is_closed) || sp_fail(err, SP_ERR_IO, image->job->title,
                                                "cannot write: %s", strerror(file ? why : errno));
}

static FILE *create(int folder, const char *path) {
    const int fd = openat(folder, path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    FILE *file = fd < 0 ? NULL : fdopen(fd, "w");
    if (fd >= 0 && !file)
        close(fd);
    return file;
}

bool sp_zarr_write_text(const struct sp_zarr_image *image, struct sp_error *err) {
    const int folder = image->job->out;
    FILE *file;
    for (unsigned l = 0; l < image->levels; l++) {
        char path[32];
        snprintf(path, sizeof path, "%u/.zarray", l);
        if ((file = create(folder, path)))
            put_array(file, &image->level[l], image->job->info->type);
        if (!finish(file, image, err))
            return false;
        snprintf(path, sizeof path, "%u/.zattrs", l);
        if ((file = create(folder, path))) /* for xarray */
            fprintf(file, "{ \"_ARRAY_DIMENSIONS\": [\"z\", \"y\", \"x\"] }\n");
        if (!finish(file, image, err))
            return false;
    }
    if ((file = create(folder, ".zgroup")))
        fprintf(file, "{ \"zarr_format\": 2 }\n");
    if (!finish(file, image, err))
        return false;
    if ((file = create(folder, ".zattrs")))
        put_attributes(file, image);
    return finish(file, image, err);
}
