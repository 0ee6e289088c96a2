/* SPDX-License-Identifier: Apache-2.0
 *
 * What the numbers in the names of files mean: "img_t003_z012_c1.tif". Only numbers that vary
 * count. The word before a number tells its meaning; a number without a known word beside others
 * is the main one:
 *
 *   img_t*_z*    time, slice             A*_w*        well (other), channel
 *   img_c*_*     channel, slice          sub-*_t*     subject (other), time
 */
#ifndef SP_IMPORT_NUMBERS_H
#define SP_IMPORT_NUMBERS_H

#include <limits.h>

#include "data/import/numbered.h"
#include "data/import/warnings.h"

enum import_number_kind {
    IMPORT_NUMBER_FIXED,   /* the same in all names, or it follows from another number */
    IMPORT_NUMBER_UNKNOWN, /* only while it is being found out */
    IMPORT_NUMBER_SLICE,
    IMPORT_NUMBER_TIME,
    IMPORT_NUMBER_CHANNEL,
    IMPORT_NUMBER_OTHER /* of a subject, well, tile …: such files are volumes of their own */
};

struct import_numbers {
    enum import_number_kind meanings[NAME_MAX / 2 + 1];
    unsigned count;
    bool are_mixed;   /* several are the main one: nothing tells them apart */
    bool is_doubtful; /* the only one that varies is the main one, but its word says another */
};

/* Finds what the numbers of these names mean, which match one pattern. `main`: what the only number
 * that varies is. A second number of the same meaning is IMPORT_NUMBER_OTHER. False if there is no
 * memory. */
bool import_numbers_guess(const struct import_names *files, enum import_number_kind main,
                          struct import_numbers *numbers);

/* How many different numbers of this meaning the names have: 1 if none varies. If `values` is not
 * NULL, it gets them in rising order; it has files->count entries. */
uint32_t import_numbers_count(const struct import_names *files,
                              const struct import_numbers *numbers, enum import_number_kind meaning,
                              uint64_t *values);

/* The name's number of this meaning, the first one; 0 if there is none. */
uint64_t import_numbers_value(const struct import_numbers *numbers, enum import_number_kind meaning,
                              const char *name);

/* Leaves out the names that differ from `own` in a number of this meaning. Returns how many, and
 * writes one of them to `example`, unless it is NULL. */
uint32_t import_numbers_hold(struct import_names *files, const struct import_numbers *numbers,
                             enum import_number_kind meaning, const char *own,
                             char example[NAME_MAX + 1]);

/* Warns of names that were left out, of numbers that nothing tells apart, and of numbers that are
 * missing between others. `what`: "slices" or "time steps". */
void import_numbers_warn(const struct import_names *files, const struct import_numbers *numbers,
                         enum import_number_kind main, const char *what,
                         struct import_warnings *warnings);
void import_numbers_warn_left_out(uint32_t left_out, const char *example, const char *own,
                                  struct import_warnings *warnings);

#endif
