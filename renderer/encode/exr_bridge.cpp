/* SPDX-License-Identifier: Apache-2.0 */
#include "encode/exr_bridge.h"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <memory>
#include <new>
#include <string>
#include <vector>

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

namespace {

/* R, G, B, A, and with depth Z and Z.spread. */
int count_channels(const sp_exr_image &image) {
    return image.depth ? 6 : 4;
}

OIIO::ImageSpec describe(const sp_exr_image &image) {
    OIIO::ImageSpec spec(static_cast<int>(image.width), static_cast<int>(image.height),
                         count_channels(image), OIIO::TypeDesc::FLOAT);
    if (image.depth) {
        spec.channelnames = { "R", "G", "B", "A", "Z", "Z.spread" };
        spec.alpha_channel = 3;
        spec.z_channel = 4;
    }
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

/* Copies row y of a plane of floats to a channel. */
void copy_channel(const float *plane, const sp_exr_image &image, std::size_t y, float *channel) {
    const char *row = reinterpret_cast<const char *>(plane) + y * image.depth_stride;
    for (std::size_t x = 0; x < image.width; x++)
        std::memcpy(channel + 6 * x, row + x * sizeof(float), sizeof(float));
}

/* Writes the rows of an image with depth: a few at a time, because they are copied. */
bool write_rows(OIIO::ImageOutput &output, const sp_exr_image &image) {
    const std::size_t rows = 16, floats = std::size_t(image.width) * 6;
    std::vector<float> lines(rows * floats);
    for (std::size_t begin = 0; begin < image.height; begin += rows) {
        const std::size_t end = std::min<std::size_t>(begin + rows, image.height);
        for (std::size_t y = begin; y < end; y++) {
            const char *from = static_cast<const char *>(image.pixels) + y * image.stride;
            float *to = lines.data() + (y - begin) * floats;
            for (std::size_t x = 0; x < image.width; x++)
                std::memcpy(to + 6 * x, from + x * 16, 16);
            copy_channel(image.depth, image, y, to + 4);
            copy_channel(image.spread, image, y, to + 5);
        }
        if (!output.write_scanlines(static_cast<int>(begin), static_cast<int>(end), 0,
                                    OIIO::TypeDesc::FLOAT, lines.data()))
            return false;
    }
    return true;
}

bool write_pixels(OIIO::ImageOutput &output, const sp_exr_image &image) {
    if (image.depth)
        return write_rows(output, image);
    return output.write_image(OIIO::TypeDesc::FLOAT, image.pixels, OIIO::AutoStride,
                              static_cast<OIIO::stride_t>(image.stride));
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
    if (!output->open(name, spec) || !write_pixels(*output, image) || !output->close())
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
        file.reserve(static_cast<std::size_t>(image->width) * image->height *
                         count_channels(*image) * sizeof(float) +
                     (1 << 16));
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
