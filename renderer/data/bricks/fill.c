/* SPDX-License-Identifier: Apache-2.0 */
#include "data/bricks/fill.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "data/bricks/gather.h"
#include "data/volume/sample.h"

enum { THREADS_MAX = 256 };

struct fill {
    const struct sp_brick_fill_job *job;
    const struct sp_brick_level *level;
    unsigned arrays;                 /* 1 = the samples, 2 = also the vectors */
    size_t item[2];                  /* bytes per sample of each */
    struct sp_brick_box_samples box; /* that is filled */
    struct {
        struct sp_brick_scratch *scratch;
        void *brick;
    } workers[THREADS_MAX];
    uint32_t *order;           /* owned: the wanted bricks in the order in which they are read */
    size_t order_count, begin; /* where the part that is read now begins */
    uint8_t *has;              /* owned: by brick, 1 = it is there */
    uint8_t *missing, *failed; /* owned: of bricks that are cut from chunks; NULL = of a file */
    atomic_bool ended;         /* cancelled, or out of memory */
    pthread_mutex_t mutex;     /* guards why */
    struct sp_error *why;
};

/* Array n in a set of arrays (need.h). */
static uint8_t bit(unsigned n) {
    return (uint8_t)(n ? BRICK_VECTORS : BRICK_SAMPLES);
}

/* Where brick i of a box lies in its array n. */
static struct sp_brick_place place_in(const struct fill *f, const struct sp_brick_box_samples *box,
                                      unsigned n, uint64_t i) {
    const struct sp_brick_box_samples vectors = { .need = box->need,
                                                  .samples = (void *)box->vectors };
    return sp_brick_place(n ? &vectors : box, f->level, f->item[n], i);
}

static uint64_t number_of(const struct fill *f, uint64_t i) {
    return sp_brick_need_at(f->job->need, f->level, i);
}

/* Copies the rows of a brick to their place. In `from`, rows are `row` bytes apart and slices
 * `slice` bytes. */
static void put(const struct fill *f, unsigned n, const struct sp_brick_place *p, const char *from,
                size_t row, size_t slice) {
    for (uint32_t z = 0; z < p->size[2]; z++)
        for (uint32_t y = 0; y < p->size[1]; y++)
            memcpy(p->samples + z * p->slice + y * p->row, from + z * slice + y * row,
                   p->size[0] * f->item[n]);
}

static void put_constant(const struct fill *f, uint64_t i) {
    const struct sp_brick_entry *entry =
        &sp_brick_file_entries(f->job->file, f->job->need->level)[number_of(f, i)];
    const struct sp_volume_info *info = &sp_brick_file_header(f->job->file)->info;
    sp_brick_file_begin(f->job->file);
    const double value = sp_brick_value(entry, info->type);
    sp_brick_file_end(f->job->file);
    if (value == 0)
        return;
    struct sp_brick_place p = place_in(f, &f->box, 0, i);
    double row[BRICK_SIDE]; /* as many samples of any type */
    for (size_t x = 0; x < BRICK_SIDE; x++)
        sp_sample_set(row, info->type, x, value);
    put(f, 0, &p, (const char *)row, 0, 0);
}

/* Puts samples of the coarse level into array n of a brick. */
static void put_coarse(const struct fill *f, unsigned n, uint64_t brick) {
    const struct sp_brick_header *header = sp_brick_file_header(f->job->file);
    const unsigned coarser = f->job->coarse.need->level;
    const struct sp_brick_level *to = &header->level[coarser];
    const uint32_t *dims = to->dims;
    uint32_t first[3], size[3], nearest[3][BRICK_SIDE];
    sp_brick_box(f->level, number_of(f, brick), first, size);
    for (int a = 0; a < 3; a++)
        for (uint32_t i = 0; i < size[a]; i++) {
            const double at = f->level->offset[a] + f->level->step[a] * (first[a] + i);
            const double coarse = floor((at - to->offset[a]) / to->step[a] + 0.5);
            nearest[a][i] = (uint32_t)fmin(fmax(coarse, 0), dims[a] - 1);
        }
    const struct sp_brick_place p = place_in(f, &f->box, n, brick);
    const size_t item = f->item[n];
    const char *from =
        n ? (const char *)f->job->coarse.vectors : (const char *)f->job->coarse.samples;
    for (uint32_t z = 0; z < size[2]; z++)
        for (uint32_t y = 0; y < size[1]; y++)
            for (uint32_t x = 0; x < size[0]; x++) {
                const size_t at =
                    ((size_t)nearest[2][z] * dims[1] + nearest[1][y]) * dims[0] + nearest[0][x];
                memcpy(p.samples + z * p.slice + y * p.row + x * item, from + at * item, item);
            }
}

/* Copies array n of a brick that is in memory already; false if it is not. */
static bool put_known(const struct fill *f, unsigned n, uint64_t i) {
    const struct sp_brick_fill_job *job = f->job;
    for (size_t k = 0; k < job->known_count; k++) {
        const struct sp_brick_box_samples *known = &job->known[k];
        uint64_t at;
        if (known->need->level != job->need->level ||
            !(sp_brick_need_arrays(known->need) & bit(n)) ||
            !sp_brick_need_find(job->need, i, known->need, &at) ||
            known->need->wanted[at] < BRICK_WANTED || (known->lost[at] & bit(n)))
            continue;
        const struct sp_brick_place to = place_in(f, &f->box, n, i),
                                    from = place_in(f, known, n, at);
        put(f, n, &to, from.samples, from.row, from.slice);
        return true;
    }
    return false;
}

static void end(struct fill *f) {
    atomic_store_explicit(&f->ended, true, memory_order_relaxed);
}

/* Array n of a brick cannot be read. Without a coarse level its vectors stay 0. */
static void fill_unreadable(const struct fill *f, unsigned n, uint64_t i) {
    if (f->job->coarse.samples)
        put_coarse(f, n, i);
    else if (n == 0)
        put_constant(f, i);
    f->job->lost[i] |= bit(n);
}

/* Reads array n of a brick from the file. */
static bool read_array(const struct fill *f, unsigned n, uint64_t i, unsigned worker,
                       struct sp_error *err) {
    const struct sp_brick_file *file = f->job->file;
    const struct sp_brick_place p = place_in(f, &f->box, n, i);
    const size_t row = p.size[0] * f->item[n];
    struct sp_brick_scratch *scratch = f->workers[worker].scratch;
    void *brick = f->workers[worker].brick;
    const unsigned level = f->job->need->level;
    if (!(n ? sp_brick_file_read_vectors(file, level, number_of(f, i), scratch, brick, err)
            : sp_brick_file_read(file, level, number_of(f, i), scratch, brick, err)))
        return false;
    put(f, n, &p, brick, row, row * p.size[1]);
    return true;
}

static void put_read(struct fill *f, unsigned n, uint64_t i, unsigned worker) {
    struct sp_error err;
    if (f->missing) { /* it is cut from chunks */
        f->missing[i] = 1;
        return;
    }
    if (read_array(f, n, i, worker, &err))
        return;
    fill_unreadable(f, n, i);
    pthread_mutex_lock(&f->mutex);
    *f->why = err;
    pthread_mutex_unlock(&f->mutex);
}

static bool is_ended(struct fill *f) {
    const struct sp_brick_fill_job *job = f->job;
    if (!atomic_load_explicit(&f->ended, memory_order_relaxed) && job->is_cancelled &&
        job->is_cancelled(job->user))
        end(f);
    return atomic_load_explicit(&f->ended, memory_order_relaxed);
}

static void fill_wanted(void *user, size_t begin, size_t end_, unsigned worker) {
    struct fill *f = user;
    for (size_t k = begin; k < end_ && !is_ended(f); k++) {
        const uint64_t i = f->order[f->begin + k];
        for (unsigned n = 0; n < f->arrays; n++)
            if (!put_known(f, n, i))
                put_read(f, n, i, worker);
        f->has[i] = !f->missing || !f->missing[i];
    }
}

/* Reads some bricks after the other, and tells which are there. */
static void fill_batches(struct fill *f) {
    const struct sp_brick_fill_job *job = f->job;
    const size_t batch = (size_t)BRICK_BATCH * sp_pool_threads(job->pool);
    for (f->begin = 0; f->begin < f->order_count && !is_ended(f); f->begin += batch) {
        const size_t left = f->order_count - f->begin;
        sp_parallel_for(job->pool, left < batch ? left : batch, 1, fill_wanted, f);
        if (left > batch && !f->missing && job->is_due && job->is_due(job->user))
            job->progress(job->user, f->has);
    }
}

static void fill_others(void *user, size_t begin, size_t end_, unsigned worker) {
    struct fill *f = user;
    (void)worker;
    for (size_t i = begin; i < end_ && !is_ended(f); i++)
        if (f->job->need->wanted[i] == BRICK_HIDDEN)
            put_constant(f, i);
}

/* Cuts the missing bricks from chunks. */
static bool gather(struct fill *f, struct sp_error *err) {
    const struct sp_brick_fill_job *job = f->job;
    const struct sp_gather_job own = { .file = job->file,
                                       .need = job->need,
                                       .missing = f->missing,
                                       .failed = f->failed,
                                       .pool = job->pool,
                                       .has = f->has,
                                       .is_cancelled = job->is_cancelled,
                                       .is_due = job->is_due,
                                       .progress = job->progress,
                                       .user = job->user,
                                       .box = &f->box };
    if (!sp_gather(&own, f->why, err))
        return false;
    for (uint64_t i = 0; i < sp_brick_need_count(job->need); i++)
        if (f->failed[i])
            fill_unreadable(f, 0, i);
    return true;
}

static bool allocate(struct fill *f, unsigned threads, struct sp_error *err) {
    const bool has_chunks = sp_brick_file_chunks(f->job->file) != NULL;
    const uint64_t count = sp_brick_need_count(f->job->need);
    const size_t item = sp_brick_item_max(&sp_brick_file_header(f->job->file)->info);
    f->order = sp_brick_order(f->job->need->wanted, count, &f->order_count);
    f->has = calloc(1, count);
    bool ok = f->order && f->has;
    if (has_chunks) {
        f->missing = calloc(1, count);
        f->failed = calloc(1, count);
        ok = ok && f->missing && f->failed;
    }
    for (unsigned t = 0; ok && !has_chunks && t < threads; t++)
        ok = (f->workers[t].scratch = sp_brick_scratch_create(err)) &&
             (f->workers[t].brick = malloc((size_t)BRICK_SIDE * BRICK_SIDE * BRICK_SIDE * item));
    return ok || sp_fail(err, SP_ERR_MEMORY, "", "out of memory for reading bricks");
}

bool sp_brick_fill(const struct sp_brick_fill_job *job, struct sp_error *why,
                   struct sp_error *err) {
    const struct sp_brick_header *header = sp_brick_file_header(job->file);
    struct fill *f = calloc(1, sizeof *f);
    const unsigned threads = sp_pool_threads(job->pool);
    bool ok;
    why->code = SP_OK;
    if (!f)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for reading bricks");
    f->job = job;
    f->level = &header->level[job->need->level];
    f->arrays = job->need->has_vectors ? 2 : 1;
    f->item[0] = sp_type_size(header->info.type);
    f->item[1] = BRICK_VECTOR_BYTES;
    f->why = why;
    atomic_init(&f->ended, false);
    pthread_mutex_init(&f->mutex, NULL);
    f->box = (struct sp_brick_box_samples){ .need = job->need,
                                            .samples = job->samples,
                                            .blocks = job->blocks,
                                            .vectors = (const float(*)[3])job->vectors };
    ok = allocate(f, threads, err);
    if (ok) {
        sp_parallel_for(job->pool, (size_t)sp_brick_need_count(job->need), 1, fill_others, f);
        fill_batches(f);
    }
    if (ok && atomic_load(&f->ended))
        ok = sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    if (ok && f->missing)
        ok = gather(f, err);
    for (unsigned t = 0; t < threads; t++) {
        sp_brick_scratch_destroy(&f->workers[t].scratch);
        free(f->workers[t].brick);
    }
    pthread_mutex_destroy(&f->mutex);
    free(f->order);
    free(f->has);
    free(f->missing);
    free(f->failed);
    free(f);
    return ok;
}
