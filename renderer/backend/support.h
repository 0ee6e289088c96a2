/* SPDX-License-Identifier: Apache-2.0
 *
 * Checks whether a backend can draw a view. The view must be valid. Errors are SP_ERR_UNSUPPORTED
 * with the JSON pointer of the field; the text says what to do.
 */
#ifndef SP_BACKEND_SUPPORT_H
#define SP_BACKEND_SUPPORT_H

#include "backend/backend.h"

/* Checks the view against the masks of the capabilities: the features that every backend must draw
 * by itself. */
bool sp_support_check(const struct sp_backend *backend, const struct sp_view *view,
                      struct sp_error *err);

/* Checks the kinds of frames that another backend may draw instead: interpolated sheets, ambient
 * occlusion and shadows, surfaces and shells. `is_alone`: no other backend may draw them. */
bool sp_support_check_kind(const struct sp_backend *backend, bool is_alone,
                           const struct sp_view *view, struct sp_error *err);

/* Checks that the backend draws all visible layers by itself. */
bool sp_support_check_layers(const struct sp_backend *backend, const struct sp_view *view,
                             struct sp_error *err);

#endif
