/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/points.h"

#include <float.h>
#include <math.h>
#include <string.h>
#include <strings.h>

#include "data/import/shift.h"
#include "data/volume/curvilinear.h"

static const char *const position[] = { "x", "y", "z" };
/* Their names, the most usual ones first. */
static const char *const colors[][3] = { { "red", "green", "blue" },
                                         { "r", "g", "b" },
                                         { "diffuse_red", "diffuse_green", "diffuse_blue" } };
static const char *const variance[] = { "variance_xx", "variance_xy", "variance_yy",
                                        "variance_xz", "variance_yz", "variance_zz" };

/* Columns that say something else about a point. */
static const char *const others[] = { "x",
                                      "y",
                                      "z",
                                      "nx",
                                      "ny",
                                      "nz",
                                      "normal_x",
                                      "normal_y",
                                      "normal_z",
                                      "r",
                                      "g",
                                      "b",
                                      "a",
                                      "alpha",
                                      "red",
                                      "green",
                                      "blue",
                                      "texture_u",
                                      "texture_v",
                                      "diffuse_red",
                                      "diffuse_green",
                                      "diffuse_blue",
                                      "diffuse_alpha",
                                      "ambient_red",
                                      "ambient_green",
                                      "ambient_blue",
                                      "specular_red",
                                      "specular_green",
                                      "specular_blue",
                                      "variance_xx",
                                      "variance_xy",
                                      "variance_yy",
                                      "variance_xz",
                                      "variance_yz",
                                      "variance_zz",
                                      "volume" };

static int find_name(const char *const *names, unsigned count, const char *name) {
    for (unsigned i = 0; i < count; i++)
        if (names[i] && strcasecmp(names[i], name) == 0)
            return (int)i;
    return -1;
}

/* True if the column is a texture coordinate: "u" beside "v", or "s" beside "t". */
static bool is_texture(const char *const *names, unsigned count, const char *name) {
    static const char *const pairs[][2] = { { "u", "v" }, { "s", "t" } };
    for (int p = 0; p < 2; p++)
        if (find_name(pairs[p], 2, name) >= 0)
            return find_name(names, count, pairs[p][0]) >= 0 &&
                   find_name(names, count, pairs[p][1]) >= 0;
    return false;
}

static bool is_scalar(const char *const *names, unsigned count, const char *name) {
    return name && find_name(others, sizeof others / sizeof *others, name) < 0 &&
           !is_texture(names, count, name);
}

static int find_scalar(const char *const *names, unsigned count, const char *field) {
    static const char *const best[] = { "value", "scalar", "intensity" };
    enum { BEST = sizeof best / sizeof *best };
    if (*field && find_name(names, count, field) >= 0)
        return find_name(names, count, field);
    for (int i = 0; i < BEST; i++)
        if (find_name(names, count, best[i]) >= 0)
            return find_name(names, count, best[i]);
    for (unsigned i = 0; i < count; i++)
        if (is_scalar(names, count, names[i]))
            return (int)i;
    return -1;
}

static bool find_colors(const char *const *names, unsigned count, int color[3]) {
    for (size_t i = 0; i < sizeof colors / sizeof *colors; i++) {
        bool has_all = true;
        for (int a = 0; a < 3; a++)
            has_all &= (color[a] = find_name(names, count, colors[i][a])) >= 0;
        if (has_all)
            return true;
    }
    return false;
}

bool import_columns_find(const struct import_file *file, const char *const *names, unsigned count,
                         struct import_columns *columns) {
    const char *field = file->field;
    columns->shift = file->shift;
    for (int a = 0; a < 3; a++)
        if ((columns->position[a] = find_name(names, count, position[a])) < 0)
            return false;
    columns->scalar = find_scalar(names, count, field);
    if (!find_colors(names, count, columns->color) ||
        (columns->scalar >= 0 && strcasecmp(field, "colors") != 0))
        columns->color[0] = -1;
    columns->volume = find_name(names, count, "volume");
    for (int k = 5; k >= 0; k--)
        if ((columns->variance[k] = find_name(names, count, variance[k])) < 0)
            columns->variance[0] = -1;
    for (int k = 1; k < 6; k++)
        if (columns->variance[k] < 0)
            columns->variance[0] = -1;
    return true;
}

void import_columns_use(const struct import_columns *columns, const char *const *names,
                        unsigned count, uint32_t points, struct import_header *header) {
    const bool has_colors = columns->color[0] >= 0;
    int color[3];
    import_header_use_elements(
        header, &(struct sp_elements_shape){
                    .kind = has_colors ? SP_KIND_GAUSSIANS : SP_KIND_POINTS, .count = points });
    header->has_factors = columns->variance[0] >= 0;
    header->are_colored_points = has_colors;
    if (has_colors)
        import_name(header->value_name, "colors");
    else if (columns->scalar >= 0)
        import_name(header->value_name, names[columns->scalar]);
    if (!has_colors && find_colors(names, count, color))
        import_header_add_other(header, "colors");
    for (unsigned i = 0; i < count; i++)
        if ((has_colors || (int)i != columns->scalar) && is_scalar(names, count, names[i]))
            import_header_add_other(header, names[i]);
}

/* Cholesky of a variance that may be singular. False if it is no variance: not finite, or with a
 * negative eigenvalue beyond what rounding explains. */
static bool factor(const double v[6], float out[6], double *determinant) {
    double l[6];
    const double trace = v[0] + v[2] + v[5], slack = 1e-5 * fabs(trace);
    l[0] = sqrt(fmax(v[0], 0));
    l[1] = l[0] > 0 ? v[1] / l[0] : 0;
    const double second = v[2] - l[1] * l[1];
    l[2] = sqrt(fmax(second, 0));
    l[3] = l[0] > 0 ? v[3] / l[0] : 0;
    l[4] = l[2] > 0 ? (v[4] - l[3] * l[1]) / l[2] : 0;
    const double third = v[5] - l[3] * l[3] - l[4] * l[4];
    l[5] = sqrt(fmax(third, 0));
    for (int k = 0; k < 6; k++)
        out[k] = (float)l[k];
    *determinant = l[0] * l[2] * l[5];
    const bool is_coupled = l[0] > 0 || (fabs(v[1]) <= slack && fabs(v[3]) <= slack);
    return isfinite(trace) && isfinite(v[1] + v[3] + v[4]) && v[0] >= -slack && second >= -slack &&
           third >= -slack && is_coupled;
}

void import_columns_copy(const struct import_columns *columns, const double *row,
                         const struct sp_elements *points, uint32_t i) {
    for (int a = 0; a < 3; a++)
        points->positions[i][a] = import_shift_put(columns->shift, a, row[columns->position[a]]);
    for (int a = 0; a < 3 && points->harmonics; a++)
        points->harmonics[3 * (size_t)i + (size_t)a] = (float)row[columns->color[a]];
    if (points->values)
        points->values[i] = columns->scalar >= 0 ? (float)row[columns->scalar] : 1;
    if (columns->variance[0] < 0)
        return;
    double v[6];
    for (int k = 0; k < 6; k++)
        v[k] = row[columns->variance[k]];
    double determinant;
    const bool is_variance = factor(v, points->factors[i], &determinant);
    const double volume =
        columns->volume >= 0 ? row[columns->volume] : determinant / pow(SP_CURVILINEAR_SIGMA, 3);
    if (!is_variance || !(volume > 0)) { /* it is not drawn, and counts as not finite */
        *(points->values ? &points->values[i] : &points->positions[i][0]) = NAN;
        memset(points->factors[i], 0, sizeof points->factors[i]);
    }
    if (points->volumes)
        points->volumes[i] = (float)fmin(fmax(volume, (double)FLT_MIN), (double)FLT_MAX);
}
