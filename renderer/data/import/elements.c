/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/elements.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/neighbours.h"
#include "data/import/vectors.h"
#include "data/volume/curvilinear.h"

/* The normal of triangle i, as long as twice its area. False if a vertex does not exist. */
static bool compute_normal(const struct sp_elements *e, uint32_t i, double normal[3]) {
    const uint32_t *at = e->triangles[i];
    double edge[2][3];
    for (int k = 0; k < 3; k++)
        if (at[k] >= e->shape.vertex_count)
            return false;
    for (int a = 0; a < 3; a++) {
        edge[0][a] = (double)e->positions[at[1]][a] - (double)e->positions[at[0]][a];
        edge[1][a] = (double)e->positions[at[2]][a] - (double)e->positions[at[0]][a];
    }
    for (int a = 0; a < 3; a++)
        normal[a] = edge[0][(a + 1) % 3] * edge[1][(a + 2) % 3] -
                    edge[0][(a + 2) % 3] * edge[1][(a + 1) % 3];
    return true;
}

static void compute_normals(const struct sp_elements *e) {
    for (uint32_t i = 0; i < e->shape.count; i++) {
        const uint32_t *at = e->triangles[i];
        double normal[3];
        if (!compute_normal(e, i, normal))
            continue;
        for (int k = 0; k < 3; k++)
            for (int a = 0; a < 3; a++)
                e->normals[at[k]][a] += (float)normal[a];
    }
}

static uint64_t finish_blocks(const struct import_header *header,
                              const struct sp_elements *points) {
    uint64_t first = 0, folded = 0;
    for (uint32_t b = 0; b < header->block_count; b++) {
        const uint32_t *dims = header->blocks[b];
        folded += sp_curvilinear_finish(points, first, dims);
        first += (uint64_t)dims[0] * dims[1] * dims[2];
    }
    return folded;
}

static bool is_finite(const float *numbers, unsigned count) {
    for (unsigned i = 0; i < count; i++)
        if (!isfinite(numbers[i]))
            return false;
    return true;
}

/* True if an element has a number that keeps it from being drawn. */
static bool is_undrawn(const struct sp_elements *e, uint32_t i) {
    if (e->triangles) {
        for (int k = 0; k < 3; k++)
            if (e->triangles[i][k] < e->shape.vertex_count &&
                !is_finite(e->positions[e->triangles[i][k]], 3))
                return true;
        return false;
    }
    return !is_finite(e->positions[i], 3) || !is_finite(e->factors[i], 6) ||
           (e->values && !is_finite(&e->values[i], 1)) ||
           (e->opacities && !is_finite(&e->opacities[i], 1));
}

/* Gaussians whose colour is not finite are not drawn: light without a bound would hide the image.
 */
static void hide_colors(const struct sp_elements *e) {
    const uint32_t numbers = 3 * sp_harmonics_count(e->shape.degree);
    for (uint32_t i = 0; i < e->shape.count; i++)
        if (!is_finite(e->harmonics + (size_t)i * numbers, numbers))
            e->opacities[i] = NAN;
}

/* True if no triangle has an area. */
static bool is_flat(const struct sp_elements *e) {
    for (uint32_t i = 0; i < e->shape.count; i++) {
        double normal[3];
        if (!compute_normal(e, i, normal))
            continue;
        if (fabs(normal[0]) + fabs(normal[1]) + fabs(normal[2]) > 0)
            return false;
    }
    return e->shape.count > 0;
}

/* Warns of elements that are not drawn. Folded elements and elements that the file hides have a
 * warning of their own. */
static void warn(struct import_warnings *warnings, const struct sp_elements *e, uint64_t folded) {
    static const struct {
        const char *name, *reason;
    } kinds[SP_KIND_COUNT] = { [SP_KIND_POINTS] = { "points", "their position, value or size" },
                               [SP_KIND_GAUSSIANS] = { "Gaussians",
                                                       "their position, size, opacity or colour" },
                               [SP_KIND_MESH] = { "triangles", "the position of a corner" } };
    const char *name = kinds[e->shape.kind].name, *reason = kinds[e->shape.kind].reason;
    const uint32_t count = e->shape.count;
    uint64_t undrawn = 0;
    if (!warnings)
        return;
    if (count == 0)
        import_warn(warnings, "The file has no %s, so nothing is drawn.", name);
    for (uint32_t i = 0; i < count; i++)
        undrawn += is_undrawn(e, i);
    if (e->triangles && undrawn == 0 && is_flat(e))
        import_warn(warnings, "No triangle of the file has an area, so nothing is drawn.");
    if (folded)
        import_warn(warnings,
                    "%" PRIu64 " of the %" PRIu32 " nodes are not drawn, because their cells are "
                    "flat or turned inside out.",
                    folded, count);
    if (warnings->hidden)
        import_warn(warnings,
                    "%" PRIu64 " of the %" PRIu32 " nodes are not drawn, because the file marks "
                    "them as blank.",
                    warnings->hidden, count);
    if (undrawn > folded + warnings->hidden)
        import_warn(warnings,
                    "%" PRIu64 " of the %" PRIu32 " %s are not drawn, because %s is not a finite "
                    "number.",
                    undrawn - folded - warnings->hidden, count, name, reason);
}

/* Points without a size that are all at one place: their neighbours tell none. */
static void warn_of_one_place(struct import_warnings *warnings, const struct sp_elements *points) {
    const float *first = points->positions[0];
    uint32_t count = 0; /* positions that are not finite come last */
    for (; count < points->shape.count && isfinite(points->positions[count][0]) &&
           isfinite(points->positions[count][1]) && isfinite(points->positions[count][2]);
         count++)
        for (int a = 0; a < 3; a++)
            if (points->positions[count][a] < first[a] || points->positions[count][a] > first[a])
                return;
    if (count > 1)
        import_warn(warnings,
                    "All %" PRIu32 " points are at one place, (%g, %g, %g), so that their "
                    "distances give no size; they have a size of 1. Give variance_xx to "
                    "variance_zz and volume in a CSV or PLY file, or set the size of the layer.",
                    count, (double)first[0], (double)first[1], (double)first[2]);
}

/* Coloured points. */

/* The number of full colour. */
static double choose_color_most(const struct sp_elements *e) {
    double most = 1;
    for (size_t i = 0; i < 3 * (size_t)e->shape.count; i++) {
        const double number = (double)e->harmonics[i];
        if (isfinite(number) && number > most)
            most = number <= 255 ? 255 : 65535;
        if (most > 255)
            break;
    }
    return most;
}

/* Packs colours into the bits of the values of points, which the search for neighbours moves. */
static void pack_colors(const struct sp_elements *e, double most, float *values) {
    for (size_t i = 0; i < e->shape.count; i++) {
        uint8_t bytes[sizeof *values] = { 0 };
        for (size_t a = 0; a < 3; a++) {
            const double share = (double)e->harmonics[3 * i + a] / most;
            bytes[a] = (uint8_t)lround(255 * fmin(fmax(isnan(share) ? 0 : share, 0), 1));
        }
        memcpy(&values[i], bytes, sizeof bytes);
    }
}

static void unpack_colors(const struct sp_elements *e, const float *values) {
    static const double constant = 0.28209479177387814; /* the harmonic of degree 0 */
    for (size_t i = 0; i < e->shape.count; i++) {
        uint8_t bytes[sizeof *values];
        memcpy(bytes, &values[i], sizeof bytes);
        for (size_t a = 0; a < 3; a++)
            e->harmonics[3 * i + a] = (float)((bytes[a] / 255.0 - 0.5) / constant);
        e->opacities[i] = 1;
    }
}

/* Opaque points need less overlap than transparent ones, so that single ones can be told apart. */
static void shrink_kernels(const struct sp_elements *e) {
    for (size_t i = 0; i < e->shape.count; i++)
        for (int k = 0; k < 6; k++)
            e->factors[i][k] *= 0.5F;
}

/* Coloured points are opaque Gaussians. */
static bool finish_colors(const struct import_file *file, const struct import_header *header,
                          const struct sp_elements *e, const struct import_progress *progress,
                          struct sp_error *err) {
    const size_t count = e->shape.count ? e->shape.count : 1;
    const double most = header->color_most > 0 ? header->color_most : choose_color_most(e);
    struct sp_elements points = *e;
    points.shape = (struct sp_elements_shape){ .kind = SP_KIND_POINTS, .count = e->shape.count };
    points.values = malloc(count * sizeof *points.values);
    points.volumes = malloc(count * sizeof *points.volumes);
    bool ok = (points.values && points.volumes) ||
              sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for the colours");
    if (ok) {
        pack_colors(e, most, points.values);
        ok = header->has_factors || import_neighbours_finish(&points, progress, err);
    }
    if (ok) {
        unpack_colors(e, points.values);
        if (!header->has_factors)
            shrink_kernels(e);
        if (e->shape.count > 0 && !header->has_factors)
            warn_of_one_place(file->warnings, &points);
    }
    free(points.values);
    free(points.volumes);
    return ok;
}

/* Colours of a mesh, in [0, 1]. Floating-point numbers of a file may reach 255 instead; a little
 * more than 1 is light that is too bright. */
static void scale_colors(struct import_warnings *warnings, const struct sp_elements *e) {
    float most = 0;
    for (size_t i = 0; i < e->shape.vertex_count; i++)
        for (int k = 0; k < 4; k++)
            most = isfinite(e->colors[i][k]) ? fmaxf(most, e->colors[i][k]) : most;
    if (most > 2 && most <= 255) {
        bool has_alpha = false; /* also in [0, 255]; 1 is the alpha of files without one */
        for (size_t i = 0; i < e->shape.vertex_count; i++)
            has_alpha |= e->colors[i][3] > 1;
        for (size_t i = 0; i < e->shape.vertex_count; i++)
            for (int k = 0; k < 3 + has_alpha; k++)
                e->colors[i][k] /= 255;
    } else if (most > 1.001F) {
        import_warn(warnings,
                    "The colours have numbers up to %g, which are neither in [0, 1] nor in "
                    "[0, 255]; they were cut at 1.",
                    (double)most);
    }
}

bool import_elements_finish(const struct import_file *file, const struct import_header *header,
                            const struct sp_elements *elements,
                            const struct import_progress *progress, uint64_t *folded,
                            struct sp_error *err) {
    *folded = 0;
    if (elements->shape.kind == SP_KIND_MESH && !header->has_normals)
        compute_normals(elements);
    if (elements->shape.kind == SP_KIND_MESH)
        scale_colors(file->warnings, elements);
    if (header->are_colored_points && !finish_colors(file, header, elements, progress, err))
        return false;
    if (elements->shape.kind == SP_KIND_GAUSSIANS)
        hide_colors(elements);
    if (header->block_count) {
        *folded = finish_blocks(header, elements);
    } else if (elements->shape.kind == SP_KIND_POINTS && !header->has_factors) {
        if (!import_neighbours_finish(elements, progress, err))
            return false;
        if (elements->shape.count > 0)
            warn_of_one_place(file->warnings, elements);
    }
    warn(file->warnings, elements, *folded);
    if (elements->vectors && elements->shape.count > 0)
        import_vectors_warn(file, (const float(*)[3])elements->vectors, elements->shape.count);
    return true;
}
