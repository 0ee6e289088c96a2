/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/frame_header.h"
#include "protocol/rpc.h"
#include "protocol/volume.h"

#include "protocol/fixture.h"

static void requests_are_decoded(void **state) {
    (void)state;
    const char *text = "{\"jsonrpc\":\"2.0\",\"id\":7,\"method\":\"view.update\",\"params\":{"
                       "\"seq\":3,\"patch\":{}}}";
    struct proto_rpc_message message;
    enum proto_rpc_code code;
    assert_true(proto_rpc_decode(text, strlen(text), &message, &code, NULL));
    assert_string_equal(message.method, "view.update");
    assert_true(message.has_id);
    int64_t seq = 0;
    assert_true(proto_json_integer(proto_json_get(message.params, "seq"), &seq));
    assert_int_equal(seq, 3);
    size_t size;
    proto_json *result = proto_json_object();
    proto_json_set_integer(&result, "seq", 3);
    char *answer = proto_rpc_result(message.id, result, &size);
    assert_string_equal(answer, "{\"jsonrpc\":\"2.0\",\"id\":7,\"result\":{\"seq\":3}}");
    assert_int_equal(size, strlen(answer));
    free(answer);
    proto_rpc_finish(&message);
    proto_rpc_finish(&message);
}

static void notifications_have_no_id(void **state) {
    (void)state;
    const char *text = "{\"jsonrpc\":\"2.0\",\"method\":\"ping\"}";
    struct proto_rpc_message message;
    enum proto_rpc_code code;
    assert_true(proto_rpc_decode(text, strlen(text), &message, &code, NULL));
    assert_false(message.has_id);
    assert_null(message.id);
    assert_null(message.params);
    proto_rpc_finish(&message);
    char *sent = proto_rpc_notification("server.draining", proto_json_object(), NULL);
    assert_string_equal(sent, "{\"jsonrpc\":\"2.0\",\"method\":\"server.draining\",\"params\":{}}");
    free(sent);
    assert_null(proto_rpc_notification("x", NULL, NULL));
    assert_null(proto_rpc_result(NULL, NULL, NULL));
}

static void bad_messages_give_the_code_and_keep_the_id(void **state) {
    (void)state;
    static const struct {
        const char *text;
        int code;
        const char *place, *id;
    } cases[] = {
        { "", -32700, "", "null" },
        { "{", -32700, "", "null" },
        { "{\"jsonrpc\":\"2.0\",\"method\":\"a\",\"method\":\"b\"}", -32700, "/method", "null" },
        { "[]", -32600, "", "null" },
        { "[{\"jsonrpc\":\"2.0\",\"method\":\"a\"}]", -32600, "", "null" },
        { "7", -32600, "", "null" },
        { "{\"id\":1,\"method\":\"a\"}", -32600, "/jsonrpc", "1" },
        { "{\"jsonrpc\":2.0,\"id\":1,\"method\":\"a\"}", -32600, "/jsonrpc", "1" },
        { "{\"jsonrpc\":\"1.0\",\"id\":\"q\",\"method\":\"a\"}", -32600, "/jsonrpc", "\"q\"" },
        { "{\"jsonrpc\":\"2.0\",\"id\":1}", -32600, "/method", "1" },
        { "{\"jsonrpc\":\"2.0\",\"id\":1.5,\"result\":{}}", -32600, "/method", "1.5" },
        { "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"\"}", -32600, "/method", "1" },
        { "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":5}", -32600, "/method", "1" },
        { "{\"jsonrpc\":\"2.0\",\"id\":null,\"method\":\"a\"}", -32600, "/id", "null" },
        { "{\"jsonrpc\":\"2.0\",\"id\":[1],\"method\":\"a\"}", -32600, "/id", "null" },
        { "{\"jsonrpc\":\"2.0\",\"id\":99999999999999999999,\"method\":\"a\"}", -32600, "/id",
          "null" },
        { "{\"jsonrpc\":\"2.0\",\"id\":-9007199254740992,\"method\":\"\"}", -32600, "/method",
          "-9007199254740992" },
        { "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"a\",\"params\":[1]}", -32602, "/params",
          "1" },
        { "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"a\",\"params\":null}", -32602, "/params",
          "1" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct proto_rpc_message message;
        enum proto_rpc_code code = PROTO_RPC_INTERNAL;
        struct sp_error err = { 0 };
        char id[64], number[32];
        if (proto_rpc_decode(cases[i].text, strlen(cases[i].text), &message, &code, &err))
            fail_msg("accepted %s", cases[i].text);
        char *answer = proto_rpc_error(message.id, code, &err, NULL);
        snprintf(id, sizeof id, "\"id\":%s,", cases[i].id);
        snprintf(number, sizeof number, "\"code\":%d,", cases[i].code);
        if (!strstr(answer, id) || !strstr(answer, number) || strcmp(err.place, cases[i].place))
            fail_msg("%s is answered with %s (%s)", cases[i].text, answer, err.place);
        free(answer);
        proto_rpc_finish(&message);
    }
    char text[512];
    struct proto_rpc_message message;
    enum proto_rpc_code code;
    snprintf(text, sizeof text, "{\"jsonrpc\":\"2.0\",\"id\":\"%0257d\",\"method\":\"a\"}", 0);
    assert_false(proto_rpc_decode(text, strlen(text), &message, &code, NULL));
    assert_int_equal(code, PROTO_RPC_REQUEST);
    proto_rpc_finish(&message);
    snprintf(text, sizeof text, "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"%065d\"}", 0);
    assert_false(proto_rpc_decode(text, strlen(text), &message, &code, NULL));
    proto_rpc_finish(&message);
}

static void errors_carry_the_pointer(void **state) {
    (void)state;
    struct sp_error err;
    sp_fail(&err, SP_ERR_INVALID, "/camera/up", "up is zero");
    char *text = proto_rpc_error(NULL, proto_rpc_code_from(err.code), &err, NULL);
    assert_string_equal(text, "{\"jsonrpc\":\"2.0\",\"id\":null,\"error\":{\"code\":-32000,"
                              "\"message\":\"up is zero\",\"data\":{\"pointer\":\"/camera/up\"}}}");
    free(text);
}

static void frame_headers_match_the_documented_layout(void **state) {
    (void)state;
    const struct proto_frame_header header = { .codec = PROTO_CODEC_PNG,
                                               .flags = PROTO_FRAME_KEY | PROTO_FRAME_LOSSLESS,
                                               .frame = 0x01020304,
                                               .seq = 0x05060708,
                                               .width = 0x1112,
                                               .height = 0x2122,
                                               .render_us = 0x31323334,
                                               .encode_us = 0x41424344,
                                               .payload_bytes = 3,
                                               .queue_us = 0x51525354 };
    static const uint8_t expected[39] = { 'S',  'P',  'F',  '1',  2,    5,    36,   0,
                                          4,    3,    2,    1,    8,    7,    6,    5,
                                          0x12, 0x11, 0x22, 0x21, 0x34, 0x33, 0x32, 0x31,
                                          0x44, 0x43, 0x42, 0x41, 3,    0,    0,    0,
                                          0x54, 0x53, 0x52, 0x51, 9,    9,    9 };
    uint8_t message[40] = { 0 };
    memset(message + 36, 9, 3);
    proto_frame_header_encode(&header, message);
    assert_memory_equal(message, expected, sizeof expected);
    struct proto_frame_header back = { 0 };
    assert_true(proto_frame_header_decode(message, 39, &back));
    assert_int_equal(back.codec, header.codec);
    assert_int_equal(back.flags, header.flags);
    assert_int_equal(back.frame, header.frame);
    assert_int_equal(back.seq, header.seq);
    assert_int_equal(back.width, header.width);
    assert_int_equal(back.height, header.height);
    assert_int_equal(back.render_us, header.render_us);
    assert_int_equal(back.encode_us, header.encode_us);
    assert_int_equal(back.payload_bytes, header.payload_bytes);
    assert_int_equal(back.queue_us, header.queue_us);
    for (size_t size = 0; size <= 40; size++)
        if (size != 39)
            assert_false(proto_frame_header_decode(message, size, &back));
    static const struct {
        int at;
        uint8_t value;
    } broken[] = { { 0, 's' }, { 3, '2' }, { 4, 0 },  { 6, 35 },
                   { 6, 37 },  { 7, 1 },   { 28, 2 }, { 31, 0xff } };
    for (size_t i = 0; i < sizeof broken / sizeof *broken; i++) {
        uint8_t copy[39];
        memcpy(copy, message, sizeof copy);
        copy[broken[i].at] = broken[i].value;
        assert_false(proto_frame_header_decode(copy, sizeof copy, &back));
    }
    uint8_t later[43]; /* a later version whose header has four more bytes */
    memcpy(later, message, 36);
    memset(later + 36, 9, 7);
    later[6] = 40;
    assert_true(proto_frame_header_decode(later, sizeof later, &back));
}

static void frame_headers_have_the_camera_and_the_depth(void **state) {
    (void)state;
    const struct proto_frame_header header = { .codec = PROTO_CODEC_JPEG,
                                               .flags = PROTO_FRAME_KEY | PROTO_FRAME_DEPTH,
                                               .payload_bytes = 3 };
    const struct proto_frame_depth depth = { .depth_bytes = 2,
                                             .columns = 0x0102,
                                             .rows = 0x0304,
                                             .near = 1.5f,
                                             .far = 2.5f,
                                             .camera = { .position = { 1, 2, 3 },
                                                         .target = { 4, 5, 6 },
                                                         .up = { 0, -1, 0.5 },
                                                         .fov_y = 30 } };
    uint8_t message[141] = { 0 };
    proto_frame_header_encode(&header, message);
    proto_frame_depth_encode(&depth, message + 36);
    assert_int_equal(message[6], 136);
    static const uint8_t expected[20] = {
        2, 0, 0, 0, 2, 1, 4, 3, 0, 0, 0xc0, 0x3f, 0, 0, 0x20, 0x40
    };
    assert_memory_equal(message + 36, expected, sizeof expected);
    struct proto_frame_header back;
    struct proto_frame_depth back_depth;
    assert_true(proto_frame_header_decode(message, sizeof message, &back));
    assert_int_equal(back.payload_bytes, 3);
    assert_true(proto_frame_depth_decode(message, sizeof message, &back_depth));
    assert_int_equal(back_depth.depth_bytes, 2);
    assert_int_equal(back_depth.columns, depth.columns);
    assert_int_equal(back_depth.rows, depth.rows);
    assert_true(back_depth.near == 1.5f && back_depth.far == 2.5f);
    assert_memory_equal(&back_depth.camera, &depth.camera, sizeof depth.camera);
    struct proto_frame_depth flat = depth;
    flat.camera.projection = SP_ORTHOGRAPHIC;
    flat.camera.height = 7;
    proto_frame_depth_encode(&flat, message + 36);
    assert_true(proto_frame_depth_decode(message, sizeof message, &back_depth));
    assert_int_equal(back_depth.camera.projection, SP_ORTHOGRAPHIC);
    assert_true(back_depth.camera.height == 7 && back_depth.camera.fov_y == 0);
    for (size_t size = 0; size < sizeof message; size++)
        assert_false(proto_frame_depth_decode(message, size, &back_depth));
    message[36] = 3; /* one byte more than there is */
    assert_false(proto_frame_header_decode(message, sizeof message, &back));
    message[36] = 2;
    message[39] = 0xff;
    assert_false(proto_frame_header_decode(message, sizeof message, &back));
    message[39] = 0;
    message[6] = 135;
    assert_false(proto_frame_header_decode(message, sizeof message, &back));
    message[6] = 136;
    message[5] = PROTO_FRAME_KEY; /* a longer header of another version, and five bytes follow */
    assert_false(proto_frame_depth_decode(message, sizeof message, &back_depth));
}

static void volumes_are_encoded(void **state) {
    (void)state;
    struct sp_volume_info info = fixture_info();
    proto_json *volume = proto_volume_encode(&info, "an id", true);
    const proto_json *counts = proto_json_get(proto_json_get(volume, "histogram"), "counts");
    assert_int_equal(proto_json_size(counts), 256);
    proto_json_free(&volume);
    volume = proto_volume_encode(&info, "an id", false);
    char *text = proto_json_to_text(volume, NULL);
    assert_string_equal(
        text, "{\"id\":\"an "
              "id\",\"name\":\"fixture\",\"source\":\"\",\"kind\":\"grid\",\"dims\":[64,64,32],"
              "\"spacing\":[1,1,2.5],\"origin\":[-10,0,0.125],\"direction\":[[1,0,0],[0,1,0],"
              "[0,0,1]],\"unit\":\"mm\",\"type\":\"uint8\",\"components\":1,\"range\":[0,255],"
              "\"nonfinite\":0,\"noise\":0,\"fields\":[{\"name\":\"\",\"components\":1,"
              "\"type\":\"uint8\",\"range\":[0,255],\"unit\":\"\"}],\"bytes\":131072}");
    free(text);
    proto_json_free(&volume);
    strcpy(info.anatomy, "LPS");
    volume = proto_volume_encode(&info, "an id", false);
    text = proto_json_to_text(proto_json_get(volume, "anatomy"), NULL);
    assert_string_equal(text, "[\"L\",\"P\",\"S\"]");
    free(text);
    proto_json_free(&volume);
    strcpy(info.value_name, "magnitude");
    strcpy(info.vector_name, "wind");
    strcpy(info.value_unit, "m/s");
    info.longest = 12.5;
    info.vector_bytes = 12 * 131072;
    volume = proto_volume_encode(&info, "an id", false);
    text = proto_json_to_text(proto_json_get(volume, "fields"), NULL);
    assert_string_equal(text,
                        "[{\"name\":\"magnitude\",\"components\":1,\"type\":\"uint8\",\"range\":"
                        "[0,255],\"unit\":\"m/s\"},{\"name\":\"wind\",\"components\":3,"
                        "\"type\":\"float32\",\"range\":[0,12.5],\"unit\":\"m/s\"}]");
    int64_t bytes;
    assert_true(proto_json_integer(proto_json_get(volume, "bytes"), &bytes));
    assert_int_equal(bytes, 13 * 131072);
    free(text);
    proto_json_free(&volume);
    info.elements =
        (struct sp_elements_shape){ .kind = SP_KIND_GAUSSIANS, .count = 7, .degree = 2 };
    info.element_spacing = 0.5;
    volume = proto_volume_encode(&info, "an id", false);
    text = proto_json_to_text(proto_json_get(volume, "elements"), NULL);
    assert_string_equal(text, "{\"count\":7,\"spacing\":0.5,\"degree\":2}");
    free(text);
    proto_json_free(&volume);
    info.elements = (struct sp_elements_shape){ .kind = SP_KIND_POINTS, .count = 9 };
    info.folded = 4;
    strcpy(info.warnings[0], "One.");
    strcpy(info.warnings[1], "Two.");
    volume = proto_volume_encode(&info, "an id", false);
    assert_non_null(volume);
    text = proto_json_to_text(proto_json_get(volume, "elements"), NULL);
    assert_non_null(strstr(text, "\"folded\":4"));
    free(text);
    text = proto_json_to_text(proto_json_get(volume, "warnings"), NULL);
    assert_string_equal(text, "[\"One.\",\"Two.\"]");
    free(text);
    proto_json_free(&volume);
    info.folded = 0;
    info.warnings[0][0] = 0;
    info.elements = (struct sp_elements_shape){ .kind = SP_KIND_GRID };
    const double x[3] = { 0, 1, 4 }, z[2] = { 0, 2.5 };
    info.grid = (struct sp_grid){ .dims = { 3, 64, 2 }, .coordinates = { x, NULL, z } };
    volume = proto_volume_encode(&info, "an id", false);
    text = proto_json_to_text(proto_json_get(volume, "coordinates"), NULL);
    assert_string_equal(text, "[[0,1,4],null,[0,2.5]]");
    free(text);
    proto_json_free(&volume);
}

/* Compares the member "noise" of the volume with JSON text; NULL = there is no such member. */
static void check_noise(const struct sp_volume_info *info, const char *expected) {
    proto_json *volume = proto_volume_encode(info, "an id", false);
    assert_non_null(volume);
    const proto_json *noise = proto_json_get(volume, "noise");
    if (expected) {
        char *text = proto_json_to_text(noise, NULL);
        assert_non_null(text);
        assert_string_equal(text, expected);
        free(text);
    } else {
        assert_null(noise);
    }
    proto_json_free(&volume);
}

static void only_grids_have_noise_and_unknown_noise_is_null(void **state) {
    (void)state;
    struct sp_volume_info info = fixture_info();
    info.noise = 2.5;
    check_noise(&info, "2.5");
    info.noise = NAN;
    check_noise(&info, "null");
    info.elements = (struct sp_elements_shape){ .kind = SP_KIND_POINTS, .count = 9 };
    check_noise(&info, NULL);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(requests_are_decoded),
        cmocka_unit_test(notifications_have_no_id),
        cmocka_unit_test(bad_messages_give_the_code_and_keep_the_id),
        cmocka_unit_test(errors_carry_the_pointer),
        cmocka_unit_test(frame_headers_match_the_documented_layout),
        cmocka_unit_test(frame_headers_have_the_camera_and_the_depth),
        cmocka_unit_test(volumes_are_encoded),
        cmocka_unit_test(only_grids_have_noise_and_unknown_noise_is_null),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
