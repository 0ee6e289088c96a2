// SPDX-License-Identifier: Apache-2.0
#include "data/import/dicom_bridge.h"

#include <cmath>
#include <cstdio>
#include <exception>
#include <fstream>

#include <gdcmReader.h>
#include <gdcmTrace.h>

#include "data/import/dicom_guard.h"
#include "data/import/dicom_tags.h"
#include "data/import/exception.h"

bool dicom_explain(sp_error *err, const char *text) {
    return sp_fail(err, SP_ERR_FORMAT, "", "%s", text);
}

static unsigned whole(double number, unsigned otherwise) {
    return number >= 0 && number <= 0xffffffffu ? static_cast<unsigned>(number) : otherwise;
}

static dicom_colors colors_of(const std::string &name, unsigned channels) {
    if (name == "PALETTE COLOR")
        return DICOM_PALETTE;
    if (channels < 3)
        return DICOM_GRAY;
    if (name == "YBR_FULL")
        return DICOM_YBR_FULL;
    if (name == "YBR_FULL_422")
        return DICOM_YBR_422;
    const bool is_rgb = name == "RGB" || name == "YBR_RCT" || name == "YBR_ICT";
    return is_rgb || name.empty() || name.rfind("MONOCHROME", 0) == 0 ? DICOM_RGB
                                                                      : DICOM_OTHER_COLORS;
}

static void describe_pixels(const gdcm::DataSet &set, dicom_image *image) {
    const unsigned allocated = whole(dicom_value<uint16_t>(set, 0x0028, 0x0100), 0);
    image->channels = whole(dicom_value<uint16_t>(set, 0x0028, 0x0002), 1);
    image->bytes = (allocated + 7) / 8;
    image->bits = whole(dicom_value<uint16_t>(set, 0x0028, 0x0101), allocated);
    image->high_bit = whole(dicom_value<uint16_t>(set, 0x0028, 0x0102), image->bits - 1);
    image->is_signed = dicom_value<uint16_t>(set, 0x0028, 0x0103) == 1;
    image->is_planar = image->channels > 1 && dicom_value<uint16_t>(set, 0x0028, 0x0006) == 1;
    image->is_bits = allocated == 1;
    dicom_copy(image->color_name, sizeof image->color_name, dicom_text(set, 0x0028, 0x0004));
    image->colors = colors_of(image->color_name, image->channels);
    image->is_labels = dicom_text(set, 0x0062, 0x0001) == "BINARY";
    image->has_labels = dicom_text(set, 0x0062, 0x0001) == "LABELMAP";
    if (image->has_labels)
        image->colors = DICOM_GRAY; /* a palette only proposes colours for the labels */
}

/* Frames of these kinds are a film, not a stack, unless each says where it lies. */
static bool is_film(const gdcm::DataSet &set) {
    const std::vector<uint16_t> pointers = dicom_values<uint16_t>(set, 0x0028, 0x0009);
    for (size_t i = 0; i + 1 < pointers.size(); i += 2)
        if (pointers[i] == 0x0018 && (pointers[i + 1] == 0x1063 || pointers[i + 1] == 0x1065))
            return true;
    const std::string modality = dicom_text(set, 0x0008, 0x0060);
    return modality == "XA" || modality == "RF" || modality == "US" || modality == "IVUS" ||
           modality == "ES";
}

static void describe_order(const gdcm::DataSet &set, dicom_image *image) {
    const double each = dicom_number(set, 0x0018, 0x1063) / 1000;
    const double rate = dicom_number(set, 0x0018, 0x0040);
    image->order = is_film(set) ? DICOM_ORDER_TIMES : DICOM_ORDER_PLACES;
    const double resolution = dicom_number(set, 0x0020, 0x0110) / 1000;
    image->frame_time = each > 0 ? each : rate > 0 ? 1 / rate : resolution > 0 ? resolution : 0;
}

/* The element with the pixels. The stream stands at its value, 8 bytes after its tag (or 12, with a
 * type). Fills where the value lies if the tag is there. */
static bool find_pixels(std::ifstream &stream, std::streamoff at, uint16_t element, bool is_big,
                        dicom_image *image) {
    for (int head : { 12, 8 }) {
        uint8_t bytes[12] = { 0 };
        stream.clear();
        if (at < head || !stream.seekg(at - head) ||
            !stream.read(reinterpret_cast<char *>(bytes), head))
            continue;
        const uint16_t low = bytes[is_big ? 1 : 0] | bytes[is_big ? 0 : 1] << 8;
        const uint16_t high = bytes[is_big ? 3 : 2] | bytes[is_big ? 2 : 3] << 8;
        if (low != 0x7fe0 || high != element)
            continue;
        uint32_t length = 0;
        for (int i = 0; i < 4; i++)
            length |= static_cast<uint32_t>(bytes[head - 4 + (is_big ? 3 - i : i)]) << 8 * i;
        image->has_words = is_big && head == 12 && bytes[4] == 'O' && bytes[5] == 'W';
        image->pixels_at = static_cast<uint64_t>(at);
        image->pixels_bytes = length;
        return true;
    }
    return false;
}

/* Reads the data set up to the pixels, which are samples, or numbers of 4 or 8 bytes. */
static bool read_header(const char *path, gdcm::Reader &reader, dicom_image *image) {
    static const uint16_t elements[] = { 0x0010, 0x0008, 0x0009 };
    const std::set<gdcm::Tag> skipped = { { 0x7fe0, 0x0008 },
                                          { 0x7fe0, 0x0009 },
                                          { 0x7fe0, 0x0010 } };
    std::ifstream stream(path, std::ios::binary);
    for (uint16_t element : elements) {
        stream.clear();
        stream.seekg(0);
        reader.SetStream(stream);
        bool ok = reader.ReadUpToTag({ 0x7fe0, element }, skipped);
        if (!ok && reader.GetFile().GetHeader().GetDataSetTransferSyntax() ==
                       gdcm::TransferSyntax::DeflatedExplicitVRLittleEndian) {
            stream.clear(); /* GDCM 3.0 cannot skip pixels there */
            stream.seekg(0);
            reader.SetStream(stream);
            ok = reader.Read();
        }
        if (!ok && element == 0x0010)
            return false;
        const gdcm::TransferSyntax &syntax =
            reader.GetFile().GetHeader().GetDataSetTransferSyntax();
        const bool is_big = syntax == gdcm::TransferSyntax::ExplicitVRBigEndian;
        const bool is_turned =
            is_big || syntax == gdcm::TransferSyntax::ImplicitVRBigEndianPrivateGE;
        const std::streamoff at = stream.tellg();
        image->is_packed = syntax.IsEncapsulated() ||
                           syntax == gdcm::TransferSyntax::DeflatedExplicitVRLittleEndian;
        image->is_swapped = is_turned;
        if (ok && find_pixels(stream, at, element, is_big, image)) {
            image->is_float = element != 0x0010;
            return true;
        }
        if (image->is_packed)
            return true;
    }
    return true;
}

/* Slides of a microscope, and segmentations of them. An image that is one whole tile is none. */
static void describe_tiles(const gdcm::DataSet &set, dicom_image *image) {
    static const char slides[] = "1.2.840.10008.5.1.4.1.1.77.1.6";
    image->tiled[0] = dicom_value<uint32_t>(set, 0x0048, 0x0006);
    image->tiled[1] = dicom_value<uint32_t>(set, 0x0048, 0x0007);
    const bool is_part = image->tiled[0] > image->columns || image->tiled[1] > image->rows;
    const bool is_slide = dicom_text(set, 0x0008, 0x0016) == slides ||
                          dicom_text(set, 0x0020, 0x9311).rfind("TILED_", 0) == 0;
    image->is_tiled = is_part || (is_slide && image->frames > 1);
    image->planes = image->is_tiled && !is_part && image->tiled[0] > 0 ? image->frames : 0;
}

/* True if the values of the real world are in a table. */
static bool has_world_table(const gdcm::DataSet &set) {
    const gdcm::DataSet all = dicom_item(set, 0x5200, 0x9229),
                        one = dicom_item(set, 0x5200, 0x9230);
    for (const gdcm::DataSet &part : { set, all, one }) {
        const gdcm::DataSet mapping = dicom_item(part, 0x0040, 0x9096);
        if (!dicom_values<double>(mapping, 0x0040, 0x9212).empty())
            return true;
    }
    return false;
}

/* The warning about the values or lengths of the file; "" = none. */
static const char *note_of(const gdcm::DataSet &set, const dicom_image &image) {
    const bool has_spacing =
        !dicom_text(set, 0x0028, 0x0030).empty() || !dicom_text(set, 0x0018, 0x2010).empty();
    if (!dicom_item(set, 0x0028, 0x3000).IsEmpty())
        return "The values are those of the file: its modality lookup table is not applied.";
    if (has_world_table(set))
        return "The values are not those of the real world, which the file has as a lookup table: "
               "it is not applied.";
    if (dicom_gap_of(set) == DICOM_ONLY_LOCATION)
        return "The file gives a SliceLocation, but no position (ImagePositionPatient): left, "
               "right, front and back are not known.";
    if (dicom_gap_of(set) == DICOM_NO_DIRECTIONS)
        return "The file does not give the directions of its pixels (ImageOrientationPatient): "
               "they are shown as axial.";
    if (dicom_text(set, 0x0028, 0x0004) == "MONOCHROME1")
        return "The file shows low values bright (MONOCHROME1); the values are those of the file.";
    if (!has_spacing && image.first.spacing[0] > 0 && !dicom_text(set, 0x0018, 0x1164).empty())
        return "Lengths are those on the detector (ImagerPixelSpacing): in the body they are "
               "smaller.";
    if (image.first.has_regions)
        return "The image has regions of several scales or units: the spacing is that of the first "
               "one in cm, and lengths in others are wrong.";
    return "";
}

static bool describe(const char *path, dicom_image *image, sp_error *err) try {
    gdcm::Trace::WarningOff();
    gdcm::Trace::ErrorOff();
    gdcm::Reader reader;
    *image = dicom_image();
    if (dicom_refuse_syntax(path, err))
        return false;
    if (!read_header(path, reader, image))
        return dicom_explain(err, "this is no DICOM file, or it is damaged");
    const gdcm::DataSet &set = reader.GetFile().GetDataSet();
    dicom_copy(image->series, sizeof image->series, dicom_text(set, 0x0020, 0x000e));
    dicom_copy(image->patient, sizeof image->patient, dicom_text(set, 0x0010, 0x0020));
    dicom_copy(image->space, sizeof image->space, dicom_text(set, 0x0020, 0x0052));
    dicom_copy(image->modality, sizeof image->modality, dicom_text(set, 0x0008, 0x0060));
    dicom_copy(image->description, sizeof image->description,
               dicom_words(set, dicom_text(set, 0x0008, 0x103e)));
    dicom_copy(image->id, sizeof image->id, dicom_text(set, 0x0008, 0x0018));
    const double number = dicom_number(set, 0x0020, 0x0011);
    image->has_number = std::fabs(number) <= 0x7fffffff;
    image->number = image->has_number ? static_cast<long>(number) : 0;
    image->is_directory =
        dicom_text(reader.GetFile().GetHeader(), 0x0002, 0x0002) == "1.2.840.10008.1.3.10";
    image->columns = whole(dicom_value<uint16_t>(set, 0x0028, 0x0011), 0);
    image->rows = whole(dicom_value<uint16_t>(set, 0x0028, 0x0010), 0);
    if (image->columns == 0 || image->rows == 0) {
        image->columns = 0;
        image->has_empty_image = image->pixels_at > 0;
        return true;
    }
    const double frames = dicom_number(set, 0x0028, 0x0008);
    image->frames = frames >= 1 && frames <= 0xffffffffu ? static_cast<uint32_t>(frames) : 1;
    describe_pixels(set, image);
    describe_order(set, image);
    describe_tiles(set, image);
    dicom_describe_mosaic(set, image);
    dicom_fill_frames(set, *image, &image->first, 1);
    if (!image->note[0])
        dicom_copy(image->note, sizeof image->note, note_of(set, *image));
    const gdcm::DataSet all = dicom_item(set, 0x5200, 0x9229),
                        one = dicom_item(set, 0x5200, 0x9230);
    image->is_in_patient = dicom_gap_of(set) != DICOM_ONLY_LOCATION &&
                           dicom_item(all, 0x0020, 0x930e).IsEmpty() &&
                           dicom_item(one, 0x0020, 0x930e).IsEmpty();
    image->has_places = image->first.is_placed && !image->first.segment && !image->has_labels &&
                        !image->is_tiled &&
                        (image->tiles > 0 || !dicom_item(one, 0x0020, 0x9113).IsEmpty());
    return true;
} catch (const std::exception &e) {
    return import_fail_caught(err, e, dicom_explain);
}

static bool describe_frames(const char *path, dicom_frame *frames, uint32_t count,
                            sp_error *err) try {
    gdcm::Reader reader;
    dicom_image image = dicom_image();
    if (!read_header(path, reader, &image))
        return dicom_explain(err, "this is no DICOM file, or it is damaged");
    const gdcm::DataSet &set = reader.GetFile().GetDataSet();
    image.frames = 1;
    image.columns = whole(dicom_value<uint16_t>(set, 0x0028, 0x0011), 0);
    image.rows = whole(dicom_value<uint16_t>(set, 0x0028, 0x0010), 0);
    describe_pixels(set, &image);
    describe_order(set, &image);
    dicom_describe_mosaic(set, &image);
    image.frames = count;
    dicom_fill_frames(set, image, frames, count);
    return true;
} catch (const std::exception &e) {
    return import_fail_caught(err, e, dicom_explain);
}

static bool guarded_describe(const char *path, dicom_image *image, sp_error *err) {
    return dicom_guard([=] { return describe(path, image, err); }, err);
}

static bool guarded_frames(const char *path, dicom_frame *frames, uint32_t count, sp_error *err) {
    return dicom_guard([=] { return describe_frames(path, frames, count, err); }, err);
}

static void *guarded_open(const char *path, dicom_image *image, sp_error *err) {
    void *pixels = nullptr;
    dicom_guard([&] { return (pixels = dicom_open_pixels(path, image, err)) != nullptr; }, err);
    return pixels;
}

static bool guarded_read(void *pixels, uint32_t frame, void *out, size_t size, sp_error *err) {
    return dicom_guard([=] { return dicom_read_frame(pixels, frame, out, size, err); }, err);
}

static bool guarded_palette(const char *path, dicom_palette *palette, sp_error *err) {
    return dicom_guard([=] { return dicom_read_palette(path, palette, err); }, err);
}

extern "C" __attribute__((visibility("default")))
const dicom_bridge_functions splat_dicom_bridge = { guarded_describe,   guarded_frames,
                                                    guarded_open,       guarded_read,
                                                    dicom_close_pixels, guarded_palette };
