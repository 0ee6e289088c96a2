/* SPDX-License-Identifier: Apache-2.0
 *
 * Edits of a view: sp_view.edits remove samples by planes, boxes and spheres, and keep or remove
 * connected parts. Renderers apply the edits themselves. These functions are for other code that
 * needs the edited samples.
 */
#ifndef SP_EDIT_H
#define SP_EDIT_H

#include "sp/api.h"
#include "sp/view.h"
#include "sp/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Returns a reference to the volume with the view's edits applied. If the view has no edits, the
 * result is a reference to the volume itself. The volume remembers the last result. NULL with *err
 * set: SP_ERR_MEMORY; `err` may be NULL. Each edit takes about 10 ms per 16 million samples; an
 * edit of type part takes about 20 times as long. The view must be valid. Thread-safe. */
SP_API struct sp_volume *sp_edit_volume(struct sp_volume *volume, const struct sp_view *view,
                                        struct sp_error *err);

/* Like sp_edit_volume(), but computes nothing: returns the remembered result, or a reference to the
 * volume itself if there is none. Thread-safe. */
SP_API struct sp_volume *sp_edit_volume_made(struct sp_volume *volume, const struct sp_view *view);

#ifdef __cplusplus
}
#endif

#endif
