/* SPDX-License-Identifier: Apache-2.0 */
#include "splat/ewa.h"

#include "base/minmax.h"
#include "data/volume/grid.h"
#include "splat/outline.h"

/* Computes the third row of J·K, along the ray. */
static void project_depth(const struct sp_ewa_frame *f, const float kernel[3][3], const float u[3],
                          float inv, float m[3]) {
    float ratio[2] = { 0, 0 };
    if (f->projection == SP_PERSPECTIVE)
        for (int i = 0; i < 2; i++)
            ratio[i] = sp_clampf(u[i] * inv, -f->ratio_max[i], f->ratio_max[i]);
    float scale = 1 / sqrtf(1 + ratio[0] * ratio[0] + ratio[1] * ratio[1]);
    for (int a = 0; a < 3; a++)
        m[a] = (ratio[0] * kernel[0][a] + ratio[1] * kernel[1][a] + kernel[2][a]) * scale;
}

/* Computes the input for the extent of one of the voxels. */
static void get_place(const struct sp_ewa_frame *f, const struct sp_places *p, int lane,
                      struct sp_kernel_place *k) {
    *k = (struct sp_kernel_place){ .h2 = p->h2, .radius = f->radius };
    for (int r = 0; r < 3; r++) {
        k->u[r] = p->u[r][lane];
        for (int a = 0; a < 3; a++) {
            k->kernel[r][a] = p->kernel[r][a][lane];
            if (r < 2)
                k->m[r][a] = p->m[r][a][lane];
        }
    }
    project_depth(f, (const float(*)[3])k->kernel, k->u, p->inv[lane], k->m[2]);
    sp_wide v[3], det = sp_place_variance((const sp_wide(*)[3])p->m, p->h2, v);
    k->det = det[lane];
    k->inverse[0] = v[2][lane] / k->det;
    k->inverse[1] = -v[1][lane] / k->det;
    k->inverse[2] = v[0][lane] / k->det;
    k->distance = sp_ewa_distance(f, k->u);
}

/* Computes the depth range and the cuts of a placed splat. False if the clipping planes leave
 * nothing of it. */
static bool write_extent(const struct sp_ewa_frame *f, const struct sp_places *p, int lane,
                         const struct sp_splats *out, uint32_t n) {
    struct sp_kernel_place k;
    get_place(f, p, lane, &k);
    if (out->cut) {
        int cuts = sp_extent_cut(&k, &f->clip, &out->cut[n]);
        if (cuts < 0)
            return false;
        out->splat[n].cuts = (uint32_t)cuts;
    }
    if (out->span)
        sp_extent_span(&k, &out->span[n]);
    return true;
}

/* What entries add to the pixels at the centres of their footprints. */
struct amounts {
    float depth[SP_WIDE], color[3][SP_WIDE];             /* post: length and gradient */
    float value[SP_WIDE];                                /* post: the scalar */
    uint32_t gradient[SP_WIDE], microflakes[2][SP_WIDE]; /* one of the two arrays is used */
};

/* Classifies the lanes in `bits`, whose entries are e[]. `gain` converts the depth of a class to τ.
 * Returns the lanes that add anything. */
static unsigned classify(const struct sp_ewa_run *run, const uint64_t *e, const float *gain,
                         unsigned bits, struct amounts *to) {
    unsigned left = 0;
    bool has_microflakes = sp_visible_has_microflakes(run->list);
    for (; bits; bits &= bits - 1) {
        int i = __builtin_ctz(bits);
        uint32_t key = sp_visible_key(run->list, e[i]);
        for (int k = 0; has_microflakes && k < 2; k++)
            to->microflakes[k][i] = sp_visible_microflakes(run->list, e[i])->word[k];
        if (run->list->normal && !has_microflakes)
            to->gradient[i] = sp_visible_normal(run->list, e[i]);
        struct sp_class c = sp_transfer_class_at(run->transfer, key, to->gradient[i]);
        to->depth[i] = c.depth * gain[i];
        if (!(to->depth[i] > 0))
            continue;
        to->depth[i] = to->depth[i] < SP_DEPTH_MAX ? to->depth[i] : SP_DEPTH_MAX;
        for (int k = 0; k < 3; k++)
            to->color[k][i] = c.color[k];
        left |= 1u << i;
    }
    return left;
}

static inline void shade(const struct sp_ewa_frame *f, const struct sp_ewa_run *run,
                         const struct sp_places *p, struct amounts *a) {
    sp_wide to_eye[3], color[3], lit[3], shine[3];
    sp_place_eye(f, p->u, to_eye);
    for (int k = 0; k < 3; k++)
        color[k] = sp_wide_load(a->color[k]);
    if (sp_visible_has_microflakes(run->list)) {
        const sp_wide_int word[2] = { sp_wide_int_load((const int32_t *)a->microflakes[0]),
                                      sp_wide_int_load((const int32_t *)a->microflakes[1]) };
        sp_shade_microflakes(run->shade, word, to_eye, lit, shine);
        for (int k = 0; k < 3; k++)
            color[k] = color[k] * lit[k] + shine[k];
    } else {
        sp_shade_apply(run->shade, sp_wide_int_load((const int32_t *)a->gradient), to_eye, color);
    }
    for (int k = 0; k < 3; k++)
        sp_wide_store(a->color[k], color[k]);
}

/* The same as classify() for post-classification: length, scalar and gradient. */
static void read_scalars(const struct sp_ewa_run *run, const uint64_t *e, const float *gain,
                         unsigned bits, struct amounts *to) {
    for (; bits; bits &= bits - 1) {
        int i = __builtin_ctz(bits);
        float direction[3] = { 0, 0, 0 }, share = 0;
        to->depth[i] = gain[i] < SP_DEPTH_MAX ? gain[i] : SP_DEPTH_MAX;
        to->value[i] = sp_transfer_value(run->transfer, sp_visible_key(run->list, e[i]));
        if (run->list->normal) {
            uint32_t packed = sp_visible_normal(run->list, e[i]);
            sp_gradient_unpack(packed, direction);
            share = sp_gradient_share(packed);
        }
        for (int k = 0; k < 3; k++)
            to->color[k][i] = direction[k] * share;
    }
}

static inline void write_splat(const struct sp_outlines *o, const struct amounts *a, int lane,
                               struct sp_splat *s) {
    s->x = o->x[lane];
    s->y = o->y[lane];
    s->a = o->a[lane];
    s->b = o->b[lane];
    s->c = o->c[lane];
    s->x0 = (int16_t)o->x0[lane];
    s->y0 = (int16_t)o->y0[lane];
    s->x1 = (int16_t)o->x1[lane];
    s->y1 = (int16_t)o->y1[lane];
    s->area = o->area[lane];
    s->depth = a->depth[lane];
    for (int k = 0; k < 3; k++)
        s->emission[k] = a->color[k][lane] * a->depth[lane];
}

/* Computes the voxels' positions; returns the volumes of their cells, divided by the mean volume.
 */
static inline sp_wide locate(const struct sp_ewa_frame *f, const struct sp_ewa_brick *brick,
                             bool is_rectilinear, sp_wide_int local, struct sp_places *p) {
    const sp_wide_int i[3] = { local & 15, local >> 4 & 15, local >> 8 };
    sp_wide at[3], volume = sp_wide_all(1);
    for (int a = 0; a < 3; a++)
        at[a] = is_rectilinear ? sp_wide_gather(brick->at[a], i[a]) : sp_wide_from_int(i[a]);
    for (int r = 0; r < 3; r++) {
        p->u[r] =
            brick->base[r] + f->step[r][0] * at[0] + f->step[r][1] * at[1] + f->step[r][2] * at[2];
        for (int a = 0; a < 3; a++)
            p->kernel[r][a] = sp_wide_all(f->kernel[r][a]);
    }
    for (int a = 0; is_rectilinear && a < 3; a++) {
        sp_wide size = sp_wide_gather(brick->size[a], i[a]);
        for (int r = 0; r < 3; r++)
            p->kernel[r][a] *= size;
        volume *= size;
    }
    return volume;
}

/* Sets up the places [n, n + lanes) of the run, at most SP_WIDE of them. Returns the number of
 * splats written. */
static inline uint32_t set_up(const struct sp_ewa_frame *f, const struct sp_ewa_run *run,
                              const struct sp_ewa_brick *brick, uint32_t n, int lanes,
                              const struct sp_splats *out, uint32_t written) {
    int32_t local[SP_WIDE] = { 0 };
    uint64_t entry[SP_WIDE];
    float gain[SP_WIDE];
    struct sp_places p;
    struct sp_outlines o;
    struct amounts a = { 0 };
    for (int i = 0; i < lanes; i++) {
        uint32_t place = n + (uint32_t)i;
        local[i] = run->local[place - run->begin];
        entry[i] = run->first + (run->order ? run->order[place] : place);
    }
    sp_wide volume = locate(f, brick, sp_grid_is_rectilinear(f->grid), sp_wide_int_load(local), &p);
    sp_wide_mask seen = sp_place_splats(f, &p, run->mode, &o) & sp_wide_first(lanes);
    unsigned bits = sp_wide_mask_bits(seen);
    sp_wide_store(gain, o.gain * f->gain * volume);
    if (f->post)
        read_scalars(run, entry, gain, bits, &a);
    else
        bits = classify(run, entry, gain, bits, &a);
    if (run->shade && bits)
        shade(f, run, &p, &a);
    for (; bits; bits &= bits - 1) {
        int i = __builtin_ctz(bits);
        struct sp_splat *s = &out->splat[written];
        s->cuts = 0;
        if ((out->span || out->cut) && !write_extent(f, &p, i, out, written))
            continue;
        write_splat(&o, &a, i, s);
        if (f->post)
            s->value = a.value[i] * s->depth;
        s->sheet = run->sheet;
        written++;
    }
    return written;
}

uint32_t sp_ewa_set_up(const struct sp_ewa_frame *f, const struct sp_ewa_run *run,
                       const struct sp_splats *out) {
    uint32_t written = 0, end = run->begin + run->count;
    struct sp_ewa_brick brick;
    sp_ewa_brick_init(&brick, f, run->brick);
    for (uint32_t n = run->begin; n < end; n += SP_WIDE)
        written =
            set_up(f, run, &brick, n, end - n < SP_WIDE ? (int)(end - n) : SP_WIDE, out, written);
    return written;
}
