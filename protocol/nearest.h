/* SPDX-License-Identifier: Apache-2.0 */
#ifndef PROTO_NEAREST_H
#define PROTO_NEAREST_H

#include "protocol/view_fields.h"

/* Returns the field name of the group that is closest to a misspelt name: at most a third of its
 * letters are inserted, deleted or replaced (Levenshtein distance, ignoring case). NULL if no field
 * is that close. Borrowed from the table of fields. Thread-safe. */
const char *proto_nearest_name(const char *misspelt, const struct proto_group *group);

#endif
