// SPDX-License-Identifier: Apache-2.0
// A layer that is drawn splat by splat (struct constants of splat_layers.c), and the records of its splats: of a shell, of vectors
// (STREAKS), of points, of trained Gaussians (TRAINED). Lengths in cells.

layout(std430, binding = 1) readonly buffer Layer {
    vec4 steps[3];  // rows of C, base of u; clouds: from a position
    vec4 kernel[3]; // rows of K; points: depths of the parts of a kernel, one after the other
    vec4 view;      // scale, centre x, centre y [px], near
    vec4 filter_of; // h² [px²], Mahalanobis radius, cut, peak
    vec4 bounds;    // largest u0/u2, u1/u2; half of a flat footprint [standard deviations], gain
    vec4 cell;      // unit, least depth of opaque voxels, struct sp_voxel_frame: apart; clouds: size of a kernel
    uvec4 kind;     // flat, linear attenuation, rectilinear
    uvec4 rows;     // by axis: first row of coordinates; points: parts of a kernel
    vec4 streak_axes[3]; // STREAKS: world → camera space; points: [0] lowest number of colours, its scale, value of the lowest one, step of spreads
    vec4 streaks;      // the same: σ²·(stretch² − 1), length of a period, phase, 1 = blends; points: deviation of a part
    vec4 streak_color; // the same, of style blend
    vec4 eye;    // Gaussians: in the world of the data, or the direction of view there; opacity. Points: base of values; from a volume to cells
    uvec4 cloud; // elements, coefficients of the harmonics per colour, 1 = normalised; points: numbers per point that give its colour, points; pieces of the transfer function
    // Coordinates: place and local spacing of each sample. Or pieces: where it starts, red, green, blue, opacity, their slopes.
    uint layer_words[];
};

#ifndef RECORDS_ACCESS
#define RECORDS_ACCESS readonly
#endif
layout(std430, binding = 5) RECORDS_ACCESS buffer Records { vec4 records[]; };

const float DEPTH_MAX = 1e6, LOG2E = 1.44269504, TRAINED_OPACITY_MIN = 1.0 / 255.0, TRAINED_OPACITY_MAX = 0.99;
const uint RECORD_WORDS = STREAKS != 0 ? 5u : 4u; // of four

struct Splat {
    vec4 place; // x, y, a, b; flat: its box, columns [x, z) and rows [y, w)
    vec4 color; // shaded; u2
#if STREAKS
    vec2 shape; // c, optical depth at the centre
    vec4 turn;  // the map from pixels to standard deviations along and across the vector, row by row
    vec4 wave;  // periods per standard deviation, contrast, shift of rows [rows], phase [periods]
#else
    // c, optical depth at the centre; TRAINED: opacity. Kernels close to the eye (splat/close.h): ahead, the share w; around,
    // −1 − n·√S22. Then, of these, the record, whose fourth word is: struct sp_close, `more`, `area` and ρ².
    vec4 shape;
#endif
};

Splat read_splat(uint record) {
    uint at = RECORD_WORDS * record;
    Splat s;
    s.place = records[at];
    s.color = records[at + 1u];
#if STREAKS
    s.shape = records[at + 2u].xy;
    s.turn = records[at + 3u];
    s.wave = records[at + 4u];
#else
    s.shape = vec4(records[at + 2u].xyz, float(record));
#endif
    return s;
}
