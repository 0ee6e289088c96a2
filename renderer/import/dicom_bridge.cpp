// SPDX-License-Identifier: Apache-2.0
#include "import/dicom_bridge.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <fstream>
#include <string>
#include <vector>

#include <gdcmImageChangePlanarConfiguration.h>
#include <gdcmImageHelper.h>
#include <gdcmImageReader.h>
#include <gdcmReader.h>
#include <gdcmTrace.h>

static void explain(char *why, size_t capacity, const char *text) {
    snprintf(why, capacity, "%s", text);
}

/* The text of an element, without the blanks around it; "" if there is none. */
static std::string text_of(const gdcm::DataSet &set, uint16_t group, uint16_t element) {
    const gdcm::Tag tag(group, element);
    if (!set.FindDataElement(tag))
        return "";
    const gdcm::ByteValue *value = set.GetDataElement(tag).GetByteValue();
    if (!value)
        return "";
    std::string text(value->GetPointer(), value->GetLength());
    const size_t end = text.find_last_not_of(std::string(" \0", 2));
    const size_t begin = text.find_first_not_of(' ');
    return end == std::string::npos ? "" : text.substr(begin, end + 1 - begin);
}

template <size_t n> static void copy_text(char (&out)[n], const std::string &text) {
    snprintf(out, n, "%s", text.c_str());
}

static void describe_pixels(const gdcm::File &file, dicom_image *image) {
    const gdcm::PixelFormat format = gdcm::ImageHelper::GetPixelFormatValue(file);
    const gdcm::PhotometricInterpretation colors =
        gdcm::ImageHelper::GetPhotometricInterpretationValue(file);
    const gdcm::PixelFormat::ScalarType type = format.GetScalarType();
    image->channels = format.GetSamplesPerPixel();
    image->bits = format.GetBitsStored();
    image->bytes = format.GetBitsAllocated() == 12 ? 2 : (format.GetBitsAllocated() + 7u) / 8;
    image->is_signed = format.GetPixelRepresentation() != 0;
    image->is_float = type == gdcm::PixelFormat::FLOAT32 || type == gdcm::PixelFormat::FLOAT64;
    image->is_palette = colors == gdcm::PhotometricInterpretation::PALETTE_COLOR;
    image->is_other_color = image->channels > 1 && colors != gdcm::PhotometricInterpretation::RGB;
}

static void describe_place(const gdcm::File &file, const gdcm::DataSet &set, dicom_image *image) {
    const std::vector<double> spacing = gdcm::ImageHelper::GetSpacingValue(file);
    const std::vector<double> position = gdcm::ImageHelper::GetOriginValue(file);
    const std::vector<double> along = gdcm::ImageHelper::GetDirectionCosinesValue(file);
    for (size_t i = 0; i < 3 && i < spacing.size(); i++)
        image->first.spacing[i] = spacing[i];
    for (size_t i = 0; i < 3 && i < position.size(); i++)
        image->first.position[i] = position[i];
    for (size_t i = 0; i < 6 && i < along.size(); i++)
        image->first.along[i / 3][i % 3] = along[i];
    /* GDCM gives default values where the file has none. */
    const bool has_frames = set.FindDataElement(gdcm::Tag(0x5200, 0x9229)) ||
                            set.FindDataElement(gdcm::Tag(0x5200, 0x9230));
    image->first.is_placed = has_frames || (!text_of(set, 0x0020, 0x0032).empty() &&
                                            !text_of(set, 0x0020, 0x0037).empty());
    if (image->frames > 1)
        return;
    const std::string between = text_of(set, 0x0018, 0x0088), thick = text_of(set, 0x0018, 0x0050);
    image->first.spacing[2] = atof(!between.empty() ? between.c_str() : thick.c_str());
}

static bool describe(const char *path, dicom_image *image, char *why, size_t capacity) try {
    gdcm::Trace::WarningOff();
    gdcm::Trace::ErrorOff();
    const gdcm::Tag pixels(0x7fe0, 0x0010);
    std::ifstream stream(path, std::ios::binary);
    gdcm::Reader reader;
    reader.SetStream(stream);
    *image = dicom_image();
    if (!reader.ReadUpToTag(pixels, { pixels })) {
        explain(why, capacity, "this is no DICOM file, or it is damaged");
        return false;
    }
    const gdcm::File &file = reader.GetFile();
    const gdcm::DataSet &set = file.GetDataSet();
    copy_text(image->series, text_of(set, 0x0020, 0x000e));
    copy_text(image->modality, text_of(set, 0x0008, 0x0060));
    copy_text(image->rescale_type, text_of(set, 0x0028, 0x1054));
    copy_text(image->description, text_of(set, 0x0008, 0x103e));
    image->first.instance = atol(text_of(set, 0x0020, 0x0013).c_str());
    const std::vector<unsigned> dims = gdcm::ImageHelper::GetDimensionsValue(file);
    if (dims.size() < 2 || dims[0] == 0 || dims[1] == 0) {
        explain(why, capacity, "the file has no image");
        return false;
    }
    image->columns = dims[0];
    image->rows = dims[1];
    image->frames = dims.size() > 2 ? dims[2] : 1;
    const std::vector<double> rescale = gdcm::ImageHelper::GetRescaleInterceptSlopeValue(file);
    image->first.intercept = rescale.size() > 1 ? rescale[0] : 0;
    image->first.slope = rescale.size() > 1 ? rescale[1] : 1;
    image->is_packed = file.GetHeader().GetDataSetTransferSyntax().IsEncapsulated() ||
                       gdcm::ImageHelper::GetPixelFormatValue(file).GetBitsAllocated() % 8 != 0;
    const std::streamoff at = stream.tellg(); /* where the pixels begin, which were skipped */
    image->pixels_at = at > 0 ? static_cast<uint64_t>(at) : 0;
    describe_pixels(file, image);
    describe_place(file, set, image);
    for (double &key : image->first.keys)
        key = NAN;
    return true;
} catch (const std::exception &e) {
    explain(why, capacity, e.what());
    return false;
}

static bool read(const char *path, void *out, size_t size, char *why, size_t capacity) try {
    gdcm::ImageReader reader;
    reader.SetFileName(path);
    if (!reader.Read()) {
        explain(why, capacity, "the pixels are damaged, or packed in a way that is not supported");
        return false;
    }
    const gdcm::Image *image = &reader.GetImage();
    gdcm::ImageChangePlanarConfiguration alternate;
    if (image->GetPlanarConfiguration() == 1) {
        alternate.SetInput(*image);
        alternate.SetPlanarConfiguration(0);
        if (alternate.Change())
            image = &alternate.GetOutput();
    }
    if (image->GetBufferLength() != size) {
        explain(why, capacity, "the file has another number of pixels than its header says");
        return false;
    }
    if (!image->GetBuffer(static_cast<char *>(out))) {
        explain(why, capacity, "the pixels cannot be unpacked: they are cut off or damaged");
        return false;
    }
    return true;
} catch (const std::exception &e) {
    explain(why, capacity, e.what());
    return false;
}

extern "C" __attribute__((visibility("default")))
const dicom_bridge_functions splat_dicom_bridge = { describe, read };
