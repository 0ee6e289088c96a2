/* SPDX-License-Identifier: Apache-2.0 */
#include "data/volume/slice_colors.h"

#include <stdint.h>

#include "data/volume/interpolate.h"

enum { COLORS = 33 };

/* Equally spaced colours, 0xRRGGBB: the tables of clients/web/core/color_maps.js, sampled from
 * d3-scale-chromatic 3.1.0 (ISC), ColorBrewer and turbo (Apache-2.0). clients/web/LICENSES.md has
 * the texts. */
static const uint32_t maps[][COLORS] = {
    [SP_SLICE_VIRIDIS] = { 0x440154, 0x470d60, 0x48186a, 0x482374, 0x472d7b, 0x453781, 0x424086,
                           0x3e4989, 0x3b528b, 0x375b8d, 0x33638d, 0x2f6b8e, 0x2c728e, 0x297a8e,
                           0x26828e, 0x23898e, 0x21918c, 0x1f988b, 0x1fa088, 0x22a785, 0x28ae80,
                           0x32b67a, 0x3fbc73, 0x4ec36b, 0x5ec962, 0x70cf57, 0x84d44b, 0x98d83e,
                           0xaddc30, 0xc2df23, 0xd8e219, 0xece51b, 0xfde725 },
    [SP_SLICE_INFERNO] = { 0x000004, 0x040312, 0x0b0724, 0x150b37, 0x210c4a, 0x2f0a5b, 0x3d0965,
                           0x4a0c6b, 0x57106e, 0x64156e, 0x71196e, 0x7d1e6d, 0x8a226a, 0x972766,
                           0xa32c61, 0xb0315b, 0xbc3754, 0xc73e4c, 0xd24644, 0xdb503b, 0xe45a31,
                           0xeb6628, 0xf1731d, 0xf68013, 0xf98e09, 0xfb9d07, 0xfcac11, 0xfbbc21,
                           0xf9cb35, 0xf5db4c, 0xf2ea69, 0xf3f68a, 0xfcffa4 },
    [SP_SLICE_CIVIDIS] = { 0x002051, 0x00265d, 0x012b65, 0x083169, 0x11366c, 0x1c3c6e, 0x26426e,
                           0x31476e, 0x3c4d6e, 0x47536d, 0x51586e, 0x5a5e6e, 0x62646f, 0x6a6a70,
                           0x727071, 0x797673, 0x7f7c75, 0x868276, 0x8c8877, 0x938e78, 0x9a9478,
                           0xa19b78, 0xa9a177, 0xb2a874, 0xbbaf71, 0xc5b66d, 0xcebd68, 0xd8c462,
                           0xe2cb5c, 0xebd355, 0xf3da4f, 0xfae249, 0xfdea45 },
    [SP_SLICE_TURBO] = { 0x23171b, 0x3e2a71, 0x493eae, 0x4a53d7, 0x4569ee, 0x3c7ff8, 0x3295f7,
                         0x2ba9ef, 0x26bce1, 0x25cdcf, 0x29dcbc, 0x32e9a7, 0x3ff393, 0x50f980,
                         0x65fd6e, 0x7cfd5e, 0x95fb51, 0xadf545, 0xc5ec3c, 0xdae034, 0xecd12e,
                         0xfac029, 0xffad24, 0xff9821, 0xff821d, 0xfd6c1a, 0xf05616, 0xdf4111,
                         0xcb2f0d, 0xb61f07, 0xa31302, 0x950c00, 0x900c00 },
    [SP_SLICE_BLUE_RED] = { 0x053061, 0x0e4178, 0x17518e, 0x2061a0, 0x2a71ae, 0x367fb8, 0x448ec1,
                            0x569dc8, 0x6bacd0, 0x82bad8, 0x98c7df, 0xadd2e5, 0xbfdceb, 0xd0e4ef,
                            0xdeebf2, 0xe9eff2, 0xf2efee, 0xf7ece5, 0xfae4d8, 0xfbd9c7, 0xfaccb4,
                            0xf7bca0, 0xf3aa8c, 0xec977a, 0xe48268, 0xdb6d59, 0xd1574b, 0xc6413f,
                            0xb82d35, 0xa81d2d, 0x941127, 0x7e0823, 0x67001f },
};

void sp_points_color(const struct sp_transfer_function *tf, double value, double rgb[3]) {
    uint32_t low = 0, high = tf->point_count - 1;
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;
        if (tf->points[middle].value <= value)
            low = middle;
        else
            high = middle;
    }
    const struct sp_tf_point *a = &tf->points[low], *b = &tf->points[high];
    double half_span = b->value * 0.5 - a->value * 0.5; /* half: the span may overflow */
    double t = half_span > 0 ? (value * 0.5 - a->value * 0.5) / half_span : 0;
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    for (int c = 0; c < 3; c++)
        rgb[c] = (1 - t) * (double)a->color[c] + t * (double)b->color[c];
}

/* The colour of a map at a place in [0, 1]. */
static void compute_map_color(const uint32_t map[COLORS], double at, double rgb[3]) {
    const int low = at * (COLORS - 1) < COLORS - 1 ? (int)(at * (COLORS - 1)) : COLORS - 2;
    const double t = at * (COLORS - 1) - low;
    for (int c = 0; c < 3; c++) {
        const int shift = 16 - 8 * c;
        rgb[c] = ((1 - t) * (map[low] >> shift & 255) + t * (map[low + 1] >> shift & 255)) / 255;
    }
}

void sp_slice_color(const struct sp_view *view, double value, double rgb[3]) {
    const struct sp_slices *slices = &view->slices;
    const double window[2] = { slices->center, slices->width };
    switch (slices->colors) {
    case SP_SLICE_GREY:
        rgb[0] = rgb[1] = rgb[2] = sp_grey_level(value, window);
        break;
    case SP_SLICE_TRANSFER_FUNCTION:
        sp_points_color(&view->transfer_function, value, rgb);
        break;
    default:
        compute_map_color(maps[slices->colors], sp_grey_level(value, window), rgb);
    }
}
