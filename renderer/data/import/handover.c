/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/handover.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "data/volume/anatomy.h"
#include "data/volume/elements.h"
#include "data/volume/volume.h"
#include "sp/utf8.h"

size_t sp_handover_size(enum sp_handover_kind kind) {
    size_t head = offsetof(struct sp_handover, header);
    switch (kind) {
    case SP_HANDOVER_HEADER:
        return head + sizeof(struct sp_handover_header);
    case SP_HANDOVER_PROGRESS:
    case SP_HANDOVER_GO:
        return head + sizeof(uint64_t);
    case SP_HANDOVER_OPENING:
        return head + sizeof(double);
    case SP_HANDOVER_DONE:
        return head + sizeof(struct sp_handover_done);
    case SP_HANDOVER_ERROR:
        return head + sizeof(struct sp_handover_error);
    case SP_HANDOVER_LEVELS:
        return head + sizeof(struct sp_handover_levels);
    case SP_HANDOVER_READ:
    case SP_HANDOVER_CHUNK:
        return head + sizeof(struct sp_handover_read);
    case SP_HANDOVER_SERIES:
        return head + sizeof(struct sp_series);
    }
    return 0;
}

void sp_handover_init(struct sp_handover *message, enum sp_handover_kind kind) {
    memset(message, 0, sizeof *message);
    message->magic = SP_HANDOVER_MAGIC;
    message->version = SP_HANDOVER_VERSION;
    message->kind = (uint16_t)kind;
}

struct sp_elements_shape sp_handover_shape(const struct sp_handover_header *header) {
    return (struct sp_elements_shape){ .kind = (enum sp_kind)header->kind,
                                       .count = header->count,
                                       .vertex_count = header->vertex_count,
                                       .degree = header->degree,
                                       .has_vectors =
                                           header->kind != SP_KIND_GRID && header->has_vectors,
                                       .lacks_colors = header->lacks_colors };
}

/* The samples, vectors and coordinates. */
static struct sp_handover_layout layout_of_grid(const struct sp_handover_header *header) {
    struct sp_handover_layout layout = { 0 };
    uint64_t voxels = header->bytes / sp_type_size((enum sp_type)header->type), vectors_at;
    layout.bytes = sp_volume_layout(header->bytes, voxels, header->has_vectors, &vectors_at);
    layout.vectors_at = header->has_vectors ? vectors_at : 0;
    for (int axis = 0; axis < 3; axis++)
        if (header->rectilinear >> axis & 1) {
            layout.coordinates_at[axis] = layout.bytes;
            layout.bytes += header->dims[axis] * sizeof(double);
        }
    return layout;
}

struct sp_handover_layout sp_handover_layout(const struct sp_handover_header *header) {
    const struct sp_elements_shape shape = sp_handover_shape(header);
    struct sp_handover_layout layout = { 0 };
    if (shape.kind == SP_KIND_GRID)
        layout = layout_of_grid(header);
    else
        layout.bytes = sp_elements_bytes(&shape);
    if (header->has_times) {
        layout.times_at = (layout.bytes + sizeof(double) - 1) / sizeof(double) * sizeof(double);
        layout.bytes = layout.times_at + header->steps * sizeof(double);
    }
    return layout;
}

void sp_handover_describe(const struct sp_handover_header *h, const struct sp_handover_done *done,
                          struct sp_volume_info *info) {
    memset(info, 0, sizeof *info);
    memcpy(info->grid.dims, h->dims, sizeof h->dims);
    memcpy(info->grid.spacing, h->spacing, sizeof h->spacing);
    memcpy(info->grid.origin, h->origin, sizeof h->origin);
    memcpy(info->grid.direction, h->direction, sizeof h->direction);
    info->type = (enum sp_type)h->type;
    info->elements = sp_handover_shape(h);
    info->folded = done->folded;
    memcpy(info->warnings, done->warnings, sizeof info->warnings);
    info->steps.count = h->steps;
    info->steps.index = h->step;
    memcpy(info->steps.unit, h->time_unit, sizeof info->steps.unit);
    memcpy(info->unit, h->unit, sizeof info->unit);
    info->vertical = h->vertical;
    memcpy(info->anatomy, h->anatomy, sizeof info->anatomy);
    info->meaning = (enum sp_meaning)h->meaning;
    memcpy(info->value_name, h->value_name, sizeof info->value_name);
    memcpy(info->vector_name, h->vector_name, sizeof info->vector_name);
    memcpy(info->value_unit, h->value_unit, sizeof info->value_unit);
    memcpy(info->others, h->others, sizeof info->others);
    memcpy(info->other_vectors, h->other_vectors, sizeof info->other_vectors);
}

/* True if the text ends with 0 within `capacity` bytes. Replaces control characters, and bytes that
 * are not UTF-8: a file may have texts in any encoding. */
static bool clean_text(char *text, size_t capacity) {
    if (!memchr(text, 0, capacity))
        return false;
    for (char *c = text; *c; c++)
        if ((unsigned char)*c < 0x20 || *c == 0x7f)
            *c = '?';
    sp_utf8_mend(text);
    return true;
}

static bool check_elements(const struct sp_handover_header *header, const char *place,
                           struct sp_error *err) {
    const struct sp_elements_shape shape = sp_handover_shape(header);
    const char *problem = header->kind >= SP_KIND_COUNT ? "elements of an unknown kind"
                                                        : sp_elements_shape_problem(&shape);
    if (!problem && shape.kind != SP_KIND_GRID &&
        (header->bytes != sizeof(float) || header->rectilinear))
        problem = "elements on a grid";
    return !problem || sp_fail(err, SP_ERR_CRASHED, place, "the import process sent %s", problem);
}

static bool check_texts(struct sp_handover_header *header, const char *place,
                        struct sp_error *err) {
    if (!clean_text(header->unit, sizeof header->unit) ||
        !clean_text(header->vertical.unit, sizeof header->vertical.unit) ||
        !clean_text(header->value_unit, sizeof header->value_unit) ||
        !clean_text(header->time_unit, sizeof header->time_unit))
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process sent a unit that is not terminated");
    if (!clean_text(header->value_name, sizeof header->value_name) ||
        !clean_text(header->vector_name, sizeof header->vector_name))
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process sent a name that is not terminated");
    for (int i = 0; i < SP_OTHER_FIELDS_MAX; i++)
        if (!clean_text(header->others[i], sizeof header->others[i]))
            return sp_fail(err, SP_ERR_CRASHED, place,
                           "the import process sent the name of a field that is not terminated");
    for (int i = 0; i < SP_OTHER_VECTORS_MAX; i++)
        if (!clean_text(header->other_vectors[i], sizeof header->other_vectors[i]))
            return sp_fail(err, SP_ERR_CRASHED, place,
                           "the import process sent the name of vectors that is not terminated");
    if (header->vector_name[0] && !header->has_vectors)
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process named vectors that it does not have");
    return true;
}

static bool check_header(struct sp_handover_header *header, const char *place,
                         struct sp_error *err) {
    if (header->type >= SP_TYPE_COUNT)
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process sent the unknown sample type %" PRIu32, header->type);
    struct sp_grid grid = { .coordinates = { NULL } };
    memcpy(grid.dims, header->dims, sizeof grid.dims);
    memcpy(grid.spacing, header->spacing, sizeof grid.spacing);
    memcpy(grid.origin, header->origin, sizeof grid.origin);
    memcpy(grid.direction, header->direction, sizeof grid.direction);
    uint64_t bytes;
    struct sp_error why;
    if (!sp_grid_check(&grid, (enum sp_type)header->type, place, &bytes, &why))
        return sp_fail(err, SP_ERR_CRASHED, place, "the import process sent a bad grid: %s",
                       why.text);
    if (header->bytes != bytes)
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process sent a size of %" PRIu64
                       " bytes; its grid needs %" PRIu64,
                       header->bytes, bytes);
    if (header->rectilinear > 7)
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process sent axes of an unknown kind");
    if (header->has_vectors > 1)
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process sent vectors of an unknown kind");
    if (header->lacks_colors > 1)
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process sent colours of an unknown kind");
    if (header->level > 0 && header->level >= header->level_count)
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process sent a level of detail that is not there");
    if (!sp_anatomy_is_valid(header->anatomy))
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process sent unknown anatomical directions");
    if (header->meaning >= SP_MEANING_COUNT)
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process sent the unknown meaning %" PRIu32, header->meaning);
    if (header->steps < 1 || header->steps > SP_STEPS_MAX || header->step >= header->steps ||
        header->has_times > 1)
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process sent step %" PRIu32 " of %" PRIu32, header->step,
                       header->steps);
    if (!isfinite(header->vertical.per_unit))
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process sent a vertical axis without a scale");
    return check_texts(header, place, err) && check_elements(header, place, err);
}

static bool check_error(struct sp_handover_error *error, const char *place, struct sp_error *err) {
    switch (error->code) {
    case SP_ERR_INVALID:
    case SP_ERR_UNSUPPORTED:
    case SP_ERR_NOT_FOUND:
    case SP_ERR_FORMAT:
    case SP_ERR_IO:
    case SP_ERR_DENIED:
    case SP_ERR_MEMORY:
        break;
    default:
        return sp_fail(err, SP_ERR_CRASHED, place, "the import process failed with code %" PRIu32,
                       error->code);
    }
    if (!clean_text(error->place, sizeof error->place) ||
        !clean_text(error->text, sizeof error->text))
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process sent an error message that is not terminated");
    return true;
}

static bool check_done(struct sp_handover_done *done, const char *place, struct sp_error *err) {
    for (int i = 0; i < SP_WARNINGS_MAX; i++) {
        if (!clean_text(done->warnings[i], sizeof done->warnings[i]))
            return sp_fail(err, SP_ERR_CRASHED, place,
                           "the import process sent a warning that is not terminated");
        if (i > 0 && done->warnings[i][0] && !done->warnings[i - 1][0])
            return sp_fail(err, SP_ERR_CRASHED, place,
                           "the import process sent warnings with a gap between them");
    }
    return true;
}

static bool check_levels(const struct sp_handover_levels *levels, const char *place,
                         struct sp_error *err) {
    if (levels->count < 1 || levels->count > BRICK_LEVELS_MAX)
        return sp_fail(err, SP_ERR_CRASHED, place, "the import process sent %" PRIu32 " levels",
                       levels->count);
    for (uint32_t l = 0; l < levels->count; l++)
        for (int a = 0; a < 3; a++) {
            const struct sp_chunk_level *own = &levels->level[l];
            const uint32_t most = l ? own[-1].dims[a] : SP_DIM_MAX;
            if (own->dims[a] < 1 || own->dims[a] > most || own->chunk[a] < 1 ||
                own->chunk[a] > own->dims[a])
                return sp_fail(err, SP_ERR_CRASHED, place,
                               "the import process sent a bad size of level %" PRIu32, l);
            if (!(own->step[a] >= 0.5 && own->step[a] <= SP_DIM_MAX) ||
                !(fabs(own->offset[a]) <= own->step[a]))
                return sp_fail(err, SP_ERR_CRASHED, place,
                               "the import process sent a bad place of level %" PRIu32, l);
        }
    return true;
}

static bool check_series(struct sp_series *series, const char *place, struct sp_error *err) {
    unsigned char flag;
    memcpy(&flag, &series->has_number, 1); /* reading another bool than 0 and 1 is undefined */
    return (flag <= 1 && clean_text(series->uid, sizeof series->uid) &&
            clean_text(series->description, sizeof series->description) &&
            clean_text(series->modality, sizeof series->modality)) ||
           sp_fail(err, SP_ERR_CRASHED, place,
                   "the import process sent a series whose texts are not terminated");
}

bool sp_handover_decode(const void *bytes, size_t size, struct sp_handover *message,
                        const char *place, struct sp_error *err) {
    memset(message, 0, sizeof *message);
    if (size < offsetof(struct sp_handover, header) || size > sizeof *message)
        return sp_fail(err, SP_ERR_CRASHED, place, "the import process sent a message of %zu bytes",
                       size);
    memcpy(message, bytes, size);
    if (message->magic != SP_HANDOVER_MAGIC)
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "a message of the import process starts with %08" PRIx32, message->magic);
    if (message->version != SP_HANDOVER_VERSION)
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "splat-import uses version %u of the handover and this program version %u; "
                       "install both from one build",
                       message->version, SP_HANDOVER_VERSION);
    if (sp_handover_size((enum sp_handover_kind)message->kind) != size)
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process sent a message of kind %u with %zu bytes", message->kind,
                       size);
    if (message->kind == SP_HANDOVER_HEADER)
        return check_header(&message->header, place, err);
    if (message->kind == SP_HANDOVER_ERROR)
        return check_error(&message->error, place, err);
    if (message->kind == SP_HANDOVER_LEVELS)
        return check_levels(&message->levels, place, err);
    if (message->kind == SP_HANDOVER_OPENING && !(message->share >= 0 && message->share <= 1))
        return sp_fail(err, SP_ERR_CRASHED, place, "the import process sent a share of %g",
                       message->share);
    if (message->kind == SP_HANDOVER_SERIES)
        return check_series(&message->series, place, err);
    if (message->kind == SP_HANDOVER_DONE)
        return check_done(&message->done, place, err);
    return true;
}
