/* SPDX-License-Identifier: Apache-2.0 */
#include "conformance/manifest.h"

#define EWA SP_FILTER_EWA
#define ADAPTIVE SP_FILTER_ADAPTIVE
#define RECONSTRUCTION SP_FILTER_RECONSTRUCTION
#define LOWPASS SP_FILTER_LOWPASS
#define SWAN SP_FILTER_SWAN
#define NONE SP_FILTER_NONE
#define SPLAT SP_COMPOSITE_SPLAT
#define SHEET SP_COMPOSITE_SHEET
#define SLAB SP_COMPOSITE_SLAB
#define LINEAR SP_ATTENUATION_LINEAR

/* Filter, low-pass, compositing, slab, cutoff, attenuation, floor, measured, isa_floor. */
static const struct manifest_row constant_cube[] = {
    { EWA, 0, SHEET, 0, 0, 0, 69.1, 69.59, 71 },
    { EWA, 1, SHEET, 0, 0, 0, 59.0, 59.51, 69.5 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 59.0, 59.51, 69.5 },
    { EWA, 0, SPLAT, 0, 0, 0, 69.1, 69.59, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 69.1, 69.59, 0 },
    { EWA, 1, SLAB, 1, 0, 0, 59.0, 59.51, 0 },
};

static const struct manifest_row thin_shells[] = {
    { EWA, 0, SHEET, 0, 0, 0, 57.8, 58.30, 71 },      { EWA, 1, SHEET, 0, 0, 0, 41.5, 42.05, 59 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 41.5, 42.05, 59 }, { EWA, 0, SPLAT, 0, 0, 0, 57.8, 58.31, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 57.8, 58.31, 0 },        { EWA, 1, SLAB, 1, 0, 0, 41.5, 42.04, 0 },
};

static const struct manifest_row anisotropic[] = {
    { EWA, 0, SHEET, 0, 0, 0, 50.1, 50.60, 0 },       { EWA, 1, SHEET, 0, 0, 0, 43.0, 43.47, 62 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 43.0, 43.47, 62 }, { EWA, 0, SPLAT, 0, 0, 0, 48.0, 48.45, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 50.1, 50.58, 0 },        { EWA, 1, SLAB, 1, 0, 0, 43.0, 43.49, 0 },
    { EWA, 0, SLAB, 0.5, 4, 0, 51.6, 52.10, 0 },
};

static const struct manifest_row checkerboard[] = {
    { EWA, 0, SHEET, 0, 0, 0, 54.4, 54.85, 0 },
    { EWA, 1, SHEET, 0, 0, 0, 34.9, 35.41, 61.5 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 34.8, 35.32, 61.5 },
    { EWA, 0, SPLAT, 0, 0, 0, 55.6, 56.10, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 56.5, 57.00, 0 },
    { EWA, 1, SLAB, 1, 0, 0, 34.9, 35.42, 0 },
    { EWA, 0, SLAB, 0.5, 0, 0, 56.6, 57.05, 0 },
    { EWA, 0, SPLAT, 0, 2, 0, 37.1, 37.62, 0 },
    { EWA, 0, SHEET, 0, 2, 0, 37.1, 37.60, 0 },
    { EWA, 0, SLAB, 1, 2, 0, 37.1, 37.61, 0 },
    { EWA, 0, SLAB, 0.5, 2, 0, 37.1, 37.61, 0 },
    { EWA, 0, SPLAT, 0, 4, 0, 62.5, 63.04, 0 },
    { EWA, 0, SHEET, 0, 4, 0, 58.3, 58.78, 0 },
    { EWA, 0, SLAB, 1, 4, 0, 73.9, 74.38, 0 },
    { EWA, 0, SLAB, 0.5, 4, 0, 78.5, 79.03, 0 },
    { EWA, 0.3, SHEET, 0, 0, 0, 44.2, 44.73, 62 },
    { EWA, 0.3, SLAB, 0.5, 0, 0, 44.5, 44.97, 0 },
    { EWA, 0.55, SHEET, 0, 0, 0, 38.3, 38.82, 59 },
    { EWA, 0.55, SLAB, 0.5, 0, 0, 38.4, 38.88, 0 },
    { EWA, 1, SPLAT, 0, 0, 0, 34.9, 35.42, 0 },
    { SWAN, 1, SLAB, 1, 0, 0, 34.8, 35.29, 0 },
    { RECONSTRUCTION, 1, SLAB, 1, 0, 0, 21.9, 22.44, 0 },
    { LOWPASS, 1, SLAB, 1, 0, 0, 34.7, 35.21, 0 },
    { NONE, 0, SLAB, 1, 0, 0, 29.1, 29.62, 0 },
    { EWA, 0, SLAB, 1, 0, LINEAR, 34.0, 34.53, 0 },
    { EWA, 0, SPLAT, 0, 0, LINEAR, 45.0, 45.54, 0 },
    { ADAPTIVE, 1, SLAB, 1, 0, 0, 34.8, 35.32, 0 },
};

static const struct manifest_row phantom[] = {
    { EWA, 0, SHEET, 0, 0, 0, 67.6, 68.09, 73.5 },      { EWA, 1, SHEET, 0, 0, 0, 66.8, 67.29, 74 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 65.2, 65.69, 73.5 }, { EWA, 0, SPLAT, 0, 0, 0, 66.8, 67.27, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 68.0, 68.46, 0 },          { EWA, 1, SLAB, 1, 0, 0, 67.1, 67.57, 0 },
};

static const struct manifest_row oblique[] = {
    { EWA, 0, SHEET, 0, 0, 0, 44.4, 44.88, 0 },      { EWA, 1, SHEET, 0, 0, 0, 41.0, 41.51, 0 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 41.0, 41.51, 0 }, { EWA, 0, SPLAT, 0, 0, 0, 48.1, 48.61, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 48.1, 48.63, 0 },       { EWA, 1, SLAB, 1, 0, 0, 42.6, 43.07, 0 },
};

static const struct manifest_row blobs[] = {
    { EWA, 0, SHEET, 0, 0, 0, 63.3, 63.83, 84.5 },
    { EWA, 1, SHEET, 0, 0, 0, 54.9, 55.40, 73 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 54.9, 55.40, 71 },
    { EWA, 0, SPLAT, 0, 0, 0, 67.3, 67.76, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 67.3, 67.82, 0 },
    { EWA, 1, SLAB, 1, 0, 0, 55.2, 55.67, 0 },
    { EWA, 0, SLAB, 0.5, 0, 0, 67.5, 67.96, 0 },
    { EWA, 0, SPLAT, 0, 2, 0, 51.9, 52.40, 0 },
    { EWA, 0, SHEET, 0, 2, 0, 51.7, 52.20, 67 },
    { EWA, 0, SLAB, 1, 2, 0, 51.8, 52.31, 0 },
    { EWA, 0, SLAB, 0.5, 2, 0, 51.8, 52.34, 0 },
    { EWA, 0, SPLAT, 0, 4, 0, 72.0, 72.51, 0 },
    { EWA, 0, SHEET, 0, 4, 0, 64.8, 65.26, 91 },
    { EWA, 0, SLAB, 1, 4, 0, 74.3, 74.79, 0 },
    { EWA, 0, SLAB, 0.5, 4, 0, 74.4, 74.89, 0 },
    { EWA, 0.3, SHEET, 0, 0, 0, 63.5, 63.99, 78.5 },
    { EWA, 0.3, SLAB, 0.5, 0, 0, 67.9, 68.40, 0 },
    { EWA, 0.55, SHEET, 0, 0, 0, 62.0, 62.48, 74.5 },
    { EWA, 0.55, SLAB, 0.5, 0, 0, 64.5, 65.03, 0 },
    { EWA, 1, SPLAT, 0, 0, 0, 55.5, 55.97, 0 },
    { SWAN, 1, SLAB, 1, 0, 0, 48.0, 48.45, 0 },
    { RECONSTRUCTION, 1, SLAB, 1, 0, 0, 48.0, 48.45, 0 },
    { LOWPASS, 1, SLAB, 1, 0, 0, 43.7, 44.19, 0 },
    { NONE, 0, SLAB, 1, 0, 0, 39.4, 39.86, 0 },
    { EWA, 0, SLAB, 1, 0, LINEAR, 44.0, 44.55, 0 },
    { EWA, 0, SPLAT, 0, 0, LINEAR, 59.0, 59.48, 0 },
    { ADAPTIVE, 1, SLAB, 1, 0, 0, 55.2, 55.67, 0 },
};

static const struct manifest_row orthographic[] = {
    { EWA, 0, SHEET, 0, 0, 0, 65.2, 65.73, 69.5 },    { EWA, 1, SHEET, 0, 0, 0, 53.6, 54.14, 67.5 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 53.6, 54.14, 66 }, { EWA, 0, SPLAT, 0, 0, 0, 69.3, 69.84, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 69.3, 69.84, 0 },        { EWA, 1, SLAB, 1, 0, 0, 54.0, 54.47, 0 },
};

static const struct manifest_row rotated[] = {
    { EWA, 0, SHEET, 0, 0, 0, 62.3, 62.81, 67 },      { EWA, 1, SHEET, 0, 0, 0, 50.3, 50.76, 65.5 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 50.3, 50.76, 64 }, { EWA, 0, SPLAT, 0, 0, 0, 59.2, 59.68, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 62.6, 63.12, 0 },        { EWA, 1, SLAB, 1, 0, 0, 49.8, 50.27, 0 },
};

static const struct manifest_row left_handed[] = {
    { EWA, 0, SHEET, 0, 0, 0, 63.5, 63.98, 69.8 },
    { EWA, 1, SHEET, 0, 0, 0, 52.7, 53.22, 66.5 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 52.7, 53.22, 65.5 },
    { EWA, 0, SPLAT, 0, 0, 0, 60.3, 60.84, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 63.8, 64.28, 0 },
    { EWA, 1, SLAB, 1, 0, 0, 52.1, 52.62, 0 },
};

static const struct manifest_row sheared[] = {
    { EWA, 0, SHEET, 0, 0, 0, 60.0, 60.48, 79 },      { EWA, 1, SHEET, 0, 0, 0, 46.1, 46.62, 79.5 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 46.1, 46.62, 78 }, { EWA, 0, SPLAT, 0, 0, 0, 56.7, 57.24, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 60.6, 61.08, 0 },        { EWA, 1, SLAB, 1, 0, 0, 46.0, 46.45, 0 },
};

static const struct manifest_row inside[] = {
    { EWA, 0, SHEET, 0, 0, 0, 44.6, 45.13, 0 },      { EWA, 1, SHEET, 0, 0, 0, 44.5, 45.01, 0 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 44.5, 45.01, 0 }, { EWA, 0, SPLAT, 0, 0, 0, 44.9, 45.41, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 44.9, 45.41, 0 },       { EWA, 1, SLAB, 1, 0, 0, 44.8, 45.29, 0 },
};

static const struct manifest_row wide_kernel[] = {
    { EWA, 0, SHEET, 0, 0, 0, 57.9, 58.37, 0 },         { EWA, 1, SHEET, 0, 0, 0, 53.8, 54.29, 0 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 53.8, 54.29, 86.5 }, { EWA, 0, SPLAT, 0, 0, 0, 69.3, 69.82, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 73.7, 74.20, 0 },          { EWA, 1, SLAB, 1, 0, 0, 57.7, 58.16, 0 },
};

static const struct manifest_row lit_shell[] = {
    { EWA, 0, SHEET, 0, 0, 0, 46.3, 46.81, 84.5 },
    { EWA, 1, SHEET, 0, 0, 0, 37.4, 37.89, 82.5 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 37.4, 37.89, 79.5 },
    { EWA, 0, SPLAT, 0, 0, 0, 50.2, 50.72, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 55.1, 55.60, 0 },
    { EWA, 1, SLAB, 1, 0, 0, 38.2, 38.73, 0 },
};

static const struct manifest_row layers[] = {
    { EWA, 0, SHEET, 0, 0, 0, 44.0, 44.46, 0 },
    { EWA, 1, SHEET, 0, 0, 0, 41.9, 42.40, 0 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 41.9, 42.40, 0 },
    { EWA, 0, SPLAT, 0, 0, 0, 47.3, 47.81, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 48.2, 48.73, 0 },
    { EWA, 1, SLAB, 1, 0, 0, 43.6, 44.15, 0 },
    { EWA, 0, SLAB, 0.5, 0, 0, 48.2, 48.73, 0 },
    { EWA, 0, SPLAT, 0, 2, 0, 37.2, 37.66, 0 },
    { EWA, 0, SHEET, 0, 2, 0, 36.7, 37.23, 0 },
    { EWA, 0, SLAB, 1, 2, 0, 37.3, 37.81, 0 },
    { EWA, 0, SLAB, 0.5, 2, 0, 37.3, 37.81, 0 },
    { EWA, 0, SPLAT, 0, 4, 0, 48.5, 48.98, 0 },
    { EWA, 0, SHEET, 0, 4, 0, 44.5, 44.96, 0 },
    { EWA, 0, SLAB, 1, 4, 0, 49.6, 50.09, 0 },
    { EWA, 0, SLAB, 0.5, 4, 0, 49.6, 50.09, 0 },
    { EWA, 0.3, SHEET, 0, 0, 0, 44.1, 44.60, 0 },
    { EWA, 0.3, SLAB, 0.5, 0, 0, 48.5, 49.00, 0 },
    { EWA, 0.55, SHEET, 0, 0, 0, 44.0, 44.55, 0 },
    { EWA, 0.55, SLAB, 0.5, 0, 0, 48.1, 48.60, 0 },
    { EWA, 1, SPLAT, 0, 0, 0, 43.4, 43.90, 0 },
    { SWAN, 1, SLAB, 1, 0, 0, 38.9, 39.38, 0 },
    { RECONSTRUCTION, 1, SLAB, 1, 0, 0, 38.2, 38.73, 0 },
    { LOWPASS, 1, SLAB, 1, 0, 0, 25.3, 25.82, 0 },
    { NONE, 0, SLAB, 1, 0, 0, 28.4, 28.94, 0 },
    { EWA, 0, SLAB, 1, 0, LINEAR, 42.5, 42.95, 0 },
    { EWA, 0, SPLAT, 0, 0, LINEAR, 45.7, 46.16, 0 },
    { ADAPTIVE, 1, SLAB, 1, 0, 0, 43.6, 44.15, 0 },
};

static const struct manifest_row near_shell[] = {
    { EWA, 0, SHEET, 0, 0, 0, 46.8, 47.28, 0 },
    { EWA, 1, SHEET, 0, 0, 0, 46.1, 46.59, 0 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 46.1, 46.59, 0 },
    { EWA, 0, SPLAT, 0, 0, 0, 52.0, 52.50, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 51.6, 52.05, 0 },
    { EWA, 1, SLAB, 1, 0, 0, 49.5, 49.96, 0 },
    { EWA, 0, SLAB, 0.5, 0, 0, 51.7, 52.17, 0 },
    { EWA, 0, SPLAT, 0, 2, 0, 42.2, 42.71, 0 },
    { EWA, 0, SHEET, 0, 2, 0, 41.3, 41.82, 0 },
    { EWA, 0, SLAB, 1, 2, 0, 42.1, 42.57, 0 },
    { EWA, 0, SLAB, 0.5, 2, 0, 42.1, 42.60, 0 },
    { EWA, 0, SPLAT, 0, 4, 0, 51.7, 52.20, 0 },
    { EWA, 0, SHEET, 0, 4, 0, 46.7, 47.18, 0 },
    { EWA, 0, SLAB, 1, 4, 0, 51.4, 51.86, 0 },
    { EWA, 0, SLAB, 0.5, 4, 0, 51.5, 51.96, 0 },
    { EWA, 0.3, SHEET, 0, 0, 0, 46.8, 47.33, 0 },
    { EWA, 0.3, SLAB, 0.5, 0, 0, 51.8, 52.31, 0 },
    { EWA, 0.55, SHEET, 0, 0, 0, 46.9, 47.36, 0 },
    { EWA, 0.55, SLAB, 0.5, 0, 0, 51.8, 52.28, 0 },
    { EWA, 1, SPLAT, 0, 0, 0, 50.0, 50.49, 0 },
    { SWAN, 1, SLAB, 1, 0, 0, 44.4, 44.93, 0 },
    { RECONSTRUCTION, 1, SLAB, 1, 0, 0, 44.4, 44.93, 0 },
    { LOWPASS, 1, SLAB, 1, 0, 0, 25.1, 25.62, 0 },
    { NONE, 0, SLAB, 1, 0, 0, 29.6, 30.11, 0 },
    { EWA, 0, SLAB, 1, 0, LINEAR, 34.0, 34.48, 0 },
    { EWA, 0, SPLAT, 0, 0, LINEAR, 44.5, 45.00, 0 },
    { ADAPTIVE, 1, SLAB, 1, 0, 0, 49.5, 49.96, 0 },
};

static const struct manifest_row rectilinear_blobs[] = {
    { EWA, 0, SHEET, 0, 0, 0, 65.0, 65.49, 0 },      { EWA, 1, SHEET, 0, 0, 0, 53.9, 54.43, 0 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 53.9, 54.43, 0 }, { EWA, 0, SPLAT, 0, 0, 0, 67.3, 67.79, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 67.5, 68.01, 0 },       { EWA, 1, SLAB, 1, 0, 0, 54.3, 54.80, 0 },
};

static const struct manifest_row clip_plane[] = {
    { EWA, 0, SHEET, 0, 0, 0, 63.4, 63.85, 0 },      { EWA, 1, SHEET, 0, 0, 0, 55.3, 55.77, 0 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 55.3, 55.77, 0 }, { EWA, 0, SPLAT, 0, 0, 0, 68.1, 68.64, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 68.5, 68.98, 0 },       { EWA, 1, SLAB, 1, 0, 0, 55.8, 56.27, 0 },
};

static const struct manifest_row clip_box[] = {
    { EWA, 0, SHEET, 0, 0, 0, 64.3, 64.78, 0 },      { EWA, 1, SHEET, 0, 0, 0, 51.6, 52.05, 0 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 51.6, 52.05, 0 }, { EWA, 0, SPLAT, 0, 0, 0, 68.9, 69.37, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 69.6, 70.07, 0 },       { EWA, 1, SLAB, 1, 0, 0, 51.6, 52.07, 0 },
};

static const struct manifest_row clip_edge[] = {
    { EWA, 0, SHEET, 0, 0, 0, 52.1, 52.55, 0 },      { EWA, 1, SHEET, 0, 0, 0, 39.0, 39.45, 0 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 39.0, 39.45, 0 }, { EWA, 0, SPLAT, 0, 0, 0, 52.2, 52.71, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 52.2, 52.71, 0 },       { EWA, 1, SLAB, 1, 0, 0, 39.0, 39.46, 0 },
};

static const struct manifest_row clip_corner[] = {
    { EWA, 0, SHEET, 0, 0, 0, 66.8, 67.34, 0 },      { EWA, 1, SHEET, 0, 0, 0, 52.8, 53.32, 0 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 52.8, 53.32, 0 }, { EWA, 0, SPLAT, 0, 0, 0, 67.1, 67.61, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 69.0, 69.53, 0 },       { EWA, 1, SLAB, 1, 0, 0, 53.1, 53.60, 0 },
};

static const struct manifest_row cubic[] = {
    { EWA, 0, SHEET, 0, 0, 0, 72.9, 73.42, 0 },      { EWA, 1, SHEET, 0, 0, 0, 38.2, 38.73, 0 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 38.2, 38.73, 0 }, { EWA, 0, SPLAT, 0, 0, 0, 72.9, 73.42, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 72.9, 73.42, 0 },       { EWA, 1, SLAB, 1, 0, 0, 38.2, 38.73, 0 },
};

static const struct manifest_row gradient_axis[] = {
    { EWA, 0, SHEET, 0, 0, 0, 57.2, 57.69, 69.5 },      { EWA, 1, SHEET, 0, 0, 0, 45.9, 46.35, 61 },
    { ADAPTIVE, 1, SHEET, 0, 0, 0, 45.9, 46.35, 60.5 }, { EWA, 0, SPLAT, 0, 0, 0, 58.9, 59.43, 0 },
    { EWA, 0, SLAB, 1, 0, 0, 59.8, 60.32, 0 },          { EWA, 1, SLAB, 1, 0, 0, 45.8, 46.34, 0 },
};

static const struct manifest_row post_peak[] = {
    { EWA, 0, SLAB, 1, 0, 0, 52.3, 52.78, 0 },
    { EWA, 0, SLAB, 0.5, 0, 0, 53.6, 54.08, 0 },
    { EWA, 0, SLAB, 0.25, 0, 0, 53.6, 54.07, 0 },
    { RECONSTRUCTION, 0, SLAB, 0.25, 0, 0, 53.6, 54.07, 0 },
    { EWA, 0.3, SLAB, 0.5, 0, 0, 33.9, 34.40, 0 },
    { EWA, 1, SLAB, 0.5, 0, 0, 23.1, 23.60, 0 },
};

static const struct manifest_row post_lit[] = {
    { EWA, 0, SLAB, 1, 0, 0, 54.3, 54.81, 0 },
    { EWA, 0, SLAB, 0.5, 0, 0, 56.6, 57.07, 0 },
    { EWA, 0, SLAB, 0.25, 0, 0, 56.7, 57.19, 0 },
    { RECONSTRUCTION, 0, SLAB, 0.25, 0, 0, 56.7, 57.19, 0 },
    { EWA, 0.3, SLAB, 0.5, 0, 0, 36.3, 36.84, 0 },
    { EWA, 1, SLAB, 0.5, 0, 0, 25.7, 26.18, 0 },
};

#define SCENE(name, rows)                                                                          \
    { name, test_scene_##rows, rows, sizeof rows / sizeof *rows }

const struct manifest_scene manifest[] = {
    SCENE("constant-cube", constant_cube),
    SCENE("thin-shells", thin_shells),
    SCENE("anisotropic", anisotropic),
    SCENE("checkerboard", checkerboard),
    SCENE("phantom", phantom),
    SCENE("oblique", oblique),
    SCENE("blobs", blobs),
    SCENE("orthographic", orthographic),
    SCENE("rotated", rotated),
    SCENE("left-handed", left_handed),
    SCENE("sheared", sheared),
    SCENE("inside", inside),
    SCENE("wide-kernel", wide_kernel),
    SCENE("lit-shell", lit_shell),
    SCENE("layers", layers),
    SCENE("near-shell", near_shell),
    SCENE("rectilinear", rectilinear_blobs),
    SCENE("clip-plane", clip_plane),
    SCENE("clip-box", clip_box),
    SCENE("clip-edge", clip_edge),
    SCENE("clip-corner", clip_corner),
    SCENE("cubic", cubic),
    SCENE("gradient-axis", gradient_axis),
    SCENE("post-peak", post_peak),
    SCENE("post-lit", post_lit),
};
const size_t manifest_count = sizeof manifest / sizeof *manifest;

/* Name, projection, compositing, order, style, floor, measured, target_floor. */
const struct manifest_mixed manifest_mixed[] = {
    { "sheets post", SP_PERSPECTIVE, SHEET, SP_TF_POST, SP_VECTORS_MODULATE, 51.5, 52.03, 88.8 },
    { "sheets pre", SP_ORTHOGRAPHIC, SHEET, SP_TF_PRE, SP_VECTORS_BLEND, 48.7, 49.20, 89.9 },
    { "slabs", SP_PERSPECTIVE, SLAB, SP_TF_PRE, SP_VECTORS_MODULATE, 47.5, 48.06, 86.7 },
    { "splats", SP_ORTHOGRAPHIC, SPLAT, SP_TF_PRE, SP_VECTORS_MODULATE, 48.0, 48.57, 79.9 },
};
const size_t manifest_mixed_count = sizeof manifest_mixed / sizeof *manifest_mixed;
