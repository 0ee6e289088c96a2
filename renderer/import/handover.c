/* SPDX-License-Identifier: Apache-2.0 */
#include "import/handover.h"

#include <inttypes.h>
#include <string.h>

#include "volume/anatomy.h"
#include "volume/volume.h"

size_t sp_handover_size(enum sp_handover_kind kind) {
    size_t head = offsetof(struct sp_handover, header);
    switch (kind) {
    case SP_HANDOVER_HEADER:
        return head + sizeof(struct sp_handover_header);
    case SP_HANDOVER_PROGRESS:
    case SP_HANDOVER_GO:
        return head + sizeof(uint64_t);
    case SP_HANDOVER_DONE:
        return head;
    case SP_HANDOVER_ERROR:
        return head + sizeof(struct sp_handover_error);
    }
    return 0;
}

void sp_handover_init(struct sp_handover *message, enum sp_handover_kind kind) {
    memset(message, 0, sizeof *message);
    message->magic = SP_HANDOVER_MAGIC;
    message->version = SP_HANDOVER_VERSION;
    message->kind = (uint16_t)kind;
}

struct sp_handover_layout sp_handover_layout(const struct sp_handover_header *header) {
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

/* True if the text ends with 0 within `capacity` bytes. Replaces control characters. */
static bool clean_text(char *text, size_t capacity) {
    if (!memchr(text, 0, capacity))
        return false;
    for (char *c = text; *c; c++)
        if ((unsigned char)*c < 0x20 || *c == 0x7f)
            *c = '?';
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
    if (!sp_anatomy_is_valid(header->anatomy))
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process sent unknown anatomical directions");
    if (!clean_text(header->unit, sizeof header->unit))
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process sent a unit that is not terminated");
    if (!clean_text(header->value_name, sizeof header->value_name) ||
        !clean_text(header->vector_name, sizeof header->vector_name))
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process sent a name that is not terminated");
    if (header->vector_name[0] && !header->has_vectors)
        return sp_fail(err, SP_ERR_CRASHED, place,
                       "the import process named vectors that it does not have");
    return true;
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
    return true;
}
