/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/derived.h"

#include <stdio.h>
#include <string.h>

#include "data/volume/volume.h"

static const char *const endings[] = {
    [IMPORT_LENGTH] = "magnitude", [IMPORT_X] = "x", [IMPORT_Y] = "y", [IMPORT_Z] = "z"
};

/* Writes the name of a scalar of these vectors. */
static void name_derived(char out[SP_FIELD_BYTES], const char *vectors, enum import_derived what) {
    char name[2 * SP_FIELD_BYTES];
    snprintf(name, sizeof name, "%s%s%s", vectors, *vectors ? " " : "", endings[what]);
    import_name(out, name);
}

bool import_is_derived_from(const char *field, const char *vectors) {
    return *vectors && strcmp(field, endings[IMPORT_LENGTH]) != 0 &&
           import_derived_of(field, vectors) != IMPORT_NOT_DERIVED;
}

enum import_derived import_derived_of(const char *field, const char *vectors) {
    char name[SP_FIELD_BYTES];
    if (strcmp(field, endings[IMPORT_LENGTH]) == 0)
        return IMPORT_LENGTH;
    for (int what = IMPORT_LENGTH; what <= IMPORT_Z; what++) {
        name_derived(name, vectors, (enum import_derived)what);
        if (strcmp(field, name) == 0)
            return (enum import_derived)what;
    }
    return IMPORT_NOT_DERIVED;
}

void import_header_list_derived(struct import_header *header, const char *vectors,
                                const char *lengths) {
    char name[SP_FIELD_BYTES];
    if (strcmp(header->value_name, lengths) != 0)
        import_header_add_other(header, lengths);
    for (int what = IMPORT_X; what <= IMPORT_Z; what++) {
        name_derived(name, vectors, (enum import_derived)what);
        if (strcmp(header->value_name, name) != 0)
            import_header_add_other(header, name);
    }
}

void import_header_derive(struct import_header *header, const char *field) {
    const enum import_derived wanted = import_derived_of(field, header->vector_name);
    header->derived = wanted ? wanted : IMPORT_LENGTH;
    header->type = SP_FLOAT32;
    import_name(header->value_name, wanted ? field : endings[IMPORT_LENGTH]);
}

void import_header_use_vectors(struct import_header *header, const char *field) {
    import_header_derive(header, field);
    import_header_list_derived(header, header->vector_name, endings[IMPORT_LENGTH]);
}

void import_derive(enum import_derived what, const float (*vectors)[3], uint64_t count,
                   float *out) {
    if (what == IMPORT_LENGTH)
        sp_volume_lengths(vectors, count, out);
    for (uint64_t i = 0; what >= IMPORT_X && i < count; i++)
        out[i] = vectors[i][what - IMPORT_X];
}
