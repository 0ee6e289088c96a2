/* SPDX-License-Identifier: Apache-2.0
 *
 * One XML file of VTK, and the names of others in it.
 */
#ifndef SP_IMPORT_VTK_XML_H
#define SP_IMPORT_VTK_XML_H

#include "data/import/numbered.h"
#include "data/import/vtk.h"

/* The names in XML files. */
extern const char *const vtk_set_names[];

/* probe() of struct import_format. */
bool vtk_xml_probe(const uint8_t *start, size_t size, const char *title);

/* Finds the data set of a type: itself, in pieces of other files (parallel), or in blocks of other
 * files (composite, without a set). False if it is not supported. */
bool vtk_xml_find_type(const char *type, enum vtk_set *set, bool *is_parallel, bool *is_composite);

/* False if the compressor is not supported. */
bool vtk_xml_find_packing(const char *compressor, enum vtk_packing *packing);

struct vtk_xml_names {
    bool is_parallel;  /* the names of pieces are in vtk_volume.files */
    bool is_composite; /* the names of blocks are here */
    struct import_names blocks;
};

/* Reads the pieces and arrays of a file. `names` is NULL for a piece of another file, which then
 * must have the same data set and no names. */
bool vtk_xml_read(struct vtk_volume *v, uint32_t number, struct vtk_xml_names *names,
                  struct sp_error *err);

/* Adds a block. */
bool vtk_xml_add_name(struct vtk_xml_names *names, const char *file,
                      const struct import_file *source, struct sp_error *err);

#endif
