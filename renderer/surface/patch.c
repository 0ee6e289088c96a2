/* SPDX-License-Identifier: Apache-2.0 */
#include "surface/patch.h"

#include <math.h>
#include <stdbool.h>

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
static int split(unsigned corners, unsigned parts[SURFACE_PATCHES_MAX]) {
    int count = 0;
    for (; corners; corners &= ~parts[count - 1])
        parts[count++] = first_part(corners);
    return count;
}

/* One piece per part of the inside or, if that is connected, per part of the outside. Sets *outside
 * if the parts are outside. */
static int find_parts(unsigned inside, unsigned parts[SURFACE_PATCHES_MAX], int *outside) {
    int count = split(inside, parts);
    *outside = 0;
    if (count > 1)
        return count;
    *outside = 1;
    return split(~inside & 255, parts);
}

int sp_surface_patch_count(unsigned inside) {
    unsigned parts[SURFACE_PATCHES_MAX];
    int outside;
    return find_parts(inside, parts, &outside);
}

/* Where the edge from a corner with value a to one with b is crossed, as a share of the edge. */
static float crossing(float a, float b) {
    return a / (a - b);
}

static float mix(float a, float b, float t) {
    return a + t * (b - a);
}

/* The part of a face that is inside of a polygon: its area, and the integrals of both coordinates.
 */
struct share {
    float area, moment[2];
};

/* Adds the triangle of the face's corner 0 and an edge of the polygon. */
static void add_triangle(struct share *share, const float a[2], const float b[2]) {
    float area = 0.5f * (a[0] * b[1] - a[1] * b[0]);
    share->area += area;
    for (int k = 0; k < 2; k++)
        share->moment[k] += area * (a[k] + b[k]) * (1.0f / 3);
}

/* The share of a face that the part covers. f: around the face, positive in the part. Corners of
 * the part that face each other do not connect. */
static struct share face_share(const float f[4], unsigned part) {
    static const float corners[4][2] = { { 0, 0 }, { 1, 0 }, { 1, 1 }, { 0, 1 } };
    struct share share = { 0 };
    float at[8][2];
    int count = 0;
    if (part == 5 || part == 10) {
        struct share other = face_share(f, part & 12);
        share = face_share(f, part & 3);
        return (struct share){ share.area + other.area,
                               { share.moment[0] + other.moment[0],
                                 share.moment[1] + other.moment[1] } };
    }
    for (int i = 0; i < 4 && part; i++) {
        const int next = (i + 1) & 3;
        const bool is_in = part >> i & 1, is_next_in = part >> next & 1;
        if (is_in) {
            at[count][0] = corners[i][0];
            at[count++][1] = corners[i][1];
        }
        if (is_in == is_next_in)
            continue;
        const float t = crossing(f[i], f[next]);
        for (int k = 0; k < 2; k++)
            at[count][k] = corners[i][k] + t * (corners[next][k] - corners[i][k]);
        count++;
    }
    for (int i = 0; i < count; i++)
        add_triangle(&share, at[i], at[i + 1 < count ? i + 1 : 0]);
    return share;
}

/* The region of the part is closed by its shares of the six faces and by the surface, so that the
 * vector areas of all of them add up to 0 (Gauss). In the same way the shares of the faces across
 * the axis b give ∫ x_a dA_b of the surface, and thus its centre along the other axes. */
static void find_area(const float f[8], unsigned part, struct sp_surface_patch *out,
                      float moment[3][2]) {
    for (int a = 0; a < 3; a++) {
        const int b = 1 << (a + 1) % 3, c = 1 << (a + 2) % 3;
        struct share share[2];
        for (int side = 0; side < 2; side++) {
            const int corner = side << a;
            const int around[4] = { corner, corner | b, corner | b | c, corner | c };
            float g[4];
            unsigned in = 0;
            for (int i = 0; i < 4; i++) {
                g[i] = f[around[i]];
                in |= (part >> around[i] & 1) << i;
            }
            share[side] = face_share(g, in);
        }
        out->area[a] = share[0].area - share[1].area;
        for (int k = 0; k < 2; k++)
            moment[a][k] = share[0].moment[k] - share[1].moment[k];
    }
}

/* The mean of the crossings of the part's edges. */
static void find_middle(const float f[8], unsigned part, float at[3]) {
    int count = 0;
    at[0] = at[1] = at[2] = 0;
    for (int a = 0; a < 3; a++)
        for (int i = 0; i < 8; i++) {
            int j = i | 1 << a;
            if (i == j || !((part >> i ^ part >> j) & 1))
                continue;
            at[a] += crossing(f[i], f[j]);
            at[(a + 1) % 3] += (float)(i >> (a + 1) % 3 & 1);
            at[(a + 2) % 3] += (float)(i >> (a + 2) % 3 & 1);
            count++;
        }
    for (int a = 0; a < 3; a++)
        at[a] /= (float)count;
}

static float clamp(float x) {
    return x > 0 ? (x < 1 ? x : 1) : 0;
}

/* The centre of the patch, by the axis that it faces most; on the surface, if the surface is there.
 */
static void find_center(const float f[8], unsigned part, struct sp_surface_patch *patch,
                        const float moment[3][2]) {
    const float least = 1e-3f; /* a smaller area has no direction */
    int b = 0;
    for (int a = 1; a < 3; a++)
        b = fabsf(patch->area[a]) > fabsf(patch->area[b]) ? a : b;
    find_middle(f, part, patch->at);
    if (fabsf(patch->area[b]) < least)
        return;
    const int c = (b + 1) % 3, d = (b + 2) % 3;
    patch->at[c] = clamp(moment[b][0] / patch->area[b]);
    patch->at[d] = clamp(moment[b][1] / patch->area[b]);
    float ends[2];
    for (int side = 0; side < 2; side++) {
        const int corner = side << b;
        float near = mix(f[corner], f[corner | 1 << c], patch->at[c]);
        float far = mix(f[corner | 1 << d], f[corner | 1 << c | 1 << d], patch->at[c]);
        ends[side] = mix(near, far, patch->at[d]);
    }
    if ((ends[0] >= 0) != (ends[1] >= 0))
        patch->at[b] = crossing(ends[0], ends[1]);
}

/* Moves a place in the cell along the gradient of the interpolant to where that is 0. */
static void move(const float f[8], float at[3]) {
    for (int step = 0; step < 2; step++) {
        const float x = at[0], y = at[1], z = at[2];
        float e[4] = { mix(f[0], f[1], x), mix(f[2], f[3], x), mix(f[4], f[5], x),
                       mix(f[6], f[7], x) };
        float value = mix(mix(e[0], e[1], y), mix(e[2], e[3], y), z);
        float slope[3] = {
            mix(mix(f[1] - f[0], f[3] - f[2], y), mix(f[5] - f[4], f[7] - f[6], y), z),
            mix(e[1] - e[0], e[3] - e[2], z), mix(e[2], e[3], y) - mix(e[0], e[1], y)
        };
        float square = slope[0] * slope[0] + slope[1] * slope[1] + slope[2] * slope[2];
        float length = square > 0 ? value / square : 0;
        /* Farther than half a cell the interpolant is too bent: the middle of the crossings is
         * better. */
        if (!(length * length * square < 0.25f))
            return;
        for (int a = 0; a < 3; a++) {
            at[a] -= length * slope[a];
            at[a] = at[a] < 0 ? 0 : at[a] > 1 ? 1 : at[a];
        }
    }
}

int sp_surface_patches(const float f[8], struct sp_surface_patch out[SURFACE_PATCHES_MAX]) {
    unsigned inside = 0, parts[SURFACE_PATCHES_MAX];
    float g[8];
    int outside;
    for (int i = 0; i < 8; i++)
        inside |= (unsigned)(f[i] >= 0) << i;
    int count = find_parts(inside, parts, &outside);
    for (int i = 0; i < 8; i++)
        g[i] = outside ? -f[i] : f[i];
    for (int p = 0; p < count; p++) {
        float moment[3][2];
        find_area(g, parts[p], &out[p], moment);
        find_center(f, parts[p], &out[p], moment);
        move(f, out[p].at);
        for (int a = 0; a < 3 && outside; a++)
            out[p].area[a] *= -1;
    }
    return count;
}
