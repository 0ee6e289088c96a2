/* SPDX-License-Identifier: Apache-2.0
 *
 * VP8 and VP9 by libvpx, for real time: one pass, nothing looked ahead at, a fixed quantiser.
 */
#include <stdlib.h>
#include <vpx/vp8cx.h>
#include <vpx/vpx_encoder.h>

#include "encode/video_coder.h"

enum {
    Q_MAX = 63,
    SPEED = 8,               /* VP9's fastest real-time speed: higher ones lose too much quality */
    RATE_KBIT = 1000 * 1000, /* so large that it never limits a frame: the quantiser is fixed */
};

struct vpx {
    vpx_codec_ctx_t codec;
    vpx_codec_enc_cfg_t config;
    int64_t time;
};

static void configure(vpx_codec_enc_cfg_t *config, unsigned width, unsigned height,
                      unsigned threads) {
    config->g_w = width;
    config->g_h = height;
    config->g_threads = threads;
    config->g_lag_in_frames = 0;
    config->g_timebase = (struct vpx_rational){ 1, 30 };
    config->g_error_resilient = 0;
    config->rc_end_usage = VPX_CBR;
    config->rc_target_bitrate = RATE_KBIT;
    config->rc_dropframe_thresh = 0;
    config->rc_resize_allowed = 0;
    config->kf_mode = VPX_KF_DISABLED; /* key frames only on request */
}

static void *create(vpx_codec_iface_t *interface, bool is_vp9, unsigned width, unsigned height,
                    unsigned threads) {
    struct vpx *vpx = calloc(1, sizeof *vpx);
    if (!vpx || vpx_codec_enc_config_default(interface, &vpx->config, 0) != VPX_CODEC_OK) {
        free(vpx);
        return NULL;
    }
    /* VP8's threads spin while they wait for each other. When other work uses the same cores, a
     * frame takes ten times as long as with one thread. */
    configure(&vpx->config, width, height, is_vp9 ? threads : 1);
    if (vpx_codec_enc_init(&vpx->codec, interface, &vpx->config, 0) != VPX_CODEC_OK) {
        free(vpx);
        return NULL;
    }
    vpx_codec_control(&vpx->codec, VP8E_SET_STATIC_THRESHOLD, 1);
    if (is_vp9) {
        int columns = threads > 3 ? 2 : threads > 1;
        vpx_codec_control(&vpx->codec, VP8E_SET_CPUUSED, SPEED);
        vpx_codec_control(&vpx->codec, VP9E_SET_TILE_COLUMNS, columns);
        vpx_codec_control(&vpx->codec, VP9E_SET_ROW_MT, threads > 1);
        vpx_codec_control(&vpx->codec, VP9E_SET_AQ_MODE, 0);
        vpx_codec_control(&vpx->codec, VP9E_SET_COLOR_SPACE, VPX_CS_BT_601);
    } else {
        /* A negative value sets a fixed speed; a positive one would adapt it to the clock. */
        vpx_codec_control(&vpx->codec, VP8E_SET_CPUUSED, -SPEED);
    }
    return vpx;
}

static void *create_vp8(unsigned width, unsigned height, unsigned threads) {
    return create(vpx_codec_vp8_cx(), false, width, height, threads);
}

static void *create_vp9(unsigned width, unsigned height, unsigned threads) {
    return create(vpx_codec_vp9_cx(), true, width, height, threads);
}

static void destroy(void *state) {
    struct vpx *vpx = state;
    if (vpx)
        vpx_codec_destroy(&vpx->codec);
    free(vpx);
}

/* Converts a JPEG quality to a quantiser of similar quality: 90 → 8, 60 → 26, 30 → 44. */
static unsigned quantiser(int quality) {
    int q = 62 - quality * 6 / 10;
    return (unsigned)(q > Q_MAX ? Q_MAX : q);
}

static const char *encode(void *state, const struct sp_i420 *image, int quality, bool key,
                          struct sp_coder_packet *packet) {
    struct vpx *vpx = state;
    vpx_image_t wrapped;
    unsigned q = quantiser(quality);
    if (vpx->config.rc_min_quantizer != q || vpx->config.rc_max_quantizer != q) {
        vpx->config.rc_min_quantizer = vpx->config.rc_max_quantizer = q;
        if (vpx_codec_enc_config_set(&vpx->codec, &vpx->config) != VPX_CODEC_OK)
            return "libvpx refuses the quality";
    }
    /* Uses the planes without a copy; the caller still owns the memory. */
    if (!vpx_img_wrap(&wrapped, VPX_IMG_FMT_I420, image->width, image->height, 1, image->planes[0]))
        return "libvpx refuses the image";
    for (int p = 0; p < 3; p++) {
        wrapped.planes[p] = image->planes[p];
        wrapped.stride[p] = (int)image->strides[p];
    }
    if (vpx_codec_encode(&vpx->codec, &wrapped, vpx->time, 1, key ? VPX_EFLAG_FORCE_KF : 0,
                         VPX_DL_REALTIME) != VPX_CODEC_OK)
        return "libvpx cannot encode the image";
    vpx->time++;
    vpx_codec_iter_t at = NULL;
    const vpx_codec_cx_pkt_t *got;
    while ((got = vpx_codec_get_cx_data(&vpx->codec, &at)))
        if (got->kind == VPX_CODEC_CX_FRAME_PKT) {
            *packet = (struct sp_coder_packet){
                .bytes = got->data.frame.buf,
                .size = got->data.frame.sz,
                .is_key = (got->data.frame.flags & VPX_FRAME_IS_KEY) != 0,
            };
            return NULL;
        }
    return "libvpx gave no packet";
}

const struct sp_video_coder sp_video_vp8 = {
    .version = SP_CODER_VERSION,
    .create = create_vp8,
    .encode = encode,
    .destroy = destroy,
};
const struct sp_video_coder sp_video_vp9 = {
    .version = SP_CODER_VERSION,
    .create = create_vp9,
    .encode = encode,
    .destroy = destroy,
};
