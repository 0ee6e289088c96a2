// SPDX-License-Identifier: Apache-2.0
#include "data/import/dicom_tags.h"

#include <cmath>
#include <cstdlib>

std::string dicom_text(const gdcm::DataSet &set, uint16_t group, uint16_t element) {
    const gdcm::Tag tag(group, element);
    if (!set.FindDataElement(tag))
        return "";
    const gdcm::ByteValue *value = set.GetDataElement(tag).GetByteValue();
    if (!value)
        return "";
    const std::string text(value->GetPointer(), value->GetLength());
    const size_t end = text.find_last_not_of(std::string(" \0", 2));
    const size_t begin = text.find_first_not_of(' ');
    return end == std::string::npos ? "" : text.substr(begin, end + 1 - begin);
}

std::vector<double> dicom_numbers(const gdcm::DataSet &set, uint16_t group, uint16_t element) {
    const std::string text = dicom_text(set, group, element);
    std::vector<double> numbers;
    const char *at = text.c_str();
    while (*at) {
        char *end;
        const double number = strtod(at, &end);
        if (end == at)
            break;
        numbers.push_back(number);
        while (*end == ' ')
            end++;
        at = *end == '\\' ? end + 1 : "";
    }
    return numbers;
}

double dicom_number(const gdcm::DataSet &set, uint16_t group, uint16_t element) {
    const std::vector<double> numbers = dicom_numbers(set, group, element);
    return numbers.empty() ? NAN : numbers[0];
}

gdcm::SmartPointer<gdcm::SequenceOfItems> dicom_sequence(const gdcm::DataSet &set, uint16_t group,
                                                         uint16_t element) {
    const gdcm::Tag tag(group, element);
    return set.FindDataElement(tag) ? set.GetDataElement(tag).GetValueAsSQ() : nullptr;
}

gdcm::DataSet dicom_item(const gdcm::DataSet &set, uint16_t group, uint16_t element,
                         size_t number) {
    const gdcm::SmartPointer<gdcm::SequenceOfItems> items = dicom_sequence(set, group, element);
    if (!items || number < 1 || number > items->GetNumberOfItems())
        return gdcm::DataSet();
    return items->GetItem(number).GetNestedDataSet();
}

static bool is_utf8(const std::string &text) {
    for (size_t i = 0; i < text.size(); i++) {
        const unsigned char c = static_cast<unsigned char>(text[i]);
        const size_t more = c < 0x80                ? 0
                            : c >= 0xc2 && c < 0xe0 ? 1
                            : c >= 0xe0 && c < 0xf0 ? 2
                            : c >= 0xf0 && c < 0xf5 ? 3
                                                    : text.size();
        if (more >= text.size() - i)
            return false;
        for (size_t end = i + more; i < end;)
            if ((static_cast<unsigned char>(text[++i]) & 0xc0) != 0x80)
                return false;
    }
    return true;
}

static std::string utf8_of_latin(const std::string &text) {
    std::string result;
    for (const char one : text) {
        const unsigned char c = static_cast<unsigned char>(one);
        if (c < 0x80)
            result += one;
        else
            (result += static_cast<char>(0xc0 | c >> 6)) += static_cast<char>(0x80 | (c & 0x3f));
    }
    return result;
}

void dicom_copy(char *out, size_t capacity, const std::string &any) {
    const std::string text = is_utf8(any) ? any : utf8_of_latin(any);
    size_t size = text.size();
    if (size >= capacity)
        for (size = capacity - 1; size > 0 && (static_cast<uint8_t>(text[size]) & 0xc0) == 0x80;)
            size--;
    memcpy(out, text.data(), size);
    out[size] = 0;
}
