/* SPDX-License-Identifier: Apache-2.0
 *
 * Shortest paths on the surface of a part.
 *
 *   border samples of the part ─► A* over neighbours at most two samples away ─► a path of samples
 *   ─► a few of its points, pulled tight on the iso-surface ─► twice as many, pulled tight, …
 *
 * The first path is at most 3 % longer than the shortest one on a flat border; pulling it tight
 * removes that. The tightened points stay on the surface, because each is moved back along the
 * gradient after each step.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/grow.h"
#include "base/vec.h"
#include "data/volume/grid.h"
#include "data/volume/interpolate.h"
#include "data/volume/volume.h"
#include "inspect/part/connect.h"
#include "sp/part.h"

enum { REACH = 2, STEPS = 98 }; /* of the search: samples, and moves to others */

/* A move to another sample that is not a multiple of a shorter one. */
struct step {
    int by[3];
    double length; /* world units, for the mean spacings */
};

/* The search. A sample's number counts the border samples before it. */
struct search {
    const struct sp_grid *grid;
    const struct sp_mask *border;
    uint32_t *first; /* [rows + 1]: number of the first border sample of each row, owned */
    float *cost;     /* [count]: of the best path so far, owned */
    uint8_t *from;   /* [count]: the move that led there, owned; UINT8_MAX = none */
    struct step steps[STEPS];
    struct entry {
        float estimate; /* of the whole path */
        uint16_t at[3];
        uint8_t from;
        float cost;
    } * heap; /* owned */
    size_t count;
    double goal[3]; /* world */
};

static int divisor(int a, int b) {
    while (b) {
        int rest = a % b;
        a = b;
        b = rest;
    }
    return a < 0 ? -a : a;
}

static double length_of(const struct sp_grid *grid, const double by[3]) {
    double square = 0;
    for (int r = 0; r < 3; r++) {
        double part = 0;
        for (int a = 0; a < 3; a++)
            part += grid->direction[r][a] * by[a];
        square += part * part;
    }
    return sqrt(square);
}

static void list_steps(struct search *s) {
    enum { SIDE = 2 * REACH + 1 };
    int count = 0;
    for (int i = 0; i < SIDE * SIDE * SIDE; i++) {
        int by[3] = { i % SIDE - REACH, i / SIDE % SIDE - REACH, i / SIDE / SIDE - REACH };
        if (divisor(divisor(by[0], by[1]), by[2]) != 1)
            continue;
        struct step *step = &s->steps[count++];
        double along[3];
        for (int a = 0; a < 3; a++) {
            step->by[a] = by[a];
            along[a] = s->grid->spacing[a] * by[a];
        }
        step->length = length_of(s->grid, along);
    }
}

/* The samples of the part that have a neighbour outside of it, or lie at the volume's border. */
static void mark_border(const struct sp_mask *mine, struct sp_mask *border) {
    const uint32_t *dims = mine->dims;
    for (uint32_t z = 0; z < dims[2]; z++)
        for (uint32_t y = 0; y < dims[1]; y++)
            for (uint32_t w = 0; w < mine->words; w++) {
                const uint64_t *row = sp_mask_row(mine, y, z);
                uint64_t before = w > 0 ? row[w - 1] >> 63 : 0;
                uint64_t behind = w + 1 < mine->words ? row[w + 1] << 63 : 0;
                uint64_t inside = (row[w] << 1 | before) & (row[w] >> 1 | behind);
                inside &= y > 0 ? sp_mask_row(mine, y - 1, z)[w] : 0;
                inside &= y + 1 < dims[1] ? sp_mask_row(mine, y + 1, z)[w] : 0;
                inside &= z > 0 ? sp_mask_row(mine, y, z - 1)[w] : 0;
                inside &= z + 1 < dims[2] ? sp_mask_row(mine, y, z + 1)[w] : 0;
                sp_mask_row(border, y, z)[w] = row[w] & ~inside;
            }
}

static bool number_samples(struct search *s, struct sp_error *err) {
    const uint32_t *dims = s->border->dims;
    const uint64_t rows = (uint64_t)dims[1] * dims[2];
    uint64_t sum = 0;
    s->first = malloc((rows + 1) * sizeof *s->first);
    for (uint64_t r = 0; s->first && r < rows; r++) {
        const uint64_t *row = s->border->bits + r * s->border->words;
        s->first[r] = (uint32_t)sum;
        for (uint32_t w = 0; w < s->border->words; w++)
            sum += (uint64_t)__builtin_popcountll(row[w]);
    }
    if (s->first && sum < UINT32_MAX) {
        s->cost = malloc((sum + 1) * sizeof *s->cost);
        s->from = malloc(sum + 1);
    }
    if (!s->cost || !s->from)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for a path on a surface");
    for (uint64_t i = 0; i < sum; i++)
        s->cost[i] = INFINITY;
    memset(s->from, UINT8_MAX, sum + 1);
    return true;
}

static uint32_t number_of(const struct search *s, const uint16_t at[3]) {
    const uint64_t r = (uint64_t)at[2] * s->border->dims[1] + at[1];
    const uint64_t *row = s->border->bits + r * s->border->words;
    uint32_t number = s->first[r];
    for (uint32_t w = 0; w < at[0] / 64u; w++)
        number += (uint32_t)__builtin_popcountll(row[w]);
    uint64_t below = (UINT64_C(1) << at[0] % 64) - 1;
    return number + (uint32_t)__builtin_popcountll(row[at[0] / 64] & below);
}

static void place(const struct sp_grid *grid, const uint16_t at[3], double world[3]) {
    for (int r = 0; r < 3; r++) {
        world[r] = grid->origin[r];
        for (unsigned a = 0; a < 3; a++)
            world[r] += grid->direction[r][a] * sp_grid_distance(grid, a, at[a]);
    }
}

static double apart(const double a[3], const double b[3]) {
    return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) +
                (a[2] - b[2]) * (a[2] - b[2]));
}

static bool push(struct search *s, struct entry entry, struct sp_error *err) {
    if (!sp_grow(&s->heap, s->count, sizeof *s->heap))
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for a path on a surface");
    size_t i = s->count++;
    while (i > 0 && entry.estimate < s->heap[(i - 1) / 2].estimate) {
        s->heap[i] = s->heap[(i - 1) / 2];
        i = (i - 1) / 2;
    }
    s->heap[i] = entry;
    return true;
}

static struct entry pop(struct search *s) {
    struct entry best = s->heap[0], last = s->heap[--s->count];
    size_t i = 0;
    for (;;) {
        size_t child = 2 * i + 1;
        if (child + 1 < s->count && s->heap[child + 1].estimate < s->heap[child].estimate)
            child++;
        if (child >= s->count || !(s->heap[child].estimate < last.estimate))
            break;
        s->heap[i] = s->heap[child];
        i = child;
    }
    s->heap[i] = last;
    return best;
}

/* Finds the neighbour at the end of a step; false = it is no border sample. */
static bool go(const struct search *s, const uint16_t at[3], const int by[3], uint16_t to[3]) {
    for (int a = 0; a < 3; a++) {
        int x = at[a] + by[a];
        if (x < 0 || x >= (int)s->border->dims[a])
            return false;
        to[a] = (uint16_t)x;
    }
    return sp_mask_has(s->border, to[0], to[1], to[2]);
}

/* The length of a step from a sample, by the grid's local distances. */
static double step_length(const struct search *s, const uint16_t at[3], const struct step *step) {
    double along[3];
    if (!sp_grid_is_rectilinear(s->grid))
        return step->length;
    for (unsigned a = 0; a < 3; a++)
        along[a] = sp_grid_distance(s->grid, a, (uint32_t)(at[a] + step->by[a])) -
                   sp_grid_distance(s->grid, a, at[a]);
    return length_of(s->grid, along);
}

/* Follows the best path from `from` until it arrives at `to`; false with no error: it does not. */
static bool find_path(struct search *s, const uint16_t from[3], const uint16_t to[3], bool *arrives,
                      struct sp_error *err) {
    struct entry start = { .from = UINT8_MAX };
    memcpy(start.at, from, sizeof start.at);
    place(s->grid, to, s->goal);
    *arrives = false;
    if (!push(s, start, err))
        return false;
    while (s->count > 0) {
        struct entry entry = pop(s);
        uint32_t number = number_of(s, entry.at);
        if (entry.cost >= s->cost[number])
            continue;
        s->cost[number] = entry.cost;
        s->from[number] = entry.from;
        if (memcmp(entry.at, to, sizeof entry.at) == 0) {
            *arrives = true;
            return true;
        }
        for (int i = 0; i < STEPS; i++) {
            struct entry next = { .from = (uint8_t)i };
            double world[3];
            if (!go(s, entry.at, s->steps[i].by, next.at))
                continue;
            next.cost = entry.cost + (float)step_length(s, entry.at, &s->steps[i]);
            if (next.cost >= s->cost[number_of(s, next.at)])
                continue;
            place(s->grid, next.at, world);
            next.estimate = next.cost + (float)apart(world, s->goal);
            if (!push(s, next, err))
                return false;
        }
    }
    return true;
}

/* Tightening. */
struct curve {
    struct sp_interpolator field;
    double value, reach; /* of the surface; how far a point may be moved back onto it */
    double (*points)[3];
    uint32_t count;
};

static bool compute_gradient(const struct curve *curve, const double p[3], double *value,
                             struct sp_vec3 *gradient) {
    double h = 0.25 * curve->reach;
    if (!sp_interpolator_at(&curve->field, p, value) || !isfinite(*value))
        return false;
    for (int r = 0; r < 3; r++) {
        double q[3] = { p[0], p[1], p[2] }, low, high;
        q[r] = p[r] - h;
        if (!sp_interpolator_at(&curve->field, q, &low) || !isfinite(low))
            return false;
        q[r] = p[r] + h;
        if (!sp_interpolator_at(&curve->field, q, &high) || !isfinite(high))
            return false;
        gradient->v[r] = (high - low) / (2 * h);
    }
    return true;
}

/* Moves a point onto the surface; it stays where it is if the surface is not near. */
static void settle(const struct curve *curve, double p[3]) {
    double q[3] = { p[0], p[1], p[2] };
    for (int i = 0; i < 4; i++) {
        struct sp_vec3 gradient;
        double value;
        if (!compute_gradient(curve, q, &value, &gradient))
            return;
        double square = sp_vec3_dot(gradient, gradient);
        if (!(square > 0))
            return;
        for (int r = 0; r < 3; r++)
            q[r] += (curve->value - value) * gradient.v[r] / square;
        if (!(apart(p, q) <= 2 * curve->reach))
            return;
    }
    memcpy(p, q, sizeof q);
}

/* Pulls the inner points to the middles of their neighbours, and back onto the surface. */
static void tighten(struct curve *curve) {
    enum { ROUNDS = 40 };
    for (int round = 0; round < ROUNDS; round++)
        for (int odd = 0; odd < 2; odd++)
            for (uint32_t i = 2 - (uint32_t)odd; i + 1 < curve->count; i += 2) {
                for (int r = 0; r < 3; r++)
                    curve->points[i][r] = 0.5 * (curve->points[i - 1][r] + curve->points[i + 1][r]);
                settle(curve, curve->points[i]);
            }
}

/* Puts a point on the surface between each two. */
static void refine(struct curve *curve) {
    for (uint32_t i = curve->count - 1; i > 0; i--) {
        memcpy(curve->points[2 * i], curve->points[i], sizeof curve->points[i]);
        for (int r = 0; r < 3; r++)
            curve->points[2 * i - 1][r] = 0.5 * (curve->points[i - 1][r] + curve->points[2 * i][r]);
        settle(curve, curve->points[2 * i - 1]);
    }
    curve->count = 2 * curve->count - 1;
}

/* Writes the path that the search has found backwards from `to`, at most `most` points of it,
 * evenly; returns the samples on it. */
static uint32_t trace(const struct search *s, const uint16_t to[3], uint32_t most,
                      struct sp_part_path *path) {
    uint16_t at[3];
    uint32_t samples = 0;
    for (int pass = 0; pass < 2; pass++) {
        uint32_t points = samples < most ? samples : most, i = 0;
        memcpy(at, to, sizeof at);
        for (;; i++) {
            uint8_t from = s->from[number_of(s, at)];
            if (pass == 1) /* the later of several samples of one place wins */
                place(s->grid, at,
                      path->points[points - 1 -
                                   (uint32_t)((uint64_t)i * (points - 1) / (samples - 1))]);
            if (from == UINT8_MAX)
                break;
            for (int a = 0; a < 3; a++)
                at[a] = (uint16_t)(at[a] - s->steps[from].by[a]);
        }
        samples = i + 1;
        path->count = samples < most ? samples : most;
        if (samples < 2)
            break;
    }
    return samples;
}

static void pull_tight(const struct sp_volume *volume, const struct sp_part *part,
                       const double ends[2][3], uint32_t samples, struct sp_part_path *path) {
    const struct sp_grid *grid = &sp_volume_info(volume)->grid;
    struct curve curve = { .value = part->range[0],
                           .reach =
                               fmin(grid->spacing[0], fmin(grid->spacing[1], grid->spacing[2])),
                           .points = path->points,
                           .count = path->count };
    sp_interpolator_init(&curve.field, volume);
    memcpy(path->points[0], ends[0], sizeof path->points[0]);
    memcpy(path->points[path->count - 1], ends[1], sizeof path->points[0]);
    for (uint32_t i = 0; i < curve.count; i++)
        settle(&curve, curve.points[i]);
    tighten(&curve);
    while (curve.count < 2 * samples && 2 * curve.count - 1 <= SP_PART_PATH_MAX) {
        refine(&curve);
        tighten(&curve);
    }
    path->count = curve.count;
}

/* The border sample that is nearest to a point. False if the part is empty. */
static bool find_end(const struct search *s, const double point[3], uint16_t at[3]) {
    double best = INFINITY;
    const uint32_t *dims = s->border->dims;
    for (uint32_t z = 0; z < dims[2]; z++)
        for (uint32_t y = 0; y < dims[1]; y++)
            for (uint32_t w = 0; w < s->border->words; w++)
                for (uint64_t left = sp_mask_row(s->border, y, z)[w]; left; left &= left - 1) {
                    const uint16_t to[3] = { (uint16_t)(w * 64 + (uint32_t)__builtin_ctzll(left)),
                                             (uint16_t)y, (uint16_t)z };
                    double world[3];
                    place(s->grid, to, world);
                    double distance = apart(world, point);
                    if (distance < best) {
                        best = distance;
                        memcpy(at, to, sizeof to);
                    }
                }
    return best < INFINITY;
}

/* Finds the path on the border of the part. */
static bool search(const struct sp_volume *volume, const struct sp_part *part, const double to[3],
                   const struct sp_mask *border, struct sp_part_path *path, struct sp_error *err) {
    enum { COARSE = 17 };
    struct search s = { .grid = &sp_volume_info(volume)->grid, .border = border };
    double ends[2][3];
    uint16_t first[3], last[3];
    list_steps(&s);
    memcpy(ends[0], part->point, sizeof ends[0]);
    memcpy(ends[1], to, sizeof ends[1]);
    bool ok = number_samples(&s, err);
    if (ok && find_end(&s, ends[0], first) && find_end(&s, ends[1], last))
        ok = find_path(&s, first, last, &path->is_found, err);
    if (ok && path->is_found) {
        uint32_t samples = trace(&s, last, COARSE, path);
        if (path->count < 2)
            path->count = 2;
        pull_tight(volume, part, ends, samples, path);
        for (uint32_t i = 0; i + 1 < path->count; i++)
            path->length += apart(path->points[i], path->points[i + 1]);
        path->straight = apart(path->points[0], path->points[path->count - 1]);
    }
    free(s.first);
    free(s.cost);
    free(s.from);
    free(s.heap);
    return ok;
}

/* True if the point is near the part whose samples are `mine`. */
static bool is_near(const struct sp_volume *volume, const struct sp_part *part, const double to[3],
                    struct sp_pool *pool, const struct sp_mask *mine, bool *is_same,
                    struct sp_error *err) {
    struct sp_mask all = { 0 }, other = { 0 };
    bool is_found;
    bool ok = sp_part_connect(sp_volume_info(volume), sp_volume_voxels(volume), to, part->range,
                              pool, &all, &other, &is_found, err);
    uint64_t words = (uint64_t)mine->dims[2] * mine->dims[1] * mine->words;
    *is_same = ok && is_found && memcmp(other.bits, mine->bits, words * sizeof *mine->bits) == 0;
    sp_mask_finish(&all);
    sp_mask_finish(&other);
    return ok;
}

bool sp_part_find_path(const struct sp_volume *volume, const struct sp_part *part,
                       const double to[3], struct sp_part_path *path, struct sp_error *err) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    struct sp_pool *pool = sp_pool_create(sp_volume_threads(), err);
    struct sp_mask all = { 0 }, mine = { 0 };
    bool is_found = false, is_same = false;
    memset(path, 0, sizeof *path);
    if (!pool)
        return false;
    bool ok = sp_part_connect(info, sp_volume_voxels(volume), part->point, part->range, pool, &all,
                              &mine, &is_found, err);
    if (ok && is_found)
        ok = is_near(volume, part, to, pool, &mine, &is_same, err);
    if (ok && is_same) {
        mark_border(&mine, &all); /* whose bits are no longer needed */
        ok = search(volume, part, to, &all, path, err);
    }
    sp_mask_finish(&all);
    sp_mask_finish(&mine);
    sp_pool_destroy(&pool);
    return ok;
}
