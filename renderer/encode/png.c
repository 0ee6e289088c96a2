/* SPDX-License-Identifier: Apache-2.0 */
#include <png.h>
#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>

#include "encode/encoder.h"

enum {
    LEVEL = 1, /* zlib level: files a quarter larger than at the best level, four times as fast */
    FILTER = PNG_FILTER_UP, /* for rendered volumes: smaller files than with no filter, faster than
                               a choice per row */
    CHUNK_BYTES = 64 << 10  /* size of an IDAT chunk; the library's default is 8 KiB */
};

struct job { /* the context of the library's callbacks */
    struct sp_buffer *output;
    bool is_short; /* a callback ran out of memory */
    char why[128]; /* the library's error message */
};

/* An error of the library jumps to the setjmp() of write_png(). The jump skips stack frames of the
 * library, of write_image() and of the callbacks below. None of these owns memory. */
static void fail(png_structp png, png_const_charp why) {
    struct job *job = png_get_error_ptr(png);
    snprintf(job->why, sizeof job->why, "%s", why);
    png_longjmp(png, 1);
}

static void ignore(png_structp png, png_const_charp warning) {
    (void)png;
    (void)warning;
}

static png_voidp allocate(png_structp png, png_alloc_size_t size) {
    struct job *job = png_get_mem_ptr(png);
    void *memory = malloc(size);
    job->is_short = job->is_short || !memory;
    return memory;
}

static void give_back(png_structp png, png_voidp memory) {
    (void)png;
    free(memory);
}

static void append(png_structp png, png_bytep bytes, size_t size) {
    struct job *job = png_get_io_ptr(png);
    if (sp_buffer_append(job->output, bytes, size))
        return;
    job->is_short = true;
    png_error(png, "out of memory");
}

static void flush(png_structp png) {
    (void)png;
}

static void write_image(png_structp png, png_infop info, const struct sp_raster *raster) {
    char key[] = "Software", value[] = "splatd " SPLATD_VERSION;
    const png_text software = { .compression = PNG_TEXT_COMPRESSION_NONE,
                                .key = key,
                                .text = value,
                                .text_length = sizeof value - 1 };
    png_set_compression_level(png, LEVEL);
    png_set_compression_buffer_size(png, CHUNK_BYTES);
    png_set_filter(png, PNG_FILTER_TYPE_BASE, FILTER);
    png_set_IHDR(png, info, raster->width, raster->height, 8,
                 raster->is_grey     ? PNG_COLOR_TYPE_GRAY
                 : raster->is_opaque ? PNG_COLOR_TYPE_RGB
                                     : PNG_COLOR_TYPE_RGBA,
                 PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_BASE, PNG_FILTER_TYPE_BASE);
    if (!raster->is_grey) { /* an image to look at */
        png_set_sRGB(png, info, PNG_sRGB_INTENT_PERCEPTUAL);
        png_set_text(png, info, &software, 1);
    }
    png_write_info(png, info);
    if (raster->is_opaque && !raster->is_grey)
        png_set_filler(png, 0, PNG_FILLER_AFTER); /* the fourth byte is left out */
    for (uint32_t y = 0; y < raster->height; y++)
        png_write_row(png, (png_const_bytep)raster->pixels + y * raster->stride);
    png_write_end(png, info);
}

static bool write_png(png_structp png, png_infop info, const struct sp_raster *raster) {
    if (setjmp(png_jmpbuf(png)) != 0)
        return false;
    write_image(png, info, raster);
    return true;
}

bool sp_encode_png(struct sp_encoder *encoder, const struct sp_raster *raster,
                   struct sp_error *err) {
    struct job job = { .output = &encoder->output,
                       .why = "this program was built for another libpng" };
    if (!sp_buffer_reserve(&encoder->output, (size_t)raster->width * raster->height, err))
        return false;
    png_structp png = png_create_write_struct_2(PNG_LIBPNG_VER_STRING, &job, fail, ignore, &job,
                                                allocate, give_back);
    png_infop info = png ? png_create_info_struct(png) : NULL;
    if (png)
        png_set_write_fn(png, &job, append, flush);
    bool ok = info && write_png(png, info, raster);
    png_destroy_write_struct(&png, &info);
    if (job.is_short) /* an error even if the library continued without the memory */
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory while encoding %u × %u as png",
                       raster->width, raster->height);
    return ok || sp_fail(err, SP_ERR_BACKEND, "", "cannot encode %u × %u as png: %s", raster->width,
                         raster->height, job.why);
}
