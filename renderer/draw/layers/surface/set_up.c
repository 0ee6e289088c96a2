/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/surface/footprint.h"
#include "splat/exp2.h"

typedef uint16_t places __attribute__((vector_size(SP_WIDE * 2)));
typedef int16_t shorts __attribute__((vector_size(SP_WIDE * 2)));

static inline sp_wide_int load_places(const uint16_t *p) {
    places a;
    memcpy(&a, p, sizeof a);
    return __builtin_convertvector(a, sp_wide_int);
}

static inline sp_wide load_shorts(const int16_t *p) {
    shorts a;
    memcpy(&a, p, sizeof a);
    return sp_wide_from_int(__builtin_convertvector(a, sp_wide_int));
}

static inline sp_wide dot(const sp_wide a[3], const sp_wide b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Points in camera space. */
struct points {
    sp_wide u[3];      /* [cells] */
    sp_wide area[3];   /* [cells²] */
    sp_wide normal[3]; /* unit, or 0 */
    sp_wide size[3];   /* local spacing [mean spacings], less close to the eye */
    sp_wide share;     /* of the kernel's size far from the eye */
};

static inline void read_places(const struct sp_surface *s, const struct sp_surface_cells *cells,
                               uint64_t first, struct points *p) {
    const float step = 1 / SURFACE_PLACE_STEPS;
    const sp_wide one = sp_wide_all(1);
    sp_wide at[3], area[3], gap[3] = { one, one, one };
    for (int a = 0; a < 3; a++) {
        sp_wide_int place = load_places(cells->points->at[a] + first);
        at[a] = sp_wide_from_int(place) * step;
        area[a] = load_shorts(cells->points->area[a] + first) * cells->area_step;
        p->size[a] = one;
        if (!cells->is_rectilinear)
            continue;
        sp_wide_int cell = place >> 13;
        sp_wide share = at[a] - sp_wide_from_int(cell);
        gap[a] = sp_wide_gather(cells->gap[a], cell);
        at[a] = sp_wide_gather(cells->start[a], cell) + share * gap[a];
        sp_wide low = sp_wide_gather(cells->size[a], cell);
        p->size[a] = low + share * (sp_wide_gather(cells->size[a], cell + 1) - low);
    }
    for (int a = 0; a < 3 && cells->is_rectilinear; a++)
        area[a] *= gap[(a + 1) % 3] * gap[(a + 2) % 3];
    for (int r = 0; r < 3; r++) {
        const float *c = s->frame.step[r], *f = s->facing[r];
        p->u[r] = cells->base[r] + c[0] * at[0] + c[1] * at[1] + c[2] * at[2];
        p->area[r] = f[0] * area[0] + f[1] * area[1] + f[2] * area[2];
    }
}

/* Makes kernels smaller that are close to the eye (focus.h). Returns where kernels are kept. */
static inline sp_wide_mask focus(const struct sp_surface *s, struct points *p) {
    sp_wide distance = sp_wide_sqrt(dot(p->u, p->u));
    p->share = sp_wide_clamp(distance * s->focus.growth, s->focus.least, 1);
    for (int a = 0; a < 3; a++)
        p->size[a] *= p->share;
    return sp_wide_lt(sp_wide_all(s->focus.nearest), distance);
}

static inline void read_normals(const struct sp_surface *s, const struct sp_surface_points *points,
                                uint64_t first, struct points *p) {
    const float unit = 1 / SURFACE_NORMAL_STEPS;
    sp_wide n[3];
    for (int a = 0; a < 3; a++)
        n[a] = load_shorts(points->normal[a] + first) * unit;
    for (int r = 0; r < 3; r++) {
        const float *w = s->to_camera[r];
        p->normal[r] = w[0] * n[0] + w[1] * n[1] + w[2] * n[2];
    }
    sp_wide bend = load_shorts(points->bend + first) * s->bend * p->share * p->share;
    for (int r = 0; r < 3; r++)
        p->u[r] += p->normal[r] * bend;
}

/* Rows of the kernel, flattened along q, the direction of the gradient in index space:
 * K·(I − (1 − 1/s)·q·qᵀ), q = Kᵀn/|Kᵀn|. */
static inline void flatten(const struct sp_surface *s, const struct points *p, sp_wide k[3][3]) {
    sp_wide q[3], square = sp_wide_all(1e-30f);
    for (int a = 0; a < 3; a++) {
        q[a] = sp_wide_all(0);
        for (int r = 0; r < 3; r++) {
            k[r][a] = s->frame.kernel[r][a] * p->size[a];
            q[a] += p->normal[r] * k[r][a];
        }
        square += q[a] * q[a];
    }
    sp_wide factor = s->squeeze / square;
    for (int r = 0; r < 3; r++) {
        sp_wide along = dot(k[r], q) * factor;
        for (int a = 0; a < 3; a++)
            k[r][a] -= along * q[a];
    }
}

/* Where clipping leaves something of a kernel: its reach and a pixel of the low-pass filter are the
 * margin. */
static inline sp_wide_mask is_kept(const struct sp_surface *s, const struct points *p,
                                   sp_wide margin) {
    sp_wide least = sp_wide_all(INFINITY);
    for (uint32_t i = 0; i < s->clip.count; i++) {
        const struct sp_clip_half *h = &s->clip.planes[i];
        least = sp_wide_min(h->normal[0] * p->u[0] + h->normal[1] * p->u[1] +
                                h->normal[2] * p->u[2] - h->offset,
                            least);
    }
    return sp_wide_lt(-margin, least);
}

static inline void store_int(int32_t *to, sp_wide x) {
    sp_wide_int_store(to, sp_wide_to_int(x));
}

/* Stores the part of the box [x ± half] that lies in the tile; returns where there is any. */
static inline sp_wide_mask store_box(int32_t *low, int32_t *high, sp_wide x, sp_wide half) {
    const sp_wide zero = sp_wide_all(0), side = sp_wide_all(SP_FRAGMENT_TILE);
    /* Pixels whose centres are inside. */
    sp_wide begin = sp_wide_max(sp_wide_floor(x - half + 0.5f), zero);
    sp_wide end = sp_wide_min(sp_wide_floor(x + half + 0.5f), side);
    store_int(low, sp_wide_min(begin, side));
    store_int(high, sp_wide_max(end, zero));
    return sp_wide_lt(begin, end);
}

/* Rows 0 and 1 of J·K, and the vector area's share along the ray. */
struct projected {
    sp_wide m[2][3], facing;
};

static inline void project(const struct sp_ewa_frame *f, const struct points *p, sp_wide inverse,
                           const sp_wide k[3][3], struct projected *out) {
    const bool is_perspective = f->projection == SP_PERSPECTIVE;
    const sp_wide scale = f->scale * inverse;
    out->facing = p->area[2];
    for (int i = 0; i < 2; i++) {
        sp_wide ratio = is_perspective ? p->u[i] * inverse : sp_wide_all(0);
        out->facing += p->area[i] * ratio;
        ratio = sp_wide_clamp(ratio, -f->ratio_max[i], f->ratio_max[i]);
        for (int a = 0; a < 3; a++)
            out->m[i][a] = scale * (k[i][a] - ratio * k[2][a]);
    }
}

static inline void cross(const sp_wide a[3], const sp_wide b[3], sp_wide out[3]) {
    for (int i = 0; i < 3; i++)
        out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

/* Standard deviation along the view of the kernel that is not flat. */
static inline sp_wide thickness(const struct sp_ewa_frame *f, const struct points *p) {
    sp_wide sum = sp_wide_all(0);
    for (int a = 0; a < 3; a++)
        sum += f->kernel[2][a] * f->kernel[2][a] * p->size[a] * p->size[a];
    return sp_wide_sqrt(sum);
}

/* Depths that differ by less than this belong to one sheet: it bends within a kernel, and the
 * low-pass filter spreads it, as it does a plane of 60° [cells]. */
static inline sp_wide compute_tolerance(const struct sp_surface *s, const struct points *p,
                                        sp_wide scale) {
    const float steep = 1.75f;
    return s->tolerance * (thickness(&s->frame, p) + steep * sqrtf(s->frame.lowpass2) / scale);
}

/* Writes everything but centres and normals. Returns which footprints touch the tile. */
static inline sp_wide_mask write_ellipses(const struct sp_surface *s, const struct points *p,
                                          sp_wide inverse, struct sp_surface_footprints *out) {
    const struct sp_ewa_frame *f = &s->frame;
    const sp_wide scale = f->scale * inverse;
    const float h2 = f->lowpass2;
    sp_wide k[3][3], area[3];
    struct projected image;
    flatten(s, p, k);
    project(f, p, inverse, k, &image);
    sp_wide v00 = dot(image.m[0], image.m[0]), v01 = dot(image.m[0], image.m[1]);
    sp_wide v11 = dot(image.m[1], image.m[1]), v02 = dot(image.m[0], k[2]);
    sp_wide v12 = dot(image.m[1], k[2]);
    cross(image.m[0], image.m[1], area);
    sp_wide det = dot(area, area) + h2 * (v00 + v11) + h2 * h2, over = 1 / det;
    sp_wide i00 = (v11 + h2) * over, i01 = -v01 * over, i11 = (v00 + h2) * over;
    sp_wide slope[2] = { i00 * v02 + i01 * v12, i01 * v02 + i11 * v12 };
    sp_wide peak = scale * scale * sp_wide_abs(image.facing) * f->peak / sp_wide_sqrt(det);
    sp_wide x = sp_wide_load(out->x), y = sp_wide_load(out->y);
    sp_wide_store(out->a, 0.5f * SP_LOG2E * i00);
    sp_wide_store(out->b, SP_LOG2E * i01);
    sp_wide_store(out->c, 0.5f * SP_LOG2E * i11);
    sp_wide_store(out->peak, peak);
    sp_wide_store(out->depth, p->u[2] - s->depth_first);
    sp_wide_store(out->slope[0], slope[0]);
    sp_wide_store(out->slope[1], slope[1]);
    sp_wide_store(out->tolerance, compute_tolerance(s, p, scale));
    out->back = sp_wide_mask_bits(sp_wide_lt(sp_wide_all(0), image.facing));
    return sp_wide_lt(sp_wide_all(1e-6f), peak) & sp_wide_lt(peak, sp_wide_all(1e30f)) &
           store_box(out->x0, out->x1, x, f->radius * sp_wide_sqrt(v00 + h2)) &
           store_box(out->y0, out->y1, y, f->radius * sp_wide_sqrt(v11 + h2));
}

void sp_surface_set_up(const struct sp_surface *s, const struct sp_surface_cells *cells,
                       uint64_t first, int n, const int corner[2],
                       struct sp_surface_footprints *out) {
    const struct sp_ewa_frame *f = &s->frame;
    const bool is_perspective = f->projection == SP_PERSPECTIVE;
    const sp_wide one = sp_wide_all(1), near = sp_wide_all(0.5f * f->near);
    const sp_wide half_side = sp_wide_all(0.5f * SP_FRAGMENT_TILE);
    struct points p;
    out->seen = 0;
    read_places(s, cells, first, &p);
    p.share = one;
    sp_wide_mask alive = sp_wide_first(n);
    if (s->focus.growth > 0)
        alive = alive & focus(s, &p);
    read_normals(s, cells->points, first, &p);
    sp_wide inverse = is_perspective ? 1 / sp_wide_max(p.u[2], near) : one;
    sp_wide scale = f->scale * inverse;
    sp_wide x = f->centre[0] - (float)corner[0] + scale * p.u[0];
    sp_wide y = f->centre[1] - (float)corner[1] + scale * p.u[1];
    sp_wide largest = sp_wide_max(sp_wide_max(p.size[0], p.size[1]), p.size[2]);
    sp_wide blur = sp_wide_all(f->radius * sqrtf(f->lowpass2));
    sp_wide most = blur + half_side + s->reach * s->stretch * largest * scale;
    alive = alive & sp_wide_le(near, p.u[2]) & sp_wide_lt(sp_wide_abs(x - half_side), most) &
            sp_wide_lt(sp_wide_abs(y - half_side), most);
    if (s->clip.count)
        alive = alive & is_kept(s, &p, s->reach * largest + (blur + 2) / scale);
    if (!sp_wide_any(alive))
        return;
    sp_wide_store(out->x, x);
    sp_wide_store(out->y, y);
    for (int r = 0; r < 3; r++)
        sp_wide_store(out->normal[r], p.normal[r]);
    out->seen = sp_wide_mask_bits(alive & write_ellipses(s, &p, inverse, out));
}
