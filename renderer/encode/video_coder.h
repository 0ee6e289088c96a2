/* SPDX-License-Identifier: Apache-2.0
 *
 * The functions that video.c needs from a video library. vpx.c defines two such tables; a module
 * exports one as `splat_video_coder`. The table uses plain C types only, so that a module does not
 * depend on this library.
 */
#ifndef ENCODE_VIDEO_CODER_H
#define ENCODE_VIDEO_CODER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct sp_i420 { /* Y, U, V; chroma has half as many columns and rows, rounded up */
    uint8_t *planes[3];
    size_t strides[3];
    unsigned width, height; /* px; even if the coder asks for it */
};

struct sp_coder_packet {
    const uint8_t *bytes; /* owned by the coder; valid until its next call */
    size_t size;
    bool is_key;
};

enum { SP_CODER_VERSION = 1 };
struct sp_video_coder {
    unsigned version; /* SP_CODER_VERSION */
    bool wants_even;  /* needs an even width and height */
    /* Creates a coder for images of one size. Returns NULL if out of memory or if the library
     * refuses. */
    void *(*create)(unsigned width, unsigned height, unsigned threads);
    /* Encodes one image into one packet; `key` asks for a key frame. Returns NULL on success,
     * otherwise the reason as a constant string. quality: [1, 100]. */
    const char *(*encode)(void *state, const struct sp_i420 *image, int quality, bool key,
                          struct sp_coder_packet *packet);
    void (*destroy)(void *state);
};

extern const struct sp_video_coder sp_video_vp8, sp_video_vp9; /* vpx.c */

#endif
