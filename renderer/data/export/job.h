/* SPDX-License-Identifier: Apache-2.0
 *
 * Writers of volumes in formats of other programs. Each takes a description and a file with the
 * samples, and writes them piece by piece, so that memory does not grow with the volume.
 *
 *   convert.c ─► samples in a file without a name ─► nrrd.c, nifti.c ─► stream.c ─► a file
 *                                                 ├► vdb_blocks.c ─► vdb.c ───────► a file
 *                                                 └► zarr.c, in folder.c ─► a folder
 */
#ifndef SP_EXPORT_JOB_H
#define SP_EXPORT_JOB_H

#include "sp/volume.h"

struct sp_export_job {
    /* Grid with even axes, type, units, names and anatomy. Range and histogram are not used. */
    const struct sp_volume_info *info;
    int samples;        /* descriptor: the samples from byte 0 on, native order, i0 fastest */
    int out;            /* descriptor of an empty file, or of an empty folder */
    const char *folder; /* folder of temporary files: the folder of the output, with a '/' at its
                           end, or "." */
    const char *title;  /* the path of the output, for errors; its end chooses among the variants of
                           a format */
    /* Called from the calling thread with the finished fraction; false cancels. NULL = none. */
    bool (*progress)(void *user, double fraction);
    void *user;
};

/* SP_ERR_IO, SP_ERR_MEMORY, SP_ERR_CANCELLED; SP_ERR_UNSUPPORTED: the format cannot store the
 * volume. */
typedef bool sp_export_fn(const struct sp_export_job *job, struct sp_error *err);
bool sp_export_nrrd(const struct sp_export_job *job, struct sp_error *err);  /* raw */
bool sp_export_nifti(const struct sp_export_job *job, struct sp_error *err); /* gzip: .gz */
bool sp_export_vdb(const struct sp_export_job *job, struct sp_error *err);   /* zlib */
bool sp_export_zarr(const struct sp_export_job *job, struct sp_error *err);  /* a folder */

/* Writes a header and all samples, packed by gzip or not (stream.c). */
bool sp_export_stream(const struct sp_export_job *job, const void *header, size_t size,
                      bool is_packed, struct sp_error *err);

/* Calls progress(); false with *err set if it cancels. */
bool sp_export_report(const struct sp_export_job *job, double fraction, struct sp_error *err);

/* Computes the directions of the axes and the origin in a world whose axes have the anatomical
 * letters `to`, such as "RAS". Without an anatomy they stay unchanged (place.c). */
void sp_export_place(const struct sp_volume_info *info, const char to[4], double direction[3][3],
                     double origin[3]);

#endif
