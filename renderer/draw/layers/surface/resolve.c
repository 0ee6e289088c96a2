/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "draw/layers/surface/footprint.h"
#include "splat/normal.h"

static const float full = SURFACE_FULL;
static const float least = 1.0f / 4096; /* smaller coverage is not drawn */

/* One row of a sheet, resolved. */
struct resolved {
    float depth[SURFACE_STRIDE]; /* [cells] */
    float coverage[SURFACE_STRIDE], color[3][SURFACE_STRIDE];
};

/* The ray of a pixel: u = depth·ray in perspective, (ray0, ray1, depth) else. */
static inline void compute_ray(const struct sp_ewa_frame *f, int x, int y, sp_wide ray[2]) {
    const float inverse = 1 / f->scale;
    ray[0] = (sp_wide_count() + ((float)x + 0.5f - f->centre[0])) * inverse;
    ray[1] = sp_wide_all(((float)y + 0.5f - f->centre[1]) * inverse);
}

/* A sheet at pixels, as a plane sees it. */
struct crossing {
    sp_wide value; /* distance from the plane, positive where it keeps [cells] */
    sp_wide step;  /* how much that changes per pixel */
};

static inline void cross(const struct sp_ewa_frame *f, const struct sp_clip_half *h,
                         const sp_wide ray[2], sp_wide depth, const sp_wide n[3],
                         struct crossing *out) {
    const bool is_perspective = f->projection == SP_PERSPECTIVE;
    const sp_wide tiny = sp_wide_all(1e-20f);
    sp_wide across, along, value, change[2];
    if (is_perspective) {
        across = n[0] * ray[0] + n[1] * ray[1] + n[2];
        along = h->normal[0] * ray[0] + h->normal[1] * ray[1] + h->normal[2];
        value = depth * along - h->offset;
    } else {
        across = n[2];
        along = sp_wide_all(h->normal[2]);
        value = h->normal[0] * ray[0] + h->normal[1] * ray[1] + h->normal[2] * depth - h->offset;
    }
    /* Depth changes by −(n_i/across) per change of the ray; a sheet that is seen from its side
     * changes by as much as one at 85°. */
    sp_wide length = sp_wide_sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    sp_wide bound = sp_wide_max(0.08f * length, tiny);
    across = sp_wide_copysign(sp_wide_max(sp_wide_abs(across), bound), across);
    for (int i = 0; i < 2; i++)
        change[i] = h->normal[i] - along * n[i] / across;
    sp_wide step = sp_wide_sqrt(change[0] * change[0] + change[1] * change[1]);
    out->value = value;
    out->step = sp_wide_max(step * (is_perspective ? depth : sp_wide_all(1)) / f->scale, tiny);
}

/* How much the plane keeps of pixels. */
static inline sp_wide keep(const struct crossing *c) {
    sp_wide share = c->value / c->step + 0.5f;
    return sp_wide_clamp(share, 0, 1);
}

static inline sp_wide plane_share(const struct sp_ewa_frame *f, const struct sp_clip_half *h,
                                  const sp_wide ray[2], sp_wide depth, const sp_wide n[3]) {
    struct crossing c;
    cross(f, h, ray, depth, n, &c);
    return keep(&c);
}

/* Variance of the flat kernel along a direction. */
static inline sp_wide kernel_variance(const struct sp_surface *s, const float direction[3],
                                      const sp_wide n[3]) {
    sp_wide sum = sp_wide_all(0), mixed = sum, square = sp_wide_all(1e-30f);
    for (int a = 0; a < 3; a++) {
        float k = 0;
        sp_wide q = sp_wide_all(0);
        for (int r = 0; r < 3; r++) {
            k += direction[r] * s->frame.kernel[r][a];
            q += n[r] * s->frame.kernel[r][a];
        }
        sum += k * k;
        mixed += k * q;
        square += q * q;
    }
    /* |k − squeeze·(k·q)·q|² with q of unit length */
    return sum - s->squeeze * (2 - s->squeeze) * mixed * mixed / square;
}

/* Beside a border of the volume only the kernels of one side exist. Raises the weight to what it
 * would be without the border, and cuts the surface there. */
static sp_wide end_at_borders(const struct sp_surface *s, int x, int y, sp_wide depth,
                              const sp_wide n[3], sp_wide weight, sp_wide *share) {
    const struct sp_ewa_frame *f = &s->frame;
    const float least_side = 0.2f;
    sp_wide ray[2], size = sp_wide_all(1);
    compute_ray(f, x, y, ray);
    *share = sp_wide_all(1);
    if (s->focus.growth > 0) {
        sp_wide distance = depth * sp_wide_sqrt(ray[0] * ray[0] + ray[1] * ray[1] + 1);
        size = sp_wide_clamp(distance * s->focus.growth, s->focus.least, 1);
    }
    for (uint32_t i = 0; i < s->borders.count; i++) {
        const struct sp_clip_half *h = &s->borders.planes[i];
        struct crossing c;
        cross(f, h, ray, depth, n, &c);
        if (!sp_wide_any(sp_wide_lt(c.value, s->reach + 4 * c.step)))
            continue;
        sp_wide variance =
            kernel_variance(s, h->normal, n) * size * size + f->lowpass2 * c.step * c.step;
        sp_wide deviation = sp_wide_sqrt(sp_wide_max(variance, sp_wide_all(1e-12f)));
        sp_wide side = sp_wide_normal_share(c.value / deviation);
        weight /= sp_wide_max(side, sp_wide_all(least_side));
        *share *= keep(&c);
    }
    return weight;
}

sp_wide sp_surface_clip_share(const struct sp_surface *s, int x, int y, sp_wide depth,
                              const sp_wide normal[3]) {
    const struct sp_clip_half near = { { 0, 0, 1 }, s->frame.near };
    sp_wide ray[2], share = sp_wide_all(1);
    compute_ray(&s->frame, x, y, ray);
    for (uint32_t i = 0; i < s->clip.count; i++)
        share *= plane_share(&s->frame, &s->clip.planes[i], ray, depth, normal);
    if (s->cuts_near)
        share *= plane_share(&s->frame, &near, ray, depth, normal);
    return share;
}

static inline void shade(const struct sp_surface *s, int x, int y, const sp_wide normal[3],
                         sp_wide color[3]) {
    sp_wide eye[3] = { sp_wide_all(0), sp_wide_all(0), sp_wide_all(-1) }, to_eye[3], world[3];
    for (int c = 0; c < 3; c++)
        color[c] = sp_wide_all(s->color[c]);
    if (!s->shade)
        return;
    if (s->frame.projection == SP_PERSPECTIVE) {
        sp_wide ray[2];
        compute_ray(&s->frame, x, y, ray);
        sp_wide length = sp_wide_inverse_sqrt(ray[0] * ray[0] + ray[1] * ray[1] + 1);
        eye[0] = -ray[0] * length;
        eye[1] = -ray[1] * length;
        eye[2] = -length;
    }
    sp_shade_eye(s->shade, eye, to_eye);
    sp_shade_eye(s->shade, normal, world);
    sp_shade_direction(s->shade, world, to_eye, color);
}

/* Weights ripple a little inside of a surface, which must be covered completely. Below a half, they
 * are the coverage, so that small things keep their energy and silhouettes their place. */
static inline sp_wide cover(sp_wide weight) {
    const sp_wide half = sp_wide_all(0.5f);
    sp_wide above = half + (weight - half) * (0.5f / (full - 0.5f));
    return sp_wide_select(sp_wide_lt(weight, half), weight, sp_wide_min(above, sp_wide_all(1)));
}

static void resolve_row(const struct sp_surface *s, const struct sp_surface_sheet_row *row, int x0,
                        int y, struct resolved *out) {
    const sp_wide tiny = sp_wide_all(1e-30f), one = sp_wide_all(1), none = sp_wide_all(0);
    for (int x = 0; x < SP_FRAGMENT_TILE; x += SP_WIDE) {
        sp_wide w = sp_wide_load(row->weight + x), normal[3], color[3], square = none;
        sp_wide_store(out->coverage + x, none);
        if (!sp_wide_any(sp_wide_lt(sp_wide_all(least), w)))
            continue;
        sp_wide depth = sp_wide_load(row->depth + x) / sp_wide_max(w, tiny) + s->depth_first;
        for (int r = 0; r < 3; r++) {
            normal[r] = sp_wide_load(row->normal[r] + x);
            square += normal[r] * normal[r];
        }
        sp_wide length = sp_wide_sqrt(square);
        sp_wide_mask has_side = sp_wide_lt(w * 1e-3f, length);
        for (int r = 0; r < 3; r++)
            normal[r] = sp_wide_keep(has_side, normal[r] / sp_wide_max(length, tiny));
        sp_wide share = one;
        if (s->borders.count)
            w = end_at_borders(s, x0 + x, y, depth, normal, w, &share);
        sp_wide coverage = cover(w) * share;
        shade(s, x0 + x, y, normal, color);
        if (s->clip.count || s->cuts_near)
            coverage *= sp_surface_clip_share(s, x0 + x, y, depth, normal);
        sp_wide_store(out->depth + x, depth);
        sp_wide_store(out->coverage + x, coverage);
        for (int c = 0; c < 3; c++)
            sp_wide_store(out->color[c] + x, color[c]);
    }
}

enum { ROWS = 2 * SURFACE_SHEETS };

/* Sorts the sheets of a pixel by depth. Of two sheets at nearly the same depth, as at an edge, the
 * sheet that shows its outside comes first. Returns their number. */
static int sort_sheets(const struct resolved rows[ROWS], int x, int order[ROWS]) {
    const float nearly = 0.3f; /* cells */
    float depths[ROWS];
    int count = 0;
    for (int i = 0; i < ROWS; i++) {
        const float depth = rows[i].depth[x] + (i < SURFACE_SHEETS ? 0 : nearly);
        int at = count;
        if (!(rows[i].coverage[x] > least))
            continue;
        for (; at > 0 && depth < depths[at - 1]; at--) {
            order[at] = order[at - 1];
            depths[at] = depths[at - 1];
        }
        order[at] = i;
        depths[at] = depth;
        count++;
    }
    return count;
}

/* The rays of a pixel by where they are: their share of all rays, and the light that comes through
 * along them to the eye, as a share of all light. Rays that have not met a sheet may be outside of
 * the body or, behind a cut or a face of the volume, inside. */
struct rays {
    float share, light;
};
enum { OUTSIDE, INSIDE, UNKNOWN, PLACES };

/* Moves rays that cover at most `share` of the pixel. */
static void move_rays(struct rays *from, float share, struct rays *to) {
    const float most = fmaxf(share, 0), part = most < from->share ? most / from->share : 1;
    const struct rays moved = { part * from->share, part * from->light };
    from->share -= moved.share;
    from->light -= moved.light;
    to->share += moved.share;
    to->light += moved.light;
}

/* Lets rays cross a sheet: first rays on its near side, then rays of unknown place. If these are
 * fewer than the sheet covers, a sheet before it is missing, and other rays cross. Returns the
 * light that the sheet hides. */
static float cross_sheet(struct rays rays[PLACES], int side, float coverage, float opacity) {
    struct rays *far = &rays[!side], crossing = { 0, 0 };
    move_rays(&rays[side], coverage, &crossing);
    move_rays(&rays[UNKNOWN], coverage - crossing.share, &crossing);
    move_rays(far, coverage - crossing.share, &crossing);
    far->share += crossing.share;
    far->light += (1 - opacity) * crossing.light;
    return opacity * crossing.light;
}

/* Adds the sheets of one pixel. */
static void add_pixel(const struct sp_surface *s, const struct resolved rows[ROWS], int x,
                      struct sp_fragment_tile *tile, int pixel) {
    struct rays rays[PLACES] = { [UNKNOWN] = { 1, 1 } };
    int order[ROWS];
    const int count = sort_sheets(rows, x, order);
    float light = 1;
    for (int k = 0; k < count && light > least; k++) {
        const struct resolved *row = &rows[order[k]];
        const int side = order[k] < SURFACE_SHEETS ? OUTSIDE : INSIDE;
        const float alpha = cross_sheet(rays, side, row->coverage[x], s->opacity) / light;
        const struct sp_fragment fragment = { .depth = row->depth[x] * (float)s->frame.unit,
                                              .color = { row->color[0][x] * alpha,
                                                         row->color[1][x] * alpha,
                                                         row->color[2][x] * alpha },
                                              .alpha = alpha };
        if (alpha > least)
            sp_fragment_add(tile, pixel, &fragment);
        light = rays[OUTSIDE].light + rays[INSIDE].light + rays[UNKNOWN].light;
    }
}

void sp_surface_resolve(const struct sp_surface *s, const struct sp_surface_scratch *scratch,
                        struct sp_fragment_tile *tile) {
    const int columns = s->frame.size[0] - tile->x, rows = s->frame.size[1] - tile->y;
    struct resolved resolved[ROWS];
    for (int i = 0; i < ROWS; i++)
        for (int x = 0; x < SURFACE_STRIDE; x++)
            resolved[i].coverage[x] = 0;
    for (int y = 0; y < SP_FRAGMENT_TILE && y < rows; y++) {
        for (int facing = 0; facing < 2; facing++)
            for (int l = 0; l < scratch->used[facing]; l++)
                resolve_row(s, &scratch->sheets[facing][l][y], tile->x, tile->y + y,
                            &resolved[facing * SURFACE_SHEETS + l]);
        for (int x = 0; x < SP_FRAGMENT_TILE && x < columns; x++)
            add_pixel(s, resolved, x, tile, y * SP_FRAGMENT_TILE + x);
    }
}
