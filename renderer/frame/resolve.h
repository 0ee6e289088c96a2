/* SPDX-License-Identifier: Apache-2.0
 *
 * Composited planes over the background → pixels (sp/frame.h):
 *
 *   colour += transmittance·A·background,  alpha = 1 − transmittance·(1 − A)
 */
#ifndef SP_FRAME_RESOLVE_H
#define SP_FRAME_RESOLVE_H

#include "base/isa.h"
#include "sp/frame.h"

/* A pixel is opaque when its transmittance is below this: nothing behind it is drawn. */
#define SP_TRANSMITTANCE_MIN (1.0f / 512)

/* One row of `count` pixels. planes: transmittance, then associated red, green, blue. `background`:
 * RGBA, not associated. `out` has 16 bytes a pixel. */
void sp_resolve_rgbaf32(const float *const planes[4], uint32_t count, const float background[4],
                        float *out);

/* The same to 8 bits, not associated, clamped and rounded; 4 bytes a pixel. */
void sp_resolve_rgba8(const float *const planes[4], uint32_t count, const float background[4],
                      unsigned char *out);

#endif
