/* SPDX-License-Identifier: Apache-2.0 */
#include "import/vtk_xml_probe.h"

#include <string.h>
#include <strings.h>

/* True if the start of a file says which data set it has. */
static bool is_data_set(const uint8_t *start, size_t size) {
    static const char *const types[] = { "\"ImageData\"", "\"RectilinearGrid\"",
                                         "\"StructuredGrid\"", "\"UnstructuredGrid\"",
                                         "\"PolyData\"" };
    bool has_type = false;
    for (size_t i = 0; i < sizeof types / sizeof *types; i++)
        has_type = has_type || memmem(start, size, types[i], strlen(types[i]));
    return has_type && memmem(start, size, "<VTKFile", 8);
}

bool vtk_xml_probe(const uint8_t *start, size_t size, const char *shown) {
    static const uint8_t mark[] = { 0xef, 0xbb, 0xbf }; /* byte order, as UTF-8 */
    size_t n = strlen(shown), i = size >= 3 && memcmp(start, mark, 3) == 0 ? 3 : 0;
    if (n == 0)
        return is_data_set(start, size);
    while (i < size && (start[i] == ' ' || (start[i] >= '\t' && start[i] <= '\r')))
        i++;
    const char *ending = n > 4 ? shown + n - 4 : "";
    static const char *const endings[] = { ".vti", ".vtr", ".vts", ".vtu", ".vtp" };
    bool is_named = false;
    for (size_t k = 0; k < sizeof endings / sizeof *endings; k++)
        is_named |= strcasecmp(ending, endings[k]) == 0;
    return (i < size && start[i] == '<') || is_named;
}
