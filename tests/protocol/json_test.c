/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/json.h"
#include "protocol/limits.h"
#include "protocol/pointer.h"
#include "support/compare.h"

/* cmocka compares floats only; this one prints both doubles. */
static void assert_double(double actual, double expected) {
    if (actual != expected)
        fail_msg("%.17g is not %.17g", actual, expected);
}

static proto_json *parse(const char *text) {
    struct sp_error err = { 0 };
    proto_json *json = proto_json_parse(text, strlen(text), &err);
    if (!json)
        fail_msg("%s: %s: %s", text, err.place, err.text);
    return json;
}

static void assert_text(const char *text, const char *expected) {
    proto_json *json = parse(text);
    size_t size;
    char *out = proto_json_to_text(json, &size);
    assert_string_equal(out, expected);
    assert_int_equal(size, strlen(expected));
    free(out);
    proto_json_free(&json);
    assert_null(json);
}

static void text_is_compact_and_numbers_are_shortest(void **state) {
    (void)state;
    assert_text(" [ 1 , 2.0,\t0.1 ,1e3, -0.0, 1e22, 1.5e-7]\n", "[1,2,0.1,1000,0,1e+22,1.5e-07]");
    assert_text("[true,false,null,{},[]]", "[true,false,null,{},[]]");
    assert_text("\"\\u0041\\n\\\"\\\\\\/é\\ud83d\\ude00\"", "\"A\\u000a\\\"\\\\/é😀\"");
    assert_text("12345678901234567890123", "1.2345678901234568e+22");
    assert_text("9007199254740993", "9007199254740993");
    assert_text("0.3333333333333333", "0.3333333333333333");
    assert_text("{\"b\":1,\"a\":2}", "{\"b\":1,\"a\":2}");
}

static void doubles_and_floats_round_trip(void **state) {
    (void)state;
    uint64_t seed = 88172645463325252u;
    for (int i = 0; i < 20000; i++) {
        seed ^= seed << 13, seed ^= seed >> 7, seed ^= seed << 17; /* Marsaglia 2003 */
        double d, d2 = 0;
        float f;
        memcpy(&d, &seed, sizeof d);
        memcpy(&f, (char *)&seed + 2, sizeof f);
        if (!isfinite(d) || !isfinite(f))
            continue;
        proto_json *array = proto_json_array();
        proto_json_append_number(&array, d);
        proto_json_append(&array, proto_json_new_float(f));
        assert_int_equal(proto_json_size(array), 2);
        char *text = proto_json_to_text(array, NULL);
        proto_json *back = parse(text);
        assert_true(proto_json_number(proto_json_at(back, 0), &d2));
        assert_double(d2, d);
        assert_true(proto_json_number(proto_json_at(back, 1), &d2));
        assert_double((float)d2, f);
        free(text);
        proto_json_free(&array);
        proto_json_free(&back);
    }
    proto_json *number = proto_json_new_float(0.3f);
    char *text = proto_json_to_text(number, NULL);
    assert_string_equal(text, "0.3");
    free(text);
    proto_json_free(&number);
}

static void infinity_and_nan_are_refused(void **state) {
    (void)state;
    proto_json *object = proto_json_object(), *other = proto_json_object();
    proto_json_set_number(&object, "a", INFINITY);
    assert_null(object);
    proto_json_set_number(&other, "a", NAN);
    assert_null(other);
}

static void canonical_text_does_not_depend_on_order_or_spelling(void **state) {
    (void)state;
    static const char *const same[] = {
        "{\"b\":[1,{\"y\":null,\"x\":0.5}],\"a\":100,\"\\u00e9\":\"\\u0041\"}",
        "{\"é\":\"A\", \"a\":1e2, \"b\":[1.0,{\"x\":5e-1,\"y\":null}]}",
        "{\"a\":100.0,\n\"é\":\"A\",\"b\":[10e-1,{\"x\":0.50,\"y\":null}]}",
    };
    for (int i = 0; i < 3; i++) {
        proto_json *json = parse(same[i]);
        char *text = proto_json_to_canonical(json, NULL);
        assert_string_equal(text, "{\"a\":100,\"b\":[1,{\"x\":0.5,\"y\":null}],\"é\":\"A\"}");
        free(text);
        proto_json_free(&json);
    }
}

static void syntax_errors_have_pointer_line_and_column(void **state) {
    (void)state;
    struct sp_error err;
    const char *text = "{\n  \"camera\": {\n    \"up\": [0, é]\n  }\n}";
    assert_null(proto_json_parse(text, strlen(text), &err));
    assert_int_equal(err.code, SP_ERR_FORMAT);
    assert_string_equal(err.place, "/camera/up/1");
    assert_non_null(strstr(err.text, "line 3, column 16"));
    assert_null(proto_json_parse("{\"a\":{\"b\":1,\"b\":2}}", 19, &err));
    assert_string_equal(err.place, "/a/b");
    assert_non_null(strstr(err.text, "duplicate"));
    assert_null(proto_json_parse(NULL, 0, &err));
    assert_int_equal(err.code, SP_ERR_FORMAT);
    assert_null(proto_json_parse("1 2", 3, NULL));
}

static void errors_of_syntax_have_plain_reasons(void **state) {
    (void)state;
    static const struct {
        const char *text, *reason;
    } cases[] = {
        { "", "line 1, column 1: the text is empty" },
        { " \n ", "line 2, column 2: the text is empty" },
        { "{\"a\":[1", "line 1, column 8: the text ends inside of an array" },
        { "{\"a\":", "line 1, column 6: the text ends inside of an object" },
        { "[\"abc", "line 1, column 6: the text ends inside of a string" },
        { "{} x", "more text follows the end of the document; send one document" },
        { "[\"a\\u0000\"]", "the character \\u0000 is not allowed" },
        { "{\"a\\u0000\":1}", "the character \\u0000 is not allowed" },
        { "{\"a\":1,\"a\":2}", "the object has a duplicate key; keep one of them" },
        { "[1e999]", "the number is beyond 1.7e308, the limit of a double" },
        { "[\"\xff\"]", "line 1, column 3: the byte 0xff is not UTF-8; save the text as UTF-8" },
        { "[\"a\nb\"]", "a string holds the control character 0x0a; write \\u000a" },
        { "[\"\\x41\"]", "a backslash begins no known escape; write \\\\ for a backslash" },
        { "[\"\\\\\\q\"]", "a backslash begins no known escape; write \\\\ for a backslash" },
        { "[\"\\u12G4\"]", "\\u needs four hexadecimal digits" },
        { "[\"\\ud83d\\ude00 \\ud800\"]", "'\\ud800' is half of a surrogate pair" },
        { "[\"\\uDC00\"]", "'\\uDC00' is half of a surrogate pair" },
        { "\xef\xbb\xbf{}", "the text begins with a byte order mark; remove it" },
        { "{a:1}", "a key needs double quotes" },
        { "{'a':1}", "a string needs double quotes" },
        { "{\"a\" 1}", "a colon is missing behind the key" },
        { "[NaN]", "NaN is no number of JSON" },
        { "[-Infinity]", "-Infinity is no number of JSON" },
        { "[1 2]", "2 does not belong here; a comma or a bracket is missing" },
        { "[1 true]", "true does not belong here; a comma or a bracket is missing" },
        { "[0x10]", "0x10 is no number of JSON; write it like -1.5 or 2e3" },
        { "[01]", "01 is no number of JSON; write it like -1.5 or 2e3" },
        { "[1.]", "1. is no number of JSON; write it like -1.5 or 2e3" },
        { "[+1]", "+1 is no number of JSON; write it like -1.5 or 2e3" },
        { "[1e]", "1e is no number of JSON; write it like -1.5 or 2e3" },
        { "[tru]", "'tru' is no value; a string needs double quotes" },
        { "[größe]", "'größe' is no value; a string needs double quotes" },
        { "[1,]", "no comma may stand before ']'" },
        { "{\"a\":1,}", "no comma may stand before '}'" },
        { "[1}", "'}' does not close the array; ']' is missing" },
        { "{\"a\":1]", "']' does not close the object; '}' is missing" },
        { "{/* */}", "comments are not allowed" },
        { "{\"a\":1 \"b\":2}", "a string does not belong here; a comma or a colon is missing" },
        { "[@]", "'@' does not belong here" },
        { "[\x01]", "the control character 0x01 does not belong here" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct sp_error err = { 0 };
        size_t size = strlen(cases[i].text);
        char *exact = malloc(size ? size : 1); /* so that a sanitizer sees reads behind it */
        memcpy(exact, cases[i].text, size);
        assert_null(proto_json_parse(exact, size, &err));
        free(exact);
        assert_int_equal(err.code, SP_ERR_FORMAT);
        const char *reason = strstr(err.text, cases[i].reason);
        assert_string_equal(reason ? reason : err.text, cases[i].reason);
    }
}

static void size_and_depth_are_limited(void **state) {
    (void)state;
    struct sp_error err;
    char *text = malloc(PROTO_BODY_MAX + 1);
    memset(text, ' ', PROTO_BODY_MAX + 1);
    text[0] = '1';
    proto_json *json = proto_json_parse(text, PROTO_BODY_MAX, &err);
    assert_non_null(json);
    proto_json_free(&json);
    assert_null(proto_json_parse(text, PROTO_BODY_MAX + 1, &err));
    assert_int_equal(err.code, SP_ERR_FORMAT);
    assert_non_null(strstr(err.text, "1048577"));
    memset(text, '[', PROTO_DEPTH_MAX);
    memset(text + PROTO_DEPTH_MAX, ']', PROTO_DEPTH_MAX);
    json = proto_json_parse(text, 2 * PROTO_DEPTH_MAX, &err);
    assert_non_null(json);
    proto_json_free(&json);
    memset(text, '[', PROTO_BODY_MAX);
    assert_null(proto_json_parse(text, PROTO_BODY_MAX, &err));
    assert_non_null(strstr(err.text, "deeper than 32"));
    const char *in_strings = "\"[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[\\\"[[[[\"";
    json = parse(in_strings);
    proto_json_free(&json);
    free(text);
}

static void values_are_read_by_type(void **state) {
    (void)state;
    proto_json *json = parse("{\"i\":7,\"r\":7.0,\"f\":7.5,\"big\":1e300,\"s\":\"x\",\"t\":true,"
                             "\"n\":null,\"a\":[1],\"o\":{\"k\":1},\"long\":9007199254740993}");
    int64_t i = -1;
    double d = -1;
    bool b = false;
    assert_true(proto_json_integer(proto_json_get(json, "i"), &i));
    assert_int_equal(i, 7);
    i = -1;
    assert_true(proto_json_integer(proto_json_get(json, "r"), &i));
    assert_int_equal(i, 7);
    assert_false(proto_json_integer(proto_json_get(json, "f"), &i));
    assert_false(proto_json_integer(proto_json_get(json, "big"), &i));
    assert_false(proto_json_integer(proto_json_get(json, "long"), &i));
    assert_false(proto_json_integer(proto_json_get(json, "s"), &i));
    assert_true(proto_json_number(proto_json_get(json, "i"), &d));
    assert_double(d, 7);
    assert_false(proto_json_number(proto_json_get(json, "t"), &d));
    assert_true(proto_json_bool(proto_json_get(json, "t"), &b));
    assert_true(b);
    assert_false(proto_json_bool(proto_json_get(json, "i"), &b));
    assert_string_equal(proto_json_string(proto_json_get(json, "s")), "x");
    assert_null(proto_json_string(proto_json_get(json, "n")));
    assert_int_equal(proto_json_type(proto_json_get(json, "n")), PROTO_JSON_NULL);
    assert_int_equal(proto_json_type(proto_json_get(json, "missing")), PROTO_JSON_NONE);
    assert_int_equal(proto_json_type(proto_json_get(json, "a")), PROTO_JSON_ARRAY);
    assert_int_equal(proto_json_size(proto_json_get(json, "a")), 1);
    assert_int_equal(proto_json_size(proto_json_get(json, "s")), 0);
    assert_null(proto_json_at(proto_json_get(json, "a"), 1));
    assert_null(proto_json_get(NULL, "a"));
    assert_null(proto_json_get(proto_json_get(json, "a"), "k"));
    void *at = NULL;
    const char *key;
    const proto_json *value;
    size_t members = 0;
    while (proto_json_next(json, &at, &key, &value))
        members += proto_json_get(json, key) == value;
    assert_int_equal(members, proto_json_size(json));
    at = NULL;
    assert_false(proto_json_next(proto_json_get(json, "a"), &at, &key, &value));
    proto_json_free(&json);
}

/* A call that fails frees the document and sets it to NULL, so a builder checks only once. */
static void a_null_part_gives_no_document(void **state) {
    (void)state;
    proto_json *object = proto_json_object(), *array = proto_json_array();
    proto_json_set_bool(&object, "b", true);
    proto_json_set(&object, "a", NULL);
    assert_null(object);
    proto_json_set(&object, "a", proto_json_new_integer(1));
    assert_null(object);
    proto_json_append(&array, NULL);
    assert_null(array);
    proto_json_append(&array, proto_json_new_integer(1));
    assert_null(array);
}

static void arrays_of_numbers_are_built_at_once(void **state) {
    (void)state;
    proto_json *numbers = proto_json_numbers((const double[]){ 0.5, -1 }, 2);
    proto_json *integers = proto_json_integers((const uint32_t[]){ 7, UINT32_MAX }, 2);
    proto_json *both = proto_json_array();
    proto_json_append(&both, numbers);
    proto_json_append(&both, integers);
    char *text = proto_json_to_text(both, NULL);
    assert_string_equal(text, "[[0.5,-1],[7,4294967295]]");
    free(text);
    proto_json_free(&both);
}

static void bad_utf8_is_mended(void **state) {
    (void)state;
    proto_json *object = proto_json_object();
    proto_json_set_string(&object, "name", "bad \xff\xc0\xaf\xed\xa0\x80 é\xe2\x82");
    proto_json_set_bool(&object, "b", true);
    proto_json_set_null(&object, "n");
    char *text = proto_json_to_text(object, NULL);
    assert_string_equal(text, "{\"name\":\"bad ?????? é??\",\"b\":true,\"n\":null}");
    free(text);
    proto_json *same = proto_json_ref(object);
    proto_json_free(&object);
    assert_int_equal(proto_json_size(same), 3);
    proto_json_free(&same);
    proto_json_free(&same);
    assert_null(proto_json_to_text(NULL, NULL));
}

static void unknown_members_are_reported_with_their_pointers(void **state) {
    (void)state;
    static const char *const known[] = { "view", "from", NULL };
    struct sp_error err;
    proto_json *json = proto_json_parse("{\"from\":1,\"a/b~\":2}", 19, &err);
    assert_non_null(json);
    assert_false(proto_json_only(json, known, &err));
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_string_equal(err.place, "/a~1b~0");
    assert_string_equal(err.text, "unknown member; known: view, from");
    proto_json_free(&json);
    json = proto_json_parse("{\"from\":1}", 10, &err);
    assert_true(proto_json_only(json, known, &err));
    proto_json_free(&json);
}

static void pointers_are_escaped_and_truncated(void **state) {
    (void)state;
    struct proto_pointer pointer = { .length = 0 };
    proto_pointer_push(&pointer, "a/b~c", 5);
    size_t length = pointer.length;
    proto_pointer_push_index(&pointer, 12);
    assert_string_equal(pointer.text, "/a~1b~0c/12");
    proto_pointer_pop(&pointer, length);
    assert_string_equal(pointer.text, "/a~1b~0c");
    for (int i = 0; i < 100; i++)
        proto_pointer_push(&pointer, "é", 2);
    assert_compare(strlen(pointer.text), <, sizeof pointer.text);
    assert_int_equal((unsigned char)pointer.text[strlen(pointer.text) - 1] & 0x40, 0);
    proto_json *valid = proto_json_new_string(pointer.text);
    assert_string_equal(proto_json_string(valid), pointer.text);
    proto_json_free(&valid);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(text_is_compact_and_numbers_are_shortest),
        cmocka_unit_test(doubles_and_floats_round_trip),
        cmocka_unit_test(infinity_and_nan_are_refused),
        cmocka_unit_test(canonical_text_does_not_depend_on_order_or_spelling),
        cmocka_unit_test(syntax_errors_have_pointer_line_and_column),
        cmocka_unit_test(errors_of_syntax_have_plain_reasons),
        cmocka_unit_test(size_and_depth_are_limited),
        cmocka_unit_test(values_are_read_by_type),
        cmocka_unit_test(a_null_part_gives_no_document),
        cmocka_unit_test(arrays_of_numbers_are_built_at_once),
        cmocka_unit_test(bad_utf8_is_mended),
        cmocka_unit_test(unknown_members_are_reported_with_their_pointers),
        cmocka_unit_test(pointers_are_escaped_and_truncated),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
