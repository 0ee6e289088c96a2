/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/resample/projection.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "data/volume/missing.h"
#include "sp/slice.h"

/* Sums over the histogram: the root mean square of max(value − zero, 0). */
static double root_mean_square(const struct sp_volume_info *info, double zero) {
    const double bin =
        sp_missing_data(info)[1] / SP_HISTOGRAM_BINS - sp_missing_data(info)[0] / SP_HISTOGRAM_BINS;
    double sum = 0, count = 0;
    for (int b = 0; b < SP_HISTOGRAM_BINS; b++) {
        double above =
            fmax((sp_missing_data(info)[0] + (b + 0.5) * bin - zero) / bin, 0); /* [bins] */
        if (info->histogram[b] == 0)
            continue;
        sum += (double)info->histogram[b] *
               (b == 0 && zero == sp_missing_data(info)[0] ? 0 : above * above);
        count += (double)info->histogram[b];
    }
    return count > 0 && bin > 0 ? bin * sqrt(sum / count) : 0;
}

static double zero_of(const struct sp_view *view, const struct sp_volume_info *info) {
    return isnan(view->compositing.zero) ? sp_missing_data(info)[0] : view->compositing.zero;
}

/* The value at a share of the range, which may be wider than a double. */
static double value_at(const struct sp_volume_info *info, double share) {
    return sp_missing_data(info)[0] * (1 - share) + sp_missing_data(info)[1] * share;
}

/* The upper end of the sums of max(value − zero, 0) along rays: known for the lowest value. */
static double sum_end(const struct sp_view *view, const struct sp_volume_info *info) {
    const double all = root_mean_square(info, sp_missing_data(info)[0]);
    const double share = all > 0 ? root_mean_square(info, zero_of(view, info)) / all : 0;
    return (sp_missing_data(info)[1] - sp_missing_data(info)[0]) * info->projected.sum * share;
}

/* The ends of the window that suits the volume and the mode. */
static void choose_ends(const struct sp_view *view, const struct sp_volume_info *info,
                        double ends[2]) {
    const enum sp_compositing mode = view->compositing.mode;
    const double *shares =
        mode == SP_COMPOSITE_MEAN ? info->projected.mean : info->projected.maximum;
    double window[2];
    if (mode == SP_COMPOSITE_SUM) {
        ends[0] = 0;
        ends[1] = isnan(view->compositing.absorption) ? sum_end(view, info) : 1;
    } else if (mode != SP_COMPOSITE_MINIMUM && shares[1] > shares[0]) {
        ends[0] = value_at(info, shares[0]);
        ends[1] = value_at(info, shares[1]);
    } else {
        sp_slice_default_window(info, window);
        ends[0] = window[0] - window[1] / 2;
        ends[1] = sp_missing_data(info)[1];
    }
}

void sp_projection_window(const struct sp_view *view, const struct sp_volume_info *info,
                          double window[2]) {
    const struct sp_compositing_options *c = &view->compositing;
    double ends[2];
    choose_ends(view, info, ends);
    window[0] = isnan(c->center) ? ends[0] / 2 + ends[1] / 2 : c->center;
    window[1] = isnan(c->width) ? fmin(ends[1] - ends[0], DBL_MAX / 4) : c->width;
    if (!(window[1] > 0))
        window[1] = 1;
}

/* The numbers that have the first and the last colour. */
static void compute_ends(const struct sp_view *view, const struct sp_volume_info *info,
                         double ends[2]) {
    const struct sp_transfer_function *tf = &view->transfer_function;
    double window[2];
    sp_projection_window(view, info, window);
    ends[0] = window[0] - window[1] / 2;
    ends[1] = window[0] + window[1] / 2;
    if (view->compositing.colors == SP_COLORS_TRANSFER_FUNCTION) {
        ends[0] = tf->points[0].value;
        ends[1] = tf->points[tf->point_count - 1].value;
    }
    if (!(ends[1] > ends[0])) /* one colour, or closer than doubles tell apart */
        ends[1] = ends[0] + fmax(fabs(ends[0]) * 1e-12, 1e-300);
}

/* Values from which on nothing is left out: all that are finite. */
static void show_all(struct sp_transfer_function *tf, const struct sp_volume_info *info) {
    tf->point_count = 1;
    tf->points[0] = (struct sp_tf_point){ .value = sp_missing_data(info)[0], .opacity = 0.5f };
}

/* Codes span a multiple of what the transfer function tells apart. It is wide enough that integers
 * have codes. */
static void widen(const struct sp_volume_info *info, double ends[2]) {
    const double least_share = 1e-5;
    bool is_real = info->type == SP_FLOAT32 || info->type == SP_FLOAT64;
    double least = least_share * (sp_missing_data(info)[1] / 2 - sp_missing_data(info)[0] / 2);
    double more = fmax(least, is_real ? 0 : 0.5) - (ends[1] / 2 - ends[0] / 2);
    if (more > 0) {
        ends[0] -= more;
        ends[1] += more;
    }
}

void sp_reduction_transfer(const struct sp_view *view, const struct sp_volume_info *info,
                           struct sp_transfer_function *tf) {
    bool is_minimum = view->compositing.mode == SP_COMPOSITE_MINIMUM;
    double ends[2] = { sp_missing_data(info)[0], sp_missing_data(info)[1] };
    memset(tf, 0, sizeof *tf);
    tf->reference_length = 1;
    tf->order = SP_TF_POST;
    if (view->compositing.mode == SP_COMPOSITE_SUM)
        ends[0] = zero_of(view, info);
    else if (view->compositing.mode != SP_COMPOSITE_MEAN)
        compute_ends(view, info, ends);
    if (sp_missing_are_holes(info) || !(ends[1] > ends[0])) {
        show_all(tf, info);
        return;
    }
    widen(info, ends);
    tf->point_count = 2;
    tf->points[0] = (struct sp_tf_point){ .value = ends[0], .opacity = is_minimum ? 0.5f : 0 };
    tf->points[1] = (struct sp_tf_point){ .value = ends[1], .opacity = is_minimum ? 0 : 0.5f };
}

static double code_of(const struct sp_curve *curve, double value) {
    return CURVE_CODE_MIN + (value - curve->base) * curve->codes_per_unit;
}

/* A float, whatever the double is. */
static float to_float(double x) {
    return (float)fmin(fmax(x, -(double)FLT_MAX), (double)FLT_MAX);
}

void sp_reduction_init(struct sp_reduction *r, const struct sp_view *view,
                       const struct sp_volume_info *info, const struct sp_curve *curve,
                       double length_unit) {
    const enum sp_compositing mode = view->compositing.mode;
    const double per_unit = curve->codes_per_unit;
    *r = (struct sp_reduction){ .is_on = true,
                                .is_extreme =
                                    mode == SP_COMPOSITE_MAXIMUM || mode == SP_COMPOSITE_MINIMUM,
                                .is_mean = mode == SP_COMPOSITE_MEAN,
                                .leaves_out = sp_missing_are_holes(info),
                                .sign = mode == SP_COMPOSITE_MINIMUM ? -1 : 1 };
    compute_ends(view, info, r->ends);
    double ends[2] = { code_of(curve, r->ends[0]), code_of(curve, r->ends[1]) };
    double zero = code_of(curve, r->is_mean ? sp_missing_data(info)[0] : zero_of(view, info));
    double shift = 0, span = ends[1] - ends[0]; /* position = (number + shift − ends[0])/span */
    if (r->is_extreme) {
        /* Rays begin with what looks like the end of the window that is not looked for, or, where
         * all samples are looked at, with less than these. */
        const double beyond = 1e6, none = r->sign > 0 ? CURVE_CODE_NONE : -INT16_MAX;
        double start = r->leaves_out ? none : r->sign > 0 ? ends[0] : -ends[1];
        r->start = (float)fmin(fmax(start, -beyond), beyond);
        r->full = to_float(r->sign > 0 ? ends[1] : -ends[0]);
    } else if (r->is_mean) {
        shift = zero;
    } else if (isnan(view->compositing.absorption)) {
        span = (r->ends[1] - r->ends[0]) * per_unit / length_unit;
        ends[0] = r->ends[0] * per_unit / length_unit;
    } else {
        r->absorption =
            to_float(view->compositing.absorption * length_unit / per_unit * 1.4426950408889634);
        span = r->ends[1] - r->ends[0];
        ends[0] = r->ends[0];
    }
    r->zero = to_float(zero);
    r->gain = to_float(r->sign / span);
    r->offset = to_float((shift - ends[0]) / span);
}

void sp_reduction_colors(const struct sp_view *view, const struct sp_volume_info *info,
                         float (*colors)[4]) {
    double ends[2];
    compute_ends(view, info, ends);
    for (int i = 0; i <= REDUCTION_COLORS; i++) {
        double share = (double)i / REDUCTION_COLORS;
        struct sp_class class = { .color = { (float)share, (float)share, (float)share } };
        if (view->compositing.colors == SP_COLORS_TRANSFER_FUNCTION)
            sp_transfer_function_eval(&view->transfer_function,
                                      ends[0] + share * (ends[1] - ends[0]), &class);
        memcpy(colors[i], class.color, sizeof class.color);
        colors[i][3] = view->compositing.colors == SP_COLORS_GREY ? 1 : 1 - expf(-class.depth);
    }
}
