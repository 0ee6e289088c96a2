// SPDX-License-Identifier: Apache-2.0
//
// Values of the elements of a DICOM data set, for the files of the module.
#ifndef SP_IMPORT_DICOM_TAGS_H
#define SP_IMPORT_DICOM_TAGS_H

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include <gdcmDataSet.h>
#include <gdcmSequenceOfItems.h>

#include "import/dicom_bridge.h"

/* The text of an element, without the blanks around it; "" if there is none. */
std::string dicom_text(const gdcm::DataSet &set, uint16_t group, uint16_t element);

/* The numbers of an element that holds them as text. */
std::vector<double> dicom_numbers(const gdcm::DataSet &set, uint16_t group, uint16_t element);

/* The first of them, or NaN. */
double dicom_number(const gdcm::DataSet &set, uint16_t group, uint16_t element);

/* The numbers of an element that holds them in binary form. */
template <typename T>
std::vector<T> dicom_values(const gdcm::DataSet &set, uint16_t group, uint16_t element) {
    const gdcm::Tag tag(group, element);
    const gdcm::ByteValue *bytes =
        set.FindDataElement(tag) ? set.GetDataElement(tag).GetByteValue() : nullptr;
    std::vector<T> values(bytes ? bytes->GetLength() / sizeof(T) : 0);
    if (!values.empty())
        memcpy(values.data(), bytes->GetPointer(), values.size() * sizeof(T));
    return values;
}

/* The first of them as a double, or NaN. */
template <typename T>
double dicom_value(const gdcm::DataSet &set, uint16_t group, uint16_t element) {
    const std::vector<T> values = dicom_values<T>(set, group, element);
    return values.empty() ? __builtin_nan("") : static_cast<double>(values[0]);
}

/* A sequence; null if there is none. */
gdcm::SmartPointer<gdcm::SequenceOfItems> dicom_sequence(const gdcm::DataSet &set, uint16_t group,
                                                         uint16_t element);

/* One item of a sequence, from 1; an empty one if there is none. */
gdcm::DataSet dicom_item(const gdcm::DataSet &set, uint16_t group, uint16_t element,
                         size_t number = 1);

/* Copies a text and cuts it where it is too long, not inside of a UTF-8 character. */
void dicom_copy(char *out, size_t capacity, const std::string &text);

/* What a file without functional groups does not give of its place. */
enum dicom_gap {
    DICOM_NO_GAP,
    DICOM_NO_DIRECTIONS, /* a position, but no directions: taken as axial */
    DICOM_ONLY_LOCATION  /* of one frame along an unknown normal: taken as z, not in the patient */
};
dicom_gap dicom_gap_of(const gdcm::DataSet &set);

/* Moves the position of a frame along the normal of its pixels [mm]. */
void dicom_move(dicom_frame *frame, double distance);

/* Of nuclear medicine: the item of the detector of a frame, from 0; empty if there is none. */
gdcm::DataSet dicom_detector(const gdcm::DataSet &set, uint32_t index);

/* Of nuclear medicine: what vectors with a number for each frame say. False if there are none. */
bool dicom_fill_nuclear(const gdcm::DataSet &set, uint32_t index, dicom_frame *frame);

/* Fills frames [0, count) from the data set of a file; image->frames says how many it has. */
void dicom_fill_frames(const gdcm::DataSet &set, const dicom_image &image, dicom_frame *frames,
                       uint32_t count);

/* What manufacturers put into elements of their own (dicom_private_bridge.cpp). */

/* The b-value of diffusion [s/mm²] of a file, or NaN. */
double dicom_b_value(const gdcm::DataSet &set);

/* The direction of diffusion in the item of a frame, or else of a file; empty = not known. */
std::vector<double> dicom_gradient(const gdcm::DataSet &set, const gdcm::DataSet &item);

/* If the file is a mosaic, whose tiles are the slices of one time, makes frames of the tiles. */
void dicom_describe_mosaic(const gdcm::DataSet &set, dicom_image *image);

/* Where a tile of the mosaic lies; *frame has the place of the mosaic. */
void dicom_place_tile(const gdcm::DataSet &set, const dicom_image &image, uint32_t index,
                      dicom_frame &frame);

/* The functions of struct dicom_bridge_functions that unpack pixels. */
void *dicom_open_pixels(const char *path, char *why, size_t capacity);
bool dicom_read_frame(void *pixels, uint32_t frame, void *out, size_t size, char *why,
                      size_t capacity);
void dicom_close_pixels(void *pixels);
bool dicom_read_palette(const char *path, dicom_palette *palette, char *why, size_t capacity);

#endif
