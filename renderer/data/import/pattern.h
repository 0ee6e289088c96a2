/* SPDX-License-Identifier: Apache-2.0
 *
 * "FORMAT MIN MAX STEP [SUBDIM]": the numbered data files of NRRD and MetaImage headers, with one
 * %d, %03d or similar in FORMAT.
 */
#ifndef SP_IMPORT_PATTERN_H
#define SP_IMPORT_PATTERN_H

#include <stdbool.h>
#include <stddef.h>

enum { IMPORT_PATTERN_MAX = 4096, IMPORT_PATTERN_NAME = IMPORT_PATTERN_MAX + 32 }; /* bytes */

struct import_pattern {
    char value[IMPORT_PATTERN_MAX + 1];
    size_t before, after; /* bytes before '%'; offset of the text after the conversion */
    int width;
    bool zeros;
    long long low, high, step, subdim; /* subdim 0 = not given */
};

/* Reads a pattern. False if the value has another form; it may then be a plain name. */
bool import_pattern_parse(const char *value, struct import_pattern *pattern);

/* True if the step leads from the first number to the last one. */
bool import_pattern_is_sound(const struct import_pattern *pattern);

/* Writes the name of the file with this number. */
void import_pattern_name(const struct import_pattern *pattern, long long number,
                         char name[IMPORT_PATTERN_NAME]);

/* Reads a whole number in [low, high]; false if the text is anything else. */
bool import_integer(const char *text, long long low, long long high, long long *out);

#endif
