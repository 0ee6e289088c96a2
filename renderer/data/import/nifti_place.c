/* SPDX-License-Identifier: Apache-2.0
 *
 * The place of a NIfTI file in the world: the sform if it is one, else the qform, else the spacing
 * alone. Nibabel also takes the sform first; ITK prefers the qform where the sform is not
 * orthogonal, and SPM the sform.
 */
#include <math.h>
#include <string.h>

#include "data/import/nifti_header.h"
#include "data/volume/grid.h"

/* The directions that a quaternion turns the axes into (nifti1.h, method 2). */
static void turn(const struct nifti_fields *f, double direction[3][3]) {
    double b = f->quaternion[0], c = f->quaternion[1], d = f->quaternion[2];
    double a = 1 - (b * b + c * c + d * d);
    if (a < 1e-7) { /* a half turn, apart from rounding */
        const double length = sqrt(b * b + c * c + d * d);
        a = 0;
        b /= length;
        c /= length;
        d /= length;
    } else {
        a = sqrt(a);
    }
    const double third = f->pixdim[0] < 0 ? -1 : 1;
    const double rows[3][3] = {
        { a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c) * third },
        { 2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b) * third },
        { 2 * (b * d - a * c), 2 * (c * d + a * b), (a * a + d * d - c * c - b * b) * third },
    };
    memcpy(direction, rows, sizeof rows);
}

/* An affine map: columns are the steps along the axes, the last one is the origin. */
struct map {
    double rows[3][4];
};

static double length_of(const struct map *m, int axis) {
    return hypot(hypot(m->rows[0][axis], m->rows[1][axis]), m->rows[2][axis]);
}

/* True if every step has a length, and the three span a volume. */
static bool is_sound(const struct map *m) {
    struct sp_mat3 unit;
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 4; column++)
            if (!isfinite(m->rows[row][column]))
                return false;
    for (int axis = 0; axis < 3; axis++) {
        const double length = length_of(m, axis);
        if (!(length > 0))
            return false;
        for (int row = 0; row < 3; row++)
            unit.m[row][axis] = m->rows[row][axis] / length;
    }
    return fabs(sp_mat3_determinant(&unit)) > 1e-4;
}

static struct map map_of_sform(const struct nifti_fields *f) {
    struct map m;
    memcpy(m.rows, f->rows, sizeof m.rows);
    return m;
}

static struct map map_of_qform(const struct nifti_fields *f, const double spacing[3]) {
    struct map m;
    double direction[3][3];
    turn(f, direction);
    for (int row = 0; row < 3; row++) {
        for (int axis = 0; axis < 3; axis++)
            m.rows[row][axis] = direction[row][axis] * spacing[axis];
        m.rows[row][3] = f->shift[row];
    }
    return m;
}

/* The largest distance between the places that two maps give to a corner of the grid, in the
 * smallest step of the first one. */
static double difference(const struct map *a, const struct map *b, const uint32_t dims[3]) {
    double most = 0, step = fmin(length_of(a, 0), fmin(length_of(a, 1), length_of(a, 2)));
    for (unsigned corner = 0; corner < 8; corner++) {
        double distance[3];
        for (int row = 0; row < 3; row++) {
            distance[row] = a->rows[row][3] - b->rows[row][3];
            for (int axis = 0; axis < 3; axis++)
                if (corner >> axis & 1)
                    distance[row] += (a->rows[row][axis] - b->rows[row][axis]) * (dims[axis] - 1);
        }
        most = fmax(most, hypot(hypot(distance[0], distance[1]), distance[2]));
    }
    return most / step;
}

static void use_map(const struct map *m, struct import_header *header) {
    struct sp_grid *grid = &header->grid;
    for (int axis = 0; axis < 3; axis++) {
        grid->spacing[axis] = length_of(m, axis);
        for (int row = 0; row < 3; row++)
            grid->direction[row][axis] = m->rows[row][axis] / grid->spacing[axis];
        grid->origin[axis] = m->rows[axis][3];
    }
    import_header_set_anatomy(header, "RAS");
}

void nifti_place(const struct import_file *file, const struct nifti_fields *f,
                 struct import_header *header) {
    double *spacing = header->grid.spacing;
    bool is_guessed = false;
    for (int axis = 0; axis < 3; axis++) {
        spacing[axis] = fabs(f->pixdim[axis + 1]);
        if (!(spacing[axis] > 0) || !isfinite(spacing[axis])) {
            is_guessed |= axis + 1 <= (int)f->dims[0];
            spacing[axis] = 1;
        }
    }
    const struct map sform = map_of_sform(f), qform = map_of_qform(f, spacing);
    const bool has_sform = f->sform > 0 && is_sound(&sform);
    const bool has_qform = f->qform > 0 && is_sound(&qform);
    if (f->sform > 0 && !has_sform)
        import_warn(file->warnings, "The sform is no map of the samples to the world, so %s.",
                    has_qform ? "the qform is used" : "only the spacing is used");
    else if (f->qform > 0 && !has_qform && !has_sform)
        import_warn(file->warnings, "The qform is no rotation, so only the spacing is used.");
    if (has_sform && has_qform && difference(&sform, &qform, header->grid.dims) > 0.5)
        import_warn(file->warnings, "The sform and the qform place the samples differently; the "
                                    "sform is used. Other programs may use the qform.");
    if (has_sform || has_qform)
        use_map(has_sform ? &sform : &qform, header);
    if (is_guessed && !has_sform)
        import_warn(file->warnings,
                    "The spacing of an axis is 0 or no number (pixdim); it is taken as 1.");
}
