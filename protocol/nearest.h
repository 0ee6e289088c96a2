/* SPDX-License-Identifier: Apache-2.0 */
#ifndef PROTO_NEAREST_H
#define PROTO_NEAREST_H

#include "protocol/view_fields.h"

/* The name of the group's field that was probably meant by a misspelt one: at most a third of its
 * letters inserted, dropped or replaced (Levenshtein distance), case ignored. NULL if none is. */
const char *proto_nearest_name(const char *misspelt, const struct proto_group *group);

#endif
