/* SPDX-License-Identifier: Apache-2.0 */
#include "support/face.h"

#include <math.h>
#include <string.h>

#include "support/sample.h"

double test_face_range(const struct test_interpolant *f, const struct sp_transfer_function *tf) {
    const size_t count = (size_t)f->count[0] * (size_t)f->count[1] * (size_t)f->count[2];
    double low = INFINITY, high = -INFINITY, seen[2];
    uint32_t first = 0, last = tf->point_count - 1;
    for (size_t i = 0; i < count; i++) {
        low = fmin(low, f->values[i]);
        high = fmax(high, f->values[i]);
    }
    while (first < last && !(tf->points[first].opacity > 0))
        first++;
    while (last > first && !(tf->points[last].opacity > 0))
        last--;
    seen[0] = fmax(first > 0 ? tf->points[first - 1].value : low, low);
    seen[1] = fmin(tf->points[last + 1 < tf->point_count ? last + 1 : last].value, high);
    const double beyond = 16 * (seen[1] - seen[0]);
    return fmin(high, seen[1] + beyond) - fmax(low, seen[0] - beyond);
}

void test_face_enter(struct test_face *face, const struct test_interpolant *field,
                     const struct sp_transfer_function *tf, double range, const double eye[3],
                     const double ahead[3], double from) {
    const struct sp_grid *grid = field->grid;
    double index[3], move[3], inside[3], smallest = INFINITY, color[3], opacity;
    int axis = 0;
    *face = (struct test_face){ .begin = -INFINITY };
    for (int a = 0; a < 3; a++) {
        index[a] = move[a] = 0;
        for (int r = 0; r < 3; r++) {
            index[a] += field->inverse[a][r] / grid->spacing[a] * (eye[r] - grid->origin[r]);
            move[a] += field->inverse[a][r] / grid->spacing[a] * ahead[r];
        }
        smallest = fmin(smallest, grid->spacing[a]);
        double at = ((move[a] > 0 ? -0.5 : grid->dims[a] - 0.5) - index[a]) / move[a];
        if (move[a] != 0 && at > face->begin) {
            face->begin = at;
            axis = a;
        }
    }
    for (int a = 0; a < 3; a++) {
        inside[a] = index[a] + face->begin * move[a];
        if (inside[a] < -0.501 || inside[a] > grid->dims[a] - 0.499)
            return;
        inside[a] = fmin(fmax(inside[a], 0), grid->dims[a] - 1.0);
        face->normal[a] = field->inverse[axis][a];
    }
    if (face->begin < from)
        return;
    face->slice = 1 / fabs(move[field->slices]);
    test_classify(tf, test_interpolant_value(field, inside), 0, color, &opacity);
    opacity = 1 - pow(1 - opacity, face->slice / tf->reference_length);
    face->length = 4 * range * opacity / smallest;
}

double test_face_share(const struct test_face *face, double l, double square) {
    const double length = face->length * pow(4, -fmax(l - face->begin, 0) / face->slice);
    return length > 0 ? length * length / (length * length + square) : 0;
}
