/* SPDX-License-Identifier: Apache-2.0
 *
 * Units of length.
 */
#ifndef SP_VOLUME_UNIT_H
#define SP_VOLUME_UNIT_H

struct sp_unit {
    const char *name, *symbol; /* in files; as volumes name it */
    double meters;
};

/* A unit of length by its symbol, or by its name: of any case, also in the plural, and "metre" as
 * well as "meter". NULL = none of these. */
const struct sp_unit *sp_unit_find(const char *name);

/* Its name in English, as OME-Zarr has it: "millimeter". */
const char *sp_unit_full_name(const struct sp_unit *unit);

#endif
