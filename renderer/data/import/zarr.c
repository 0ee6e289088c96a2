/* SPDX-License-Identifier: Apache-2.0
 *
 * Zarr v2 and v3, plain or OME-Zarr 0.4 and 0.5: a folder, of which the file that is open is one
 * with metadata. Chunks are read one by one.
 *
 * Why this parser is our own: parsers.md.
 */
#include "data/import/zarr.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/array_reader.h"
#include "data/import/derived.h"
#include "data/import/remote.h"
#include "data/import/zarr_chunk.h"
#include "data/import/zarr_fields.h"
#include "data/import/zarr_image.h"
#include "data/import/zarr_remote.h"
#include "data/volume/volume.h"

struct reading;

struct zarr {
    const struct zarr_store *store;
    struct zarr_store *folder; /* owned; NULL = the caller's store */
    void (*close_store)(struct zarr_store **store);
    const struct import_file *file;
    struct zarr_fields *fields; /* owned; NULL = the image has metadata of OME */
    struct arrays arrays;       /* of the fields */
    struct zarr_image image;
    const struct zarr_level *level; /* of the image */
    uint32_t channel;
    struct import_conversion conversion;
    struct zarr_chunks chunks;                  /* of zarr_chunk_read() */
    struct reading *chunk_of[BRICK_LEVELS_MAX]; /* owned: the same, by level; NULL = not used yet */
};

static bool probe(const uint8_t *start, size_t size, const char *title) {
    static const char *const names[] = { ".zattrs", ".zgroup", ".zarray", "zarr.json" };
    const char *slash = strrchr(title, '/'), *name = slash ? slash + 1 : title;
    (void)start;
    (void)size;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (strcmp(name, names[i]) == 0)
            return true;
    return false;
}

/* The level that was asked for, or else the finest one that a volume can hold. */
static bool choose_level(struct zarr *z, struct import_header *header, struct sp_error *err) {
    const unsigned count = z->image.level_count;
    const int wanted = z->file->level;
    if (wanted >= (int)count)
        return sp_fail(err, SP_ERR_NOT_FOUND, z->store->title,
                       "there is no level %d; the image has level 0, the finest, to %u", wanted,
                       count - 1);
    for (unsigned i = wanted < 0 ? 0 : (unsigned)wanted;; i++) {
        z->level = &z->image.levels[i];
        memcpy(header->grid.dims, z->level->dims, sizeof header->grid.dims);
        memcpy(header->grid.spacing, z->level->spacing, sizeof header->grid.spacing);
        memcpy(header->grid.origin, z->level->origin, sizeof header->grid.origin);
        for (int a = 0; a < 3; a++)
            header->grid.direction[a][a] = z->level->is_turned[a] ? -1 : 1;
        header->level = i;
        header->level_count = count;
        if (sp_grid_check(&header->grid, header->type, z->store->title, &header->bytes, err))
            return true;
        if (wanted >= 0 || i + 1 == count)
            return false;
    }
}

static bool choose_channel(struct zarr *z, struct import_header *header, struct sp_error *err) {
    const struct zarr_image *image = &z->image;
    const unsigned count = image->name_count;
    const char *field = z->file->field;
    char text[SP_ERROR_TEXT];
    struct import_list list;
    unsigned chosen = *field ? count : 0;
    if (image->axes.are_vectors) {
        import_header_add_vectors(header, "");
        import_header_use_vectors(header, field);
        return true;
    }
    if (image->axes.are_colors) {
        z->channel = import_header_choose_component(header, field, image->channels, true);
        return true;
    }
    for (unsigned i = 0; i < count && chosen == count; i++)
        if (strcmp(image->names[i], field) == 0)
            chosen = i;
    if (chosen == count) {
        snprintf(text, sizeof text, "there is no channel %.60s; the image has", field);
        import_list_begin(&list, text, sizeof text);
        for (unsigned i = 0; i < count; i++)
            import_list_add(&list, i ? ", " : " ",
                            image->names[i][0] ? image->names[i] : "one channel without a name");
        import_list_end(&list, false);
        return sp_fail(err, SP_ERR_NOT_FOUND, z->store->title, "%s", text);
    }
    import_name(header->value_name, image->names[chosen]);
    for (unsigned i = 0; i < count; i++)
        if (i != chosen)
            import_header_add_other(header, image->names[i]);
    z->channel = chosen;
    return true;
}

static bool describe_image(struct zarr *z, struct import_header *header, struct sp_error *err) {
    if (!zarr_image_choose(&z->image, z->file, header, err))
        return false;
    z->conversion = import_conversion_of(z->image.levels[0].array.number, z->file->warnings);
    if (z->image.axes.are_vectors)
        z->conversion.type = SP_FLOAT32;
    header->type = z->conversion.type;
    if (z->image.are_labels)
        header->meaning = SP_MEANING_LABELS;
    snprintf(header->unit, sizeof header->unit, "%s", z->image.unit);
    if (!choose_channel(z, header, err) ||
        !import_header_use_steps(header, z->file, z->image.steps, err))
        return false;
    if (z->image.steps > 1)
        import_header_use_interval(header, z->image.first_time, z->image.interval,
                                   z->image.time_unit);
    if (!choose_level(z, header, err))
        return false;
    if (z->image.anatomy[0]) /* it may turn the axes */
        import_header_set_anatomy(header, z->image.anatomy);
    return true;
}

/* An array without metadata of OME: the conventions of CF. */
static bool describe_plain(struct zarr *z, const struct zarr_node *node,
                           struct import_header *header, struct sp_error *err) {
    struct arrays *a = &z->arrays;
    z->fields = zarr_fields_open(node, z->file, err);
    if (!z->fields)
        return false;
    a->file = z->file;
    a->title = z->store->title;
    a->call = &zarr_field_functions;
    a->handle = z->fields;
    a->takes_first = true;
    if (!arrays_choose(a, err))
        return false;
    if (z->file->level > 0)
        return arrays_fail(a, err, SP_ERR_NOT_FOUND,
                           "there is no level %d; the array has only level 0", z->file->level);
    if (!arrays_fill_header(a, header, err) ||
        !sp_grid_check(&header->grid, header->type, a->title, &header->bytes, err))
        return false;
    header->level_count = 1;
    z->conversion = a->conversion;
    z->channel = a->channel;
    if (!zarr_image_use_array(&z->image, zarr_fields_array(z->fields, a->chosen), &a->axes))
        return sp_fail(err, SP_ERR_MEMORY, a->title, "out of memory");
    z->level = &z->image.levels[0];
    return true;
}

/* An array in a folder that lists it as a level of its image: it has the place that the image gives
 * it. Returns true. */
static bool open_as_level(struct zarr *z) {
    enum { DEPTH_MAX = 2 }; /* "image.zarr/0" and "image.zarr/scale0/image" */
    const char *folder = z->store->list ? z->file->folder : "", *own = folder + strlen(folder);
    char up[3 * DEPTH_MAX] = "..";
    for (int depth = 0; depth < DEPTH_MAX && *folder; depth++, strcpy(up, "../..")) {
        struct zarr_image image;
        struct zarr_node node;
        struct sp_error why;
        while (own > folder && *--own != '/')
            continue;
        if (zarr_node_open(&node, z->store, up, &why) != ZARR_FOUND)
            continue;
        const enum zarr_found found = zarr_image_open_level(&image, &node, own + 1, &why);
        zarr_node_close(&node);
        if (found == ZARR_FOUND) {
            zarr_image_close(&z->image);
            z->image = image;
            return true;
        }
        if (found == ZARR_FAILED)
            import_warn(z->file->warnings,
                        "The image that has this level cannot be read (%.200s); the spacing is "
                        "unknown.",
                        why.text);
    }
    return true;
}

bool zarr_open(struct zarr *z, const struct zarr_store *store, const struct import_file *file,
               struct import_header *header, struct sp_error *err) {
    struct zarr_node node;
    z->store = store;
    z->file = file;
    const enum zarr_found found = zarr_node_open(&node, z->store, "", err);
    if (found == ZARR_MISSING)
        return sp_fail(err, SP_ERR_UNSUPPORTED, z->store->title,
                       "this folder has no metadata of Zarr (zarr.json, .zarray, .zgroup or "
                       ".zattrs)");
    if (found != ZARR_FOUND)
        return false;
    const bool ok = zarr_image_open(&z->image, &node, err) &&
                    (!node.is_array || open_as_level(z)) &&
                    (z->image.is_plain ? describe_plain(z, &node, header, err)
                                       : describe_image(z, header, err));
    zarr_node_close(&node);
    return ok;
}

static void free_reading(struct reading *r);

void zarr_close(void *reader) {
    struct zarr *z = reader;
    for (int l = 0; l < BRICK_LEVELS_MAX; l++)
        free_reading(z->chunk_of[l]);
    zarr_chunks_finish(&z->chunks);
    zarr_image_close(&z->image);
    arrays_finish(&z->arrays);
    zarr_fields_close(&z->fields);
    if (z->folder)
        z->close_store(&z->folder);
}

/* Reading. */

struct box { /* of one chunk, along x, y and z */
    uint32_t first[3], size[3];
};

struct reading {
    const struct zarr *zarr;
    const struct zarr_level *level;
    const struct zarr_array *array; /* of the level */
    struct box out;                 /* the samples that `voxels` holds */
    size_t strides[3];              /* of x, y and z in a chunk [numbers] */
    size_t base;                    /* of the channel and the step in a chunk [numbers] */
    char *chunk, *row;              /* owned: a chunk, and numbers along x */
    float *floats;                  /* owned: components along x; NULL = reads samples */
    float (*vectors)[3];
    uint32_t channel; /* or component of the vectors */
    char *voxels;
    uint64_t done;  /* samples */
    uint64_t holes; /* chunks that are damaged */
};

static bool begin(struct reading *r, struct sp_error *err) {
    const struct zarr_image *image = &r->zarr->image;
    r->chunk = malloc(r->array->chunk_bytes);
    r->row = malloc((size_t)r->level->dims[0] * r->array->number.size);
    r->floats = r->vectors ? malloc((size_t)r->level->dims[0] * sizeof *r->floats) : NULL;
    if (!r->chunk || !r->row || (r->vectors && !r->floats))
        return sp_fail(err, SP_ERR_MEMORY, r->zarr->store->title, "out of memory for a chunk");
    size_t step = 1;
    for (unsigned d = r->array->rank; d-- > 0; step *= (size_t)r->array->chunk[d]) {
        for (int a = 0; a < 3; a++)
            if (image->axes.space[a] == (int)d)
                r->strides[a] = step;
        if (image->axes.channel == (int)d)
            r->base += step * (size_t)(r->channel % r->array->chunk[d]);
        if (image->axes.time == (int)d)
            r->base += step * (size_t)(r->zarr->file->step % r->array->chunk[d]);
    }
    return true;
}

/* Copies the rows of a chunk into the volume. */
static void put(struct reading *r, const struct box *box) {
    const struct import_conversion *c = &r->zarr->conversion;
    const uint32_t *dims = r->out.size, *first = r->out.first;
    const size_t number = c->number.size, sample = sp_type_size(c->type);
    const bool is_copy = import_conversion_is_copy(c);
    for (uint32_t k = 0; k < box->size[2]; k++)
        for (uint32_t j = 0; j < box->size[1]; j++) {
            const char *from =
                r->chunk + (r->base + k * r->strides[2] + j * r->strides[1]) * number;
            const uint64_t at = ((uint64_t)(box->first[2] - first[2] + k) * dims[1] +
                                 box->first[1] - first[1] + j) *
                                    dims[0] +
                                box->first[0] - first[0];
            char *to = r->vectors ? (char *)r->floats : r->voxels + at * sample;
            if (r->strides[0] != 1) {
                for (uint32_t i = 0; i < box->size[0]; i++)
                    memcpy(r->row + i * number, from + i * r->strides[0] * number, number);
                from = r->row;
            }
            if (is_copy)
                memcpy(to, from, box->size[0] * sample);
            else
                import_conversion_put(c, from, box->size[0], to);
            for (uint32_t i = 0; r->vectors && i < box->size[0]; i++)
                r->vectors[at + i][r->channel] = r->floats[i];
        }
    r->done += (uint64_t)box->size[0] * box->size[1] * box->size[2];
}

/* The chunk at a place of the grid of chunks, and its part of the volume. */
static void locate_chunk(const struct reading *r, const uint64_t place[3], uint64_t at[],
                         struct box *box) {
    const struct zarr_image *image = &r->zarr->image;
    memset(at, 0, ZARR_RANK_MAX * sizeof *at);
    if (image->axes.channel >= 0)
        at[image->axes.channel] = r->channel / r->array->chunk[image->axes.channel];
    if (image->axes.time >= 0)
        at[image->axes.time] = r->zarr->file->step / r->array->chunk[image->axes.time];
    for (int a = 0; a < 3; a++) {
        const uint32_t dim = r->level->dims[a];
        const uint64_t size = image->axes.space[a] < 0 ? 1 : r->array->chunk[image->axes.space[a]];
        if (image->axes.space[a] >= 0)
            at[image->axes.space[a]] = place[a];
        box->first[a] = (uint32_t)(place[a] * size);
        box->size[a] = size < dim - box->first[a] ? (uint32_t)size : dim - box->first[a];
    }
}

/* A chunk that is damaged, or cannot be read, is a hole of NaN or of the fill value, with a
 * warning. A library that is missing is an error. */
static bool mark_hole(struct reading *r, const struct sp_error *why) {
    const struct zarr_array *a = r->array;
    uint8_t hole[IMPORT_NUMBER_BYTES];
    const size_t size = a->number.size, count = a->chunk_bytes / size;
    if (why->code != SP_ERR_FORMAT && why->code != SP_ERR_IO)
        return false;
    memcpy(hole, a->fill, sizeof hole);
    if (import_number_part(a->number).kind == IMPORT_FLOAT)
        import_narrow(NAN, a->number, hole);
    for (size_t i = 0; i < count; i++)
        memcpy(r->chunk + i * size, hole, size);
    const char *place = strstr(why->place, ": ");
    import_warn(r->zarr->file->warnings, "The chunk %.80s was left out: %.200s.",
                place ? place + 2 : "", why->text);
    r->holes++;
    return true;
}

/* Reads the chunks [first, end) along x, y and z. */
static bool read_range(struct reading *r, struct zarr_chunks *chunks, const uint64_t first[3],
                       const uint64_t end[3], const struct import_progress *progress,
                       struct sp_error *err) {
    uint64_t place[3], at[ZARR_RANK_MAX];
    struct box box;
    for (place[2] = first[2]; place[2] < end[2]; place[2]++)
        for (place[1] = first[1]; place[1] < end[1]; place[1]++)
            for (place[0] = first[0]; place[0] < end[0]; place[0]++) {
                locate_chunk(r, place, at, &box);
                if (zarr_chunk_read(chunks, r->array, at, r->chunk, err) == ZARR_FAILED &&
                    !mark_hole(r, err))
                    return false;
                put(r, &box);
                import_report(progress, r->done * sp_type_size(r->zarr->conversion.type));
            }
    return true;
}

/* Reads shard by shard, because the index of a shard is read whole and only the last index is kept.
 * Without shards, each chunk counts as one. */
static bool read_chunks(struct reading *r, struct zarr_chunks *chunks,
                        const struct import_progress *progress, struct sp_error *err) {
    const struct zarr_image *image = &r->zarr->image;
    uint64_t counts[3], sides[3], first[3], end[3] = { 0 };
    for (int a = 0; a < 3; a++) {
        const int d = image->axes.space[a];
        counts[a] = d < 0 ? 1 : zarr_array_chunks(r->array, (unsigned)d);
        sides[a] = d < 0 ? 1 : r->array->shard[d];
    }
    for (first[2] = 0; first[2] < counts[2]; first[2] = end[2])
        for (first[1] = 0; first[1] < counts[1]; first[1] = end[1])
            for (first[0] = 0; first[0] < counts[0]; first[0] = end[0]) {
                for (int a = 0; a < 3; a++)
                    end[a] = sides[a] < counts[a] - first[a] ? first[a] + sides[a] : counts[a];
                if (!read_range(r, chunks, first, end, progress, err))
                    return false;
            }
    return r->holes < counts[0] * counts[1] * counts[2]; /* *err tells about the last one */
}

bool zarr_read(void *reader, void *voxels, float (*vectors)[3],
               const struct import_progress *progress, struct sp_error *err) {
    const struct zarr *z = reader;
    const bool are_vectors = z->image.axes.are_vectors;
    struct zarr_chunks chunks;
    bool ok = true;
    zarr_chunks_init(&chunks, z->store, z->file);
    for (uint32_t c = 0; ok && c < (are_vectors ? 3 : 1); c++) {
        struct reading r = {
            .zarr = z, .level = z->level, .array = &z->level->array, .voxels = voxels
        };
        r.channel = are_vectors ? c : z->channel;
        r.vectors = are_vectors ? vectors : NULL;
        memcpy(r.out.size, z->level->dims, sizeof r.out.size);
        ok = begin(&r, err) && read_chunks(&r, &chunks, progress, err);
        free(r.chunk);
        free(r.row);
        free(r.floats);
    }
    zarr_chunks_finish(&chunks);
    return ok;
}

/* Chunk by chunk. */

/* Where a level lies on the samples of the finest one. The metadata of many files has the same
 * scale for all levels, or no translation; then the samples stand for boxes that fill the volume.
 */
static void place_on(const struct zarr_level *finest, const struct zarr_level *level,
                     struct sp_chunk_level *out) {
    static const double tolerance = 0.4;
    for (int a = 0; a < 3; a++) {
        const double ratio = (double)finest->dims[a] / level->dims[a];
        const double scale = level->spacing[a] / finest->spacing[a];
        const double shift = (level->origin[a] - finest->origin[a]) / finest->spacing[a] *
                             (finest->is_turned[a] ? -1 : 1);
        out->step[a] = fabs(scale / ratio - 1) <= tolerance ? scale : ratio;
        const bool is_shifted = fabs(shift) > 1e-6 && fabs(shift) <= out->step[a];
        out->offset[a] = is_shifted ? shift : 0.5 * (out->step[a] - 1);
    }
}

/* Levels that are not coarser than the one before them end the list. */
static unsigned list_levels(void *reader, struct sp_chunk_level *levels, unsigned most) {
    const struct zarr *z = reader;
    const struct zarr_level *finest = z->level;
    const size_t left = z->image.level_count - (size_t)(finest - z->image.levels);
    unsigned count = 0;
    if (z->image.axes.are_vectors)
        return 0;
    for (; count < most && count < left; count++) {
        const struct zarr_level *level = finest + count;
        bool is_coarser = count == 0;
        for (int a = 0; a < 3; a++) {
            const int d = z->image.axes.space[a];
            const uint64_t chunk = d < 0 ? 1 : level->array.chunk[d];
            if (count && level->dims[a] > level[-1].dims[a])
                return count;
            is_coarser = is_coarser || level->dims[a] < level[-1].dims[a];
            levels[count].dims[a] = level->dims[a];
            levels[count].chunk[a] = chunk < level->dims[a] ? (uint32_t)chunk : level->dims[a];
        }
        if (!is_coarser)
            break;
        place_on(finest, level, &levels[count]);
    }
    return count;
}

static void free_reading(struct reading *r) {
    if (!r)
        return;
    free(r->chunk);
    free(r->row);
    free(r);
}

static bool read_chunk(void *reader, unsigned l, const uint32_t place[3], void *out,
                       struct sp_error *err) {
    struct zarr *z = reader;
    struct reading *r = z->chunk_of[l];
    uint64_t at[ZARR_RANK_MAX];
    if (!r) {
        if (!(r = calloc(1, sizeof *r)))
            return sp_fail(err, SP_ERR_MEMORY, z->store->title, "out of memory for a chunk");
        r->zarr = z;
        r->channel = z->channel;
        r->level = z->level + l;
        r->array = &r->level->array;
        if (!begin(r, err)) {
            free_reading(r);
            return false;
        }
        z->chunk_of[l] = r;
    }
    if (!z->chunks.store)
        zarr_chunks_init(&z->chunks, z->store, z->file);
    for (int a = 0; a < 3; a++) {
        const int d = z->image.axes.space[a];
        if (place[a] >= (d < 0 ? 1 : zarr_array_chunks(r->array, (unsigned)d)))
            return sp_fail(err, SP_ERR_INVALID, z->store->title, "there is no such chunk");
    }
    const uint64_t wide[3] = { place[0], place[1], place[2] };
    locate_chunk(r, wide, at, &r->out);
    r->voxels = out;
    if (zarr_chunk_read(&z->chunks, r->array, at, r->chunk, err) == ZARR_FAILED)
        return false;
    put(r, &r->out);
    return true;
}

static bool open_folder(void *reader, const struct import_file *file, struct import_header *header,
                        struct sp_error *err) {
    struct zarr *z = reader;
    z->folder = zarr_folder_open(file);
    z->close_store = zarr_folder_close;
    if (!z->folder)
        return sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory");
    return zarr_open(z, z->folder, file, header, err);
}

static bool lacks_root(const struct zarr_store *store) {
    struct zarr_node node;
    struct sp_error unused;
    const enum zarr_found found = zarr_node_open(&node, store, "", &unused);
    if (found == ZARR_FOUND)
        zarr_node_close(&node);
    return found == ZARR_MISSING;
}

static bool open_remote(void *reader, const struct import_file *file, struct import_header *header,
                        struct sp_error *err) {
    struct zarr *z = reader;
    z->folder = zarr_remote_open(REMOTE_FILE, REMOTE_MEMORY, file->title, err);
    z->close_store = zarr_remote_close;
    if (!z->folder)
        return false;
    if (zarr_open(z, z->folder, file, header, err))
        return true;
    const unsigned status = zarr_remote_status(z->folder);
    if (err->code == SP_ERR_UNSUPPORTED && status && lacks_root(z->folder))
        sp_fail(err, SP_ERR_NOT_FOUND, file->title,
                "there is no OME-Zarr at this address: the host answered with the status %u",
                status);
    return false;
}

static bool is_never(const uint8_t *start, size_t size, const char *title) {
    (void)start;
    (void)size;
    (void)title;
    return false;
}

const struct import_format import_zarr_remote = { .name = "Zarr",
                                                  .probe = is_never,
                                                  .needs_module = true,
                                                  .reader_size = sizeof(struct zarr),
                                                  .open = open_remote,
                                                  .read = zarr_read,
                                                  .levels = list_levels,
                                                  .read_chunk = read_chunk,
                                                  .close = zarr_close };

const struct import_format import_zarr = { .name = "Zarr",
                                           .probe = probe,
                                           .needs_module = true,
                                           .reader_size = sizeof(struct zarr),
                                           .open = open_folder,
                                           .read = zarr_read,
                                           .levels = list_levels,
                                           .read_chunk = read_chunk,
                                           .close = zarr_close };
