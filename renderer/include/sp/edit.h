/* SPDX-License-Identifier: Apache-2.0
 *
 * Edits of what a view shows: sp_view.edits cut samples away by planes, boxes and spheres, and keep
 * or remove connected parts. Renderers do this by themselves; these functions are for other work on
 * what a view shows.
 */
#ifndef SP_EDIT_H
#define SP_EDIT_H

#include "sp/api.h"
#include "sp/view.h"
#include "sp/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Returns a reference to the volume with the view's edits; without edits, to the volume itself. The
 * volume remembers the last result. NULL with *err set: SP_ERR_MEMORY; `err` may be NULL. Takes a
 * time in proportion to the samples, about 10 ms per 16 million of them and edit, and for a part
 * about 20 times that. The view must be valid. Thread-safe. */
SP_API struct sp_volume *sp_edit_volume(struct sp_volume *volume, const struct sp_view *view,
                                        struct sp_error *err);

/* The same if the result is remembered; else, at once, a reference to the volume itself.
 * Thread-safe. */
SP_API struct sp_volume *sp_edit_volume_made(struct sp_volume *volume, const struct sp_view *view);

#ifdef __cplusplus
}
#endif

#endif
