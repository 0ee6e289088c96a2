/* SPDX-License-Identifier: Apache-2.0 */
#include "manifest.h"

/* clang-format off */
const struct manifest_entry manifest[] = {
    /*                                               lowpass 0       lowpass 1       adaptive */
    { "constant-cube", test_scene_constant_cube, { 66.0, 0 }, { 56.0, 0 }, { 56.0, 0 } },
    { "thin-shells",   test_scene_thin_shells,   { 55.0, 0 }, { 40.0, 0 }, { 40.0, 0 } },
    { "anisotropic",   test_scene_anisotropic,   { 48.0, 0 }, { 41.0, 0 }, { 41.0, 0 } },
    { "checkerboard",  test_scene_checkerboard,  { 40.0, 0 }, { 30.0, 0 }, { 30.0, 0 } },
    { "phantom",       test_scene_phantom,       { 64.0, 0 }, { 60.0, 0 }, { 45.0, 0 } },
    { "oblique",       test_scene_oblique,       { 42.0, 0 }, { 39.0, 0 }, { 39.0, 0 } },
    { "blobs",         test_scene_blobs,         { 60.0, 0 }, { 52.0, 0 }, { 52.0, 0 } },
    { "orthographic",  test_scene_orthographic,  { 62.0, 0 }, { 51.0, 0 }, { 51.0, 0 } },
    { "rotated",       test_scene_rotated,       { 59.0, 0 }, { 48.0, 0 }, { 48.0, 0 } },
    { "left-handed",   test_scene_left_handed,   { 60.0, 0 }, { 50.0, 0 }, { 50.0, 0 } },
    { "sheared",       test_scene_sheared,       { 57.0, 0 }, { 44.0, 0 }, { 44.0, 0 } },
    { "inside",        test_scene_inside,        { 44.0, 0 }, { 44.0, 0 }, { 42.0, 0 } },
    { "wide-kernel",   test_scene_wide_kernel,   { 55.0, 0 }, { 51.0, 0 }, { 51.0, 0 } },
    { "lit-shell",     test_scene_lit_shell,     { 44.0, 0 }, { 35.0, 0 }, { 35.0, 0 } },
};
/* clang-format on */
const size_t manifest_count = sizeof manifest / sizeof *manifest;
