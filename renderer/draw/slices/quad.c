/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/slices/quad.h"

#include <math.h>

static void to_distances(const struct sp_interpolator *grid, const double world[3],
                         double distances[3]) {
    for (int a = 0; a < 3; a++) {
        distances[a] = 0;
        for (int r = 0; r < 3; r++)
            distances[a] += grid->inverse[a][r] * world[r];
    }
}

void sp_quad_rays_init(struct sp_quad_rays *rays, const struct sp_interpolator *grid,
                       const struct sp_view *view) {
    sp_camera_transform_init(&rays->camera, &view->camera, view->size);
    sp_interpolator_distances(grid, rays->camera.eye.v, rays->eye);
    for (int i = 0; i < 3; i++)
        to_distances(grid, rays->camera.w.m[i], rays->axes[i]);
}

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Where the ray of a point of the image meets a plane, and how fast that moves from pixel to pixel.
 */
struct hit {
    double at[3]; /* distances */
    double depth;
    double step[2][3]; /* of `at` per px to the right and down */
};

/* False if the ray of the point does not meet the plane, or before the near plane. */
static bool meet(const struct sp_quad_rays *rays, const struct sp_slice_cut *cut, double x,
                 double y, struct hit *hit) {
    const struct sp_camera_transform *c = &rays->camera;
    const double right = (x - c->centre[0]) / c->scale, down = (y - c->centre[1]) / c->scale;
    const bool is_flat = c->projection == SP_ORTHOGRAPHIC;
    double from[3], along[3];
    for (int a = 0; a < 3; a++) {
        double aside = right * rays->axes[0][a] + down * rays->axes[1][a];
        from[a] = rays->eye[a] + (is_flat ? aside : 0);
        along[a] = rays->axes[2][a] + (is_flat ? 0 : aside);
    }
    const double facing = dot(cut->normal, along);
    const double depth = (cut->offset - dot(cut->normal, from)) / facing;
    if (!(depth >= c->near && depth <= 1e300))
        return false;
    hit->depth = depth;
    for (int a = 0; a < 3; a++)
        hit->at[a] = from[a] + depth * along[a];
    for (int i = 0; i < 2; i++) {
        /* A pixel moves the point across the ray, and then along it back to the plane. */
        const double across = (is_flat ? 1 : depth) / c->scale;
        const double back = across * dot(cut->normal, rays->axes[i]) / facing;
        for (int a = 0; a < 3; a++)
            hit->step[i][a] = across * rays->axes[i][a] - back * along[a];
    }
    if (cut->axis >= 0)
        hit->at[cut->axis] = cut->offset; /* exactly on the slice */
    return true;
}

/* What bounds a piece of a slice: the borders of the volume, and the planes before it. A point is
 * inside if dot(normal, at) >= offset. */
struct border {
    double normal[3], offset;
};
enum { BORDERS_MAX = 6 + SP_SLICE_PLANES_MAX - 1 };

static unsigned list_borders(const struct sp_interpolator *grid, const struct sp_compose_plan *plan,
                             const struct sp_compose_step *step, struct border *borders) {
    unsigned count = 0;
    for (int a = 0; a < 3; a++) {
        if (a == plan->cuts[step->plane].axis)
            continue;
        for (int end = 0; end < 2; end++) {
            const double sign = end ? -1 : 1;
            borders[count] = (struct border){ .offset = sign * grid->extent[a][end] };
            borders[count++].normal[a] = sign;
        }
    }
    for (unsigned p = 0; p < step->plane; p++, count++) {
        borders[count].offset = step->sides[p] * plan->cuts[p].offset;
        for (int a = 0; a < 3; a++)
            borders[count].normal[a] = step->sides[p] * plan->cuts[p].normal[a];
    }
    return count;
}

static bool is_inside(const struct border *borders, unsigned count, const double at[3]) {
    for (unsigned b = 0; b < count; b++)
        if (!(dot(borders[b].normal, at) >= borders[b].offset))
            return false;
    return true;
}

/* The part of the pixel around (x, y) that the borders enclose: exact inside and outside, a
 * multiple of 1/64 along a border. */
static double cover(const struct sp_quad_rays *rays, const struct sp_slice_cut *cut,
                    const struct border *borders, unsigned count, const struct hit *hit, double x,
                    double y) {
    enum { PARTS = 8 };
    bool is_whole = true;
    for (unsigned b = 0; b < count; b++) {
        const double *normal = borders[b].normal;
        const double inside = dot(normal, hit->at) - borders[b].offset;
        const double reach =
            0.5 * (fabs(dot(normal, hit->step[0])) + fabs(dot(normal, hit->step[1])));
        if (!(inside >= -reach))
            return 0;
        is_whole = is_whole && inside >= reach;
    }
    if (is_whole)
        return 1;
    unsigned covered = 0;
    for (int i = 0; i < PARTS * PARTS; i++) {
        struct hit part;
        const double right = (i % PARTS + 0.5) / PARTS - 0.5,
                     down = (i / PARTS + 0.5) / PARTS - 0.5;
        covered +=
            meet(rays, cut, x + right, y + down, &part) && is_inside(borders, count, part.at);
    }
    return covered / (double)(PARTS * PARTS);
}

void sp_quad_sample(const struct sp_quad_rays *rays, const struct sp_interpolator *grid,
                    const struct sp_compose_plan *plan, const struct sp_compose_step *step,
                    uint32_t x, uint32_t y, size_t n, double *values, double *coverage,
                    double *depths) {
    const struct sp_slice_cut *cut = &plan->cuts[step->plane];
    struct border borders[BORDERS_MAX];
    const unsigned count = list_borders(grid, plan, step, borders);
    double at[SP_INTERPOLATE_RUN][3];
    for (size_t i = 0; i < n; i++) {
        struct hit hit;
        const double middle[2] = { x + (double)i + 0.5, y + 0.5 };
        bool is_met = meet(rays, cut, middle[0], middle[1], &hit);
        coverage[i] = is_met ? cover(rays, cut, borders, count, &hit, middle[0], middle[1]) : 0;
        depths[i] = is_met ? hit.depth : INFINITY;
        for (int a = 0; a < 3; a++) {
            const double *extent = grid->extent[a];
            at[i][a] = coverage[i] > 0 ? fmin(fmax(hit.at[a], extent[0]), extent[1]) : NAN;
        }
    }
    sp_interpolate_run(grid, n, (const double(*)[3])at, values);
}

void sp_quad_outline(const struct sp_interpolator *grid, const struct sp_camera_transform *camera,
                     const struct sp_clip *clip, const uint32_t size[2], uint32_t low[2],
                     uint32_t high[2]) {
    double least[2] = { INFINITY, INFINITY }, most[2] = { -INFINITY, -INFINITY };
    bool is_before = true; /* all corners are in front of the eye */
    for (int corner = 0; corner < 8; corner++) {
        double u[3] = { 0 }, world[3];
        for (int r = 0; r < 3; r++) {
            world[r] = grid->grid->origin[r] - camera->eye.v[r];
            for (int a = 0; a < 3; a++) {
                const double *extent = grid->extent[a];
                double fraction = clip->box[corner >> a & 1][a];
                world[r] +=
                    grid->grid->direction[r][a] * (extent[0] + fraction * (extent[1] - extent[0]));
            }
        }
        for (int i = 0; i < 3; i++)
            u[i] = dot(camera->w.m[i], world);
        is_before = is_before && u[2] > 0;
        for (int i = 0; i < 2; i++) {
            double px = camera->centre[i] +
                        camera->scale * u[i] / (camera->projection == SP_ORTHOGRAPHIC ? 1 : u[2]);
            least[i] = fmin(least[i], px);
            most[i] = fmax(most[i], px);
        }
    }
    const double margin = 4; /* px, of filters */
    for (int i = 0; i < 2; i++) {
        bool is_whole = !is_before && camera->projection != SP_ORTHOGRAPHIC;
        double begin = is_whole ? 0 : fmin(fmax(least[i] - margin, 0), size[i]);
        double end = is_whole ? size[i] : fmin(fmax(most[i] + margin, 0), size[i]);
        low[i] = (uint32_t)begin;
        high[i] = (uint32_t)ceil(end);
    }
}
