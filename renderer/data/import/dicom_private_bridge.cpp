// SPDX-License-Identifier: Apache-2.0
//
// What manufacturers put into elements of their own: mosaics of Siemens, diffusion. The CSA header
// of Siemens is read as nibabel's documentation describes it ("Siemens CSA header"), the place of
// the tiles of a mosaic as in "DICOM Mosaic" there.
#include <cmath>
#include <cstdlib>

#include "data/import/dicom_tags.h"

namespace {

enum { CSA_COUNT_MAX = 1000 }; /* elements of a header, and items of an element */

/* The element whose number ends with `low` in the block of this creator, or in the first block if
 * that names no creator, as in files that were made anonymous; 0 = none. */
uint16_t element_of(const gdcm::DataSet &set, uint16_t group, const char *creator, uint16_t low) {
    const uint16_t first = 0x10, last = 0x1f;
    for (uint16_t block = first; block <= last; block++)
        if (dicom_text(set, group, block) == creator)
            return static_cast<uint16_t>(block << 8 | low);
    const uint16_t element = static_cast<uint16_t>(first << 8 | low);
    const bool is_there = set.FindDataElement(gdcm::Tag(group, element));
    return is_there && dicom_text(set, group, first).empty() ? element : 0;
}

/* Reads through bytes; past their end come zeros. */
struct cursor {
    const std::vector<uint8_t> &bytes;
    size_t at;

    int32_t number() {
        int32_t value = 0;
        if (at + sizeof value <= bytes.size())
            memcpy(&value, bytes.data() + at, sizeof value);
        at += sizeof value;
        return value;
    }

    std::string text(size_t size) {
        std::string value;
        for (size_t i = at; i < at + size && i < bytes.size() && bytes[i]; i++)
            value += static_cast<char>(bytes[i]);
        at += size;
        return value;
    }
};

/* The numbers of an element of a CSA header, of version 1 or 2. */
std::vector<double> csa_numbers(const std::vector<uint8_t> &bytes, const char *wanted) {
    const bool is_new = bytes.size() > 8 && memcmp(bytes.data(), "SV10", 4) == 0;
    cursor in = { bytes, is_new ? size_t{ 8 } : 0 };
    const int32_t count = in.number();
    int32_t first_items = 0; /* version 1 adds this number to lengths */
    in.number();
    for (int32_t tag = 0; tag < count && tag < CSA_COUNT_MAX && in.at < bytes.size(); tag++) {
        std::vector<double> numbers;
        const std::string name = in.text(64);
        in.text(12); /* multiplicity, representation, type */
        const int32_t items = in.number();
        in.number();
        first_items = tag == 0 ? items : first_items;
        for (int32_t i = 0; i < items && i < CSA_COUNT_MAX && in.at < bytes.size(); i++) {
            const int32_t old_length = in.number(), new_length = in.number();
            in.text(8);
            const int64_t length = is_new ? new_length : int64_t{ old_length } - first_items;
            if (length < 0 || static_cast<size_t>(length) > bytes.size())
                return {};
            const std::string value = in.text(static_cast<size_t>(length));
            in.at += static_cast<size_t>((4 - length % 4) % 4);
            if (!value.empty())
                numbers.push_back(strtod(value.c_str(), nullptr));
        }
        if (name == wanted)
            return numbers;
    }
    return {};
}

std::vector<double> csa_of(const gdcm::DataSet &set, const char *wanted) {
    const uint16_t element = element_of(set, 0x0029, "SIEMENS CSA HEADER", 0x10);
    return element ? csa_numbers(dicom_values<uint8_t>(set, 0x0029, element), wanted)
                   : std::vector<double>();
}

unsigned count_of_mosaic(const gdcm::DataSet &set) {
    const std::vector<double> csa = csa_of(set, "NumberOfImagesInMosaic");
    const uint16_t element = element_of(set, 0x0019, "SIEMENS MR HEADER", 0x0a);
    const double count = !csa.empty() && csa[0] >= 1 ? csa[0]
                         : element                   ? dicom_value<uint16_t>(set, 0x0019, element)
                                                     : NAN;
    return count >= 1 && count <= 65535 ? static_cast<unsigned>(count) : 0;
}

} // namespace

double dicom_b_value(const gdcm::DataSet &set) {
    const double standard = dicom_value<double>(set, 0x0018, 0x9087);
    if (std::isfinite(standard))
        return standard;
    if (const uint16_t siemens = element_of(set, 0x0019, "SIEMENS MR HEADER", 0x0c))
        return dicom_number(set, 0x0019, siemens);
    if (const uint16_t philips = element_of(set, 0x2001, "Philips Imaging DD 001", 0x03))
        return dicom_value<float>(set, 0x2001, philips);
    if (const uint16_t ge = element_of(set, 0x0043, "GEMS_PARM_01", 0x39))
        return std::fmod(dicom_number(set, 0x0043, ge), 1e6); /* 1000001000 is 1000 */
    const std::vector<double> csa = csa_of(set, "B_value");
    return csa.empty() ? NAN : csa[0];
}

std::vector<double> dicom_gradient(const gdcm::DataSet &set, const gdcm::DataSet &item) {
    std::vector<double> standard = dicom_values<double>(item, 0x0018, 0x9089);
    if (standard.size() < 3)
        standard = dicom_values<double>(set, 0x0018, 0x9089);
    if (standard.size() >= 3)
        return standard;
    if (const uint16_t siemens = element_of(set, 0x0019, "SIEMENS MR HEADER", 0x0e))
        return dicom_values<double>(set, 0x0019, siemens);
    std::vector<double> three;
    for (uint16_t axis = 0; axis < 3; axis++) {
        const uint16_t philips = element_of(set, 0x2005, "Philips MR Imaging DD 001", 0xb0 + axis);
        const uint16_t ge = element_of(set, 0x0019, "GEMS_ACQU_01", 0xbb + axis);
        const double number = philips ? dicom_value<float>(set, 0x2005, philips)
                              : ge    ? dicom_number(set, 0x0019, ge)
                                      : NAN;
        if (std::isfinite(number))
            three.push_back(number);
    }
    return three.size() == 3 ? three : csa_of(set, "DiffusionGradientDirection");
}

void dicom_describe_mosaic(const gdcm::DataSet &set, dicom_image *image) {
    const std::string type = '\\' + dicom_text(set, 0x0008, 0x0008) + '\\';
    image->is_mosaic = image->frames == 1 && type.find("\\MOSAIC\\") != std::string::npos;
    if (!image->is_mosaic)
        return;
    const unsigned count = count_of_mosaic(set);
    const unsigned tiles = static_cast<unsigned>(std::ceil(std::sqrt(count)));
    if (count == 0 || image->columns % tiles != 0 || image->rows % tiles != 0)
        return;
    image->tiles = tiles;
    image->frames = count;
    image->columns /= tiles;
    image->rows /= tiles;
    if (csa_of(set, "SliceNormalVector").size() < 3)
        dicom_copy(image->note, sizeof image->note,
                   "The mosaic does not say in which direction its slices follow one another "
                   "(SliceNormalVector): they are shown along the normal.");
}

void dicom_place_tile(const gdcm::DataSet &set, const dicom_image &image, uint32_t index,
                      dicom_frame &frame) {
    const double(*a)[3] = frame.along;
    const std::vector<double> normal = csa_of(set, "SliceNormalVector");
    const double columns = image.columns * (image.tiles - 1.0),
                 rows = image.rows * (image.tiles - 1.0);
    double cosine = 0;
    for (size_t i = 0; i < 3; i++) {
        const size_t j = (i + 1) % 3, k = (i + 2) % 3;
        if (normal.size() >= 3)
            cosine += normal[i] * (a[0][j] * a[1][k] - a[0][k] * a[1][j]);
        /* The file gives the corner that the whole mosaic would have around the same centre. */
        frame.position[i] += a[0][i] * frame.spacing[0] * columns / 2;
        frame.position[i] += a[1][i] * frame.spacing[1] * rows / 2;
    }
    frame.is_assumed = frame.spacing[2] == 0;
    frame.spacing[2] = std::copysign(frame.is_assumed ? 1 : frame.spacing[2], cosine < 0 ? -1 : 1);
    dicom_move(&frame, index * frame.spacing[2]);
}
