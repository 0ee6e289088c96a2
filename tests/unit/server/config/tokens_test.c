/* SPDX-License-Identifier: Apache-2.0
 *
 * The token file, and the quotas that count snapshots in progress.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "config/tokens.h"
#include "sp/log.h"
#include "support/compare.h"

#define A "0123456789abcdef"
#define B "abcdef0123456789.~_-"

enum {
    ALL =
        SRV_RIGHT_METRICS | SRV_RIGHT_VIEW | SRV_RIGHT_RENDER | SRV_RIGHT_CONTROL | SRV_RIGHT_ADMIN
};

static bool parse(const char *text, struct srv_token **list, size_t *count, struct sp_error *err) {
    return srv_token_file_parse(text, strlen(text), list, count, err);
}

static void a_token_alone_has_all_rights(void **state) {
    (void)state;
    static const char *const files[] = { A, A "\n", "\n# comment\n  " A " \r\n\n" };
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        struct srv_token *list;
        struct sp_error err;
        size_t count;
        assert_true(parse(files[i], &list, &count, &err));
        assert_int_equal(count, 1);
        assert_string_equal(list->text, A);
        assert_int_equal(list->rights, ALL);
        assert_int_equal(list->quota.sessions, 0);
        assert_int_equal(list->quota.snapshots, 0);
        assert_int_equal(list->quota.fps, 0);
        assert_int_equal(list->quota.frame_px, 0);
        free(list);
    }
}

static void lines_have_roles_and_quotas(void **state) {
    (void)state;
    struct srv_token *list;
    struct sp_error err;
    size_t count;
    assert_true(parse(A "\tname=ann role=control sessions=3 snapshots=2 views=7 paths=5 "
                        "fps=24 path-bytes=500M frame-size=1024x512\n"
                        "# the next has no name\n" B " role=metrics\n"
                        "0123456789abcdef-view role=view\n0123456789abcdef-render role=render",
                      &list, &count, &err));
    assert_int_equal(count, 4);
    assert_string_equal(list[0].name, "ann");
    assert_int_equal(list[0].rights, SRV_RIGHT_VIEW | SRV_RIGHT_RENDER | SRV_RIGHT_CONTROL);
    assert_int_equal(list[0].quota.sessions, 3);
    assert_int_equal(list[0].quota.snapshots, 2);
    assert_int_equal(list[0].quota.views, 7);
    assert_int_equal(list[0].quota.paths, 5);
    assert_int_equal(list[0].quota.fps, 24);
    assert_int_equal(list[0].quota.path_bytes, 500 << 20);
    assert_int_equal(list[0].quota.frame_px, 1024 * 512);
    assert_string_equal(list[1].name, "token-3");
    assert_string_equal(list[1].text, B);
    assert_int_equal(list[1].rights, SRV_RIGHT_METRICS);
    assert_int_equal(list[2].rights, SRV_RIGHT_VIEW);
    assert_int_equal(list[3].rights, SRV_RIGHT_VIEW | SRV_RIGHT_RENDER);
    free(list);
}

static void errors_name_the_line(void **state) {
    (void)state;
    static const char *const wrong[] = {
        "",
        "# nothing\n",
        "short-token\n",
        "0123456789abcde!\n",
        A " role\n",
        A " role=king\n",
        A " role=\n",
        A " role=view role=admin\n",
        A " Role=view\n",
        A " name=\n",
        A " name=a,b\n",
        A " name=123456789012345678901234567890123\n",
        A " sessions=0\n",
        A " paths=10001\n",
        A " paths=1 paths=1\n",
        A " sessions=-1\n",
        A " sessions=100001\n",
        A " sessions=1 sessions=2\n",
        A " snapshots=1.5\n",
        A " fps=121\n",
        A " fps=9999999999999999\n",
        A " path-bytes=1023\n",
        A " path-bytes=65T\n",
        A " path-bytes=2x2\n",
        A " path-bytes=1M path-bytes=1M\n",
        A " frame-size=8193x8192\n",
        A " frame-size=some\n",
        A " color=red\n",
        A " =1\n",
    };
    struct srv_token *list;
    struct sp_error err;
    size_t count;
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        err.code = SP_OK;
        if (parse(wrong[i], &list, &count, &err))
            fail_msg("accepted: %s", wrong[i]);
        assert_int_equal(err.code, SP_ERR_INVALID);
        assert_string_equal(err.place, "line 1");
        assert_null(list);
    }
    assert_false(parse(A " frame-size=64x64\n", &list, &count, &err));
    assert_string_equal(err.text, "frame-size: 64x64 is outside [256K, 64M]");
    assert_false(parse(B "\n\n" A " name=x\n" A "\n", &list, &count, &err));
    assert_string_equal(err.place, "line 4");
    assert_false(parse(B " name=x\n" A " name=x\n", &list, &count, &err));
    assert_string_equal(err.place, "line 2");
    assert_false(srv_token_file_parse(A "\n\0\n", 19, &list, &count, &err));
    assert_string_equal(err.place, "line 2");
    char longer[700];
    memset(longer, ' ', sizeof longer);
    memcpy(longer, A, 16);
    longer[sizeof longer - 1] = 'x';
    assert_false(srv_token_file_parse(longer, sizeof longer, &list, &count, &err));
}

static void the_number_of_tokens_is_limited(void **state) {
    (void)state;
    char *text = malloc(32 * (SRV_TOKENS_MAX + 1)), *end = text;
    struct srv_token *list;
    struct sp_error err;
    size_t count;
    for (int i = 0; i <= SRV_TOKENS_MAX; i++)
        end += sprintf(end, A "-%d\n", i);
    assert_false(srv_token_file_parse(text, (size_t)(end - text), &list, &count, &err));
    assert_string_equal(err.place, "line 1001");
    free(text);
}

static void the_mode_and_size_of_the_file_are_checked(void **state) {
    (void)state;
    char path[] = "/tmp/splatd-tokens-XXXXXX";
    struct srv_token *list;
    struct sp_error err;
    size_t count;
    int fd = mkstemp(path);
    assert_compare(fd, >=, 0);
    assert_false(srv_token_file_read(path, &list, &count, &err));
    assert_string_equal(err.place, path);
    assert_int_equal(write(fd, A "\n" B "\n", 38), 38);
    assert_true(srv_token_file_read(path, &list, &count, &err));
    assert_int_equal(count, 2);
    free(list);
    static const mode_t writable[] = { 0620, 0602, 0666 }, others[] = { 0400, 0640, 0644 };
    for (int i = 0; i < 3; i++) {
        assert_int_equal(fchmod(fd, writable[i]), 0);
        assert_false(srv_token_file_read(path, &list, &count, &err));
        assert_int_equal(err.code, SP_ERR_DENIED);
        assert_non_null(strstr(err.text, "chmod 600"));
        assert_int_equal(fchmod(fd, others[i]), 0);
        assert_true(srv_token_file_read(path, &list, &count, &err));
        free(list);
    }
    assert_int_equal(write(fd, "no", 2), 2);
    assert_false(srv_token_file_read(path, &list, &count, &err));
    assert_non_null(strstr(err.text, "line 3"));
    close(fd);
    assert_int_equal(truncate(path, SRV_TOKEN_FILE_BYTES + 1), 0);
    assert_false(srv_token_file_read(path, &list, &count, &err));
    assert_int_equal(err.code, SP_ERR_INVALID);
    unlink(path);
    assert_false(srv_token_file_read(path, &list, &count, &err));
    assert_int_equal(err.code, SP_ERR_IO);
}

static void keep_line(void *user, enum sp_log_level level, const char *kind,
                      const struct sp_log_field *fields, const char *line) {
    (void)level, (void)kind, (void)fields;
    snprintf(user, 512, "%s", line);
}

static void owners_without_a_name_cause_a_warning(void **state) {
    (void)state;
    static const struct {
        const char *text, *warning; /* NULL = none */
    } files[] = {
        { A "\n" B " role=control\n", ": 1 tokens with the role control or render have no name "
                                      "(first: token-2); " },
        { "\n" A " role=render\n" B " role=control name=b\n" A "-3 role=control",
          ": 2 tokens with the role control or render have no name (first: token-2); " },
        { A "\n" B " role=admin\n" A "-3 role=view\n" A "-4 role=metrics\n", NULL },
        { A " role=control name=a\n" B " role=render name=token-1\n", NULL },
    };
    char path[] = "/tmp/splatd-tokens-XXXXXX", said[512];
    int fd = mkstemp(path);
    assert_compare(fd, >=, 0);
    sp_log_init(keep_line, said, SP_LOG_WARN);
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        struct srv_token *list;
        size_t count, size = strlen(files[i].text);
        said[0] = 0;
        assert_int_equal(ftruncate(fd, 0), 0);
        assert_int_equal(pwrite(fd, files[i].text, size, 0), size);
        assert_true(srv_token_file_read(path, &list, &count, NULL));
        if (files[i].warning)
            assert_memory_equal(said + strlen(path), files[i].warning, strlen(files[i].warning));
        else
            assert_string_equal(said, "");
        free(list);
    }
    sp_log_init(NULL, NULL, SP_LOG_INFO);
    close(fd);
    unlink(path);
}

static void set(struct srv_tokens *tokens, const char *text) {
    struct srv_token *list;
    struct sp_error err;
    size_t count;
    assert_true(parse(text, &list, &count, &err));
    assert_true(srv_tokens_set(tokens, list, count, &err));
}

static void a_token_is_found_on_any_line(void **state) {
    (void)state;
    struct sp_error err;
    struct srv_tokens *tokens = srv_tokens_create(&err);
    struct srv_grant grant;
    set(tokens, A " role=view\n" B " role=metrics name=m\n" A B " role=render\n");
    static const struct {
        const char *given;
        unsigned rights;
    } cases[] = { { A, SRV_RIGHT_VIEW },
                  { B, SRV_RIGHT_METRICS },
                  { A B, SRV_RIGHT_VIEW | SRV_RIGHT_RENDER },
                  { B A, 0 },
                  { "", 0 },
                  { NULL, 0 },
                  { A A, 0 } };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        srv_tokens_acquire(tokens, cases[i].given, &grant);
        assert_int_equal(grant.rights, cases[i].rights);
        srv_tokens_release(tokens, &grant);
    }
    srv_tokens_destroy(&tokens);
}

static bool begin(struct srv_tokens *tokens, const struct srv_grant *grant, double now_ms) {
    struct sp_error err = { .code = SP_OK };
    bool ok = srv_tokens_begin_snapshot(tokens, grant, now_ms, &err);
    if (!ok) {
        assert_int_equal(err.code, SP_ERR_QUOTA);
    }
    return ok;
}

static void cancelled_snapshots_do_not_count(void **state) {
    (void)state;
    struct sp_error err;
    struct srv_tokens *tokens = srv_tokens_create(&err);
    struct srv_grant grant;
    set(tokens, A " name=ann snapshots=1 fps=2\n");
    srv_tokens_acquire(tokens, A, &grant);
    for (int i = 0; i < 5; i++) {
        assert_true(begin(tokens, &grant, 5000));
        assert_false(begin(tokens, &grant, 5000));
        srv_tokens_cancel_snapshot(tokens, &grant);
    }
    for (int i = 0; i < 2; i++) {
        assert_true(begin(tokens, &grant, 5000));
        srv_tokens_end_snapshot(tokens, &grant);
    }
    assert_false(begin(tokens, &grant, 5000));
    srv_tokens_release(tokens, &grant);
    srv_tokens_destroy(&tokens);
}

static void quotas_outlive_a_reload(void **state) {
    (void)state;
    struct sp_error err;
    struct srv_tokens *tokens = srv_tokens_create(&err);
    struct srv_grant old, fresh, gone;
    set(tokens, A " name=ann snapshots=2\n" B " name=bob fps=4\n");
    srv_tokens_acquire(tokens, A, &old);
    srv_tokens_acquire(tokens, B, &gone);
    assert_true(begin(tokens, &old, 0));
    assert_true(begin(tokens, &old, 0));
    assert_false(begin(tokens, &old, 0));
    set(tokens, B " name=ann snapshots=2\n"); /* ann has a new token; bob's is removed */
    srv_tokens_acquire(tokens, B, &fresh);
    assert_false(begin(tokens, &fresh, 0));
    srv_tokens_end_snapshot(tokens, &old);
    assert_true(begin(tokens, &fresh, 0));
    srv_tokens_end_snapshot(tokens, &fresh);
    srv_tokens_end_snapshot(tokens, &old);
    /* A grant of the removed token still works. */
    assert_true(begin(tokens, &gone, 1e6));
    srv_tokens_end_snapshot(tokens, &gone);
    srv_tokens_release(tokens, &old);
    srv_tokens_acquire(tokens, A, &old);
    assert_int_equal(old.rights, 0);
    srv_tokens_release(tokens, &gone);
    srv_tokens_release(tokens, &fresh);
    srv_tokens_destroy(&tokens);
}

static void a_name_has_its_rights_and_quota(void **state) {
    (void)state;
    struct sp_error err;
    struct srv_tokens *tokens = srv_tokens_create(&err);
    struct srv_quota quota = { .path_bytes = 5 };
    set(tokens, A " name=ann path-bytes=2K\n" B " name=bob role=view\n");
    assert_false(srv_tokens_of_name(tokens, "eve", NULL, &quota));
    assert_int_equal(quota.path_bytes, 5);
    unsigned rights = 0;
    assert_true(srv_tokens_of_name(tokens, "bob", &rights, &quota));
    assert_int_equal(quota.path_bytes, 0);
    assert_int_equal(rights, SRV_RIGHT_VIEW);
    assert_true(srv_tokens_of_name(tokens, "ann", &rights, &quota));
    assert_int_equal(quota.path_bytes, 2048);
    assert_true(rights & SRV_RIGHT_ADMIN);
    set(tokens, A " name=eve path-bytes=3K\n");
    assert_false(srv_tokens_of_name(tokens, "ann", NULL, &quota));
    assert_true(srv_tokens_of_name(tokens, "eve", NULL, &quota));
    assert_int_equal(quota.path_bytes, 3072);
    srv_tokens_destroy(&tokens);
}

static void fps_limits_snapshots_per_second(void **state) {
    (void)state;
    struct sp_error err;
    struct srv_tokens *tokens = srv_tokens_create(&err);
    struct srv_grant grant;
    unsigned drawn = 0;
    set(tokens, A " fps=5\n");
    srv_tokens_acquire(tokens, A, &grant);
    for (double now_ms = 1e6; now_ms < 1e6 + 10000; now_ms += 20)
        if (begin(tokens, &grant, now_ms)) {
            srv_tokens_end_snapshot(tokens, &grant);
            drawn++;
        }
    assert_in_range(drawn, 53,
                    55); /* one unused second at the start, then 5 in each of 10 seconds */
    srv_tokens_release(tokens, &grant);
    srv_tokens_destroy(&tokens);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_token_alone_has_all_rights),
        cmocka_unit_test(lines_have_roles_and_quotas),
        cmocka_unit_test(errors_name_the_line),
        cmocka_unit_test(the_number_of_tokens_is_limited),
        cmocka_unit_test(the_mode_and_size_of_the_file_are_checked),
        cmocka_unit_test(owners_without_a_name_cause_a_warning),
        cmocka_unit_test(a_token_is_found_on_any_line),
        cmocka_unit_test(cancelled_snapshots_do_not_count),
        cmocka_unit_test(quotas_outlive_a_reload),
        cmocka_unit_test(a_name_has_its_rights_and_quota),
        cmocka_unit_test(fps_limits_snapshots_per_second),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
