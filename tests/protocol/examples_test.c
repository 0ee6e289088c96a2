/* SPDX-License-Identifier: Apache-2.0
 *
 * Decodes every file of protocol/examples. The decoder accepts the valid files, and they
 * round-trip bit for bit; the invalid files give the error that they name.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/fixture.h"
#include "protocol/limits.h"
#include "protocol/view.h"
#include "support/compare.h"

static char *read_file(const char *path, size_t *size) {
    FILE *file = fopen(path, "rb");
    char *bytes = malloc(PROTO_BODY_MAX);
    assert_non_null(file);
    assert_non_null(bytes);
    *size = fread(bytes, 1, PROTO_BODY_MAX, file);
    fclose(file);
    return bytes;
}

static proto_json *parse_file(const char *path) {
    size_t size;
    char *bytes = read_file(path, &size);
    struct sp_error err = { 0 };
    proto_json *json = proto_json_parse(bytes, size, &err);
    if (!json)
        print_error("%s: %s: %s\n", path, err.place, err.text);
    free(bytes);
    return json;
}

/* Calls `check` for each .json file of a folder. Returns the number of files; *failed is the number
 * of failures. */
static int each_file(const char *kind, bool (*check)(const char *path), int *failed) {
    char folder[512], path[1024];
    snprintf(folder, sizeof folder, "%s/protocol/examples/%s", SPLATD_SOURCE_DIR, kind);
    DIR *dir = opendir(folder);
    assert_non_null(dir);
    int count = 0;
    *failed = 0;
    for (const struct dirent *entry; (entry = readdir(dir));) {
        if (!strstr(entry->d_name, ".json"))
            continue;
        snprintf(path, sizeof path, "%s/%s", folder, entry->d_name);
        *failed += !check(path);
        count++;
    }
    closedir(dir);
    return count;
}

static bool check_valid(const char *path) {
    struct sp_error err = { 0 };
    struct sp_view defaults = fixture_view(), view = defaults, again;
    proto_json *patch = parse_file(path);
    bool ok = patch && proto_view_apply(patch, &defaults, &view, &err);
    if (!ok)
        print_error("%s: %s: %s\n", path, err.place, err.text);
    proto_json *encoded = proto_view_encode(&view);
    again = fixture_view();
    again.camera.fov_y = 77;
    ok = ok && proto_view_apply(encoded, &defaults, &again, &err);
    if (ok && !sp_view_equal(&again, &view)) {
        print_error("%s: encoding and decoding changed the view\n", path);
        ok = false;
    }
    proto_json_free(&encoded);
    proto_json_free(&patch);
    return ok;
}

static void valid_examples_are_accepted(void **state) {
    (void)state;
    int failed;
    assert_compare(each_file("valid", check_valid, &failed), >=, 10);
    assert_int_equal(failed, 0);
}

/* Returns the bytes of an invalid example: its view, its text, or its hexadecimal bytes. The caller
 * frees them. */
static char *example_bytes(const proto_json *example, size_t *size) {
    const proto_json *view = proto_json_get(example, "view");
    const char *text = proto_json_string(proto_json_get(example, "text"));
    const char *hex = proto_json_string(proto_json_get(example, "hex"));
    if (view)
        return proto_json_to_text(view, size);
    if (text) {
        *size = strlen(text);
        return strdup(text);
    }
    *size = hex ? strlen(hex) / 2 : 0;
    char *bytes = malloc(*size + 1);
    for (size_t i = 0; i < *size && bytes; i++) {
        unsigned value;
        if (sscanf(hex + 2 * i, "%2x", &value) != 1)
            fail_msg("bad hexadecimal %s", hex);
        bytes[i] = (char)value;
    }
    return bytes;
}

static bool check_invalid(const char *path) {
    proto_json *example = parse_file(path);
    if (!example)
        return false;
    const proto_json *error = proto_json_get(example, "error");
    const char *code = proto_json_string(proto_json_get(error, "code"));
    const char *pointer = proto_json_string(proto_json_get(error, "pointer"));
    if (!code || !pointer) {
        print_error("%s: the member \"error\" with code and pointer is missing\n", path);
        proto_json_free(&example);
        return false;
    }
    size_t size;
    char *bytes = example_bytes(example, &size);
    struct sp_error err = { 0 };
    struct sp_view defaults = fixture_view(), view = defaults;
    proto_json *patch = proto_json_parse(bytes, size, &err);
    bool accepted = patch && proto_view_apply(patch, &defaults, &view, &err);
    bool has_error = !accepted && strcmp(sp_code_name(err.code), code) == 0 &&
                     strcmp(err.place, pointer) == 0 && err.text[0];
    if (!has_error)
        print_error("%s: expected the error %s at \"%s\", got %s at \"%s\": %s\n", path, code,
                    pointer, accepted ? "no error" : sp_code_name(err.code), err.place, err.text);
    bool is_unchanged = sp_view_equal(&view, &defaults);
    if (!is_unchanged)
        print_error("%s: the refused patch changed the view\n", path);
    proto_json_free(&patch);
    proto_json_free(&example);
    free(bytes);
    return has_error && is_unchanged;
}

static void invalid_examples_give_their_error(void **state) {
    (void)state;
    int failed;
    assert_compare(each_file("invalid", check_invalid, &failed), >=, 40);
    assert_int_equal(failed, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(valid_examples_are_accepted),
        cmocka_unit_test(invalid_examples_give_their_error),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
