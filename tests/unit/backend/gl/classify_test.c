/* SPDX-License-Identifier: Apache-2.0
 *
 * Lists that the GPU makes are those of the processor, and an edit uploads next to nothing. On
 * software GL.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <epoxy/gl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "backend/gl/context.h"
#include "backend/gl/levels.h"
#include "backend/gl/program.h"
#include "classify/collect.h"
#include "sp/log.h"
#include "support/data.h"

struct rig {
    struct gl_lists lists;
    struct sp_classify_cache cache;
    struct sp_pool *pool;
    unsigned warnings;
};

static double uniform(double low, double high) {
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

/* A volume, and what it is made of. */
struct shape {
    enum sp_type type;
    uint32_t dims[3];
    bool is_rectilinear; /* along axes 0 and 2, and sheared */
};

static void put(enum sp_type type, void *samples, size_t i, double share) {
    static const double low[] = { 3, -120, 0, -30000 }, high[] = { 250, 100, 65535, 32000 };
    double v = low[type] + share * (high[type] - low[type]);
    if (type == SP_UINT8)
        ((uint8_t *)samples)[i] = (uint8_t)v;
    else if (type == SP_INT8)
        ((int8_t *)samples)[i] = (int8_t)v;
    else if (type == SP_UINT16)
        ((uint16_t *)samples)[i] = (uint16_t)v;
    else
        ((int16_t *)samples)[i] = (int16_t)v;
}

/* Smooth with noise; a third of it is one value. */
static struct sp_volume *make_volume(const struct shape *shape) {
    const uint32_t *d = shape->dims;
    size_t count = (size_t)d[0] * d[1] * d[2];
    void *samples = calloc(count, 2);
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
    struct sp_error err;
    struct sp_volume *volume = sp_volume_create(&grid, shape->type, samples, "v", &err);
    if (!volume)
        fail_msg("%s", err.text);
    free(samples);
    free(places[0]);
    free(places[2]);
    return volume;
}

/* Visible where the share of the range lies in [from, to]. */
static struct sp_transfer_function make_function(const struct sp_volume *volume, double from,
                                                 double to) {
    const double *range = sp_volume_info(volume)->range, span = range[1] - range[0];
    const double shares[4] = { from - 1e-9, from, to, to + 1e-9 };
    struct sp_transfer_function tf = { .reference_length = 1, .point_count = 4 };
    for (uint32_t i = 0; i < 4; i++)
        tf.points[i] = (struct sp_tf_point){ .value = range[0] + span * shares[i],
                                             .color = { 1, (float)uniform(0, 1), 0 },
                                             .opacity = i == 1 || i == 2 ? 0.5f : 0 };
    return tf;
}

static void add_gradient_axis(struct sp_transfer_function *tf) {
    tf->gradient_count = 2;
    tf->gradient[0] = (struct sp_gradient_point){ 0, 0 };
    tf->gradient[1] = (struct sp_gradient_point){ 10, 1 };
}

static struct sp_classify_job make_job(struct rig *rig, const struct sp_transfer_function *tf,
                                       bool normals) {
    return (struct sp_classify_job){
        .tf = tf, .levels = 1, .axis = SP_NO_AXIS, .normals = normals, .pool = rig->pool
    };
}

static const struct gl_list *get(struct rig *rig, struct sp_volume *volume,
                                 const struct sp_classify_job *job) {
    struct gl_levels levels;
    struct sp_error err;
    if (!gl_levels_get(&levels, &rig->lists, &rig->cache, volume, job, &err))
        fail_msg("%s", err.text);
    return levels.lists[0];
}

static void *read_back(const struct gl_buffer *buffer, uint64_t bytes) {
    void *copy = malloc(bytes + 1);
    assert_non_null(copy);
    glBindBuffer(GL_COPY_READ_BUFFER, buffer->name);
    glGetBufferSubData(GL_COPY_READ_BUFFER, 0, (GLsizeiptr)bytes, copy);
    assert_int_equal(glGetError(), GL_NO_ERROR);
    return copy;
}

/* Directions at most a step of their map apart, which stretches it, and magnitudes a step. */
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

/* The processor's list, by voxel of the brick: key + 1, and normal. */
struct brick {
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
        brick->key[local[n]] = sp_visible_key(v, v->first[b] + n) + 1;
        brick->normal[local[n]] = normals ? sp_visible_normal(v, v->first[b] + n) : 0;
    }
    return count;
}

/* What of the processor's lists the GPU's differ in is nothing. What is hidden may be missing. */
static void check_list(const struct gl_list *list, const struct sp_level *level, bool normals,
                       bool is_exact) {
    static struct brick brick;
    const struct sp_transfer *t = &level->transfer;
    uint32_t *words = read_back(&list->entries, list->count * sizeof *words);
    uint32_t bytes = normals ? list->normal_bytes : 0;
    void *packed = read_back(bytes ? &list->normals : &list->entries, list->count * bytes);
    assert_memory_equal(list->bricks, level->visible.bricks, sizeof list->bricks);
    assert_true(!normals || bytes == level->visible.normal_bytes);
    for (uint32_t b = 0; b < gl_list_bricks(list); b++) {
        uint32_t wanted = read_brick(level, b, normals, &brick), found = 0;
        for (uint64_t e = list->first[b]; e < list->first[b + 1]; e++) {
            uint32_t local = words[e] & 4095, key = words[e] >> 12;
            bool is_there = brick.key[local] == key + 1;
            if (!is_there && (is_exact || t->is_visible[key]))
                fail_msg("brick %u: voxel %03x has key %u", b, local, key);
            if (!is_there)
                continue;
            brick.key[local] = 0; /* each once */
            found++;
            if (bytes == 2)
                check_normal(sp_gradient_widen(((uint16_t *)packed)[e]), brick.normal[local],
                             false);
            if (bytes == 4)
                check_normal(((uint32_t *)packed)[e], brick.normal[local], true);
        }
        assert_int_equal(found, wanted);
    }
    assert_int_equal(list->first[gl_list_bricks(list)], list->count);
    free(words);
    free(packed);
}

/* Compares with a list that the processor makes of nothing. */
static void check_against_processor(struct rig *rig, struct sp_volume *volume,
                                    const struct sp_classify_job *job, bool is_exact) {
    const struct gl_list *list = get(rig, volume, job);
    struct sp_classification c;
    struct sp_error err;
    sp_classification_init(&c, volume);
    if (!sp_classification_update(&c, job, &err))
        fail_msg("%s", err.text);
    check_list(list, &c.levels[0], job->normals, is_exact);
    sp_classification_finish(&c);
}

static void forget(struct rig *rig, struct sp_volume **volume) {
    gl_lists_forget(&rig->lists, *volume);
    sp_classify_cache_forget(&rig->cache, *volume);
    sp_volume_unref(volume);
}

/* Whether the processor has made entries of the volume's finest level. */
static bool has_entries(const struct rig *rig, const struct sp_volume *volume) {
    bool has = false;
    for (int i = 0; i < SP_CLASSIFY_SLOTS; i++)
        has = has || (rig->cache.slots[i].c.volume == volume &&
                      rig->cache.slots[i].c.levels[0].visible.place);
    return has;
}

/* Of the slot that has one. */
static void check_histogram(struct rig *rig, const struct sp_volume *volume) {
    const struct sp_classification *c = NULL;
    for (int i = 0; i < SP_CLASSIFY_SLOTS; i++)
        if (rig->cache.slots[i].c.volume == volume && rig->cache.slots[i].c.histogram)
            c = &rig->cache.slots[i].c;
    assert_non_null(c);
    const struct sp_transfer *transfer = &c->levels[0].transfer;
    uint64_t *wanted = sp_collect_histogram(transfer, volume, rig->pool, NULL);
    assert_non_null(wanted);
    assert_memory_equal(c->histogram, wanted, transfer->count * sizeof *wanted);
    free(wanted);
}

static void lists_are_those_of_the_processor(void **state) {
    struct rig *rig = *state;
    static const enum sp_type types[] = { SP_UINT8, SP_INT8, SP_UINT16, SP_INT16 };
    static const uint32_t dims[][3] = { { 17, 33, 5 }, { 16, 16, 16 }, { 1, 1, 1 }, { 40, 3, 50 } };
    static const double shares[][2] = { { 0.2, 0.6 }, { -1, 2 }, { 2, 3 }, { 0.5, 0.5 } };
    for (unsigned n = 0; n < 4 * 4 * 2; n++) {
        struct shape shape = { types[n % 4], { 0 }, n >= 16 };
        memcpy(shape.dims, dims[n / 4 % 4], sizeof shape.dims);
        struct sp_volume *volume = make_volume(&shape);
        for (unsigned m = 0; m < 4 * 3; m++) {
            struct sp_transfer_function tf =
                make_function(volume, shares[m % 4][0], shares[m % 4][1]);
            if (m >= 8)
                add_gradient_axis(&tf);
            const struct sp_classify_job job = make_job(rig, &tf, m >= 4);
            check_against_processor(rig, volume, &job, false);
            assert_false(has_entries(rig, volume));
        }
        check_histogram(rig, volume);
        forget(rig, &volume);
    }
}

/* Lists that were made for other functions serve, or new ones are made; none lacks what is visible,
 * and the first is exact. */
static void edits_leave_nothing_out(void **state) {
    struct rig *rig = *state;
    const struct shape shape = { SP_UINT16, { 50, 35, 20 }, false };
    struct sp_volume *volume = make_volume(&shape);
    double from = 0.3, to = 0.6;
    for (int i = 0; i < 60; i++) {
        struct sp_transfer_function tf = make_function(volume, from, to);
        const struct sp_classify_job job = make_job(rig, &tf, i % 7 > 3);
        if (i % 20 == 19)
            gl_lists_forget(&rig->lists, NULL); /* as with a lost context */
        check_against_processor(rig, volume, &job, i == 0);
        from += i % 11 == 10 ? uniform(-0.3, 0.2) : uniform(-0.03, 0.03);
        from = fmin(fmax(from, 0), 0.9);
        to = fmin(fmax(to + uniform(-0.03, 0.03), from), 1);
    }
    assert_false(has_entries(rig, volume));
    forget(rig, &volume);
}

static void an_edit_uploads_no_voxels(void **state) {
    struct rig *rig = *state;
    const struct shape shape = { SP_UINT8, { 64, 64, 64 }, false };
    struct sp_volume *volume = make_volume(&shape);
    uint32_t values =
        (uint32_t)(sp_volume_info(volume)->range[1] - sp_volume_info(volume)->range[0]) + 1;
    uint64_t table = (values + GL_TABLE_SCALES + 1) * sizeof(float[4]), before;
    static const double shares[][2] = { { 0.2, 0.8 }, { 0.25, 0.8 }, { 0.2, 0.8 },
                                        { 0.1, 0.9 }, { 0.6, 0.9 },  { -1, 2 } };
    for (size_t i = 0; i < sizeof shares / sizeof shares[0]; i++) {
        struct sp_transfer_function tf = make_function(volume, shares[i][0], shares[i][1]);
        const struct sp_classify_job job = make_job(rig, &tf, true);
        before = rig->lists.uploaded;
        get(rig, volume, &job);
        uint64_t uploaded = rig->lists.uploaded - before;
        if (i == 0) /* the samples */
            assert_true(uploaded > 64 * 64 * 64);
        else
            assert_in_range(uploaded, table, table + 500);
        tf.points[0].color[2] = 1; /* a colour alone, or nothing at all */
        before = rig->lists.uploaded;
        get(rig, volume, &job);
        assert_int_equal(rig->lists.uploaded - before, table);
        get(rig, volume, &job);
        assert_int_equal(rig->lists.uploaded - before, table);
    }
    forget(rig, &volume);
}

static void count_warnings(void *user, enum sp_log_level level, const char *line) {
    struct rig *rig = user;
    rig->warnings +=
        level == SP_LOG_WARN && strstr(line, "volume v is classified by the processor");
}

static void set_room(struct rig *rig, uint64_t limit_bytes, uint64_t block_bytes) {
    rig->lists.limit_bytes = limit_bytes;
    rig->lists.block_bytes = rig->lists.classify.block_bytes = block_bytes;
}

/* Samples that do not fit into the budget, beside the list, or into a buffer. */
static void without_room_the_processor_classifies(void **state) {
    struct rig *rig = *state;
    const struct shape shape = { SP_UINT8, { 40, 40, 40 }, false };
    const uint64_t limit = rig->lists.limit_bytes, voxels = 40 * 40 * 40;
    for (int n = 0; n < 3; n++) {
        struct sp_volume *volume = make_volume(&shape);
        struct sp_transfer_function tf =
            make_function(volume, n == 1 ? 0.2 : 0.4, n == 1 ? 0.8 : 0.41);
        const struct sp_classify_job job = make_job(rig, &tf, true);
        rig->warnings = 0;
        get(rig, volume, &job);
        uint64_t lists = gl_lists_bytes(&rig->lists, volume) - voxels;
        assert_int_equal(rig->warnings, 0);
        assert_int_equal(lists > voxels, n == 1);
        gl_lists_forget(&rig->lists, volume);
        sp_classify_cache_forget(&rig->cache, volume);
        set_room(rig, n == 0 ? voxels - 1 : n == 1 ? lists : limit, n == 2 ? voxels - 1 : 0);
        for (int again = 0; again < 2; again++)
            check_against_processor(rig, volume, &job, true);
        assert_true(has_entries(rig, volume));
        assert_true(gl_lists_bytes(&rig->lists, volume) <= lists);
        assert_int_equal(rig->warnings, 1);
        set_room(rig, limit, 0);
        forget(rig, &volume);
    }
}

static void a_cancelled_pass_can_be_made_again(void **state) {
    struct rig *rig = *state;
    const struct shape shape = { SP_UINT8, { 50, 40, 30 }, false };
    struct sp_volume *volume = make_volume(&shape);
    struct sp_transfer_function tf = make_function(volume, 0.2, 0.7);
    struct sp_classify_job job = make_job(rig, &tf, true);
    atomic_bool cancel = true;
    struct gl_levels levels;
    struct sp_error err;
    job.cancel = &cancel;
    assert_false(gl_levels_get(&levels, &rig->lists, &rig->cache, volume, &job, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    job.cancel = NULL;
    check_against_processor(rig, volume, &job, true);
    assert_false(has_entries(rig, volume));
    forget(rig, &volume);
}

/* A voxel's direction may be off by a step of its map, which is two degrees, or 8 of 255. */
static void check_flakes(const uint32_t got[2], struct sp_flakes wanted) {
    for (int i = 0; i < 8; i++) {
        int a = (int)(got[i / 4] >> 8 * (i % 4) & 255);
        int b = (int)(wanted.word[i / 4] >> 8 * (i % 4) & 255);
        if (abs(a - b) > 8)
            fail_msg("flakes %08x %08x for %08x %08x", got[0], got[1], wanted.word[0],
                     wanted.word[1]);
    }
}

/* Depths rounded otherwise, and colours of what has a depth. */
static void check_class(const float got[4], const struct sp_class *wanted) {
    assert_true(fabsf(got[3] - wanted->depth) <= 1e-4f * wanted->depth + 1e-7f);
    for (int k = 0; wanted->depth > 1e-6f && k < 3; k++)
        assert_true(fabsf(got[k] - wanted->color[k]) < 1e-4f);
}

static void check_coarse(const struct gl_list *list, const struct sp_level *wanted, bool normals) {
    const struct sp_visible *v = &wanted->visible;
    uint32_t *words = read_back(&list->entries, list->count * sizeof *words);
    uint32_t(*flakes)[2] = read_back(normals ? &list->normals : &list->entries,
                                     normals ? list->count * sizeof *flakes : 0);
    float(*rows)[4] = read_back(&list->tables, (list->first_class + list->count) * sizeof *rows);
    assert_int_equal(list->count, v->count);
    assert_memory_equal(list->first, v->first, (gl_list_bricks(list) + 1) * sizeof *v->first);
    for (uint32_t b = 0; b < gl_list_bricks(list); b++) {
        uint16_t local[SP_BRICK_VOXELS];
        uint32_t count = (uint32_t)(v->first[b + 1] - v->first[b]);
        sp_visible_locals(v, b, NULL, 0, count, local);
        for (uint32_t n = 0; n < count; n++) { /* both rise by place */
            uint64_t e = v->first[b] + n;
            assert_int_equal(words[e], local[n]);
            check_class(rows[list->first_class + e], &wanted->transfer.table[e]);
            if (normals)
                check_flakes(flakes[e], *sp_visible_flakes(v, e));
        }
    }
    free(words);
    free(flakes);
    free(rows);
}

static void check_levels(struct rig *rig, struct sp_volume *volume,
                         const struct sp_classify_job *job) {
    struct gl_levels levels;
    struct sp_classification c;
    struct sp_error err;
    struct sp_classify_job all = *job;
    if (!gl_levels_get(&levels, &rig->lists, &rig->cache, volume, job, &err))
        fail_msg("%s", err.text);
    for (unsigned l = 0; l < SP_LEVELS; l++)
        assert_int_equal(levels.lists[l] != NULL, job->levels >> l & 1);
    sp_classification_init(&c, volume);
    all.levels = 15;
    if (!sp_classification_update(&c, &all, &err))
        fail_msg("%s", err.text);
    if (levels.lists[0])
        check_list(levels.lists[0], &c.levels[0], job->normals, false);
    for (unsigned l = 1; l < 4; l++)
        if (levels.lists[l])
            check_coarse(levels.lists[l], &c.levels[l], job->normals);
    sp_classification_finish(&c);
    assert_false(has_entries(rig, volume));
}

static void coarse_levels_are_those_of_the_processor(void **state) {
    struct rig *rig = *state;
    static const uint32_t dims[][3] = { { 50, 40, 30 }, { 17, 33, 5 }, { 1, 100, 2 } };
    static const uint32_t levels[] = { 2, 15, 4, 1, 8, 13 };
    for (unsigned n = 0; n < 12; n++) {
        struct shape shape = { n % 2 ? SP_UINT8 : SP_INT16, { 0 }, n >= 6 };
        memcpy(shape.dims, dims[n % 3], sizeof shape.dims);
        struct sp_volume *volume = make_volume(&shape);
        struct sp_transfer_function tf = make_function(volume, 0.2, 0.7);
        for (unsigned m = 0; m < 6; m++) {
            if (m == 3) /* what was made of it is made anew */
                tf = make_function(volume, 0.25, 0.7);
            if (m == 4)
                add_gradient_axis(&tf);
            struct sp_classify_job job = make_job(rig, &tf, m % 2 || m >= 4);
            job.levels = levels[(n + m) % 6];
            check_levels(rig, volume, &job);
        }
        gl_lists_forget(&rig->lists, NULL); /* as with a lost context: from the samples again */
        struct sp_classify_job job = make_job(rig, &tf, true);
        job.levels = 8;
        check_levels(rig, volume, &job);
        forget(rig, &volume);
    }
}

static bool open_rig(struct rig *rig, struct gl_context *context, struct sp_error *err) {
    rig->lists.limit_bytes = rig->cache.limit_bytes = (uint64_t)1 << 30;
    rig->pool = sp_pool_create(2, err);
    return rig->pool && gl_context_bind(context, err) && gl_lists_init(&rig->lists, true, 0, err);
}

int main(void) {
    const struct gl_options options = { .gpu = -1, .software = true };
    static struct rig rig;
    struct sp_error err;
    sp_log_init(count_warnings, &rig, SP_LOG_WARN);
    struct gl_context *context = gl_context_create(&options, &err);
    if (!context) {
        printf("skipped: no software GL here: %s\n", err.text);
        return TEST_SKIPPED;
    }
    if (!open_rig(&rig, context, &err)) {
        printf("FAILED: %s\n", err.text);
        return 1;
    }
#define ON(test)                                                                                   \
    { #test, test, NULL, NULL, &rig }
    const struct CMUnitTest tests[] = {
        ON(lists_are_those_of_the_processor),   ON(edits_leave_nothing_out),
        ON(an_edit_uploads_no_voxels),          ON(without_room_the_processor_classifies),
        ON(a_cancelled_pass_can_be_made_again), ON(coarse_levels_are_those_of_the_processor),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    gl_lists_finish(&rig.lists);
    sp_classify_cache_forget(&rig.cache, NULL);
    sp_pool_destroy(&rig.pool);
    gl_context_destroy(&context);
    return failed;
}
