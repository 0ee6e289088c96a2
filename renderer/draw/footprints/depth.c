/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/footprints/depth.h"

#include <math.h>
#include <string.h>

#include "splat/ewa.h"

enum { LAYERS_MAX = 65000 };

/* Cells. Beyond this distance single precision cannot separate neighbouring voxels, so all count as
 * equally far. */
#define FARTHEST 1e7

/* The sorted voxels of each brick, before the bricks' layers are joined. */
struct sort {
    const struct sp_depth_job *job;
    double thickness;
    uint16_t *order;  /* by place: entry of the brick */
    uint16_t *layer;  /* by place: layer, counted from the brick's first */
    int64_t *begin;   /* by brick: its first layer */
    uint32_t *runs;   /* by brick: how many layers have voxels; 0 = the brick is not drawn */
    uint32_t *counts; /* [LAYERS_MAX + 1] per worker, all zero between bricks */
};

double sp_depth_thickness(const struct sp_ewa_frame *frame, double thickness, double reach) {
    double least = (frame->diameter + 2 * reach) / (LAYERS_MAX - 2);
    return fmax(thickness, least);
}

/* Computes the layers of a brick's entries relative to the brick's first layer, which is returned.
 */
static int64_t compute_layers(const struct sort *s, uint32_t b, int64_t *layer, int64_t *last) {
    const struct sp_visible *list = s->job->list;
    struct sp_ewa_brick brick;
    uint32_t n = (uint32_t)(list->first[b + 1] - list->first[b]);
    uint16_t local[SP_BRICK_VOXELS];
    sp_visible_locals(list, b, NULL, 0, n, local);
    int64_t first = INT64_MAX;
    *last = INT64_MIN;
    uint32_t x = b % list->bricks[0], y = b / list->bricks[0] % list->bricks[1],
             z = b / list->bricks[0] / list->bricks[1];
    sp_ewa_brick_init(&brick, s->job->frame,
                      (uint32_t[3]){ x * SP_BRICK, y * SP_BRICK, z * SP_BRICK });
    for (uint32_t i = 0; i < n; i++) {
        float u[3];
        sp_ewa_brick_place(&brick, s->job->frame, local[i], u);
        double d = fmin((double)sp_ewa_distance(s->job->frame, u), FARTHEST) - s->job->reach;
        layer[i] = (int64_t)floor(fmax(d, -FARTHEST) / s->thickness);
        first = layer[i] < first ? layer[i] : first;
        *last = layer[i] > *last ? layer[i] : *last;
    }
    *last = *last - first < LAYERS_MAX ? *last - first : LAYERS_MAX;
    for (uint32_t i = 0; i < n; i++)
        layer[i] = layer[i] - first < LAYERS_MAX ? layer[i] - first : LAYERS_MAX;
    return first;
}

static void sort_bricks(void *user, size_t begin, size_t end, unsigned worker) {
    const struct sort *s = user;
    const struct sp_visible *list = s->job->list;
    uint32_t *counts = s->counts + (size_t)worker * (LAYERS_MAX + 1);
    int64_t layer[SP_BRICK_VOXELS], last;
    for (size_t b = begin; b < end; b++) {
        uint64_t at = list->first[b];
        uint32_t n = (uint32_t)(list->first[b + 1] - at), sum = 0, runs = 0, corner[3];
        sp_visible_brick_corner(list->bricks, (uint32_t)b, corner);
        if (!n || sp_ewa_brick_is_clipped(s->job->frame, corner)) {
            s->runs[b] = 0;
            continue;
        }
        s->begin[b] = compute_layers(s, (uint32_t)b, layer, &last);
        for (uint32_t i = 0; i < n; i++)
            counts[layer[i]]++;
        for (int64_t l = 0; l <= last; l++) {
            uint32_t count = counts[l];
            counts[l] = sum;
            sum += count;
            runs += count > 0;
        }
        for (uint32_t i = 0; i < n; i++) {
            uint32_t place = counts[layer[i]]++;
            s->order[at + place] = (uint16_t)i;
            s->layer[at + place] = (uint16_t)layer[i];
        }
        memset(counts, 0, (size_t)(last + 1) * sizeof *counts);
        s->runs[b] = runs;
    }
}

/* Sorts the runs of all bricks by layer with a counting sort: the first pass counts, the second
 * writes. */
static void join_runs(const struct sort *s, uint32_t bricks, int64_t first,
                      struct sp_order *order) {
    const struct sp_visible *list = s->job->list;
    memset(order->first, 0, (order->layers + (size_t)1) * sizeof *order->first);
    for (int pass = 0; pass < 2; pass++) {
        for (uint32_t b = 0; b < bricks; b++) {
            uint64_t at = list->first[b];
            uint32_t n = s->runs[b] ? (uint32_t)(list->first[b + 1] - at) : 0;
            for (uint32_t i = 0, end; i < n; i = end) {
                for (end = i + 1; end < n && s->layer[at + end] == s->layer[at + i];)
                    end++;
                uint64_t l = (uint64_t)(s->begin[b] - first) + s->layer[at + i];
                if (pass == 0)
                    order->first[l]++;
                else
                    order->runs[order->first[l]++] =
                        (struct sp_run){ b, (uint16_t)i, (uint16_t)(end - i),
                                         (uint8_t)s->job->level, s->job->is_enlarged };
            }
        }
        uint64_t sum = 0;
        for (uint32_t l = 0; pass == 0 && l <= order->layers; l++) {
            uint64_t count = order->first[l];
            order->first[l] = sum;
            sum += count;
        }
    }
    /* The second pass moved first[l] to the end of layer l, which is the begin of the next layer.
     */
    memmove(order->first + 1, order->first, order->layers * sizeof *order->first);
    order->first[0] = 0;
}

bool sp_order_distance(const struct sp_depth_job *job, struct sp_order *order, double *nearest) {
    const struct sp_visible *list = job->list;
    uint32_t bricks = sp_visible_bricks(list);
    unsigned threads = sp_pool_threads(job->pool);
    size_t counts = (size_t)threads * (LAYERS_MAX + 1);
    struct sort s = { .job = job,
                      .thickness = sp_depth_thickness(job->frame, job->thickness, job->reach),
                      .order = sp_arena_alloc(job->arena, "order by distance", list->count, 2),
                      .layer = sp_arena_alloc(job->arena, "layers of voxels", list->count, 2),
                      .begin = sp_arena_alloc(job->arena, "layers of bricks", bricks, 8),
                      .runs = sp_arena_alloc(job->arena, "runs of bricks", bricks, 4),
                      .counts = sp_arena_alloc(job->arena, "sizes of layers", counts, 4) };
    if (job->arena->failed)
        return false;
    memset(s.counts, 0, counts * sizeof *s.counts);
    sp_parallel_for(job->pool, bricks, 4, sort_bricks, &s);
    int64_t first = INT64_MAX, last = INT64_MIN;
    uint64_t runs = 0;
    for (uint32_t b = 0; b < bricks; b++) {
        if (!s.runs[b])
            continue;
        int64_t end = s.begin[b] + s.layer[list->first[b + 1] - 1];
        first = s.begin[b] < first ? s.begin[b] : first;
        last = end > last ? end : last;
        runs += s.runs[b];
    }
    if (!runs)
        first = last = 0;
    *nearest = (double)first * s.thickness;
    order->layers = (uint32_t)(last - first + 1);
    order->order = s.order;
    order->first =
        sp_arena_alloc(job->arena, "layers", order->layers + (size_t)1, sizeof *order->first);
    order->runs = sp_arena_alloc(job->arena, "runs", runs, sizeof *order->runs);
    if (job->arena->failed)
        return false;
    join_runs(&s, bricks, first, order);
    return true;
}
