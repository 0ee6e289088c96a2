/* SPDX-License-Identifier: Apache-2.0
 *
 * The meaning of several numbers per voxel: an extra axis, or the components of a sample, may be
 * time steps, vectors, colours or channels. The source states the meaning ("?as=vectors"), or else
 * the file, or else the reader uses its default. All readers use these functions, so that a choice
 * and its errors are the same for every format.
 */
#ifndef SP_IMPORT_MEANING_H
#define SP_IMPORT_MEANING_H

#include "data/import/format.h"

struct import_extra {
    uint64_t count;         /* entries; 0 and 1 = there are none */
    enum import_as meaning; /* meaning in the file, or the default: TIME, VECTORS, RGB, CHANNELS */
    bool no_vectors;        /* the reader cannot turn the entries into vectors */
    bool are_parts; /* neither steps nor vectors: another axis is time, or they are bytes of a
                       colour */
};

/* Decides what the entries are, and sets header->used_as. Labels leave the entries what they are.
 * *as: TIME, VECTORS, RGB or CHANNELS; IMPORT_AS_FILE if there are none. Fails if the source wants
 * what cannot be, with a list of what can: SP_ERR_UNSUPPORTED. Vectors need three entries, colours
 * three or four. */
bool import_meaning_choose(const struct import_file *file, const struct import_extra *extra,
                           struct import_header *header, enum import_as *as, struct sp_error *err);

/* Makes one of the `count` components the samples, as import_header_choose_component() does, with
 * names of their own; `names` NULL = "red" …, or "component 1" …. Returns its number. */
unsigned import_meaning_choose_component(const struct import_file *file,
                                         struct import_header *header, unsigned count,
                                         enum import_as as, const char *const *names);

/* What an intent code of NIfTI says about the samples and the entries of the fifth axis. */
struct import_intent {
    enum sp_meaning meaning;
    enum import_as as;        /* IMPORT_AS_FILE = the code does not say */
    const char *name;         /* of the samples; "" = none */
    const char *warning;      /* what the samples are that the image does not show; NULL = none */
    const char *refusal;      /* what the file has in place of a volume; NULL = it has one */
    const char *const *names; /* of `name_count` entries; NULL = none */
    unsigned name_count;
};

enum { IMPORT_INTENT_FNIRT = 2006 }; /* a field of displacements by FSL's FNIRT */

struct import_intent import_intent_of(int code);

/* The names of the six entries of a symmetric matrix, row by row of its upper part, as FSL and NRRD
 * store it. (NIfTI goes row by row of its lower part.) */
extern const char *const import_tensor_names[6];

/* True if `count` triples of numbers are directions: nearly all are of length 1 or 0. `squares`
 * holds the squares of their lengths. */
bool import_meaning_are_directions(const float *squares, uint64_t count);

#endif
