/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/vtk_xml.h"

#include <string.h>
#include <strings.h>

/* True if the start of a file says which data set it has. */
static bool is_data_set(const uint8_t *start, size_t size) {
    static const char *const types[] = { "ImageData\"",         "RectilinearGrid\"",
                                         "StructuredGrid\"",    "UnstructuredGrid\"",
                                         "PolyData\"",          "vtkMultiBlockDataSet\"",
                                         "PartitionedDataSet\"" };
    bool has_type = false;
    for (size_t i = 0; i < sizeof types / sizeof *types; i++)
        has_type = has_type || memmem(start, size, types[i], strlen(types[i]));
    return has_type && memmem(start, size, "<VTKFile", 8);
}

bool vtk_xml_probe(const uint8_t *start, size_t size, const char *title) {
    static const uint8_t mark[] = { 0xef, 0xbb, 0xbf }; /* byte order, as UTF-8 */
    size_t n = strlen(title), i = size >= 3 && memcmp(start, mark, 3) == 0 ? 3 : 0;
    if (n == 0)
        return is_data_set(start, size);
    while (i < size && (start[i] == ' ' || (start[i] >= '\t' && start[i] <= '\r')))
        i++;
    const char *dot = strrchr(title, '.'), *ending = dot ? dot : "";
    static const char *const endings[] = { ".vti",  ".vtr",  ".vts",  ".vtu",  ".vtp", ".pvti",
                                           ".pvtr", ".pvts", ".pvtu", ".pvtp", ".vtm", ".vtmb",
                                           ".vtpd", ".vtpc", ".vth",  ".vthb" };
    bool is_named = false;
    for (size_t k = 0; k < sizeof endings / sizeof *endings; k++)
        is_named |= strcasecmp(ending, endings[k]) == 0;
    return (i < size && start[i] == '<') || is_named;
}

const char *const vtk_set_names[] = { [VTK_NO_SET] = "",
                                      [VTK_IMAGE] = "ImageData",
                                      [VTK_RECTILINEAR] = "RectilinearGrid",
                                      [VTK_STRUCTURED] = "StructuredGrid",
                                      [VTK_UNSTRUCTURED] = "UnstructuredGrid",
                                      [VTK_POLY] = "PolyData" };

bool vtk_xml_find_type(const char *type, enum vtk_set *set, bool *is_parallel, bool *is_composite) {
    static const char *const composite[] = { "vtkMultiBlockDataSet", "vtkPartitionedDataSet",
                                             "vtkPartitionedDataSetCollection" };
    const char *plain = type[0] == 'P' && strcmp(type, "PolyData") != 0 ? type + 1 : type;
    for (int i = VTK_IMAGE; i <= VTK_POLY; i++)
        if (strcmp(plain, vtk_set_names[i]) == 0)
            *set = (enum vtk_set)i;
    *is_parallel = *set && plain != type;
    for (size_t i = 0; i < sizeof composite / sizeof *composite; i++)
        *is_composite |= strcmp(type, composite[i]) == 0;
    return *set || *is_composite;
}

bool vtk_xml_find_packing(const char *compressor, enum vtk_packing *packing) {
    static const char *const known[] = { [VTK_PLAIN] = "",
                                         [VTK_ZLIB] = "vtkZLibDataCompressor",
                                         [VTK_LZ4] = "vtkLZ4DataCompressor",
                                         [VTK_LZMA] = "vtkLZMADataCompressor" };
    for (int i = VTK_PLAIN; i <= VTK_LZMA; i++)
        if (strcmp(compressor, known[i]) == 0) {
            *packing = (enum vtk_packing)i;
            return true;
        }
    return false;
}
