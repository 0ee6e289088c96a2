/* SPDX-License-Identifier: Apache-2.0 */
#include "data/volume/unit.h"

#include <stdio.h>
#include <string.h>
#include <strings.h>

/* If a unit has several names, OME-Zarr uses the first. */
static const struct sp_unit units[] = {
    { "femtometer", "fm", 1e-15 },
    { "picometer", "pm", 1e-12 },
    { "pm", "pm", 1e-12 },
    { "angstrom", "A", 1e-10 },
    { "\xc3\x85ngstr\xc3\xb6m", "A", 1e-10 },
    { "\xc3\x85", "A", 1e-10 },
    { "\xe2\x84\xab", "A", 1e-10 },
    { "nanometer", "nm", 1e-9 },
    { "nm", "nm", 1e-9 },
    { "micrometer", "um", 1e-6 },
    { "micron", "um", 1e-6 },
    { "um", "um", 1e-6 },
    { "\xc2\xb5m", "um", 1e-6 },
    { "\xce\xbcm", "um", 1e-6 },
    { "millimeter", "mm", 1e-3 },
    { "mm", "mm", 1e-3 },
    { "centimeter", "cm", 1e-2 },
    { "cm", "cm", 1e-2 },
    { "decimeter", "dm", 1e-1 },
    { "meter", "m", 1 },
    { "m", "m", 1 },
    { "hectometer", "hm", 1e2 },
    { "kilometer", "km", 1e3 },
    { "km", "km", 1e3 },
    { "megameter", "Mm", 1e6 },
    { "gigameter", "Gm", 1e9 },
    { "inch", "in", 0.0254 },
    { "inche", "in", 0.0254 }, /* without the s of the plural */
    { "foot", "ft", 0.3048 },
    { "feet", "ft", 0.3048 },
    { "yard", "yd", 0.9144 },
    { "mile", "mi", 1609.344 },
    { "parsec", "pc", 3.0856775814913673e16 },
    { "kiloparsec", "kpc", 3.0856775814913673e19 },
    { "megaparsec", "Mpc", 3.0856775814913673e22 },
    { "astronomical_unit", "AU", 1.495978707e11 },
};

enum { NAME_BYTES = 32, PLURAL_MIN = 4 };

/* "Kilometres" becomes "Kilometer": one word, in the singular and as in American English. */
static void simplify(const char *name, char out[NAME_BYTES]) {
    while (*name == ' ')
        name++;
    snprintf(out, NAME_BYTES, "%s", name);
    size_t length = strlen(out);
    while (length > 0 && out[length - 1] == ' ')
        out[--length] = 0;
    if (length >= PLURAL_MIN && (out[length - 1] == 's' || out[length - 1] == 'S'))
        out[--length] = 0;
    if (length >= 5 && strcasecmp(out + length - 5, "metre") == 0)
        strcpy(out + length - 2, "er");
}

const struct sp_unit *sp_unit_find(const char *name) {
    char simple[NAME_BYTES];
    simplify(name, simple);
    for (size_t i = 0; i < sizeof units / sizeof *units; i++) /* "Mm" is not "mm" */
        if (strcmp(units[i].symbol, simple) == 0)
            return &units[i];
    for (size_t i = 0; i < sizeof units / sizeof *units; i++)
        if (strcasecmp(units[i].name, simple) == 0)
            return &units[i];
    return NULL;
}

const char *sp_unit_full_name(const struct sp_unit *unit) {
    for (size_t i = 0; i < sizeof units / sizeof *units; i++)
        if (strcmp(units[i].symbol, unit->symbol) == 0)
            return units[i].name;
    return unit->name;
}
