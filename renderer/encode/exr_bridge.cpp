/* SPDX-License-Identifier: Apache-2.0 */
#include "encode/exr_bridge.h"

#include <cstdio>
#include <memory>
#include <new>
#include <string>
#include <vector>

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

namespace {

OIIO::ImageSpec describe(const sp_exr_image &image) {
    OIIO::ImageSpec spec(static_cast<int>(image.width), static_cast<int>(image.height), 4,
                         OIIO::TypeDesc::FLOAT);
    spec.attribute("compression", "zip");
    /* The values are display values; readers must not apply a transfer curve again. */
    spec.attribute("oiio:ColorSpace", "sRGB");
    /* A fixed time: the library would write the current time, and equal frames must give equal
     * files. */
    spec.attribute("DateTime", "1970:01:01 00:00:00");
    spec.attribute("ImageDescription", "sRGB display values, associated alpha");
    spec.attribute("Software", "splatd " SPLATD_VERSION);
    return spec;
}

std::string write(const sp_exr_image &image, std::vector<unsigned char> &file) {
    OIIO::Filesystem::IOVecOutput memory(file);
    const char *const name = "image.exr";
    std::unique_ptr<OIIO::ImageOutput> output = OIIO::ImageOutput::create(name);
    if (!output)
        return OIIO::geterror();
    if (!output->supports("ioproxy") || !output->set_ioproxy(&memory))
        return "this version of OpenImageIO cannot write OpenEXR files to memory";
    OIIO::ImageSpec spec = describe(image);
    if (!output->open(name, spec) ||
        !output->write_image(spec.format, image.pixels, OIIO::AutoStride,
                             static_cast<OIIO::stride_t>(image.stride)) ||
        !output->close())
        return output->geterror();
    return file.empty() ? "nothing was written" : std::string();
}

} // namespace

sp_exr_status splat_exr_encode(const sp_exr_image *image, sp_exr_sink *sink, void *user,
                               char *error, size_t error_size) {
    try {
        /* Encode on the calling thread: the thread pools of the library would compete with the
         * threads of the renderer. */
        static const bool alone =
            OIIO::attribute("threads", 1) && OIIO::attribute("exr_threads", -1);
        (void)alone;
        std::vector<unsigned char> file;
        /* Noise takes all of it. A vector that grows would take three times as much. */
        file.reserve(static_cast<std::size_t>(image->width) * image->height * 16 + (1 << 16));
        std::string why = write(*image, file);
        if (!why.empty()) {
            std::snprintf(error, error_size, "%s", why.c_str());
            return SP_EXR_FAILED;
        }
        return sink(user, file.data(), file.size()) ? SP_EXR_DONE : SP_EXR_MEMORY;
    } catch (const std::bad_alloc &) {
        std::snprintf(error, error_size, "out of memory");
        return SP_EXR_MEMORY;
    } catch (const std::exception &e) {
        std::snprintf(error, error_size, "%s", e.what());
    } catch (...) {
        std::snprintf(error, error_size, "unknown exception");
    }
    return SP_EXR_FAILED;
}
