/* SPDX-License-Identifier: Apache-2.0
 *
 * XML files of VTK: one alone, or one that names others. The files of a parallel data set (.pvti …)
 * are its pieces. Of a composite data set (.vtm, .vtpd) the first block is read.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/vtk_xml.h"

enum { BLOCKS_MAX = 1 << 16 };

bool vtk_xml_add_name(struct vtk_xml_names *names, const char *file,
                      const struct import_file *source, struct sp_error *err) {
    if (names->blocks.count == BLOCKS_MAX)
        return sp_fail(err, SP_ERR_UNSUPPORTED, source->title,
                       "the file has more than %d blocks, the limit; open the files of the blocks",
                       BLOCKS_MAX);
    return import_names_append(&names->blocks, file) ||
           sp_fail(err, SP_ERR_MEMORY, source->title, "out of memory for the blocks");
}

/* Says which blocks are left out. */
static void warn_of_blocks(const struct vtk_volume *v, const struct vtk_xml_names *names) {
    char text[SP_WARNING_BYTES - 100] = "";
    struct import_list list;
    import_list_begin(&list, text, sizeof text);
    for (uint32_t i = 1; i < names->blocks.count; i++)
        import_list_add(&list, i > 1 ? ", " : "", names->blocks.names[i]);
    import_list_end(&list, false);
    import_warn(v->file->warnings,
                "Only the first of %u blocks, %.60s, is read. Open the others by their files: %s.",
                names->blocks.count, names->blocks.names[0], text);
}

static bool read_block(struct vtk_volume *v, const struct vtk_xml_names *names,
                       struct sp_error *err) {
    struct vtk_xml_names none = { .is_parallel = false };
    if (names->blocks.count == 0)
        return sp_fail(err, SP_ERR_FORMAT, v->file->title,
                       "the composite data set names no file of a block");
    const uint32_t number = vtk_add_file(v, names->blocks.names[0], err);
    bool ok = number && vtk_xml_read(v, number, &none, err);
    if (ok && (none.is_parallel || none.is_composite))
        ok = sp_fail(err, SP_ERR_UNSUPPORTED, v->file->title,
                     "the first block, %.100s, names files of its own; open that file instead",
                     names->blocks.names[0]);
    import_names_finish(&none.blocks);
    if (ok && names->blocks.count > 1)
        warn_of_blocks(v, names);
    return ok;
}

/* Reads the file, and the files that it names. */
static bool parse(struct vtk_volume *v, struct sp_error *err) {
    struct vtk_xml_names names = { .is_parallel = false };
    bool ok = vtk_xml_read(v, 0, &names, err);
    if (ok && names.is_composite)
        ok = read_block(v, &names, err);
    for (uint32_t i = 1; ok && names.is_parallel && i <= v->file_count; i++)
        ok = vtk_xml_read(v, i, NULL, err);
    import_names_finish(&names.blocks);
    if (ok && v->cell_count)
        vtk_warn_of_cells(v, v->cell_count);
    return ok;
}

static bool open_xml(void *reader, const struct import_file *file, struct import_header *header,
                     struct sp_error *err) {
    struct vtk_volume *v = reader;
    vtk_init(v, file);
    return parse(v, err) && vtk_complete(v, header, err);
}

static bool read_time(const struct import_file *file, double *time) {
    struct vtk_volume v;
    vtk_init(&v, file);
    const bool ok = parse(&v, NULL) && isfinite(v.time);
    *time = v.time;
    vtk_close(&v);
    return ok;
}

const struct import_format import_vtk_xml = { .name = "VTK XML (.vti, .vtu, .vtp and others)",
                                              .probe = vtk_xml_probe,
                                              .reader_size = sizeof(struct vtk_volume),
                                              .open = open_xml,
                                              .read = vtk_read,
                                              .read_elements = vtk_read_elements,
                                              .close = vtk_close,
                                              .read_time = read_time };
