/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/light/light.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "classify/transfer.h"
#include "data/volume/grid.h"
#include "data/volume/volume.h"

/* R: this share of the volume's diagonal. */
static const double fading_share = 0.1;

/* Distance of the beams from the middle of the light's disc, whose radius is the sine of 4°: they
 * are as far apart as the points of the disc, in the mean square. */
static const double beam_radius = 0.07 * 0.7071;

bool sp_light_is_wanted(const struct sp_view *view) {
    const struct sp_shading *s = &view->shading;
    return s->mode == SP_SHADING_PHONG && !sp_compositing_is_projection(view->compositing.mode) &&
           !sp_view_has_channels(view) &&
           (s->occlusion > 0 || (s->shadow > 0 && s->light_count > 0));
}

static uint64_t cell_count(const struct sp_light_slot *slot) {
    return (uint64_t)slot->dims[0] * slot->dims[1] * slot->dims[2];
}

static uint64_t slot_bytes(const void *pointer) {
    const struct sp_light_slot *slot = pointer;
    return cell_count(slot) * (sizeof *slot->extinction + sizeof *slot->field);
}

static void finish_slot(void *pointer) {
    struct sp_light_slot *slot = pointer;
    free(slot->extinction);
    free(slot->field);
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
        if (cell_count(&made) <= LIGHT_CELLS_MAX)
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
    slot->extinction = malloc(cell_count(slot) * sizeof *slot->extinction);
    slot->field = malloc(cell_count(slot) * sizeof *slot->field);
    bool ok = slot->extinction && slot->field;
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

/* The corners of a dodecahedron. */
static void list_directions(struct sp_vec3 out[LIGHT_DIRECTIONS]) {
    const double golden = 0.5 + sqrt(1.25), third = sqrt(1.0 / 3);
    int n = 0;
    for (int i = 0; i < 8; i++)
        for (int a = 0; a < 3; a++)
            out[i].v[a] = i >> a & 1 ? third : -third;
    for (n = 8; n < LIGHT_DIRECTIONS; n++) {
        int a = (n - 8) / 4, k = n & 3;
        out[n].v[a] = 0;
        out[n].v[(a + 1) % 3] = (k & 1 ? third : -third) / golden;
        out[n].v[(a + 2) % 3] = (k & 2 ? third : -third) * golden;
    }
}

/* Sums of ambient light in the low bits of the field, until they become openness. */
enum { SUM_UNIT = 2048, SUM_BITS = 0xffff };

static void clear_sums(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    uint32_t *field = user;
    for (size_t i = begin; i < end; i++)
        field[i] &= ~(uint32_t)SUM_BITS;
}

/* Twice the mean of A above a plane at a distance of x·R: ∫ e^−x/μ dμ over [0, 1]. */
static double occlude_plane(double x) {
    enum { PARTS = 256 };
    double sum = 0;
    for (int i = 0; i < PARTS; i++)
        sum += exp(-x * PARTS / (i + 0.5)) / PARTS;
    return sum;
}

/* Interpolation spreads directions along a plane into it, as if it were so much nearer. */
static const double widening = 0.92;

struct sums {
    uint32_t *field;
    float plane; /* twice the mean of A where a plane is fully open */
};

static void close_sums(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct sums *sums = user;
    uint32_t *field = sums->field;
    const float unit = 2 * 255.0f / SUM_UNIT / LIGHT_DIRECTIONS;
    float none = 255 * (sums->plane - 1) + 0.5f;
    for (size_t i = begin; i < end; i++) {
        int32_t sum = field[i] & SUM_BITS;
        float open = (float)sum * unit + none;
        open = open < 255 ? open : 255;
        field[i] += (uint32_t)((int32_t)(open > 0 ? open : 0) + (255 << 8) - sum);
    }
}

/* Fills the openness, and makes all light arrive. */
static bool compute_openness(struct sp_light_slot *slot, const struct sp_light_job *job,
                             struct sp_light_scratch *scratch, struct sp_error *err) {
    const struct sp_grid *grid = &sp_volume_info(slot->base.volume)->grid;
    struct sp_vec3 directions[LIGHT_DIRECTIONS];
    double diagonal = 0;
    for (int a = 0; a < 3; a++)
        diagonal += pow(grid->spacing[a] * grid->dims[a], 2);
    list_directions(directions);
    memset(slot->direction, 0, sizeof slot->direction);
    sp_parallel_for(job->pool, cell_count(slot), 1 << 14, clear_sums, slot->field);
    for (int face = 0; face < 6; face++) {
        struct sp_sweep sweep = { .fading = fading_share * sqrt(diagonal),
                                  .is_ambient = true,
                                  .scale = SUM_UNIT };
        for (int d = 0; d < LIGHT_DIRECTIONS; d++) {
            bool rises;
            int axis = sp_sweep_axis(slot, directions[d], &rises);
            if (2 * axis + rises == face)
                sweep.towards[sweep.count++] = directions[d];
        }
        if (sweep.count && !sp_sweep_run(slot, &sweep, job, scratch, err))
            return false;
    }
    double fading = fading_share * sqrt(diagonal);
    struct sums sums = { slot->field, (float)occlude_plane(widening * ahead_width(slot) / fading) };
    sp_parallel_for(job->pool, cell_count(slot), 1 << 14, close_sums, &sums);
    slot->has_openness = true;
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
                              .scale = 255.0f / LIGHT_BEAMS };
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

/* Brings the field of a slot up to date with the view. */
static bool update(struct sp_light_slot *slot, const struct sp_light_job *job,
                   struct sp_light_scratch *scratch, struct sp_error *err) {
    const struct sp_shading *shading = &job->view->shading;
    bool wants_openness = shading->occlusion > 0;
    bool wants_shadow = shading->shadow > 0 && job->direction;
    if (wants_openness && !slot->has_openness && !compute_openness(slot, job, scratch, err))
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
    bool is_made =
        slot && (!slot->base.used || (job->view->shading.occlusion > 0 && !slot->has_openness));
    if (!slot || !update(slot, job, &cache->scratch, err))
        return false;
    slot->base.used = ++cache->clock;
    describe(slot, job->view, field);
    field->is_made = is_made;
    return true;
}
