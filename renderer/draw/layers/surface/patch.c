/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/surface/patch.h"

#include "base/wide.h"

/* The corners that share an edge with one of `corners`. */
static unsigned grow(unsigned corners) {
    return corners | (corners & 0x55) << 1 | (corners & 0xaa) >> 1 | (corners & 0x33) << 2 |
           (corners & 0xcc) >> 2 | (corners & 0x0f) << 4 | corners >> 4;
}

/* The connected part of `corners` that has the lowest of them. */
static unsigned first_part(unsigned corners) {
    unsigned part = corners & (0 - corners), last;
    do {
        last = part;
        part = grow(part) & corners;
    } while (part != last);
    return part;
}

/* Splits the corners into connected parts; returns their number. */
static int split(unsigned corners, uint8_t parts[SURFACE_PARTS_MAX]) {
    int count = 0;
    for (; corners; corners &= ~parts[count - 1])
        parts[count++] = (uint8_t)first_part(corners);
    return count;
}

void sp_surface_parts_init(unsigned inside, struct sp_surface_parts *out) {
    int count = split(inside, out->corners);
    out->are_outside = count < 2;
    if (out->are_outside)
        count = split(~inside & 255, out->corners);
    out->count = (uint8_t)count;
}

/* Pieces in the lanes of vectors. An edge is known by its axis and the corner where it begins. */
struct cells {
    sp_wide f[8];
    sp_wide_mask in[8];     /* the corner belongs to the part */
    sp_wide crossing[3][8]; /* as a share of the edge; 0 = none */
    sp_wide_mask is_crossed[3][8];
};

static inline void read_cells(const struct sp_surface_patches *p, int first, struct cells *out) {
    const sp_wide_int corners = sp_wide_int_load(p->corners + first), zero = { 0 };
    for (int c = 0; c < 8; c++) {
        out->f[c] = sp_wide_load(p->f[c] + first);
        out->in[c] = sp_wide_int_lt(zero, corners & 1 << c);
    }
    for (int a = 0; a < 3; a++)
        for (int i = 0; i < 8; i++) {
            const int j = i | 1 << a;
            if (i == j)
                continue;
            sp_wide share = out->f[i] / (out->f[i] - out->f[j]);
            out->is_crossed[a][i] = out->in[i] ^ out->in[j];
            out->crossing[a][i] = sp_wide_keep(out->is_crossed[a][i], share);
        }
}

/* The share of a face that a part covers: its area, and the integrals of both coordinates. */
struct share {
    sp_wide area, moment[2];
};

/* Adds a segment from x to y of the boundary, with the share on its left:
 * ∮ u dv, ∮ u²/2 dv, −∮ v²/2 du. */
static inline void add_chord(struct share *share, const sp_wide x[2], const sp_wide y[2]) {
    const float sixth = 1.0f / 6;
    sp_wide du = y[0] - x[0], dv = y[1] - x[1];
    share->area += 0.5f * (x[0] + y[0]) * dv;
    share->moment[0] += sixth * dv * (x[0] * (x[0] + y[0]) + y[0] * y[0]);
    share->moment[1] -= sixth * du * (x[1] * (x[1] + y[1]) + y[1] * y[1]);
}

/* in: the corners (0, 0), (1, 0), (1, 1), (0, 1) of the face; at: where the edges from each to the
 * next are crossed, along the axes. The boundary of the part leaves the edges at most once. */
static inline void add_face(const sp_wide_mask in[4], const sp_wide at[4], struct share *share) {
    const sp_wide one = sp_wide_all(1);
    sp_wide_mask leaves[4], enters[4];
    for (int i = 0; i < 4; i++) {
        const int next = (i + 1) & 3;
        leaves[i] = in[i] & ~in[next];
        enters[i] = in[next] & ~in[i];
    }
    const sp_wide from[2] = { sp_wide_keep(leaves[0], at[0]) + sp_wide_keep(leaves[1], one) +
                                  sp_wide_keep(leaves[2], at[2]),
                              sp_wide_keep(leaves[1], at[1]) + sp_wide_keep(leaves[2], one) +
                                  sp_wide_keep(leaves[3], at[3]) };
    const sp_wide to[2] = { sp_wide_keep(enters[0], at[0]) + sp_wide_keep(enters[1], one) +
                                sp_wide_keep(enters[2], at[2]),
                            sp_wide_keep(enters[1], at[1]) + sp_wide_keep(enters[2], one) +
                                sp_wide_keep(enters[3], at[3]) };
    /* The lengths of the parts of the edges where u = 1 and v = 1. */
    sp_wide right = sp_wide_select(in[2], one, at[1]) - sp_wide_keep(~in[1], at[1]);
    sp_wide upper = sp_wide_select(in[2], one, at[2]) - sp_wide_keep(~in[3], at[2]);
    share->area += right;
    share->moment[0] += 0.5f * right;
    share->moment[1] += 0.5f * upper;
    add_chord(share, from, to);
}

/* The face across axis a. Corners of the part that face each other do not connect. */
static inline void compute_share(const struct cells *cells, int a, int side, struct share *share) {
    const int b = (a + 1) % 3, c = (a + 2) % 3, first = side << a;
    const int around[4] = { first, first | 1 << b, first | 1 << b | 1 << c, first | 1 << c };
    const sp_wide_mask in[4] = { cells->in[around[0]], cells->in[around[1]], cells->in[around[2]],
                                 cells->in[around[3]] };
    const sp_wide at[4] = { cells->crossing[b][around[0]], cells->crossing[c][around[1]],
                            cells->crossing[b][around[3]], cells->crossing[c][around[0]] };
    *share = (struct share){ sp_wide_all(0), { sp_wide_all(0), sp_wide_all(0) } };
    sp_wide_mask is_split = (in[0] ^ in[1]) & (in[1] ^ in[2]) & (in[2] ^ in[3]);
    if (!sp_wide_any(is_split)) {
        add_face(in, at, share);
        return;
    }
    const sp_wide_mask lower[4] = { in[0], in[1], in[2] & ~is_split, in[3] & ~is_split };
    const sp_wide_mask upper[4] = { in[0] & ~in[0], in[0] & ~in[0], in[2] & is_split,
                                    in[3] & is_split };
    add_face(lower, at, share);
    sp_wide rest[4];
    for (int i = 0; i < 4; i++)
        rest[i] = sp_wide_keep(is_split, at[i]);
    add_face(upper, rest, share);
}

/* The mean of the crossings of the part's edges. */
static inline void compute_middle(const struct cells *cells, sp_wide at[3]) {
    const sp_wide one = sp_wide_all(1);
    sp_wide count = sp_wide_all(1e-30f);
    for (int a = 0; a < 3; a++)
        at[a] = sp_wide_all(0);
    for (int a = 0; a < 3; a++)
        for (int i = 0; i < 8; i++) {
            if (i >> a & 1)
                continue;
            sp_wide is_crossed = sp_wide_keep(cells->is_crossed[a][i], one);
            at[a] += cells->crossing[a][i];
            for (int k = 1; k < 3; k++)
                if (i >> (a + k) % 3 & 1)
                    at[(a + k) % 3] += is_crossed;
            count += is_crossed;
        }
    for (int a = 0; a < 3; a++)
        at[a] /= count;
}

static inline sp_wide mix(sp_wide a, sp_wide b, sp_wide t) {
    return a + t * (b - a);
}

/* Where `chosen`, moves the place to the centre of a piece that faces axis b most; on the surface,
 * if the surface is there. */
static inline void move_to_center(const struct cells *cells, int b, sp_wide_mask chosen,
                                  sp_wide area, const sp_wide moment[2], sp_wide at[3]) {
    const int c = (b + 1) % 3, d = (b + 2) % 3;
    const sp_wide zero = sp_wide_all(0);
    sp_wide ends[2];
    at[c] = sp_wide_select(chosen, sp_wide_clamp(moment[0] / area, 0, 1), at[c]);
    at[d] = sp_wide_select(chosen, sp_wide_clamp(moment[1] / area, 0, 1), at[d]);
    for (int side = 0; side < 2; side++) {
        const int k = side << b;
        sp_wide near = mix(cells->f[k], cells->f[k | 1 << c], at[c]);
        sp_wide far = mix(cells->f[k | 1 << d], cells->f[k | 1 << c | 1 << d], at[c]);
        ends[side] = mix(near, far, at[d]);
    }
    chosen = chosen & (sp_wide_lt(ends[0], zero) ^ sp_wide_lt(ends[1], zero));
    at[b] = sp_wide_select(chosen, ends[0] / (ends[0] - ends[1]), at[b]);
}

/* Moves places along the gradient of the interpolant to where that is 0. */
static inline void move(const sp_wide f[8], sp_wide at[3]) {
    const sp_wide quarter = sp_wide_all(0.25f), tiny = sp_wide_all(1e-30f);
    sp_wide_mask moves = sp_wide_first(SP_WIDE);
    for (int step = 0; step < 2; step++) {
        const sp_wide x = at[0], y = at[1], z = at[2];
        sp_wide e[4], d[4];
        for (int i = 0; i < 4; i++) {
            d[i] = f[2 * i + 1] - f[2 * i];
            e[i] = f[2 * i] + x * d[i];
        }
        sp_wide low = mix(e[0], e[1], y), high = mix(e[2], e[3], y), value = mix(low, high, z);
        const sp_wide slope[3] = { mix(mix(d[0], d[1], y), mix(d[2], d[3], y), z),
                                   mix(e[1] - e[0], e[3] - e[2], z), high - low };
        sp_wide square = slope[0] * slope[0] + slope[1] * slope[1] + slope[2] * slope[2];
        sp_wide length = value / sp_wide_max(square, tiny);
        /* Farther than half a cell the interpolant is too bent: the middle of the crossings is
         * better. */
        moves = moves & sp_wide_lt(length * length * square, quarter);
        for (int a = 0; a < 3; a++)
            at[a] = sp_wide_select(moves, sp_wide_clamp(at[a] - length * slope[a], 0, 1), at[a]);
    }
}

/* The region of a part is closed by its shares of the six faces and by the surface, so that the
 * vector areas of all of them add up to 0 (Gauss). In the same way the shares of the faces across
 * the axis b give ∫ x_a dA_b of the surface, and thus its centre along the other axes. */
static void compute_patches(struct sp_surface_patches *p, int first) {
    const sp_wide least = sp_wide_all(1e-3f); /* a smaller area has no direction */
    struct cells cells;
    sp_wide area[3], moment[3][2], size[3], at[3], sign = sp_wide_load(p->sign + first);
    read_cells(p, first, &cells);
    for (int a = 0; a < 3; a++) {
        struct share low, high;
        compute_share(&cells, a, 0, &low);
        compute_share(&cells, a, 1, &high);
        area[a] = low.area - high.area;
        size[a] = sp_wide_abs(area[a]);
        for (int k = 0; k < 2; k++)
            moment[a][k] = low.moment[k] - high.moment[k];
        sp_wide_store(p->area[a] + first, area[a] * sign);
    }
    compute_middle(&cells, at);
    sp_wide_mask faces_0 = sp_wide_le(size[1], size[0]) & sp_wide_le(size[2], size[0]);
    sp_wide_mask faces_1 = sp_wide_le(size[2], size[1]) & ~faces_0;
    const sp_wide_mask faces[3] = { faces_0, faces_1, ~(faces_0 | faces_1) };
    for (int b = 0; b < 3; b++)
        move_to_center(&cells, b, faces[b] & sp_wide_le(least, size[b]), area[b], moment[b], at);
    move(cells.f, at);
    for (int a = 0; a < 3; a++)
        sp_wide_store(p->at[a] + first, at[a]);
}

void sp_surface_patches_compute(struct sp_surface_patches *patches) {
    for (int i = 0; i < patches->count; i += SP_WIDE)
        compute_patches(patches, i);
}
