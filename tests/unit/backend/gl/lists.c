/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <epoxy/gl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "support/compare.h"
#include "unit/backend/gl/lists.h"

double uniform(double low, double high) {
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

static void put(enum sp_type type, void *samples, size_t i, double share) {
    static const double low[] = { 3, -120, 0, -30000, -2e9, -1.5 };
    static const double high[] = { 250, 100, 65535, 32000, 2.1e9, 400 };
    double v = low[type] + share * (high[type] - low[type]);
    if (type == SP_UINT8)
        ((uint8_t *)samples)[i] = (uint8_t)v;
    else if (type == SP_INT8)
        ((int8_t *)samples)[i] = (int8_t)v;
    else if (type == SP_UINT16)
        ((uint16_t *)samples)[i] = (uint16_t)v;
    else if (type == SP_INT16)
        ((int16_t *)samples)[i] = (int16_t)v;
    else if (type == SP_INT32)
        ((int32_t *)samples)[i] = (int32_t)v;
    else
        ((float *)samples)[i] = rand() % 97 ? (float)v : rand() % 2 ? NAN : -INFINITY;
}

struct sp_volume *make_volume(const struct shape *shape) {
    const uint32_t *d = shape->dims;
    size_t count = (size_t)d[0] * d[1] * d[2];
    void *samples = calloc(count, 4);
    double *places[3] = { NULL };
    struct sp_grid grid = { .dims = { d[0], d[1], d[2] },
                            .spacing = { 1, 2, 0.5 },
                            .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    assert_non_null(samples);
    for (unsigned a = 0; shape->is_rectilinear && a < 3; a += 2) {
        places[a] = calloc(d[a], sizeof(double));
        assert_non_null(places[a]);
        for (uint32_t i = 1; i < d[a]; i++)
            places[a][i] = places[a][i - 1] + uniform(0.1, 3);
        grid.coordinates[a] = places[a];
        grid.spacing[a] = d[a] > 1 ? places[a][d[a] - 1] / (d[a] - 1) : 1;
        grid.direction[0][1] = 0.6;
        grid.direction[1][1] = 0.8;
    }
    for (size_t i = 0; i < count; i++) {
        uint32_t x = (uint32_t)(i % d[0]), y = (uint32_t)(i / d[0] % d[1]);
        double v = 0.47 + 0.45 * sin(0.3 * x) * cos(0.2 * y) + uniform(-0.02, 0.02);
        put(shape->type, samples, i, 3 * x > 2 * d[0] ? 0.5 : v);
    }
    if (shape->type == SP_FLOAT32) /* a volume without finite samples is refused */
        ((float *)samples)[0] = 100;
    struct sp_error err;
    struct sp_volume *volume = sp_volume_create(&grid, shape->type, samples, "v", &err);
    if (!volume)
        fail_msg("%s", err.text);
    free(samples);
    free(places[0]);
    free(places[2]);
    return volume;
}

struct sp_transfer_function make_function(const struct sp_volume *volume, double from, double to) {
    const double *range = sp_volume_info(volume)->range, span = range[1] - range[0];
    const double shares[4] = { from - 1e-9, from, to, to + 1e-9 };
    struct sp_transfer_function tf = { .reference_length = 1, .point_count = 4 };
    for (uint32_t i = 0; i < 4; i++)
        tf.points[i] = (struct sp_tf_point){ .value = range[0] + span * shares[i],
                                             .color = { 1, (float)uniform(0, 1), 0 },
                                             .opacity = i == 1 || i == 2 ? 0.5f : 0 };
    return tf;
}

void add_gradient_axis(struct sp_transfer_function *tf) {
    tf->gradient_count = 2;
    tf->gradient[0] = (struct sp_gradient_point){ 0, 0 };
    tf->gradient[1] = (struct sp_gradient_point){ 10, 1 };
}

struct sp_classify_job make_job(struct rig *rig, const struct sp_transfer_function *tf,
                                bool normals) {
    return (struct sp_classify_job){ .tf = tf,
                                     .levels = 1,
                                     .axis = SP_NO_AXIS,
                                     .normals = normals,
                                     .reach = 1.3,
                                     .pool = rig->pool };
}

const struct gl_visible_list *get(struct rig *rig, struct sp_volume *volume,
                                  const struct sp_classify_job *job) {
    struct gl_mip_levels levels;
    struct sp_error err;
    if (!gl_mip_levels_get(&levels, &rig->residency, &rig->cache, volume, job, &err))
        fail_msg("%s", err.text);
    return levels.lists[0];
}

void *read_back(const struct gl_buffer *buffer, uint64_t bytes) {
    void *copy = malloc(bytes + 1);
    assert_non_null(copy);
    glBindBuffer(GL_COPY_READ_BUFFER, buffer->name);
    glGetBufferSubData(GL_COPY_READ_BUFFER, 0, (GLsizeiptr)bytes, copy);
    assert_int_equal(glGetError(), GL_NO_ERROR);
    return copy;
}

/* Directions may differ by one step of their map, and magnitudes by one step. */
static void check_normal(uint32_t got, uint32_t wanted, bool is_wide) {
    float a[3], b[3];
    assert_int_equal(got == 0, wanted == 0);
    sp_gradient_unpack(got, a);
    sp_gradient_unpack(wanted, b);
    float x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
    float apart = sqrtf(x * x + y * y + z * z), step = is_wide ? 1.0f / 1023 : 1.0f / 127;
    if (!(apart < 6 * step) || labs((long)(got >> 22) - (long)(wanted >> 22)) > 1)
        fail_msg("%08x for %08x: %g apart", got, wanted, (double)apart);
}

/* Returns the list of the CPU, indexed by the voxel in the brick. */
struct brick {
    bool is_there[SP_BRICK_VOXELS];
    uint32_t key[SP_BRICK_VOXELS], normal[SP_BRICK_VOXELS];
};

static uint32_t read_brick(const struct sp_level *level, uint32_t b, bool normals,
                           struct brick *brick) {
    const struct sp_visible *v = &level->visible;
    uint16_t local[SP_BRICK_VOXELS];
    uint32_t count = (uint32_t)(v->first[b + 1] - v->first[b]);
    memset(brick, 0, sizeof *brick);
    sp_visible_locals(v, b, NULL, 0, count, local);
    for (uint32_t n = 0; n < count; n++) {
        brick->is_there[local[n]] = true;
        brick->key[local[n]] = sp_visible_key(v, v->first[b] + n);
        brick->normal[local[n]] = normals ? sp_visible_normal(v, v->first[b] + n) : 0;
    }
    return count;
}

static bool has_depth(const float got[4], const struct sp_class *wanted) {
    return fabsf(got[3] - wanted->depth) <= 1e-4f * wanted->depth + 1e-7f;
}

void check_class(const float got[4], const struct sp_class *wanted) {
    if (!has_depth(got, wanted))
        fail_msg("depth %g for %g", (double)got[3], (double)wanted->depth);
    for (int k = 0; wanted->depth > 1e-6f && k < 3; k++)
        assert_compare(fabsf(got[k] - wanted->color[k]), <, 1e-4f);
}

static uint32_t key_of(float value) {
    union {
        float value;
        uint32_t bits;
    } u = { .value = value };
    return u.bits;
}

/* Returns the class of a value or of its neighbour in single precision, because the transfer
 * function may jump between the two. */
static struct sp_class class_near(const float got[4], const struct sp_transfer *transfer,
                                  uint32_t key) {
    struct sp_class own = sp_transfer_class(transfer, key);
    float value = sp_transfer_value(transfer, key);
    for (int side = 0; side < 2 && !has_depth(got, &own); side++) {
        uint32_t beside = key_of(nextafterf(value, side ? INFINITY : -INFINITY));
        struct sp_class other = sp_transfer_class(transfer, beside);
        if (has_depth(got, &other))
            return other;
    }
    return own;
}

/* Checks the class of an entry; with order post its value, to one step of single precision. */
static void check_row(const float row[4], const struct sp_transfer *transfer, uint32_t key) {
    struct sp_class wanted = class_near(row, transfer, key);
    float value = sp_transfer_value(transfer, key);
    if (transfer->tf.order == SP_TF_POST) {
        assert_compare(fabsf(row[0] - value), <=, 1.2e-7f * fabsf(value));
        assert_compare(row[3], ==, 0);
    } else {
        check_class(row, &wanted);
    }
}

void check_list(const struct gl_visible_list *list, const struct sp_level *level, bool normals,
                bool is_exact) {
    static struct brick brick;
    const struct sp_transfer *t = &level->transfer;
    uint32_t *words = read_back(&list->entries, list->count * sizeof *words);
    uint32_t bytes = normals ? list->normal_bytes : 0;
    uint64_t classes = list->has_keys ? 0 : list->count;
    float(*rows)[4] = read_back(&list->tables, (list->first_class + classes) * sizeof *rows);
    void *packed = read_back(bytes ? &list->normals : &list->entries, list->count * bytes);
    assert_memory_equal(list->bricks, level->visible.bricks, sizeof list->bricks);
    assert_true(!normals || bytes == level->visible.normal_bytes);
    assert_int_equal(list->has_keys, t->table != NULL);
    assert_compare(list->base, ==, sp_transfer_base(t));
    for (uint32_t b = 0; b < sp_visible_brick_count(list->bricks); b++) {
        uint32_t wanted = read_brick(level, b, normals, &brick), found = 0;
        for (uint64_t e = list->first[b]; e < list->first[b + 1]; e++) {
            uint32_t local = words[e] & 4095, key = words[e] >> 12;
            bool is_there = brick.is_there[local] && (!list->has_keys || brick.key[local] == key);
            if (!is_there && (is_exact || !level->listed || t->is_visible[key]))
                fail_msg("brick %u: voxel %03x has key %u", b, local, key);
            if (!is_there)
                continue;
            brick.is_there[local] = false; /* each voxel once */
            found++;
            if (!list->has_keys)
                check_row(rows[list->first_class + e], t, brick.key[local]);
            if (bytes == 2)
                check_normal(sp_gradient_widen(((uint16_t *)packed)[e]), brick.normal[local],
                             false);
            if (bytes == 4)
                check_normal(((uint32_t *)packed)[e], brick.normal[local], true);
        }
        assert_int_equal(found, wanted);
    }
    assert_int_equal(list->first[sp_visible_brick_count(list->bricks)], list->count);
    free(words);
    free(rows);
    free(packed);
}

void check_against_processor(struct rig *rig, struct sp_volume *volume,
                             const struct sp_classify_job *job, bool is_exact) {
    const struct gl_visible_list *list = get(rig, volume, job);
    struct sp_classification c;
    struct sp_error err;
    sp_classification_init(&c, volume);
    if (!sp_classification_update(&c, job, &err))
        fail_msg("%s", err.text);
    check_list(list, &c.levels[0], job->normals, is_exact);
    sp_classification_finish(&c);
}

void forget(struct rig *rig, struct sp_volume **volume) {
    gl_residency_evict(&rig->residency, *volume);
    sp_classify_cache_evict(&rig->cache, *volume);
    sp_volume_unref(volume);
}

bool has_entries(const struct rig *rig, const struct sp_volume *volume) {
    bool has = false;
    for (int i = 0; i < SP_CLASSIFY_SLOTS; i++)
        has = has || (rig->cache.slots[i].c.volume == volume &&
                      rig->cache.slots[i].c.levels[0].visible.place);
    return has;
}
