/* SPDX-License-Identifier: Apache-2.0
 *
 * Single stages of the GPU backend on software GL: sorting into bins, and errors of shaders and
 * buffers.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <epoxy/gl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "backend/gl/bins.h"
#include "backend/gl/context.h"
#include "backend/gl/program.h"
#include "sp/log.h"
#include "support/compare.h"
#include "support/data.h"
#include "support/gl.h"

/* Tiles and layers of a record, [first, last]; as in shaders/records.glsl. */
struct span {
    uint32_t c0, r0, c1, r1, l0, l1;
};

enum { RECORD_BITS = 22 };

struct sorting {
    struct gl_bins_space space;
    struct span *spans;
    uint32_t records;
    uint32_t *counts; /* indexed by bin */
    uint64_t pairs;
};

static uint32_t bin_of(const struct sorting *s, uint32_t r, uint32_t c, uint32_t layer) {
    return (r * s->space.columns + c) * s->space.layers + layer;
}

static uint32_t below(uint32_t n) {
    return (uint32_t)rand() % n;
}

/* Random spans; a quarter of the records is not drawn. */
static struct sorting make_sorting(uint32_t columns, uint32_t rows, uint32_t layers,
                                   uint32_t records) {
    struct sorting s = { .space = { columns, 0, rows * GL_TILE, rows, layers },
                         .records = records };
    s.spans = calloc(records + (size_t)1, sizeof *s.spans);
    s.counts = calloc(gl_bins_count(&s.space), sizeof *s.counts);
    assert_true(s.spans);
    assert_true(s.counts);
    for (uint32_t i = 0; i < records; i++) {
        struct span *p = &s.spans[i];
        *p = (struct span){ .c0 = below(columns), .r0 = below(rows), .l0 = below(layers) };
        p->l1 = p->l0 + (below(3) ? 0 : below(9));
        p->l1 = p->l1 < layers ? p->l1 : layers - 1;
        p->c1 = p->c0 + below(3) < columns ? p->c0 + below(3) : p->c0;
        p->c1 = p->c1 < columns ? p->c1 : columns - 1;
        p->r1 = p->r0 + below(2) < rows ? p->r0 : rows - 1;
        if (below(4) == 0)
            *p = (struct span){ 1, 0, 0, 0, 0, 0 };
        for (uint32_t r = p->r0; r <= p->r1; r++)
            for (uint32_t c = p->c0; c <= p->c1; c++)
                for (uint32_t l = p->l0; l <= p->l1; l++, s.pairs++)
                    s.counts[bin_of(&s, r, c, l)]++;
    }
    return s;
}

static uint32_t *read_words(const struct gl_buffer *buffer, uint64_t words) {
    uint32_t *copy = malloc((words + 1) * sizeof *copy);
    assert_non_null(copy);
    glBindBuffer(GL_SHADER_STORAGE_BUFFER, buffer->name);
    glGetBufferSubData(GL_SHADER_STORAGE_BUFFER, 0, (GLsizeiptr)(words * sizeof *copy), copy);
    assert_int_equal(glGetError(), GL_NO_ERROR);
    return copy;
}

static void write_spans(const struct sorting *s, struct gl_buffer *to) {
    uint32_t(*words)[2] = calloc(s->records + (size_t)1, sizeof *words);
    assert_non_null(words);
    for (uint32_t i = 0; i < s->records; i++) {
        const struct span *p = &s->spans[i];
        words[i][0] = p->c0 | p->r0 << 10 | (p->l0 & 0xfff) << 20;
        words[i][1] = p->c1 | p->r1 << 10 | p->l0 >> 12 << 20 | (p->l1 - p->l0) << 22;
    }
    assert_true(
        gl_buffer_reserve(to, "spans", (s->records + 1) * sizeof *words, 0, GL_USE_STREAM, NULL));
    gl_buffer_write(to, words, (s->records + 1) * sizeof *words);
    free(words);
}

static void write_counts(const struct sorting *s, struct gl_bins *bins) {
    uint32_t n = gl_bins_count(&s->space), head = GL_BINS_HEAD;
    uint32_t *words = calloc(n + (size_t)head, sizeof *words);
    assert_non_null(words);
    memcpy(words + head, s->counts, n * sizeof *words);
    gl_buffer_write(&bins->counts, words, (n + head) * sizeof *words);
    free(words);
}

/* Checks that the pairs [begin, end) are the records of that bin, each once. */
static void check_bin(const struct sorting *s, const uint32_t *pairs, uint32_t begin, uint32_t end,
                      uint32_t bin, uint32_t *seen, bool is_ordered) {
    uint32_t layer = bin % s->space.layers, tile = bin / s->space.layers;
    uint32_t last = 0, r = tile / s->space.columns, c = tile % s->space.columns;
    for (uint32_t i = begin; i < end; i++) {
        uint32_t record = pairs[i] & ((1u << RECORD_BITS) - 1), l = pairs[i] >> RECORD_BITS;
        assert_compare(record, <, s->records);
        const struct span *p = &s->spans[record];
        assert_int_equal(p->l0 + l, layer);
        assert_compare(layer, <=, p->l1);
        assert_compare(p->r0, <=, r);
        assert_compare(r, <=, p->r1);
        assert_compare(p->c0, <=, c);
        assert_compare(c, <=, p->c1);
        assert_compare(seen[record], !=, bin + 1);
        assert_true(!is_ordered || i == begin || pairs[i] > last);
        last = pairs[i];
        seen[record] = bin + 1;
    }
}

static void check_sorted(const struct sorting *s, const struct gl_bins *bins, bool is_ordered) {
    uint32_t n = gl_bins_count(&s->space), at = 0;
    uint32_t *counts = read_words(&bins->counts, GL_BINS_HEAD + (uint64_t)n);
    uint32_t *totals = read_words(&bins->totals, n / GL_SCAN_BLOCK + 1);
    uint32_t *pairs = read_words(&bins->pairs, s->pairs);
    uint32_t *seen = calloc(s->records + (size_t)1, sizeof *seen);
    assert_non_null(seen);
    for (uint32_t b = 0; b < n; b++) {
        uint32_t end = counts[GL_BINS_HEAD + b] + totals[b / GL_SCAN_BLOCK];
        assert_int_equal(end - at, s->counts[b]);
        check_bin(s, pairs, at, end, b, seen, is_ordered);
        at = end;
    }
    assert_int_equal(at, s->pairs);
    assert_int_equal(((struct gl_bins_head *)(void *)counts)->needed, s->pairs);
    free(seen);
    free(pairs);
    free(totals);
    free(counts);
}

static void sort_and_check(uint32_t columns, uint32_t rows, uint32_t layers, uint32_t records) {
    struct sorting s = make_sorting(columns, rows, layers, records);
    struct gl_bins bins = { 0 };
    struct gl_buffer spans = { 0 };
    assert_true(gl_bins_init(&bins, NULL));
    assert_true(gl_bins_reserve(&bins, gl_bins_count(&s.space), s.pairs + 1, 0, NULL));
    write_spans(&s, &spans);
    write_counts(&s, &bins);
    gl_bins_sort(&bins, &s.space, &spans, records, (uint32_t)s.pairs);
    check_sorted(&s, &bins, false);
    gl_bins_order(&bins, &s.space, (uint32_t)s.pairs, (uint32_t)s.pairs);
    check_sorted(&s, &bins, true);
    gl_buffer_finish(&spans);
    gl_bins_finish(&bins);
    free(s.spans);
    free(s.counts);
}

static void pairs_are_sorted_at_any_size(void **state) {
    (void)state;
    srand(7);
    sort_and_check(1, 1, 1, 0); /* nothing to sort */
    sort_and_check(1, 1, 1, 1);
    sort_and_check(1, 1, 1, 1000); /* one bin */
    sort_and_check(3, 1, 341, 255);
    sort_and_check(4, 4, 64, 256);     /* exactly one block of bins */
    sort_and_check(5, 5, 41, 257);     /* one block and one bin */
    sort_and_check(16, 16, 1, 20000);  /* many records per bin */
    sort_and_check(31, 17, 499, 5000); /* 257 blocks: more than a work group sums at once */
    sort_and_check(2, 2, 16384, 3000); /* layers of more than 12 bits */
}

static void pairs_beyond_the_capacity_are_reported_and_not_written(void **state) {
    (void)state;
    enum { GUARD = 0x5a5a5a5a };
    srand(8);
    struct sorting s = make_sorting(8, 8, 10, 3000);
    struct gl_bins bins = { 0 };
    struct gl_buffer spans = { 0 };
    assert_true(gl_bins_init(&bins, NULL));
    assert_true(gl_bins_reserve(&bins, gl_bins_count(&s.space), s.pairs, 0, NULL));
    uint32_t *guard = malloc(s.pairs * sizeof *guard);
    assert_non_null(guard);
    for (uint64_t i = 0; i < s.pairs; i++)
        guard[i] = GUARD;
    gl_buffer_write(&bins.pairs, guard, s.pairs * sizeof *guard);
    free(guard);
    write_spans(&s, &spans);
    write_counts(&s, &bins);
    gl_bins_sort(&bins, &s.space, &spans, s.records, (uint32_t)s.pairs - 1);
    uint32_t *pairs = read_words(&bins.pairs, s.pairs);
    uint32_t *head = read_words(&bins.counts, GL_BINS_HEAD);
    for (uint64_t i = 0; i < s.pairs; i++)
        assert_int_equal(pairs[i], GUARD);
    assert_int_equal(((struct gl_bins_head *)(void *)head)->needed, s.pairs);
    free(head);
    free(pairs);
    gl_buffer_finish(&spans);
    gl_bins_finish(&bins);
    free(s.spans);
    free(s.counts);
}

/* Sums that do not fit into 32 bits saturate. */
static void too_many_pairs_never_look_like_few(void **state) {
    (void)state;
    struct sorting s = make_sorting(64, 1, 64, 1);
    for (uint32_t b = 0; b < gl_bins_count(&s.space); b++)
        s.counts[b] = 1u << 21; /* 2^33 in all */
    struct gl_bins bins = { 0 };
    struct gl_buffer spans = { 0 };
    assert_true(gl_bins_init(&bins, NULL));
    assert_true(gl_bins_reserve(&bins, gl_bins_count(&s.space), 16, 0, NULL));
    write_spans(&s, &spans);
    write_counts(&s, &bins);
    gl_bins_sort(&bins, &s.space, &spans, s.records, 16);
    uint32_t *head = read_words(&bins.counts, GL_BINS_HEAD);
    assert_compare(((struct gl_bins_head *)(void *)head)->needed, ==, UINT32_MAX);
    free(head);
    gl_buffer_finish(&spans);
    gl_bins_finish(&bins);
    free(s.spans);
    free(s.counts);
}

struct lines {
    unsigned count;
    bool has_line, has_name;
};

static void check_line(void *user, enum sp_log_level level, const char *kind,
                       const struct sp_log_field *fields, const char *line) {
    (void)kind;
    (void)fields;
    struct lines *lines = user;
    (void)level;
    lines->count++;
    lines->has_line = lines->has_line || strstr(line, "no_such_thing") != NULL;
    lines->has_name = lines->has_name || strstr(line, "broken") != NULL;
}

static void a_broken_shader_is_an_error_with_its_log(void **state) {
    (void)state;
    static const char *const broken[] = { "layout(local_size_x = 1) in;\n"
                                          "void main() {\n"
                                          "    no_such_thing = 1;\n"
                                          "    neither = 2;\n"
                                          "}\n",
                                          NULL };
    static const char *const too_wide[] = { "layout(local_size_x = 1000000) in;\n"
                                            "void main() {}\n",
                                            NULL };
    struct lines lines = { 0 };
    struct sp_error err = { 0 };
    sp_log_init(check_line, &lines, SP_LOG_ERROR);
    assert_int_equal(gl_program_create("broken", "", broken, &err), 0);
    assert_int_equal(err.code, SP_ERR_BACKEND);
    assert_non_null(strstr(err.text, "broken"));
    assert_compare(strlen(err.text), <, SP_ERROR_TEXT - 1);
    assert_true(lines.has_line);
    assert_true(lines.has_name);
    assert_compare(lines.count, >=, 3);
    assert_int_equal(gl_program_create("wide", "", too_wide, &err), 0);
    assert_int_equal(err.code, SP_ERR_BACKEND);
    assert_non_null(strstr(err.text, "wide"));
    sp_log_init(NULL, NULL, SP_LOG_INFO);
    assert_int_equal(glGetError(), GL_NO_ERROR);
}

static void buffers_refuse_what_is_too_large(void **state) {
    (void)state;
    struct gl_buffer buffer = { 0 };
    struct sp_error err;
    assert_true(gl_buffer_reserve(&buffer, "words", 1000, 4096, GL_USE_KEPT, &err));
    unsigned name = buffer.name;
    assert_compare(buffer.bytes, >=, 1000);
    assert_compare(buffer.bytes, <=, 4096);
    assert_true(gl_buffer_reserve(&buffer, "words", 900, 4096, GL_USE_KEPT, &err));
    assert_int_equal(buffer.name, name); /* the buffer is large enough and stays */
    assert_false(gl_buffer_reserve(&buffer, "words", 5000, 4096, GL_USE_KEPT, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_non_null(strstr(err.text, "5000"));
    assert_non_null(strstr(err.text, "4096"));
    gl_buffer_finish(&buffer);
    assert_int_equal(buffer.name, 0);
}

int main(void) {
    const struct gl_options options = { .gpu = -1, .software = test_gl_is_software() };
    struct sp_error err;
    struct gl_context *context = gl_context_create(&options, &err);
    if (!context) {
        printf("skipped: %s\n", err.text);
        return TEST_SKIPPED;
    }
    if (!gl_context_bind(context, &err)) {
        printf("FAILED: %s\n", err.text);
        return 1;
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pairs_are_sorted_at_any_size),
        cmocka_unit_test(pairs_beyond_the_capacity_are_reported_and_not_written),
        cmocka_unit_test(too_many_pairs_never_look_like_few),
        cmocka_unit_test(a_broken_shader_is_an_error_with_its_log),
        cmocka_unit_test(buffers_refuse_what_is_too_large),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    gl_context_destroy(&context);
    return failed;
}
