// SPDX-License-Identifier: Apache-2.0
//
// What orders the frames of a file: the dimensions by which it lists them, and tuples of numbers.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include <gdcmDict.h>
#include <gdcmDicts.h>
#include <gdcmGlobal.h>

#include "data/import/dicom_tags.h"

std::vector<dicom_dimension> dicom_dimensions(const gdcm::DataSet &file) {
    static const gdcm::Tag known[] = {
        { 0x0020, 0x0032 }, { 0x0020, 0x0037 }, { 0x0020, 0x9056 }, { 0x0020, 0x9057 },
        { 0x0020, 0x9128 }, { 0x0020, 0x9153 }, { 0x0020, 0x9252 }, { 0x0020, 0x9241 },
        { 0x0018, 0x9074 }, { 0x0018, 0x9151 }, { 0x0018, 0x9082 }, { 0x0018, 0x9087 },
        { 0x0018, 0x9089 }, { 0x0062, 0x000b }, { 0x0020, 0x930d }, { 0x0020, 0x9301 },
        { 0x0020, 0x9302 }, { 0x0018, 0x9808 }, { 0x0008, 0x9007 }, { 0x0008, 0x9208 },
        { 0x0048, 0x021e }, { 0x0048, 0x021f }, { 0x0040, 0x072a }, { 0x0040, 0x073a },
        { 0x0040, 0x074a },
    };
    std::vector<dicom_dimension> found;
    const auto items = dicom_sequence(file, 0x0020, 0x9222);
    for (size_t i = 1; items && i <= items->GetNumberOfItems(); i++) {
        const gdcm::DataSet &item = items->GetItem(i).GetNestedDataSet();
        const std::vector<uint16_t> pointer = dicom_values<uint16_t>(item, 0x0020, 0x9165);
        const std::vector<uint16_t> group = dicom_values<uint16_t>(item, 0x0020, 0x9167);
        if (pointer.size() < 2)
            continue;
        const gdcm::Tag tag(pointer[0], pointer[1]);
        if (std::find(std::begin(known), std::end(known), tag) != std::end(known))
            continue;
        const char *name =
            gdcm::Global::GetInstance().GetDicts().GetPublicDict().GetDictEntry(tag).GetName();
        const std::string label = dicom_text(item, 0x0020, 0x9421);
        found.push_back({ i - 1, tag,
                          group.size() < 2 ? gdcm::Tag(0, 0) : gdcm::Tag(group[0], group[1]),
                          !label.empty()  ? label
                          : name && *name ? name
                                          : "dimension" });
    }
    return found;
}

std::string dicom_dimension_value(const gdcm::DataSet &set, const dicom_dimension &is,
                                  uint32_t index) {
    const gdcm::VR vr =
        gdcm::Global::GetInstance().GetDicts().GetPublicDict().GetDictEntry(is.pointer).GetVR();
    const uint16_t group = is.pointer.GetGroup(), element = is.pointer.GetElement();
    double number = NAN;
    char text[40];
    if (vr == gdcm::VR::FD)
        number = dicom_value<double>(set, group, element);
    else if (vr == gdcm::VR::FL)
        number = dicom_value<float>(set, group, element);
    else if (vr == gdcm::VR::US)
        number = dicom_value<uint16_t>(set, group, element);
    else if (vr != gdcm::VR::INVALID && (vr & gdcm::VR::VRASCII)) {
        const std::string is_text = dicom_text(set, group, element);
        if (!is_text.empty())
            return is_text;
    }
    if (std::isfinite(number))
        snprintf(text, sizeof text, "%.6g", number);
    else
        snprintf(text, sizeof text, "%u", index);
    return text;
}

/* True if the tuple is one number that a double holds, which is the same in all files. */
static bool is_short(const dicom_tuple &tuple) {
    return tuple.size() <= 3 &&
           std::all_of(tuple.begin(), tuple.end(), [](uint32_t number) { return number < 65536; });
}

void dicom_number_tuples(const std::vector<dicom_tuple> &tuples, dicom_key key,
                         dicom_frame *frames) {
    const bool are_short = std::all_of(tuples.begin(), tuples.end(), is_short);
    std::vector<dicom_tuple> sorted;
    if (!are_short) {
        sorted = tuples;
        std::sort(sorted.begin(), sorted.end());
        sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
    }
    for (size_t i = 0; i < tuples.size(); i++) {
        double number = 0;
        for (uint32_t part : tuples[i])
            number = number * 65536 + part;
        if (!are_short)
            number = static_cast<double>(std::lower_bound(sorted.begin(), sorted.end(), tuples[i]) -
                                         sorted.begin());
        if (!tuples[i].empty())
            frames[i].keys[key] = number;
    }
}
