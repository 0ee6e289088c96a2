// SPDX-License-Identifier: Apache-2.0
#include "import/tiff_bridge.h"

#include <cstdio>
#include <cstring>
#include <exception>
#include <memory>
#include <string>

#include <OpenImageIO/imageio.h>

struct tiff_bridge {
    std::unique_ptr<OIIO::ImageInput> input;
};

static void explain(char *why, size_t capacity, const std::string &text) {
    std::string line = text.empty() ? std::string("no reason given") : text;
    for (char &c : line)
        if (static_cast<unsigned char>(c) < 0x20)
            c = ' ';
    snprintf(why, capacity, "%s", line.c_str());
}

static tiff_bridge *open_file(const char *path, char *why, size_t capacity) try {
    OIIO::attribute("threads", 1);
    OIIO::attribute("exr_threads", -1);
    auto bridge = std::make_unique<tiff_bridge>();
    bridge->input = OIIO::ImageInput::create("tiff");
    if (!bridge->input) {
        explain(why, capacity, OIIO::geterror());
        return nullptr;
    }
    OIIO::ImageSpec spec;
    if (!bridge->input->open(path, spec)) {
        explain(why, capacity, bridge->input->geterror());
        return nullptr;
    }
    return bridge.release();
} catch (const std::exception &e) {
    explain(why, capacity, e.what());
    return nullptr;
}

static void close_file(tiff_bridge *bridge) {
    delete bridge;
}

static int describe_page(tiff_bridge *bridge, int n, tiff_page *page, char *why,
                         size_t capacity) try {
    if (!bridge->input->seek_subimage(n, 0)) {
        std::string text = bridge->input->geterror();
        explain(why, capacity, text);
        return text.empty() ? 0 : -1;
    }
    const OIIO::ImageSpec &spec = bridge->input->spec();
    memset(page, 0, sizeof *page);
    page->width = spec.width;
    page->height = spec.height;
    page->depth = spec.depth;
    page->channels = spec.nchannels;
    page->bytes = static_cast<int>(spec.format.basesize());
    page->bits = spec.get_int_attribute("oiio:BitsPerSample", 0);
    page->floating = spec.format.is_floating_point();
    page->is_signed = spec.format.is_signed();
    page->x_resolution = spec.get_float_attribute("XResolution", 0);
    page->y_resolution = spec.get_float_attribute("YResolution", 0);
    std::string unit = spec.get_string_attribute("ResolutionUnit");
    std::string description = spec.get_string_attribute("ImageDescription");
    snprintf(page->resolution_unit, sizeof page->resolution_unit, "%s", unit.c_str());
    snprintf(page->description, sizeof page->description, "%s", description.c_str());
    return 1;
} catch (const std::exception &e) {
    explain(why, capacity, e.what());
    return -1;
}

/* Reads row by row. For several rows at once, OpenImageIO 2.4 unpacks deflate itself if samples are
 * uint8 or uint16, and reports success when that fails. It reports other failures with a result of
 * true. */
static bool read_rows(OIIO::ImageInput &input, void *out) {
    const OIIO::ImageSpec &spec = input.spec();
    char *row = static_cast<char *>(out);
    for (int y = spec.y; y < spec.y + spec.height; y++, row += spec.scanline_bytes())
        if (!input.read_scanline(y, spec.z, spec.format, row))
            return false;
    return true;
}

static bool read_page(tiff_bridge *bridge, int n, void *out, char *why, size_t capacity) try {
    OIIO::ImageInput &input = *bridge->input;
    bool ok = input.seek_subimage(n, 0);
    const OIIO::ImageSpec &spec = input.spec();
    bool by_row = spec.tile_width == 0 &&
                  (spec.format == OIIO::TypeDesc::UINT8 || spec.format == OIIO::TypeDesc::UINT16);
    if (ok && spec.format == OIIO::TypeDesc::DOUBLE) { /* read_image() would return zeros */
        if (spec.tile_width || spec.height < 2) {
            explain(why, capacity,
                    "samples of 64 bits in tiles or in a single row are not supported");
            return false;
        }
        ok = input.read_native_scanlines(n, 0, spec.y, spec.y + spec.height, spec.z, out);
    } else
        ok =
            ok && (by_row ? read_rows(input, out) : input.read_image(n, 0, 0, 1, spec.format, out));
    if (!ok || input.has_error()) {
        explain(why, capacity, input.geterror());
        return false;
    }
    return true;
} catch (const std::exception &e) {
    explain(why, capacity, e.what());
    return false;
}

/* The module's only symbol. */
extern "C" __attribute__((visibility("default")))
const tiff_bridge_functions splat_tiff_bridge = { open_file, close_file, describe_page, read_page };
