// SPDX-License-Identifier: Apache-2.0
//
// Texts in the character sets of DICOM (PS3.3, C.12.1.1.2), by iconv of the C library.
#include <algorithm>
#include <cerrno>

#include <iconv.h>

#include "data/import/dicom_tags.h"

namespace {

struct encoding {
    const char *name, *of_iconv;
    bool is_kept; /* iconv needs the escape sequence itself */
};

/* Names as SpecificCharacterSet has them; "ISO 2022 IR n" is the same as "ISO_IR n". Latin 1 is not
 * here: dicom_copy() takes it for what is not UTF-8, since many files with UTF-8 say Latin 1. */
const encoding sets[] = {
    { "ISO_IR 101", "ISO-8859-2", false },
    { "ISO_IR 109", "ISO-8859-3", false },
    { "ISO_IR 110", "ISO-8859-4", false },
    { "ISO_IR 144", "ISO-8859-5", false },
    { "ISO_IR 127", "ISO-8859-6", false },
    { "ISO_IR 126", "ISO-8859-7", false },
    { "ISO_IR 138", "ISO-8859-8", false },
    { "ISO_IR 148", "ISO-8859-9", false },
    { "ISO_IR 203", "ISO-8859-15", false },
    { "ISO_IR 13", "SHIFT_JIS", false },
    { "ISO_IR 166", "TIS-620", false },
    { "GB18030", "GB18030", false },
    { "GBK", "GBK", false },
};

/* What follows the escape character. Shift JIS has the characters of JIS X 0201 in their places. */
const encoding escapes[] = {
    { "$B", "ISO-2022-JP-2", true },  { "$@", "ISO-2022-JP-2", true },
    { "$(D", "ISO-2022-JP-2", true }, { "(J", "SHIFT_JIS", false },
    { ")I", "SHIFT_JIS", false },     { "$)C", "EUC-KR", false },
    { "$)A", "EUC-CN", false },       { "-A", "ISO-8859-1", false },
    { "-B", "ISO-8859-2", false },    { "-C", "ISO-8859-3", false },
    { "-D", "ISO-8859-4", false },    { "-L", "ISO-8859-5", false },
    { "-G", "ISO-8859-6", false },    { "-F", "ISO-8859-7", false },
    { "-H", "ISO-8859-8", false },    { "-M", "ISO-8859-9", false },
    { "-b", "ISO-8859-15", false },   { "-T", "TIS-620", false },
};

const char ESCAPE = '\x1b';

/* Appends a text as UTF-8. False if it is not in this encoding, or iconv does not know that. */
bool append(const std::string &text, const char *encoding, std::string *out) {
    std::string from = text;
    char *at = &from[0], buffer[256];
    size_t left = from.size();
    const iconv_t with = iconv_open("UTF-8", encoding);
    if (with == iconv_t(-1))
        return false;
    bool ok = true;
    while (ok && left > 0) {
        char *to = buffer;
        size_t free = sizeof buffer;
        const size_t before = left;
        ok = iconv(with, &at, &left, &to, &free) != size_t(-1) || (left < before && errno == E2BIG);
        out->append(buffer, to);
    }
    iconv_close(with);
    return ok;
}

/* The first of the sets of the file; null = ASCII, UTF-8 or Latin 1. */
const char *first_encoding(const gdcm::DataSet &file) {
    const std::string all = dicom_text(file, 0x0008, 0x0005), iso = "ISO 2022 IR ";
    std::string name = all.substr(0, all.find('\\'));
    name.erase(name.find_last_not_of(' ') + 1);
    if (name.rfind(iso, 0) == 0)
        name = "ISO_IR " + name.substr(iso.size());
    for (const encoding &one : sets)
        if (name == one.name)
            return one.of_iconv;
    return nullptr;
}

/* A part of a text up to the next escape. */
bool append_part(const std::string &part, const char *first, std::string *out) {
    if (part[0] != ESCAPE)
        return first ? append(part, first, out) : (*out += part, true);
    for (const encoding &one : escapes) {
        const size_t size = strlen(one.name);
        if (part.compare(1, size, one.name) == 0)
            return append(one.is_kept ? part : part.substr(1 + size), one.of_iconv, out);
    }
    const size_t ascii = 3; /* ESC ( B: back to the first set */
    return part.compare(1, 2, "(B") == 0 &&
           (part.size() == ascii || append_part(part.substr(ascii), first, out));
}

} // namespace

std::string dicom_words(const gdcm::DataSet &file, const std::string &text) {
    const char *first = first_encoding(file);
    std::string result;
    for (size_t at = 0, next; at < text.size(); at = next) {
        next = std::min(text.find(ESCAPE, at + 1), text.size());
        if (!append_part(text.substr(at, next - at), first, &result))
            return text;
    }
    return result;
}
