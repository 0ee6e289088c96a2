/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>

#include "data/volume/slice_colors.h"

/* A view whose slices have the window [100, 300]. */
static struct sp_view make_view(enum sp_slice_colors colors) {
    return (struct sp_view){
        .slices = { .colors = colors, .center = 200, .width = 200 },
        .transfer_function = { .point_count = 3,
                               .points = { { .value = 0, .color = { 1, 0, 0 } },
                                           { .value = 400, .color = { 0, 1, 0 } },
                                           { .value = 401, .color = { 0, 0, 1 } } } },
    };
}

/* color: 0xRRGGBB */
static void check(const struct sp_view *view, double value, uint32_t color) {
    double rgb[3];
    sp_slice_color(view, value, rgb);
    assert_int_equal(lround(rgb[0] * 255) << 16 | lround(rgb[1] * 255) << 8 | lround(rgb[2] * 255),
                     color);
}

static void the_window_spans_grey_and_the_maps(void **state) {
    (void)state;
    static const uint32_t expected[][3] = {
        [SP_SLICE_GREY] = { 0x000000, 0x808080, 0xffffff },
        [SP_SLICE_VIRIDIS] = { 0x440154, 0x21918c, 0xfde725 },
        [SP_SLICE_INFERNO] = { 0x000004, 0xbc3754, 0xfcffa4 },
        [SP_SLICE_CIVIDIS] = { 0x002051, 0x7f7c75, 0xfdea45 },
        [SP_SLICE_TURBO] = { 0x23171b, 0x95fb51, 0x900c00 },
        [SP_SLICE_BLUE_RED] = { 0x053061, 0xf2efee, 0x67001f },
    };
    for (int colors = SP_SLICE_GREY; colors <= SP_SLICE_BLUE_RED; colors++) {
        const struct sp_view view = make_view((enum sp_slice_colors)colors);
        for (int i = 0; i < 3 && colors != SP_SLICE_TRANSFER_FUNCTION; i++)
            check(&view, 100 * (i + 1), expected[colors][i]);
        if (colors != SP_SLICE_TRANSFER_FUNCTION) {
            check(&view, -INFINITY, expected[colors][0]);
            check(&view, 1e300, expected[colors][2]);
        }
    }
    const struct sp_view view = make_view(SP_SLICE_VIRIDIS);
    check(&view, 100 + 200 / 64., 0x46075a); /* half way between two colours */
}

static void the_transfer_function_needs_no_window(void **state) {
    (void)state;
    struct sp_view view = make_view(SP_SLICE_TRANSFER_FUNCTION);
    check(&view, -5, 0xff0000);
    check(&view, 200, 0x808000);
    check(&view, 400, 0x00ff00);
    check(&view, 900, 0x0000ff);
    view.transfer_function.point_count = 1;
    check(&view, 900, 0xff0000);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_window_spans_grey_and_the_maps),
        cmocka_unit_test(the_transfer_function_needs_no_window),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
