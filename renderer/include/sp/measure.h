/* SPDX-License-Identifier: Apache-2.0
 *
 * Measurements in a volume: lengths, angles, values along a line, statistics of a region of a
 * plane, sizes of connected parts (sp/part.h) and paths on their surface. All points are world
 * positions, so the grid may be anisotropic, rotated or sheared.
 *
 * Value at a point: trilinear interpolation between the eight samples around it. The volume reaches
 * half a gap beyond its first and last sample of each axis. In these margins a point has the value
 * of the nearest point between samples. Farther outside, a point has no value. If a sample with a
 * weight above 0 is NaN or infinite, the value is not finite.
 *
 *   distance    a ─── b              rectangle  c────┐        ellipse     ╭──c──╮
 *   angle       a ─── b ⟍ c                     │    │                    │  a──b
 *   profile     a ∙∙∙∙∙ b                       a────b                    ╰─────╯
 *   path        a ╌╌╌╌╌ b
 *
 * Samples of a region:
 *   - If two axes of the grid lie in the plane of the region: one sample per grid sample whose
 *     centre is inside the region. Its value is interpolated between the two grid slices beside the
 *     plane. A centre on the border is inside. On a rectilinear grid, the weight of a sample is the
 *     area of its cell.
 *   - If the plane is oblique: the centres of nearly square cells, which divide both sides evenly
 *     (for an ellipse: the sides of the rectangle around it). The size of a cell is close to the
 *     smallest spacing of the grid.
 * Samples outside of the volume are not counted. NaN and infinite samples are counted separately
 * and otherwise ignored.
 *
 * A part and a path need all samples of the volume. A part has no value if no sample near its point
 * is in the range. A path has no value if its ends do not lie on the same part.
 */
#ifndef SP_MEASURE_H
#define SP_MEASURE_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/api.h"
#include "sp/part.h"
#include "sp/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

enum sp_measure_kind {
    SP_MEASURE_DISTANCE,  /* from a to b */
    SP_MEASURE_ANGLE,     /* at b, between the directions to a and c */
    SP_MEASURE_PROFILE,   /* the values from a to b */
    SP_MEASURE_RECTANGLE, /* corner a and the two corners next to it, b and c */
    SP_MEASURE_ELLIPSE,   /* the centre a and the ends of the two semi-axes, b and c */
    SP_MEASURE_MARKER,    /* the value at a */
    SP_MEASURE_PART,      /* the connected part at a */
    SP_MEASURE_PATH,      /* a shortest path from a to b on the surface of the part at a */
    SP_MEASURE_KINDS
};

enum {
    SP_MEASURE_POINTS = 3,             /* most points of a measurement */
    SP_MEASURE_SAMPLES = 1 << 22,      /* most samples of a region */
    SP_MEASURE_PART_SAMPLES = 1 << 28, /* most samples of a volume in which parts are measured */
    SP_MEASURE_BINS = 32,              /* bins of the histogram of a region */
    SP_MEASURE_PROFILE_SAMPLES = 4096  /* most samples of a profile */
};

struct sp_measure {
    enum sp_measure_kind kind;
    double points[SP_MEASURE_POINTS][3]; /* world; the first sp_measure_point_count() are used */
    double range[2]; /* of a part or a path: lowest and highest value, data unit; else unused */
};

enum sp_measure_unit {
    SP_MEASURE_DATA,   /* the unit of the samples */
    SP_MEASURE_LENGTH, /* the unit of world coordinates */
    SP_MEASURE_AREA,   /* its square */
    SP_MEASURE_VOLUME, /* its cube */
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
    /* False: a marker lies outside of the volume or on a value that is not finite; or there is no
     * part, or no path. */
    bool has_value;
    /* Length, angle in [0, 180], length of a profile or a path, area, value at a marker, volume. */
    double value;
    enum sp_measure_unit unit;
    /* Fraction of the line, of both arms or of the area that lies outside of the volume, [0, 1].
     * Marker: 0 or 1. Ellipse: exact to 0.0002. Part and path: 0, because they lie inside. Volume
     * of elements: 0. */
    double outside;
    bool has_statistics; /* profile, rectangle, ellipse */
    struct sp_statistics statistics;
    bool has_histogram; /* rectangle, ellipse, if count is above 0 */
    /* Finite samples by value: bins of equal width from min to max; the last one includes max. If
     * all values are equal, the first bin has all samples. */
    uint64_t histogram[SP_MEASURE_BINS];
    double area;      /* part: area of its surface, world unit² */
    bool is_open;     /* part: reaches the border of the volume, where no area is counted */
    uint64_t samples; /* part: samples in it */
    double straight;  /* path: straight distance between its ends, world units */
};

/* Returns "distance", "angle", "profile", "rectangle", "ellipse", "marker", "part" or "path". A
 * constant string. */
SP_API const char *sp_measure_kind_name(enum sp_measure_kind kind);
/* Returns how many points a measurement of the kind has, [1, SP_MEASURE_POINTS]. */
SP_API unsigned sp_measure_point_count(enum sp_measure_kind kind);
/* Returns the unit of the result of a kind. */
SP_API enum sp_measure_unit sp_measure_unit_of(enum sp_measure_kind kind);
/* True if a measurement of the kind has a range. */
SP_API bool sp_measure_has_range(enum sp_measure_kind kind);

/* Checks the points and the range, without a volume. SP_ERR_INVALID at "/points" or "/points/N": a
 * coordinate is not finite or above SP_POSITION_MAX; an arm of an angle or a side of a region has
 * no length; the sides of a region are not perpendicular (the cosine of their angle is above
 * 0.001). At
 * "/range": an end is not finite, or the lowest value is above the highest. Thread-safe. */
SP_API bool sp_measure_check(const struct sp_measure *measure, struct sp_error *err);

/* Returns an upper bound of the number of samples that sp_measure_compute() reads, for accounting
 * of time. The measurement must pass sp_measure_check(). Thread-safe. */
SP_API double sp_measure_cost(const struct sp_volume *volume, const struct sp_measure *measure);

/* Computes a measurement. Takes up to 50 ns per sample: 0.2 s at most for a region, and for a part
 * or a path up to 10 s. SP_ERR_INVALID: as sp_measure_check(); at "/kind", the kind needs a grid of
 * samples and the volume has none, or a part or a path is in a volume of more than
 * SP_MEASURE_PART_SAMPLES samples; at "/points", a region has more than SP_MEASURE_SAMPLES samples;
 * at "/range", the surface of a part needs more than SP_PART_AREA_BYTES. SP_ERR_MEMORY.
 * Thread-safe. */
SP_API bool sp_measure_compute(const struct sp_volume *volume, const struct sp_measure *measure,
                               struct sp_measure_result *result, struct sp_error *err);

/* Like sp_measure_compute() for a path, and also writes the points of the path. path->is_found is
 * true if the result has a value. Errors as sp_measure_compute(). Thread-safe. */
SP_API bool sp_measure_path(const struct sp_volume *volume, const struct sp_measure *measure,
                            struct sp_measure_result *result, struct sp_part_path *path,
                            struct sp_error *err);

/* Returns how many samples a profile has by default: about two per smallest spacing of the grid,
 * [2, 1024]. Thread-safe. */
SP_API uint32_t sp_measure_profile_count(const struct sp_volume *volume,
                                         const struct sp_measure *profile);
/* Computes `count` values at equal steps from a to b, both included: value i belongs to the point a
 * + (b − a)·i/(count − 1). count: at least 2. A value is NaN where the volume has no finite value.
 * Thread-safe. */
SP_API void sp_measure_profile(const struct sp_volume *volume, const struct sp_measure *profile,
                               uint32_t count, double *values);

/* Computes the value at a world position. False: the position is outside of the volume, and *value
 * is unchanged. Thread-safe. */
SP_API bool sp_measure_value(const struct sp_volume *volume, const double position[3],
                             double *value);

#ifdef __cplusplus
}
#endif

#endif
