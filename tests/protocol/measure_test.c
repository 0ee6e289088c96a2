/* SPDX-License-Identifier: Apache-2.0
 *
 * Measurements in JSON and CSV.
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

#include "protocol/measure.h"

static proto_json *parse(const char *text) {
    struct sp_error err;
    proto_json *json = proto_json_parse(text, strlen(text), &err);
    assert_non_null(json);
    return json;
}

static const char region[] =
    "{\"kind\":\"rectangle\",\"points\":[[0,0,1],[2,0,1],[0,3,1]],\"text\":\"a \\\"b\\\", c\","
    "\"color\":\"#FF8000\",\"hidden\":true}";

static struct proto_measure measure_of(const char *text) {
    struct proto_measure measure = { .id = "m-1", .volume = "head", .author = "Zoë" };
    struct sp_error err;
    proto_json *json = parse(text);
    assert_true(proto_measure_apply(json, true, &measure, &err));
    proto_json_free(&json);
    return measure;
}

static struct proto_measure rectangle(void) {
    struct proto_measure m = measure_of(region);
    m.value = (struct proto_measure_value){
        .world_unit = "mm",
        .data_unit = "HU",
        .result = { .has_value = true,
                    .value = 6,
                    .unit = SP_MEASURE_AREA,
                    .outside = 0.25,
                    .has_statistics = true,
                    .statistics = { 12, 1, 0.1, 1.0 / 3, -5, 1e300 } },
    };
    return m;
}

static void a_measurement_is_read_and_written(void **state) {
    (void)state;
    const struct proto_measure m = rectangle();
    struct proto_measure again = { .is_hidden = false };
    size_t size;
    assert_string_equal(m.color, "#ff8000");
    proto_json *json = proto_measure_encode(&m);
    char *text = proto_json_to_text(json, &size);
    assert_string_equal(
        text, "{\"id\":\"m-1\",\"kind\":\"rectangle\",\"volume\":\"head\",\"points\":[[0,0,1],[2,0,"
              "1],[0,3,1]],\"text\":\"a \\\"b\\\", c\",\"color\":\"#ff8000\",\"author\":\"Zoë\","
              "\"hidden\":true,\"value\":6,\"unit\":\"mm^2\",\"data_unit\":\"HU\",\"outside\":0.25,"
              "\"note\":\"25 % of the "
              "rectangle lies outside of the volume; the statistics count the rest\","
              "\"statistics\":{\"count\":12,"
              "\"nonfinite\":1,\"mean\":0.1,\"deviation\":0.3333333333333333,\"min\":-5,\"max\":"
              "1e+300}}");
    assert_true(proto_measure_restore(json, &again));
    assert_string_equal(again.value.world_unit, "mm");
    assert_string_equal(again.value.data_unit, "HU");
    proto_json *second = proto_measure_encode(&again);
    char *second_text = proto_json_to_text(second, &size);
    assert_string_equal(second_text, text);
    free(second_text);
    free(text);
    proto_json_free(&second);
    proto_json_free(&json);
}

/* Infinite sums are null, and stay so. */
static void numbers_that_are_not_finite_are_null(void **state) {
    (void)state;
    struct proto_measure m = rectangle(), again;
    m.value.result.statistics.mean = m.value.result.statistics.deviation = INFINITY;
    proto_json *json = proto_measure_encode(&m);
    const proto_json *statistics = proto_json_get(json, "statistics");
    assert_int_equal(proto_json_type(proto_json_get(statistics, "mean")), PROTO_JSON_NULL);
    assert_true(proto_measure_restore(json, &again));
    assert_true(isnan(again.value.result.statistics.mean));
    proto_json_free(&json);
}

static void what_is_no_measurement_is_not_restored(void **state) {
    (void)state;
    static const char *const texts[] = {
        "{}",
        "7",
        "{\"id\":\"a b\",\"kind\":\"marker\",\"volume\":\"v\",\"points\":[[0,0,0]],\"text\":\"\","
        "\"color\":\"#000000\",\"author\":\"\",\"hidden\":false,\"value\":1,\"unit\":\"\"}",
        "{\"id\":\"a\",\"kind\":\"marker\",\"volume\":\"v\",\"points\":[[0,0,0]],\"text\":\"\","
        "\"author\":\"\",\"hidden\":false,\"value\":1,\"unit\":\"\"}",
        "{\"id\":\"a\",\"kind\":\"ellipse\",\"volume\":\"v\",\"points\":[[0,0,0],[1,0,0],[0,1,0]],"
        "\"text\":\"\",\"color\":\"#000000\",\"author\":\"\",\"value\":1,\"unit\":\"mm^2\","
        "\"statistics\":{\"count\":-1,\"nonfinite\":0}}",
    };
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        struct proto_measure m;
        proto_json *json = parse(texts[i]);
        assert_false(proto_measure_restore(json, &m));
        proto_json_free(&json);
    }
}

static void a_patch_changes_what_it_names(void **state) {
    (void)state;
    struct proto_measure m = rectangle();
    struct sp_error err;
    proto_json *json = parse("{\"text\":\"\",\"hidden\":false}");
    assert_true(proto_measure_apply(json, false, &m, &err));
    assert_string_equal(m.text, "");
    assert_false(m.is_hidden);
    assert_string_equal(m.color, "#ff8000");
    assert_int_equal(m.geometry.kind, SP_MEASURE_RECTANGLE);
    proto_json_free(&json);
}

static void bad_members_are_refused(void **state) {
    (void)state;
    char long_text[260];
    strcpy(long_text, "{\"text\":\"");
    memset(long_text + 9, 'x', 201);
    strcpy(long_text + 210, "\"}");
    const struct {
        const char *text, *place;
    } cases[] = {
        { "{\"kind\":\"marker\"}", "/kind" },
        { "{\"points\":[[0,0,0]]}", "/points" },
        { "{\"color\":\"red\"}", "/color" },
        { "{\"color\":\"#ff00zz\"}", "/color" },
        { "{\"hidden\":1}", "/hidden" },
        { "{\"text\":7}", "/text" },
        { "{\"text\":\"a\\nb\"}", "/text" },
        { "{\"text\":\"\\u202eb\"}", "/text" },
        { long_text, "/text" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct proto_measure m = rectangle(), before = m;
        struct sp_error err = { .code = SP_OK };
        proto_json *json = parse(cases[i].text);
        assert_false(proto_measure_apply(json, false, &m, &err));
        assert_int_equal(err.code, SP_ERR_INVALID);
        assert_string_equal(err.place, cases[i].place);
        assert_memory_equal(&m, &before, sizeof m);
        proto_json_free(&json);
    }
}

#define HEADER                                                                                     \
    "id,kind,volume,text,author,color,hidden,value,unit,count,nonfinite,mean,deviation,min,max,"   \
    "outside,note,x1,y1,z1,x2,y2,z2,x3,y3,z3,low,high,area,samples,straight,data_unit\r\n"
#define NUMBERS                                                                                    \
    "#ff8000,true,6,mm^2,12,1,0.1,0.3333333333333333,-5,1e+300,0.25,\"25 % of the rectangle lies " \
    "outside of the volume; the statistics count the rest\",0,0,1,2,0,1,0,3,1,,,,,,HU\r\n"

static void csv_follows_rfc_4180(void **state) {
    (void)state;
    struct proto_measure items[2] = { rectangle(), { .id = "m" } };
    size_t size;
    strcpy(items[1].volume, " v");
    items[1].geometry.kind = SP_MEASURE_MARKER;
    items[1].geometry.points[0][1] = -0.1;
    char *text = proto_measures_to_csv(items, 2, &size);
    assert_string_equal(text,
                        HEADER "m-1,rectangle,head,\"a \"\"b\"\", c\",Zoë," NUMBERS
                               "m,marker,\" v\",,,,false,,,,,,,,,0,,0,-0.1,0,,,,,,,,,,,,\r\n");
    assert_int_equal(size, strlen(text));
    free(text);
}

/* https://owasp.org/www-community/attacks/CSV_Injection, with blanks and full-width signs. */
static void csv_has_no_formulas(void **state) {
    (void)state;
    const struct {
        const char *text, *field;
    } cases[] = {
        { "=HYPERLINK(\"http://x\")", "\"'=HYPERLINK(\"\"http://x\"\")\"" },
        { "+1", "\"'+1\"" },
        { "-1", "\"'-1\"" },
        { "@SUM(1)", "\"'@SUM(1)\"" },
        { "\t=1", "\"'\t=1\"" },
        { "\t1", "\"'\t1\"" },
        { "\r1", "\"'\r1\"" },
        { "\n1", "\"'\n1\"" },
        { " =1", "\"' =1\"" },
        { "\xc2\xa0 =1", "\"'\xc2\xa0 =1\"" },       /* no-break space */
        { "\xef\xbb\xbf=1", "\"'\xef\xbb\xbf=1\"" }, /* byte order mark */
        { "\xe3\x80\x80=1", "\"'\xe3\x80\x80=1\"" }, /* ideographic space */
        { "\xe2\x80\x8b-1", "\"'\xe2\x80\x8b-1\"" }, /* zero-width space */
        { "＝1", "\"'＝1\"" },
        { "＋1", "\"'＋1\"" },
        { " －1", "\"' －1\"" },
        { "＠x", "\"'＠x\"" },
        { "−1", "\"'−1\"" },
        { "a;=1+1;b", "\"a;'=1+1;b\"" },
        { "a; \xef\xbb\xbf@x", "\"a;' \xef\xbb\xbf@x\"" },
        { "\"=1", "\"\"\"=1\"" },
        { "1=1 - 2", "1=1 - 2" },
        { "wall, 3-4", "\"wall, 3-4\"" },
        { "größe", "größe" },
        { " x", "\" x\"" },
        { "x ", "\"x \"" },
        { "\xf0", "\xf0" }, /* cut short */
        { "", "" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char expected[600];
        size_t size;
        struct proto_measure m = rectangle();
        strcpy(m.text, cases[i].text);
        strcpy(m.author, cases[i].text);
        strcpy(m.volume, cases[i].text);
        strcpy(m.id, "-1");
        snprintf(expected, sizeof expected, "%s\"'-1\",rectangle,%s,%s,%s,%s", HEADER,
                 cases[i].field, cases[i].field, cases[i].field, NUMBERS);
        char *text = proto_measures_to_csv(&m, 1, &size);
        assert_string_equal(text, expected);
        free(text);
    }
}

static void note_is(struct proto_measure m, double outside, const char *unit,
                    const char *expected) {
    char note[PROTO_MEASURE_NOTE_MAX + 1];
    m.value.result.outside = outside;
    strcpy(m.value.world_unit, unit);
    proto_measure_note(&m.geometry, &m.value, note);
    assert_string_equal(note, expected);
}

static void a_note_says_what_lies_outside_and_that_the_unit_is_not_known(void **state) {
    (void)state;
    const struct proto_measure region_ = rectangle();
    struct proto_measure line = { .value.result.unit = SP_MEASURE_LENGTH };
    struct proto_measure marker = { .geometry.kind = SP_MEASURE_MARKER };
    note_is(region_, 0, "mm", "");
    note_is(region_, 1e-6, "mm",
            "less than 1 % of the rectangle lies outside of the volume; the statistics count the "
            "rest");
    note_is(region_, 0.9999, "mm",
            "more than 99 % of the rectangle lies outside of the volume; the statistics count the "
            "rest");
    note_is(region_, 1, "mm", "the rectangle lies outside of the volume, so it has no statistics");
    note_is(region_, 0.03, "",
            "the volume does not state the unit of its coordinates; 3 % of the rectangle lies "
            "outside of the volume; the statistics count the rest");
    note_is(line, 0, "", "the volume does not state the unit of its coordinates");
    note_is(line, 0.5, "mm", "50 % of the distance lies outside of the volume");
    note_is(marker, 1, "", "the marker lies outside of the volume");
}

/* A session that an earlier daemon saved has no "outside"; a broken one is not believed. */
static void the_share_outside_is_restored(void **state) {
    (void)state;
    const struct proto_measure m = rectangle();
    struct proto_measure again;
    proto_json *json = proto_measure_encode(&m);
    assert_true(proto_measure_restore(json, &again));
    assert_true(again.value.result.outside == 0.25);
    proto_json_set_number(&json, "outside", 7);
    assert_true(proto_measure_restore(json, &again));
    assert_true(again.value.result.outside == 0);
    proto_json_free(&json);
}

/* A marker has the unit of the data. A marker that an earlier daemon saved has no unit. */
static void a_marker_has_the_unit_of_the_data(void **state) {
    (void)state;
    const struct sp_volume_info info = { .unit = "mm", .value_unit = "HU" };
    struct proto_measure m = measure_of("{\"kind\":\"marker\",\"points\":[[0,0,0]]}"), again;
    strcpy(m.color, "#000000");
    m.value.result = (struct sp_measure_result){ .has_value = true, .unit = SP_MEASURE_DATA };
    proto_measure_set_units(&m.value, &info);
    assert_string_equal(m.value.world_unit, "mm");
    proto_json *json = proto_measure_encode(&m);
    assert_string_equal(proto_json_string(proto_json_get(json, "unit")), "HU");
    assert_true(proto_measure_restore(json, &again));
    assert_string_equal(again.value.data_unit, "HU");
    proto_json_set_null(&json, "data_unit");
    assert_true(proto_measure_restore(json, &again));
    assert_string_equal(again.value.data_unit, "");
    proto_json_free(&json);
}

static void an_answer_says_that_the_unit_is_not_known(void **state) {
    (void)state;
    struct proto_measure m = rectangle();
    m.value.result.outside = 0;
    proto_json *json =
        proto_measure_answer("v", &m.geometry, &m.value, &(struct proto_measure_line){ 0 });
    assert_null(proto_json_get(json, "note"));
    assert_string_equal(proto_json_string(proto_json_get(json, "unit")), "mm^2");
    proto_json_free(&json);
    m.value.world_unit[0] = 0;
    json = proto_measure_answer("v", &m.geometry, &m.value, &(struct proto_measure_line){ 0 });
    assert_non_null(proto_json_get(json, "note"));
    assert_string_equal(proto_json_string(proto_json_get(json, "unit")), "");
    proto_json_free(&json);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_measurement_is_read_and_written),
        cmocka_unit_test(numbers_that_are_not_finite_are_null),
        cmocka_unit_test(what_is_no_measurement_is_not_restored),
        cmocka_unit_test(a_patch_changes_what_it_names),
        cmocka_unit_test(bad_members_are_refused),
        cmocka_unit_test(csv_follows_rfc_4180),
        cmocka_unit_test(csv_has_no_formulas),
        cmocka_unit_test(a_marker_has_the_unit_of_the_data),
        cmocka_unit_test(a_note_says_what_lies_outside_and_that_the_unit_is_not_known),
        cmocka_unit_test(the_share_outside_is_restored),
        cmocka_unit_test(an_answer_says_that_the_unit_is_not_known),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
