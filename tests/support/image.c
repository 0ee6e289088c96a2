/* SPDX-License-Identifier: Apache-2.0 */
#include "support/image.h"

#include <errno.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

bool test_image_init(struct test_image *image, unsigned width, unsigned height) {
    *image = (struct test_image){ .width = width, .height = height };
    image->rgba = calloc((size_t)width * height * 4, sizeof *image->rgba);
    return image->rgba != NULL;
}

void test_image_finish(struct test_image *image) {
    free(image->rgba);
    *image = (struct test_image){ 0 };
}

bool test_image_from_frame(struct test_image *image, const struct sp_frame *frame) {
    if (!test_image_init(image, frame->width, frame->height))
        return false;
    for (unsigned y = 0; y < image->height; y++) {
        const unsigned char *row =
            (const unsigned char *)frame->pixels + (size_t)y * frame->stride_bytes;
        for (unsigned x = 0; x < image->width; x++) {
            double *to = test_image_at(image, x, y);
            if (frame->format == SP_RGBAF32) {
                float p[4];
                memcpy(p, row + (size_t)x * sizeof p, sizeof p);
                for (int c = 0; c < 4; c++)
                    to[c] = p[c];
            } else {
                const unsigned char *p = row + (size_t)x * 4;
                to[3] = p[3] / 255.0;
                for (int c = 0; c < 3; c++)
                    to[c] = p[c] / 255.0 * to[3];
            }
        }
    }
    return true;
}

void test_image_over(struct test_image *image, const float background[4]) {
    double under[4] = { 0, 0, 0, background[3] };
    for (int c = 0; c < 3; c++)
        under[c] = (double)background[c] * background[3];
    for (size_t i = 0; i < (size_t)image->width * image->height; i++) {
        double *p = image->rgba + i * 4, through = 1 - p[3];
        for (int c = 0; c < 4; c++)
            p[c] += through * under[c];
    }
}

void test_image_mirror(struct test_image *image) {
    for (unsigned y = 0; y < image->height; y++)
        for (unsigned x = 0; x < image->width / 2; x++) {
            double *a = test_image_at(image, x, y), *b;
            b = test_image_at(image, image->width - 1 - x, y);
            for (int c = 0; c < 4; c++) {
                double kept = a[c];
                a[c] = b[c];
                b[c] = kept;
            }
        }
}

double test_image_bend(const struct test_image frames[3]) {
    const size_t n = (size_t)frames[0].width * frames[0].height * 4;
    double most = 0;
    for (size_t i = 0; i < n; i++)
        most = fmax(most, fabs(frames[0].rgba[i] - 2 * frames[1].rgba[i] + frames[2].rgba[i]));
    return most;
}

double test_image_psnr(const struct test_image *a, const struct test_image *b) {
    if (a->width != b->width || a->height != b->height)
        return NAN;
    size_t count = (size_t)a->width * a->height * 4;
    double sum = 0;
    for (size_t i = 0; i < count; i++)
        sum += (a->rgba[i] - b->rgba[i]) * (a->rgba[i] - b->rgba[i]);
    if (!isfinite(sum))
        return NAN;
    return sum > 0 ? -10 * log10(sum / (double)count) : INFINITY;
}

struct test_difference test_image_difference(const struct test_image *a,
                                             const struct test_image *b) {
    struct test_difference d = { .largest = -1 };
    for (unsigned y = 0; y < a->height && y < b->height; y++)
        for (unsigned x = 0; x < a->width && x < b->width; x++)
            for (unsigned c = 0; c < 4; c++) {
                double pa = test_image_at(a, x, y)[c], pb = test_image_at(b, x, y)[c];
                if (!(fabs(pa - pb) <= d.largest))
                    d = (struct test_difference){ fabs(pa - pb), x, y, c, pa, pb };
            }
    return d;
}

void test_image_statistics(const struct test_image *image, unsigned channel, double *mean,
                           double *variance) {
    size_t count = (size_t)image->width * image->height;
    double sum = 0, squares = 0;
    for (size_t i = 0; i < count; i++)
        sum += image->rgba[i * 4 + channel];
    *mean = sum / (double)count;
    for (size_t i = 0; i < count; i++)
        squares += pow(image->rgba[i * 4 + channel] - *mean, 2);
    *variance = squares / (double)count;
}

/* PNG with stored (uncompressed) deflate blocks, so that a test needs no image library. */

struct png {
    FILE *file;
    uint32_t crc, adler_a, adler_b;
};

static void png_bytes(struct png *png, const void *bytes, size_t size) {
    const unsigned char *p = bytes;
    for (size_t i = 0; i < size; i++) {
        png->crc ^= p[i];
        for (int bit = 0; bit < 8; bit++)
            png->crc = png->crc >> 1 ^ (png->crc & 1 ? UINT32_C(0xedb88320) : 0);
    }
    fwrite(bytes, 1, size, png->file);
}

static void png_u32(struct png *png, uint32_t v) {
    unsigned char b[4] = { (unsigned char)(v >> 24), (unsigned char)(v >> 16),
                           (unsigned char)(v >> 8), (unsigned char)v };
    png_bytes(png, b, 4);
}

static void png_begin(struct png *png, const char *type, size_t size) {
    png_u32(png, (uint32_t)size);
    png->crc = UINT32_MAX;
    png_bytes(png, type, 4);
}

static void png_end(struct png *png) {
    png_u32(png, png->crc ^ UINT32_MAX);
}

static void png_row(struct png *png, const unsigned char *row, size_t size, bool last) {
    unsigned char head[5] = { last, (unsigned char)size, (unsigned char)(size >> 8),
                              (unsigned char)~size, (unsigned char)(~size >> 8) };
    png_bytes(png, head, sizeof head);
    png_bytes(png, row, size);
    for (size_t i = 0; i < size; i++) {
        png->adler_a = (png->adler_a + row[i]) % 65521;
        png->adler_b = (png->adler_b + png->adler_a) % 65521;
    }
}

bool test_image_write_png(const struct test_image *image, const char *path) {
    size_t row_bytes = (size_t)image->width * 3 + 1; /* the filter byte first */
    if (row_bytes > 65535)
        return false;
    unsigned char *row = calloc(1, row_bytes);
    struct png png = { .file = fopen(path, "wb"), .adler_a = 1 };
    if (!row || !png.file) {
        free(row);
        if (png.file)
            fclose(png.file);
        return false;
    }
    fwrite("\x89PNG\r\n\x1a\n", 1, 8, png.file);
    png_begin(&png, "IHDR", 13);
    png_u32(&png, image->width);
    png_u32(&png, image->height);
    png_bytes(&png, "\x08\x02\x00\x00\x00", 5);
    png_end(&png);
    png_begin(&png, "IDAT", 2 + (row_bytes + 5) * image->height + 4);
    png_bytes(&png, "\x78\x01", 2);
    for (unsigned y = 0; y < image->height; y++) {
        for (unsigned x = 0; x < image->width; x++)
            for (unsigned c = 0; c < 3; c++) {
                double v = test_image_at(image, x, y)[c];
                row[1 + x * 3 + c] = (unsigned char)(255 * fmin(fmax(v, 0), 1) + 0.5);
            }
        png_row(&png, row, row_bytes, y + 1 == image->height);
    }
    png_u32(&png, png.adler_b << 16 | png.adler_a);
    png_end(&png);
    png_begin(&png, "IEND", 0);
    png_end(&png);
    free(row);
    return fclose(png.file) == 0;
}

void test_image_dump(const char *name, const struct test_image *got,
                     const struct test_image *wanted, double gain) {
    const char *folder = getenv("SPLATD_TEST_DUMP");
    char path[1024];
    struct test_image all;
    unsigned width = got->width, height = got->height;
    if (!folder)
        folder = "dump";
    if (mkdir(folder, 0777) && errno != EEXIST) {
        printf("cannot create the folder %s: %s\n", folder, strerror(errno));
        return;
    }
    if (wanted->width != width || wanted->height != height ||
        !test_image_init(&all, 3 * width, height))
        return;
    for (unsigned y = 0; y < height; y++)
        for (unsigned x = 0; x < width; x++)
            for (unsigned c = 0; c < 4; c++) {
                double a = test_image_at(got, x, y)[c], b = test_image_at(wanted, x, y)[c];
                test_image_at(&all, x, y)[c] = a;
                test_image_at(&all, x + width, y)[c] = b;
                test_image_at(&all, x + 2 * width, y)[c] = gain * fabs(a - b);
            }
    snprintf(path, sizeof path, "%s/%s.png", folder, name);
    if (test_image_write_png(&all, path))
        printf("  %s: result, expected image, %g times the difference\n", path, gain);
    test_image_finish(&all);
}
