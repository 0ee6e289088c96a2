/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SRV_SESSION_VIEW_CHECK_H
#define SRV_SESSION_VIEW_CHECK_H

#include "protocol/view.h"

/* Applies a patch to the default view of a cube. This checks a patch that belongs to no volume, and
 * reads a complete view without its volume. Errors as proto_view_apply(). */
bool srv_view_check(const proto_json *patch, struct sp_view *view, struct sp_error *err);

#endif
