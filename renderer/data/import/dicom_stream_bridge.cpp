// SPDX-License-Identifier: Apache-2.0
//
// What the code of compressed pixels says of itself: where a frame begins, and how it holds
// colours.
#include <cstdio>

#include "data/import/dicom_tags.h"

namespace {

using bytes = std::vector<uint8_t>;

enum coded { CODED_UNKNOWN, CODED_RGB, CODED_YBR, CODED_TWICE };

bool has_start(const bytes &code, const char *start, size_t count) {
    return code.size() >= count && memcmp(code.data(), start, count) == 0;
}

/* The marker segments of a JPEG before its pixels (ITU-T T.81, annex B). `take` gets the number of
 * the marker and the bytes of its segment; it returns false where it has seen enough. */
template <typename Visitor> void for_segments(const bytes &code, Visitor visit) {
    size_t at = 2;
    while (at + 4 <= code.size() && code[at] == 0xff) {
        const uint8_t marker = code[at + 1];
        const size_t length = static_cast<size_t>(code[at + 2]) << 8 | code[at + 3];
        if (marker == 0xff) { /* a byte of padding */
            at++;
            continue;
        }
        if (length < 2 || at + 2 + length > code.size() ||
            !visit(marker, bytes(code.begin() + static_cast<long>(at) + 4,
                                 code.begin() + static_cast<long>(at + 2 + length))))
            return;
        at += 2 + length;
    }
}

bool is_frame_header(uint8_t marker) {
    const bool is_table = marker == 0xc4 || marker == 0xc8 || marker == 0xcc;
    return (marker >= 0xc0 && marker <= 0xcf && !is_table) || marker == 0xf7; /* JPEG-LS */
}

/* Names of components, then the mark of JFIF, then that of Adobe, which programs also write into
 * lossless code without a meaning. */
coded of_jpeg(const bytes &code) {
    coded by_jfif = CODED_UNKNOWN, by_adobe = CODED_UNKNOWN, by_names = CODED_UNKNOWN;
    for_segments(code, [&](uint8_t marker, const bytes &is) {
        enum { APP0 = 0xe0, APP14 = 0xee, PROGRESSIVE = 0xc2, TRANSFORM = 11, NAMES = 6, STEP = 3 };
        if (marker == APP0 && has_start(is, "JFIF", 5))
            by_jfif = CODED_YBR;
        if (marker == APP14 && has_start(is, "Adobe", 5) && is.size() > TRANSFORM)
            by_adobe = is[TRANSFORM] == 0 ? CODED_RGB : is[TRANSFORM] == 1 ? CODED_YBR : by_adobe;
        if (!is_frame_header(marker))
            return true;
        if (marker > PROGRESSIVE)
            by_adobe = CODED_UNKNOWN;
        if (is.size() > NAMES + 2 * STEP) {
            const char names[] = { static_cast<char>(is[NAMES]),
                                   static_cast<char>(is[NAMES + STEP]),
                                   static_cast<char>(is[NAMES + 2 * STEP]), 0 };
            if (!strcmp(names, "RGB") || !strcmp(names, "rgb"))
                by_names = CODED_RGB;
        }
        return false;
    });
    return by_names ? by_names : by_jfif ? by_jfif : by_adobe;
}

/* JPEG 2000: its own transformation of colours, which the decoder undoes (ITU-T T.800, A.6.1). */
coded of_jpeg2000(const bytes &code) {
    coded result = CODED_UNKNOWN;
    for_segments(code, [&](uint8_t marker, const bytes &is) {
        enum { COD = 0x52, TRANSFORM = 4 };
        if (marker == COD && is.size() > TRANSFORM && is[TRANSFORM] == 1)
            result = CODED_TWICE;
        return marker != COD;
    });
    return result;
}

} // namespace

bool dicom_begins_frame(const char *code, size_t size) {
    const bytes start(code, code + (size < 12 ? size : 12));
    return has_start(start, "\xff\xd8\xff", 3) || has_start(start, "\xff\x4f\xff\x51", 4) ||
           has_start(start, "\0\0\0\x0cjP  ", 8);
}

void dicom_check_colors(const std::vector<uint8_t> &code, dicom_image *image) {
    const bool is_ybr = image->colors == DICOM_YBR_FULL || image->colors == DICOM_YBR_422;
    const bool is_jpeg2000 = has_start(code, "\xff\x4f\xff\x51", 4);
    if (image->channels != 3 || image->bytes != 1 || image->is_signed ||
        !(is_ybr || image->colors == DICOM_RGB))
        return;
    const coded coded = is_jpeg2000                          ? of_jpeg2000(code)
                        : has_start(code, "\xff\xd8\xff", 3) ? of_jpeg(code)
                                                             : CODED_UNKNOWN;
    if (coded == CODED_TWICE && is_ybr)
        snprintf(image->note, sizeof image->note,
                 "The colours may be wrong: the header calls them %.20s, and their JPEG 2000 code "
                 "also converts them from RGB.",
                 image->color_name);
    if ((coded != CODED_RGB || !is_ybr) && (coded != CODED_YBR || is_ybr))
        return;
    image->colors = is_ybr ? DICOM_RGB : DICOM_YBR_FULL;
    snprintf(image->note, sizeof image->note,
             "The header calls the colours %.20s, their JPEG code %s: they are read as the code "
             "says.",
             image->color_name, is_ybr ? "RGB" : "YBR");
}
