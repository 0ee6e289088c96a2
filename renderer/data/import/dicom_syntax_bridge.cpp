// SPDX-License-Identifier: Apache-2.0
//
// Transfer syntaxes that GDCM does not read, by name. GDCM calls such files damaged, or no DICOM.
#include <cstdio>
#include <fstream>

#include <gdcmTransferSyntax.h>

#include "data/import/dicom_tags.h"

namespace {

const char with_pydicom[] = "decompress it, for example with pydicom";
const char as_film[] = "export its frames as images, for example with ffmpeg";
const char with_writer[] = "export it without compression from its program";

const struct {
    const char *uid, *name, *remedy; /* of the UID, and of those that extend it */
} refused[] = {
    { "1.2.840.10008.1.2.4.201", "HTJ2K (lossless)", with_pydicom },
    { "1.2.840.10008.1.2.4.202", "HTJ2K (lossless, RPCL)", with_pydicom },
    { "1.2.840.10008.1.2.4.203", "HTJ2K", with_pydicom },
    { "1.2.840.10008.1.2.4.110", "JPEG XL (lossless)", with_writer },
    { "1.2.840.10008.1.2.4.111", "JPEG XL (from JPEG)", with_writer },
    { "1.2.840.10008.1.2.4.112", "JPEG XL", with_writer },
    { "1.2.840.10008.1.2.4.92", "JPEG 2000 part 2 (lossless)", with_writer },
    { "1.2.840.10008.1.2.4.93", "JPEG 2000 part 2", with_writer },
    { "1.2.840.10008.1.2.4.94", "JPIP, whose pixels are on a server", with_writer },
    { "1.2.840.10008.1.2.4.95", "JPIP, whose pixels are on a server", with_writer },
    { "1.2.840.10008.1.2.4.204", "JPIP, whose pixels are on a server", with_writer },
    { "1.2.840.10008.1.2.4.205", "JPIP, whose pixels are on a server", with_writer },
    { "1.2.840.10008.1.2.4.100", "a film as MPEG-2", as_film },
    { "1.2.840.10008.1.2.4.101", "a film as MPEG-2", as_film },
    { "1.2.840.10008.1.2.4.102", "a film as MPEG-4", as_film },
    { "1.2.840.10008.1.2.4.103", "a film as MPEG-4", as_film },
    { "1.2.840.10008.1.2.4.104", "a film as MPEG-4", as_film },
    { "1.2.840.10008.1.2.4.105", "a film as MPEG-4", as_film },
    { "1.2.840.10008.1.2.4.106", "a film as MPEG-4", as_film },
    { "1.2.840.10008.1.2.4.107", "a film as HEVC", as_film },
    { "1.2.840.10008.1.2.4.108", "a film as HEVC", as_film },
    { "1.2.840.10008.1.2.7", "a film of SMPTE ST 2110", as_film },
    { "1.2.840.10008.1.2.8.1", "Deflated Image Frame Compression", with_pydicom },
};

/* The value of TransferSyntaxUID; "" if the file has no preamble or no such element. The group is
 * little endian with types (PS3.10, 7.1). */
std::string read_syntax(const char *path) {
    enum { PREAMBLE = 128, ELEMENTS_MAX = 64, UID_MAX = 64 };
    std::ifstream stream(path, std::ios::binary);
    char mark[4] = "", head[8];
    if (!stream.seekg(PREAMBLE) || !stream.read(mark, 4) || memcmp(mark, "DICM", 4) != 0)
        return "";
    for (int i = 0; i < ELEMENTS_MAX && stream.read(head, sizeof head); i++) {
        uint16_t group, element, narrow;
        uint32_t length;
        memcpy(&group, head, 2);
        memcpy(&element, head + 2, 2);
        memcpy(&narrow, head + 6, 2);
        length = narrow;
        if ((!memcmp(head + 4, "OB", 2) || !memcmp(head + 4, "UN", 2)) &&
            !stream.read(reinterpret_cast<char *>(&length), 4))
            return "";
        if (group != 2 || (element == 0x0010 && length > UID_MAX))
            return "";
        if (element != 0x0010) {
            stream.seekg(length, std::ios::cur);
            continue;
        }
        std::string uid(length, '\0');
        stream.read(&uid[0], length);
        return uid.substr(0, uid.find_last_not_of(std::string(" \0", 2)) + 1);
    }
    return "";
}

} // namespace

bool dicom_refuse_syntax(const char *path, sp_error *err) {
    const std::string uid = read_syntax(path);
    for (const auto &one : refused) {
        if (uid != one.uid && uid.rfind(one.uid + std::string("."), 0) != 0)
            continue;
        sp_fail(err, SP_ERR_UNSUPPORTED, "", "%s is not supported; %s", one.name, one.remedy);
        return true;
    }
    if (uid.empty() || uid.find_first_not_of("0123456789.") != std::string::npos ||
        gdcm::TransferSyntax::GetTSType(uid.c_str()) != gdcm::TransferSyntax::TS_END)
        return false;
    sp_fail(err, SP_ERR_UNSUPPORTED, "", "the transfer syntax %.64s is not known; %s", uid.c_str(),
            with_writer);
    return true;
}
