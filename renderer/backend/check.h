/* SPDX-License-Identifier: Apache-2.0
 *
 * Checks that a GPU draws correct images before a user sees one. A driver may compile a shader
 * wrongly without an error.
 *
 *   a small built-in volume, drawn in a few ways by both backends ──► each pair of images reaches
 *   a PSNR of at least SP_CHECK_PSNR, or the device is refused
 *
 * This does not measure quality; the conformance suite does.
 */
#ifndef SP_BACKEND_CHECK_H
#define SP_BACKEND_CHECK_H

#include "backend/backend.h"

#define SP_CHECK_PSNR 50.0 /* dB, of 8 bits */

/* Draws with the backend's state and with a new state of `reference`, which must not need a GPU.
 * False with SP_ERR_BACKEND if an image is wrong, or with the error of the backend that could not
 * draw. */
bool sp_backend_check(const struct sp_backend *backend, void *state,
                      const struct sp_backend *reference, const struct sp_backend_options *options,
                      struct sp_error *err);

#endif
