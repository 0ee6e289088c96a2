/* SPDX-License-Identifier: Apache-2.0
 *
 * Converts the view between JSON and `struct sp_view`. One table of fields (view_fields.c) drives
 * both directions; view.schema.json publishes names, units and ranges.
 *
 *   patch (RFC 7396)  ─► types, names ─► merged into a copy ─► sp_view_validate() ─► *view
 */
#ifndef PROTO_VIEW_H
#define PROTO_VIEW_H

#include <stdbool.h>

#include "protocol/json.h"
#include "sp/status.h"
#include "sp/view.h"

/* Merges a patch into *view. A member of the patch replaces the field; a missing member keeps it;
 * null resets it to `defaults`; an array replaces the whole array. `defaults` may be `view` itself:
 * then null changes nothing. *view must be valid before the call, or made by proto_view_merge(), so
 * that an error is always about the patches; on failure it is unchanged.
 *
 * Errors: SP_ERR_INVALID with the JSON pointer of the wrong field in err->place. The patch is not
 * an object, has an unknown field (the text suggests a name), a wrong type, an unknown name of an
 * enumeration (the text lists the names) or a list that is too long, or sp_view_validate() refuses
 * the result. Thread-safe.
 *
 * Numbers of 32-bit fields (colours, opacities) are rounded to the nearest float, but never to ±1,
 * because opacities are below 1. */
bool proto_view_apply(const proto_json *patch, const struct sp_view *defaults, struct sp_view *view,
                      struct sp_error *err);

/* Like proto_view_apply(), without sp_view_validate(): the caller merges another patch, or
 * validates the view. On failure *view is undefined. */
bool proto_view_merge(const proto_json *patch, const struct sp_view *defaults, struct sp_view *view,
                      struct sp_error *err);

/* Encodes every field. Decoding the result gives the same bits. NULL when out of memory. */
proto_json *proto_view_encode(const struct sp_view *view);

/* Returns the "volume" of a patch if it is a string, else NULL. Borrowed from the patch. A patch
 * that changes the volume starts from the default view of the new volume and keeps size and
 * background; the caller does that. */
const char *proto_view_volume(const proto_json *patch);

#endif
