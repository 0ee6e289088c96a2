/* SPDX-License-Identifier: Apache-2.0 */
#include "splat/shade.h"

#include "splat/exp2.h"

static inline sp_wide dot(const sp_wide a[3], const sp_wide b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* (n·h)^exponent from cosines: of the normal to the light plus to the eye, and of the light to the
 * eye. 0 if the half vector has no direction or is perpendicular to the normal. */
static inline sp_wide highlight(float exponent, sp_wide n_sum, sp_wide l_eye) {
    const sp_wide one = sp_wide_all(1), tiny = sp_wide_all(1e-6f);
    sp_wide length2 = 2 + 2 * l_eye; /* of the sum of two unit vectors */
    sp_wide_mask shines = sp_wide_lt(tiny, length2) & sp_wide_lt(tiny, sp_wide_abs(n_sum));
    sp_wide square = n_sum * n_sum * sp_wide_inverse(sp_wide_max(length2, tiny));
    square = sp_wide_select(shines, sp_wide_min(square, one), one);
    return sp_wide_keep(shines, sp_wide_exp2(exponent * 0.5f * sp_wide_log2(square)));
}

static inline void compute_terms(const struct sp_shade *shade, const sp_wide n[3],
                                 const sp_wide to_eye[3], const sp_wide *share, sp_wide lit[3],
                                 sp_wide shine[3]) {
    const sp_wide one = sp_wide_all(1), zero = sp_wide_all(0);
    sp_wide n_eye = dot(n, to_eye);
    sp_wide_mask has_side = sp_wide_lt(zero, dot(n, n));
    for (int c = 0; c < 3; c++) {
        lit[c] = sp_wide_all(shade->ambient);
        shine[c] = zero;
    }
    for (int i = 0; i < shade->light_count; i++) {
        const float *l = shade->lights[i].world, *strength = shade->lights[i].color;
        sp_wide n_light = l[0] * n[0] + l[1] * n[1] + l[2] * n[2];
        sp_wide l_eye = l[0] * to_eye[0] + l[1] * to_eye[1] + l[2] * to_eye[2];
        sp_wide facing = sp_wide_select(has_side, sp_wide_abs(n_light), one);
        sp_wide glint = sp_wide_keep(has_side, highlight(shade->exponent, n_light + n_eye, l_eye));
        if (share && i == 0) {
            facing *= share[1];
            glint *= share[1];
        }
        for (int c = 0; c < 3; c++) {
            lit[c] += facing * (shade->diffuse * strength[c]);
            shine[c] += glint * (shade->specular * strength[c]);
        }
    }
    for (int c = 0; c < 3 && share; c++)
        lit[c] *= share[0];
}

void sp_shade_terms(const struct sp_shade *shade, const sp_wide normal[3], const sp_wide to_eye[3],
                    const sp_wide *share, sp_wide lit[3], sp_wide shine[3]) {
    compute_terms(shade, normal, to_eye, share, lit, shine);
}

void sp_shade_direction(const struct sp_shade *shade, const sp_wide normal[3],
                        const sp_wide to_eye[3], sp_wide color[3]) {
    sp_wide lit[3], shine[3];
    compute_terms(shade, normal, to_eye, NULL, lit, shine);
    for (int c = 0; c < 3; c++)
        color[c] = color[c] * lit[c] + shine[c];
}

/* A symmetric matrix: xx, yy, zz, xy, xz, yz. */
static inline sp_wide quadratic(const sp_wide m[6], const sp_wide v[3]) {
    return v[0] * (m[0] * v[0] + 2 * (m[3] * v[1] + m[4] * v[2])) +
           v[1] * (m[1] * v[1] + 2 * m[5] * v[2]) + m[2] * v[2] * v[2];
}

/* S of the microflakes (classify/microflakes.h). */
static inline void microflakes_matrix(const sp_wide_int word[2], sp_wide s[6]) {
    const float minor = 1.25f * SP_MICROFLAKES_MINOR * SP_MICROFLAKES_MINOR;
    const float major = 1.25f * SP_MICROFLAKES_MAJOR * SP_MICROFLAKES_MAJOR;
    const float mixed = 1.25f * SP_MICROFLAKES_MINOR * SP_MICROFLAKES_MAJOR;
    sp_wide sum[3], difference[3]; /* of the three pairs of axes */
    for (int a = 0; a < 3; a++) {
        sp_wide pair[2];
        for (int k = 0; k < 2; k++) {
            int i = 2 * a + k;
            sp_wide area = sp_wide_from_int(word[i >> 2] >> 8 * (i & 3) & 255);
            area *= 1.0f / SP_MICROFLAKES_STEPS;
            pair[k] = area * area;
        }
        sum[a] = pair[0] + pair[1];
        difference[a] = pair[0] - pair[1];
    }
    sp_wide even = 0.25f * (sum[0] + sum[1] + sum[2]);
    s[0] = minor * sum[1] + major * sum[2] - even;
    s[1] = minor * sum[0] + major * sum[1] - even;
    s[2] = minor * sum[2] + major * sum[0] - even;
    s[3] = mixed * difference[1];
    s[4] = mixed * difference[2];
    s[5] = mixed * difference[0];
}

/* Constants of the highlights of one cell's microflakes, for any half vector. */
struct glints {
    sp_wide t[6], gaussian[6]; /* T, and the adjugate of T + I/p */
    sp_wide peak, gain;        /* det(T + I/p)/(p + 1), log2 N */
    sp_wide narrow;            /* w */
};

static inline void start_glints(const struct sp_shade *shade, const sp_wide s[6],
                                struct glints *g) {
    const sp_wide none = sp_wide_all(0), one = sp_wide_all(1);
    sp_wide v[6], inverse = 1 / sp_wide_max(s[0] + s[1] + s[2], sp_wide_all(1e-6f));
    for (int k = 0; k < 6; k++) {
        g->t[k] = s[k] * inverse;
        v[k] = g->t[k] + (k < 3 ? shade->glint_width : 0);
    }
    g->gaussian[0] = v[1] * v[2] - v[5] * v[5];
    g->gaussian[1] = v[0] * v[2] - v[4] * v[4];
    g->gaussian[2] = v[0] * v[1] - v[3] * v[3];
    g->gaussian[3] = v[4] * v[5] - v[3] * v[2];
    g->gaussian[4] = v[3] * v[5] - v[4] * v[1];
    g->gaussian[5] = v[3] * v[4] - v[0] * v[5];
    sp_wide det = v[0] * g->gaussian[0] + v[3] * g->gaussian[3] + v[4] * g->gaussian[4];
    g->peak = sp_wide_max(det, none) * (1 / (shade->exponent + 1));
    sp_wide even = one - dot(g->t, g->t) - 2 * dot(g->t + 3, g->t + 3);
    g->narrow = sp_wide_max(sp_wide_min(one - 0.25f * shade->exponent * even, one), none);
    g->gain = 2.25f * even * even * shade->glint_gain;
}

static inline sp_wide glint(const struct sp_shade *shade, const struct glints *g,
                            const sp_wide h[3]) {
    const sp_wide none = sp_wide_all(0), one = sp_wide_all(1);
    sp_wide along = sp_wide_max(sp_wide_min(quadratic(g->t, h), one), sp_wide_all(1e-12f));
    sp_wide power =
        sp_wide_exp2(sp_wide_min(0.5f * shade->exponent * sp_wide_log2(along) + g->gain, none));
    sp_wide away = sp_wide_max(quadratic(g->gaussian, h), sp_wide_all(1e-7f));
    sp_wide spread = sp_wide_min(g->peak / (away * sp_wide_sqrt(away)), one);
    return spread + g->narrow * (power - spread);
}

void sp_shade_microflakes(const struct sp_shade *shade, const sp_wide_int word[2],
                          const sp_wide to_eye[3], sp_wide lit[3], sp_wide shine[3]) {
    const sp_wide none = sp_wide_all(0);
    sp_wide s[6], sided = sp_wide_from_int(word[1] >> 16 & 255) * (1.0f / SP_MICROFLAKES_STEPS);
    struct glints glints;
    microflakes_matrix(word, s);
    start_glints(shade, s, &glints);
    for (int c = 0; c < 3; c++) {
        lit[c] = sp_wide_all(shade->ambient);
        shine[c] = none;
    }
    for (int i = 0; i < shade->light_count; i++) {
        const float *strength = shade->lights[i].color;
        sp_wide l[3], h[3];
        for (int c = 0; c < 3; c++) {
            l[c] = sp_wide_all(shade->lights[i].world[c]);
            h[c] = l[c];
            for (int r = 0; r < 3; r++) /* the camera's axes are the rows of W */
                h[c] += shade->to_camera[r][c] * to_eye[r];
        }
        sp_wide length2 = dot(h, h);
        sp_wide inverse = 1 / sp_wide_sqrt(sp_wide_max(length2, sp_wide_all(1e-12f)));
        for (int c = 0; c < 3; c++)
            h[c] *= inverse;
        sp_wide facing = sp_wide_sqrt(sp_wide_max(quadratic(s, l), none));
        sp_wide shone =
            sp_wide_keep(sp_wide_lt(sp_wide_all(1e-12f), length2), glint(shade, &glints, h));
        for (int c = 0; c < 3; c++) {
            lit[c] += shade->diffuse * strength[c] * (1 + sided * (facing - 1));
            shine[c] += shade->specular * strength[c] * sided * shone;
        }
    }
}

void sp_shade_apply(const struct sp_shade *shade, sp_wide_int packed_gradient,
                    const sp_wide to_eye[3], sp_wide color[3]) {
    sp_wide normal[3], eye[3];
    sp_shade_unpack(packed_gradient, normal);
    sp_shade_eye(shade, to_eye, eye);
    sp_shade_direction(shade, normal, eye, color);
}
