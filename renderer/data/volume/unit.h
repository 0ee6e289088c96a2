/* SPDX-License-Identifier: Apache-2.0
 *
 * Units of length.
 */
#ifndef SP_VOLUME_UNIT_H
#define SP_VOLUME_UNIT_H

struct sp_unit {
    const char *name, *symbol; /* name in files; symbol in volumes */
    double meters;
};

/* Finds a unit of length by its symbol, or by its name: in any case, also in the plural, "metre" as
 * well as "meter". NULL = unknown. */
const struct sp_unit *sp_unit_find(const char *name);

/* Returns the English name of the unit, as in OME-Zarr: "millimeter". */
const char *sp_unit_full_name(const struct sp_unit *unit);

#endif
