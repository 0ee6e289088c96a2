/* SPDX-License-Identifier: Apache-2.0
 *
 * Warnings: sentences for the user about data that a reader left out or changed. The volume is
 * still worth showing, but differs from the file. A problem that prevents a volume is an error
 * instead. The sentences pass to the parent with the end of the load and appear in the description
 * of the volume.
 */
#ifndef SP_IMPORT_WARNINGS_H
#define SP_IMPORT_WARNINGS_H

#include <stddef.h>

#include "sp/volume.h"

struct import_warnings {
    char texts[SP_WARNINGS_MAX][SP_WARNING_BYTES]; /* as in struct sp_volume_info */
    unsigned count; /* different sentences, also those that did not fit */
    /* Elements whose value is NaN because the file hides them: they are no surprise. */
    uint64_t hidden;
};

/* Adds one sentence: it begins with a capital letter, ends with a full stop, gives numbers and
 * places, and says what was done. Files are named without their folder, which no client may learn.
 * Text that is too long is cut, and a repeated sentence is dropped. If there are too many
 * sentences, the last one counts the dropped ones. NULL `warnings`: does nothing. */
__attribute__((format(printf, 2, 3))) void import_warn(struct import_warnings *warnings,
                                                       const char *format, ...);

/* Replaces "/proc/self/fd/N", the name by which libraries open a file, by "the file". */
void import_hide_descriptors(char *text);

/* A list of names in a text of limited size: "a, b, c and 12 more". */
struct import_list {
    char *text;
    size_t capacity, used;
    unsigned left_out;
};

/* Begins with the text that is there. `capacity` is at least 40 bytes more. */
void import_list_begin(struct import_list *list, char *text, size_t capacity);

/* Adds a name after `before`, such as ", ". */
void import_list_add(struct import_list *list, const char *before, const char *name);

/* Ends the list with the number of names that did not fit; has_more = there are more names, which
 * were not added. */
void import_list_end(struct import_list *list, bool has_more);

#endif
