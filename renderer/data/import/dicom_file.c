/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/dicom_file.h"

#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "data/import/confine.h"

bool dicom_has_ending(const char *name) {
    static const char *const endings[] = { ".dcm", ".dicom", ".ima" };
    const char *dot = strrchr(name, '.');
    for (size_t i = 0; dot && i < sizeof endings / sizeof *endings; i++)
        if (strcasecmp(dot, endings[i]) == 0)
            return true;
    return false;
}

/* True for group 8, with which files without a preamble begin: an element, then two letters that
 * name its type, or else a length, after which comes the next element of the group. */
static bool is_group_8(const uint8_t *start, size_t size) {
    if (size < 8 || start[0] != 8 || start[1] != 0 || start[3] != 0)
        return false;
    const bool has_letters =
        start[4] >= 'A' && start[4] <= 'Z' && start[5] >= 'A' && start[5] <= 'Z';
    const size_t length = start[4], next = 8 + length;
    const bool is_short = start[5] == 0 && start[6] == 0 && start[7] == 0 && length % 2 == 0;
    const bool is_followed = next + 4 <= size && start[next] == 8 && start[next + 1] == 0 &&
                             start[next + 3] == 0 && start[next + 2] > start[2];
    return has_letters || (is_short && is_followed);
}

bool dicom_is_file(const uint8_t *start, size_t size) {
    return (size >= DICOM_PREFIX && memcmp(start + DICOM_PREFIX - 4, "DICM", 4) == 0) ||
           is_group_8(start, size);
}

bool dicom_fail(const struct dicom_source *source, enum sp_code code, const char *name,
                const char *text, struct sp_error *err) {
    char place[SP_ERROR_PLACE];
    const bool is_same = strcmp(name, "") == 0;
    snprintf(place, sizeof place, "%.180s%s%.60s", source->file->title, is_same ? "" : ": ", name);
    return sp_fail(err, code, place, "%s", text);
}

int dicom_open(const struct dicom_source *source, const char *name, struct sp_error *err) {
    char path[2 * PATH_MAX], real[PATH_MAX];
    uint64_t size;
    if (!*name)
        return source->file->fd;
    snprintf(path, sizeof path, "%s/%s", source->file->folder, name);
    return sp_open_confined(source->file->root, path, name, real, &size, err);
}

void dicom_close(const struct dicom_source *source, int fd) {
    if (fd >= 0 && fd != source->file->fd)
        close(fd);
}

/* The path refers to the file however it is renamed meanwhile. */
bool dicom_describe(const struct dicom_source *source, int fd, struct dicom_image *image,
                    struct sp_error *err) {
    char path[40];
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    return source->call->describe(path, image, err);
}
