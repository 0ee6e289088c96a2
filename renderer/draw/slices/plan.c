/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/slices/plan.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

/* The part of an axis below a distance, as a fraction of the volume's extent. */
static double fraction_at(const struct sp_interpolator *grid, int axis, double distance) {
    const double *extent = grid->extent[axis];
    return (distance - extent[0]) / (extent[1] - extent[0]);
}

static void list_orthogonal(struct sp_compose_plan *plan, const struct sp_interpolator *grid,
                            const bool is_drawn[3], const double distances[3]) {
    for (int a = 0; a < 3; a++) {
        double fraction = fraction_at(grid, a, distances[a]);
        if (!is_drawn[a] || !(fraction > 0 && fraction < 1))
            continue;
        struct sp_slice_cut *cut = &plan->cuts[plan->planes++];
        *cut = (struct sp_slice_cut){ .axis = a, .offset = distances[a] };
        cut->normal[a] = 1;
    }
}

/* dot(n, world) in distances: world = origin + Σ direction·distance. */
static void list_oblique(struct sp_compose_plan *plan, const struct sp_interpolator *grid,
                         const struct sp_view *view, const double distances[3]) {
    const double *n = view->slices.normal;
    const double largest = fmax(fabs(n[0]), fmax(fabs(n[1]), fabs(n[2])));
    struct sp_slice_cut *cut = &plan->cuts[plan->planes++];
    *cut = (struct sp_slice_cut){ .axis = -1 };
    for (int a = 0; a < 3; a++) {
        for (int r = 0; r < 3; r++)
            cut->normal[a] += n[r] / largest * grid->grid->direction[r][a];
        cut->offset += cut->normal[a] * distances[a];
    }
}

/* The side of a plane on which the viewer is: −1 below, 1 above. */
static int side_of_eye(const struct sp_slice_cut *cut, const struct sp_interpolator *grid,
                       const struct sp_camera *camera) {
    double eye[3], target[3], side = -cut->offset;
    sp_interpolator_distances(grid, camera->position, eye);
    sp_interpolator_distances(grid, camera->target, target);
    if (camera->projection == SP_ORTHOGRAPHIC) {
        side = 0; /* from infinitely far away */
        for (int a = 0; a < 3; a++)
            eye[a] -= target[a];
    }
    for (int a = 0; a < 3; a++)
        side += cut->normal[a] * eye[a];
    return side < 0 ? -1 : 1;
}

/* The box around a piece of a slice: flat if the slice is orthogonal. */
static void compute_box(const struct sp_compose_plan *plan, const struct sp_interpolator *grid,
                        struct sp_compose_step *step) {
    step->clip = (struct sp_clip){ .box = { { 0, 0, 0 }, { 1, 1, 1 } } };
    for (unsigned i = 0; i <= step->plane; i++) {
        const struct sp_slice_cut *cut = &plan->cuts[i];
        if (cut->axis < 0)
            continue;
        double fraction = fraction_at(grid, cut->axis, cut->offset);
        if (i == step->plane || step->sides[i] > 0)
            step->clip.box[0][cut->axis] = fraction;
        if (i == step->plane || step->sides[i] < 0)
            step->clip.box[1][cut->axis] = fraction;
    }
}

/* The clip of a part; false if it is empty. */
static bool compute_clip(const struct sp_compose_plan *plan, const struct sp_interpolator *grid,
                         const struct sp_view *view, const int *sides, struct sp_clip *clip) {
    *clip = view->clip;
    for (unsigned i = 0; i < plan->planes; i++) {
        const struct sp_slice_cut *cut = &plan->cuts[i];
        if (cut->axis >= 0) {
            double fraction = fraction_at(grid, cut->axis, cut->offset);
            double *low = &clip->box[0][cut->axis], *high = &clip->box[1][cut->axis];
            *low = sides[i] > 0 ? fmax(*low, fraction) : *low;
            *high = sides[i] < 0 ? fmin(*high, fraction) : *high;
            if (!(*low < *high))
                return false;
            continue;
        }
        const struct sp_slices *s = &view->slices;
        struct sp_clip_plane *plane = &clip->planes[clip->plane_count++];
        const double largest =
            fmax(fabs(s->normal[0]), fmax(fabs(s->normal[1]), fabs(s->normal[2])));
        plane->offset = 0;
        for (int r = 0; r < 3; r++) {
            plane->normal[r] = sides[i] * s->normal[r] / largest;
            plane->offset += plane->normal[r] * s->position[r];
        }
    }
    return true;
}

/* A binary space partition: what lies on the viewer's side of a plane, the plane, what lies behind
 * it. */
static void walk(struct sp_compose_plan *plan, const struct sp_interpolator *grid,
                 const struct sp_view *view, unsigned depth, int *sides) {
    struct sp_compose_step *step = &plan->step[plan->steps];
    if (depth == plan->planes) {
        step->is_slice = false;
        memcpy(step->sides, sides, sizeof step->sides);
        plan->steps += compute_clip(plan, grid, view, sides, &step->clip);
        return;
    }
    int near = side_of_eye(&plan->cuts[depth], grid, &view->camera);
    sides[depth] = near;
    walk(plan, grid, view, depth + 1, sides);
    step = &plan->step[plan->steps++];
    *step = (struct sp_compose_step){ .is_slice = true, .plane = depth };
    memcpy(step->sides, sides, sizeof step->sides);
    compute_box(plan, grid, step);
    sides[depth] = -near;
    walk(plan, grid, view, depth + 1, sides);
}

void sp_compose_plan_init(struct sp_compose_plan *plan, const struct sp_interpolator *grid,
                          const struct sp_view *view) {
    double distances[3];
    int sides[SP_SLICE_PLANES_MAX] = { 0 };
    plan->planes = plan->steps = 0;
    sp_interpolator_distances(grid, view->slices.position, distances);
    if (view->slices.mode == SP_SLICES_ORTHOGONAL)
        list_orthogonal(plan, grid, view->slices.planes, distances);
    else
        list_oblique(plan, grid, view, distances);
    walk(plan, grid, view, 0, sides);
}
