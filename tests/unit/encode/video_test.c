/* SPDX-License-Identifier: Apache-2.0
 *
 * Decodes video packets with libvpx and compares them with the encoded images. There is no decoder
 * for H.264, so its tests check the structure of the stream.
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
#include <vpx/vp8dx.h>
#include <vpx/vpx_decoder.h>

#include "sp/encode.h"
#include "sp/video.h"
#include "support/compare.h"

static struct sp_frame make_frame(uint32_t width, uint32_t height) {
    struct sp_frame frame = { .width = width, .height = height, .format = SP_RGBA8 };
    frame.stride_bytes = ((size_t)width * 4 + 64 + 63) / 64 * 64;
    frame.pixels = aligned_alloc(64, frame.stride_bytes * height);
    assert_non_null(frame.pixels);
    memset(frame.pixels, 0xa5, frame.stride_bytes * height);
    return frame;
}

static uint8_t *pixel(const struct sp_frame *frame, uint32_t x, uint32_t y) {
    return (uint8_t *)frame->pixels + y * frame->stride_bytes + 4 * x;
}

static uint8_t wave(double phase) {
    return (uint8_t)(127.5 + 100 * sin(phase));
}

/* Draws an image similar to a rendered object that moves with `time`. */
static void draw(struct sp_frame *frame, int time) {
    double cx = frame->width / 2.0 + 3 * time, cy = frame->height / 2.0;
    for (uint32_t y = 0; y < frame->height; y++)
        for (uint32_t x = 0; x < frame->width; x++) {
            uint8_t *p = pixel(frame, x, y);
            double dx = x - cx, dy = y - cy, r = sqrt(dx * dx + dy * dy);
            bool inside = r < frame->height * 0.4;
            p[0] = inside ? wave(r / 9) : 10;
            p[1] = inside ? wave(dx / 13 + time * 0.1) : 20;
            p[2] = inside ? wave(dy / 17) : 30;
            p[3] = 255;
        }
}

struct decoder {
    vpx_codec_ctx_t codec;
};

static void begin(struct decoder *decoder, enum sp_video_codec codec) {
    vpx_codec_iface_t *interface = codec == SP_VIDEO_VP8 ? vpx_codec_vp8_dx() : vpx_codec_vp9_dx();
    assert_int_equal(vpx_codec_dec_init(&decoder->codec, interface, NULL, 0), VPX_CODEC_OK);
}

/* Returns NULL if the packet cannot be decoded. */
static const vpx_image_t *decode(struct decoder *decoder, const struct sp_video_packet *packet) {
    vpx_codec_iter_t at = NULL;
    if (vpx_codec_decode(&decoder->codec, packet->bytes, (unsigned)packet->size, NULL, 0) !=
        VPX_CODEC_OK)
        return NULL;
    return vpx_codec_get_frame(&decoder->codec, &at);
}

static double clamp(double v) {
    return v < 0 ? 0 : v > 255 ? 255 : v;
}

/* Returns the peak signal-to-noise ratio over all three colours [dB]. Converts the decoded image by
 * the inverse of BT.601, limited range. */
static double psnr(const struct sp_frame *frame, const vpx_image_t *image) {
    double sum = 0;
    assert_int_equal(image->d_w, frame->width);
    assert_int_equal(image->d_h, frame->height);
    assert_int_equal(image->fmt, VPX_IMG_FMT_I420);
    for (uint32_t y = 0; y < frame->height; y++)
        for (uint32_t x = 0; x < frame->width; x++) {
            const uint8_t *p = pixel(frame, x, y);
            double l = 1.164384 * (image->planes[0][y * (size_t)image->stride[0] + x] - 16);
            double u = image->planes[1][y / 2 * (size_t)image->stride[1] + x / 2] - 128;
            double v = image->planes[2][y / 2 * (size_t)image->stride[2] + x / 2] - 128;
            double d[3] = { clamp(l + 1.596027 * v) - p[0],
                            clamp(l - 0.391762 * u - 0.812968 * v) - p[1],
                            clamp(l + 2.017232 * u) - p[2] };
            sum += d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        }
    double mean = sum / (3.0 * frame->width * frame->height);
    return 10 * log10(255 * 255 / (mean + 1e-9));
}

static struct sp_video *create(enum sp_video_codec codec) {
    struct sp_error err = { .code = SP_OK };
    struct sp_video *video = sp_video_create(codec, 2, &err);
    if (!video)
        fail_msg("%s", err.text);
    return video;
}

static struct sp_video_packet encode(struct sp_video *video, const struct sp_frame *frame,
                                     int quality, bool key) {
    struct sp_video_packet packet;
    struct sp_error err = { .code = SP_OK };
    if (!sp_video_encode(video, frame, quality, key, &packet, &err))
        fail_msg("%s", err.text);
    assert_compare(packet.size, >, 0);
    return packet;
}

static void codecs_are_found_by_name(void **state) {
    (void)state;
    assert_int_equal(sp_video_codec_find("vp8"), SP_VIDEO_VP8);
    assert_int_equal(sp_video_codec_find("VP9"), SP_VIDEO_VP9);
    assert_int_equal(sp_video_codec_find("h264"), SP_VIDEO_H264);
    assert_int_equal(sp_video_codec_find("jpeg"), SP_VIDEO_CODEC_COUNT);
    assert_string_equal(sp_video_codec_name(SP_VIDEO_VP9), "vp9");
    assert_true(sp_video_is_available(SP_VIDEO_VP8));
    assert_true(sp_video_is_available(SP_VIDEO_VP9));
}

/* Each frame gives one packet and is decoded with small errors. Only the first is a key frame. */
static void check_moving_images(enum sp_video_codec codec, uint32_t width, uint32_t height) {
    struct sp_frame frame = make_frame(width, height);
    struct sp_video *video = create(codec);
    struct decoder decoder;
    size_t key_bytes = 0, bytes = 0;
    begin(&decoder, codec);
    for (int i = 0; i < 12; i++) {
        draw(&frame, i);
        struct sp_video_packet packet = encode(video, &frame, 90, false);
        assert_int_equal(packet.is_key, i == 0);
        *(i ? &bytes : &key_bytes) += packet.size;
        const vpx_image_t *image = decode(&decoder, &packet);
        assert_non_null(image);
        double db = psnr(&frame, image);
        if (db < (width > 100 ? 33 : 25)) /* chroma has a quarter of the pixels */
            fail_msg("%s %ux%u frame %d: %.1f dB", sp_video_codec_name(codec), width, height, i,
                     db);
    }
    print_message("%s %ux%u: key %zu bytes, delta %zu\n", sp_video_codec_name(codec), width, height,
                  key_bytes, bytes / 11);
    vpx_codec_destroy(&decoder.codec);
    sp_video_destroy(&video);
    free(frame.pixels);
}

static void moving_images_are_decoded_with_small_errors(void **state) {
    (void)state;
    static const uint32_t sizes[][2] = { { 320, 240 }, { 321, 241 }, { 17, 33 }, { 2, 2 } };
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        check_moving_images(SP_VIDEO_VP8, sizes[i][0], sizes[i][1]);
        check_moving_images(SP_VIDEO_VP9, sizes[i][0], sizes[i][1]);
    }
}

static void an_image_of_one_pixel_is_encoded(void **state) {
    (void)state;
    struct sp_frame frame = make_frame(1, 1);
    draw(&frame, 0);
    for (int codec = 0; codec < SP_VIDEO_CODEC_COUNT; codec++) {
        if (!sp_video_is_available((enum sp_video_codec)codec))
            continue;
        struct sp_video *video = create((enum sp_video_codec)codec);
        assert_true(encode(video, &frame, 50, false).is_key);
        assert_false(encode(video, &frame, 50, false).is_key);
        sp_video_destroy(&video);
    }
    free(frame.pixels);
}

/* A decoder that starts late decodes no frame before a key frame, and every frame from then on. */
static void decoding_can_begin_at_any_key_frame(void **state) {
    (void)state;
    struct sp_frame frame = make_frame(160, 120);
    for (int codec = SP_VIDEO_VP8; codec <= SP_VIDEO_VP9; codec++) {
        struct sp_video *video = create((enum sp_video_codec)codec);
        struct decoder late;
        begin(&late, (enum sp_video_codec)codec);
        draw(&frame, 0);
        encode(video, &frame, 80, false);
        draw(&frame, 1);
        struct sp_video_packet packet = encode(video, &frame, 80, false);
        assert_false(packet.is_key);
        assert_null(decode(&late, &packet));
        draw(&frame, 2);
        packet = encode(video, &frame, 80, true);
        assert_true(packet.is_key);
        const vpx_image_t *image = decode(&late, &packet);
        assert_non_null(image);
        assert_compare(psnr(&frame, image), >, 30);
        draw(&frame, 3);
        packet = encode(video, &frame, 80, false);
        image = decode(&late, &packet);
        assert_non_null(image);
        assert_compare(psnr(&frame, image), >, 30);
        vpx_codec_destroy(&late.codec);
        sp_video_destroy(&video);
    }
    free(frame.pixels);
}

/* A change of the size begins with a key frame, which the same decoder accepts. */
static void a_new_size_begins_with_a_key_frame(void **state) {
    (void)state;
    struct sp_frame frames[2] = { make_frame(200, 100), make_frame(101, 75) };
    for (int codec = SP_VIDEO_VP8; codec <= SP_VIDEO_VP9; codec++) {
        struct sp_video *video = create((enum sp_video_codec)codec);
        struct decoder decoder;
        begin(&decoder, (enum sp_video_codec)codec);
        for (int i = 0; i < 6; i++) {
            struct sp_frame *frame = &frames[i / 2 % 2];
            draw(frame, i);
            struct sp_video_packet packet = encode(video, frame, 90, false);
            assert_int_equal(packet.is_key, i % 2 == 0);
            const vpx_image_t *image = decode(&decoder, &packet);
            assert_non_null(image);
            assert_compare(psnr(frame, image), >, 30);
        }
        vpx_codec_destroy(&decoder.codec);
        sp_video_destroy(&video);
    }
    free(frames[0].pixels);
    free(frames[1].pixels);
}

/* A higher quality gives more bytes and a better image. It may change from frame to frame. */
static void higher_quality_gives_more_bytes_and_a_better_image(void **state) {
    (void)state;
    struct sp_frame frame = make_frame(320, 240);
    for (int codec = SP_VIDEO_VP8; codec <= SP_VIDEO_VP9; codec++) {
        struct sp_video *video = create((enum sp_video_codec)codec);
        struct decoder decoder;
        double last_db = 0;
        size_t last_bytes = 0;
        begin(&decoder, (enum sp_video_codec)codec);
        draw(&frame, 0);
        for (int q = 10; q <= 100; q += 30) {
            struct sp_video_packet packet = encode(video, &frame, q, true);
            double db = psnr(&frame, decode(&decoder, &packet));
            print_message("%s quality %d: %zu bytes, %.1f dB\n",
                          sp_video_codec_name((enum sp_video_codec)codec), q, packet.size, db);
            assert_compare(packet.size, >, last_bytes);
            assert_compare(db, >, last_db);
            last_bytes = packet.size;
            last_db = db;
        }
        vpx_codec_destroy(&decoder.codec);
        sp_video_destroy(&video);
    }
    free(frame.pixels);
}

/* Colours are preserved. Pixels that are not opaque are blended with black. */
static void colours_are_preserved_and_blended_with_black(void **state) {
    (void)state;
    static const uint8_t shown[][4] = {
        { 0, 0, 0, 255 },   { 255, 255, 255, 255 }, { 128, 128, 128, 255 }, { 255, 0, 0, 255 },
        { 0, 255, 0, 255 }, { 0, 0, 255, 255 },     { 200, 100, 50, 255 },
    };
    struct sp_frame frame = make_frame(64, 64), expected = make_frame(64, 64);
    struct sp_video *video = create(SP_VIDEO_VP9);
    struct decoder decoder;
    begin(&decoder, SP_VIDEO_VP9);
    for (size_t i = 0; i < sizeof shown / sizeof *shown; i++) {
        for (uint32_t y = 0; y < 64; y++)
            for (uint32_t x = 0; x < 64; x++) {
                memcpy(pixel(&frame, x, y), shown[i], 4);
                memcpy(pixel(&expected, x, y), shown[i], 4);
            }
        struct sp_video_packet packet = encode(video, &frame, 100, true);
        double db = psnr(&expected, decode(&decoder, &packet));
        if (db < 38)
            fail_msg("colour %zu: %.1f dB", i, db);
    }
    for (uint32_t y = 0; y < 64; y++)
        for (uint32_t x = 0; x < 64; x++) {
            memcpy(pixel(&frame, x, y), (const uint8_t[]){ 200, 100, 50, 128 }, 4);
            memcpy(pixel(&expected, x, y), (const uint8_t[]){ 100, 50, 25, 255 }, 4);
        }
    struct sp_video_packet packet = encode(video, &frame, 100, true);
    assert_compare(psnr(&expected, decode(&decoder, &packet)), >, 38);
    vpx_codec_destroy(&decoder.codec);
    sp_video_destroy(&video);
    free(frame.pixels);
    free(expected.pixels);
}

/* Writes the unit types of an Annex B stream as digits: 7 and 8 are parameter sets, 5 is a key
 * frame, 1 is a delta frame. */
static void unit_types(const struct sp_video_packet *packet, char *out, size_t size) {
    size_t n = 0;
    for (size_t i = 0; i + 3 < packet->size && n + 1 < size; i++)
        if (packet->bytes[i] == 0 && packet->bytes[i + 1] == 0 && packet->bytes[i + 2] == 1)
            out[n++] = (char)('0' + (packet->bytes[i + 3] & 31));
    out[n] = 0;
}

static void h264_streams_have_parameter_sets_with_each_key_frame(void **state) {
    (void)state;
    if (!sp_video_is_available(SP_VIDEO_H264)) {
        struct sp_error err = { .code = SP_OK };
        assert_null(sp_video_create(SP_VIDEO_H264, 1, &err));
        assert_int_equal(err.code, SP_ERR_UNSUPPORTED);
        print_message("skipped: built without H.264 (SPLATD_X264)\n");
        skip();
    }
    struct sp_frame frame = make_frame(321, 241);
    struct sp_video *video = create(SP_VIDEO_H264);
    size_t key_bytes = 0;
    for (int i = 0; i < 8; i++) {
        char types[64];
        draw(&frame, i);
        struct sp_video_packet packet = encode(video, &frame, 60, i == 4);
        bool is_key = i % 4 == 0;
        assert_int_equal(packet.is_key, is_key);
        unit_types(&packet, types, sizeof types);
        /* A key frame comes with its parameter sets. No packet has images of both kinds. */
        assert_true(!strchr(types, '7') == !is_key);
        assert_true(!strchr(types, '8') == !is_key);
        assert_true(!strchr(types, '5') == !is_key);
        assert_true(!strchr(types, '1') == is_key);
        if (i == 0)
            key_bytes = packet.size;
        else if (!is_key)
            assert_compare(packet.size, <, key_bytes);
    }
    sp_video_destroy(&video);
    free(frame.pixels);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(codecs_are_found_by_name),
        cmocka_unit_test(moving_images_are_decoded_with_small_errors),
        cmocka_unit_test(an_image_of_one_pixel_is_encoded),
        cmocka_unit_test(decoding_can_begin_at_any_key_frame),
        cmocka_unit_test(higher_quality_gives_more_bytes_and_a_better_image),
        cmocka_unit_test(colours_are_preserved_and_blended_with_black),
        cmocka_unit_test(a_new_size_begins_with_a_key_frame),
        cmocka_unit_test(h264_streams_have_parameter_sets_with_each_key_frame),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
