/* SPDX-License-Identifier: Apache-2.0
 *
 * Scalars that come from vectors: their lengths and their components, as fields of a file.
 */
#ifndef SP_IMPORT_DERIVED_H
#define SP_IMPORT_DERIVED_H

#include "data/import/format.h"

/* What the field of this name is for vectors of the name `vectors`: "magnitude" or "VECTORS
 * magnitude", or "VECTORS x", "VECTORS y" or "VECTORS z"; without a name of the vectors "x" …
 * Returns IMPORT_NOT_DERIVED for any other name. */
enum import_derived import_derived_of(const char *field, const char *vectors);

/* True if the field is one of these vectors, and not of any others. */
bool import_is_derived_from(const char *field, const char *vectors);

/* Makes the lengths of header->vector_name the samples, or the component that `field` names. */
void import_header_derive(struct import_header *header, const char *field);

/* Like import_header_derive(), and lists the other scalars that come from these vectors, which are
 * the only vectors of the file. */
void import_header_use_vectors(struct import_header *header, const char *field);

/* Adds the scalars that come from these vectors to the list of other fields, except for the scalars
 * that are read. `lengths` is the name of the lengths: "magnitude" for the only vectors. */
void import_header_list_derived(struct import_header *header, const char *vectors,
                                const char *lengths);

/* Computes `count` scalars. `out` may be NULL for IMPORT_NOT_DERIVED. */
void import_derive(enum import_derived what, const float (*vectors)[3], uint64_t count, float *out);

#endif
