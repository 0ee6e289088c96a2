/* SPDX-License-Identifier: Apache-2.0
 *
 * The writer of a brick file: write.c writes levels of bricks, write_values.c finds what the header
 * says of the values.
 */
#ifndef SP_BRICKS_WRITE_PRIVATE_H
#define SP_BRICKS_WRITE_PRIVATE_H

#include <zstd.h>

#include "base/parallel_for.h"
#include "data/bricks/samples.h"
#include "data/bricks/write.h"

enum { WRITE_THREADS_MAX = 16 };

/* A row of bricks, with the rows and slices around it. */
struct sp_brick_strip {
    uint32_t first[2], size[2]; /* of its own samples: along axes 1 and 2 */
    uint32_t from[2], count[2]; /* in memory: with the margin */
    void *samples;
};

struct sp_brick_worker {
    ZSTD_CCtx *context;
    void *copy; /* samples of a brick */
    uint64_t histogram[SP_HISTOGRAM_BINS];
    uint64_t zeros; /* samples in holes, for the histogram */
    bool failed;    /* reading for it */
};

/* An array that is written in bricks: the samples, or the vectors as three floats each. */
struct sp_brick_array {
    bool is_vectors;
    enum sp_type type;   /* of its numbers */
    unsigned components; /* numbers per sample */
    size_t item;         /* bytes per sample */
    uint64_t at;         /* in job->samples */
    double from, share;  /* of the progress */
};

struct sp_brick_writer {
    const struct sp_bricks_write_job *job;
    struct sp_brick_header header;
    double *places; /* owned: of the header */
    struct sp_pool *pool;
    struct sp_brick_worker workers[WRITE_THREADS_MAX];
    struct sp_brick_array array;
    unsigned l;       /* the level that is written */
    int fine, coarse; /* descriptors: samples of the level, and of the next one; −1 = none */
    uint64_t at;      /* end of the file */
    struct sp_brick_strip strip;
    void *means;                    /* of the strip, for the next level */
    struct sp_brick_entry *entries; /* of the level */
    struct sp_brick_packed {
        void *bytes; /* [packed_max] */
        size_t size; /* 0 = constant */
        bool failed;
        uint64_t nonfinite;
        double longest; /* of vectors */
    } * packed;         /* by brick of the strip */
    uint64_t first_brick;
    size_t packed_max;
    size_t first_chunk; /* of those that are counted now */
};

/* Fails with SP_ERR_MEMORY. */
bool sp_bricks_write_fail_memory(const struct sp_brick_writer *writer, struct sp_error *err);
/* Reports the finished fraction of the array; false with *err set if it cancels. */
bool sp_bricks_write_report(const struct sp_brick_writer *writer, double fraction,
                            struct sp_error *err);

/* Fills the histogram from the samples of level 0, whose range is known; the progress goes from one
 * fraction of the array to another. */
bool sp_bricks_count_values(struct sp_brick_writer *writer, double from, double to,
                            struct sp_error *err);
/* Computes the projected ranges, if the level writer->fine is the first level with at most 256³
 * samples, or the last level. *is_found = true if it did so. */
bool sp_bricks_measure_projected(struct sp_brick_writer *writer, bool *is_found,
                                 struct sp_error *err);

#endif
