/* SPDX-License-Identifier: Apache-2.0
 *
 * All formats.
 */
#include "data/import/foreign.h"
#include "data/import/format.h"

/* In the order in which they are asked. DICOM comes first, because such a file may begin as a TIFF.
 */
static const struct import_format *const formats[] = {
    &import_zarr,    &import_dicom,  &import_tiff_stack, &import_image_stack, &import_nrrd,
    &import_mrc,     &import_gipl,   &import_mgh,        &import_nifti,       &import_metaimage,
    &import_pvm,     &import_vdb,    &import_ply,        &import_collection,  &import_vtk,
    &import_vtk_xml, &import_spz,    &import_csv,        &import_mesh,        &import_amira,
    &import_vol,     &import_netcdf, &import_hdf5,       &import_plot3d,      &import_raw
};

bool import_format_needs_module(const uint8_t *start, size_t size, const char *title) {
    bool needed = false;
    for (size_t i = 0; i < sizeof formats / sizeof formats[0]; i++)
        needed |= formats[i]->needs_module &&
                  (formats[i]->probe(start, size, "") || formats[i]->probe(start, size, title));
    return needed;
}

bool import_format_is_known(const uint8_t *start, size_t size, const char *title) {
    for (size_t i = 0; i < sizeof formats / sizeof formats[0]; i++)
        if (formats[i]->probe(start, size, title))
            return true;
    return false;
}

static const struct import_format *find_format(const uint8_t *start, size_t size,
                                               const char *title) {
    for (size_t i = 0; i < sizeof formats / sizeof formats[0]; i++)
        if (formats[i]->probe(start, size, title))
            return formats[i];
    return NULL;
}

const struct import_format *import_format_find(const uint8_t *start, size_t size, const char *title,
                                               struct sp_error *err) {
    if (size == 0) {
        import_fail(err, SP_ERR_FORMAT, title, 0, NULL, "the file is empty");
        return NULL;
    }
    /* The contents of a file count more than its name; but files of several formats may be packed
     * with gzip. */
    const bool is_gzip = size >= 2 && start[0] == 0x1f && start[1] == 0x8b;
    const struct import_format *found = find_format(start, size, "");
    if (!found && is_gzip)
        found = find_format(start, size, title);
    if (!found && !import_foreign_check(start, size, title, err))
        return NULL;
    if (!found)
        found = find_format(start, size, title);
    if (found) /* NetCDF-4 files are HDF5 files; their names tell */
        return found == &import_hdf5 && import_netcdf.probe(start, size, title) ? &import_netcdf
                                                                                : found;
    if (!import_foreign_check_name(title, err))
        return NULL;
    char names[SP_ERROR_TEXT - 64] = "";
    struct import_list list;
    import_list_begin(&list, names, sizeof names);
    for (size_t i = 0; i < sizeof formats / sizeof formats[0]; i++)
        import_list_add(&list, i > 0 ? ", " : "", formats[i]->name);
    import_list_end(&list, false);
    import_fail(err, SP_ERR_UNSUPPORTED, title, 0, NULL, "unknown file format; supported are %s",
                names);
    return NULL;
}
