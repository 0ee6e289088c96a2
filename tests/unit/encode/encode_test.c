/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <limits.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <turbojpeg.h>

#include "encode/convert.h"
#include "support/compare.h"
#include "support/one_thread.h"
#include "unit/encode/read_image.h"

/* Allocates a frame whose rows have padding, which is filled with a pattern. */
static struct sp_frame make_frame(uint32_t width, uint32_t height, enum sp_pixel_format format) {
    size_t pixel = format == SP_RGBA8 ? 4 : 16;
    struct sp_frame frame = { .width = width, .height = height, .format = format };
    frame.stride_bytes = (width * pixel + 64 + 63) / 64 * 64;
    frame.pixels = aligned_alloc(64, frame.stride_bytes * height);
    assert_non_null(frame.pixels);
    memset(frame.pixels, 0xa5, frame.stride_bytes * height);
    return frame;
}

static uint8_t *pixel8(const struct sp_frame *frame, uint32_t x, uint32_t y) {
    return (uint8_t *)frame->pixels + y * frame->stride_bytes + 4 * x;
}

static float *pixel32(const struct sp_frame *frame, uint32_t x, uint32_t y) {
    return (float *)(void *)((uint8_t *)frame->pixels + y * frame->stride_bytes + 16 * x);
}

/* Makes a smooth image with noise in the lowest bits. Alpha rises to the right unless opaque. */
static struct sp_frame image8(uint32_t width, uint32_t height, bool opaque) {
    struct sp_frame frame = make_frame(width, height, SP_RGBA8);
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            uint8_t *p = pixel8(&frame, x, y);
            p[0] = (uint8_t)(x * 255 / width);
            p[1] = (uint8_t)(y * 255 / height);
            p[2] = (uint8_t)(128 + (x * 7 + y * 13) % 5);
            p[3] = opaque ? 255 : (uint8_t)(x * 255 / (width - 1));
        }
    return frame;
}

static struct decoded_image encode_and_read(const struct sp_frame *frame,
                                            enum sp_image_format format, int quality) {
    struct sp_error err = { 0 };
    struct sp_encoder *encoder = sp_encoder_create(&err);
    const uint8_t *bytes;
    size_t size;
    struct decoded_image image;
    if (!sp_encode(encoder, frame, format, quality, &bytes, &size, &err))
        fail_msg("%s: %s", err.place, err.text);
    assert_true(read_image(sp_image_format_info(format)->extension, bytes, size, &image));
    assert_int_equal(image.width, frame->width);
    assert_int_equal(image.height, frame->height);
    sp_encoder_destroy(&encoder);
    assert_null(encoder);
    return image;
}

static float read_at(const struct decoded_image *image, uint32_t x, uint32_t y, int c) {
    return image
        ->pixels[((size_t)y * (size_t)image->width + x) * (size_t)image->channels + (size_t)c];
}

static void formats_are_found_by_name_type_and_extension(void **state) {
    (void)state;
    assert_int_equal(sp_image_format_find("jpeg"), SP_IMAGE_JPEG);
    assert_int_equal(sp_image_format_find("jpg"), SP_IMAGE_JPEG);
    assert_int_equal(sp_image_format_find(".JPEG"), SP_IMAGE_JPEG);
    assert_int_equal(sp_image_format_find("image/png"), SP_IMAGE_PNG);
    assert_int_equal(sp_image_format_find(".webp"), SP_IMAGE_WEBP);
    assert_int_equal(sp_image_format_find("image/x-exr"), SP_IMAGE_EXR);
    assert_int_equal(sp_image_format_find("tiff"), SP_IMAGE_FORMAT_COUNT);
    assert_int_equal(sp_image_format_find(""), SP_IMAGE_FORMAT_COUNT);
    for (int i = 0; i < SP_IMAGE_FORMAT_COUNT; i++)
        assert_int_equal(sp_image_format_find(sp_image_format_info((enum sp_image_format)i)->name),
                         i);
}

static void png_preserves_every_pixel(void **state) {
    (void)state;
    for (int opaque = 0; opaque < 2; opaque++) {
        struct sp_frame frame = image8(61, 37, opaque);
        struct decoded_image image = encode_and_read(&frame, SP_IMAGE_PNG, 80);
        assert_int_equal(image.channels, opaque ? 3 : 4);
        for (uint32_t y = 0; y < frame.height; y++)
            for (uint32_t x = 0; x < frame.width; x++)
                for (int c = 0; c < image.channels; c++)
                    assert_int_equal(lroundf(read_at(&image, x, y, c) * 255),
                                     pixel8(&frame, x, y)[c]);
        free(image.pixels);
        free(frame.pixels);
    }
}

static double mean_difference(const struct sp_frame *frame, const struct decoded_image *image,
                              bool over_black) {
    double sum = 0;
    for (uint32_t y = 0; y < frame->height; y++)
        for (uint32_t x = 0; x < frame->width; x++)
            for (int c = 0; c < 3; c++) {
                const uint8_t *p = pixel8(frame, x, y);
                double want = p[c] * (over_black ? p[3] / 255.0 : 1.0);
                sum += fabs(read_at(image, x, y, c) * 255 - want);
            }
    return sum / (3.0 * frame->width * frame->height);
}

static void jpeg_is_close_and_shows_alpha_over_black(void **state) {
    (void)state;
    for (int opaque = 0; opaque < 2; opaque++) {
        struct sp_frame frame = image8(203, 117, opaque);
        struct decoded_image good = encode_and_read(&frame, SP_IMAGE_JPEG, 95),
                             poor = encode_and_read(&frame, SP_IMAGE_JPEG, 30);
        assert_int_equal(good.channels, 3);
        double g = mean_difference(&frame, &good, true), p = mean_difference(&frame, &poor, true);
        if (!(g < 1.5 && p < 6 && g < p))
            fail_msg("mean difference: %.3f at quality 95, %.3f at 30", g, p);
        free(good.pixels);
        free(poor.pixels);
        free(frame.pixels);
    }
}

/* Returns the sampling factors of the first component in the first frame header of a JPEG; -1 if
 * there is none. */
static int jpeg_sampling(const uint8_t *bytes, size_t size) {
    for (size_t i = 2; i + 12 < size; i += 2 + (size_t)(bytes[i + 2] << 8 | bytes[i + 3]))
        if (bytes[i] == 0xff && (bytes[i + 1] == 0xc0 || bytes[i + 1] == 0xc2))
            return bytes[i + 11];
    return -1;
}

static void jpeg_subsamples_colour_below_90(void **state) {
    (void)state;
    struct sp_frame frame = image8(64, 64, true);
    struct sp_encoder *encoder = sp_encoder_create(NULL);
    const uint8_t *bytes;
    size_t size;
    assert_true(sp_encode(encoder, &frame, SP_IMAGE_JPEG, 89, &bytes, &size, NULL));
    assert_int_equal(jpeg_sampling(bytes, size), 0x22);
    assert_true(sp_encode(encoder, &frame, SP_IMAGE_JPEG, 90, &bytes, &size, NULL));
    assert_int_equal(jpeg_sampling(bytes, size), 0x11);
    sp_encoder_destroy(&encoder);
    free(frame.pixels);
}

/* The image has columns of two colours in its left half and rows of them in its right half. 4:2:2
 * mixes the columns, 4:2:0 mixes columns and rows. */
static void jpeg_has_the_requested_chroma_subsampling(void **state) {
    (void)state;
    static const struct {
        enum sp_chroma chroma;
        const char *name;
        int factors;
    } cases[] = { { SP_CHROMA_444, "4:4:4", 0x11 },
                  { SP_CHROMA_422, "4:2:2", 0x21 },
                  { SP_CHROMA_420, "4:2:0", 0x22 } };
    struct sp_frame frame = image8(64, 64, true);
    for (unsigned y = 0; y < 64; y++)
        for (unsigned x = 0; x < 64; x++) {
            bool red = (x < 32 ? x : y) % 2 == 0;
            uint8_t *p = (uint8_t *)frame.pixels + y * frame.stride_bytes + 4 * x;
            p[0] = red ? 200 : 60;
            p[1] = 100;
            p[2] = red ? 60 : 200;
            p[3] = 255;
        }
    double differences[3];
    for (int i = 0; i < 3; i++) {
        struct sp_encoder *encoder = sp_encoder_create(NULL);
        const uint8_t *bytes;
        size_t size;
        sp_encoder_set_chroma(encoder, cases[i].chroma);
        assert_true(sp_encode(encoder, &frame, SP_IMAGE_JPEG, 95, &bytes, &size, NULL));
        assert_int_equal(jpeg_sampling(bytes, size), cases[i].factors);
        struct decoded_image image;
        assert_true(read_image(".jpg", bytes, size, &image));
        differences[i] = mean_difference(&frame, &image, true);
        assert_string_equal(sp_chroma_name(cases[i].chroma), cases[i].name);
        assert_int_equal(sp_chroma_find(cases[i].name), cases[i].chroma);
        free(image.pixels);
        sp_encoder_destroy(&encoder);
    }
    /* 4:4:4 preserves the colours; 4:2:2 mixes colours of columns, 4:2:0 of columns and rows. */
    assert_compare(differences[0], <, 5);
    assert_compare(differences[1], >, 3 * differences[0]);
    assert_compare(differences[2], >, 1.5 * differences[1]);
    assert_int_equal(sp_chroma_find("4:1:1"), SP_CHROMA_COUNT);
    assert_int_equal(sp_chroma_at(SP_CHROMA_AUTO, 89), SP_CHROMA_420);
    assert_int_equal(sp_chroma_at(SP_CHROMA_AUTO, 90), SP_CHROMA_444);
    assert_int_equal(sp_chroma_at(SP_CHROMA_422, 90), SP_CHROMA_422);
    free(frame.pixels);
}

/* Encodes the image with one call of the library and decodes it. */
static struct decoded_image encode_whole(const struct sp_frame *frame, int sampling) {
    tjhandle library = tjInitCompress();
    unsigned char *bytes = NULL;
    unsigned long size = 0;
    struct decoded_image image;
    assert_int_equal(tjCompress2(library, frame->pixels, (int)frame->width,
                                 (int)frame->stride_bytes, (int)frame->height, TJPF_RGBX, &bytes,
                                 &size, sampling, 80, 0),
                     0);
    assert_true(read_image(".jpg", bytes, size, &image));
    tjFree(bytes);
    tjDestroy(library);
    return image;
}

/* Counts the restart markers of a JPEG. A byte 255 of coded data is followed by 0. */
static unsigned count_restarts(const uint8_t *bytes, size_t size) {
    unsigned count = 0;
    for (size_t i = 0; i + 1 < size; i++)
        if (bytes[i] == 0xff && bytes[i + 1] >= 0xd0 && bytes[i + 1] <= 0xd7)
            assert_int_equal(bytes[i + 1], 0xd0 + count++ % 8);
    return count;
}

static const struct {
    enum sp_chroma chroma;
    int sampling;
} samplings[] = { { SP_CHROMA_444, TJSAMP_444 },
                  { SP_CHROMA_422, TJSAMP_422 },
                  { SP_CHROMA_420, TJSAMP_420 } };

static void stripes_change_no_pixel(void **state) {
    (void)state;
    static const struct {
        uint32_t width, height;
        unsigned stripes;
    } cases[] = {
        { 724, 724, 1 }, { 725, 724, 2 }, { 1021, 1029, 4 },  { 8192, 65, 2 },
        { 63, 8192, 1 }, { 80, 8192, 2 }, { 2100, 1999, 16 }, { 2000, 5000, 32 },
    };
    struct sp_encoder *encoder = sp_encoder_create(NULL);
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
        struct sp_frame frame = image8(cases[c].width, cases[c].height, true);
        for (int s = 0; s < 3; s++) {
            const uint8_t *bytes;
            size_t size;
            struct decoded_image image, whole = encode_whole(&frame, samplings[s].sampling);
            sp_encoder_set_chroma(encoder, samplings[s].chroma);
            assert_true(sp_encode(encoder, &frame, SP_IMAGE_JPEG, 80, &bytes, &size, NULL));
            assert_int_equal(count_restarts(bytes, size), cases[c].stripes - 1);
            assert_true(read_image(".jpg", bytes, size, &image));
            assert_int_equal(image.width, whole.width);
            assert_int_equal(image.height, whole.height);
            assert_memory_equal(image.pixels, whole.pixels,
                                sizeof(float) * 3 * frame.width * frame.height);
            free(image.pixels);
            free(whole.pixels);
        }
        free(frame.pixels);
    }
    sp_encoder_destroy(&encoder);
}

struct stripe_sharer { /* encodes the stripes alternately with its own encoders, the last stripe
                          first */
    struct sp_encoder *with[3];
    unsigned calls;
};

static void share(void *user, struct sp_encoder *own, unsigned count, sp_stripe_fn *stripe,
                  void *of) {
    struct stripe_sharer *stripe_sharer = user;
    stripe_sharer->calls++;
    for (unsigned i = count; i-- > 0;)
        stripe(of, i, i % 4 < 3 ? stripe_sharer->with[i % 4] : own);
}

static void stripes_from_any_encoder_give_the_same_bytes(void **state) {
    (void)state;
    struct sp_frame frame = image8(1400, 1000, false), small = image8(64, 64, false);
    struct sp_encoder *alone = sp_encoder_create(NULL), *shared = sp_encoder_create(NULL);
    struct stripe_sharer stripe_sharer = { .calls = 0 };
    const uint8_t *a, *b;
    size_t a_size, b_size;
    for (int i = 0; i < 3; i++)
        assert_non_null(stripe_sharer.with[i] = sp_encoder_create(NULL));
    sp_encoder_set_share(shared, share, &stripe_sharer);
    assert_true(sp_encode(alone, &frame, SP_IMAGE_JPEG, 80, &a, &a_size, NULL));
    assert_true(sp_encode(shared, &frame, SP_IMAGE_JPEG, 80, &b, &b_size, NULL));
    assert_int_equal(stripe_sharer.calls, 1);
    assert_int_equal(a_size, b_size);
    assert_memory_equal(a, b, a_size);
    assert_true(sp_encode(shared, &small, SP_IMAGE_JPEG, 80, &b, &b_size, NULL));
    assert_int_equal(stripe_sharer.calls, 1);
    for (int i = 0; i < 3; i++)
        sp_encoder_destroy(&stripe_sharer.with[i]);
    sp_encoder_destroy(&alone);
    sp_encoder_destroy(&shared);
    free(frame.pixels);
    free(small.pixels);
}

static void a_failed_stripe_fails_the_image(void **state) {
    (void)state;
    struct sp_frame frame = image8(1000, 700, true);
    struct sp_encoder *encoder = sp_encoder_create(NULL), broken = { .jpeg = tjInitDecompress() };
    struct stripe_sharer stripe_sharer = { .with = { &broken, encoder, encoder } };
    struct sp_error err = { .code = SP_OK };
    const uint8_t *bytes;
    size_t size;
    sp_encoder_set_share(encoder, share, &stripe_sharer);
    assert_false(sp_encode(encoder, &frame, SP_IMAGE_JPEG, 80, &bytes, &size, &err));
    assert_int_equal(err.code, SP_ERR_BACKEND);
    assert_non_null(strstr(err.text, "cannot encode a JPEG image of 1000 × 700: "));
    stripe_sharer.with[0] = encoder;
    assert_true(sp_encode(encoder, &frame, SP_IMAGE_JPEG, 80, &bytes, &size, &err));
    tjDestroy(broken.jpeg);
    sp_encoder_destroy(&encoder);
    free(frame.pixels);
}

/* With these settings of the library, stripes cannot be joined, so the image must be encoded as a
 * whole. */
static void environment_variables_of_the_library_apply(void **state) {
    (void)state;
    static const char *const variables[] = { "TJ_OPTIMIZE", "TJ_RESTART", "TJ_PROGRESSIVE" };
    struct sp_frame frame = image8(1000, 700, true);
    for (size_t i = 0; i < sizeof variables / sizeof *variables; i++) {
        setenv(variables[i], "1", 1);
        struct decoded_image image = encode_and_read(&frame, SP_IMAGE_JPEG, 80),
                             whole = encode_whole(&frame, TJSAMP_420);
        unsetenv(variables[i]);
        assert_memory_equal(image.pixels, whole.pixels,
                            sizeof(float) * 3 * frame.width * frame.height);
        free(image.pixels);
        free(whole.pixels);
    }
    free(frame.pixels);
}

/* If the frame is declared opaque, its pixels are not checked. */
static void a_frame_declared_opaque_is_opaque(void **state) {
    (void)state;
    struct sp_frame frame = image8(61, 37, false);
    assert_false(sp_frame_is_opaque(&frame));
    frame.is_opaque = true;
    assert_true(sp_frame_is_opaque(&frame));
    free(frame.pixels);
    frame = image8(61, 37, true);
    assert_true(sp_frame_is_opaque(&frame)); /* all its pixels are opaque */
    pixel8(&frame, 60, 36)[3] = 254;
    assert_false(sp_frame_is_opaque(&frame));
    free(frame.pixels);
}

static void webp_is_close_and_preserves_alpha(void **state) {
    (void)state;
    for (int opaque = 0; opaque < 2; opaque++) {
        struct sp_frame frame = image8(61, 37, opaque);
        struct decoded_image image = encode_and_read(&frame, SP_IMAGE_WEBP, 95);
        assert_true(image.channels == 4 || opaque);
        double difference = mean_difference(&frame, &image, false);
        for (uint32_t y = 0; y < frame.height && !opaque; y++)
            for (uint32_t x = 0; x < frame.width; x++)
                assert_int_equal(lroundf(read_at(&image, x, y, 3) * 255), pixel8(&frame, x, y)[3]);
        /* WebP loses the colour of transparent pixels, so only opaque images are compared. */
        if (opaque && difference > 3)
            fail_msg("mean difference %.3f", difference);
        free(image.pixels);
        free(frame.pixels);
    }
}

static void higher_webp_quality_gives_larger_files(void **state) {
    (void)state;
    struct sp_frame frame = image8(256, 256, true);
    struct sp_encoder *encoder = sp_encoder_create(NULL);
    const uint8_t *bytes;
    size_t low, high;
    assert_true(sp_encode(encoder, &frame, SP_IMAGE_WEBP, 20, &bytes, &low, NULL));
    assert_true(sp_encode(encoder, &frame, SP_IMAGE_WEBP, 95, &bytes, &high, NULL));
    if (low >= high)
        fail_msg("%zu bytes at quality 20, %zu at 95", low, high);
    sp_encoder_destroy(&encoder);
    free(frame.pixels);
}

static void exr_preserves_floats_exactly(void **state) {
    (void)state;
    struct sp_frame frame = make_frame(33, 21, SP_RGBAF32);
    for (uint32_t y = 0; y < frame.height; y++)
        for (uint32_t x = 0; x < frame.width; x++)
            for (uint32_t c = 0; c < 4; c++)
                pixel32(&frame, x, y)[c] = (float)(x * 100 + y * 10 + c) / 7919.0f;
    struct decoded_image image = encode_and_read(&frame, SP_IMAGE_EXR, 80);
    assert_int_equal(image.channels, 4);
    assert_true(image.is_float);
    for (uint32_t y = 0; y < frame.height; y++)
        for (uint32_t x = 0; x < frame.width; x++)
            for (int c = 0; c < 4; c++)
                assert_compare(read_at(&image, x, y, c), ==, pixel32(&frame, x, y)[c]);
    free(image.pixels);
    free(frame.pixels);
}

static void exr_of_bytes_has_premultiplied_alpha(void **state) {
    (void)state;
    struct sp_frame frame = image8(33, 21, false);
    struct decoded_image image = encode_and_read(&frame, SP_IMAGE_EXR, 80);
    assert_int_equal(image.channels, 4);
    for (uint32_t y = 0; y < frame.height; y++)
        for (uint32_t x = 0; x < frame.width; x++) {
            const uint8_t *p = pixel8(&frame, x, y);
            for (int c = 0; c < 4; c++) {
                double want = p[c] / 255.0 * (c < 3 ? p[3] / 255.0 : 1);
                assert_compare(fabs(read_at(&image, x, y, c) - want), <, 1e-6);
            }
        }
    free(image.pixels);
    free(frame.pixels);
}

static void floats_become_bytes_with_straight_alpha(void **state) {
    (void)state;
    struct sp_frame frame = make_frame(8, 1, SP_RGBAF32);
    const float in[8][4] = {
        { 0, 0, 0, 0 },           { 0.25f, 0.125f, 0, 0.5f }, { 1, 0.5f, 0.25f, 1 },
        { 2, -1, 0.5f, 1 },       { NAN, 0.5f, 0.5f, 1 },     { 0.5f, 0.5f, 0.5f, NAN },
        { INFINITY, 0, 0, 0.5f }, { 1e-3f, 0, 0, 1e-3f },
    };
    const uint8_t out[8][4] = {
        { 0, 0, 0, 0 },       { 128, 64, 0, 128 }, { 255, 128, 64, 255 }, { 255, 0, 128, 255 },
        { 0, 128, 128, 255 }, { 0, 0, 0, 0 },      { 255, 0, 0, 128 },    { 255, 0, 0, 0 },
    };
    for (uint32_t x = 0; x < 8; x++)
        memcpy(pixel32(&frame, x, 0), in[x], sizeof in[x]);
    struct decoded_image image = encode_and_read(&frame, SP_IMAGE_PNG, 80);
    assert_int_equal(image.channels, 4);
    for (uint32_t x = 0; x < 8; x++)
        for (int c = 0; c < 4; c++)
            assert_int_equal(lroundf(read_at(&image, x, 0, c) * 255), out[x][c]);
    free(image.pixels);
    free(frame.pixels);
}

static void one_encoder_serves_all_sizes_and_formats(void **state) {
    (void)state;
    static const uint32_t sizes[][2] = { { 1, 1 }, { 300, 200 }, { 7, 500 }, { 2, 1 }, { 640, 1 } };
    struct sp_encoder *encoder = sp_encoder_create(NULL);
    for (size_t s = 0; s < 5; s++)
        for (int f = 0; f < SP_IMAGE_FORMAT_COUNT; f++)
            for (int opaque = 0; opaque < 2; opaque++) {
                struct sp_frame frame = make_frame(sizes[s][0], sizes[s][1], SP_RGBA8);
                memset(frame.pixels, opaque ? 255 : 77, frame.stride_bytes * frame.height);
                const uint8_t *bytes;
                size_t size;
                struct decoded_image image;
                struct sp_error err;
                if (!sp_encode(encoder, &frame, (enum sp_image_format)f, 75, &bytes, &size, &err))
                    fail_msg("%s", err.text);
                assert_true(read_image(sp_image_format_info((enum sp_image_format)f)->extension,
                                       bytes, size, &image));
                assert_int_equal(image.width, frame.width);
                assert_int_equal(image.height, frame.height);
                free(image.pixels);
                free(frame.pixels);
            }
    sp_encoder_destroy(&encoder);
}

static void equal_frames_give_equal_files(void **state) {
    (void)state;
    struct sp_frame frame = image8(61, 37, false);
    struct sp_encoder *first = sp_encoder_create(NULL), *second = sp_encoder_create(NULL);
    for (int f = 0; f < SP_IMAGE_FORMAT_COUNT; f++) {
        const uint8_t *a, *b;
        size_t a_size, b_size;
        time_t start = time(NULL);
        assert_true(sp_encode(first, &frame, (enum sp_image_format)f, 80, &a, &a_size, NULL));
        while (time(NULL) == start) /* so that a timestamp in the file would differ */
            nanosleep(&(struct timespec){ .tv_nsec = 10000000 }, NULL);
        assert_true(sp_encode(second, &frame, (enum sp_image_format)f, 80, &b, &b_size, NULL));
        assert_int_equal(a_size, b_size);
        assert_memory_equal(a, b, a_size);
    }
    sp_encoder_destroy(&first);
    sp_encoder_destroy(&second);
    free(frame.pixels);
}

enum { THREADS = 4, ROUNDS = 4 };

static void *encode_in_thread(void *user) {
    const struct sp_frame *frame = user;
    for (int round = 0; round < ROUNDS; round++) {
        struct sp_encoder *encoder = sp_encoder_create(NULL);
        const uint8_t *bytes;
        size_t size;
        for (int f = 0; encoder && f < SP_IMAGE_FORMAT_COUNT; f++)
            if (!sp_encode(encoder, frame, (enum sp_image_format)f, 80, &bytes, &size, NULL))
                return user;
        sp_encoder_destroy(&encoder);
    }
    return NULL;
}

static void threads_load_and_encode_at_once(void **state) {
    (void)state;
    struct sp_frame frame = image8(61, 37, false);
    pthread_t threads[THREADS];
    for (int i = 0; i < THREADS; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, encode_in_thread, &frame), 0);
    for (int i = 0; i < THREADS; i++) {
        void *failed;
        pthread_join(threads[i], &failed);
        assert_null(failed);
    }
    free(frame.pixels);
}

/* Runs in a copy of this program in a folder without the EXR bridge. Only EXR needs the bridge. */
static int report_missing_bridge(void) {
    static uint32_t pixels[16] = { 0 };
    const struct sp_frame frame = {
        .width = 1, .height = 1, .format = SP_RGBA8, .stride_bytes = 64, .pixels = pixels
    };
    struct sp_encoder *encoder = sp_encoder_create(NULL);
    const uint8_t *bytes;
    size_t size;
    struct sp_error err = { 0 };
    bool others = sp_encode(encoder, &frame, SP_IMAGE_JPEG, 80, &bytes, &size, &err) &&
                  sp_encode(encoder, &frame, SP_IMAGE_PNG, 80, &bytes, &size, &err) &&
                  sp_encode(encoder, &frame, SP_IMAGE_WEBP, 80, &bytes, &size, &err);
    bool exr = others && sp_encode(encoder, &frame, SP_IMAGE_EXR, 80, &bytes, &size, &err);
    sp_encoder_destroy(&encoder);
    printf("%s: %s\n", err.place, err.text);
    return others && !exr && err.code == SP_ERR_IO && strstr(err.place, "/splat-exr.so") ? 0 : 1;
}

static void a_missing_bridge_is_named_and_only_exr_needs_it(void **state) {
    (void)state;
    char folder[] = "/tmp/splat-encode-XXXXXX", command[256], copy[64];
    assert_non_null(mkdtemp(folder));
    snprintf(copy, sizeof copy, "%s/program", folder);
    snprintf(command, sizeof command, "cp /proc/%d/exe %s && %s --missing-bridge", (int)getpid(),
             copy, copy);
    int status = system(command);
    unlink(copy);
    rmdir(folder);
    assert_true(WIFEXITED(status));
    assert_int_equal(WEXITSTATUS(status), 0);
}

int main(int argc, char **argv) {
    if (argc == 2 && strcmp(argv[1], "--missing-bridge") == 0)
        return report_missing_bridge();
    const struct CMUnitTest tests[] = {
        one_thread_test(formats_are_found_by_name_type_and_extension),
        one_thread_test(png_preserves_every_pixel),
        one_thread_test(jpeg_is_close_and_shows_alpha_over_black),
        one_thread_test(jpeg_subsamples_colour_below_90),
        one_thread_test(jpeg_has_the_requested_chroma_subsampling),
        one_thread_test(stripes_change_no_pixel),
        one_thread_test(stripes_from_any_encoder_give_the_same_bytes),
        one_thread_test(a_failed_stripe_fails_the_image),
        one_thread_test(environment_variables_of_the_library_apply),
        one_thread_test(a_frame_declared_opaque_is_opaque),
        one_thread_test(webp_is_close_and_preserves_alpha),
        one_thread_test(higher_webp_quality_gives_larger_files),
        one_thread_test(exr_preserves_floats_exactly),
        one_thread_test(exr_of_bytes_has_premultiplied_alpha),
        one_thread_test(floats_become_bytes_with_straight_alpha),
        one_thread_test(one_encoder_serves_all_sizes_and_formats),
        one_thread_test(equal_frames_give_equal_files),
        cmocka_unit_test(threads_load_and_encode_at_once),
        cmocka_unit_test(a_missing_bridge_is_named_and_only_exr_needs_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
