/* SPDX-License-Identifier: Apache-2.0
 *
 * splat-limit: prints the peak rates of this bench as one JSON line. Each number is the best of a
 * few short runs on all threads at once; "copy" counts only the bytes written.
 *
 *   {"isa":…, "threads":…, "add": {"3": Msplat/s, "5":…, "7":…, "11":…}, "set_up": Msplat/s,
 *    "read": GB/s, "copy": GB/s}
 */
#include <getopt.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/cpu_features.h"
#include "base/parallel_for.h"
#include "bench/limit_kernels.h"

enum { EXIT_USAGE = 2, RUNS = 5, MEMORY_BYTES = 64 << 20, THREADS_MAX = 256 };
static const double run_ms = 15; /* minimum time of a run */

extern const struct limit_table bench_limit_table_sse41, bench_limit_table_avx2,
    bench_limit_table_avx512, bench_limit_table_neon;

/* In rising order of instruction sets. */
static const struct {
    uint32_t feature;
    const struct limit_table *table;
} tables[] = {
    { 0, &bench_limit_table },
#ifdef LIMIT_HAS_SSE41
    { SP_CPU_SSE41, &bench_limit_table_sse41 },
#endif
#ifdef LIMIT_HAS_AVX2
    { SP_CPU_AVX2, &bench_limit_table_avx2 },
#endif
#ifdef LIMIT_HAS_AVX512
    { SP_CPU_AVX512, &bench_limit_table_avx512 },
#endif
#ifdef LIMIT_HAS_NEON
    { SP_CPU_NEON, &bench_limit_table_neon },
#endif
};
enum { TABLES = sizeof tables / sizeof tables[0] };

/* Returns the table of the instruction set `name`; for "auto", the best table that this machine can
 * run. NULL if there is none. */
static const struct limit_table *find_table(const char *name) {
    const struct limit_table *found = NULL;
    for (int i = 0; i < TABLES; i++)
        if ((tables[i].feature & ~sp_cpu_features()) == 0 &&
            (strcmp(name, "auto") == 0 || strcmp(name, tables[i].table->isa) == 0))
            found = tables[i].table;
    return found;
}

/* Memory of one thread. */
struct thread_memory {
    struct limit_tile tile;
    struct limit_voxels voxels;
    struct limit_footprint footprints[LIMIT_FOOTPRINTS];
    uint64_t *from, *to; /* MEMORY_BYTES each */
    uint64_t sum;        /* keeps the compiler from removing the reads */
};

struct limit_bench {
    const struct limit_table *table;
    struct sp_pool *pool;
    unsigned threads;
    struct thread_memory *memories;
};

/* A task repeats its work `count` times with the memory of one memory. */
struct task {
    struct limit_bench *bench;
    void (*work)(struct limit_bench *bench, struct thread_memory *memory, int argument);
    int argument;
    unsigned count;
};

static void do_task(void *user, size_t begin, size_t end, unsigned worker) {
    struct task *t = user;
    (void)worker; /* a memory belongs to the task index, not to the thread */
    for (size_t i = begin; i < end; i++)
        for (unsigned n = 0; n < t->count; n++)
            t->work(t->bench, &t->bench->memories[i], t->argument);
}

/* Returns calls of `work` per second over all threads, after increasing the count until a run is
 * long enough. */
static double best_rate(struct limit_bench *m, struct task t) {
    double best = 0;
    t.bench = m;
    t.count = 1;
    for (int run = 0; run < RUNS;) {
        double start = sp_clock_ms();
        sp_parallel_for(m->pool, m->threads, 1, do_task, &t);
        double ms = sp_clock_ms() - start;
        if (ms < run_ms && t.count < 1u << 30) {
            t.count *= 2;
            continue;
        }
        best = fmax(best, (double)t.count * m->threads / ms * 1e3);
        run++;
    }
    return best;
}

static void work_add(struct limit_bench *m, struct thread_memory *d, int width) {
    m->table->add(&d->tile, d->footprints, width);
}

static void work_set_up(struct limit_bench *m, struct thread_memory *d, int argument) {
    static const struct limit_camera camera = { .focal = 900,
                                                .centre = { 256, 256 },
                                                .variance = { 0.5f, 0.1f, 0, 0.5f, 0.05f, 0.4f },
                                                .lowpass = 1,
                                                .radius = 3 };
    (void)argument;
    m->table->set_up(&d->voxels, &camera);
}

static void work_read(struct limit_bench *m, struct thread_memory *d, int argument) {
    uint64_t sum[4] = { 0 };
    (void)m;
    (void)argument;
    for (size_t i = 0; i < MEMORY_BYTES / sizeof *d->from; i += 4)
        for (int k = 0; k < 4; k++)
            sum[k] += d->from[i + (size_t)k];
    d->sum += sum[0] + sum[1] + sum[2] + sum[3];
}

static void work_copy(struct limit_bench *m, struct thread_memory *d, int argument) {
    (void)m;
    (void)argument;
    memcpy(d->to, d->from, MEMORY_BYTES);
}

static uint32_t draw(uint32_t *state) { /* Marsaglia's xorshift */
    *state ^= *state << 13;
    *state ^= *state >> 17;
    return *state ^= *state << 5;
}

/* Creates Gaussians of the given width, centred in their boxes, at random places of the tile. */
static void place_footprints(struct thread_memory *d, int width) {
    uint32_t seed = 1;
    float middle = 0.5f * (float)(width - 1), sharp = 4.5f / (middle * middle + 1) * 1.442695f;
    memset(&d->tile, 0, sizeof d->tile);
    for (int i = 0; i < LIMIT_FOOTPRINTS; i++) {
        uint32_t x = draw(&seed) % (uint32_t)(LIMIT_TILE - width + 1);
        uint32_t y = draw(&seed) % (uint32_t)(LIMIT_TILE - width + 1);
        d->footprints[i] = (struct limit_footprint){
            .offset = (int)(y * LIMIT_ROW + x),
            .k0 = -2 * sharp * middle * middle,
            .k1 = 2 * sharp * middle,
            .k2 = -sharp,
            .m0 = sharp * (2 * middle - 1),
            .fall = exp2f(-2 * sharp),
            .weight = { 1e-3f, 2e-3f, 3e-3f, 4e-3f },
        };
    }
}

static bool place_desk(struct thread_memory *d) {
    uint32_t seed = 7;
    d->from = malloc(MEMORY_BYTES);
    d->to = malloc(MEMORY_BYTES);
    if (!d->from || !d->to)
        return false;
    memset(d->from, 1, MEMORY_BYTES);
    memset(d->to, 2, MEMORY_BYTES);
    for (int i = 0; i < LIMIT_VOXELS; i++) {
        for (int axis = 0; axis < 2; axis++)
            d->voxels.at[axis][i] = (float)(draw(&seed) % 256) - 128;
        d->voxels.at[2][i] = (float)(draw(&seed) % 256) + 400;
    }
    return true;
}

static void measure(struct limit_bench *m) {
    printf("{\"isa\": \"%s\", \"threads\": %u, \"add\": {", m->table->isa, m->threads);
    for (int i = 0; i < LIMIT_WIDTHS; i++) {
        for (unsigned k = 0; k < m->threads; k++)
            place_footprints(&m->memories[k], limit_widths[i]);
        double rate = best_rate(m, (struct task){ .work = work_add, .argument = limit_widths[i] });
        printf("%s\"%d\": %.1f", i ? ", " : "", limit_widths[i], rate * LIMIT_FOOTPRINTS * 1e-6);
    }
    double set_up = best_rate(m, (struct task){ .work = work_set_up });
    double read = best_rate(m, (struct task){ .work = work_read });
    double copy = best_rate(m, (struct task){ .work = work_copy });
    printf("}, \"set_up\": %.1f, \"read\": %.1f, \"copy\": %.1f}\n", set_up * LIMIT_VOXELS * 1e-6,
           read * MEMORY_BYTES * 1e-9, copy * MEMORY_BYTES * 1e-9);
}

static int run(const struct limit_table *table, unsigned threads) {
    struct sp_error err = { .text = "out of memory" };
    struct limit_bench m = { .table = table, .threads = threads };
    m.pool = sp_pool_create(threads, &err);
    m.memories = aligned_alloc(64, (threads * sizeof *m.memories + 63) & ~(size_t)63);
    bool ok = m.pool && m.memories;
    if (m.memories)
        memset(m.memories, 0, threads * sizeof *m.memories);
    for (unsigned i = 0; ok && i < threads; i++)
        ok = place_desk(&m.memories[i]);
    if (ok)
        measure(&m);
    else
        fprintf(stderr, "splat-limit: %s\n", err.text);
    for (unsigned i = 0; m.memories && i < threads; i++) {
        free(m.memories[i].from);
        free(m.memories[i].to);
    }
    free(m.memories);
    sp_pool_destroy(&m.pool);
    return ok ? EXIT_SUCCESS : EXIT_FAILURE;
}

int main(int argc, char **argv) {
    static const struct option flags[] = { { "threads", required_argument, NULL, 't' },
                                           { "isa", required_argument, NULL, 'i' },
                                           { "help", no_argument, NULL, 'h' },
                                           { NULL, 0, NULL, 0 } };
    static const char usage[] = "usage: splat-limit [--threads N] [--isa NAME]\n"
                                "Measures the peak rates of this bench; prints one JSON line.\n"
                                "N is 1 (default) to 256; NAME auto (default), scalar, avx2, ...\n";
    unsigned long threads = 1;
    const char *isa = "auto";
    char *end = NULL;
    for (int c; (c = getopt_long(argc, argv, "", flags, NULL)) != -1;) {
        if (c == 't')
            threads = strtoul(optarg, &end, 10);
        else if (c == 'i')
            isa = optarg;
        else
            fputs(usage, c == 'h' ? stdout : stderr);
        if (c == 'h' || c == '?')
            return c == 'h' ? EXIT_SUCCESS : EXIT_USAGE;
    }
    const struct limit_table *table = find_table(isa);
    if (!table || threads < 1 || threads > THREADS_MAX || (end && *end) || optind < argc) {
        fputs(table ? usage : "splat-limit: this bench does not run that instruction set\n",
              stderr);
        return EXIT_USAGE;
    }
    return run(table, (unsigned)threads);
}
