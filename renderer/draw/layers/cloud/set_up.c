/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "draw/layers/cloud/place.h"
#include "draw/layers/splat_list/closed.h"
#include "draw/layers/splat_list/phase.h"
#include "draw/layers/splat_list/record.h"
#include "draw/layers/splat_list/streak.h"
#include "splat/outline.h"
#include "splat/pieces.h"

enum { AHEAD = 32 }; /* elements that are read in advance: they lie apart in memory */

/* Some points side by side. */
struct lanes {
    float position[3][SP_WIDE], factor[6][SP_WIDE];
    float value[SP_WIDE];
    float spread[SP_WIDE]; /* of the values of merged points; 0 = of a point */
    float color[SP_WIDE];  /* with other numbers for the colours */
    float volume[SP_WIDE];
    float part[SP_WIDE]; /* with parts: depth of this one [deviations] */
    /* Of a layer of vectors: */
    float vector[3][SP_WIDE];
    uint16_t phase[SP_WIDE];
};

static inline void prefetch(const struct sp_cloud *cloud, uint32_t number) {
    const uint32_t at = number / cloud->parts;
    const struct sp_elements *own = cloud->elements;
    const struct sp_cloud_element e = sp_cloud_element_at(cloud, at);
    __builtin_prefetch(e.position);
    if (cloud->records || at >= own->shape.count) /* this is all of it */
        return;
    __builtin_prefetch(e.factor);
    __builtin_prefetch(e.value);
    __builtin_prefetch(e.volume);
}

static inline void read_elements(const struct sp_cloud *cloud, const uint32_t *elements, int count,
                                 struct lanes *to) {
    for (int i = 0; i < SP_WIDE; i++) {
        const uint32_t number = elements[i < count ? i : 0], at = number / cloud->parts;
        const struct sp_cloud_element e = sp_cloud_element_at(cloud, at);
        to->part[i] = cloud->part_at[number - at * cloud->parts];
        if (i + AHEAD < count)
            prefetch(cloud, elements[i + AHEAD]);
        for (int k = 0; k < 3; k++)
            to->position[k][i] = e.position[k];
        for (int k = 0; k < 6; k++)
            to->factor[k][i] = e.factor[k];
        to->value[i] = *e.value;
        to->volume[i] = *e.volume;
    }
}

static inline void read_spreads(const struct sp_cloud *cloud, const uint32_t *elements, int count,
                                struct lanes *to) {
    const uint32_t points = cloud->elements->shape.count;
    for (int i = 0; i < SP_WIDE; i++) {
        const uint32_t at = elements[i < count ? i : 0] / cloud->parts;
        to->spread[i] =
            at < points ? 0 : sp_cloud_spread(cloud->tree, &cloud->tree->nodes[at - points]);
    }
}

static inline void read_colors(const struct sp_cloud *cloud, const uint32_t *elements, int count,
                               struct lanes *to) {
    for (int i = 0; i < SP_WIDE; i++) {
        const uint32_t at = elements[i < count ? i : 0] / cloud->parts;
        const bool is_record = cloud->records && at < cloud->elements->shape.count;
        const float number =
            is_record ? cloud->records[at].color : sp_cloud_color_number(cloud, at);
        const bool is_number = number - number == 0;
        to->color[i] =
            cloud->color_first + (is_number ? (number - cloud->color_low) * cloud->color_scale : 0);
    }
}

static inline void read_vectors(const struct sp_cloud *cloud, const uint32_t *elements, int count,
                                struct lanes *to) {
    for (int i = 0; i < SP_WIDE; i++) {
        const uint32_t at = elements[i < count ? i : 0];
        for (int k = 0; k < 3; k++)
            to->vector[k][i] = cloud->elements->vectors[at][k];
        to->phase[i] = (uint16_t)sp_streak_hash(at);
    }
}

static inline void locate(const struct sp_cloud *cloud, const struct lanes *lanes,
                          struct sp_places *p) {
    sp_wide position[3], factor[6];
    for (int k = 0; k < 3; k++)
        position[k] = sp_wide_load(lanes->position[k]);
    for (int k = 0; k < 6; k++)
        factor[k] = sp_wide_load(lanes->factor[k]);
    sp_cloud_place(cloud, position, factor, p);
}

/* Reduces kernels to their parts: u moves to the part. The kernel, K·ξ of a standard normal ξ,
 * keeps the directions of ξ without depth, and a little of the direction with depth. */
static inline void reduce_to_parts(const struct sp_cloud *cloud, const struct lanes *lanes,
                                   struct sp_places *p) {
    sp_wide n[3], square = sp_wide_all(1e-30f);
    for (int a = 0; a < 3; a++)
        square += p->kernel[2][a] * p->kernel[2][a];
    const sp_wide inverse = 1 / sp_wide_sqrt(square), part = sp_wide_load(lanes->part);
    for (int a = 0; a < 3; a++)
        n[a] = p->kernel[2][a] * inverse;
    for (int r = 0; r < 3; r++) {
        const sp_wide along =
            p->kernel[r][0] * n[0] + p->kernel[r][1] * n[1] + p->kernel[r][2] * n[2];
        p->u[r] += part * along;
        for (int a = 0; a < 3; a++)
            p->kernel[r][a] -= (1 - cloud->part_deviation) * along * n[a];
    }
}

/* The standard deviation of kernels along unit vectors d of the world of the data: |L⁻¹·d|⁻¹, so
 * that streaks are as long in cells whatever the shape of a cell is. Flat kernels have 0. */
static inline sp_wide deviation_along(const struct lanes *lanes, const sp_wide d[3]) {
    const sp_wide tiny = sp_wide_all(1e-20f);
    sp_wide l[6], y[3];
    for (int k = 0; k < 6; k++)
        l[k] = sp_wide_load(lanes->factor[k]);
    y[0] = d[0] / sp_wide_max(l[0], tiny);
    y[1] = (d[1] - l[1] * y[0]) / sp_wide_max(l[2], tiny);
    y[2] = (d[2] - l[3] * y[0] - l[4] * y[1]) / sp_wide_max(l[5], tiny);
    sp_wide deviation = 1 / sp_wide_sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2]);
    return sp_wide_keep(sp_wide_lt(deviation, sp_wide_all(INFINITY)), deviation);
}

/* Places the splats of a layer of vectors. */
static inline sp_wide_mask place_streaks(const struct sp_voxel_frame *frame,
                                         const struct sp_cloud *cloud, const struct lanes *lanes,
                                         struct sp_places *p, struct sp_outlines *o,
                                         struct sp_streak_places *s) {
    sp_wide d[3], seen_d[3], sum = sp_wide_all(0), square = sp_wide_all(0);
    for (int a = 0; a < 3; a++)
        sum += sp_wide_abs(d[a] = sp_wide_load(lanes->vector[a]));
    const sp_wide_mask moves =
        sp_wide_lt(sp_wide_all(0), sum) & sp_wide_lt(sum, sp_wide_all(INFINITY));
    for (int a = 0; a < 3; a++) {
        d[a] = sp_wide_keep(moves, d[a] / sum);
        square += d[a] * d[a];
    }
    sp_wide inverse = sp_wide_keep(moves, 1 / sp_wide_sqrt(square));
    for (int a = 0; a < 3; a++)
        d[a] *= inverse;
    square = sp_wide_all(0);
    for (int r = 0; r < 3; r++) {
        seen_d[r] =
            cloud->place[r][0] * d[0] + cloud->place[r][1] * d[1] + cloud->place[r][2] * d[2];
        square += seen_d[r] * seen_d[r];
    }
    const sp_wide size = sp_wide_sqrt(square); /* of a world unit there [cells] */
    inverse = sp_wide_keep(moves, 1 / size);
    for (int r = 0; r < 3; r++)
        seen_d[r] *= inverse;
    const sp_wide sigma = cloud->size * size * deviation_along(lanes, d);
    return sp_streak_keep_moving(
        &frame->streaks, sp_streak_place(&frame->ewa, &frame->streaks, p, seen_d, sigma, o, s),
        moves, s);
}

/* Splats while they are set up. */
struct splats {
    struct sp_outlines outline;
    struct sp_streak_places streaks; /* of a layer of vectors */
    struct sp_close close[SP_WIDE];  /* of the lanes in the bits `is_close` */
    unsigned is_close;
    sp_wide u2, depth, color[3];
};

/* Red, green, blue and depth of points: of merged ones the mean depth of the values inside, and
 * their colours weighted by it. The colour of the mean value would be another one. */
static inline void classify(const struct sp_cloud *cloud, const struct lanes *lanes,
                            sp_wide planes[4]) {
    const sp_wide value = sp_wide_load(lanes->value) - cloud->base;
    const sp_wide spread = cloud->tree ? sp_wide_load(lanes->spread) : sp_wide_all(0);
    sp_wide sum[4] = { sp_wide_all(0), sp_wide_all(0), sp_wide_all(0), sp_wide_all(0) };
    const sp_wide_mask is_merged = sp_wide_lt(sp_wide_all(0), spread);
    sp_pieces_planes(cloud->pieces, value, planes);
    if (!sp_wide_any(is_merged))
        return;
    for (int i = 0; i < SP_CLOUD_SHARES; i++) {
        sp_wide share[4];
        sp_pieces_planes(cloud->pieces, value + sp_cloud_share_at[i] * spread, share);
        for (int k = 0; k < 3; k++)
            sum[k] += share[3] * share[k];
        sum[3] += share[3];
    }
    const sp_wide inverse = 1 / sp_wide_max(sum[3], sp_wide_all(1e-30f));
    for (int k = 0; k < 3; k++)
        planes[k] = sp_wide_select(is_merged, inverse * sum[k], planes[k]);
    planes[3] = sp_wide_select(is_merged, (1.0f / SP_CLOUD_SHARES) * sum[3], planes[3]);
}

/* Returns the lanes that are drawn. */
static inline unsigned set_up_points(const struct sp_voxel_frame *frame,
                                     const struct sp_cloud *cloud, const struct lanes *lanes,
                                     struct sp_places *p, struct splats *s) {
    sp_wide planes[4];
    unsigned seen = sp_wide_mask_bits(
        frame->has_streaks ? place_streaks(frame, cloud, lanes, p, &s->outline, &s->streaks)
                           : sp_place_splats(&frame->ewa, p, frame->mode, &s->outline));
    s->is_close = 0;
    if (!frame->has_streaks)
        seen = sp_close_place_all(&frame->ewa, p, seen, &s->outline, &s->is_close, s->close);
    classify(cloud, lanes, planes);
    const sp_wide opacity = planes[3];
    if (sp_cloud_has_colors(cloud))
        sp_pieces_planes(cloud->pieces, sp_wide_load(lanes->color), planes);
    for (int k = 0; k < 3; k++)
        s->color[k] = planes[k];
    s->depth = opacity * frame->ewa.gain * (sp_wide_load(lanes->volume) * cloud->per_volume) *
               s->outline.gain;
    s->depth = sp_wide_min(s->depth, sp_wide_all(SP_DEPTH_MAX));
    return seen & sp_wide_mask_bits(sp_wide_lt(sp_wide_all(0), s->depth));
}

static inline void write_records(const struct splats *s, unsigned bits,
                                 struct sp_voxel_record *out) {
    for (; bits; bits &= bits - 1, out++) {
        const int i = __builtin_ctz(bits);
        sp_voxel_record_write(&s->outline, i, s->depth[i], s->u2[i],
                              s->is_close >> i & 1 ? &s->close[i] : NULL, out);
        for (int k = 0; k < 3; k++)
            out->color[k] = s->color[k][i];
    }
}

uint32_t sp_cloud_set_up(const struct sp_voxel_frame *frame, const void *from,
                         const uint32_t *elements, uint32_t count, struct sp_voxel_record *out) {
    const struct sp_cloud *cloud = from;
    uint32_t written = 0;
    if (frame->is_trained)
        return sp_cloud_set_up_gaussians(frame, cloud, elements, count, out);
    for (uint32_t n = 0; n < count; n += SP_WIDE) {
        int left = count - n < SP_WIDE ? (int)(count - n) : SP_WIDE;
        struct lanes lanes;
        struct sp_places p;
        struct splats s;
        read_elements(cloud, elements + n, (int)(count - n), &lanes);
        if (cloud->tree)
            read_spreads(cloud, elements + n, (int)(count - n), &lanes);
        if (sp_cloud_has_colors(cloud))
            read_colors(cloud, elements + n, (int)(count - n), &lanes);
        if (frame->has_streaks)
            read_vectors(cloud, elements + n, (int)(count - n), &lanes);
        locate(cloud, &lanes, &p);
        if (cloud->parts > 1)
            reduce_to_parts(cloud, &lanes, &p);
        unsigned bits =
            set_up_points(frame, cloud, &lanes, &p, &s) & sp_wide_mask_bits(sp_wide_first(left));
        s.u2 = p.u[2];
        if (frame->closed)
            bits = sp_voxel_drop_covered(frame, &s.outline, bits);
        write_records(&s, bits, out + written);
        if (frame->has_streaks)
            sp_streak_write(&frame->streaks, lanes.phase, &s.streaks, bits, out + written);
        written += (uint32_t)__builtin_popcount(bits);
    }
    return written;
}
