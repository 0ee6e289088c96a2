/* SPDX-License-Identifier: Apache-2.0
 *
 * Writes a brick file (format.h) from a file of samples, strip by strip. A strip has all columns of
 * one row of bricks, so that memory grows with the width of the volume alone: 2048³ uint8 need
 * 11 MB per strip, whatever the number of slices.
 */
#ifndef SP_BRICKS_WRITE_H
#define SP_BRICKS_WRITE_H

#include "data/bricks/format.h"

struct sp_bricks_write_job {
    /* Grid, type, meaning, unit, names, anatomy, whether there are vectors (vector_bytes is not 0),
     * and for the notes others, other_vectors, steps and warnings; range, histogram and so on are
     * measured.
     */
    const struct sp_volume_info *info;
    int samples;        /* descriptor: the samples from byte 0 on, native order, i0 fastest; the
                           vectors where sp_volume_layout() says */
    int out;            /* descriptor of an empty file */
    const char *folder; /* of temporary files, which take a seventh of the samples and vectors */
    const char *title;  /* the name in errors */
    /* Called from the calling thread with the finished fraction; false cancels. NULL = none. */
    bool (*progress)(void *user, double fraction);
    void *user;
};

/* SP_ERR_IO, SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sp_bricks_write(const struct sp_bricks_write_job *job, struct sp_error *err);

#endif
