/* SPDX-License-Identifier: Apache-2.0
 *
 * Measurements of all kinds. region.c has the measurements of regions, part/ the measurements of
 * parts.
 */
#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/vec.h"
#include "data/volume/grid.h"
#include "data/volume/interpolate.h"
#include "inspect/measure/outside.h"
#include "inspect/measure/region.h"
#include "inspect/measure/statistics.h"
#include "sp/measure.h"

#define PERPENDICULAR 1e-3 /* largest cosine between the sides of a region */
#define SHORTEST 1e-40     /* length of a line that is no point; its fourth power is a double */
#define DEGREES (180 / 3.14159265358979323846)
static const char *const ordinals[SP_MEASURE_POINTS] = { "first", "second", "third" };
enum { PROFILE_DEFAULT_MAX = 1024 };

static const struct {
    const char *name;
    unsigned points;
    enum sp_measure_unit unit;
} kinds[SP_MEASURE_KINDS] = {
    [SP_MEASURE_DISTANCE] = { "distance", 2, SP_MEASURE_LENGTH },
    [SP_MEASURE_ANGLE] = { "angle", 3, SP_MEASURE_DEGREES },
    [SP_MEASURE_PROFILE] = { "profile", 2, SP_MEASURE_LENGTH },
    [SP_MEASURE_RECTANGLE] = { "rectangle", 3, SP_MEASURE_AREA },
    [SP_MEASURE_ELLIPSE] = { "ellipse", 3, SP_MEASURE_AREA },
    [SP_MEASURE_MARKER] = { "marker", 1, SP_MEASURE_DATA },
    [SP_MEASURE_PART] = { "part", 1, SP_MEASURE_VOLUME },
    [SP_MEASURE_PATH] = { "path", 2, SP_MEASURE_LENGTH },
};

const char *sp_measure_kind_name(enum sp_measure_kind kind) {
    assert(kind < SP_MEASURE_KINDS);
    return kinds[kind].name;
}

unsigned sp_measure_point_count(enum sp_measure_kind kind) {
    assert(kind < SP_MEASURE_KINDS);
    return kinds[kind].points;
}

enum sp_measure_unit sp_measure_unit_of(enum sp_measure_kind kind) {
    assert(kind < SP_MEASURE_KINDS);
    return kinds[kind].unit;
}

bool sp_measure_has_range(enum sp_measure_kind kind) {
    return kind == SP_MEASURE_PART || kind == SP_MEASURE_PATH;
}

static bool has_plane(enum sp_measure_kind kind) {
    return kind == SP_MEASURE_RECTANGLE || kind == SP_MEASURE_ELLIPSE;
}

/* Returns the vector between two points. */
static struct sp_vec3 between(const struct sp_measure *measure, unsigned from, unsigned to) {
    return sp_vec3_sub(sp_vec3_from(measure->points[to]), sp_vec3_from(measure->points[from]));
}

static bool check_coordinates(const struct sp_measure *measure, struct sp_error *err) {
    for (unsigned i = 0; i < kinds[measure->kind].points; i++)
        for (unsigned axis = 0; axis < 3; axis++) {
            char place[32];
            snprintf(place, sizeof place, "/points/%u/%u", i, axis);
            if (!(fabs(measure->points[i][axis]) <= SP_POSITION_MAX))
                return sp_fail(err, SP_ERR_INVALID, place, "%g is outside [-%g, %g]",
                               measure->points[i][axis], SP_POSITION_MAX, SP_POSITION_MAX);
        }
    return true;
}

/* Checks the two lines that meet in point `corner` and end in the other two points. */
static bool check_lines(const struct sp_measure *measure, unsigned corner, const char *what,
                        struct sp_error *err) {
    for (unsigned i = 0; i < 3; i++) {
        char place[16];
        snprintf(place, sizeof place, "/points/%u", i);
        if (i != corner && !(sp_vec3_length(between(measure, corner, i)) > SHORTEST))
            return sp_fail(err, SP_ERR_INVALID, place,
                           "the %s point is the same as the %s one, so that %s has no length",
                           ordinals[i], ordinals[corner], what);
    }
    return true;
}

static bool check_range(const struct sp_measure *measure, struct sp_error *err) {
    const double *range = measure->range;
    return (isfinite(range[0]) && isfinite(range[1]) && range[0] <= range[1]) ||
           sp_fail(err, SP_ERR_INVALID, "/range",
                   "the lowest value %g is above the highest one %g, or one is not finite",
                   range[0], range[1]);
}

bool sp_measure_check(const struct sp_measure *measure, struct sp_error *err) {
    if (!check_coordinates(measure, err) ||
        (sp_measure_has_range(measure->kind) && !check_range(measure, err)))
        return false;
    if (measure->kind == SP_MEASURE_ANGLE)
        return check_lines(measure, 1, "an arm of the angle", err);
    if (!has_plane(measure->kind))
        return true;
    if (!check_lines(measure, 0, "a side of the region", err))
        return false;
    const double cosine = sp_vec3_dot(sp_vec3_normalize(between(measure, 0, 1)),
                                      sp_vec3_normalize(between(measure, 0, 2)));
    return fabs(cosine) <= PERPENDICULAR ||
           sp_fail(err, SP_ERR_INVALID, "/points",
                   "the sides from the first point to the second and the third are not "
                   "perpendicular: the cosine of their angle is %g, and %g is allowed",
                   cosine, PERPENDICULAR);
}

static double sample_count(const struct sp_volume *volume) {
    const uint32_t *dims = sp_volume_info(volume)->grid.dims;
    return (double)dims[0] * dims[1] * dims[2];
}

double sp_measure_cost(const struct sp_volume *volume, const struct sp_measure *measure) {
    return sp_measure_has_range(measure->kind)   ? sample_count(volume)
           : has_plane(measure->kind)            ? sp_region_cost(volume, measure)
           : measure->kind == SP_MEASURE_PROFILE ? sp_measure_profile_count(volume, measure)
                                                 : 1;
}

/* By the arctangent, which is also exact near 0 and 180 degrees. */
static double angle_of(const struct sp_measure *measure) {
    const struct sp_vec3 a = sp_vec3_normalize(between(measure, 1, 0)),
                         c = sp_vec3_normalize(between(measure, 1, 2));
    return atan2(sp_vec3_length(sp_vec3_cross(a, c)), sp_vec3_dot(a, c)) * DEGREES;
}

static double area_of(const struct sp_measure *measure) {
    const double product =
        sp_vec3_length(sp_vec3_cross(between(measure, 0, 1), between(measure, 0, 2)));
    return measure->kind == SP_MEASURE_ELLIPSE ? product * 3.14159265358979323846 : product;
}

/* The statistics of a profile count its default samples. Samples outside of the volume have no
 * value and do not count. */
static void profile_statistics(const struct sp_volume *volume, const struct sp_measure *profile,
                               struct sp_statistics *statistics) {
    struct sp_interpolator interpolator;
    struct sp_sums sums = { 0 };
    struct sp_run run = { .count = 0 };
    const struct sp_vec3 line = between(profile, 0, 1);
    const uint32_t count = sp_measure_profile_count(volume, profile);
    sp_interpolator_init(&interpolator, volume);
    for (uint32_t i = 0; i < count; i++) {
        const struct sp_vec3 p = sp_vec3_add(sp_vec3_from(profile->points[0]),
                                             sp_vec3_scale(line, (double)i / (count - 1)));
        run.weights[run.count] = 1;
        run.count += sp_interpolator_at(&interpolator, p.v, &run.values[run.count]);
        if (run.count == SP_RUN || i + 1 == count) {
            sp_sums_add(&sums, &run);
            run.count = 0;
        }
    }
    sp_sums_finish(&sums, statistics);
}

static bool check_samples(const struct sp_volume *volume, struct sp_error *err) {
    return sample_count(volume) <= SP_MEASURE_PART_SAMPLES ||
           sp_fail(err, SP_ERR_INVALID, "/kind",
                   "the volume has %.0f samples, and a part is measured in at most %d; load a "
                   "smaller or a coarser volume",
                   sample_count(volume), SP_MEASURE_PART_SAMPLES);
}

static struct sp_part part_of(const struct sp_measure *measure) {
    struct sp_part part;
    memcpy(part.point, measure->points[0], sizeof part.point);
    memcpy(part.range, measure->range, sizeof part.range);
    return part;
}

static bool measure_part(const struct sp_volume *volume, const struct sp_measure *measure,
                         struct sp_measure_result *result, struct sp_error *err) {
    const struct sp_part part = part_of(measure);
    struct sp_part_size size;
    struct sp_error why;
    if (!check_samples(volume, err))
        return false;
    if (!sp_part_measure(volume, &part, &size, &why))
        return why.code == SP_ERR_BUDGET
                   ? sp_fail(
                         err, SP_ERR_INVALID, "/range",
                         "%s: the volume is too noisy at an end of the range; choose other ends",
                         why.text)
                   : sp_fail(err, why.code, why.place, "%s", why.text);
    result->has_value = size.is_found;
    result->value = size.volume;
    result->area = size.area;
    result->samples = size.samples;
    result->is_open = size.is_open;
    return true;
}

/* Values along lines and in regions, and parts of them, need samples. */
static bool check_grid(const struct sp_volume *volume, enum sp_measure_kind kind,
                       struct sp_error *err) {
    const enum sp_kind has = sp_volume_info(volume)->elements.kind;
    const bool needs_grid =
        kind == SP_MEASURE_PROFILE || has_plane(kind) || sp_measure_has_range(kind);
    return !needs_grid || has == SP_KIND_GRID ||
           sp_fail(err, SP_ERR_INVALID, "/kind",
                   "%s needs a grid of samples, and this volume has %s; distance, angle and "
                   "marker do not",
                   sp_measure_kind_name(kind), sp_kind_name(has));
}

bool sp_measure_path(const struct sp_volume *volume, const struct sp_measure *measure,
                     struct sp_measure_result *result, struct sp_part_path *path,
                     struct sp_error *err) {
    const struct sp_part part = part_of(measure);
    assert(measure->kind == SP_MEASURE_PATH);
    *result = (struct sp_measure_result){ .unit = SP_MEASURE_LENGTH };
    if (!sp_measure_check(measure, err) || !check_grid(volume, measure->kind, err) ||
        !check_samples(volume, err) ||
        !sp_part_find_path(volume, &part, measure->points[1], path, err))
        return false;
    result->has_value = path->is_found;
    result->value = path->length;
    result->straight = path->straight;
    return true;
}

static bool measure_path_alone(const struct sp_volume *volume, const struct sp_measure *measure,
                               struct sp_measure_result *result, struct sp_error *err) {
    struct sp_part_path *path = malloc(sizeof *path);
    const bool ok = path ? sp_measure_path(volume, measure, result, path, err)
                         : sp_fail(err, SP_ERR_MEMORY, "", "out of memory for a path");
    free(path);
    return ok;
}

bool sp_measure_compute(const struct sp_volume *volume, const struct sp_measure *measure,
                        struct sp_measure_result *result, struct sp_error *err) {
    *result =
        (struct sp_measure_result){ .has_value = true, .unit = sp_measure_unit_of(measure->kind) };
    if (!sp_measure_check(measure, err) || !check_grid(volume, measure->kind, err))
        return false;
    result->outside = sp_measure_outside(volume, measure);
    switch (measure->kind) {
    case SP_MEASURE_PROFILE:
        result->has_statistics = true;
        profile_statistics(volume, measure, &result->statistics);
        result->value = sp_vec3_length(between(measure, 0, 1));
        break;
    case SP_MEASURE_DISTANCE:
        result->value = sp_vec3_length(between(measure, 0, 1));
        break;
    case SP_MEASURE_ANGLE:
        result->value = angle_of(measure);
        break;
    case SP_MEASURE_RECTANGLE:
    case SP_MEASURE_ELLIPSE:
        result->value = area_of(measure);
        return sp_region_compute(volume, measure, result, err);
    case SP_MEASURE_MARKER:
        result->has_value =
            sp_measure_value(volume, measure->points[0], &result->value) && isfinite(result->value);
        break;
    case SP_MEASURE_PART:
        return measure_part(volume, measure, result, err);
    case SP_MEASURE_PATH:
        return measure_path_alone(volume, measure, result, err);
    case SP_MEASURE_KINDS:
        assert(false);
    }
    return true;
}

uint32_t sp_measure_profile_count(const struct sp_volume *volume,
                                  const struct sp_measure *profile) {
    const double *spacing = sp_volume_info(volume)->grid.spacing;
    const double step = fmin(spacing[0], fmin(spacing[1], spacing[2])) / 2;
    const double steps = ceil(sp_vec3_length(between(profile, 0, 1)) / step);
    return (uint32_t)fmin(steps + 1, PROFILE_DEFAULT_MAX) < 2
               ? 2
               : (uint32_t)fmin(steps + 1, PROFILE_DEFAULT_MAX);
}

void sp_measure_profile(const struct sp_volume *volume, const struct sp_measure *profile,
                        uint32_t count, double *values) {
    struct sp_interpolator interpolator;
    assert(count >= 2);
    sp_interpolator_init(&interpolator, volume);
    for (uint32_t i = 0; i < count; i++) {
        const struct sp_vec3 p =
            sp_vec3_add(sp_vec3_from(profile->points[0]),
                        sp_vec3_scale(between(profile, 0, 1), (double)i / (count - 1)));
        if (!sp_interpolator_at(&interpolator, p.v, &values[i]) || !isfinite(values[i]))
            values[i] = NAN;
    }
}

bool sp_measure_value(const struct sp_volume *volume, const double position[3], double *value) {
    struct sp_interpolator interpolator;
    sp_interpolator_init(&interpolator, volume);
    return sp_interpolator_at(&interpolator, position, value);
}
