/* SPDX-License-Identifier: Apache-2.0
 *
 * H.264 by libx264, without latency. A separate module, loaded if it is installed, because
 * linking libx264 puts a program under the GNU General Public License.
 */
#include <stdint.h>
#include <stdlib.h>

#include <x264.h>

#include "encode/video_coder.h"

struct x264 {
    x264_t *encoder;
    x264_param_t parameters;
    int64_t time;
};

static void *create(unsigned width, unsigned height, unsigned threads) {
    struct x264 *x = calloc(1, sizeof *x);
    if (!x || x264_param_default_preset(&x->parameters, "superfast", "zerolatency") != 0) {
        free(x);
        return NULL;
    }
    x264_param_t *p = &x->parameters;
    p->i_width = (int)width;
    p->i_height = (int)height;
    p->i_csp = X264_CSP_I420;
    p->i_threads = (int)threads;
    p->b_sliced_threads = threads > 1;
    p->i_fps_num = 30;
    p->i_fps_den = 1;
    p->b_vfr_input = 0;
    p->i_keyint_max = X264_KEYINT_MAX_INFINITE; /* key frames only on request */
    p->i_scenecut_threshold = 0;
    p->b_repeat_headers =
        1; /* each key frame repeats the headers, so that a decoder can start there */
    p->b_annexb = 1;
    p->b_aud = 0;
    p->i_log_level = X264_LOG_NONE;
    p->rc.i_rc_method = X264_RC_CRF;
    p->vui.b_fullrange = 0;
    p->vui.i_colmatrix = 6; /* BT.601 */
    p->vui.i_colorprim = 6;
    p->vui.i_transfer = 6;
    if (x264_param_apply_profile(p, "main") == 0)
        x->encoder = x264_encoder_open(p);
    if (!x->encoder) {
        free(x);
        return NULL;
    }
    return x;
}

static void destroy(void *state) {
    struct x264 *x = state;
    if (x)
        x264_encoder_close(x->encoder);
    free(x);
}

/* Converts a JPEG quality to x264's: 90 → 13, 60 → 23, 30 → 33. */
static float rate_factor(int quality) {
    return 43 - (float)quality / 3;
}

static const char *encode(void *state, const struct sp_i420 *image, int quality, bool key,
                          struct sp_coder_packet *packet) {
    struct x264 *x = state;
    float factor = rate_factor(quality);
    if (x->parameters.rc.f_rf_constant != factor) {
        x->parameters.rc.f_rf_constant = factor;
        if (x264_encoder_reconfig(x->encoder, &x->parameters) != 0)
            return "libx264 refuses the quality";
    }
    x264_picture_t in, out;
    x264_nal_t *units;
    int count;
    x264_picture_init(&in);
    in.img.i_csp = X264_CSP_I420;
    in.img.i_plane = 3;
    for (int p = 0; p < 3; p++) {
        in.img.plane[p] = image->planes[p];
        in.img.i_stride[p] = (int)image->strides[p];
    }
    in.i_pts = x->time++;
    in.i_type = key ? X264_TYPE_IDR : X264_TYPE_AUTO;
    int size = x264_encoder_encode(x->encoder, &units, &count, &in, &out);
    if (size <= 0)
        return size < 0 ? "libx264 cannot encode the image" : "libx264 gave no packet";
    /* The NAL units are contiguous in memory. */
    *packet = (struct sp_coder_packet){ .bytes = units[0].p_payload,
                                        .size = (size_t)size,
                                        .is_key = out.b_keyframe != 0 };
    return NULL;
}

extern const struct sp_video_coder splat_video_coder;
__attribute__((visibility("default"))) const struct sp_video_coder splat_video_coder = {
    .version = SP_CODER_VERSION,
    .wants_even = true,
    .create = create,
    .encode = encode,
    .destroy = destroy,
};
