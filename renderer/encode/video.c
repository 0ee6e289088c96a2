/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/video.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "encode/convert.h"
#include "encode/module.h"
#include "encode/video_coder.h"

static const struct {
    const char *name, *module;          /* module: NULL = linked in */
    const struct sp_video_coder *coder; /* if linked in */
} codecs[SP_VIDEO_CODEC_COUNT] = {
    [SP_VIDEO_VP8] = { "vp8", NULL, &sp_video_vp8 },
    [SP_VIDEO_VP9] = { "vp9", NULL, &sp_video_vp9 },
    [SP_VIDEO_H264] = { "h264", "splat-x264.so", NULL },
};

struct sp_video {
    const struct sp_video_coder *coder;
    unsigned threads;
    void *state; /* NULL = the next packet begins a new stream */
    unsigned width, height;
    struct sp_encoder scratch; /* `pixels` holds the frame over black, `output` the planes */
};

const char *sp_video_codec_name(enum sp_video_codec codec) {
    assert(codec < SP_VIDEO_CODEC_COUNT);
    return codecs[codec].name;
}

uint64_t sp_video_bytes(enum sp_video_codec codec, const uint32_t size[2]) {
    static const unsigned per_pixel[SP_VIDEO_CODEC_COUNT] = {
        [SP_VIDEO_VP8] = 40, [SP_VIDEO_VP9] = 100, [SP_VIDEO_H264] = 60
    };
    const uint64_t least = 4 << 20;
    return least + (uint64_t)size[0] * size[1] * per_pixel[codec];
}

enum sp_video_codec sp_video_codec_find(const char *name) {
    for (int i = 0; i < SP_VIDEO_CODEC_COUNT; i++)
        if (strcasecmp(name, codecs[i].name) == 0)
            return (enum sp_video_codec)i;
    return SP_VIDEO_CODEC_COUNT;
}

static const struct sp_video_coder *find_coder(enum sp_video_codec codec, struct sp_error *err) {
    if (!codecs[codec].module)
        return codecs[codec].coder;
    const struct sp_video_coder *coder =
        sp_module_symbol(codecs[codec].module, "splat_video_coder", "video library", err);
    if (coder && coder->version != SP_CODER_VERSION) {
        sp_fail(err, SP_ERR_UNSUPPORTED, codecs[codec].module, "is of version %u, not %d",
                coder->version, SP_CODER_VERSION);
        return NULL;
    }
    if (!coder && err)
        err->code = SP_ERR_UNSUPPORTED;
    return coder;
}

bool sp_video_is_available(enum sp_video_codec codec) {
    assert(codec < SP_VIDEO_CODEC_COUNT);
    return find_coder(codec, NULL) != NULL;
}

struct sp_video *sp_video_create(enum sp_video_codec codec, unsigned threads,
                                 struct sp_error *err) {
    assert(codec < SP_VIDEO_CODEC_COUNT && threads >= 1 && threads <= 8);
    const struct sp_video_coder *coder = find_coder(codec, err);
    if (!coder)
        return NULL;
    struct sp_video *video = calloc(1, sizeof *video);
    if (!video) {
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for a video encoder");
        return NULL;
    }
    video->coder = coder;
    video->threads = threads;
    return video;
}

static void restart(struct sp_video *video) {
    if (video->state)
        video->coder->destroy(video->state);
    video->state = NULL;
}

void sp_video_destroy(struct sp_video **pointer) {
    struct sp_video *video = *pointer;
    *pointer = NULL;
    if (!video)
        return;
    restart(video);
    free(video->scratch.pixels.bytes);
    free(video->scratch.output.bytes);
    free(video);
}

/* Converts two rows to luma: BT.601, limited range, 8 fraction bits. */
static void luma_row(const uint8_t *restrict rgbx, unsigned width, uint8_t *restrict out) {
    for (unsigned x = 0; x < width; x++) {
        int r = rgbx[4 * x], g = rgbx[4 * x + 1], b = rgbx[4 * x + 2];
        out[x] = (uint8_t)((66 * r + 129 * g + 25 * b + 128 + (16 << 8)) >> 8);
    }
}

/* Converts two rows to one row of chroma: the mean of each 2 × 2 pixels. */
static void chroma_row(const uint8_t *restrict a, const uint8_t *restrict b, unsigned pairs,
                       uint8_t *restrict u, uint8_t *restrict v) {
    for (unsigned x = 0; x < pairs; x++) {
        int sum[3];
        for (int c = 0; c < 3; c++)
            sum[c] = a[8 * x + c] + a[8 * x + 4 + c] + b[8 * x + c] + b[8 * x + 4 + c];
        u[x] = (uint8_t)((-38 * sum[0] - 74 * sum[1] + 112 * sum[2] + 512 + (128 << 10)) >> 10);
        v[x] = (uint8_t)((112 * sum[0] - 94 * sum[1] - 18 * sum[2] + 512 + (128 << 10)) >> 10);
    }
}

/* Fills planes with even sides, so that all blocks of 2 × 2 pixels are complete. An odd side
 * repeats its last pixels. */
static void to_planes(const struct sp_raster *raster, struct sp_i420 *image) {
    unsigned width = raster->width, height = raster->height, pairs = width / 2;
    for (unsigned y = 0; y < (height + 1) / 2; y++) {
        const uint8_t *rows[2];
        for (unsigned i = 0; i < 2; i++) {
            unsigned from = 2 * y + i < height ? 2 * y + i : height - 1;
            uint8_t *luma = image->planes[0] + (2 * y + i) * image->strides[0];
            rows[i] = (const uint8_t *)raster->pixels + from * raster->stride;
            luma_row(rows[i], width, luma);
            if (width & 1)
                luma[width] = luma[width - 1];
        }
        uint8_t *u = image->planes[1] + y * image->strides[1];
        uint8_t *v = image->planes[2] + y * image->strides[2];
        chroma_row(rows[0], rows[1], pairs, u, v);
        if (width & 1) {
            uint8_t last[2][8];
            for (int i = 0; i < 2; i++)
                for (int c = 0; c < 8; c++)
                    last[i][c] = rows[i][4 * (width - 1) + c % 4];
            chroma_row(last[0], last[1], 1, u + pairs, v + pairs);
        }
    }
}

static bool make_image(struct sp_video *video, const struct sp_frame *frame, struct sp_i420 *image,
                       struct sp_error *err) {
    struct sp_raster raster;
    size_t stride = ((size_t)frame->width + 1) / 2 * 2, rows = ((size_t)frame->height + 1) / 2 * 2;
    size_t luma = stride * rows, chroma = luma / 4;
    if (!sp_frame_to_raster(&video->scratch, frame, SP_RASTER_RGBX8, &raster, err) ||
        !sp_buffer_reserve(&video->scratch.output, luma + 2 * chroma, err))
        return false;
    uint8_t *bytes = video->scratch.output.bytes;
    *image = (struct sp_i420){ .planes = { bytes, bytes + luma, bytes + luma + chroma },
                               .strides = { stride, stride / 2, stride / 2 },
                               .width = frame->width,
                               .height = frame->height };
    if (video->coder->wants_even) {
        image->width = (unsigned)stride;
        image->height = (unsigned)rows;
    }
    to_planes(&raster, image);
    return true;
}

bool sp_video_encode(struct sp_video *video, const struct sp_frame *frame, int quality, bool is_key,
                     struct sp_video_packet *packet, struct sp_error *err) {
    struct sp_i420 image;
    struct sp_coder_packet coded = { .size = 0 };
    assert(quality >= 1 && quality <= 100);
    if (!make_image(video, frame, &image, err))
        return false;
    if (video->width != image.width || video->height != image.height)
        restart(video);
    video->width = image.width;
    video->height = image.height;
    is_key = is_key || !video->state;
    if (!video->state)
        video->state = video->coder->create(image.width, image.height, video->threads);
    if (!video->state)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for video of %u × %u", image.width,
                       image.height);
    const char *failed = video->coder->encode(video->state, &image, quality, is_key, &coded);
    if (!failed && coded.size == 0)
        failed = "the packet is empty";
    if (failed) {
        restart(video);
        return sp_fail(err, SP_ERR_BACKEND, "", "cannot encode %u × %u as video: %s", image.width,
                       image.height, failed);
    }
    *packet = (struct sp_video_packet){ coded.bytes, coded.size, coded.is_key };
    return true;
}
