/* SPDX-License-Identifier: Apache-2.0
 *
 * Lists of names, and files of a folder whose names differ in numbers only: the slices of a stack,
 * the steps of a series. A pattern is such a name with '*' in place of each number: "t*.nrrd".
 */
#ifndef SP_IMPORT_NUMBERED_H
#define SP_IMPORT_NUMBERED_H

#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

#include "sp/status.h"

struct import_names { /* all zero = empty */
    char **names;     /* owned */
    uint32_t count;
};

/* Adds a copy of one name. False if there is no memory. */
bool import_names_append(struct import_names *list, const char *name);

void import_names_finish(struct import_names *list);

/* Writes the pattern of a name. False if the name has no number, or more than NAME_MAX bytes. */
bool sp_numbered_pattern(const char *name, char pattern[NAME_MAX + 1]);

/* True if a pattern has a '*', and each '*' stands for one or more digits of the name. Letters may
 * be large or small. */
bool sp_numbered_matches(const char *pattern, const char *name);

/* Lists the names in a folder that match, at most `most` of them, in the order of their numbers of
 * any length. SP_ERR_IO, SP_ERR_MEMORY at
 * `place`. The caller finishes *files, also after a failure. */
bool sp_numbered_list(const char *folder, const char *pattern, uint32_t most,
                      struct import_names *files, const char *place, struct sp_error *err);

#endif
