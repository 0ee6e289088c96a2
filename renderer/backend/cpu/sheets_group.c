/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "backend/cpu/sheets.h"

/* Cubic B-spline at distance x. */
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
static double bend(double x) {
    double sum = -2 * fmax(0, 1 - fabs(x));
    return sum + fmax(0, 1 - fabs(x + 1)) + fmax(0, 1 - fabs(x - 1));
}

static double fill_filter(struct sheets_filter *f, double spread) {
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

/* A Gaussian cut at some samples is narrower than its name says: it is made wider until its
 * variance is right. */
static void make_filter(struct sheets_filter *f, double variance, double reach) {
    *f = (struct sheets_filter){ .taps = (int)ceil(reach * sqrt(variance)), .weight = { 1 } };
    if (f->taps > SHEETS_TAPS)
        f->taps = SHEETS_TAPS;
    double low = 1e-3, high = 4 * variance + 1e-2;
    for (int i = 0; i < 60 && f->taps > 0; i++) {
        double middle = 0.5 * (low + high);
        if (fill_filter(f, middle) < variance)
            low = middle;
        else
            high = middle;
    }
}

void sheets_tables_init(struct sheets_tables *t) {
    for (int p = 0; p < SHEETS_PHASES; p++)
        for (int k = 0; k < 4; k++) {
            double x = k - 1 - (p + 0.5) / SHEETS_PHASES;
            t->spline[p][k] = (float)spline(x);
            t->spline[p][4 + k] = (float)(0.5 * bend(x));
            t->slope[p][k] = (float)slope(x);
        }
    for (int j = 0; j < SHEETS_SCALES; j++)
        for (int p = 0; p < 1 << j; p++)
            for (int k = 0; k < 4; k++)
                t->between[j][p][k] = (float)quadratic(k - 1 - (p + 0.5) / (1 << j));
    for (int n = 0; n < SHEETS_FILTERS; n++)
        for (int i = 0; i < 2; i++)
            make_filter(&t->filters[i][n], (double)n / SHEETS_STEPS, i ? 4 : 3);
}

static const float sharpest = 0.05f; /* samples² that a deposit may be narrower than a B-spline */
static const float no_cross = 0.02f; /* of the variance: less of it across does not count */
static const float small_cross = 0.1f; /* … and so much a deposit can give by itself */

/* Filters for samples that are 2^scale px wide; false where there are none. */
static bool find_filters(const struct sheets *sheets, const float v[3], struct sheets_group *g) {
    const struct sheets_filter *filters = sheets->tables->filters[sheets->exact];
    float cross = fabsf(v[2]);
    for (int a = 0; a < 2; a++) {
        g->per_px[a] = 1.0f / (float)(1 << g->scale[a]);
        cross *= g->per_px[a];
    }
    float least = fminf(v[0] * g->per_px[0] * g->per_px[0], v[1] * g->per_px[1] * g->per_px[1]);
    int step = 0;
    if (cross > small_cross * least)
        step = (int)fminf(cross * SHEETS_STEPS + 0.5f, SHEETS_FILTERS);
    g->has_cross = cross > no_cross * least;
    g->cross = (float)(g->sign * step) / SHEETS_STEPS;
    if (step >= SHEETS_FILTERS)
        return false;
    g->diagonal = step > 0 ? &filters[step] : NULL;
    for (int a = 0; a < 2; a++) {
        float fixed = (g->scale[a] ? 1.0f / 3 + 1.0f / 4 : 1.0f / 3) + (float)step / SHEETS_STEPS;
        float rest = v[a] * g->per_px[a] * g->per_px[a] - fixed;
        int n = (int)fminf(rest * SHEETS_STEPS + 0.5f, SHEETS_FILTERS);
        if (rest < -sharpest || n >= SHEETS_FILTERS)
            return false;
        g->filter[a] = &filters[n];
        g->base[a] = fixed + (float)n / SHEETS_STEPS;
        int reach = g->filter[a]->taps + (g->diagonal ? g->diagonal->taps : 0);
        int samples = SHEETS_TILE >> g->scale[a];
        g->offset[a] = (float)SHEETS_MARGIN - (g->scale[a] ? 0 : 0.5f);
        g->end[a] = g->offset[a] + SHEETS_TILE * g->per_px[a];
        /* As far as samples reach, or footprints: a whole number of phases. */
        float around = sheets->reach * sqrtf(v[a]) * g->per_px[a];
        float low =
            fmaxf((float)(SHEETS_MARGIN - reach - 2 - (g->scale[a] > 0)), g->offset[a] - around);
        float high = fminf((float)(SHEETS_MARGIN + samples + reach + 2 + (g->scale[a] > 0)),
                           g->end[a] + around);
        g->low[a] = floorf(low * SHEETS_PHASES) / SHEETS_PHASES;
        g->high[a] = ceilf(high * SHEETS_PHASES) / SHEETS_PHASES;
        if (reach + 6 > SHEETS_MARGIN)
            return false;
    }
    return true;
}

/* Variance of footprints, px², from which samples of 2^(scale + 1) px do. */
static float variance_to_widen(const struct sheets *sheets, int scale) {
    return sheets->smooth[scale > 0] * (float)(4 << 2 * scale);
}

bool sheets_group_make(const struct sheets *sheets, const struct sheets_brick *b,
                       const float range[2], struct sheets_group *g) {
    float narrow = sheets->exact ? 1.06f : 1.08f, wide = sheets->exact ? 1.08f : 1.1f;
    float v[3], w = fminf(sqrtf(range[0] * range[1]), narrow * range[0]);
    /* A group's middle is not much nearer than its farthest voxels, and neither are its ends. */
    sheets_variance(b, w, v);
    *g = (struct sheets_group){ .reference = { v[0], v[1] },
                                .middle = w,
                                .range = { w / wide, w * wide },
                                .sign = v[2] < 0 ? -1 : 1 };
    for (int a = 0; a < 2; a++)
        while (g->scale[a] < b->scale_max[a] && v[a] >= variance_to_widen(sheets, g->scale[a]))
            g->scale[a]++;
    float radius = sheets_ewa(sheets, b)->radius;
    g->area = (float)M_PI * radius * radius * sqrtf(fmaxf(0, v[0] * v[1] - v[2] * v[2]));
    while (!find_filters(sheets, v, g)) {
        int a = g->scale[1] > g->scale[0];
        if (g->scale[a] == 0)
            return false;
        g->scale[a]--;
    }
    return true;
}

int sheets_group_fits(const struct sheets_group *g, const struct sheets_brick *b,
                      const float range[2]) {
    float low = fmaxf(range[0], g->range[0]), high = fminf(range[1], g->range[1]), v[3];
    if (!(low <= high))
        return 0;
    sheets_variance(b, sqrtf(low * high), v);
    for (int a = 0; a < 2; a++)
        if (!(fabsf(v[a] - g->reference[a]) <= SHEETS_ALIKE * g->reference[a]))
            return 0;
    return low <= range[0] && high >= range[1] ? 2 : 1;
}

/* A brick whose voxels are that much nearer and farther sees them from too many sides for one
 * filter. */
static const float uneven = 1.4f;

static float sinc(float x) {
    return fabsf(x) < 1e-3f ? 1 : sinf(x) / x;
}

/* What a grid of samples lets through of one component of a wave, and as what: deposit, filter of
 * variance `rest` and interpolation of its alias. `omega` is per sample. */
static float response(float omega, float rest, bool interpolated) {
    float alias = omega - 2 * (float)M_PI * roundf(omega / (2 * (float)M_PI));
    float b = sinc(0.5f * omega), c = interpolated ? sinc(0.5f * alias) : 1;
    return b * b * b * b * expf(-0.5f * rest * alias * alias) * c * c * c;
}

/* The voxels of a sheet are a lattice too, and beat with the samples. How much of a constant field
 * comes out as waves, at most; step: of the lattice's two axes in the picture, px. */
static float beat(const float (*step)[2], const float v[3], const int scale[2]) {
    float det = step[0][0] * step[1][1] - step[0][1] * step[1][0], sum = 0;
    float waves[4][2]; /* of the lattice: the reciprocal vectors and their sum and difference */
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
        sum += aliased ? share : 0; /* what the samples resolve belongs to the footprints */
    }
    return isfinite(sum) ? sum : 0;
}

/* Waves that are let through of a constant field, by whether the filter is exact; of pixels. */
static const float most_beat[2] = { 0.012f, 0.004f }, most_beat_of_pixels = 0.008f;

/* How wide samples may be before they beat; false when even pixels do. */
static bool choose_scales(const struct sheets *sheets, struct sheets_brick *b) {
    float v[3], w = sqrtf(b->range[0] * b->range[1]);
    int scale[2] = { 0, 0 };
    sheets_variance(b, w, v);
    for (int a = 0; a < 2; a++)
        while (scale[a] + 1 < SHEETS_SCALES && v[a] >= variance_to_widen(sheets, scale[a]))
            scale[a]++;
    while ((scale[0] || scale[1]) && beat(b->step, v, scale) > most_beat[sheets->exact])
        scale[scale[1] > scale[0]]--;
    b->scale_max[0] = (uint8_t)scale[0];
    b->scale_max[1] = (uint8_t)scale[1];
    return scale[0] || scale[1] || beat(b->step, v, scale) <= most_beat_of_pixels;
}

/* Whether there are filters for all of a brick's voxels. Where samples get wider, or with a
 * diagonal, the nearest and the farthest do not speak for those between. */
static bool has_filters(const struct sheets *sheets, const struct sheets_brick *b) {
    enum { STEPS = 16 };
    struct sheets_group group;
    bool is_plain = fabsf(b->spread[2]) <= 0.5f * small_cross * fminf(b->spread[0], b->spread[1]);
    float step = powf(b->range[1] / b->range[0], 1.0f / STEPS), w = b->range[0];
    for (int k = 0; k <= STEPS && !is_plain; k++, w *= step)
        if (!sheets_group_make(sheets, b, (float[2]){ w, w }, &group))
            return false;
    return sheets_group_make(sheets, b, b->range, &group);
}

bool sheets_find_filters(const struct sheets *sheets, struct sheets_brick *b) {
    const float most[2] = { b->range[1], b->range[1] };
    struct sheets_group group;
    return b->range[1] <= uneven * b->range[0] && choose_scales(sheets, b) &&
           has_filters(sheets, b) && sheets_group_make(sheets, b, most, &group);
}
