/* SPDX-License-Identifier: Apache-2.0 */
#include "surface/patch.h"

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

/* The share of a face that the part covers. f: around the face, positive in the part. Corners of
 * the part that face each other do not connect. */
static float face_share(const float f[4], unsigned part) {
    float share = 0;
    switch (__builtin_popcount(part)) {
    case 0:
        return 0;
    case 4:
        return 1;
    case 3: {
        int out = __builtin_ctz(~part & 15);
        float o = f[out], a = f[(out + 1) & 3], b = f[(out + 3) & 3];
        return 1 - 0.5f * crossing(o, a) * crossing(o, b);
    }
    case 2:
        for (int i = 0; i < 4; i++) /* two neighbours: a trapezium */
            if ((part >> i & 1) && (part >> ((i + 1) & 3) & 1))
                return 0.5f *
                       (crossing(f[i], f[(i + 3) & 3]) + crossing(f[(i + 1) & 3], f[(i + 2) & 3]));
        break;
    default:
        break;
    }
    for (int i = 0; i < 4; i++)
        if (part >> i & 1)
            share += 0.5f * crossing(f[i], f[(i + 1) & 3]) * crossing(f[i], f[(i + 3) & 3]);
    return share;
}

/* The region of the part is closed by its shares of the six faces and by the surface, so that the
 * vector areas of all of them add up to 0 (Gauss). */
static void find_area(const float f[8], unsigned part, float sign, float area[3]) {
    for (int a = 0; a < 3; a++) {
        const int b = 1 << (a + 1) % 3, c = 1 << (a + 2) % 3;
        float share[2];
        for (int side = 0; side < 2; side++) {
            const int corner = side << a,
                      around[4] = { corner, corner | b, corner | b | c, corner | c };
            float g[4];
            unsigned in = 0;
            for (int i = 0; i < 4; i++) {
                g[i] = f[around[i]];
                in |= (part >> around[i] & 1) << i;
            }
            share[side] = face_share(g, in);
        }
        area[a] = sign * (share[0] - share[1]);
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

static float mix(float a, float b, float t) {
    return a + t * (b - a);
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
        find_area(g, parts[p], outside ? -1.0f : 1.0f, out[p].area);
        find_middle(f, parts[p], out[p].at);
        move(f, out[p].at);
    }
    return count;
}
