/* SPDX-License-Identifier: Apache-2.0
 *
 * The description that GDCM gives of a file may have any numbers. The input has the bytes of the
 * description and of the pixels. GDCM itself runs only in the sandbox.
 */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "data/import/dicom_bridge.h"
#include "data/import/module.h"
#include "fuzz/import_fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static size_t read_file(const char *path, void *out, size_t size) {
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    const ssize_t got = fd >= 0 ? pread(fd, out, size, 0) : -1;
    if (fd >= 0)
        close(fd);
    return got > 0 ? (size_t)got : 0;
}

/* Booleans must be 0 or 1. */
static void mend(bool *flag) {
    unsigned char byte;
    memcpy(&byte, flag, 1);
    *flag = byte & 1;
}

/* Texts end. */
static void mend_frame(struct dicom_frame *frame) {
    for (int text = 0; text < DICOM_TEXT_COUNT; text++)
        frame->texts[text][DICOM_TEXT_BYTES - 1] = 0;
    frame->stack[sizeof frame->stack - 1] = 0;
    frame->unit[sizeof frame->unit - 1] = 0;
    frame->segment &= 0xffff;
    mend(&frame->is_placed);
    mend(&frame->has_regions);
    mend(&frame->is_turned_wrong);
    mend(&frame->is_spaced);
    mend(&frame->is_assumed);
    mend(&frame->is_contradicted);
    mend(&frame->is_ratio);
}

/* The input changes these numbers, so that zeros are an image. */
static const struct dicom_image usual = {
    .series = "1",
    .columns = 4,
    .rows = 3,
    .frames = 6,
    .channels = 1,
    .bytes = 2,
    .bits = 12,
    .high_bit = 11,
    .is_in_patient = true,
    .pixels_at = 8,
    .pixels_bytes = 144,
    .first = { .is_placed = true,
               .along = { { 1, 0, 0 }, { 0, 1, 0 } },
               .spacing = { 1, 1, 2 },
               .high = 4095,
               .slope = 1 },
};

static bool describe(const char *path, struct dicom_image *image, struct sp_error *err) {
    bool *const flags[] = { &image->is_signed,      &image->is_float,      &image->is_bits,
                            &image->is_planar,      &image->is_packed,     &image->is_swapped,
                            &image->is_labels,      &image->is_in_patient, &image->has_number,
                            &image->is_directory,   &image->is_tiled,      &image->has_places,
                            &image->is_mosaic,      &image->has_labels,    &image->has_words,
                            &image->has_empty_image };
    unsigned char bytes[sizeof *image] = { 0 };
    *image = usual;
    if (read_file(path, bytes, sizeof bytes) == 0)
        return sp_fail(err, SP_ERR_FORMAT, "", "too short");
    for (size_t i = 0; i < sizeof bytes; i++)
        ((unsigned char *)image)[i] ^= bytes[i];
    image->id[sizeof image->id - 1] = 0;
    image->series[sizeof image->series - 1] = 0;
    image->patient[sizeof image->patient - 1] = 0;
    image->space[sizeof image->space - 1] = 0;
    image->modality[sizeof image->modality - 1] = 0;
    image->description[sizeof image->description - 1] = 0;
    image->note[sizeof image->note - 1] = 0;
    image->color_name[sizeof image->color_name - 1] = 0;
    image->colors = (enum dicom_colors)((unsigned)image->colors % (DICOM_OTHER_COLORS + 1));
    image->order = (enum dicom_order)((unsigned)image->order % (DICOM_ORDER_TIMES + 1));
    for (size_t i = 0; i < sizeof flags / sizeof *flags; i++)
        mend(flags[i]);
    mend_frame(&image->first);
    return true;
}

/* The frames have three places per time. The bytes after the struct dicom_image change them. */
static bool describe_frames(const char *path, struct dicom_frame *frames, uint32_t count,
                            struct sp_error *err) {
    struct dicom_image image;
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    bool ok = describe(path, &image, err);
    for (uint32_t i = 0; ok && i < count; i++) {
        unsigned char bytes[sizeof *frames] = { 0 };
        frames[i] = image.first;
        frames[i].position[2] += 2 * (i % 3);
        frames[i].keys[DICOM_KEY_PHASE] = i / 3;
        frames[i].instance = i + 1;
        if (pread(fd, bytes, sizeof bytes, (off_t)(sizeof image + i * sizeof bytes)) > 0)
            for (size_t n = 0; n < sizeof bytes; n++)
                ((unsigned char *)&frames[i])[n] ^= bytes[n];
        mend_frame(&frames[i]);
    }
    if (fd >= 0)
        close(fd);
    return ok;
}

static void *open_pixels(const char *path, struct dicom_image *image, struct sp_error *err) {
    char *pixels = strdup(path);
    (void)image;
    if (!pixels)
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
    return pixels;
}

static bool read_frame(void *pixels, uint32_t frame, void *out, size_t size, struct sp_error *err) {
    memset(out, 0, size);
    (void)frame;
    return read_file(pixels, out, size) > 0 || sp_fail(err, SP_ERR_FORMAT, "", "too short");
}

static void close_pixels(void *pixels) {
    free(pixels);
}

static bool read_palette(const char *path, struct dicom_palette *palette, struct sp_error *err) {
    uint16_t numbers[2] = { 0 };
    read_file(path, numbers, sizeof numbers);
    palette->first = numbers[0];
    palette->count = numbers[1] + 1u;
    palette->colors = calloc(palette->count, 3);
    return palette->colors || sp_fail(err, SP_ERR_MEMORY, "", "out of memory");
}

/* In place of module.c. */
const void *import_module_load(const struct import_file *file, const char *module,
                               const char *symbol, const char *library, const char *package,
                               struct sp_error *err) {
    static const struct dicom_bridge_functions functions = { describe,     describe_frames,
                                                             open_pixels,  read_frame,
                                                             close_pixels, read_palette };
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
