/* SPDX-License-Identifier: Apache-2.0 */
#include "compose/quad.h"

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

/* Where the ray of a point of the image meets a plane; false if it does not, or before the near
 * plane. */
static bool meet(const struct sp_quad_rays *rays, const struct sp_slice_cut *cut, double x,
                 double y, double at[3]) {
    const struct sp_camera_transform *c = &rays->camera;
    const double right = (x - c->centre[0]) / c->scale, down = (y - c->centre[1]) / c->scale;
    const bool is_flat = c->projection == SP_ORTHOGRAPHIC;
    double from[3], along[3];
    for (int a = 0; a < 3; a++) {
        double aside = right * rays->axes[0][a] + down * rays->axes[1][a];
        from[a] = rays->eye[a] + (is_flat ? aside : 0);
        along[a] = rays->axes[2][a] + (is_flat ? 0 : aside);
    }
    double depth = (cut->offset - dot(cut->normal, from)) / dot(cut->normal, along);
    if (!(depth >= c->near && depth <= 1e300))
        return false;
    for (int a = 0; a < 3; a++)
        at[a] = from[a] + depth * along[a];
    if (cut->axis >= 0)
        at[cut->axis] = cut->offset; /* exactly on the slice */
    return true;
}

void sp_quad_sample(const struct sp_quad_rays *rays, const struct sp_interpolator *grid,
                    const struct sp_compose_plan *plan, const struct sp_compose_step *step,
                    uint32_t x, uint32_t y, size_t n, double *values) {
    double at[SP_INTERPOLATE_RUN][3];
    for (size_t i = 0; i < n; i++) {
        bool is_met = meet(rays, &plan->cuts[step->plane], x + (double)i + 0.5, y + 0.5, at[i]);
        for (unsigned p = 0; p < step->plane && is_met; p++) {
            const struct sp_slice_cut *cut = &plan->cuts[p];
            is_met = (dot(cut->normal, at[i]) < cut->offset ? -1 : 1) == step->sides[p];
        }
        if (!is_met)
            at[i][0] = at[i][1] = at[i][2] = NAN;
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
