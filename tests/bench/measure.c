/* SPDX-License-Identifier: Apache-2.0 */
#include "bench/measure.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <time.h>

#include "base/clock.h"
#include "bench/allocations.h"
#include "sp/inflight.h"

enum { STEPS = 24, ROUNDS = 2, TRIES = 4 };

/* Applies the k-th of a sequence of small edits. Each differs from the previous edit. */
static void edit_transfer(struct sp_transfer_function *tf, enum bench_edit edit,
                          const double range[2], unsigned k) {
    unsigned step = k % STEPS + 1; /* then back to the first */
    struct sp_tf_point *p = &tf->points[tf->point_count / 2];
    if (edit == EDIT_COLOUR)
        p->color[1] = 0.5f * (p->color[1] + (float)step / STEPS);
    if (edit == EDIT_OPACITY)
        p->opacity *= 1 - 0.5f * (float)step / STEPS;
    if (edit != EDIT_RANGE)
        return;
    for (uint32_t i = 0; i + 1 < tf->point_count; i++)
        if (!(tf->points[i].opacity > 0) && tf->points[i + 1].opacity > 0) {
            double gap = tf->points[i + 1].value - tf->points[i].value;
            tf->points[i].value += step * fmin((range[1] - range[0]) / 256, 0.9 * gap / STEPS);
            return;
        }
}

static bool prepare(struct bench_way *way, const struct bench_scene *scene,
                    const struct bench_setting *setting, struct sp_error *err) {
    way->view = scene->view;
    way->render = setting->render;
    way->render.find = bench_scene_find;
    way->render.user = (void *)(uintptr_t)scene;
    way->edit = setting->edit;
    return bench_view_override(&way->view, &setting->overrides, err);
}

/* Begins frame n of the measurement with camera k. */
static bool begin(const struct bench_studio *studio, const struct bench_way *way, unsigned k,
                  unsigned n, struct sp_error *err) {
    const struct bench_scene *scene = studio->scene;
    struct sp_view view = way->view;
    view.camera = scene->cameras[k % scene->camera_count];
    edit_transfer(&view.transfer_function, way->edit, sp_volume_info(scene->volume)->range, n);
    if (studio->options->cold)
        sp_renderer_evict(studio->renderer, scene->volume);
    return sp_renderer_begin(studio->renderer, scene->volume, &view, studio->pool, &way->render,
                             err);
}

struct sp_frame *bench_draw(const struct bench_studio *studio, const struct bench_way *way,
                            unsigned k, unsigned n, struct sp_error *err) {
    return begin(studio, way, k, n, err) ? sp_renderer_finish(studio->renderer, err) : NULL;
}

unsigned bench_in_flight(const struct bench_studio *studio) {
    unsigned wanted = studio->options->in_flight, depth = sp_renderer_depth(studio->renderer);
    return wanted < depth ? wanted : depth;
}

static void add_frame(struct bench_times *t, const struct sp_frame_stats *stats) {
    t->ms[t->frames++] = stats->render_ms;
    t->cpu_ms += stats->cpu_ms;
    t->splats += (double)stats->splats;
    t->fragments += (double)stats->fragments;
    for (uint32_t i = 0; i < stats->stage_count; i++)
        t->stage_ms[i] += stats->stages[i].ms;
    t->last = *stats;
}

/* Renders the warm-up frames and every camera once, with as many frames in flight as the options
 * say. */
static bool measure_pass(struct bench_times *t, const struct bench_studio *studio,
                         const struct bench_way *way, struct sp_error *err) {
    unsigned warm = studio->options->warm, cameras = studio->scene->camera_count, n = 0, k = 0;
    bool ok = true;
    for (; ok && k < warm + cameras; k++) {
        uint64_t before = bench_allocations();
        for (; ok && n < warm + cameras && n - k < bench_in_flight(studio); n += ok)
            ok = begin(studio, way, n < warm ? n : n - warm, n, err);
        if (!ok)
            break;
        struct sp_frame *frame = sp_renderer_finish(studio->renderer, err);
        ok = frame != NULL;
        if (ok && k == 0 && t->frames == 0 && frame->stats.stage_count > 0)
            t->cold_classify_ms = frame->stats.stages[0].ms;
        if (ok && k >= warm) {
            add_frame(t, &frame->stats);
            t->allocations += bench_allocations() - before;
        }
        sp_frame_unref(&frame);
    }
    for (; k < n; k++) { /* after a failure */
        struct sp_frame *frame = sp_renderer_finish(studio->renderer, NULL);
        sp_frame_unref(&frame);
    }
    return ok;
}

static int compare(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median_of_sorted(const double *ms, unsigned n) {
    return (ms[(n - 1) / 2] + ms[n / 2]) / 2;
}

double bench_median(const struct bench_times *t) {
    return median_of_sorted(t->ms, t->frames);
}

double bench_percentile95(const struct bench_times *t) {
    return t->ms[(unsigned)ceil(0.95 * t->frames) - 1];
}

double bench_mean(const struct bench_times *t) {
    double sum = 0;
    for (unsigned i = 0; i < t->frames; i++)
        sum += t->ms[i];
    return sum / t->frames;
}

/* Measures one pass, or with --against two alternating passes of each setting, so that drift in the
 * speed of the machine affects both alike. */
static bool measure_times(struct bench_result *r, const struct bench_studio *studio,
                          struct sp_error *err) {
    const struct bench_options *o = studio->options;
    unsigned rounds = o->against_text ? ROUNDS : 1;
    size_t frames = (size_t)studio->scene->camera_count * rounds;
    r->times.ms = calloc(frames, sizeof(double));
    r->against.ms = calloc(frames, sizeof(double));
    if (!r->times.ms || !r->against.ms)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the result");
    for (unsigned i = 0; i < rounds; i++)
        if (!measure_pass(&r->times, studio, &studio->way, err) ||
            (o->against_text && !measure_pass(&r->against, studio, &studio->against, err)))
            return false;
    qsort(r->times.ms, r->times.frames, sizeof(double), compare);
    qsort(r->against.ms, r->against.frames, sizeof(double), compare);
    return true;
}

/* Returns the mean squared difference over all pixels and premultiplied channels. */
static double mean_square(const struct sp_frame *a, const struct sp_frame *b) {
    double sum = 0;
    for (uint32_t y = 0; y < a->height; y++) {
        const float *p = (const float *)((const char *)a->pixels + y * a->stride_bytes);
        const float *q = (const float *)((const char *)b->pixels + y * b->stride_bytes);
        for (uint32_t i = 0; i < a->width * 4; i++)
            sum += (double)(p[i] - q[i]) * (double)(p[i] - q[i]);
    }
    return sum / ((double)a->width * a->height * 4);
}

static double decibels(double square) {
    return square > 0 ? -10 * log10(square) : BENCH_EQUAL_DB;
}

/* Renders each camera with both settings as float images. */
static bool compare_images(struct bench_result *r, const struct bench_studio *studio,
                           struct sp_error *err) {
    struct bench_way a = studio->way, b = studio->against;
    unsigned cameras = studio->scene->camera_count;
    double sum = 0, worst = 0;
    a.render.format = b.render.format = SP_RGBAF32;
    for (unsigned k = 0; k < cameras; k++) {
        struct sp_frame *one = bench_draw(studio, &a, k, k, err);
        struct sp_frame *other = one ? bench_draw(studio, &b, k, k, err) : NULL;
        double square = other ? mean_square(one, other) : 0;
        bool ok = other != NULL;
        sp_frame_unref(&one);
        sp_frame_unref(&other);
        if (!ok)
            return false;
        sum += square;
        worst = fmax(worst, square);
    }
    r->has_psnr = true;
    r->psnr_db = decibels(sum / cameras);
    r->psnr_worst_db = decibels(worst);
    return true;
}

/* Cancelling: a thread waits for a random time, records the time and sets the flag. */

struct canceller {
    double wait_ms, at_ms;
    atomic_bool flag;
};

static void *cancel_later(void *user) {
    struct canceller *c = user;
    long ns = (long)(c->wait_ms * 1e6);
    struct timespec wait = { ns / 1000000000, ns % 1000000000 };
    while (nanosleep(&wait, &wait) != 0)
        ;
    c->at_ms = sp_clock_ms();
    atomic_store(&c->flag, true);
    return NULL;
}

static double draw_unit(uint64_t *state) { /* [0, 1), Steele et al., SplitMix64 */
    uint64_t z = (*state += UINT64_C(0x9e3779b97f4a7c15));
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    z ^= z >> 31;
    return (double)(z >> 11) * 0x1p-53;
}

/* Starts one frame and cancels it; *latency_ms < 0 if the frame finished first. */
static bool cancel_one(const struct bench_studio *studio, double wait_ms, unsigned n,
                       double *latency_ms, struct sp_error *err) {
    struct bench_way way = studio->way;
    struct canceller canceller = { .wait_ms = wait_ms };
    struct sp_error why = { .code = SP_OK };
    pthread_t thread;
    way.render.cancel = &canceller.flag;
    if (pthread_create(&thread, NULL, cancel_later, &canceller) != 0)
        return sp_fail(err, SP_ERR_MEMORY, "", "no thread to cancel from");
    struct sp_frame *frame = bench_draw(studio, &way, n, n, &why);
    double returned_ms = sp_clock_ms();
    pthread_join(thread, NULL);
    bool finished = frame != NULL;
    sp_frame_unref(&frame);
    if (!finished && why.code != SP_ERR_CANCELLED) {
        if (err)
            *err = why;
        return false;
    }
    *latency_ms = finished ? -1 : returned_ms - canceller.at_ms;
    return true;
}

static bool measure_cancels(struct bench_result *r, const struct bench_studio *studio,
                            struct sp_error *err) {
    unsigned wanted = studio->options->cancel;
    struct bench_cancels *c = &r->cancels;
    double *ms = calloc(wanted, sizeof *ms);
    uint64_t seed = 1;
    bool ok = ms || sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the result");
    c->random_range_ms = bench_median(&r->times);
    for (unsigned n = 0; ok && c->stopped < wanted && n < TRIES * wanted; n++) {
        double latency = -1;
        ok = cancel_one(studio, draw_unit(&seed) * c->random_range_ms, n, &latency, err);
        if (latency < 0)
            c->finished++;
        else
            ms[c->stopped++] = latency;
    }
    if (ok && c->stopped > 0) {
        qsort(ms, c->stopped, sizeof *ms, compare);
        c->median_ms = median_of_sorted(ms, c->stopped);
        c->worst_ms = ms[c->stopped - 1];
    }
    free(ms);
    return ok;
}

bool bench_measure(struct bench_result *r, struct bench_studio *studio, struct sp_error *err) {
    const struct bench_options *o = studio->options;
    *r = (struct bench_result){ .has_psnr = false };
    if (!prepare(&studio->way, studio->scene, &o->setting, err) ||
        (o->against_text && !prepare(&studio->against, studio->scene, &o->against, err)) ||
        !measure_times(r, studio, err))
        return false;
    /* With an edit the two images are expected to differ. */
    if (o->against_text && o->setting.edit == o->against.edit && !compare_images(r, studio, err))
        return false;
    return !o->cancel || measure_cancels(r, studio, err);
}

void bench_result_finish(struct bench_result *r) {
    free(r->times.ms);
    free(r->against.ms);
    *r = (struct bench_result){ .has_psnr = false };
}
