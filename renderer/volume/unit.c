/* SPDX-License-Identifier: Apache-2.0 */
#include "volume/unit.h"

#include <stddef.h>
#include <string.h>
#include <strings.h>

/* The first of several names is that of OME-Zarr. */
static const struct sp_unit units[] = {
    { "angstrom", "A", 1e-10 },
    { "\xc3\x85", "A", 1e-10 },
    { "nanometer", "nm", 1e-9 },
    { "nm", "nm", 1e-9 },
    { "micrometer", "um", 1e-6 },
    { "micron", "um", 1e-6 },
    { "microns", "um", 1e-6 },
    { "um", "um", 1e-6 },
    { "\xc2\xb5m", "um", 1e-6 },
    { "\xce\xbcm", "um", 1e-6 },
    { "millimeter", "mm", 1e-3 },
    { "mm", "mm", 1e-3 },
    { "centimeter", "cm", 1e-2 },
    { "cm", "cm", 1e-2 },
    { "meter", "m", 1 },
    { "meters", "m", 1 },
    { "metre", "m", 1 },
    { "metres", "m", 1 },
    { "m", "m", 1 },
    { "kilometer", "km", 1e3 },
    { "km", "km", 1e3 },
    { "picometer", "pm", 1e-12 },
    { "pm", "pm", 1e-12 },
    { "inch", "in", 0.0254 },
};

const struct sp_unit *sp_unit_find(const char *name) {
    for (size_t i = 0; i < sizeof units / sizeof *units; i++)
        if (strcasecmp(units[i].name, name) == 0 || strcmp(units[i].shown, name) == 0)
            return &units[i];
    return NULL;
}

const char *sp_unit_full_name(const struct sp_unit *unit) {
    for (size_t i = 0; i < sizeof units / sizeof *units; i++)
        if (strcmp(units[i].shown, unit->shown) == 0)
            return units[i].name;
    return unit->name;
}
