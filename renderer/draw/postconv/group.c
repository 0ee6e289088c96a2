/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "draw/postconv/postconv.h"

/* Returns the cubic B-spline at distance x. */
static double spline(double x) {
    x = fabs(x);
    if (x < 1)
        return 2.0 / 3 - x * x * (1 - x / 2);
    return x < 2 ? (2 - x) * (2 - x) * (2 - x) / 6 : 0;
}

/* Its first derivative. */
static double slope(double x) {
    double a = fabs(x), d = a < 1 ? -2 * a + 1.5 * a * a : a < 2 ? -0.5 * (2 - a) * (2 - a) : 0;
    return x < 0 ? -d : d;
}

/* Quadratic B-spline. */
static double quadratic(double x) {
    x = fabs(x);
    if (x < 0.5)
        return 0.75 - x * x;
    return x < 1.5 ? 0.5 * (1.5 - x) * (1.5 - x) : 0;
}

/* The cubic's second derivative is a difference of linear ones. */
static double spline_curvature(double x) {
    double sum = -2 * fmax(0, 1 - fabs(x));
    return sum + fmax(0, 1 - fabs(x + 1)) + fmax(0, 1 - fabs(x - 1));
}

static double fill_filter(struct sp_postconv_filter *f, double spread) {
    double sum = 0, variance = 0;
    for (int k = -f->taps; k <= f->taps; k++)
        sum += exp(-0.5 * k * k / spread);
    for (int k = -f->taps; k <= f->taps; k++) {
        double w = exp(-0.5 * k * k / spread) / sum;
        f->weight[k + f->taps] = (float)w;
        variance += w * k * k;
    }
    return variance;
}

/* A truncated Gaussian has too small a variance. It is widened until its variance is right. */
static void make_filter(struct sp_postconv_filter *f, double variance, double reach) {
    *f = (struct sp_postconv_filter){ .taps = (int)ceil(reach * sqrt(variance)), .weight = { 1 } };
    if (f->taps > POSTCONV_TAPS)
        f->taps = POSTCONV_TAPS;
    double low = 1e-3, high = 4 * variance + 1e-2;
    for (int i = 0; i < 60 && f->taps > 0; i++) {
        double middle = 0.5 * (low + high);
        if (fill_filter(f, middle) < variance)
            low = middle;
        else
            high = middle;
    }
}

void sp_postconv_tables_init(struct sp_postconv_tables *t) {
    for (int p = 0; p < POSTCONV_PHASES; p++)
        for (int k = 0; k < 4; k++) {
            double x = k - 1 - (p + 0.5) / POSTCONV_PHASES;
            t->spline[p][k] = (float)spline(x);
            t->spline[p][4 + k] = (float)(0.5 * spline_curvature(x));
            t->slope[p][k] = (float)slope(x);
        }
    for (int j = 0; j < POSTCONV_SCALES; j++)
        for (int p = 0; p < 1 << j; p++)
            for (int k = 0; k < 4; k++)
                t->between[j][p][k] = (float)quadratic(k - 1 - (p + 0.5) / (1 << j));
    for (int n = 0; n < POSTCONV_FILTERS; n++)
        for (int i = 0; i < 2; i++)
            make_filter(&t->filters[i][n], (double)n / POSTCONV_STEPS, i ? 4 : 3);
}

/* A deposit may be this much narrower than a B-spline [samples²]. */
static const float sharpest = 0.05f;
static const float no_cross = 0.02f; /* a covariance below this share of the variance is ignored */
static const float small_cross = 0.1f; /* up to this share the deposit alone corrects it */

/* Chooses filters for samples that are 2^scale px wide; false if there are none. */
static bool choose_filters(const struct sp_postconv *postconv, const float v[3],
                           struct sp_postconv_group *g) {
    const struct sp_postconv_filter *filters = postconv->tables->filters[postconv->exact];
    float cross = fabsf(v[2]);
    for (int a = 0; a < 2; a++) {
        g->per_px[a] = 1.0f / (float)(1 << g->scale[a]);
        cross *= g->per_px[a];
    }
    float least = fminf(v[0] * g->per_px[0] * g->per_px[0], v[1] * g->per_px[1] * g->per_px[1]);
    int step = 0;
    if (cross > small_cross * least)
        step = (int)fminf(cross * POSTCONV_STEPS + 0.5f, POSTCONV_FILTERS);
    g->has_cross = cross > no_cross * least;
    g->cross = (float)(g->sign * step) / POSTCONV_STEPS;
    if (step >= POSTCONV_FILTERS)
        return false;
    g->diagonal = step > 0 ? &filters[step] : NULL;
    for (int a = 0; a < 2; a++) {
        float fixed = (g->scale[a] ? 1.0f / 3 + 1.0f / 4 : 1.0f / 3) + (float)step / POSTCONV_STEPS;
        float rest = v[a] * g->per_px[a] * g->per_px[a] - fixed;
        int n = (int)fminf(rest * POSTCONV_STEPS + 0.5f, POSTCONV_FILTERS);
        if (rest < -sharpest || n >= POSTCONV_FILTERS)
            return false;
        g->filter[a] = &filters[n];
        g->base[a] = fixed + (float)n / POSTCONV_STEPS;
        int reach = g->filter[a]->taps + (g->diagonal ? g->diagonal->taps : 0);
        int samples = POSTCONV_TILE >> g->scale[a];
        g->offset[a] = (float)POSTCONV_MARGIN - (g->scale[a] ? 0 : 0.5f);
        g->end[a] = g->offset[a] + POSTCONV_TILE * g->per_px[a];
        /* As far as samples or footprints reach, rounded to whole phases. */
        float around = postconv->reach * sqrtf(v[a]) * g->per_px[a];
        float low =
            fmaxf((float)(POSTCONV_MARGIN - reach - 2 - (g->scale[a] > 0)), g->offset[a] - around);
        float high = fminf((float)(POSTCONV_MARGIN + samples + reach + 2 + (g->scale[a] > 0)),
                           g->end[a] + around);
        g->low[a] = floorf(low * POSTCONV_PHASES) / POSTCONV_PHASES;
        g->high[a] = ceilf(high * POSTCONV_PHASES) / POSTCONV_PHASES;
        if (reach + 6 > POSTCONV_MARGIN)
            return false;
    }
    return true;
}

/* Returns the variance of footprints from which samples of 2^(scale + 1) px suffice [px²]. */
static float variance_to_widen(const struct sp_postconv *postconv, int scale) {
    return postconv->smooth[scale > 0] * (float)(4 << 2 * scale);
}

bool sp_postconv_group_init(const struct sp_postconv *postconv, const struct sp_postconv_brick *b,
                            const float range[2], struct sp_postconv_group *g) {
    float narrow = postconv->exact ? 1.06f : 1.08f, wide = postconv->exact ? 1.08f : 1.1f;
    float v[3], w = fminf(sqrtf(range[0] * range[1]), narrow * range[0]);
    /* The middle of a group, and its ends, are close to its farthest voxels. */
    sp_postconv_variance(b, w, v);
    *g = (struct sp_postconv_group){ .reference = { v[0], v[1] },
                                     .middle = w,
                                     .range = { w / wide, w * wide },
                                     .sign = v[2] < 0 ? -1 : 1 };
    for (int a = 0; a < 2; a++)
        while (g->scale[a] < b->scale_max[a] && v[a] >= variance_to_widen(postconv, g->scale[a]))
            g->scale[a]++;
    float radius = sp_postconv_ewa(postconv, b)->radius;
    g->area = (float)M_PI * radius * radius * sqrtf(fmaxf(0, v[0] * v[1] - v[2] * v[2]));
    while (!choose_filters(postconv, v, g)) {
        int a = g->scale[1] > g->scale[0];
        if (g->scale[a] == 0)
            return false;
        g->scale[a]--;
    }
    return true;
}

int sp_postconv_group_fits(const struct sp_postconv_group *g, const struct sp_postconv_brick *b,
                           const float range[2]) {
    float low = fmaxf(range[0], g->range[0]), high = fminf(range[1], g->range[1]), v[3];
    if (!(low <= high))
        return 0;
    sp_postconv_variance(b, sqrtf(low * high), v);
    for (int a = 0; a < 2; a++)
        if (!(fabsf(v[a] - g->reference[a]) <= POSTCONV_ALIKE * g->reference[a]))
            return 0;
    return low <= range[0] && high >= range[1] ? 2 : 1;
}

/* A brick is unfit if the distances of its voxels differ by more than this factor. */
static const float uneven = 1.4f;

static float sinc(float x) {
    return fabsf(x) < 1e-3f ? 1 : sinf(x) / x;
}

/* Returns the response of the grid of samples to a wave along one axis: deposit, filter of variance
 * `rest`, and interpolation of its alias. `omega` is per sample. */
static float response(float omega, float rest, bool interpolated) {
    float alias = omega - 2 * (float)M_PI * roundf(omega / (2 * (float)M_PI));
    float b = sinc(0.5f * omega), c = interpolated ? sinc(0.5f * alias) : 1;
    return b * b * b * b * expf(-0.5f * rest * alias * alias) * c * c * c;
}

/* Aliasing: the lattice of voxels and the grid of samples interfere. Returns the largest ripple of
 * a constant field. step: the lattice's two axes in the image [px]. */
static float aliasing_ripple(const float (*step)[2], const float v[3], const int scale[2]) {
    float det = step[0][0] * step[1][1] - step[0][1] * step[1][0], sum = 0;
    float waves[4][2]; /* reciprocal vectors of the lattice, their sum and difference */
    for (int a = 0; a < 2; a++) {
        float turn = (a ? -2 : 2) * (float)M_PI / det;
        waves[0][a] = turn * step[1][!a];
        waves[1][a] = -turn * step[0][!a];
        waves[2][a] = waves[0][a] + waves[1][a];
        waves[3][a] = waves[0][a] - waves[1][a];
    }
    for (int k = 0; k < 4; k++) {
        float share = 2;
        bool aliased = false;
        for (int a = 0; a < 2; a++) {
            float size = (float)(1 << scale[a]), omega = waves[k][a] * size;
            float rest = v[a] / (size * size) - (scale[a] ? 7.0f / 12 : 1.0f / 3);
            share *= response(omega, fmaxf(rest, 0), scale[a] > 0);
            aliased |= fabsf(omega) > (float)M_PI;
        }
        sum += aliased ? share : 0; /* waves that the samples resolve belong to the footprints */
    }
    return isfinite(sum) ? sum : 0;
}

/* Largest accepted ripple of a constant field, by sp_postconv.exact; and for samples of one pixel.
 */
static const float ripple_max[2] = { 0.012f, 0.004f }, ripple_max_of_pixels = 0.008f;

/* Chooses how wide samples may be without aliasing; false if even samples of one pixel alias. */
static bool choose_scales(const struct sp_postconv *postconv, struct sp_postconv_brick *b) {
    float v[3], w = sqrtf(b->range[0] * b->range[1]);
    int scale[2] = { 0, 0 };
    sp_postconv_variance(b, w, v);
    for (int a = 0; a < 2; a++)
        while (scale[a] + 1 < POSTCONV_SCALES && v[a] >= variance_to_widen(postconv, scale[a]))
            scale[a]++;
    while ((scale[0] || scale[1]) &&
           aliasing_ripple(b->step, v, scale) > ripple_max[postconv->exact])
        scale[scale[1] > scale[0]]--;
    b->scale_max[0] = (uint8_t)scale[0];
    b->scale_max[1] = (uint8_t)scale[1];
    return scale[0] || scale[1] || aliasing_ripple(b->step, v, scale) <= ripple_max_of_pixels;
}

/* True if there are filters for all of a brick's voxels. If samples get wider, or with a diagonal,
 * the nearest and the farthest voxel do not represent the ones between. */
static bool has_filters(const struct sp_postconv *postconv, const struct sp_postconv_brick *b) {
    enum { STEPS = 16 };
    struct sp_postconv_group group;
    bool is_plain = fabsf(b->spread[2]) <= 0.5f * small_cross * fminf(b->spread[0], b->spread[1]);
    float step = powf(b->range[1] / b->range[0], 1.0f / STEPS), w = b->range[0];
    for (int k = 0; k <= STEPS && !is_plain; k++, w *= step)
        if (!sp_postconv_group_init(postconv, b, (float[2]){ w, w }, &group))
            return false;
    return sp_postconv_group_init(postconv, b, b->range, &group);
}

bool sp_postconv_choose_filters(const struct sp_postconv *postconv, struct sp_postconv_brick *b) {
    const float most[2] = { b->range[1], b->range[1] };
    struct sp_postconv_group group;
    return b->range[1] <= uneven * b->range[0] && choose_scales(postconv, b) &&
           has_filters(postconv, b) && sp_postconv_group_init(postconv, b, most, &group);
}
