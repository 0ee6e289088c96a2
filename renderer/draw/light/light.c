/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/light/light.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "classify/transfer.h"
#include "data/volume/grid.h"
#include "data/volume/volume.h"

/* Distance of the beams from the middle of the light's disc, whose radius is the sine of 4°: they
 * are as far apart as the points of the disc, in the mean square. */
static const double beam_radius = 0.07 * 0.7071;

bool sp_light_is_wanted(const struct sp_view *view) {
    const struct sp_shading *s = &view->shading;
    return s->mode == SP_SHADING_PHONG && !sp_compositing_is_projection(view->compositing.mode) &&
           !sp_view_has_channels(view) &&
           (s->occlusion > 0 || (s->shadow > 0 && s->light_count > 0));
}

static uint64_t slot_bytes(const void *pointer) {
    const struct sp_light_slot *slot = pointer;
    return sp_light_cell_count(slot) *
           (sizeof *slot->extinction + sizeof *slot->field + sizeof *slot->moments);
}

static void finish_slot(void *pointer) {
    struct sp_light_slot *slot = pointer;
    free(slot->extinction);
    free(slot->field);
    free(slot->moments);
}

static const struct sp_slots slots = { LIGHT_SLOTS, sizeof(struct sp_light_slot), finish_slot,
                                       slot_bytes };

void sp_light_evict(struct sp_light_cache *cache, const struct sp_volume *volume) {
    sp_slots_evict(&slots, cache->slots, volume);
    if (!volume) {
        free(cache->scratch.floats);
        cache->scratch = (struct sp_light_scratch){ 0 };
    }
}

uint64_t sp_light_bytes(const struct sp_light_cache *cache, const struct sp_volume *volume) {
    return sp_slots_bytes(&slots, cache->slots, volume) +
           (volume ? 0 : cache->scratch.count * sizeof *cache->scratch.floats);
}

static bool is_same_clip(const struct sp_clip *a, const struct sp_clip *b) {
    if (memcmp(a->box, b->box, sizeof a->box) != 0 || a->plane_count != b->plane_count)
        return false;
    for (uint32_t i = 0; i < a->plane_count; i++)
        if (memcmp(a->planes[i].normal, b->planes[i].normal, sizeof a->planes[i].normal) != 0 ||
            a->planes[i].offset != b->planes[i].offset)
            return false;
    return true;
}

static const struct sp_clip *clip_of(const struct sp_light_job *job) {
    return job->clip ? job->clip : &job->view->clip;
}

/* Frees memory for a new slot: the least recently used ones are dropped, at least one if all are
 * taken. NULL if it never fits. */
static struct sp_light_slot *free_slot(struct sp_light_cache *cache, uint64_t bytes,
                                       uint64_t bytes_max) {
    const uint64_t beside = cache->scratch.count * sizeof *cache->scratch.floats + bytes;
    sp_slots_trim(&slots, cache->slots, bytes_max > beside ? bytes_max - beside : 0, UINT64_MAX,
                  NULL);
    return beside > bytes_max ? NULL : sp_slots_acquire(&slots, cache->slots, UINT64_MAX, NULL);
}

double sp_light_cell_width(const struct sp_light_slot *slot) {
    const struct sp_grid *grid = &sp_volume_info(slot->base.volume)->grid;
    return slot->side * cbrt(grid->spacing[0]) * cbrt(grid->spacing[1]) * cbrt(grid->spacing[2]);
}

/* About how far before a surface rays read the field, world units. */
static double ahead_width(const struct sp_light_slot *slot) {
    double width = sp_light_cell_width(slot);
    return slot->side < LIGHT_AHEAD ? width * LIGHT_AHEAD / slot->side : width;
}

/* Creates the slot for a job, with its extinction. */
static struct sp_light_slot *create_slot(struct sp_light_cache *cache,
                                         const struct sp_light_job *job, struct sp_error *err) {
    const uint32_t *dims = sp_volume_info(job->volume)->grid.dims;
    struct sp_light_slot made = { .tf = job->view->transfer_function, .clip = *clip_of(job) };
    for (made.side = 1;; made.side *= 2) {
        for (int a = 0; a < 3; a++)
            made.dims[a] = (dims[a] + made.side - 1) / made.side + 2;
        if (sp_light_cell_count(&made) <= LIGHT_CELLS_MAX)
            break;
    }
    struct sp_light_slot *slot = free_slot(cache, slot_bytes(&made), job->bytes_max);
    if (!slot) {
        sp_fail(err, SP_ERR_BUDGET, "",
                "the light of the volume needs %llu bytes, and only %llu may be used",
                (unsigned long long)slot_bytes(&made), (unsigned long long)job->bytes_max);
        return NULL;
    }
    *slot = made;
    slot->base.volume = sp_volume_ref(job->volume);
    slot->extinction = malloc(sp_light_cell_count(slot) * sizeof *slot->extinction);
    slot->field = malloc(sp_light_cell_count(slot) * sizeof *slot->field);
    slot->moments = malloc(sp_light_cell_count(slot) * sizeof *slot->moments);
    bool ok = slot->extinction && slot->field && slot->moments;
    if (!ok)
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the light of the volume");
    if (!ok || !sp_extinction_compute(slot, job, err)) {
        sp_slots_empty(&slots, slot);
        return NULL;
    }
    return slot;
}

static struct sp_light_slot *get_slot(struct sp_light_cache *cache, const struct sp_light_job *job,
                                      struct sp_error *err) {
    for (int i = 0; i < LIGHT_SLOTS; i++) {
        struct sp_light_slot *slot = &cache->slots[i];
        if (slot->base.volume == job->volume &&
            sp_transfer_function_equal(&slot->tf, &job->view->transfer_function) &&
            is_same_clip(&slot->clip, clip_of(job)))
            return slot;
    }
    return create_slot(cache, job, err);
}

/* The solid angle of the part of a cube's face from its middle to a corner at (u, v), as seen from
 * the middle of the cube, whose edge is 2. */
static double solid_angle(double u, double v) {
    return atan(u * v / sqrt(1 + u * u + v * v));
}

struct direction {
    struct sp_vec3 towards;
    double share; /* of the sphere */
};

/* Directions through a cube around a point, evenly spaced by angle along its faces. None is
 * parallel to an axis: interpolation would not spread such a one. */
static void list_directions(struct direction out[LIGHT_DIRECTIONS]) {
    const double quarter = 0.78539816339744831;
    double edge[LIGHT_AROUND + 1], middle[LIGHT_AROUND];
    for (int i = 0; i <= LIGHT_AROUND; i++)
        edge[i] = tan(quarter * (2.0 * i / LIGHT_AROUND - 1));
    for (int i = 0; i < LIGHT_AROUND; i++)
        middle[i] = tan(quarter * ((2.0 * i + 1) / LIGHT_AROUND - 1));
    for (int n = 0; n < LIGHT_DIRECTIONS; n++) {
        const int face = n % 6, a = face / 2, i = n / 6 % LIGHT_AROUND, j = n / 6 / LIGHT_AROUND;
        struct sp_vec3 towards;
        towards.v[a] = face & 1 ? 1 : -1;
        towards.v[(a + 1) % 3] = middle[i];
        towards.v[(a + 2) % 3] = middle[j];
        out[n].towards = sp_vec3_normalize(towards);
        out[n].share = (solid_angle(edge[i + 1], edge[j + 1]) - solid_angle(edge[i], edge[j + 1]) -
                        solid_angle(edge[i + 1], edge[j]) + solid_angle(edge[i], edge[j])) /
                       (16 * quarter);
    }
}

/* Sums of the mean of A in the low bits of the field, until they become 1 − Ā. */
enum { SUM_UNIT = 32768, SUM_BITS = 0xffff };

/* Lists what a direction adds to each moment of a cell if no light comes from there. */
static void list_moments(const struct direction *d, float moment[LIGHT_MOMENTS]) {
    const double *v = d->towards.v, third = 1.0 / 3;
    const double q[5] = { v[0] * v[0] - third, v[1] * v[1] - third, v[0] * v[1], v[0] * v[2],
                          v[1] * v[2] };
    moment[0] = (float)(d->share * SUM_UNIT);
    for (int a = 0; a < 3; a++)
        moment[1 + a] = (float)(d->share * v[a]) * LIGHT_DIPOLE;
    for (int k = 0; k < 5; k++)
        moment[4 + k] = (float)(d->share * q[k]) * LIGHT_QUADRUPOLE;
}

static void clear_sums(void *user, size_t begin, size_t end, unsigned worker) {
    const struct sp_light_slot *slot = user;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        slot->field[i] &= ~(uint32_t)SUM_BITS;
        slot->moments[i][0] = slot->moments[i][1] = LIGHT_MOMENT_ZERO;
    }
}

/* Sums become 1 − Ā, and all light of the first light arrives. */
static void close_sums(void *user, size_t begin, size_t end, unsigned worker) {
    const struct sp_light_slot *slot = user;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        uint32_t sum = slot->field[i] & SUM_BITS;
        uint32_t dark = (sum * 255 + SUM_UNIT / 2) / SUM_UNIT;
        slot->field[i] += (255 - (dark < 255 ? dark : 255)) + (255 << 8) - sum;
    }
}

/* Fills the moments, and makes all light of the first light arrive. */
static bool compute_moments(struct sp_light_slot *slot, const struct sp_light_job *job,
                            struct sp_light_scratch *scratch, struct sp_error *err) {
    const struct sp_grid *grid = &sp_volume_info(slot->base.volume)->grid;
    const double reach = job->view->shading.reach;
    struct direction directions[LIGHT_DIRECTIONS];
    double diagonal = 0;
    for (int a = 0; a < 3; a++)
        diagonal += pow(grid->spacing[a] * grid->dims[a], 2);
    list_directions(directions);
    slot->reach = 0;
    memset(slot->direction, 0, sizeof slot->direction);
    sp_parallel_for(job->pool, sp_light_cell_count(slot), 1 << 14, clear_sums, slot);
    for (int face = 0; face < 6; face++) {
        struct sp_sweep sweep = { .fading = reach * sqrt(diagonal), .is_ambient = true };
        for (int d = 0; d < LIGHT_DIRECTIONS; d++) {
            bool rises;
            int axis = sp_sweep_axis(slot, directions[d].towards, &rises);
            if (2 * axis + rises != face)
                continue;
            list_moments(&directions[d], sweep.moment[sweep.count]);
            sweep.towards[sweep.count++] = directions[d].towards;
        }
        if (sweep.count && !sp_sweep_run(slot, &sweep, job, scratch, err))
            return false;
    }
    sp_parallel_for(job->pool, sp_light_cell_count(slot), 1 << 14, close_sums, slot);
    slot->reach = reach;
    return true;
}

/* Fills the transmittance: the mean over four directions within the light's disc. */
static bool compute_transmittance(struct sp_light_slot *slot, const struct sp_light_job *job,
                                  struct sp_light_scratch *scratch, struct sp_error *err) {
    struct sp_vec3 d = { { (double)job->direction[0], (double)job->direction[1],
                           (double)job->direction[2] } };
    int least = fabs(d.v[0]) < fabs(d.v[1]) ? 0 : 1;
    least = fabs(d.v[2]) < fabs(d.v[least]) ? 2 : least;
    struct sp_vec3 side = { { 0 } };
    side.v[least] = 1;
    side = sp_vec3_scale(sp_vec3_normalize(sp_vec3_cross(d, side)), beam_radius);
    struct sp_vec3 other = sp_vec3_cross(d, side);
    struct sp_sweep sweep = { .count = LIGHT_BEAMS,
                              .fading = INFINITY,
                              .moment = { { 255.0f / LIGHT_BEAMS } } };
    for (int i = 0; i < LIGHT_BEAMS; i++)
        sweep.towards[i] =
            sp_vec3_normalize(sp_vec3_add(d, sp_vec3_scale(i & 1 ? side : other, i & 2 ? 1 : -1)));
    memset(slot->direction, 0, sizeof slot->direction);
    if (!sp_sweep_run(slot, &sweep, job, scratch, err))
        return false;
    memcpy(slot->direction, d.v, sizeof d.v);
    return true;
}

static bool is_direction(const double have[3], const float want[3]) {
    return have[0] == (double)want[0] && have[1] == (double)want[1] && have[2] == (double)want[2];
}

/* True if the field has what the view asks for. */
static bool has_moments(const struct sp_light_slot *slot, const struct sp_shading *shading) {
    return shading->occlusion <= 0 || slot->reach == shading->reach;
}

/* Brings the field of a slot up to date with the view. */
static bool update(struct sp_light_slot *slot, const struct sp_light_job *job,
                   struct sp_light_scratch *scratch, struct sp_error *err) {
    const struct sp_shading *shading = &job->view->shading;
    bool wants_shadow = shading->shadow > 0 && job->direction;
    if (!has_moments(slot, shading) && !compute_moments(slot, job, scratch, err))
        return false;
    return !wants_shadow || is_direction(slot->direction, job->direction) ||
           compute_transmittance(slot, job, scratch, err);
}

static void describe(const struct sp_light_slot *slot, const struct sp_view *view,
                     struct sp_light_field *field) {
    const struct sp_grid *grid = &sp_volume_info(slot->base.volume)->grid;
    double volume, width = ahead_width(slot);
    struct sp_mat3 from = sp_grid_steps(grid, slot->side);
    struct sp_mat3 to = sp_mat3_inverse(&from, &volume);
    *field =
        (struct sp_light_field){ .cells = slot->field,
                                 .moments = (const uint32_t(*)[2])slot->moments,
                                 .per_sample = 1 / (float)slot->side,
                                 .first = (float)sp_light_first(slot),
                                 .occlusion = (float)view->shading.occlusion,
                                 .shadow =
                                     view->shading.light_count ? (float)view->shading.shadow : 0 };
    for (int a = 0; a < 3; a++) {
        field->dims[a] = (int)slot->dims[a];
        for (int c = 0; c < 3; c++)
            field->offset[a][c] = (float)(to.m[a][c] * width);
    }
}

bool sp_light_get(struct sp_light_cache *cache, const struct sp_light_job *job,
                  struct sp_light_field *field, struct sp_error *err) {
    struct sp_light_slot *slot = get_slot(cache, job, err);
    bool is_made = slot && (!slot->base.used || !has_moments(slot, &job->view->shading));
    if (!slot || !update(slot, job, &cache->scratch, err))
        return false;
    slot->base.used = ++cache->clock;
    describe(slot, job->view, field);
    field->is_made = is_made;
    return true;
}
