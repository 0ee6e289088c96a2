// SPDX-License-Identifier: Apache-2.0
//
// Values of the elements of a DICOM data set, for the files of the module.
#ifndef SP_IMPORT_DICOM_TAGS_H
#define SP_IMPORT_DICOM_TAGS_H

#include <cstdint>
#include <cstring>
#include <map>
#include <string>
#include <vector>

#include <gdcmDataSet.h>
#include <gdcmSequenceOfItems.h>

#include "data/import/dicom_bridge.h"

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

/* Copies a text and cuts it where it is too long, not inside of a UTF-8 character. A text that is
 * not UTF-8 is taken for Latin 1, which most other files have. */
void dicom_copy(char *out, size_t capacity, const std::string &text);

/* A text of the file as UTF-8, converted from the SpecificCharacterSet of the file; unchanged if it
 * is not valid there (dicom_text_bridge.cpp). */
std::string dicom_words(const gdcm::DataSet &file, const std::string &text);

/* What a file without functional groups does not give of its place. */
enum dicom_gap {
    DICOM_NO_GAP,
    DICOM_NO_DIRECTIONS, /* a position, but no directions: taken as axial */
    DICOM_ONLY_LOCATION  /* of one frame along an unknown normal: taken as z, not in the patient */
};
dicom_gap dicom_gap_of(const gdcm::DataSet &set);

/* Moves the position of a frame along the normal of its pixels [mm]. */
void dicom_move(dicom_frame *frame, double distance);

/* Numbers that together order frames; empty = the file does not say. */
using dicom_tuple = std::vector<uint32_t>;

/* Sets a key of frames to numbers that have the order of their tuples. Short tuples of small
 * numbers have the same number in all files. */
void dicom_number_tuples(const std::vector<dicom_tuple> &tuples, dicom_key key,
                         dicom_frame *frames);

struct dicom_dimension { /* of DimensionIndexValues, which the keys do not know */
    size_t place;
    gdcm::Tag pointer, group;
    std::string label;
};

/* Dimensions by which frames are listed and that no key has. */
std::vector<dicom_dimension> dicom_dimensions(const gdcm::DataSet &file);

/* The value of a dimension, if it is a number or a text, or else its index. `set`: the functional
 * group of the frame. */
std::string dicom_dimension_value(const gdcm::DataSet &set, const dicom_dimension &is,
                                  uint32_t index);

/* Of nuclear medicine: what vectors with a number for each frame say. All of it is read once. */
class dicom_nuclear {
  public:
    explicit dicom_nuclear(const gdcm::DataSet &set);

    /* The item of the detector of a frame, from 0; empty if there is none. */
    const gdcm::DataSet &detector(uint32_t index) const;

    /* Fills a frame, its place in time, and what else tells it from others. False if there is no
     * such vector. */
    bool fill(uint32_t index, dicom_frame *frame, dicom_tuple *time, dicom_tuple *other) const;

  private:
    struct phase {
        double start, duration; /* since the first frame; of one frame [s] */
    };
    void read_phases(const gdcm::DataSet &set);
    void read_slots(const gdcm::DataSet &set);
    unsigned number(uint16_t vector, uint32_t index) const;
    double time_of(uint32_t index) const;

    std::map<uint16_t, std::vector<uint16_t>> vectors; /* by the elements of group 0054 */
    std::vector<phase> phases;
    std::vector<double> slot_ends; /* since the heartbeat [s] */
    double slot_time;              /* of each slot [s]; NaN = not known */
    std::vector<std::string> window_names;
    gdcm::SmartPointer<gdcm::SequenceOfItems> detectors;
};

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

/* Fills *err and returns false. */
bool dicom_explain(sp_error *err, const char *text);

/* True, with the reason and a remedy in *err, if the file is packed in a way that GDCM does not
 * know (dicom_syntax_bridge.cpp). */
bool dicom_refuse_syntax(const char *path, sp_error *err);

/* What the code of packed pixels says (dicom_stream_bridge.cpp). */

/* True if a frame of JPEG, JPEG-LS or JPEG 2000 begins here. */
bool dicom_begins_frame(const char *code, size_t size);

/* Compares the colours that the header names with the colours of a frame's code; see open_pixels().
 */
void dicom_check_colors(const std::vector<uint8_t> &code, dicom_image *image);

/* The functions of struct dicom_bridge_functions that unpack pixels. */
void *dicom_open_pixels(const char *path, dicom_image *image, sp_error *err);
bool dicom_read_frame(void *pixels, uint32_t frame, void *out, size_t size, sp_error *err);
void dicom_close_pixels(void *pixels);
bool dicom_read_palette(const char *path, dicom_palette *palette, sp_error *err);

#endif
