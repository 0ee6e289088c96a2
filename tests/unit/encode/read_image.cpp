/* SPDX-License-Identifier: Apache-2.0 */
#include "unit/encode/read_image.h"

#include <cstdio>
#include <cstdlib>
#include <string>

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

int read_image(const char *extension, const void *bytes, size_t size, decoded_image *image) {
    OIIO::Filesystem::IOMemReader memory(bytes, size);
    OIIO::ImageSpec config;
    config.attribute("oiio:UnassociatedAlpha", 1);
    const std::string name = std::string("image") + extension;
    auto input = OIIO::ImageInput::create(name, false, &config, &memory);
    OIIO::ImageSpec spec;
    if (!input || !input->set_ioproxy(&memory) || !input->open(name, spec, config)) {
        std::fprintf(stderr, "%s: %s\n", extension,
                     input ? input->geterror().c_str() : OIIO::geterror().c_str());
        return 0;
    }
    *image = {};
    image->width = spec.width;
    image->height = spec.height;
    image->channels = spec.nchannels;
    image->is_float = spec.format == OIIO::TypeDesc::FLOAT;
    for (int c = 0; c < spec.nchannels && c < 6; c++)
        std::snprintf(image->names[c], sizeof image->names[c], "%s", spec.channelnames[c].c_str());
    image->pixels = static_cast<float *>(
        std::malloc(sizeof(float) * spec.width * spec.height * spec.nchannels));
    if (!image->pixels ||
        !input->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, image->pixels)) {
        std::fprintf(stderr, "%s: %s\n", extension, input->geterror().c_str());
        std::free(image->pixels);
        return 0;
    }
    return 1;
}
