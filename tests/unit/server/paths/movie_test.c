/* SPDX-License-Identifier: Apache-2.0
 *
 * WebM files from packets: parsed by a reader of the test, and decoded.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include <vpx/vp8dx.h>
#include <vpx/vpx_decoder.h>

#include "paths/movie.h"
#include "sp/frame.h"
#include "sp/video.h"
#include "support/compare.h"

enum { FRAMES = 150, FPS = 25, KEY_EVERY = 60, WIDTH = 64, HEIGHT = 48 };

/* An EBML element: an id, a size, and the bytes. */

struct element {
    uint32_t id;
    const uint8_t *start, *data, *end;
};

static uint64_t number(const uint8_t *bytes, size_t size) {
    uint64_t value = 0;
    for (size_t i = 0; i < size; i++)
        value = value << 8 | bytes[i];
    return value;
}

static struct element element_at(const uint8_t *at, const uint8_t *limit) {
    struct element e = { .start = at };
    assert_compare(limit - at, >=, 2);
    size_t id = (size_t)__builtin_clz(at[0]) - 23;
    e.id = (uint32_t)number(at, id);
    at += id;
    assert_compare(limit - at, >, 0);
    assert_int_not_equal(at[0], 0);
    size_t width = (size_t)__builtin_clz(at[0]) - 23;
    uint64_t size = number(at, width) & ((UINT64_C(1) << 7 * width) - 1);
    e.data = at + width;
    assert_compare(limit - e.data, >=, 0);
    assert_compare(size, <=, (uint64_t)(limit - e.data));
    e.end = e.data + size;
    return e;
}

/* Finds the n-th child with this id. False: there is none. */
static bool find_child(const struct element *parent, uint32_t id, unsigned n,
                       struct element *child) {
    for (const uint8_t *at = parent->data; at < parent->end; at = child->end) {
        *child = element_at(at, parent->end);
        if (child->id == id && n-- == 0)
            return true;
    }
    return false;
}

static struct element child_of(const struct element *parent, uint32_t id) {
    struct element child;
    if (!find_child(parent, id, 0, &child))
        fail_msg("no element %x", id);
    return child;
}

static uint64_t value_of(const struct element *parent, uint32_t id) {
    struct element e = child_of(parent, id);
    return number(e.data, (size_t)(e.end - e.data));
}

/* The files of the packets. */

static struct srv_folder folder;

/* Returns the grey level of frame i; each frame has a different level. */
static uint8_t grey(uint32_t i) {
    return (uint8_t)(20 + i);
}

static void write_packets(void) {
    struct sp_error err;
    struct sp_frame_pool *pool = sp_frame_pool_create(1 << 20, &err);
    struct sp_frame *frame = sp_frame_create(pool, WIDTH, HEIGHT, SP_RGBA8, &err);
    struct sp_video *video = sp_video_create(SP_VIDEO_VP9, 1, &err);
    assert_non_null(pool);
    assert_non_null(frame);
    assert_non_null(video);
    for (uint32_t i = 0; i < FRAMES; i++) {
        struct sp_video_packet packet;
        char name[32];
        memset(frame->pixels, grey(i), frame->stride_bytes * HEIGHT);
        for (size_t p = 3; p < frame->stride_bytes * HEIGHT; p += 4)
            ((uint8_t *)frame->pixels)[p] = 255;
        assert_true(sp_video_encode(video, frame, 90, i % KEY_EVERY == 0, &packet, &err));
        uint8_t head = packet.is_key ? SRV_PACKET_KEY : SRV_PACKET_DELTA;
        snprintf(name, sizeof name, "%06u.vp9", i);
        assert_true(
            srv_folder_write(&folder, "a", name, &head, 1, packet.bytes, packet.size, &err));
    }
    sp_video_destroy(&video);
    sp_frame_unref(&frame);
    sp_frame_pool_destroy(&pool);
}

static int set_up(void **state) {
    (void)state;
    struct sp_error err;
    if (!srv_folder_open(&folder, NULL, &err))
        return -1;
    write_packets();
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    srv_folder_remove(&folder, "a", NULL);
    srv_folder_close(&folder);
    return access(folder.root, F_OK) == 0;
}

static const uint32_t size[2] = { WIDTH, HEIGHT };
static const struct srv_path_output output = { .frames = FRAMES, .fps = FPS, .is_movie = true };

/* Returns the upper bound for the movie of these packets. */
static uint64_t bytes_max_of(const char *id, uint32_t packets) {
    uint64_t bytes = 0, length;
    char name[32];
    for (uint32_t i = 0; i < packets; i++, bytes += length) {
        snprintf(name, sizeof name, "%06u.vp9", i);
        assert_true(srv_folder_size(&folder, id, name, &length));
    }
    return srv_movie_bytes_max(bytes, packets);
}

/* Writes the movie and returns its bytes, malloc'ed. */
static uint8_t *make_movie_of(const char *id, const struct srv_path_output *made, size_t *bytes) {
    struct sp_error err = { .code = SP_OK };
    char path[SRV_FILE_BYTES];
    uint64_t length, told;
    if (!srv_movie_write(&folder, id, "m.webm", made, size, &told, &err))
        fail_msg("%s: %s", err.place, err.text);
    assert_true(srv_folder_size(&folder, id, "m.webm", &length));
    assert_int_equal(told, length);
    length -= SRV_SEAL_BYTES;
    srv_folder_path(&folder, id, "m.webm", path);
    FILE *file = fopen(path, "rb");
    uint8_t *movie = malloc(length);
    assert_non_null(file);
    assert_non_null(movie);
    assert_int_equal(fread(movie, 1, length, file), length);
    fclose(file);
    *bytes = length;
    assert_in_range(length, 1, bytes_max_of(id, made->frames));
    return movie;
}

static uint8_t *make_movie(size_t *bytes) {
    return make_movie_of("a", &output, bytes);
}

static void the_headers_are_complete(void **state) {
    (void)state;
    size_t bytes;
    uint8_t *movie = make_movie(&bytes);
    struct element head = element_at(movie, movie + bytes);
    assert_int_equal(head.id, 0x1A45DFA3);
    struct element type = child_of(&head, 0x4282);
    assert_compare(type.end - type.data, >=, 4);
    assert_memory_equal(type.data, "webm", 4);
    struct element segment = element_at(head.end, movie + bytes);
    assert_int_equal(segment.id, 0x18538067);
    assert_ptr_equal(segment.end, movie + bytes); /* the segment ends with the file */

    struct element info = child_of(&segment, 0x1549A966), tracks = child_of(&segment, 0x1654AE6B);
    assert_int_equal(value_of(&info, 0x2AD7B1), 1000000); /* times are in ms */
    uint64_t bits = value_of(&info, 0x4489);
    double duration;
    memcpy(&duration, &bits, sizeof duration);
    assert_compare(fabs(duration - FRAMES * 1000.0 / FPS), <, 1e-6);
    struct element track = child_of(&tracks, 0xAE), video = child_of(&track, 0xE0);
    struct element codec = child_of(&track, 0x86);
    assert_memory_equal(codec.data, "V_VP9", 5);
    assert_int_equal(value_of(&video, 0xB0), WIDTH);
    assert_int_equal(value_of(&video, 0xBA), HEIGHT);

    struct element seek, places = child_of(&segment, 0x114D9B74);
    unsigned n = 0;
    for (; find_child(&places, 0x4DBB, n, &seek);
         n++) { /* each entry points to the element that it names */
        const uint8_t *to = segment.data + value_of(&seek, 0x53AC);
        assert_compare(segment.end - to, >, 0);
        assert_int_equal(element_at(to, segment.end).id, value_of(&seek, 0x53AB));
    }
    assert_int_equal(n, 3); /* Info, Tracks, Cues */
    free(movie);
}

static void cues_point_to_key_frames(void **state) {
    (void)state;
    size_t bytes;
    uint8_t *movie = make_movie(&bytes);
    struct element head = element_at(movie, movie + bytes);
    struct element segment = element_at(head.end, movie + bytes);
    struct element cues = child_of(&segment, 0x1C53BB6B), cue;
    unsigned n = 0;
    for (; find_child(&cues, 0xBB, n, &cue); n++) {
        struct element place = child_of(&cue, 0xB7);
        const uint8_t *to = segment.data + value_of(&place, 0xF1);
        assert_compare(segment.end - to, >, 0);
        struct element cluster = element_at(to, segment.end);
        assert_int_equal(cluster.id, 0x1F43B675);
        assert_int_equal(value_of(&cluster, 0xE7), value_of(&cue, 0xB3));
        assert_int_equal(value_of(&cue, 0xB3), n * KEY_EVERY * 1000 / FPS);
        struct element block = child_of(&cluster, 0xA3);
        assert_true(block.data[3] & 0x80);
    }
    assert_int_equal(n, (FRAMES + KEY_EVERY - 1) / KEY_EVERY);
    free(movie);
}

/* Decodes a packet. Returns the mean luma of its image. */
static double luma(vpx_codec_ctx_t *decoder, const uint8_t *bytes, size_t count) {
    vpx_codec_iter_t at = NULL;
    assert_int_equal(vpx_codec_decode(decoder, bytes, (unsigned)count, NULL, 0), 0);
    const vpx_image_t *image = vpx_codec_get_frame(decoder, &at);
    assert_non_null(image);
    assert_int_equal(image->d_w, WIDTH);
    double sum = 0;
    for (unsigned y = 0; y < HEIGHT; y++)
        for (unsigned x = 0; x < WIDTH; x++)
            sum += image->planes[0][y * (size_t)image->stride[0] + x];
    return sum / (WIDTH * HEIGHT);
}

static void every_frame_has_its_time(void **state) {
    (void)state;
    size_t bytes;
    uint8_t *movie = make_movie(&bytes);
    struct element head = element_at(movie, movie + bytes), cluster, block;
    struct element segment = element_at(head.end, movie + bytes);
    vpx_codec_ctx_t decoder;
    assert_int_equal(vpx_codec_dec_init(&decoder, vpx_codec_vp9_dx(), NULL, 0), 0);
    uint32_t i = 0;
    for (unsigned c = 0; find_child(&segment, 0x1F43B675, c, &cluster); c++)
        for (unsigned b = 0; find_child(&cluster, 0xA3, b, &block); b++, i++) {
            int16_t ms = (int16_t)number(block.data + 1, 2);
            assert_int_equal(block.data[0], 0x81); /* track 1 */
            assert_int_equal((int64_t)value_of(&cluster, 0xE7) + ms, i * 1000 / FPS);
            assert_int_equal((block.data[3] & 0x80) != 0, i % KEY_EVERY == 0);
            double y = luma(&decoder, block.data + 4, (size_t)(block.end - block.data - 4));
            assert_compare(fabs(y - (16 + grey(i) * 219 / 255.0)), <, 3);
        }
    assert_int_equal(i, FRAMES);
    vpx_codec_destroy(&decoder);
    free(movie);
}

static void an_invalid_packet_is_an_error(void **state) {
    (void)state;
    struct sp_error err;
    uint64_t bytes;
    const uint8_t head = 7;
    assert_true(srv_folder_write(&folder, "a", "000003.vp9", &head, 1, "x", 1, &err));
    assert_false(srv_movie_write(&folder, "a", "n.webm", &output, size, &bytes, &err));
    assert_int_equal(err.code, SP_ERR_FORMAT);
    assert_non_null(strstr(err.place, "000003.vp9"));
    srv_folder_remove_file(&folder, "a", "000003.vp9");
    assert_false(srv_movie_write(&folder, "a", "n.webm", &output, size, &bytes, &err));
    assert_false(srv_folder_size(&folder, "a", "n.webm", &bytes));
    assert_false(srv_folder_size(&folder, "a", "movie.part", &bytes)); /* no partial file is left */
}

static void clusters_have_a_size_limit(void **state) {
    (void)state;
    enum { COUNT = 4, BYTES = 3 << 20 }; /* only one packet fits into a cluster */
    const struct srv_path_output large = { .frames = COUNT, .fps = FPS, .is_movie = true };
    uint8_t *packet = calloc(1, BYTES);
    struct sp_error err;
    assert_non_null(packet);
    for (unsigned i = 0; i < COUNT; i++) {
        const uint8_t head = i == 0 ? SRV_PACKET_KEY : SRV_PACKET_DELTA;
        char name[32];
        snprintf(name, sizeof name, "%06u.vp9", i);
        assert_true(srv_folder_write(&folder, "b", name, &head, 1, packet, BYTES, &err));
    }
    free(packet);
    size_t bytes;
    uint8_t *movie = make_movie_of("b", &large, &bytes);
    struct element head = element_at(movie, movie + bytes), cluster;
    struct element segment = element_at(head.end, movie + bytes);
    for (unsigned i = 0; i < COUNT; i++)
        assert_true(find_child(&segment, 0x1F43B675, i, &cluster));
    assert_false(find_child(&segment, 0x1F43B675, COUNT, &cluster));
    free(movie);
    srv_folder_remove(&folder, "b", NULL);
}

static void the_size_bound_holds_for_tiny_packets(void **state) {
    (void)state;
    enum { COUNT = 200 }; /* each packet has a cluster and a large cue */
    const struct srv_path_output many = { .frames = COUNT, .fps = 1e-4, .is_movie = true };
    const uint8_t head = SRV_PACKET_KEY;
    struct sp_error err;
    for (unsigned i = 0; i < COUNT; i++) {
        char name[32];
        snprintf(name, sizeof name, "%06u.vp9", i);
        assert_true(srv_folder_write(&folder, "c", name, &head, 1, "x", 1, &err));
    }
    size_t bytes;
    free(make_movie_of("c", &many, &bytes)); /* checks the size */
    srv_folder_remove(&folder, "c", NULL);
}

static void a_folder_that_cannot_be_created_is_an_error(void **state) {
    (void)state;
    struct sp_error err;
    struct srv_folder nowhere = { .root = "/dev/full" };
    assert_false(srv_folder_write(&nowhere, "a", "b", NULL, 0, "x", 1, &err));
    assert_int_equal(err.code, SP_ERR_IO);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_headers_are_complete),
        cmocka_unit_test(cues_point_to_key_frames),
        cmocka_unit_test(every_frame_has_its_time),
        cmocka_unit_test(an_invalid_packet_is_an_error),
        cmocka_unit_test(clusters_have_a_size_limit),
        cmocka_unit_test(the_size_bound_holds_for_tiny_packets),
        cmocka_unit_test(a_folder_that_cannot_be_created_is_an_error),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
