/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/pick.h"

#include <math.h>
#include <stdint.h>

#include "base/vec.h"
#include "classify/gradient.h"
#include "classify/transfer.h"
#include "data/volume/sample.h"
#include "splat/crossings.h"
#include "splat/pick_elements.h"
#include "splat/ray.h"

/* An opaque voxel of a shell has at least this optical depth over the smallest spacing: it lets no
 * light through that counts. */
static const double opaque_depth = 6.25;

/* What of the view fills cells: the volume, the shell, both or neither. */
struct matter {
    const struct sp_transfer_function *tf;
    struct sp_gradient_grid samples;
    bool has_volume;
    const struct sp_layer *shell; /* NULL = none is visible */
    double low, high;             /* thresholds of the shell as optical depths */
    double smallest;              /* spacing */
};

static double depth_of(double opacity) {
    return opacity < 1 ? -log1p(-opacity) : INFINITY;
}

static void matter_init(struct matter *m, const struct sp_view *view,
                        const struct sp_volume *volume) {
    const struct sp_grid *grid = &sp_volume_info(volume)->grid;
    *m = (struct matter){ .tf = &view->transfer_function };
    sp_gradient_grid_init(&m->samples, volume);
    for (uint32_t i = 0; i < view->layer_count; i++) {
        const struct sp_layer *layer = &view->layers[i];
        m->has_volume =
            m->has_volume ||
            (layer->visible && (layer->type == SP_LAYER_VOLUME || layer->type == SP_LAYER_VECTORS));
        if (layer->visible && layer->type == SP_LAYER_SHELL)
            m->shell = layer;
    }
    if (m->shell) {
        m->low = depth_of(m->shell->low);
        m->high = depth_of(m->shell->high);
    }
    m->smallest = fmin(grid->spacing[0], fmin(grid->spacing[1], grid->spacing[2]));
}

/* Returns the optical depth of a cell over the reference length. */
static double depth_in(const struct matter *m, const uint32_t cell[3], double value) {
    struct sp_class class;
    sp_transfer_function_eval(m->tf, value, &class);
    double depth = (double)class.depth;
    if (depth > 0 && m->tf->gradient_count > 0) {
        double gradient[3];
        sp_gradient_at(&m->samples, cell, gradient);
        double magnitude = sp_vec3_length(sp_vec3_from(gradient)) / m->samples.scale;
        depth = -log1p(sp_transfer_function_scale(m->tf, magnitude) * expm1(-depth));
    }
    return depth;
}

static double value_at(const struct matter *m, const uint32_t cell[3]) {
    const uint32_t *dims = m->samples.grid->dims;
    uint64_t at = cell[0] + dims[0] * (cell[1] + (uint64_t)dims[1] * cell[2]);
    return sp_sample(m->samples.voxels, m->samples.type, at);
}

/* True if a neighbour of the cell is below the upper threshold of the shell; beyond the border of
 * the volume there is nothing. */
static bool is_at_border(const struct matter *m, const uint32_t cell[3]) {
    const uint32_t *dims = m->samples.grid->dims;
    for (unsigned axis = 0; axis < 3; axis++)
        for (int side = 0; side < 2; side++) {
            uint32_t next[3] = { cell[0], cell[1], cell[2] };
            next[axis] += side ? 1 : UINT32_MAX;
            if (next[axis] >= dims[axis] || depth_in(m, next, value_at(m, next)) < m->high)
                return true;
        }
    return false;
}

/* Returns the optical depth per world unit in a cell. */
static double extinction(const struct matter *m, const uint32_t cell[3], double value) {
    if (!m->has_volume && !m->shell)
        return 0;
    double depth = depth_in(m, cell, value), unit = m->tf->reference_length;
    double sum = m->has_volume ? depth / unit : 0;
    if (m->shell && depth > 0 && depth >= m->low && is_at_border(m, cell))
        sum += depth >= m->high ? fmax(depth / unit, opaque_depth / m->smallest) : depth / unit;
    return sum;
}

/* The state of picking along the ray. */
struct march {
    const struct sp_ray *ray;
    struct sp_pick *pick;
    double depth; /* optical depth so far */
    const struct sp_pick_events *events;
    size_t next;                    /* event */
    struct sp_crossings *crossings; /* NULL = none is ahead */
};

/* Records a position where the opacity reaches one half. */
static void hit(struct march *march, double t, double value) {
    if (march->pick->is_hit)
        return;
    march->pick->is_hit = true;
    march->pick->value = value;
    for (int r = 0; r < 3; r++)
        march->pick->position[r] = march->ray->from.v[r] + t * march->ray->way.v[r];
}

static const double half = M_LN2;

/* Goes through matter of one kind from t to `to`. */
static void pass(struct march *march, double t, double to, double per_unit, double value) {
    double more = per_unit * fmax(to - t, 0);
    if (march->depth + more >= half && more > 0)
        hit(march, t + fmax(half - march->depth, 0) / per_unit, value);
    march->depth += more;
}

/* Takes the next surface or element before t `to`; false if there is none. */
static bool pop_thin(struct march *march, double to, struct sp_pick_event *next) {
    const struct sp_crossing *crossing =
        march->crossings ? sp_crossings_peek(march->crossings) : NULL;
    const struct sp_pick_event *event =
        march->next < march->events->count ? &march->events->at[march->next] : NULL;
    if (event && event->t <= to && !(crossing && crossing->t < event->t)) {
        *next = *event;
        march->next++;
        return true;
    }
    if (!crossing || !(crossing->t <= to))
        return false;
    *next = (struct sp_pick_event){ crossing->t, depth_of((double)crossing->layer->opacity),
                                    crossing->layer->value };
    sp_crossings_pop(march->crossings);
    return true;
}

/* Goes from t to `to` through matter of one kind, surfaces and elements. */
static void go(struct march *march, double t, double to, double per_unit, double value) {
    struct sp_pick_event next;
    while (pop_thin(march, to, &next)) {
        pass(march, t, next.t, per_unit, value);
        march->depth += next.depth;
        if (march->depth >= half)
            hit(march, next.t, next.value);
        t = fmax(t, next.t);
    }
    pass(march, t, to, per_unit, value);
}

/* Goes through the grid until nothing behind counts. */
static void follow(struct march *march, const struct matter *matter, struct sp_ray_walk *walk) {
    const double opaque = 50;
    double t = march->ray->begin;
    do {
        double leave = sp_ray_walk_leave(walk, march->ray), value = value_at(matter, walk->cell);
        go(march, t, leave, extinction(matter, walk->cell, value), value);
        t = fmax(t, leave);
    } while (march->depth < opaque && sp_ray_walk_step(walk, march->ray));
}

/* Picks in the samples of the volume, and the elements inside and before it. */
static void pick_grid(const struct sp_pick_input *in, const struct sp_ray *ray,
                      struct march *march) {
    const struct sp_grid *grid = &sp_volume_info(in->volume)->grid;
    struct sp_ray_walk walk;
    struct sp_crossings crossings;
    struct matter matter;
    matter_init(&matter, in->view, in->volume);
    sp_crossings_init(&crossings, ray, in->view, in->volume);
    sp_ray_walk_start(&walk, ray, grid, SP_RAY_AROUND, ray->begin);
    go(march, ray->begin, ray->begin, 0, 0);
    march->crossings = &crossings;
    follow(march, &matter, &walk);
    march->crossings = NULL;
}

bool sp_pick_at(const struct sp_pick_input *in, struct sp_pick *pick, struct sp_error *err) {
    const struct sp_grid *grid = &sp_volume_info(in->volume)->grid;
    struct sp_ray ray, open;
    struct sp_pick_events events;
    *pick = (struct sp_pick){ .opacity = 0 };
    sp_ray_init_open(&open, in->view, grid, in->size, in->at);
    const bool ok = sp_pick_elements(in, &open, &events, err);
    struct march march = { .ray = &ray, .pick = pick, .events = &events };
    pick->elements = events.tested;
    sp_ray_init(&ray, in->view, grid, in->size, in->at);
    if (ok && ray.begin < ray.end && !sp_volume_elements(in->volume))
        pick_grid(in, &ray, &march);
    if (ok)
        go(&march, INFINITY, INFINITY, 0, 0);
    pick->opacity = -expm1(-march.depth);
    sp_pick_events_finish(&events);
    return ok;
}
