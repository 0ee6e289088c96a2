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
        .result = { .has_value = true,
                    .value = 6,
                    .unit = SP_MEASURE_AREA,
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
              "\"hidden\":true,\"value\":6,\"unit\":\"mm^2\",\"statistics\":{\"count\":12,"
              "\"nonfinite\":1,\"mean\":0.1,\"deviation\":0.3333333333333333,\"min\":-5,\"max\":"
              "1e+300}}");
    assert_true(proto_measure_restore(json, &again));
    assert_string_equal(again.value.world_unit, "mm");
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

static void csv_follows_rfc_4180_and_has_no_formulas(void **state) {
    (void)state;
    struct proto_measure items[3] = { rectangle(), rectangle(), { .id = "m" } };
    size_t size;
    strcpy(items[1].text, "=HYPERLINK(\"http://x\")");
    strcpy(items[1].author, "@me");
    strcpy(items[2].volume, "-v");
    items[2].geometry.kind = SP_MEASURE_MARKER;
    items[2].geometry.points[0][1] = -0.1;
    char *text = proto_measures_to_csv(items, 3, &size);
    assert_string_equal(
        text,
        "id,kind,volume,text,author,color,hidden,value,unit,count,nonfinite,mean,deviation,min,max,"
        "x1,y1,z1,x2,y2,z2,x3,y3,z3\r\n"
        "m-1,rectangle,head,\"a \"\"b\"\", c\",Zoë,#ff8000,true,6,mm^2,12,1,0.1,"
        "0.3333333333333333,-5,1e+300,0,0,1,2,0,1,0,3,1\r\n"
        "m-1,rectangle,head,\"'=HYPERLINK(\"\"http://x\"\")\",\"'@me\",#ff8000,true,6,mm^2,12,1,"
        "0.1,0.3333333333333333,-5,1e+300,0,0,1,2,0,1,0,3,1\r\n"
        "m,marker,\"'-v\",,,,false,,,,,,,,,0,-0.1,0,,,,,,\r\n");
    assert_int_equal(size, strlen(text));
    free(text);
}

static void an_answer_says_that_the_unit_is_not_known(void **state) {
    (void)state;
    struct proto_measure m = rectangle();
    proto_json *json = proto_measure_answer("v", &m.geometry, &m.value, NULL, 0);
    assert_null(proto_json_get(json, "note"));
    assert_string_equal(proto_json_string(proto_json_get(json, "unit")), "mm^2");
    proto_json_free(&json);
    m.value.world_unit[0] = 0;
    json = proto_measure_answer("v", &m.geometry, &m.value, NULL, 0);
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
        cmocka_unit_test(csv_follows_rfc_4180_and_has_no_formulas),
        cmocka_unit_test(an_answer_says_that_the_unit_is_not_known),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
