/* SPDX-License-Identifier: Apache-2.0
 *
 * Settings: command line, configuration files, and secrets.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "config/config.h"
#include "config/secret.h"

static bool parse(struct srv_config *config, struct sp_error *err, const char *a, const char *b,
                  const char *c) {
    char *argv[5] = { (char *)"splatd", (char *)a, (char *)b, (char *)c, NULL };
    int argc = 1 + (a != NULL) + (b != NULL) + (c != NULL);
    assert_true(srv_config_init(config, err));
    return srv_config_parse(config, argc, argv, err);
}

static void defaults_are_set(void **state) {
    (void)state;
    struct srv_config config;
    struct sp_error err;
    assert_true(parse(&config, &err, NULL, NULL, NULL));
    assert_string_equal(config.listen, "127.0.0.1:8080");
    assert_string_equal(config.backend, "auto");
    assert_string_equal(config.gpu, "auto");
    assert_false(config.require_gpu);
    assert_null(config.data);
    assert_int_equal(config.volume_count, 0);
    assert_int_equal(config.body_size, 1 << 20);
    assert_int_equal(config.rest_time_ms, 120);
    srv_config_finish(&config);
}

static void numbers_have_units_and_ranges(void **state) {
    (void)state;
    static const struct {
        const char *name, *value;
        int64_t expected; /* -1 = an error */
        size_t offset;
    } cases[] = {
#define AT(field) offsetof(struct srv_config, field)
        { "--memory", "123", 123, AT(memory) },
        { "--memory", "2K", 2048, AT(memory) },
        { "--memory", "3m", 3 << 20, AT(memory) },
        { "--memory", "1.5G", INT64_C(3) << 29, AT(memory) },
        { "--memory", "2T", INT64_C(2) << 40, AT(memory) },
        { "--memory", "65T", -1, AT(memory) },
        { "--video-memory", "16G", INT64_C(16) << 30, AT(video_memory) },
        { "--video-memory", "some", -1, AT(video_memory) },
        { "--memory", "-1", -1, AT(memory) },
        { "--memory", "", -1, AT(memory) },
        { "--memory", "K", -1, AT(memory) },
        { "--memory", "1KB", -1, AT(memory) },
        { "--memory", "1e3", -1, AT(memory) },
        { "--memory", "0x10", -1, AT(memory) },
        { "--memory", "nan", -1, AT(memory) },
        { "--memory", "1.3", -1, AT(memory) },
        { "--frame-size", "4096x4096", 1 << 24, AT(frame_px) },
        { "--frame-size", "1024x512", 1 << 19, AT(frame_px) },
        { "--frame-size", "16M", 1 << 24, AT(frame_px) },
        { "--frame-size", "300000", 300000, AT(frame_px) },
        { "--frame-size", "8192x8192", 1 << 26, AT(frame_px) },
        { "--frame-size", "107777777777777777777777", -1, AT(frame_px) },
        { "--frame-size", "8192x8193", -1, AT(frame_px) },
        { "--frame-size", "511x512", -1, AT(frame_px) },
        { "--frame-size", "4096x", -1, AT(frame_px) },
        { "--frame-size", "x4096", -1, AT(frame_px) },
        { "--frame-size", "4096x4096x1", -1, AT(frame_px) },
        { "--frame-size", "4096x-4096", -1, AT(frame_px) },
        { "--frame-size", "4096x4K", -1, AT(frame_px) },
        { "--frame-size", "1G", -1, AT(frame_px) },
        { "--threads", "256", 256, AT(threads) },
        { "--threads", "257", -1, AT(threads) },
        { "--threads", "1.5", -1, AT(threads) },
        { "--threads", "1K", -1, AT(threads) },
        { "--threads", "99999999999999999999999", -1, AT(threads) },
        { "--header-time", "0.25", 250, AT(header_time_ms) },
        { "--header-time", "7", 7000, AT(header_time_ms) },
        { "--header-time", "0.001", -1, AT(header_time_ms) },
        { "--participants", "0", -1, AT(participants) },
        { "--participants", "64", 64, AT(participants) },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct srv_config config;
        struct sp_error err;
        bool ok = parse(&config, &err, cases[i].name, cases[i].value, NULL);
        if (cases[i].expected < 0) {
            assert_false(ok);
            assert_int_equal(err.code, SP_ERR_INVALID);
            assert_string_equal(err.place, cases[i].name);
        } else {
            assert_true(ok);
            assert_int_equal(*(int64_t *)((char *)&config + cases[i].offset), cases[i].expected);
        }
        srv_config_finish(&config);
    }
}

static void errors_name_the_value_and_the_limit(void **state) {
    (void)state;
    static const struct {
        const char *name, *value, *text;
    } cases[] = {
        { "--threads", "9000", "9000 is outside [0, 256]" },
        { "--threads", "many", "'many' is not a whole number in [0, 256]" },
        { "--header-time", "0.001", "0.001 is outside [0.05, 600]" },
        { "--memory", "1Q",
          "'1Q' is not a size (a whole number of bytes, or a number with K, M, G or T) in "
          "[0, 65536G]" },
        { "--frame-size", "8192x8193", "8192x8193 is outside [256K, 64M]" },
        { "--require-gpu=1", NULL, "'1' is not yes or no" },
        { "--log-level", "loud", "'loud' is not one of error, warn, info, debug" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct srv_config config;
        struct sp_error err;
        assert_false(parse(&config, &err, cases[i].name, cases[i].value, NULL));
        assert_string_equal(err.text, cases[i].text);
        srv_config_finish(&config);
    }
}

static void options_have_two_forms(void **state) {
    (void)state;
    struct srv_config config;
    struct sp_error err;
    assert_true(parse(&config, &err, "--volume=demo:a?size=3", "--volume", "demo:b"));
    assert_int_equal(config.volume_count, 2);
    assert_string_equal(config.volumes[0], "demo:a?size=3");
    assert_string_equal(config.volumes[1], "demo:b");
    srv_config_finish(&config);
    assert_true(parse(&config, &err, "--listen=a:1", "--listen", "b:2"));
    assert_string_equal(config.listen, "b:2");
    srv_config_finish(&config);
    static const struct {
        const char *a, *b, *c;
        bool expected;
    } switches[] = { { "--require-gpu", "--gpu", "1", true },
                     { "--gpu=1", "--require-gpu", NULL, true },
                     { "--gpu=1", "--require-gpu=yes", NULL, true },
                     { "--gpu=1", "--require-gpu", "--require-gpu=no", false } };
    for (size_t i = 0; i < sizeof switches / sizeof *switches; i++) {
        assert_true(parse(&config, &err, switches[i].a, switches[i].b, switches[i].c));
        assert_string_equal(config.gpu, "1");
        assert_int_equal(config.require_gpu, switches[i].expected);
        srv_config_finish(&config);
    }
    static const char *const wrong[] = { "volume",          "--",         "-h",
                                         "--help=yes",      "--volum",    "--volume",
                                         "--volume=",       "--gpu",      "--require-gpu=",
                                         "--require-gpu=1", "--probe=yes" };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        assert_false(parse(&config, &err, wrong[i], NULL, NULL));
        assert_int_equal(err.code, SP_ERR_INVALID);
        srv_config_finish(&config);
    }
}

static void lines_of_a_file_are_read(void **state) {
    (void)state;
    struct srv_config config;
    struct sp_error err;
    assert_true(srv_config_init(&config, &err));
    assert_true(srv_config_line(&config, "", "f:1", &err));
    assert_true(srv_config_line(&config, "  # listen = x", "f:2", &err));
    assert_true(srv_config_line(&config, "  sessions\t=  7  ", "f:3", &err));
    assert_int_equal(config.sessions, 7);
    assert_true(srv_config_line(&config, "data = /a b/c=d", "f:4", &err));
    assert_string_equal(config.data, "/a b/c=d");
    assert_true(srv_config_line(&config, "require-gpu = yes", "f:4", &err));
    assert_true(config.require_gpu);
    static const char *const wrong[] = {
        "sessions",     "sessions =",     "= 7",         "help = 1",      "config = other",
        "Sessions = 7", "sessions = 7 8", "require-gpu", "require-gpu =", "probe = yes"
    };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        assert_false(srv_config_line(&config, wrong[i], "f:5", &err));
        assert_string_equal(err.place, "f:5");
    }
    assert_int_equal(config.sessions, 7);
    srv_config_finish(&config);
}

static void secrets_are_random_and_compared_whole(void **state) {
    (void)state;
    struct sp_error err;
    char a[33], b[33];
    assert_true(srv_secret_hex(a, 32, &err));
    assert_true(srv_secret_hex(b, 32, &err));
    assert_int_equal(strlen(a), 32);
    assert_int_equal(strspn(a, "0123456789abcdef"), 32);
    assert_string_not_equal(a, b);
    assert_true(srv_secret_equal(a, a));
    assert_false(srv_secret_equal(a, b));
    assert_false(srv_secret_equal(a, ""));
    assert_false(srv_secret_equal(a, NULL));
    assert_false(srv_secret_equal("", ""));
    char twice[65];
    snprintf(twice, sizeof twice, "%s%s", a, a);
    assert_false(srv_secret_equal(a, twice));
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(defaults_are_set),
                                        cmocka_unit_test(numbers_have_units_and_ranges),
                                        cmocka_unit_test(errors_name_the_value_and_the_limit),
                                        cmocka_unit_test(options_have_two_forms),
                                        cmocka_unit_test(lines_of_a_file_are_read),
                                        cmocka_unit_test(secrets_are_random_and_compared_whole) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
