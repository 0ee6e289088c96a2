/* SPDX-License-Identifier: Apache-2.0 */
#include "import/dicom_folder.h"

#include <dirent.h>
#include <string.h>
#include <unistd.h>

enum { FILES_MAX = 1 << 16 };

static bool is_same_direction(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] > 0.9999;
}

/* A series may have other images, such as an overview, which are not part of the volume. */
static bool belongs(const struct dicom_image *one, const struct dicom_image *other) {
    const struct dicom_frame *a = &one->first, *b = &other->first;
    return strcmp(one->series, other->series) == 0 && other->frames == 1 &&
           one->columns == other->columns && one->rows == other->rows &&
           one->channels == other->channels && one->bytes == other->bytes &&
           one->is_signed == other->is_signed && one->is_float == other->is_float &&
           a->is_placed == b->is_placed &&
           (!a->is_placed || (is_same_direction(a->along[0], b->along[0]) &&
                              is_same_direction(a->along[1], b->along[1])));
}

/* Adds a file of the folder if it is a slice of the series, and counts it if it is another image
 * of the series. False if there is no memory. */
static bool take_file(const struct dicom_source *source, const char *name,
                      struct dicom_slices *slices, unsigned *left_out) {
    char why[SP_ERROR_TEXT];
    uint8_t start[DICOM_PREFIX];
    struct dicom_image image;
    struct sp_error ignored;
    int fd = dicom_open(source, name, &ignored);
    if (fd < 0)
        return true;
    const ssize_t got = pread(fd, start, sizeof start, 0);
    const bool is_image = got > 0 &&
                          (dicom_is_file(start, (size_t)got) || dicom_has_ending(name)) &&
                          dicom_describe(source, fd, &image, why);
    const bool is_slice = is_image && belongs(&source->image, &image);
    dicom_close(source, fd);
    *left_out += is_image && !is_slice && strcmp(source->image.series, image.series) == 0;
    return !is_slice || dicom_slices_add(slices, name, 0, &image.first);
}

bool dicom_folder_list(const struct dicom_source *source, struct dicom_slices *slices,
                       struct sp_error *err) {
    const struct import_file *file = source->file;
    DIR *folder = opendir(file->folder);
    unsigned left_out = 0;
    bool ok = true;
    if (!folder)
        return sp_fail(err, SP_ERR_IO, file->shown, "cannot list the folder of the file");
    for (const struct dirent *entry; ok && slices->count < FILES_MAX && (entry = readdir(folder));)
        if (entry->d_name[0] != '.')
            ok = take_file(source, entry->d_name, slices, &left_out);
    closedir(folder);
    if (left_out)
        import_warn(file->warnings,
                    "Left out %u other %s of the series, whose size, type or direction differs.",
                    left_out, left_out > 1 ? "images" : "image");
    return ok || sp_fail(err, SP_ERR_MEMORY, file->shown, "out of memory for the slices");
}
