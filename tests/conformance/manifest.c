/* SPDX-License-Identifier: Apache-2.0 */
#include "manifest.h"

const struct manifest_entry manifest[] = {
    /* floor and measured: lowpass 0, lowpass 1, adaptive */
    { "constant-cube",
      test_scene_constant_cube,
      { 69.1, 69.59 },
      { 59.0, 59.51 },
      { 59.0, 59.51 } },
    { "thin-shells", test_scene_thin_shells, { 57.8, 58.30 }, { 41.5, 42.05 }, { 41.5, 42.05 } },
    { "anisotropic", test_scene_anisotropic, { 50.1, 50.60 }, { 43.0, 43.47 }, { 43.0, 43.47 } },
    { "checkerboard", test_scene_checkerboard, { 54.4, 54.85 }, { 34.9, 35.41 }, { 34.8, 35.32 } },
    { "phantom", test_scene_phantom, { 67.6, 68.09 }, { 66.8, 67.29 }, { 65.2, 65.69 } },
    { "oblique", test_scene_oblique, { 44.4, 44.88 }, { 41.0, 41.51 }, { 41.0, 41.51 } },
    { "blobs", test_scene_blobs, { 63.3, 63.83 }, { 54.9, 55.40 }, { 54.9, 55.40 } },
    { "orthographic", test_scene_orthographic, { 65.2, 65.73 }, { 53.6, 54.14 }, { 53.6, 54.14 } },
    { "rotated", test_scene_rotated, { 62.3, 62.81 }, { 50.3, 50.76 }, { 50.3, 50.76 } },
    { "left-handed", test_scene_left_handed, { 63.5, 63.98 }, { 52.7, 53.22 }, { 52.7, 53.22 } },
    { "sheared", test_scene_sheared, { 60.0, 60.48 }, { 46.1, 46.62 }, { 46.1, 46.62 } },
    { "inside", test_scene_inside, { 44.6, 45.13 }, { 44.5, 45.01 }, { 44.5, 45.01 } },
    { "wide-kernel", test_scene_wide_kernel, { 57.9, 58.37 }, { 53.8, 54.29 }, { 53.8, 54.29 } },
    { "lit-shell", test_scene_lit_shell, { 46.3, 46.81 }, { 37.4, 37.89 }, { 37.4, 37.89 } },
};
const size_t manifest_count = sizeof manifest / sizeof *manifest;
