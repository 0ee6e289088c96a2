/* SPDX-License-Identifier: Apache-2.0
 *
 * Whether a GPU draws what it should, before anybody sees a picture of it: drivers are not of our
 * making, and a shader that one of them compiles wrongly fails without a word.
 *
 *   a small built-in volume, drawn in a few ways by both ──► every picture at least
 *   SP_CHECK_PSNR dB from the other's, or the backend does not start
 *
 * It is no measure of quality, which the conformance suite takes: that the picture is the right one
 * is all that it finds out.
 */
#ifndef SP_BACKEND_CHECK_H
#define SP_BACKEND_CHECK_H

#include "backend/backend.h"

#define SP_CHECK_PSNR 50.0 /* dB, of 8 bits */

/* Draws with the state of a backend and with a new one of `reference`, which needs no GPU. False
 * with SP_ERR_BACKEND when a picture is wrong, or with what kept one of the two from drawing. */
bool sp_backend_check(const struct sp_backend *backend, void *state,
                      const struct sp_backend *reference, const struct sp_backend_options *options,
                      struct sp_error *err);

#endif
