/* SPDX-License-Identifier: Apache-2.0
 *
 * Measurements in a volume: lengths, angles, values along a line, statistics of a region of a
 * plane. All points are world positions, so that a grid may be anisotropic, rotated or sheared.
 *
 * Value at a point: trilinear interpolation between the eight samples around it. The volume reaches
 * half a gap beyond its first and last sample of each axis; there the value is that of the nearest
 * place between samples. Outside of that a point has no value. If a sample that takes part with a
 * weight above 0 is NaN or infinite, the value is not finite.
 *
 *   distance    a ─── b              rectangle  c────┐        ellipse     ╭──c──╮
 *   angle       a ─── b ⟍ c                     │    │                    │  a──b
 *   profile     a ∙∙∙∙∙ b                       a────b                    ╰─────╯
 *
 * Samples of a region:
 *   - If two axes of the grid lie in its plane, they are the samples of the grid whose centres are
 *     inside, with the value between the two slices of samples beside the plane. A centre on the
 *     border is inside. On a rectilinear grid each sample has the area of its cell as its weight.
 *   - If the plane is oblique, they are the centres of nearly square cells, which divide both sides
 *     evenly (for an ellipse: the sides of the rectangle around it). The size of a cell is close to
 *     the smallest spacing of the grid.
 * Samples outside of the volume are not counted. Samples that are not finite are counted on their
 * own and ignored otherwise.
 */
#ifndef SP_MEASURE_H
#define SP_MEASURE_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/api.h"
#include "sp/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

enum sp_measure_kind {
    SP_MEASURE_DISTANCE,  /* from a to b */
    SP_MEASURE_ANGLE,     /* at b, between the directions to a and c */
    SP_MEASURE_PROFILE,   /* the values from a to b */
    SP_MEASURE_RECTANGLE, /* a corner a and the two corners beside it, b and c */
    SP_MEASURE_ELLIPSE,   /* the centre a and the ends of the two semi-axes, b and c */
    SP_MEASURE_MARKER,    /* the value at a */
    SP_MEASURE_KINDS
};

enum {
    SP_MEASURE_POINTS = 3,            /* points of a measurement at most */
    SP_MEASURE_SAMPLES = 1 << 22,     /* samples of a region at most */
    SP_MEASURE_BINS = 32,             /* of the histogram of a region */
    SP_MEASURE_PROFILE_SAMPLES = 4096 /* samples of a profile at most */
};

struct sp_measure {
    enum sp_measure_kind kind;
    double points[SP_MEASURE_POINTS][3]; /* world; sp_measure_point_count() of them count */
};

enum sp_measure_unit {
    SP_MEASURE_DATA,   /* the unit of the samples */
    SP_MEASURE_LENGTH, /* the unit of world coordinates */
    SP_MEASURE_AREA,   /* its square */
    SP_MEASURE_DEGREES
};

struct sp_statistics {
    uint64_t count;     /* finite samples */
    uint64_t nonfinite; /* samples that are NaN or infinite */
    /* The fields below are 0 if count is 0. All are in data units. */
    double mean; /* weighted, if the samples have weights */
    /* Standard deviation, with the divisor count − 1; 0 if count is 1. With weights w, and m the
     * mean: √(Σ w(x − m)² ÷ (Σw − Σw² ÷ Σw)), which is the same if all weights are equal. */
    double deviation;
    double min, max;
};

struct sp_measure_result {
    bool has_value; /* false: a marker outside of the volume, or where the value is not finite */
    double value;   /* length, angle in [0, 180], length of a profile, area, value at a marker */
    enum sp_measure_unit unit;
    /* Share that lies outside of the volume, [0, 1]: of the line, of both arms, of the area; 0 or 1
     * of a marker. Of an ellipse within 0.0002. */
    double outside;
    bool has_statistics; /* profile, rectangle, ellipse */
    struct sp_statistics statistics;
    bool has_histogram; /* rectangle, ellipse, if count is above 0 */
    /* Finite samples by value: bins of equal width from min to max; the last one includes max. If
     * all values are equal, the first bin has all samples. */
    uint64_t histogram[SP_MEASURE_BINS];
};

/* Returns "distance", "angle", "profile", "rectangle", "ellipse" or "marker". A constant string. */
SP_API const char *sp_measure_kind_name(enum sp_measure_kind kind);
/* Returns how many points a measurement of the kind has, [1, SP_MEASURE_POINTS]. */
SP_API unsigned sp_measure_point_count(enum sp_measure_kind kind);

/* Checks the points, without a volume. SP_ERR_INVALID at "/points" or "/points/N": a coordinate is
 * not finite or above SP_POSITION_MAX; an arm of an angle or a side of a region has no length; the
 * sides of a region are not perpendicular (the cosine of their angle is above 0.001). Thread-safe.
 */
SP_API bool sp_measure_check(const struct sp_measure *measure, struct sp_error *err);

/* Returns an upper bound of the samples that sp_measure_compute() reads, for accounts of time; the
 * measurement must pass sp_measure_check(). Thread-safe. */
SP_API double sp_measure_cost(const struct sp_volume *volume, const struct sp_measure *measure);

/* Computes a measurement. Takes up to 50 ns per sample, thus 0.2 s at most. SP_ERR_INVALID: as
 * sp_measure_check(), and a region of more than SP_MEASURE_SAMPLES samples at "/points".
 * Thread-safe. */
SP_API bool sp_measure_compute(const struct sp_volume *volume, const struct sp_measure *measure,
                               struct sp_measure_result *result, struct sp_error *err);

/* Returns how many samples a profile has by default: about two per smallest spacing of the grid,
 * [2, 1024]. Thread-safe. */
SP_API uint32_t sp_measure_profile_count(const struct sp_volume *volume,
                                         const struct sp_measure *profile);
/* Gets `count` values at equal steps from a to b, both included: value i belongs to
 * a + (b − a)·i/(count − 1). 2 <= count. NaN where there is no finite value. Thread-safe. */
SP_API void sp_measure_profile(const struct sp_volume *volume, const struct sp_measure *profile,
                               uint32_t count, double *values);

/* Gets the value at a world position. False: the position is outside of the volume, and *value is
 * unchanged. Thread-safe. */
SP_API bool sp_measure_value(const struct sp_volume *volume, const double position[3],
                             double *value);

#ifdef __cplusplus
}
#endif

#endif
