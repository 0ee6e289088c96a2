/* SPDX-License-Identifier: Apache-2.0 */
#include "data/bricks/format.h"

#include <endian.h>
#include <math.h>
#include <string.h>

#include "data/volume/grid.h"
#include "sp/bricks.h"

const char sp_brick_magic[BRICK_MAGIC_BYTES] = { 'S', 'P', 'B', 'R', 'I', 'C', 'K', '\n' };

/* Where the next field is. */
struct cursor {
    unsigned char *bytes;
    size_t at;
    bool writes;
};

static void field_bytes(struct cursor *c, void *value, size_t size) {
    if (c->writes)
        memcpy(c->bytes + c->at, value, size);
    else
        memcpy(value, c->bytes + c->at, size);
    c->at += size;
}

static void field_u32(struct cursor *c, uint32_t *value) {
    uint32_t stored = htole32(*value);
    field_bytes(c, &stored, sizeof stored);
    *value = le32toh(stored);
}

static void field_u64(struct cursor *c, uint64_t *value) {
    uint64_t stored = htole64(*value);
    field_bytes(c, &stored, sizeof stored);
    *value = le64toh(stored);
}

static void field_doubles(struct cursor *c, double *values, size_t count) {
    for (size_t i = 0; i < count; i++) {
        uint64_t bits;
        memcpy(&bits, &values[i], sizeof bits);
        field_u64(c, &bits);
        memcpy(&values[i], &bits, sizeof bits);
    }
}

/* Bytes behind the end of a text are written as 0, so that equal texts give equal files. */
static void field_text(struct cursor *c, char *text, size_t capacity) {
    text[capacity - 1] = 0;
    if (c->writes)
        memset(text + strlen(text), 0, capacity - strlen(text));
    field_bytes(c, text, capacity);
    text[capacity - 1] = 0;
    for (char *p = text; *p && !c->writes; p++)
        if ((unsigned char)*p < 0x20 || *p == 0x7f)
            *p = '?';
}

static void index_fields(struct cursor *c, struct sp_brick_index *index) {
    field_u64(c, &index->at);
    field_u64(c, &index->checksum);
}

/* All fields of the header but its checksum, in their order. vector_bytes becomes 1 if there are
 * vectors. */
static void fields(struct cursor *c, struct sp_brick_header *h, uint32_t constants[3]) {
    struct sp_volume_info *info = &h->info;
    uint32_t type = info->type, levels = h->levels, has_vectors = info->vector_bytes != 0,
             meaning = info->meaning;
    for (int i = 0; i < 3; i++)
        field_u32(c, &constants[i]);
    field_u32(c, &type);
    field_u32(c, &levels);
    for (int a = 0; a < 3; a++)
        field_u32(c, &info->grid.dims[a]);
    field_doubles(c, info->grid.spacing, 3);
    field_doubles(c, info->grid.origin, 3);
    for (int row = 0; row < 3; row++)
        field_doubles(c, info->grid.direction[row], 3);
    field_doubles(c, info->range, 2);
    field_u64(c, &info->nonfinite);
    for (int b = 0; b < SP_HISTOGRAM_BINS; b++)
        field_u64(c, &info->histogram[b]);
    field_doubles(c, info->projected.maximum, 2);
    field_doubles(c, info->projected.mean, 2);
    field_doubles(c, &info->projected.sum, 1);
    field_text(c, info->unit, sizeof info->unit);
    field_text(c, info->value_name, sizeof info->value_name);
    field_text(c, info->value_unit, sizeof info->value_unit);
    field_text(c, info->anatomy, sizeof info->anatomy);
    field_text(c, info->vector_name, sizeof info->vector_name);
    field_doubles(c, &info->longest, 1);
    field_u32(c, &has_vectors);
    field_u32(c, &h->rectilinear);
    field_u64(c, &h->axes_at);
    field_u64(c, &h->axes_checksum);
    field_u64(c, &h->notes_at);
    field_u64(c, &h->notes_bytes);
    field_u64(c, &h->notes_checksum);
    for (int l = 0; l < BRICK_LEVELS_MAX; l++) {
        index_fields(c, &h->level[l].samples);
        index_fields(c, &h->level[l].vectors);
    }
    field_u32(c, &meaning);
    field_doubles(c, &info->vertical.per_unit, 1);
    field_text(c, info->vertical.unit, sizeof info->vertical.unit);
    info->vector_bytes = has_vectors;
    info->meaning = (enum sp_meaning)meaning;
    info->type = (enum sp_type)type;
    h->levels = levels;
}

uint64_t sp_brick_checksum(const void *bytes, size_t size) {
    const unsigned char *p = bytes;
    uint64_t hash = UINT64_C(0xcbf29ce484222325);
    for (size_t i = 0; i < size; i++)
        hash = (hash ^ p[i]) * UINT64_C(0x100000001b3);
    return hash;
}

enum { CHECKSUM_AT = BRICK_HEADER_BYTES - 8 };

void sp_brick_header_encode(const struct sp_brick_header *header,
                            unsigned char out[BRICK_HEADER_BYTES]) {
    struct sp_brick_header copy = *header;
    uint32_t constants[3] = { SP_BRICKS_VERSION, BRICK_SIDE, BRICK_MARGIN };
    struct cursor c = { .bytes = out, .at = sizeof sp_brick_magic, .writes = true };
    memset(out, 0, BRICK_HEADER_BYTES);
    memcpy(out, sp_brick_magic, sizeof sp_brick_magic);
    fields(&c, &copy, constants);
    uint64_t checksum = sp_brick_checksum(out, CHECKSUM_AT);
    c.at = CHECKSUM_AT;
    field_u64(&c, &checksum);
}

void sp_brick_header_init(struct sp_brick_header *h) {
    bool is_last = false;
    for (h->levels = 0; !is_last && h->levels < BRICK_LEVELS_MAX; h->levels++) {
        struct sp_brick_level *level = &h->level[h->levels];
        is_last = true;
        for (int a = 0; a < 3; a++) {
            level->dims[a] = h->levels ? (level[-1].dims[a] + 1) / 2 : h->info.grid.dims[a];
            level->step[a] = ldexp(1, (int)h->levels);
            level->offset[a] = 0.5 * (level->step[a] - 1);
        }
        sp_brick_level_divide(level);
        for (int a = 0; a < 3; a++)
            is_last = is_last && level->bricks[a] == 1;
    }
}

void sp_brick_level_divide(struct sp_brick_level *level) {
    for (int a = 0; a < 3; a++)
        level->bricks[a] = level->dims[a] / BRICK_SIDE + (level->dims[a] % BRICK_SIDE != 0);
}

double sp_brick_level_width(const struct sp_brick_level *level) {
    return (log2(level->step[0]) + log2(level->step[1]) + log2(level->step[2])) / 3;
}

/* The brick of a level that has a place on the axis of level 0. */
static uint32_t brick_at(const struct sp_brick_level *level, int axis, double at) {
    const double sample = (at - level->offset[axis]) / level->step[axis] + 0.5;
    const double brick = floor(sample / BRICK_SIDE);
    return (uint32_t)fmin(fmax(brick, 0), level->bricks[axis] - 1);
}

void sp_brick_level_map(const struct sp_brick_level *from, const struct sp_brick_level *to,
                        int axis, uint32_t *first, uint32_t *count) {
    /* Half of a sample within the ends, so that a boundary that both have belongs to one side. */
    const double margin = 0.5 * fmin(1, to->step[axis] / from->step[axis]), step = from->step[axis];
    const double low = (double)*first * BRICK_SIDE - 0.5 + margin;
    const double high =
        fmin((double)(*first + *count) * BRICK_SIDE, from->dims[axis]) - 0.5 - margin;
    const uint32_t begin = brick_at(to, axis, from->offset[axis] + step * low);
    *count = brick_at(to, axis, from->offset[axis] + step * fmax(low, high)) - begin + 1;
    *first = begin;
}

void sp_brick_box(const struct sp_brick_level *level, uint64_t number, uint32_t first[3],
                  uint32_t size[3]) {
    for (int a = 0; a < 3; a++) {
        first[a] = (uint32_t)(number % level->bricks[a]) * BRICK_SIDE;
        number /= level->bricks[a];
        uint32_t left = level->dims[a] - first[a];
        size[a] = left < BRICK_SIDE ? left : BRICK_SIDE;
    }
}

static bool fail(const char *title, const char *what, struct sp_error *err) {
    return sp_fail(err, SP_ERR_FORMAT, title,
                   "the brick file is damaged, convert the volume again: %s", what);
}

/* Only an anatomy of three different axes is one. */
static bool is_anatomy(const char *letters) {
    unsigned axes = 0;
    for (int i = 0; i < 3; i++)
        axes |= !letters[i]                ? 0u
                : strchr("RL", letters[i]) ? 1u
                : strchr("AP", letters[i]) ? 2u
                : strchr("SI", letters[i]) ? 4u
                                           : 0u;
    return axes == 7;
}

static bool check_statistics(const struct sp_volume_info *info, const char *title,
                             struct sp_error *err) {
    const struct sp_projected *p = &info->projected;
    const double shares[5] = { p->maximum[0], p->maximum[1], p->mean[0], p->mean[1], p->sum };
    for (int i = 0; i < 5; i++)
        if (!(shares[i] >= 0 && shares[i] < 1e30))
            return fail(title, "its statistics", err);
    if (!(info->longest >= 0 && isfinite(info->longest)))
        return fail(title, "the length of its longest vector", err);
    return (isfinite(info->range[0]) && isfinite(info->range[1]) &&
            info->range[0] <= info->range[1]) ||
           fail(title, "its range of values", err);
}

static bool is_beyond(uint64_t at, uint64_t bytes, uint64_t file_bytes) {
    return at > file_bytes || bytes > file_bytes - at;
}

static bool check_levels(struct sp_brick_header *h, uint32_t levels, uint64_t file_bytes,
                         const char *title, struct sp_error *err) {
    sp_brick_header_init(h);
    if (levels != h->levels)
        return fail(title, "its number of levels", err);
    for (unsigned l = 0; l < levels; l++) {
        const struct sp_brick_level *level = &h->level[l];
        const uint64_t bytes = sp_brick_count(level) * BRICK_ENTRY_BYTES;
        if (is_beyond(level->samples.at, bytes, file_bytes) ||
            (h->info.vector_bytes && is_beyond(level->vectors.at, bytes, file_bytes)))
            return fail(title, "an index lies beyond its end", err);
    }
    return true;
}

static bool check_axes(const struct sp_brick_header *h, uint64_t file_bytes, const char *title,
                       struct sp_error *err) {
    uint64_t bytes = 0;
    if (h->rectilinear > 7)
        return fail(title, "the kinds of its axes", err);
    for (int a = 0; a < 3; a++)
        bytes += h->rectilinear >> a & 1 ? h->info.grid.dims[a] * sizeof(double) : 0;
    return !is_beyond(h->axes_at, bytes, file_bytes) ||
           fail(title, "its axes lie beyond its end", err);
}

bool sp_brick_header_decode(const unsigned char bytes[BRICK_HEADER_BYTES], uint64_t file_bytes,
                            const char *title, struct sp_brick_header *h, struct sp_error *err) {
    unsigned char copy[BRICK_HEADER_BYTES];
    struct cursor c = { .bytes = memcpy(copy, bytes, sizeof copy), .at = CHECKSUM_AT };
    uint32_t constants[3];
    uint64_t checksum;
    memset(h, 0, sizeof *h);
    if (memcmp(bytes, sp_brick_magic, sizeof sp_brick_magic) != 0)
        return sp_fail(err, SP_ERR_FORMAT, title, "this is no brick file");
    field_u64(&c, &checksum);
    c.at = sizeof sp_brick_magic;
    fields(&c, h, constants);
    if (constants[0] != SP_BRICKS_VERSION)
        return sp_fail(err, SP_ERR_UNSUPPORTED, title,
                       "version %u of brick files is unknown, %d is supported; convert it again",
                       constants[0], SP_BRICKS_VERSION);
    if (checksum != sp_brick_checksum(bytes, CHECKSUM_AT))
        return fail(title, "the checksum of its header", err);
    if (constants[1] != BRICK_SIDE || constants[2] != BRICK_MARGIN ||
        h->info.type >= SP_TYPE_COUNT || h->info.meaning >= SP_MEANING_COUNT ||
        !isfinite(h->info.vertical.per_unit))
        return fail(title, "its header", err);
    if (!sp_grid_check(&h->info.grid, h->info.type, title, &h->info.voxel_bytes, err) ||
        !check_statistics(&h->info, title, err))
        return false;
    if (h->info.vector_bytes > 1)
        return fail(title, "its vectors", err);
    h->info.vector_bytes *= h->info.voxel_bytes / sp_type_size(h->info.type) * BRICK_VECTOR_BYTES;
    h->info.components = 1;
    if (!is_anatomy(h->info.anatomy))
        memset(h->info.anatomy, 0, sizeof h->info.anatomy);
    if (h->notes_bytes && (h->notes_bytes < BRICK_NOTES_BYTES ||
                           h->notes_bytes > BRICK_NOTES_BYTES + SP_STEPS_MAX * sizeof(double) ||
                           is_beyond(h->notes_at, h->notes_bytes, file_bytes)))
        return fail(title, "its notes lie beyond its end", err);
    return check_axes(h, file_bytes, title, err) &&
           check_levels(h, h->levels, file_bytes, title, err);
}

size_t sp_brick_notes_bytes(const struct sp_volume_info *info) {
    return BRICK_NOTES_BYTES + (info->steps.times ? info->steps.count * sizeof(double) : 0);
}

static void notes_fields(struct cursor *c, struct sp_volume_info *info, uint32_t *has_times) {
    field_u32(c, &info->steps.count);
    field_u32(c, &info->steps.index);
    field_u32(c, has_times);
    field_text(c, info->steps.unit, sizeof info->steps.unit);
    for (int i = 0; i < SP_OTHER_FIELDS_MAX; i++)
        field_text(c, info->others[i], sizeof info->others[i]);
    for (int i = 0; i < SP_OTHER_VECTORS_MAX; i++)
        field_text(c, info->other_vectors[i], sizeof info->other_vectors[i]);
    for (int i = 0; i < SP_WARNINGS_MAX; i++)
        field_text(c, info->warnings[i], sizeof info->warnings[i]);
}

void sp_brick_notes_encode(const struct sp_volume_info *info, unsigned char *out) {
    struct sp_volume_info copy = *info;
    struct cursor c = { .bytes = out, .writes = true };
    uint32_t has_times = info->steps.times != NULL;
    copy.steps.count += copy.steps.count == 0; /* no series */
    notes_fields(&c, &copy, &has_times);
    for (uint32_t i = 0; has_times && i < info->steps.count; i++) {
        double time = info->steps.times[i];
        field_doubles(&c, &time, 1);
    }
}

bool sp_brick_notes_decode(unsigned char *bytes, size_t size, const char *title,
                           struct sp_volume_info *info, double *times, struct sp_error *err) {
    struct cursor c = { .bytes = bytes };
    uint32_t has_times;
    if (size < BRICK_NOTES_BYTES)
        return fail(title, "its notes", err);
    notes_fields(&c, info, &has_times);
    const size_t count = has_times ? info->steps.count : 0;
    info->steps.times = NULL;
    if (info->steps.count < 1 || info->steps.count > SP_STEPS_MAX ||
        info->steps.index >= info->steps.count || has_times > 1 ||
        (size - BRICK_NOTES_BYTES) / sizeof(double) < count)
        return fail(title, "its time steps", err);
    for (size_t i = 0; i < count; i++) {
        field_doubles(&c, &times[i], 1);
        if (!isfinite(times[i]))
            return fail(title, "its times", err);
    }
    info->steps.times = count ? times : NULL;
    return true;
}

static void entry_fields(struct cursor *c, struct sp_brick_entry *entry) {
    field_u64(c, &entry->at);
    field_u32(c, &entry->bytes);
    field_u32(c, &entry->check);
    field_doubles(c, entry->range, 2);
}

void sp_brick_entry_encode(const struct sp_brick_entry *entry,
                           unsigned char out[BRICK_ENTRY_BYTES]) {
    struct sp_brick_entry copy = *entry;
    struct cursor c = { .bytes = out, .writes = true };
    entry_fields(&c, &copy);
}

bool sp_brick_entry_decode(const unsigned char bytes[BRICK_ENTRY_BYTES], uint64_t file_bytes,
                           const char *title, struct sp_brick_entry *entry, struct sp_error *err) {
    unsigned char copy[BRICK_ENTRY_BYTES];
    struct cursor c = { .bytes = memcpy(copy, bytes, sizeof copy) };
    entry_fields(&c, entry);
    bool has_range = entry->range[0] <= entry->range[1];
    if (isnan(entry->range[0]) || isnan(entry->range[1]) ||
        (has_range && !(isfinite(entry->range[0]) && isfinite(entry->range[1]))))
        return fail(title, "the range of a brick", err);
    return entry->bytes == 0 ||
           (entry->bytes <= BRICK_PACKED_MAX && !is_beyond(entry->at, entry->bytes, file_bytes)) ||
           fail(title, "a brick lies beyond its end", err);
}
