/* SPDX-License-Identifier: Apache-2.0
 *
 * The view between JSON and `struct sp_view`. One table of fields (view_fields.c) drives both
 * directions; names, units and ranges are published in view.schema.json.
 *
 *   patch (RFC 7396)  ─► types, names ─► merged into a copy ─► sp_view_validate() ─► *view
 */
#ifndef PROTO_VIEW_H
#define PROTO_VIEW_H

#include <stdbool.h>

#include "protocol/json.h"
#include "sp/status.h"
#include "sp/view.h"

/* Merges a patch into *view: a member that is there replaces, one that is not stays, null goes back
 * to `defaults` (which may be `view` itself: then null changes nothing), arrays are taken whole.
 * *view must be valid, so that what is refused is the patch's doing; it is untouched on failure.
 * SP_ERR_INVALID with the JSON pointer of the culprit in err->place: the patch is no object, an
 * unknown field (with the name that was probably meant), a wrong type, an unknown name of an
 * enumeration (with the known ones), a list too long, or whatever sp_view_validate() refuses. Pure.
 *
 * Numbers of 32-bit fields (colours, opacities) are rounded to the nearest, but never up to ±1. */
bool proto_view_apply(const proto_json *patch, const struct sp_view *defaults, struct sp_view *view,
                      struct sp_error *err);

/* Every field. Decoding what was encoded gives the same bits. NULL when out of memory. */
proto_json *proto_view_encode(const struct sp_view *view);

/* The "volume" of a patch if it has one and it is a string, else NULL. A patch that changes the
 * volume starts from that volume's default view (all but size and background); the caller does
 * that. Lives as long as the patch. */
const char *proto_view_volume(const proto_json *patch);

#endif
