/* SPDX-License-Identifier: Apache-2.0
 *
 * Blends composited planes over the background and writes pixels (sp/frame.h):
 *
 *   colour += transmittance·A·background,  alpha = 1 − transmittance·(1 − A)
 */
#ifndef SP_FRAME_RESOLVE_H
#define SP_FRAME_RESOLVE_H

#include "base/isa.h"
#include "sp/frame.h"

/* A pixel counts as opaque when its transmittance is below this value. Nothing behind an opaque
 * pixel is drawn. */
#define SP_TRANSMITTANCE_MIN (1.0f / 512)

/* Resolves one row of `count` pixels. planes: transmittance, then premultiplied red, green, blue.
 * `background`: RGBA, straight alpha. `out`: 16 bytes per pixel. */
void sp_resolve_rgbaf32(const float *const planes[4], uint32_t count, const float background[4],
                        float *out);

/* Like sp_resolve_rgbaf32(), but writes 8 bits with straight alpha, clamped and rounded. `out`: 4
 * bytes per pixel. */
void sp_resolve_rgba8(const float *const planes[4], uint32_t count, const float background[4],
                      unsigned char *out);

#endif
