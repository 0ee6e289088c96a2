/* SPDX-License-Identifier: Apache-2.0 */
#include "support/lit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "support/sample.h"

static const double disc_radius = 0.07; /* sine of 4° */
static const double golden_angle = 2.399963229728653;

/* Points on a sphere and on the light's disc, evenly along a spiral. */
static void list_directions(struct test_lit *lit) {
    double d[3] = { 0, 0, 1 }, u[3] = { 0 }, v[3], length = 0;
    for (int i = 0; i < TEST_LIT_AROUND; i++) {
        double z = (2 * i + 1.0) / TEST_LIT_AROUND - 1, r = sqrt(1 - z * z);
        double turned[3] = { r * cos(i * golden_angle), r * sin(i * golden_angle), z };
        memcpy(lit->around[i], turned, sizeof turned);
    }
    if (lit->view->shading.light_count)
        test_light_direction(lit->view, 0, d);
    int least = fabs(d[0]) < fabs(d[1]) ? 0 : 1;
    least = fabs(d[2]) < fabs(d[least]) ? 2 : least;
    u[(least + 1) % 3] = d[(least + 2) % 3];
    u[(least + 2) % 3] = -d[(least + 1) % 3];
    for (int a = 0; a < 3; a++)
        length += u[a] * u[a];
    for (int a = 0; a < 3; a++)
        u[a] /= sqrt(length);
    for (int a = 0; a < 3; a++)
        v[a] = d[(a + 1) % 3] * u[(a + 2) % 3] - d[(a + 2) % 3] * u[(a + 1) % 3];
    for (int i = 0; i < TEST_LIT_DISC; i++) {
        double r = disc_radius * sqrt((i + 0.5) / TEST_LIT_DISC), norm = 0;
        for (int a = 0; a < 3; a++) {
            lit->disc[i][a] =
                d[a] + r * (cos(i * golden_angle) * u[a] + sin(i * golden_angle) * v[a]);
            norm += lit->disc[i][a] * lit->disc[i][a];
        }
        for (int a = 0; a < 3; a++)
            lit->disc[i][a] /= sqrt(norm);
    }
}

/* Extinction at evenly spaced values of the volume's range. */
static bool fill_depths(struct test_lit *lit, double low, double high) {
    const struct sp_transfer_function *tf = &lit->view->transfer_function;
    lit->low = low;
    lit->per_unit = high > low ? (TEST_LIT_VALUES - 1) / (high - low) : 0;
    lit->depth = malloc((TEST_LIT_VALUES + 1) * sizeof *lit->depth);
    for (int i = 0; lit->depth && i <= TEST_LIT_VALUES; i++) {
        double color[3], opacity;
        double value = low + (high - low) * i / (TEST_LIT_VALUES - 1);
        test_classify(tf, fmin(value, high), 0, color, &opacity);
        lit->depth[i] = -log1p(-opacity) / tf->reference_length;
    }
    return lit->depth;
}

/* Marks the cells where a value between the values at the eight corners is visible. */
static bool mark_visible(struct test_lit *lit) {
    const struct test_interpolant *f = lit->field;
    const int *n = f->count;
    const size_t count = (size_t)n[0] * (size_t)n[1] * (size_t)n[2];
    double least = INFINITY, most = -INFINITY;
    size_t at = 0;
    for (size_t i = 0; i < count; i++) {
        least = fmin(least, f->values[i]);
        most = fmax(most, f->values[i]);
    }
    lit->visible = calloc(count, 1);
    if (!lit->visible || !fill_depths(lit, least, most))
        return false;
    int seen[TEST_LIT_VALUES + 1] = { 0 }; /* visible entries below */
    for (int i = 0; i < TEST_LIT_VALUES; i++)
        seen[i + 1] = seen[i] + (lit->depth[i] > 0);
    for (int z = 0; z < n[2]; z++)
        for (int y = 0; y < n[1]; y++)
            for (int x = 0; x < n[0]; x++, at++) {
                double low = INFINITY, high = -INFINITY;
                for (int k = 0; k < 8; k++) {
                    int i = x + (x + 1 < n[0] ? k & 1 : 0), j = y + (y + 1 < n[1] ? k >> 1 & 1 : 0);
                    int l = z + (z + 1 < n[2] ? k >> 2 : 0);
                    double value = f->values[(l * n[1] + j) * n[0] + i];
                    low = fmin(low, value);
                    high = fmax(high, value);
                }
                int first = (int)((low - least) * lit->per_unit);
                int last = (int)ceil((high - least) * lit->per_unit);
                lit->visible[at] =
                    seen[last + 1 < TEST_LIT_VALUES ? last + 1 : TEST_LIT_VALUES] > seen[first];
            }
    return true;
}

bool test_lit_init(struct test_lit *lit, const struct test_interpolant *field, double steps) {
    const struct sp_grid *grid = field->grid;
    const struct sp_transfer_function *tf = &field->scene->view.transfer_function;
    double product = 1, square = 0, smallest = INFINITY;
    *lit = (struct test_lit){ .field = field, .view = &field->scene->view };
    for (int a = 0; a < 3; a++) {
        smallest = fmin(smallest, grid->spacing[a]);
        product *= grid->spacing[a];
        square += pow(grid->spacing[a] * grid->dims[a], 2);
        lit->radius += grid->spacing[a] * (grid->dims[a] + 4);
    }
    lit->step = smallest / steps;
    lit->cell = 2 * cbrt(product);
    lit->fading = lit->view->shading.reach * sqrt(square);
    lit->firm = 0.08 * (tf->points[tf->point_count - 1].value - tf->points[0].value);
    const struct sp_clip *clip = &lit->view->clip;
    lit->is_clipped = clip->plane_count > 0;
    for (int a = 0; a < 3; a++)
        lit->is_clipped = lit->is_clipped || clip->box[0][a] > 0 || clip->box[1][a] < 1;
    list_directions(lit);
    return mark_visible(lit);
}

void test_lit_finish(struct test_lit *lit) {
    free(lit->visible);
    free(lit->depth);
    lit->visible = NULL;
    lit->depth = NULL;
}

/* Extinction per world unit at a point, whose index is given. */
static double extinction_at(const struct test_lit *lit, const double world[3],
                            const double index[3]) {
    const struct sp_view *view = lit->view;
    const struct test_interpolant *f = lit->field;
    double inside[3], gradient[3], square = 0, color[3], opacity;
    int at[3];
    for (int a = 0; a < 3; a++) {
        if (!(index[a] >= -0.5 && index[a] <= f->grid->dims[a] - 0.5))
            return 0;
        inside[a] = fmin(fmax(index[a], 0), f->grid->dims[a] - 1.0);
        at[a] = (int)(2 * inside[a]);
    }
    if (!lit->visible[(at[2] * f->count[1] + at[1]) * f->count[0] + at[0]] ||
        (lit->is_clipped && !test_interpolant_to_index(f, world, inside)))
        return 0;
    double value = test_interpolant_value(f, inside);
    if (view->transfer_function.gradient_count) {
        test_interpolant_gradient(f, inside, gradient);
        for (int r = 0; r < 3; r++)
            square += gradient[r] * gradient[r];
        test_classify(&view->transfer_function, value, sqrt(square), color, &opacity);
        return -log1p(-opacity) / view->transfer_function.reference_length;
    }
    double place = (value - lit->low) * lit->per_unit;
    int bin = (int)place;
    return lit->depth[bin] + (place - bin) * (lit->depth[bin + 1] - lit->depth[bin]);
}

double test_lit_march(const struct test_lit *lit, const double from[3], const double towards[3],
                      double start, double fading) {
    const struct test_interpolant *f = lit->field;
    const double least = 2e-3, fade_step = exp(-lit->step / fading);
    double occluded = 0, light = 1, first = start + lit->step / 2, index[3], move[3];
    double fade = exp(-first / fading);
    for (int a = 0; a < 3; a++) {
        index[a] = move[a] = 0;
        for (int r = 0; r < 3; r++) {
            double scale = f->inverse[a][r] / f->grid->spacing[a];
            index[a] += scale * (from[r] + first * towards[r] - f->grid->origin[r]);
            move[a] += scale * towards[r] * lit->step;
        }
    }
    for (double s = first; s < lit->radius && light * fade > least; s += lit->step) {
        double at[3] = { 0 };
        for (int r = 0; lit->is_clipped && r < 3; r++)
            at[r] = from[r] + s * towards[r];
        double sigma = extinction_at(lit, at, index);
        if (sigma > 0) {
            double passed = exp(-sigma * lit->step);
            occluded += light * (1 - passed) * fade;
            light *= passed;
        }
        fade *= fade_step;
        bool is_leaving = false;
        for (int a = 0; a < 3; a++) {
            index[a] += move[a];
            is_leaving = is_leaving || (move[a] < 0 && index[a] < -0.5) ||
                         (move[a] > 0 && index[a] > f->grid->dims[a] - 0.5);
        }
        if (is_leaving)
            break;
    }
    return 1 - occluded;
}

/* Half of the way along a unit vector from one slice of samples to the next one. */
static double half_slice(const struct test_lit *lit, const double towards[3]) {
    const struct test_interpolant *f = lit->field;
    double most = 0;
    for (int a = 0; a < 3; a++) {
        double move = 0;
        for (int r = 0; r < 3; r++)
            move += f->inverse[a][r] * towards[r];
        most = fmax(most, fabs(move) / f->grid->spacing[a]);
    }
    return 0.5 / most;
}

/* The share of the light around a place that does not arrive there. `cosine`: of the normal and the
 * direction to the eye. */
static double occlude(const struct test_lit *lit, const double from[3], const double normal[3],
                      double cosine, double firm) {
    double mean = 0, dipole[3] = { 0 }, sides[2] = { 0 };
    for (int i = 0; i < TEST_LIT_AROUND; i++) {
        const double *d = lit->around[i], start = half_slice(lit, d);
        double dark = (1 - test_lit_march(lit, from, d, start, lit->fading)) / TEST_LIT_AROUND;
        double slant = normal[0] * d[0] + normal[1] * d[1] + normal[2] * d[2];
        mean += dark;
        sides[slant < 0] += 4 * fabs(slant) * dark;
        for (int r = 0; r < 3; r++)
            dipole[r] += dark * d[r];
    }
    double certain = fmin(5 * fabs(cosine), 1), seen = sides[cosine < 0];
    double surface = certain * seen + (1 - certain) * fmin(sides[0], sides[1]);
    double loose =
        mean - 2 * sqrt(dipole[0] * dipole[0] + dipole[1] * dipole[1] + dipole[2] * dipole[2]);
    return fmin(fmax(firm * surface + (1 - firm) * loose, 0), 1);
}

void test_lit_shares(const struct test_lit *lit, const double world[3], const double ahead[3],
                     const double gradient[3], double share[2]) {
    const struct sp_shading *shading = &lit->view->shading;
    double length = 0, along = 0, from[3], normal[3], arrives = 0;
    for (int r = 0; r < 3; r++) {
        length += gradient[r] * gradient[r];
        along -= gradient[r] * ahead[r];
    }
    length = sqrt(length);
    double firm = fmin(pow(length * lit->cell / 2 / lit->firm, 2), 1);
    for (int r = 0; r < 3; r++) {
        normal[r] = length > 0 ? gradient[r] / length : 0;
        from[r] =
            world[r] + lit->cell * (-0.75 * ahead[r] + (along < 0 ? -0.5 : 0.5) * firm * normal[r]);
    }
    share[0] = share[1] = 1;
    if (shading->occlusion > 0) {
        double cosine = length > 0 ? along / length : 0;
        share[0] = 1 - shading->occlusion * occlude(lit, from, normal, cosine, firm);
    }
    if (shading->shadow > 0 && shading->light_count) {
        for (int i = 0; i < TEST_LIT_DISC; i++)
            arrives +=
                test_lit_march(lit, from, lit->disc[i], half_slice(lit, lit->disc[i]), INFINITY) /
                TEST_LIT_DISC;
        share[1] = 1 - shading->shadow * (1 - arrives);
    }
}
