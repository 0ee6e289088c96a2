/* SPDX-License-Identifier: Apache-2.0
 *
 * Splats of trained Gaussians. They are set up in the order of memory, where the processor reads
 * ahead by itself, and copied in the order of depth: then each is one line of the cache, where its
 * Gaussian would be seven.
 */
#include <math.h>

#include "draw/layers/cloud/place.h"
#include "draw/layers/splat_list/closed.h"
#include "draw/layers/splat_list/record.h"

enum { AHEAD = 32 }; /* elements or splats that are read in advance */

/* Some Gaussians side by side. */
struct lanes {
    sp_wide position[3], factor[6], opacity;
};

static inline void prefetch(const struct sp_elements *e, uint32_t number) {
    const uint32_t numbers = 3 * sp_harmonics_count(e->shape.degree);
    __builtin_prefetch(e->positions[number]);
    __builtin_prefetch(e->factors[number]);
    __builtin_prefetch(&e->opacities[number]);
    for (uint32_t i = 0; i < numbers; i += 16) /* a cache line */
        __builtin_prefetch(e->harmonics + (size_t)number * numbers + i);
}

/* Reads up to SP_WIDE Gaussians; lanes without one get the first. Indices of numbers fit 31 bits:
 * 6 * SP_ELEMENTS_MAX do. */
static inline void read_gaussians(const struct sp_elements *e, const uint32_t *elements, int count,
                                  struct lanes *to) {
    sp_wide_int at;
    for (int i = 0; i < SP_WIDE; i++)
        at[i] = (int32_t)elements[i < count ? i : 0];
    for (int k = 0; k < 3; k++)
        to->position[k] = sp_wide_gather(e->positions[0] + k, 3 * at);
    for (int k = 0; k < 6; k++)
        to->factor[k] = sp_wide_gather(e->factors[0] + k, 6 * at);
    to->opacity = sp_wide_gather(e->opacities, at);
}

/* The lanes whose centres the clip planes keep. */
static inline sp_wide_mask mask_kept(const struct sp_clip_frame *clip, const sp_wide u[3]) {
    sp_wide_mask kept = sp_wide_first(SP_WIDE);
    for (uint32_t i = 0; i < clip->count; i++) {
        const float *n = clip->planes[i].normal;
        kept &= sp_wide_le(sp_wide_all(clip->planes[i].offset),
                           n[0] * u[0] + n[1] * u[1] + n[2] * u[2]);
    }
    return kept;
}

/* Some Gaussians in the image. */
struct splats {
    struct sp_outlines outline;
    sp_wide opacity;                /* at the centre */
    struct sp_close close[SP_WIDE]; /* of the lanes in the bits `is_close` */
    unsigned is_close;
};

/* Changes the splats of Gaussians close to the eye, whose opacity without the filter is `own`.
 * Returns the lanes that are drawn; `seen`: if none were close. */
static __attribute__((noinline)) unsigned
place_close(const struct sp_cloud *cloud, const struct sp_ewa_frame *f, const struct sp_places *p,
            const float own[SP_WIDE], unsigned seen, struct splats *s) {
    for (unsigned bits = s->is_close; bits; bits &= bits - 1) {
        const int i = __builtin_ctz(bits);
        const unsigned bit = 1u << i;
        const bool is_seen = seen & bit;
        struct sp_close_kernel k;
        seen &= ~bit;
        sp_close_measure(f, p, i, SP_CLOUD_LOWPASS2, &k);
        const double filtered =
            cloud->is_normalised && k.square > 0 ? sqrt(k.own / (k.det * k.square)) : 1;
        const double opacity = (double)own[i] * filtered;
        const double parts = opacity / (double)SP_TRAINED_OPACITY_MIN;
        if (!(parts > 1))
            continue;
        if (sp_close_place(f, &k, sqrt(2 * log(parts)), false, is_seen, i, &s->outline,
                           &s->close[i]))
            seen |= bit;
        if (sp_close_is_around(&s->close[i]))
            s->opacity[i] = (float)(opacity * sp_close_fold(&k, &s->close[i]));
    }
    return seen;
}

/* Outlines of trained Gaussians, which end where their opacity does. s->opacity is that of
 * the data, and becomes the opacity at the centre. Returns the lanes that are drawn. */
static inline unsigned outline_trained(const struct sp_cloud *cloud, const struct sp_ewa_frame *f,
                                       struct sp_places *p, struct splats *s) {
    struct sp_outlines *o = &s->outline;
    const sp_wide own = s->opacity * cloud->opacity;
    sp_wide v[3];
    const sp_wide_mask kept = mask_kept(&f->clip, p->u);
    sp_wide_mask seen = sp_place_centres(f, p, o) & kept;
    sp_wide det = sp_place_variance((const sp_wide(*)[3])p->m, SP_CLOUD_LOWPASS2, v);
    s->opacity = own;
    if (cloud->is_normalised)
        s->opacity *= sp_wide_sqrt(sp_place_cross((const sp_wide(*)[3])p->m) / det);
    sp_wide parts = s->opacity * (1 / SP_TRAINED_OPACITY_MIN);
    seen &= sp_wide_lt(sp_wide_all(1), parts) & sp_wide_lt(det, sp_wide_all(1e36f));
    sp_wide radius =
        sp_wide_sqrt(2 / SP_LOG2E * sp_wide_log2(sp_wide_max(parts, sp_wide_all(1.000001f))));
    sp_wide half = 0.5f * SP_LOG2E / det;
    o->a = half * v[2];
    o->b = -2 * half * v[1];
    o->c = half * v[0];
    o->area = (float)M_PI * radius * radius * sp_wide_sqrt(det);
    /* A little more than the logarithm's error: pixels decide by their own opacity. */
    const float slack = 1.0001f;
    sp_wide rx = slack * radius * sp_wide_sqrt(v[0]), ry = slack * radius * sp_wide_sqrt(v[2]);
    seen &= sp_place_cover(o->y, ry, f->rows[0], f->rows[1], &o->y0, &o->y1) &
            sp_place_cover(o->x, rx, 0, f->size[0], &o->x0, &o->x1);
    const float radius_max = 3.4f; /* √(2 ln 255), where an opaque one ends */
    const sp_wide_mask close = sp_close_select(f, p, radius_max, SP_CLOUD_LOWPASS2) & kept;
    s->is_close = sp_wide_any(close) ? sp_wide_mask_bits(close) : 0;
    if (!s->is_close)
        return sp_wide_mask_bits(seen);
    float opacities[SP_WIDE];
    sp_wide_store(opacities, own);
    return place_close(cloud, f, p, opacities, sp_wide_mask_bits(seen), s);
}

/* Directions from the eye, of unit length, in the world of the data. */
static inline void compute_directions(const struct sp_cloud *cloud, const sp_wide position[3],
                                      sp_wide d[3]) {
    sp_wide square = sp_wide_all(0);
    for (int a = 0; a < 3; a++) {
        d[a] = sp_wide_all(cloud->eye[a]);
        if (!cloud->is_orthographic)
            d[a] = position[a] - d[a];
        square += d[a] * d[a];
    }
    sp_wide inverse = 1 / sp_wide_sqrt(sp_wide_max(square, sp_wide_all(1e-30f)));
    for (int a = 0; a < 3; a++)
        d[a] *= inverse;
}

/* The real spherical harmonics, in the order and with the signs of Kerbl et al. (2023):
 * basis[sp_harmonics_count(degree)]. */
static inline void compute_harmonics(unsigned degree, const sp_wide d[3], float basis[][SP_WIDE]) {
    const sp_wide x = d[0], y = d[1], z = d[2], xx = x * x, yy = y * y, zz = z * z;
    sp_wide_store(basis[0], sp_wide_all(0.28209479f));
    if (degree < 1)
        return;
    sp_wide_store(basis[1], -0.48860251f * y);
    sp_wide_store(basis[2], 0.48860251f * z);
    sp_wide_store(basis[3], -0.48860251f * x);
    if (degree < 2)
        return;
    sp_wide_store(basis[4], 1.09254843f * x * y);
    sp_wide_store(basis[5], -1.09254843f * y * z);
    sp_wide_store(basis[6], 0.31539157f * (2 * zz - xx - yy));
    sp_wide_store(basis[7], -1.09254843f * x * z);
    sp_wide_store(basis[8], 0.54627422f * (xx - yy));
    if (degree < 3)
        return;
    sp_wide_store(basis[9], -0.59004359f * y * (3 * xx - yy));
    sp_wide_store(basis[10], 2.89061144f * x * y * z);
    sp_wide_store(basis[11], -0.45704580f * y * (4 * zz - xx - yy));
    sp_wide_store(basis[12], 0.37317633f * z * (2 * zz - 3 * xx - 3 * yy));
    sp_wide_store(basis[13], -0.45704580f * x * (4 * zz - xx - yy));
    sp_wide_store(basis[14], 1.44530572f * z * (xx - yy));
    sp_wide_store(basis[15], -0.59004359f * x * (xx - 3 * yy));
}

/* Colour of a Gaussian; may be above 1. Four numbers are read where three are needed, but for the
 * last coefficient, behind which the array may end. */
static inline void compute_color(const struct sp_elements *e, uint32_t element,
                                 const float basis[][SP_WIDE], int lane, float color[3]) {
    typedef float four __attribute__((vector_size(16), aligned(4)));
    const uint32_t last = sp_harmonics_count(e->shape.degree) - 1;
    const float *c = e->harmonics + (size_t)element * 3 * (last + 1);
    four sum = { 0.5f, 0.5f, 0.5f, 0 }, more = { 0 };
    for (uint32_t i = 0; i + 1 < last; i += 2) {
        sum += basis[i][lane] * *(const four *)(const void *)(c + 3 * (size_t)i);
        more += basis[i + 1][lane] * *(const four *)(const void *)(c + 3 * (size_t)i + 3);
    }
    if (last & 1)
        sum += basis[last - 1][lane] * *(const four *)(const void *)(c + 3 * (size_t)last - 3);
    sum += more;
    for (uint32_t k = 0; k < 3; k++) {
        color[k] = sum[k] + basis[last][lane] * c[3 * last + k];
        color[k] = color[k] > 0 ? color[k] : 0;
        color[k] = color[k] < SP_CLOUD_COLOR_MAX ? color[k] : SP_CLOUD_COLOR_MAX;
    }
}

static inline void write_records(const struct sp_cloud *cloud, const struct lanes *lanes,
                                 const struct splats *s, sp_wide u2, const uint32_t *elements,
                                 unsigned bits, struct sp_voxel_record *out) {
    const struct sp_elements *e = cloud->elements;
    _Alignas(64) float basis[16][SP_WIDE];
    sp_wide d[3];
    compute_directions(cloud, lanes->position, d);
    compute_harmonics(e->shape.degree, d, basis);
    for (; bits; bits &= bits - 1, out++) {
        const int i = __builtin_ctz(bits);
        sp_voxel_record_write(&s->outline, i, s->opacity[i], u2[i],
                              s->is_close >> i & 1 ? &s->close[i] : NULL, out);
        compute_color(e, elements[i], (const float(*)[SP_WIDE])basis, i, out->color);
    }
}

/* Copies splats that are set up, with the part of their boxes that lies in the rows. */
static uint32_t copy_splats(const struct sp_voxel_frame *frame, const struct sp_cloud *cloud,
                            const uint32_t *numbers, uint32_t count, struct sp_voxel_record *out) {
    const int *rows = frame->ewa.rows;
    uint32_t written = 0;
    for (uint32_t n = 0; n < count; n++) {
        struct sp_voxel_record *to = &out[written];
        if (n + AHEAD < count)
            __builtin_prefetch(&cloud->splats[numbers[n + AHEAD]]);
        *to = cloud->splats[numbers[n]];
        to->y0 = to->y0 < rows[0] ? (int16_t)rows[0] : to->y0;
        to->y1 = to->y1 > rows[1] ? (int16_t)rows[1] : to->y1;
        written += to->y0 < to->y1 &&
                   !(frame->closed && sp_voxel_is_covered(frame, to->x0, to->y0, to->x1, to->y1));
    }
    return written;
}

uint32_t sp_cloud_set_up_gaussians(const struct sp_voxel_frame *frame, const struct sp_cloud *cloud,
                                   const uint32_t *elements, uint32_t count,
                                   struct sp_voxel_record *out) {
    uint32_t written = 0;
    if (cloud->splats)
        return copy_splats(frame, cloud, elements, count, out);
    for (uint32_t n = 0; n < count; n += SP_WIDE) {
        const int left = count - n < SP_WIDE ? (int)(count - n) : SP_WIDE;
        struct lanes lanes;
        struct sp_places p;
        struct splats s;
        for (uint32_t i = n + AHEAD; i < n + AHEAD + SP_WIDE && i < count; i++)
            prefetch(cloud->elements, elements[i]);
        read_gaussians(cloud->elements, elements + n, left, &lanes);
        sp_cloud_place(cloud, lanes.position, lanes.factor, &p);
        s.opacity = lanes.opacity;
        unsigned bits =
            outline_trained(cloud, &frame->ewa, &p, &s) & sp_wide_mask_bits(sp_wide_first(left));
        if (frame->closed)
            bits = sp_voxel_drop_covered(frame, &s.outline, bits);
        if (bits)
            write_records(cloud, &lanes, &s, p.u[2], elements + n, bits, out + written);
        written += (uint32_t)__builtin_popcount(bits);
    }
    return written;
}
