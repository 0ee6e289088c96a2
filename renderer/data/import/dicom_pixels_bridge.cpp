// SPDX-License-Identifier: Apache-2.0
//
// Compressed pixels, frame by frame, and palettes.
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <memory>

#include <gdcmFile.h>
#include <gdcmImage.h>
#include <gdcmImageHelper.h>
#include <gdcmImageReader.h>
#include <gdcmReader.h>
#include <gdcmSequenceOfFragments.h>

#include "data/import/dicom_tags.h"
#include "data/import/exception.h"

namespace {

struct pixels {
    std::string path;
    gdcm::Reader reader;
    const gdcm::SequenceOfFragments *fragments = nullptr;
    std::vector<size_t> first; /* fragment of each frame, and their number; empty = not known */
    gdcm::PixelFormat format;
    gdcm::PhotometricInterpretation colors;
    unsigned columns = 0, rows = 0, frames = 0, planar = 0;
    std::vector<char> all; /* unpacked frames, where they cannot be unpacked one by one */
};

/* Places of the frames in bytes from the first fragment on, of 4 bytes each behind the fragments'
 * own head, or of 8 bytes each in an element of their own. Empty if there is no such table. */
std::vector<uint64_t> read_offsets(const pixels &p) {
    const gdcm::ByteValue *table = p.fragments->GetTable().GetByteValue();
    std::vector<uint64_t> offsets =
        dicom_values<uint64_t>(p.reader.GetFile().GetDataSet(), 0x7fe0, 0x0001);
    if (table && table->GetLength() == 4 * size_t{ p.frames }) {
        std::vector<uint32_t> narrow(p.frames);
        memcpy(narrow.data(), table->GetPointer(), 4 * size_t{ p.frames });
        offsets.assign(narrow.begin(), narrow.end());
    }
    return offsets.size() == p.frames ? offsets : std::vector<uint64_t>();
}

/* Lists the fragments of each frame: one each, or else by the table of their offsets, or else by
 * how the code of a frame begins. */
void list_frames(pixels &p) {
    const size_t count = p.fragments->GetNumberOfFragments();
    if (count == p.frames || p.frames == 1) {
        for (size_t i = 0; i < p.frames; i++)
            p.first.push_back(i);
        p.first.push_back(count);
        return;
    }
    const std::vector<uint64_t> offsets = read_offsets(p);
    uint64_t at = 0;
    for (size_t i = 0; i < count && p.first.size() <= p.frames; i++) {
        const gdcm::ByteValue *code = p.fragments->GetFragment(i).GetByteValue();
        const size_t next = p.first.size();
        if (offsets.empty() ? code && dicom_begins_frame(code->GetPointer(), code->GetLength())
                            : next < p.frames && at == offsets[next])
            p.first.push_back(i);
        at += 8 + p.fragments->GetFragment(i).GetVL();
    }
    if (p.first.size() == p.frames && p.first[0] == 0)
        p.first.push_back(count);
    else
        p.first.clear();
}

/* The bytes of a frame as they are packed. */
std::vector<uint8_t> code_of(const pixels &p, uint32_t frame) {
    std::vector<uint8_t> code;
    for (size_t i = p.first[frame]; i < p.first[frame + 1]; i++)
        if (const gdcm::ByteValue *part = p.fragments->GetFragment(i).GetByteValue())
            code.insert(code.end(), part->GetPointer(), part->GetPointer() + part->GetLength());
    return code;
}

bool unpack(const gdcm::Image &image, void *out, size_t size, sp_error *err) {
    if (image.GetBufferLength() != size)
        return dicom_explain(err, "the file has another number of pixels than its header says");
    return image.GetBuffer(static_cast<char *>(out)) ||
           dicom_explain(err, "the pixels cannot be unpacked: they are cut off or damaged");
}

/* A segment of RLE: runs of bytes (PS3.5, annex G.3.1). Returns how many bytes it has. */
size_t unpack_runs(const uint8_t *at, const uint8_t *end, uint8_t *out, size_t count, size_t step) {
    size_t done = 0;
    while (at < end && done < count) {
        const unsigned head = *at++;
        const bool is_run = head > 128;
        const size_t length = head == 128 ? 0 : is_run ? 257 - head : head + 1;
        for (size_t i = 0; i < length && done < count && at < end; i++, at += !is_run)
            out[step * done++] = *at;
        at += is_run && at < end;
    }
    return done;
}

/* Colours of several bytes in RLE, of which GDCM 3.0 mixes up the bytes: one segment for each byte
 * of each channel, the highest byte first. */
bool unpack_rle(const pixels &p, uint32_t frame, char *out, size_t size, sp_error *err) {
    enum { HEADER = 64, SEGMENTS_MAX = 15 };
    const std::vector<uint8_t> bytes = code_of(p, frame);
    const size_t channels = p.format.GetSamplesPerPixel(), wide = p.format.GetBitsAllocated() / 8;
    const size_t segments = channels * wide, count = size / segments;
    uint32_t at[SEGMENTS_MAX + 1];
    if (bytes.size() < HEADER || segments > SEGMENTS_MAX)
        return dicom_explain(err, "the pixels cannot be unpacked: they are cut off or damaged");
    memcpy(at, bytes.data(), HEADER); /* their number, then where each begins */
    for (size_t n = 0; n < segments; n++) {
        const size_t begin = at[n + 1], end = n + 1 < segments ? at[n + 2] : bytes.size();
        const size_t to = n / wide * wide + (wide - 1 - n % wide);
        if (at[0] != segments || begin > end || end > bytes.size() ||
            unpack_runs(bytes.data() + begin, bytes.data() + end,
                        reinterpret_cast<uint8_t *>(out) + to, count, segments) != count)
            return dicom_explain(err, "the pixels cannot be unpacked: they are cut off or damaged");
    }
    return true;
}

bool is_wide_rle(const pixels &p) {
    return p.format.GetSamplesPerPixel() > 1 && p.format.GetBitsAllocated() > 8 &&
           p.reader.GetFile().GetHeader().GetDataSetTransferSyntax() ==
               gdcm::TransferSyntax::RLELossless;
}

/* An image of one frame. */
bool unpack_frame(const pixels &p, uint32_t frame, void *out, size_t size, sp_error *err) {
    gdcm::SmartPointer<gdcm::SequenceOfFragments> own = new gdcm::SequenceOfFragments;
    for (size_t i = p.first[frame]; i < p.first[frame + 1]; i++)
        own->AddFragment(p.fragments->GetFragment(i));
    gdcm::DataElement element(gdcm::Tag(0x7fe0, 0x0010));
    element.SetVR(gdcm::VR::OB);
    element.SetValue(*own);
    gdcm::Image image;
    image.SetNumberOfDimensions(2);
    image.SetDimension(0, p.columns);
    image.SetDimension(1, p.rows);
    image.SetPixelFormat(p.format);
    image.SetPhotometricInterpretation(p.colors);
    image.SetPlanarConfiguration(0); /* the code says how it orders the channels, and GDCM knows */
    image.SetTransferSyntax(p.reader.GetFile().GetHeader().GetDataSetTransferSyntax());
    image.SetDataElement(element);
    return unpack(image, out, size, err);
}

/* Puts the channels of each pixel side by side. */
void interleave(const pixels &p, const char *planes, char *out) {
    const size_t count = size_t{ p.columns } * p.rows, bytes = p.format.GetBitsAllocated() / 8;
    const size_t channels = p.format.GetSamplesPerPixel();
    for (size_t channel = 0; channel < channels; channel++)
        for (size_t i = 0; i < count; i++, planes += bytes)
            memcpy(out + (i * channels + channel) * bytes, planes, bytes);
}

/* All frames at once, which are then kept. */
bool unpack_all(pixels &p, size_t size, sp_error *err) {
    gdcm::ImageReader reader;
    reader.SetFileName(p.path.c_str());
    if (!reader.Read())
        return dicom_explain(err,
                             "the pixels are damaged, or packed in a way that is not supported");
    if (p.fragments)
        reader.GetImage().SetPlanarConfiguration(0); /* as in unpack_frame() */
    std::vector<char> all(size * p.frames), frame(size);
    if (!unpack(reader.GetImage(), all.data(), all.size(), err))
        return false;
    for (size_t n = 0; n < p.frames && p.planar == 1 && !p.fragments; n++) {
        interleave(p, all.data() + n * size, frame.data());
        memcpy(all.data() + n * size, frame.data(), size);
    }
    p.all.swap(all);
    return true;
}

} // namespace

void *dicom_open_pixels(const char *path, dicom_image *image, sp_error *err) try {
    auto p = std::make_unique<pixels>();
    std::ifstream stream(path, std::ios::binary);
    p->path = path;
    p->reader.SetStream(stream);
    if (!p->reader.Read()) {
        dicom_explain(err, "the pixels are damaged, or packed in a way that is not supported");
        return nullptr;
    }
    const gdcm::File &file = p->reader.GetFile();
    const gdcm::Tag tag(0x7fe0, 0x0010);
    const std::vector<unsigned> dims = gdcm::ImageHelper::GetDimensionsValue(file);
    p->columns = dims[0];
    p->rows = dims[1];
    p->frames = dims.size() > 2 ? dims[2] : 1;
    p->format = gdcm::ImageHelper::GetPixelFormatValue(file);
    p->colors = gdcm::ImageHelper::GetPhotometricInterpretationValue(file);
    p->planar = gdcm::ImageHelper::GetPlanarConfigurationValue(file);
    if (file.GetDataSet().FindDataElement(tag))
        p->fragments = file.GetDataSet().GetDataElement(tag).GetSequenceOfFragments();
    if (p->fragments && p->frames > 0)
        list_frames(*p);
    if (!p->first.empty())
        dicom_check_colors(code_of(*p, 0), image);
    return p.release();
} catch (const std::exception &e) {
    import_fail_caught(err, e, dicom_explain);
    return nullptr;
}

bool dicom_read_frame(void *opened, uint32_t frame, void *out, size_t size, sp_error *err) try {
    pixels &p = *static_cast<pixels *>(opened);
    if (frame >= p.frames)
        return dicom_explain(err, "the file has fewer frames than its header says");
    if (!p.first.empty() && is_wide_rle(p))
        return unpack_rle(p, frame, static_cast<char *>(out), size, err);
    if (!p.first.empty())
        return unpack_frame(p, frame, out, size, err);
    if (p.all.empty() && !unpack_all(p, size, err))
        return false;
    if (p.all.size() < (frame + size_t{ 1 }) * size)
        return dicom_explain(err, "the file has fewer frames than its header says");
    memcpy(out, p.all.data() + frame * size, size);
    return true;
} catch (const std::exception &e) {
    return import_fail_caught(err, e, dicom_explain);
}

void dicom_close_pixels(void *opened) {
    delete static_cast<pixels *>(opened);
}

/* A table of the palette: 8 bits per colour of 16 bits or 8, also two to a word. */
static bool read_table(const gdcm::DataSet &set, uint16_t channel, dicom_palette *palette) {
    const std::vector<uint16_t> is = dicom_values<uint16_t>(set, 0x0028, 0x1101 + channel);
    const std::vector<uint8_t> bytes = dicom_values<uint8_t>(set, 0x0028, 0x1201 + channel);
    if (is.size() < 3 || bytes.empty())
        return false;
    const uint32_t count = is[0] ? is[0] : 65536;
    if (!palette->colors) {
        palette->first =
            dicom_value<uint16_t>(set, 0x0028, 0x0103) == 1 ? static_cast<int16_t>(is[1]) : is[1];
        palette->count = count;
        palette->colors = static_cast<uint8_t(*)[3]>(calloc(count, 3));
    }
    const bool is_wide = bytes.size() >= 2 * size_t{ count };
    if (!palette->colors || count != palette->count || bytes.size() < count)
        return false;
    for (uint32_t i = 0; i < count; i++) {
        const unsigned wide =
            is_wide ? static_cast<unsigned>(bytes[2 * i] | bytes[2 * i + 1] << 8) : bytes[i];
        palette->is_rounded |=
            is_wide && is[2] > 8 && (wide & 255) != 0 && (wide & 255) != wide >> 8;
        palette->colors[i][channel] = static_cast<uint8_t>(is_wide && is[2] > 8 ? wide >> 8 : wide);
    }
    return true;
}

bool dicom_read_palette(const char *path, dicom_palette *palette, sp_error *err) try {
    gdcm::Reader reader;
    std::ifstream stream(path, std::ios::binary);
    reader.SetStream(stream);
    *palette = dicom_palette();
    if (!reader.ReadUpToTag({ 0x7fe0, 0x0010 }, { { 0x7fe0, 0x0010 } }))
        return dicom_explain(err, "this is no DICOM file, or it is damaged");
    for (uint16_t channel = 0; channel < 3; channel++)
        if (!read_table(reader.GetFile().GetDataSet(), channel, palette)) {
            free(palette->colors);
            palette->colors = nullptr;
            return dicom_explain(
                err, "the palette is missing, cut off, or of a kind that is not supported");
        }
    return true;
} catch (const std::exception &e) {
    return import_fail_caught(err, e, dicom_explain);
}
