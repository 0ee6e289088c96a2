/* SPDX-License-Identifier: Apache-2.0
 *
 * Measurements in JSON: the request of a client, the answer of the daemon, and the list of a
 * session.
 *
 *   {"kind", "points", "range"}                 {"id", "kind", "points", "range", "text", "color",
 *        │                                       "hidden"}
 *        ▼                                            │
 *   struct sp_measure                                 ▼
 *        │ sp_measure_compute()                  struct proto_measure ─► list, CSV, store
 *        ▼
 *   {"value", "unit", …}
 */
#ifndef PROTO_MEASURE_H
#define PROTO_MEASURE_H

#include <stdbool.h>

#include "protocol/json.h"
#include "sp/measure.h"

enum {
    PROTO_MEASURE_ID_MAX = 32,     /* bytes of an id: A-Z a-z 0-9 _ - */
    PROTO_MEASURE_TEXT_MAX = 200,  /* bytes of a text, UTF-8 */
    PROTO_MEASURE_AUTHOR_MAX = 64, /* bytes of the name of a participant */
    PROTO_MEASURE_COLOR_BYTES = 8, /* "#rrggbb" and a NUL */
    PROTO_MEASURE_NOTE_MAX = 255   /* bytes of a note */
};

/* A result with the units of its volume, "" = unknown. */
struct proto_measure_value {
    struct sp_measure_result result;
    char world_unit[SP_UNIT_BYTES]; /* of coordinates */
    char data_unit[SP_UNIT_BYTES];  /* unit of the samples, for statistics, profiles and ranges */
    /* level of the measured samples of a volume that is larger than memory; not saved */
    unsigned level;
    /* samples that a part or a path took, for accounting of time; not saved */
    double volume_samples;
};

/* A measurement of a session. */
struct proto_measure {
    char id[PROTO_MEASURE_ID_MAX + 1];
    char volume[SP_NAME_BYTES];
    struct sp_measure geometry;
    char text[PROTO_MEASURE_TEXT_MAX + 1];
    char color[PROTO_MEASURE_COLOR_BYTES];
    char author[PROTO_MEASURE_AUTHOR_MAX + 1];
    bool is_hidden;
    struct proto_measure_value value; /* without its histogram */
};

/* The points and values that a client draws for a measurement; NULL = none. */
struct proto_measure_line {
    const double *profile; /* the values of a profile */
    uint32_t profile_count;
    const struct sp_part_path *path; /* of a path */
};

/* Reads the members "kind", "points" and "range" and checks them. SP_ERR_INVALID at "/kind",
 * "/points", "/points/N", "/points/N/AXIS" or "/range". Thread-safe. */
bool proto_measure_decode(const proto_json *object, struct sp_measure *measure,
                          struct sp_error *err);

/* Merges the members of an object into a measurement: "points", "range", "text", "color", "hidden",
 * and "kind", which a measurement that exists (is_new = false) cannot change. Ignores "id". A new
 * measurement needs "kind" and "points"; a new part or path also needs "range". On failure *measure
 * is unchanged: SP_ERR_INVALID with the pointer. Thread-safe. */
bool proto_measure_apply(const proto_json *patch, bool is_new, struct proto_measure *measure,
                         struct sp_error *err);
/* True for 1 to PROTO_MEASURE_ID_MAX characters of A-Z a-z 0-9 _ -. NULL: false. */
bool proto_measure_is_id(const char *id);

/* Encodes a measurement of a session: {"id", "kind", "volume", "points", "range", "text", "color",
 * "author", "hidden", "value", "unit", "data_unit", "outside", "note", "statistics", "area",
 * "samples", "straight"}; a kind has only some of them. Thread-safe. */
proto_json *proto_measure_encode(const struct proto_measure *measure);
/* Reads the result of proto_measure_encode(). False: the JSON is something else. Thread-safe. */
bool proto_measure_restore(const proto_json *json, struct proto_measure *measure);

/* Encodes the answer to a request for a measurement: as proto_measure_encode(), without "id",
 * "text", "color", "author" and "hidden", and with "histogram", "profile" and "path". NULL when out
 * of memory. Thread-safe. */
proto_json *proto_measure_answer(const char *volume, const struct sp_measure *measure,
                                 const struct proto_measure_value *value,
                                 const struct proto_measure_line *line);

/* Returns the measurements as CSV (RFC 4180, UTF-8) with a header line; malloc'ed, NUL-terminated.
 * A text that a person typed never becomes a formula in a spreadsheet (measure_csv.c). NULL when
 * out of memory. Thread-safe. */
char *proto_measures_to_csv(const struct proto_measure *measures, size_t count, size_t *size);
/* Sets both units from the volume. */
void proto_measure_set_units(struct proto_measure_value *value, const struct sp_volume_info *info);
/* Writes the unit of a result: the unit of the samples, the unit of world coordinates, its square
 * or cube, or "deg"; "" = unknown. */
void proto_measure_unit(const struct proto_measure_value *value, char unit[SP_UNIT_BYTES + 2]);
/* Writes a note in English for the reader of the value: the unit is unknown, a fraction lies
 * outside of the volume, the samples were coarse, or there is no part; "" = no note. */
void proto_measure_note(const struct sp_measure *measure, const struct proto_measure_value *value,
                        char note[PROTO_MEASURE_NOTE_MAX + 1]);

#endif
