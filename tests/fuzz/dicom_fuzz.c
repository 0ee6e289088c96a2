/* SPDX-License-Identifier: Apache-2.0
 *
 * What GDCM may say of a file: any numbers. The bytes of the input are those of the description and
 * of the pixels. GDCM itself runs only in the sandbox.
 */
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "fuzz/import_fuzz.h"
#include "import/dicom_bridge.h"
#include "import/module.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static size_t read_file(const char *path, void *out, size_t size) {
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    const ssize_t got = fd >= 0 ? pread(fd, out, size, 0) : -1;
    if (fd >= 0)
        close(fd);
    return got > 0 ? (size_t)got : 0;
}

/* Booleans must be 0 or 1, and texts end. */
static bool describe(const char *path, struct dicom_image *image, char *why, size_t capacity) {
    bool *const flags[] = { &image->is_signed,      &image->is_float,        &image->is_palette,
                            &image->is_other_color, &image->first.is_placed, &image->is_packed };
    memset(image, 0, sizeof *image);
    snprintf(why, capacity, "too short");
    if (read_file(path, image, sizeof *image) < sizeof *image)
        return false;
    image->series[sizeof image->series - 1] = 0;
    image->modality[sizeof image->modality - 1] = 0;
    image->rescale_type[sizeof image->rescale_type - 1] = 0;
    image->description[sizeof image->description - 1] = 0;
    for (size_t i = 0; i < sizeof flags / sizeof *flags; i++) {
        unsigned char byte;
        memcpy(&byte, flags[i], 1);
        *flags[i] = byte & 1;
    }
    return true;
}

static bool read_pixels(const char *path, void *out, size_t size, char *why, size_t capacity) {
    snprintf(why, capacity, "too short");
    memset(out, 0, size);
    return read_file(path, out, size) > 0;
}

/* In place of module.c. */
const void *import_module_load(const struct import_file *file, const char *module,
                               const char *symbol, const char *library, const char *package,
                               struct sp_error *err) {
    static const struct dicom_bridge_functions functions = { describe, read_pixels };
    (void)file;
    (void)module;
    (void)symbol;
    (void)library;
    (void)package;
    (void)err;
    return &functions;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    return fuzz_import(&import_dicom, "input.dcm", data, size);
}
