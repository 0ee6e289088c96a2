// SPDX-License-Identifier: Apache-2.0
#include "data/import/image_bridge.h"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <exception>
#include <memory>
#include <string>
#include <vector>

#include <OpenImageIO/imageio.h>

#include "data/import/exception.h"

struct image_bridge {
    std::unique_ptr<OIIO::ImageInput> input;
};

static bool explain(sp_error *err, const char *text) {
    /* main.c explains an empty one. A damaged file can make a library quote gigabytes. */
    std::string line(text, strnlen(text, SP_ERROR_TEXT));
    for (char &c : line)
        if (static_cast<unsigned char>(c) < 0x20)
            c = ' ';
    static const char intro[] =
        "OpenImageIO cannot read it, most likely because it is cut off or damaged: ";
    return sp_fail(err, SP_ERR_FORMAT, "", "%s%s", line.empty() ? "" : intro, line.c_str());
}

static image_bridge *open_file(const char *path, const char *format, sp_error *err) try {
    OIIO::attribute("threads", 1);
    OIIO::attribute("exr_threads", -1);
    auto bridge = std::make_unique<image_bridge>();
    bridge->input = OIIO::ImageInput::create(format);
    if (!bridge->input) {
        explain(err, OIIO::geterror().c_str());
        return nullptr;
    }
    OIIO::ImageSpec spec, how;
    how.attribute("oiio:UnassociatedAlpha", 1); /* the numbers of the file */
    if (!bridge->input->open(path, spec, how)) {
        explain(err, bridge->input->geterror().c_str());
        return nullptr;
    }
    return bridge.release();
} catch (const std::exception &e) {
    import_fail_caught(err, e, explain);
    return nullptr;
}

static void close_file(image_bridge *bridge) {
    delete bridge;
}

static int describe_page(image_bridge *bridge, int n, image_page *page, sp_error *err) try {
    if (!bridge->input->seek_subimage(n, 0)) {
        std::string text = bridge->input->geterror();
        explain(err, text.c_str());
        return text.empty() ? 0 : -1;
    }
    const OIIO::ImageSpec &spec = bridge->input->spec();
    memset(page, 0, sizeof *page);
    page->width = spec.width;
    page->height = spec.height;
    page->channels = spec.nchannels;
    page->bytes = static_cast<int>(spec.format.basesize());
    page->floating = spec.format.is_floating_point();
    page->is_signed = spec.format.is_signed();
    return 1;
} catch (const std::exception &e) {
    import_fail_caught(err, e, explain);
    return -1;
}

/* OpenImageIO reports some failures with a result of true. */
static bool check(OIIO::ImageInput &input, bool ok, sp_error *err) {
    if (ok && !input.has_error())
        return true;
    return explain(err, input.geterror().c_str());
}

static bool read_page(image_bridge *bridge, int n, void *out, sp_error *err) try {
    OIIO::ImageInput &input = *bridge->input;
    const bool ok = input.seek_subimage(n, 0) &&
                    input.read_image(n, 0, 0, input.spec().nchannels, input.spec().format, out);
    return check(input, ok, err);
} catch (const std::exception &e) {
    return import_fail_caught(err, e, explain);
}

static int describe_grid(image_bridge *bridge, int n, image_grid *grid, sp_error *err) try {
    if (!bridge->input->seek_subimage(n, 0)) {
        explain(err, bridge->input->geterror().c_str());
        return 0; /* OpenImageIO also gives a reason beyond the last grid */
    }
    const OIIO::ImageSpec &spec = bridge->input->spec();
    float matrix[16] = { 0 };
    memset(grid, 0, sizeof *grid);
    const std::string name = spec.get_string_attribute("openvdb:name");
    snprintf(grid->name, sizeof grid->name, "%s", name.c_str());
    grid->channels = spec.nchannels;
    const std::string kind = spec.get_string_attribute("openvdb:class");
    grid->is_level_set = kind == "level set" || spec.get_string_attribute("class") == "level set";
    grid->is_double = spec.format == OIIO::TypeDesc::DOUBLE;
    const bool is_linear = spec.getattribute("openvdb:indextoworld", OIIO::TypeMatrix44, matrix);
    grid->is_other = !is_linear || spec.tile_depth < 1 ||
                     (!grid->is_double && spec.format != OIIO::TypeDesc::FLOAT);
    const int first[3] = { spec.full_x, spec.full_y, spec.full_z };
    const int dims[3] = { spec.full_width, spec.full_height, spec.full_depth };
    memcpy(grid->first, first, sizeof first);
    memcpy(grid->dims, dims, sizeof dims);
    for (int row = 0; row < 4; row++)
        for (int column = 0; column < 3; column++)
            grid->rows[row][column] = static_cast<double>(matrix[4 * row + column]);
    return 1;
} catch (const std::exception &e) {
    import_fail_caught(err, e, explain);
    return -1;
}

/* Copies the part of a slab of tiles that lies in the box. */
static size_t copy_slab(const OIIO::ImageSpec &spec, const char *slab, int z, int slices,
                        char *out) {
    const size_t voxel = spec.format.basesize();
    size_t copied = 0;
    for (int k = 0; k < slices; k++) {
        const int to_z = z + k - spec.full_z;
        if (to_z < 0 || to_z >= spec.full_depth)
            continue;
        for (int y = 0; y < spec.full_height; y++) {
            const size_t from = (static_cast<size_t>(k) * static_cast<size_t>(spec.height) +
                                 static_cast<size_t>(y + spec.full_y - spec.y)) *
                                    static_cast<size_t>(spec.width) +
                                static_cast<size_t>(spec.full_x - spec.x);
            const size_t to = (static_cast<size_t>(to_z) * static_cast<size_t>(spec.full_height) +
                               static_cast<size_t>(y)) *
                              static_cast<size_t>(spec.full_width);
            memcpy(out + to * voxel, slab + from * voxel,
                   static_cast<size_t>(spec.full_width) * voxel);
        }
        copied += static_cast<size_t>(spec.full_width) * static_cast<size_t>(spec.full_height);
    }
    return copied;
}

static bool read_voxels(image_bridge *bridge, int n, void *out,
                        void (*report)(void *user, size_t done), void *user, sp_error *err) try {
    OIIO::ImageInput &input = *bridge->input;
    bool ok = input.seek_subimage(n, 0);
    const OIIO::ImageSpec &spec = input.spec();
    std::vector<char> slab(static_cast<size_t>(spec.width) * static_cast<size_t>(spec.height) *
                           static_cast<size_t>(spec.tile_depth) * spec.format.basesize());
    size_t done = 0;
    for (int z = spec.z; ok && z < spec.z + spec.depth; z += spec.tile_depth) {
        const int slices = std::min(spec.tile_depth, spec.z + spec.depth - z);
        ok = input.read_tiles(n, 0, spec.x, spec.x + spec.width, spec.y, spec.y + spec.height, z,
                              z + slices, 0, 1, spec.format, slab.data());
        if (ok)
            done += copy_slab(spec, slab.data(), z, slices, static_cast<char *>(out));
        report(user, done);
    }
    return check(input, ok, err);
} catch (const std::exception &e) {
    return import_fail_caught(err, e, explain);
}

/* The module's only symbol. */
extern "C" __attribute__((visibility("default")))
const image_bridge_functions splat_image_bridge = { open_file, close_file,    describe_page,
                                                    read_page, describe_grid, read_voxels };
