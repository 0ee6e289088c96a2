/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/slices/slices.h"

#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "data/volume/slice_colors.h"
#include "draw/slices/quad.h"
#include "frame/depth.h"
#include "frame/resolve.h"

/* The image so far: transmittance and premultiplied colour. */
struct image {
    const struct sp_compose_job *job;
    struct sp_interpolator grid;
    struct sp_quad_rays rays;
    struct sp_compose_plan plan;
    struct sp_frame *sum; /* red, green, blue, transmittance per pixel */
    struct sp_frame *part;
    struct sp_frame *out;
    const struct sp_compose_step *step;
    uint32_t low[2], high[2]; /* the outline of the step */
    atomic_bool is_seen;      /* some pixel of the outline is not opaque */
};

enum { ROWS = 8 };

static float *row_of(const struct sp_frame *frame, uint32_t y) {
    return (float *)((char *)frame->pixels + y * frame->stride_bytes);
}

static void clear_rows(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct image *p = user;
    for (size_t y = begin; y < end; y++) {
        float *to = row_of(p->sum, (uint32_t)y);
        for (uint32_t x = 0; x < p->sum->width; x++) {
            to[4 * x] = to[4 * x + 1] = to[4 * x + 2] = 0;
            to[4 * x + 3] = 1;
        }
        for (uint32_t x = 0; p->sum->depth && x < p->sum->width; x++) {
            sp_depth_row(p->sum, p->sum->depth, y)[x] = INFINITY;
            sp_depth_row(p->sum, p->sum->spread, y)[x] = 0;
        }
    }
}

static void check_seen(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct image *p = user;
    for (size_t y = p->low[1] + begin; y < p->low[1] + end; y++) {
        const float *from = row_of(p->sum, (uint32_t)y);
        for (uint32_t x = p->low[0]; x < p->high[0]; x++)
            if (from[4 * x + 3] >= SP_TRANSMITTANCE_MIN) {
                atomic_store_explicit(&p->is_seen, true, memory_order_relaxed);
                return;
            }
    }
}

/* Adds what a pixel shows at a depth; share: T α. */
static void add_depth(const struct image *p, uint32_t y, uint32_t x, float share, float depth,
                      float spread) {
    const struct sp_frame *sum = p->sum;
    float *mean = sp_depth_row(sum, sum->depth, y) + x;
    float *deviation = sp_depth_row(sum, sum->spread, y) + x;
    struct sp_depth own = { *mean, *deviation, 1 - row_of(sum, y)[4 * x + 3] };
    sp_depth_add(&own, &(struct sp_depth){ depth, spread, share });
    *mean = own.mean;
    *deviation = own.spread;
}

static void add_depth_of_part(const struct image *p, uint32_t y, uint32_t x, float share) {
    const struct sp_frame *part = p->part;
    if (part->depth)
        add_depth(p, y, x, share, sp_depth_row(part, part->depth, y)[x],
                  sp_depth_row(part, part->spread, y)[x]);
}

/* Puts the part behind the image so far. */
static void add_part(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct image *p = user;
    for (size_t y = begin; y < end; y++) {
        const float *from = row_of(p->part, (uint32_t)y);
        float *to = row_of(p->sum, (uint32_t)y);
        for (uint32_t x = 0; x < p->sum->width; x++) {
            float through = to[4 * x + 3];
            add_depth_of_part(p, (uint32_t)y, x, through * from[4 * x + 3]);
            for (int c = 0; c < 3; c++)
                to[4 * x + c] += through * from[4 * x + c];
            to[4 * x + 3] = through * (1 - from[4 * x + 3]);
        }
    }
}

/* The pixels of [*begin, end) of a row between the first and the last that let light through. */
static uint32_t trim(const float *row, uint32_t *begin, uint32_t end) {
    while (*begin < end && row[4 * *begin + 3] <= 0)
        ++*begin;
    while (end > *begin && row[4 * (end - 1) + 3] <= 0)
        end--;
    return end;
}

/* Puts the slice behind the image so far. */
static void add_slice(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct image *p = user;
    double values[SP_INTERPOLATE_RUN], coverage[SP_INTERPOLATE_RUN], depths[SP_INTERPOLATE_RUN];
    for (uint32_t y = p->low[1] + (uint32_t)begin; y < p->low[1] + end; y++) {
        float *to = row_of(p->sum, y);
        uint32_t at = p->low[0], stop = trim(to, &at, p->high[0]);
        for (; at < stop; at += SP_INTERPOLATE_RUN) {
            uint32_t left = stop - at;
            uint32_t n = left < SP_INTERPOLATE_RUN ? left : SP_INTERPOLATE_RUN;
            sp_quad_sample(&p->rays, &p->grid, &p->plan, p->step, at, y, n, values, coverage,
                           depths);
            for (uint32_t i = 0; i < n; i++) {
                float *px = &to[4 * (at + i)];
                if (isnan(values[i]))
                    continue;
                double rgb[3];
                sp_slice_color(p->job->view, values[i], rgb);
                float covered = (float)coverage[i];
                if (p->sum->depth)
                    add_depth(p, y, at + (uint32_t)i, px[3] * covered, (float)depths[i], 0);
                for (int c = 0; c < 3; c++)
                    px[c] += px[3] * covered * (float)rgb[c];
                px[3] *= 1 - covered;
            }
        }
    }
}

/* Copies the depth of n pixels, unless they show too little. */
static void copy_depth(const struct image *p, uint32_t y, uint32_t x, uint32_t n) {
    for (uint32_t i = x; i < x + n; i++) {
        const bool shows = 1 - row_of(p->sum, y)[4 * i + 3] >= SP_DEPTH_ALPHA_MIN;
        sp_depth_row(p->out, p->out->depth, y)[i] =
            shows ? sp_depth_row(p->sum, p->sum->depth, y)[i] : INFINITY;
        sp_depth_row(p->out, p->out->spread, y)[i] =
            shows ? sp_depth_row(p->sum, p->sum->spread, y)[i] : 0;
    }
}

static void resolve_rows(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct image *p = user;
    float planes[4][SP_INTERPOLATE_RUN];
    const float *const rows[4] = { planes[0], planes[1], planes[2], planes[3] };
    for (size_t y = begin; y < end; y++)
        for (uint32_t at = 0; at < p->out->width; at += SP_INTERPOLATE_RUN) {
            uint32_t left = p->out->width - at;
            uint32_t n = left < SP_INTERPOLATE_RUN ? left : SP_INTERPOLATE_RUN;
            const float *from = &row_of(p->sum, (uint32_t)y)[4 * at];
            for (uint32_t i = 0; i < n; i++) {
                planes[0][i] = from[4 * i + 3];
                for (int c = 0; c < 3; c++)
                    planes[1 + c][i] = from[4 * i + c];
            }
            char *to = (char *)p->out->pixels + y * p->out->stride_bytes;
            if (p->out->format == SP_RGBAF32)
                sp_resolve_rgbaf32(rows, n, p->job->view->background, (float *)to + 4 * at);
            else
                sp_resolve_rgba8(rows, n, p->job->view->background,
                                 (unsigned char *)to + 4 * (size_t)at);
            if (p->out->depth)
                copy_depth(p, (uint32_t)y, at, n);
        }
}

/* True if a pixel of the step's outline is not opaque yet. */
static bool is_seen(struct image *p) {
    if (p->low[0] >= p->high[0] || p->low[1] >= p->high[1])
        return false;
    atomic_store(&p->is_seen, false);
    sp_parallel_for(p->job->workers, p->high[1] - p->low[1], ROWS, check_seen, p);
    return atomic_load(&p->is_seen);
}

static bool draw_step(struct image *p, const struct sp_compose_step *step, struct sp_error *err) {
    const struct sp_compose_job *job = p->job;
    p->step = step;
    sp_quad_outline(&p->grid, &p->rays.camera, &step->clip, job->view->size, p->low, p->high);
    if (!is_seen(p))
        return true;
    if (step->is_slice) {
        sp_parallel_for(job->workers, p->high[1] - p->low[1], ROWS, add_slice, p);
    } else {
        if (!job->draw(job->user, &step->clip, p->part, err))
            return false;
        if (!p->part->depth) /* the backend has none for this view */
            p->out->depth = p->out->spread = NULL;
        sp_parallel_for(job->workers, p->sum->height, ROWS, add_part, p);
    }
    return !sp_interrupt_is_cancelled(&job->interrupt) ||
           sp_fail(err, SP_ERR_CANCELLED, "", "the frame was cancelled");
}

bool sp_compose(const struct sp_compose_job *job, struct sp_frame *frame, struct sp_error *err) {
    const uint32_t *size = job->view->size;
    struct image p = { .job = job, .out = frame };
    struct sp_frame *(*create)(struct sp_frame_pool *, uint32_t, uint32_t, enum sp_pixel_format,
                               struct sp_error *) =
        frame->depth ? sp_frame_create_with_depth : sp_frame_create;
    sp_interpolator_init(&p.grid, job->volume);
    sp_quad_rays_init(&p.rays, &p.grid, job->view);
    sp_compose_plan_init(&p.plan, &p.grid, job->view);
    p.sum = create(job->frames, size[0], size[1], SP_RGBAF32, err);
    p.part = p.sum ? create(job->frames, size[0], size[1], SP_RGBAF32, err) : NULL;
    bool ok = p.part != NULL;
    if (ok)
        sp_parallel_for(job->workers, size[1], ROWS, clear_rows, &p);
    for (unsigned i = 0; ok && i < p.plan.steps; i++)
        ok = draw_step(&p, &p.plan.step[i], err);
    if (ok)
        sp_parallel_for(job->workers, size[1], ROWS, resolve_rows, &p);
    sp_frame_unref(&p.part);
    sp_frame_unref(&p.sum);
    return ok;
}
