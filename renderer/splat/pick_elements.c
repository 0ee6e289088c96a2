/* SPDX-License-Identifier: Apache-2.0 */
#include "splat/pick_elements.h"

#include <math.h>
#include <stdlib.h>

#include "base/grow.h"
#include "base/vec.h"
#include "classify/transfer.h"
#include "splat/camera.h"
#include "splat/close_kernel.h"
#include "splat/ewa_frame.h"

/* As for drawing (draw/layers/cloud/README.md). */
static const double trained_lowpass2 = 0.3, trained_opacity_max = 0.99,
                    trained_opacity_min = 1 / 255.0;

/* A layer and the ray. Elements lie in the world of the data, from which `turn` and `moved` lead to
 * the world of the view. */
struct picking {
    const struct sp_pick_input *input;
    const struct sp_ray *ray;
    const struct sp_layer *layer;
    const struct sp_elements *elements;
    struct sp_pick_events *events;
    struct sp_camera_transform camera;
    struct sp_mat3 turn, to_camera; /* data → view, data → camera */
    double det;                     /* of turn */
    struct sp_vec3 offset;          /* in the camera */
    struct sp_vec3 from, way;       /* of the ray, in the world of the data; t is the same */
    double stretch;                 /* at least how much longer lengths are in the data */
    double slope;                   /* depth in the camera per t */
};

static bool picking_init(struct picking *p) {
    const double *m = p->layer->transform;
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            p->turn.m[r][a] = m[4 * r + a];
    const struct sp_vec3 moved = { { m[3], m[7], m[11] } };
    const struct sp_mat3 back = sp_mat3_inverse(&p->turn, &p->det);
    sp_camera_transform_init(&p->camera, &p->input->view->camera, p->input->size);
    p->to_camera = sp_mat3_multiply(&p->camera.w, &p->turn);
    p->offset = sp_mat3_apply(&p->camera.w, sp_vec3_sub(moved, p->camera.eye));
    p->from = sp_mat3_apply(&back, sp_vec3_sub(p->ray->from, moved));
    p->way = sp_mat3_apply(&back, p->ray->way);
    p->slope = sp_vec3_dot(sp_vec3_from(p->camera.w.m[2]), p->ray->way);
    p->stretch = 0;
    for (int r = 0; r < 3; r++)
        p->stretch += sp_vec3_dot(sp_vec3_from(back.m[r]), sp_vec3_from(back.m[r]));
    p->stretch = sqrt(p->stretch);
    return p->det != 0 && p->slope > 0;
}

static bool add_event(struct sp_pick_events *events, double t, double depth, double value) {
    if (!sp_grow(&events->at, events->count, sizeof *events->at))
        return false;
    events->at[events->count++] = (struct sp_pick_event){ t, depth, value };
    return true;
}

/* The footprint of an element in the image. */
struct footprint {
    double u2, distance2; /* depth; squared distance of the point, in standard deviations */
    double det, plain;    /* determinants of the variance with and without the low-pass filter */
    double gain;          /* |det J| / √det */
    double beyond;        /* share that lies beyond the near plane */
};

/* A kernel of a perspective view before it is projected. */
struct placed {
    const struct picking *picking;
    double u[3], kernel[3][3], lowpass2;
};

/* Computes the affine footprint by the Jacobian for the ratios u0/u2 and u1/u2. */
static void compute_affine(const struct placed *at, const double ratio[2], struct footprint *f) {
    const struct picking *p = at->picking;
    const bool is_flat = p->camera.projection == SP_ORTHOGRAPHIC;
    const double scale = is_flat ? p->camera.scale : p->camera.scale / at->u[2];
    const double lowpass2 = at->lowpass2;
    double m[2][3], d[2], slopes = 1;
    for (int r = 0; r < 2; r++) {
        for (int a = 0; a < 3; a++)
            m[r][a] = scale * (at->kernel[r][a] - ratio[r] * at->kernel[2][a]);
        d[r] = p->input->at[r] - p->camera.centre[r] - scale * at->u[r];
        slopes += ratio[r] * ratio[r];
    }
    const double a = sp_vec3_dot(sp_vec3_from(m[0]), sp_vec3_from(m[0])),
                 b = sp_vec3_dot(sp_vec3_from(m[0]), sp_vec3_from(m[1])),
                 c = sp_vec3_dot(sp_vec3_from(m[1]), sp_vec3_from(m[1]));
    const struct sp_vec3 cross = sp_vec3_cross(sp_vec3_from(m[0]), sp_vec3_from(m[1]));
    f->u2 = at->u[2];
    f->plain = sp_vec3_dot(cross, cross);
    f->det = f->plain + lowpass2 * (a + c) + lowpass2 * lowpass2;
    f->distance2 =
        ((c + lowpass2) * d[0] * d[0] - 2 * b * d[0] * d[1] + (a + lowpass2) * d[1] * d[1]) /
        f->det;
    f->gain = scale * scale * sqrt(slopes) / sqrt(f->det);
    f->beyond = 1;
}

/* Changes the footprint of a kernel ahead of the eye, at the ray X = d[0], Y = d[1]. */
static void refine_ahead(const struct placed *at, const struct sp_close_kernel *k, double share,
                         const double ratio_max[2], const double d[2], struct footprint *f) {
    double ratio[2], slope = 1, lengths[2] = { 1, 1 };
    for (int r = 0; r < 2; r++) {
        const double middle = at->u[r] / at->u[2], away = share * (d[r] - middle);
        ratio[r] = sp_close_ratio(k, r, ratio_max[r], share);
        slope += k->su[r] * away * at->u[2] / k->square;
        lengths[0] += middle * middle;
        lengths[1] += (middle + away) * (middle + away);
    }
    compute_affine(at, ratio, f);
    const double divisor = slope * slope + share * share * f->distance2 / k->square;
    f->distance2 = slope > 0 ? f->distance2 / divisor : INFINITY;
    f->gain *= sqrt(lengths[1] / (lengths[0] * divisor));
}

/* Changes the footprint of a kernel close to the eye (splat/close.h). False if it is not drawn. */
static bool refine_footprint(const struct placed *at, const double ratio_max[2], bool is_integral,
                             struct footprint *f) {
    const struct picking *p = at->picking;
    struct sp_close_kernel k;
    double d[3] = { 0, 0, 1 };
    sp_close_kernel_init(&k, at->u, at->kernel, at->lowpass2 / (p->camera.scale * p->camera.scale));
    const double share = sp_close_share(&k, is_integral);
    if (!(share > SP_CLOSE_LEAST) || (share < 1 && at->u[2] < p->camera.near))
        return at->u[2] >= p->camera.near;
    for (int r = 0; r < 2; r++)
        d[r] = (p->input->at[r] - p->camera.centre[r]) / p->camera.scale;
    if (share < 1) {
        refine_ahead(at, &k, share, ratio_max, d, f);
        return true;
    }
    const double own = sp_close_form((const double(*)[3])k.s, d);
    const double t = (d[0] * k.su[0] + d[1] * k.su[1] + k.su[2]) / sqrt(own);
    f->distance2 = k.square - t * t;
    f->plain = k.own;
    f->det = k.det * k.square;
    f->gain = sqrt((d[0] * d[0] + d[1] * d[1] + 1) / (own * k.det));
    f->beyond = 0.5 * erfc((p->camera.near * sqrt(own) - t) * M_SQRT1_2);
    return true;
}

/* False if the element is not drawn. */
static bool compute_footprint(const struct picking *p, uint32_t i, double size, double lowpass2,
                              bool is_trained, struct footprint *f) {
    const float *e = p->elements->factors[i], *position = p->elements->positions[i];
    const double from[3] = { (double)position[0], (double)position[1], (double)position[2] };
    const double factor[3][3] = { { (double)e[0], 0, 0 },
                                  { (double)e[1], (double)e[2], 0 },
                                  { (double)e[3], (double)e[4], (double)e[5] } };
    const struct sp_vec3 u =
        sp_vec3_add(sp_mat3_apply(&p->to_camera, sp_vec3_from(from)), p->offset);
    const bool is_flat = p->camera.projection == SP_ORTHOGRAPHIC;
    struct placed at = { .picking = p, .lowpass2 = lowpass2 };
    double ratio[2], ratio_max[2];
    for (int r = 0; r < 3; r++) {
        at.u[r] = u.v[r];
        for (int a = 0; a < 3; a++)
            at.kernel[r][a] =
                size * (p->to_camera.m[r][0] * factor[0][a] + p->to_camera.m[r][1] * factor[1][a] +
                        p->to_camera.m[r][2] * factor[2][a]);
    }
    for (int r = 0; r < 2; r++) {
        const double slack = is_trained ? 0 : (double)SP_EWA_SLACK;
        const double most = ratio_max[r] = (double)SP_EWA_MARGIN * p->camera.tan_half[r] + slack;
        ratio[r] = is_flat ? 0 : fmin(fmax(u.v[r] / u.v[2], -most), most);
    }
    compute_affine(&at, ratio, f);
    if (is_flat)
        return u.v[2] >= p->camera.near;
    return refine_footprint(&at, ratio_max, !is_trained, f);
}

/* True if the kernel of an element may reach the ray within `cutoff` standard deviations. */
static bool is_near(const struct picking *p, uint32_t i, double size, double lowpass,
                    double cutoff) {
    const double slack = 2; /* the footprint belongs to the centre, not to the ray */
    const float *e = p->elements->factors[i], *at = p->elements->positions[i];
    const double position[3] = { (double)at[0], (double)at[1], (double)at[2] };
    const struct sp_vec3 away = sp_vec3_sub(sp_vec3_from(position), p->from);
    const struct sp_vec3 cross = sp_vec3_cross(away, p->way);
    const double length2 = sp_vec3_dot(p->way, p->way);
    const double u2 = p->to_camera.m[2][0] * position[0] + p->to_camera.m[2][1] * position[1] +
                      p->to_camera.m[2][2] * position[2] + p->offset.v[2];
    const double px = (p->camera.projection == SP_ORTHOGRAPHIC ? 1 : fabs(u2)) / p->camera.scale;
    double factor2 = 0;
    for (int k = 0; k < 6; k++)
        factor2 += (double)e[k] * (double)e[k];
    const double reach = slack * cutoff * (size * sqrt(factor2) + lowpass * px * p->stretch);
    const bool is_flat = p->camera.projection == SP_ORTHOGRAPHIC;
    const struct sp_vec3 forward = sp_vec3_from(p->to_camera.m[2]);
    const double behind = is_flat ? 0 : cutoff * size * sqrt(factor2) * sp_vec3_length(forward);
    return u2 + behind >= p->camera.near && sp_vec3_dot(cross, cross) <= reach * reach * length2;
}

/* Adds an event at a depth in the camera, if that is on the ray. Kernels that reach beyond the near
 * plane although their centre does not are at the near plane. */
static bool add_at(const struct picking *p, double u2, double depth, double value) {
    const bool is_flat = p->camera.projection == SP_ORTHOGRAPHIC;
    const double t = (is_flat ? u2 : fmax(u2, p->camera.near)) / p->slope;
    if (!(t >= p->ray->begin && t <= p->ray->end && depth > 0))
        return true;
    return add_event(p->events, t, depth, value);
}

/* A point has the optical depth of its volume, spread by the footprint (splat/ewa.h). */
static bool pick_points(const struct picking *p) {
    const struct sp_filter *filter = &p->input->view->filter;
    const struct sp_transfer_function *tf = &p->input->view->transfer_function;
    const double cutoff = filter->cutoff, gain = 1 / (2 * M_PI * -expm1(-cutoff * cutoff / 2));
    for (uint32_t i = 0; i < p->elements->shape.count; i++) {
        struct footprint f;
        struct sp_class class;
        if (!is_near(p, i, p->layer->size, filter->lowpass, cutoff))
            continue;
        if (!compute_footprint(p, i, p->layer->size, filter->lowpass * filter->lowpass, false,
                               &f) ||
            !(f.distance2 <= cutoff * cutoff && f.det > 0))
            continue;
        const double value = (double)p->elements->values[i];
        sp_transfer_function_eval(tf, value, &class);
        const double depth = (double)class.depth / tf->reference_length * gain * f.gain *
                             (double)p->elements->volumes[i] * fabs(p->det) * f.beyond *
                             exp(-f.distance2 / 2);
        if (!add_at(p, f.u2, depth, value))
            return false;
    }
    return true;
}

static bool pick_gaussians(const struct picking *p) {
    const double cutoff = sqrt(-2 * log(trained_opacity_min)); /* of an opaque one */
    const bool is_normalised = p->layer->convention == SP_CONVENTION_NORMALISED;
    for (uint32_t i = 0; i < p->elements->shape.count; i++) {
        struct footprint f;
        double opacity = (double)p->elements->opacities[i] * (double)p->layer->opacity;
        if (!(opacity >= trained_opacity_min) || !is_near(p, i, 1, sqrt(trained_lowpass2), cutoff))
            continue;
        if (!compute_footprint(p, i, 1, trained_lowpass2, true, &f))
            continue;
        opacity *= f.beyond * exp(-f.distance2 / 2) * (is_normalised ? sqrt(f.plain / f.det) : 1);
        if (opacity >= trained_opacity_min &&
            !add_at(p, f.u2, -log1p(-fmin(opacity, trained_opacity_max)), NAN))
            return false;
    }
    return true;
}

static double opacity_of(const float color[4]) {
    return fmin(fmax(0, (double)color[3]), 1);
}

/* Where the ray meets a triangle (Möller and Trumbore 1997), from either side: its t, or NaN. Also
 * the shares of the second and the third corner. */
static double meet(const struct picking *p, const uint32_t triangle[3], double shares[2]) {
    struct sp_vec3 corners[3];
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++)
            corners[k].v[a] = (double)p->elements->positions[triangle[k]][a];
    const struct sp_vec3 a = sp_vec3_sub(corners[1], corners[0]),
                         b = sp_vec3_sub(corners[2], corners[0]),
                         away = sp_vec3_sub(p->from, corners[0]);
    const struct sp_vec3 across = sp_vec3_cross(p->way, b), beside = sp_vec3_cross(away, a);
    const double det = sp_vec3_dot(a, across);
    shares[0] = sp_vec3_dot(away, across) / det;
    shares[1] = sp_vec3_dot(p->way, beside) / det;
    const bool is_inside = shares[0] >= 0 && shares[1] >= 0 && shares[0] + shares[1] <= 1;
    return is_inside ? sp_vec3_dot(b, beside) / det : NAN;
}

static bool pick_mesh(const struct picking *p) {
    const struct sp_elements *e = p->elements;
    for (uint32_t i = 0; i < e->shape.count; i++) {
        const uint32_t *corners = e->triangles[i];
        double shares[2], t = meet(p, corners, shares);
        if (!(t >= p->ray->begin && t <= p->ray->end))
            continue;
        const double opacity = (double)p->layer->opacity *
                               ((1 - shares[0] - shares[1]) * opacity_of(e->colors[corners[0]]) +
                                shares[0] * opacity_of(e->colors[corners[1]]) +
                                shares[1] * opacity_of(e->colors[corners[2]]));
        if (opacity > 0 && !add_event(p->events, t, opacity < 1 ? -log1p(-opacity) : INFINITY, NAN))
            return false;
    }
    return true;
}

static bool pick_layer(const struct sp_pick_input *input, const struct sp_ray *ray,
                       const struct sp_layer *layer, const struct sp_volume *volume,
                       struct sp_pick_events *events) {
    static const enum sp_kind kinds[SP_LAYER_TYPES] = { [SP_LAYER_VECTORS] = SP_KIND_POINTS,
                                                        [SP_LAYER_POINTS] = SP_KIND_POINTS,
                                                        [SP_LAYER_GAUSSIANS] = SP_KIND_GAUSSIANS,
                                                        [SP_LAYER_GEOMETRY] = SP_KIND_MESH };
    struct picking p = { .input = input,
                         .ray = ray,
                         .layer = layer,
                         .elements = sp_volume_elements(volume),
                         .events = events };
    if (!p.elements || p.elements->shape.kind != kinds[layer->type] || !picking_init(&p))
        return true; /* the image has nothing of it, either */
    events->tested += p.elements->shape.count;
    switch (p.elements->shape.kind) {
    case SP_KIND_POINTS:
        return pick_points(&p);
    case SP_KIND_GAUSSIANS:
        return pick_gaussians(&p);
    default:
        return pick_mesh(&p);
    }
}

static int by_t(const void *a, const void *b) {
    const struct sp_pick_event *x = a, *y = b;
    return (x->t > y->t) - (x->t < y->t);
}

bool sp_pick_elements(const struct sp_pick_input *input, const struct sp_ray *ray,
                      struct sp_pick_events *events, struct sp_error *err) {
    *events = (struct sp_pick_events){ 0 };
    for (uint32_t i = 0; i < input->view->layer_count && ray->begin < ray->end; i++) {
        const struct sp_layer *layer = &input->view->layers[i];
        if (!layer->visible || layer->type < SP_LAYER_VECTORS)
            continue;
        struct sp_volume *other =
            layer->id[0] && input->find ? input->find(input->user, layer->id) : NULL;
        const struct sp_volume *own = layer->id[0] ? other : input->volume;
        const bool ok = !own || pick_layer(input, ray, layer, own, events);
        sp_volume_unref(&other);
        if (!ok)
            return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for what the ray meets");
    }
    if (events->count)
        qsort(events->at, events->count, sizeof *events->at, by_t);
    return true;
}

void sp_pick_events_finish(struct sp_pick_events *events) {
    free(events->at);
    *events = (struct sp_pick_events){ 0 };
}
