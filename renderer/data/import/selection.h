/* SPDX-License-Identifier: Apache-2.0
 *
 * The query of a source: "PATH?series=3&as=time&unit=mm". A reader that honours `series` or `as`
 * says so in its header; otherwise the load fails, because a choice without effect would give a
 * wrong image without a warning.
 *
 * The keys are level, series, as, unit, vectors and field (load.c), each once, with a value; the
 * last two come last. '&' joins them; in the description of a series it is part of the value
 * unless a key and '=' follow it. Without such keys the whole text is the name of a file.
 */
#ifndef SP_IMPORT_SELECTION_H
#define SP_IMPORT_SELECTION_H

#include "sp/status.h"

/* What the extra axis, or the components of each sample, mean. */
enum import_as {
    IMPORT_AS_FILE, /* the file says it, or the reader guesses */
    IMPORT_AS_TIME,
    IMPORT_AS_VECTORS,
    IMPORT_AS_RGB,
    IMPORT_AS_CHANNELS,
    IMPORT_AS_LABELS, /* the samples are categories */
    IMPORT_AS_SLICE,  /* this file alone, without the slices that belong to it */
    IMPORT_AS_COUNT
};

struct import_selection {
    const char *series; /* SeriesInstanceUID, number or description; "" = the reader chooses */
    const char *unit; /* unit of the spacing, which replaces the unit of the file; "" = the unit of
                         the file */
    enum import_as as;
};

/* Reads the name of a meaning; "" is IMPORT_AS_FILE. SP_ERR_INVALID at `title`. */
bool import_as_parse(const char *name, enum import_as *as, const char *title, struct sp_error *err);

/* A unit is one word. SP_ERR_INVALID at `title`. */
bool import_unit_check(const char *unit, const char *title, struct sp_error *err);

/* True if the value gives the meaning of an axis or of the components. */
bool import_as_is_axis(enum import_as as);

/* The name in a source; "" for IMPORT_AS_FILE. A constant string. */
const char *import_as_name(enum import_as as);

#endif
