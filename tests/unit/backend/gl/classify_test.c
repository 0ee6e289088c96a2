/* SPDX-License-Identifier: Apache-2.0
 *
 * Lists of visible voxels from the GPU equal lists from the CPU, and an edit uploads only a few
 * bytes. Runs on software GL, or on a GPU (support/gl.h).
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "backend/gl/context.h"
#include "backend/gl/program.h"
#include "classify/collect.h"
#include "sp/log.h"
#include "support/compare.h"
#include "support/data.h"
#include "support/gl.h"
#include "support/sanitized.h"
#include "unit/backend/gl/lists.h"

/* Returns the list of the slot that has one. */
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

static void check_functions(struct rig *rig, struct sp_volume *volume, enum sp_tf_order order) {
    static const double shares[][2] = { { 0.2, 0.6 }, { -1, 2 }, { 2, 3 }, { 0.5, 0.5 } };
    for (unsigned m = 0; m < 4 * 3; m++) {
        struct sp_transfer_function tf = make_function(volume, shares[m % 4][0], shares[m % 4][1]);
        tf.order = order;
        if (m >= 8)
            add_gradient_axis(&tf);
        struct sp_classify_job job = make_job(rig, &tf, m >= 4);
        job.reach = m % 2 ? 1.3 : 2.6;
        check_against_processor(rig, volume, &job, false);
        assert_false(has_entries(rig, volume));
    }
}

static void lists_equal_those_of_the_cpu(void **state) {
    struct rig *rig = *state;
    static const uint32_t dims[][3] = { { 17, 33, 5 }, { 16, 16, 16 }, { 1, 1, 1 }, { 40, 3, 50 } };
    const unsigned step = TEST_SANITIZED ? 5 : 1; /* still all types, all sizes, both grids */
    for (unsigned n = 0; n < TYPES * 4 * 2; n += step) {
        struct shape shape = { (enum sp_type)(n % TYPES), { 0 }, n >= TYPES * 4 };
        memcpy(shape.dims, dims[n / TYPES % 4], sizeof shape.dims);
        struct sp_volume *volume = make_volume(&shape);
        check_functions(rig, volume, SP_TF_PRE);
        if (shape.type <= SP_INT16)
            check_histogram(rig, volume);
        check_functions(rig, volume, SP_TF_POST);
        forget(rig, &volume);
    }
}

/* Edits reuse the lists of other transfer functions or make new ones. No list lacks a visible
 * voxel, and the first list is exact. */
static void edits_leave_nothing_out(void **state) {
    struct rig *rig = *state;
    const struct shape shape = { SP_UINT16, { 50, 35, 20 }, false };
    struct sp_volume *volume = make_volume(&shape);
    double from = 0.3, to = 0.6;
    for (int i = 0; i < 60; i++) {
        struct sp_transfer_function tf = make_function(volume, from, to);
        const struct sp_classify_job job = make_job(rig, &tf, i % 7 > 3);
        if (i % 20 == 19)
            gl_residency_evict(&rig->residency, NULL); /* as with a lost context */
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
        before = rig->residency.uploaded;
        get(rig, volume, &job);
        uint64_t uploaded = rig->residency.uploaded - before;
        if (i == 0) /* the samples */
            assert_compare(uploaded, >, 64 * 64 * 64);
        else
            assert_in_range(uploaded, table, table + 500);
        tf.points[0].color[2] = 1; /* only a colour, or nothing */
        before = rig->residency.uploaded;
        get(rig, volume, &job);
        assert_int_equal(rig->residency.uploaded - before, table);
        get(rig, volume, &job);
        assert_int_equal(rig->residency.uploaded - before, table);
    }
    forget(rig, &volume);
}

/* Lists of types without a table, and of order post, cannot be reused. They are still not uploaded.
 */
static void lists_by_value_follow_edits(void **state) {
    struct rig *rig = *state;
    static const enum sp_type types[] = { SP_FLOAT32, SP_INT32, SP_UINT8, SP_FLOAT32 };
    for (unsigned n = 0; n < 4; n++) {
        const struct shape shape = { types[n], { 50, 35, 20 }, n == 3 };
        struct sp_volume *volume = make_volume(&shape);
        double from = 0.3, to = 0.6;
        for (int i = 0; i < 30; i++) {
            struct sp_transfer_function tf = make_function(volume, from, to);
            tf.order = n >= 2 && i % 3 ? SP_TF_POST : SP_TF_PRE;
            struct sp_classify_job job = make_job(rig, &tf, i % 7 > 3);
            job.reach = i % 2 ? 1 : 2;
            if (i % 10 == 9)
                gl_residency_evict(&rig->residency, NULL); /* as with a lost context */
            check_against_processor(rig, volume, &job, false);
            tf.points[1].color[1] = 0.25f; /* the list is reused */
            check_against_processor(rig, volume, &job, false);
            from = fmin(fmax(from + uniform(-0.1, 0.1), 0), 0.9);
            to = fmin(fmax(to + uniform(-0.1, 0.1), from), 1);
        }
        assert_false(has_entries(rig, volume));
        forget(rig, &volume);
    }
}

/* A new colour uploads the points, the starts of the bricks and scales. A new list also uploads the
 * visible range. */
static void an_edit_by_value_uploads_a_few_bytes_a_brick(void **state) {
    struct rig *rig = *state;
    const uint64_t bricks = 4 * 4 * 4, most = (GL_TABLE_SCALES + 16) * 16 + 2 * 4 * bricks + 2000;
    for (int n = 0; n < 2; n++) {
        const struct shape shape = { SP_FLOAT32, { 64, 64, 64 }, false };
        struct sp_volume *volume = make_volume(&shape);
        for (int i = 0; i < 3; i++) {
            struct sp_transfer_function tf = make_function(volume, 0.2 + 0.1 * i, 0.8);
            tf.order = n ? SP_TF_POST : SP_TF_PRE;
            const struct sp_classify_job job = make_job(rig, &tf, true);
            uint64_t before = rig->residency.uploaded;
            assert_in_range(get(rig, volume, &job)->count, 10000, 64 * 64 * 64);
            if (i > 0) /* the first get() also uploads the samples */
                assert_in_range(rig->residency.uploaded - before, 1, most);
            tf.points[0].color[2] = 1;
            before = rig->residency.uploaded;
            get(rig, volume, &job);
            assert_in_range(rig->residency.uploaded - before, 1, most);
            before = rig->residency.uploaded;
            get(rig, volume, &job);
            assert_int_equal(rig->residency.uploaded, before);
        }
        forget(rig, &volume);
    }
}

/* Values that are close together and far from 0, or as far apart as possible, with points between.
 */
static void values_of_any_size_are_distinguished(void **state) {
    struct rig *rig = *state;
    static const struct {
        enum sp_type type;
        double first, step, points[4];
    } cases[] = {
        { SP_FLOAT32, 1000, 0.0009765625, { 1000.05, 1000.1, 1000.2, 1000.25 } },
        { SP_FLOAT32, -8e37, 1e36, { -8.1e37, -3e37, 2e36, 3e36 } },
        { SP_FLOAT32, -2e-4, 1e-6, { -1e-5, 0, 1e-9, 3e-5 } },
        { SP_INT32, -2e9, 2.1e7, { -1.9e9, -1.8e9, 1e9, 1.1e9 } },
        { SP_INT32, 2147483000, 3, { 2147483100, 2147483100.5, 2147483200, 2147483200.25 } },
        { SP_INT16, 100, 1, { 110.3, 110.5, 110.6, 110.8 } },
        { SP_INT32, 100, 1, { 110.3, 110.5, 110.6, 110.8 } },
    };
    for (size_t n = 0; n < 2 * sizeof cases / sizeof cases[0]; n++) {
        enum { COUNT = 18 * 5 * 17 };
        int32_t whole[COUNT];
        int16_t halves[COUNT];
        float reals[COUNT];
        const double *points = cases[n / 2].points;
        enum sp_type type = cases[n / 2].type;
        for (int i = 0; i < COUNT; i++) {
            double v = cases[n / 2].first + cases[n / 2].step * (rand() % 192);
            whole[i] = type == SP_FLOAT32 ? 0 : (int32_t)v;
            halves[i] = type == SP_INT16 ? (int16_t)v : 0;
            reals[i] = (float)v;
        }
        const struct sp_grid grid = { .dims = { 18, 5, 17 },
                                      .spacing = { 1, 1, 1 },
                                      .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
        const void *samples = type == SP_FLOAT32 ? (void *)reals
                              : type == SP_INT32 ? (void *)whole
                                                 : (void *)halves;
        struct sp_volume *volume = sp_volume_create(&grid, type, samples, "v", NULL);
        struct sp_transfer_function tf = { .reference_length = 1, .point_count = 4 };
        assert_non_null(volume);
        tf.order = n % 2 ? SP_TF_POST : SP_TF_PRE;
        for (int i = 0; i < 4; i++)
            tf.points[i] = (struct sp_tf_point){ points[i], { 1, 0.5f, 0 }, i % 3 ? 0.5f : 0 };
        const struct sp_classify_job job = make_job(rig, &tf, true);
        check_against_processor(rig, volume, &job, true);
        assert_false(has_entries(rig, volume));
        forget(rig, &volume);
    }
}

static void count_warnings(void *user, enum sp_log_level level, const char *kind,
                           const struct sp_log_field *fields, const char *line) {
    (void)kind;
    (void)fields;
    struct rig *rig = user;
    rig->warnings +=
        level == SP_LOG_WARN && strstr(line, "volume v is classified by the processor");
}

static void set_capacity(struct rig *rig, uint64_t limit_bytes, uint64_t block_bytes) {
    rig->residency.limit_bytes = limit_bytes;
    rig->residency.block_bytes = rig->residency.classify.block_bytes = block_bytes;
}

/* The samples do not fit into the budget, beside the list, or into one buffer. */
static void the_cpu_classifies_when_gpu_memory_is_short(void **state) {
    struct rig *rig = *state;
    const struct shape shape = { SP_UINT8, { 40, 40, 40 }, false };
    const uint64_t limit = rig->residency.limit_bytes, voxels = 40 * 40 * 40;
    for (int n = 0; n < 3; n++) {
        struct sp_volume *volume = make_volume(&shape);
        struct sp_transfer_function tf =
            make_function(volume, n == 1 ? 0.2 : 0.4, n == 1 ? 0.8 : 0.41);
        const struct sp_classify_job job = make_job(rig, &tf, true);
        rig->warnings = 0;
        get(rig, volume, &job);
        uint64_t lists = gl_residency_bytes(&rig->residency, volume) - voxels;
        assert_int_equal(rig->warnings, 0);
        assert_int_equal(lists > voxels, n == 1);
        gl_residency_evict(&rig->residency, volume);
        sp_classify_cache_evict(&rig->cache, volume);
        set_capacity(rig, n == 0 ? voxels - 1 : n == 1 ? lists : limit, n == 2 ? voxels - 1 : 0);
        for (int again = 0; again < 2; again++)
            check_against_processor(rig, volume, &job, true);
        assert_true(has_entries(rig, volume));
        assert_compare(gl_residency_bytes(&rig->residency, volume), <=, lists);
        assert_int_equal(rig->warnings, 1);
        set_capacity(rig, limit, 0);
        forget(rig, &volume);
    }
}

/* The CPU makes a list that the GPU has counted, and the other way round. */
static void the_cpu_and_the_gpu_alternate(void **state) {
    struct rig *rig = *state;
    const uint64_t limit = rig->residency.limit_bytes;
    static const enum sp_type types[] = { SP_UINT8, SP_FLOAT32, SP_INT32 };
    for (int n = 0; n < 6; n++) {
        const struct shape shape = { types[n % 3], { 30, 20, 40 }, false };
        struct sp_volume *volume = make_volume(&shape);
        struct sp_transfer_function tf = make_function(volume, 0.3, 0.6);
        tf.order = n < 3 ? SP_TF_PRE : SP_TF_POST;
        for (int round = 0; round < 4; round++) {
            const struct sp_classify_job job = make_job(rig, &tf, round > 0);
            bool is_gpu = round % 2 == 0;
            gl_residency_evict(&rig->residency, volume);
            rig->residency.classify.block_bytes = is_gpu ? 0 : 20000; /* the samples take more */
            check_against_processor(rig, volume, &job, false);
            tf.points[1].color[0] = 0.1f * (float)round;
            check_against_processor(rig, volume, &job, false);
            assert_int_equal(has_entries(rig, volume), !is_gpu || (n == 0 && round > 0));
        }
        set_capacity(rig, limit, 0);
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
    struct gl_mip_levels levels;
    struct sp_error err;
    job.cancel = &cancel;
    assert_false(gl_mip_levels_get(&levels, &rig->residency, &rig->cache, volume, &job, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    job.cancel = NULL;
    check_against_processor(rig, volume, &job, true);
    assert_false(has_entries(rig, volume));
    forget(rig, &volume);
}

/* The direction of a voxel may differ by one step of its map: two degrees, or 8 of 255. */
static void check_microflakes(const uint32_t got[2], struct sp_microflakes wanted) {
    for (int i = 0; i < 8; i++) {
        int a = (int)(got[i / 4] >> 8 * (i % 4) & 255);
        int b = (int)(wanted.word[i / 4] >> 8 * (i % 4) & 255);
        if (abs(a - b) > 8)
            fail_msg("microflakes %08x %08x for %08x %08x", got[0], got[1], wanted.word[0],
                     wanted.word[1]);
    }
}

/* Order post: a mean value, and a gradient whose components may each differ by one step. */
static void check_scalar(const float row[4], const struct sp_visible *v, uint64_t e,
                         const struct sp_transfer *transfer, const uint32_t *normal) {
    float value = sp_transfer_value(transfer, sp_visible_key(v, e));
    assert_compare(fabsf(row[0] - value), <=, 1e-5f * fabsf(value) + 1e-5f);
    if (!normal)
        return;
    float a[3], b[3], apart = 0, got = sp_gradient_share(*normal);
    float wanted = sp_gradient_share(sp_visible_normal(v, e));
    sp_gradient_unpack(*normal, a);
    sp_gradient_unpack(sp_visible_normal(v, e), b);
    for (int k = 0; k < 3; k++)
        apart = fmaxf(apart, fabsf(a[k] * got - b[k] * wanted));
    assert_compare(apart, <, 0.01f * sqrtf(wanted) + 1e-4f);
}

static void check_coarse(const struct gl_visible_list *list, const struct sp_level *wanted,
                         bool normals) {
    const struct sp_visible *v = &wanted->visible;
    bool is_post = wanted->transfer.tf.order == SP_TF_POST;
    uint32_t *words = read_back(&list->entries, list->count * sizeof *words);
    uint32_t size = list->normal_bytes / 4;
    uint32_t *packed = read_back(normals ? &list->normals : &list->entries,
                                 normals ? list->count * list->normal_bytes : 0);
    float(*rows)[4] = read_back(&list->tables, (list->first_class + list->count) * sizeof *rows);
    assert_int_equal(list->count, v->count);
    assert_int_equal(list->normal_bytes, normals ? v->normal_bytes : 0);
    assert_memory_equal(list->first, v->first,
                        (sp_visible_brick_count(list->bricks) + 1) * sizeof *v->first);
    for (uint32_t b = 0; b < sp_visible_brick_count(list->bricks); b++) {
        uint16_t local[SP_BRICK_VOXELS];
        uint32_t count = (uint32_t)(v->first[b + 1] - v->first[b]);
        sp_visible_locals(v, b, NULL, 0, count, local);
        for (uint32_t n = 0; n < count; n++) { /* both are sorted by place */
            uint64_t e = v->first[b] + n;
            const float *row = rows[list->first_class + e];
            assert_int_equal(words[e], local[n]);
            if (is_post)
                check_scalar(row, v, e, &wanted->transfer, normals ? &packed[e] : NULL);
            else
                check_class(row, &wanted->transfer.table[e]);
            if (normals && !is_post)
                check_microflakes(&packed[size * e], *sp_visible_microflakes(v, e));
        }
    }
    if (is_post)
        assert_compare(list->base, ==, wanted->transfer.base);
    free(words);
    free(packed);
    free(rows);
}

static void check_levels(struct rig *rig, struct sp_volume *volume,
                         const struct sp_classify_job *job) {
    struct gl_mip_levels levels;
    struct sp_classification c;
    struct sp_error err;
    struct sp_classify_job all = *job;
    if (!gl_mip_levels_get(&levels, &rig->residency, &rig->cache, volume, job, &err))
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

static void mip_levels_equal_those_of_the_cpu(void **state) {
    struct rig *rig = *state;
    static const uint32_t dims[][3] = { { 50, 40, 30 }, { 17, 33, 5 }, { 1, 100, 2 } };
    static const uint32_t levels[] = { 2, 15, 4, 1, 8, 13 };
    static const enum sp_type types[] = { SP_UINT8, SP_INT16, SP_FLOAT32 };
    for (unsigned n = 0; n < 18; n++) {
        struct shape shape = { types[n / 3 % 3], { 0 }, n >= 9 };
        memcpy(shape.dims, dims[n % 3], sizeof shape.dims);
        struct sp_volume *volume = make_volume(&shape);
        struct sp_transfer_function tf = make_function(volume, 0.2, 0.7);
        for (unsigned m = 0; m < 6; m++) {
            if (m == 3) /* the data derived from it is computed again */
                tf = make_function(volume, 0.25, 0.7);
            if (m == 4)
                add_gradient_axis(&tf);
            tf.order = m == 1 || m == 5 ? SP_TF_POST : SP_TF_PRE;
            struct sp_classify_job job = make_job(rig, &tf, m % 2 || m >= 4);
            job.levels = levels[(n + m) % 6];
            check_levels(rig, volume, &job);
        }
        gl_residency_evict(&rig->residency,
                           NULL); /* as with a lost context: from the samples again */
        struct sp_classify_job job = make_job(rig, &tf, true);
        job.levels = 8;
        check_levels(rig, volume, &job);
        forget(rig, &volume);
    }
}

static bool open_rig(struct rig *rig, struct gl_context *context, struct sp_error *err) {
    rig->residency.limit_bytes = rig->cache.limit_bytes = (uint64_t)1 << 30;
    rig->pool = sp_pool_create(2, err);
    return rig->pool && gl_context_bind(context, err) &&
           gl_residency_init(&rig->residency, true, 0, err);
}

int main(void) {
    const struct gl_options options = { .gpu = -1, .software = test_gl_is_software() };
    static struct rig rig;
    struct sp_error err;
    sp_log_init(count_warnings, &rig, SP_LOG_WARN);
    if (TEST_SANITIZED)
        printf("reduced under a sanitizer: every fifth volume\n");
    struct gl_context *context = gl_context_create(&options, &err);
    if (!context) {
        printf("skipped: %s\n", err.text);
        return TEST_SKIPPED;
    }
    if (!open_rig(&rig, context, &err)) {
        printf("FAILED: %s\n", err.text);
        return 1;
    }
#define ON(test)                                                                                   \
    { #test, test, NULL, NULL, &rig }
    const struct CMUnitTest tests[] = {
        ON(lists_equal_those_of_the_cpu),
        ON(edits_leave_nothing_out),
        ON(an_edit_uploads_no_voxels),
        ON(lists_by_value_follow_edits),
        ON(an_edit_by_value_uploads_a_few_bytes_a_brick),
        ON(values_of_any_size_are_distinguished),
        ON(the_cpu_classifies_when_gpu_memory_is_short),
        ON(the_cpu_and_the_gpu_alternate),
        ON(a_cancelled_pass_can_be_made_again),
        ON(mip_levels_equal_those_of_the_cpu),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    gl_residency_finish(&rig.residency);
    sp_classify_cache_evict(&rig.cache, NULL);
    sp_pool_destroy(&rig.pool);
    gl_context_destroy(&context);
    return failed;
}
