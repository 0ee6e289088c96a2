/* SPDX-License-Identifier: Apache-2.0
 *
 * One PNG or JPEG image: a volume of one slice. stack.c joins the slices of a folder.
 * OpenImageIO reads it (image_bridge.h).
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "data/import/conversion.h"
#include "data/import/image_bridge.h"
#include "data/import/module.h"
#include "data/volume/volume.h"

struct image {
    const struct import_file *file;
    const struct image_bridge_functions *call;
    struct image_bridge *bridge;
    struct image_page page;
    struct import_conversion conversion;
};

static const char *format_of(const uint8_t *start, size_t size) {
    if (size >= 8 && memcmp(start, "\x89PNG\r\n\x1a\n", 8) == 0)
        return "png";
    return size >= 3 && memcmp(start, "\xff\xd8\xff", 3) == 0 ? "jpeg" : NULL;
}

static bool probe(const uint8_t *start, size_t size, const char *title) {
    (void)title;
    return format_of(start, size) != NULL;
}

static bool set_type(struct image *m, struct import_header *header, struct sp_error *err) {
    const struct image_page *page = &m->page;
    if (page->width < 1 || page->height < 1 || page->width > (int)SP_DIM_MAX ||
        page->height > (int)SP_DIM_MAX)
        return sp_fail(err, SP_ERR_FORMAT, m->file->title,
                       "the image has %d x %d px; each side must be in [1, %u]", page->width,
                       page->height, SP_DIM_MAX);
    if (page->floating || page->is_signed || page->bytes > 2 || page->channels < 1 ||
        page->channels > 4)
        return sp_fail(err, SP_ERR_UNSUPPORTED, m->file->title,
                       "images of %d channels of %d bits are not supported; supported are 1 to 4 "
                       "channels of 8 or 16 bits",
                       page->channels, page->bytes * 8);
    m->conversion = import_conversion_of(
        (struct import_number){ IMPORT_UNSIGNED, (size_t)page->bytes }, m->file->warnings);
    m->conversion.components = (unsigned)page->channels;
    if (page->channels > 1)
        m->conversion.component = import_header_choose_component(
            header, m->file->field, m->conversion.components, page->channels > 2);
    header->type = m->conversion.type;
    header->grid.dims[0] = (uint32_t)page->width;
    header->grid.dims[1] = (uint32_t)page->height;
    header->grid.dims[2] = 1;
    return sp_grid_check(&header->grid, header->type, m->file->title, &header->bytes, err);
}

static bool open_image(void *reader, const struct import_file *file, struct import_header *header,
                       struct sp_error *err) {
    struct image *m = reader;
    m->file = file;
    char path[40];
    struct sp_error why;
    uint8_t start[8] = { 0 };
    const ssize_t got = pread(m->file->fd, start, sizeof start, 0);
    const char *format = got > 0 ? format_of(start, (size_t)got) : NULL;
    if (!format)
        return import_fail(err, SP_ERR_FORMAT, m->file->title, 0, NULL,
                           "the file is neither PNG nor JPEG");
    m->call = import_module_load(m->file, IMAGE_BRIDGE_MODULE, IMAGE_BRIDGE_SYMBOL, "OpenImageIO",
                                 "libopenimageio2.4", err);
    if (!m->call)
        return false;
    /* Opens by descriptor, because the name may refer to another file by now. */
    snprintf(path, sizeof path, "/proc/self/fd/%d", m->file->fd);
    m->bridge = m->call->open(path, format, &why);
    if (!m->bridge || m->call->page(m->bridge, 0, &m->page, &why) != 1)
        return sp_fail(err, why.code, m->file->title, "%s", why.text);
    return set_type(m, header, err);
}

static void close_image(void *reader) {
    struct image *m = reader;
    if (m->bridge)
        m->call->close(m->bridge);
}

static bool read_image(void *reader, void *voxels, float (*vectors)[3],
                       const struct import_progress *progress, struct sp_error *err) {
    struct image *m = reader;
    const size_t count = (size_t)m->page.width * (size_t)m->page.height;
    const bool is_copy = import_conversion_is_copy(&m->conversion);
    void *pixels =
        is_copy ? voxels : malloc(count * (size_t)m->page.channels * (size_t)m->page.bytes);
    struct sp_error why;
    (void)vectors;
    bool ok = pixels || sp_fail(err, SP_ERR_MEMORY, m->file->title, "out of memory for an image");
    if (ok && !m->call->read(m->bridge, 0, pixels, &why))
        ok = sp_fail(err, why.code, m->file->title, "%s", why.text);
    if (ok && !is_copy)
        import_conversion_put(&m->conversion, pixels, count, voxels);
    if (!is_copy)
        free(pixels);
    import_report(progress, count * sp_type_size(m->conversion.type));
    return ok;
}

const struct import_format import_image = { .name = "image",
                                            .needs_module = true,
                                            .probe = probe,
                                            .reader_size = sizeof(struct image),
                                            .open = open_image,
                                            .read = read_image,
                                            .close = close_image };
