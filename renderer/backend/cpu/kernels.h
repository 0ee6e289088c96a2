/* SPDX-License-Identifier: Apache-2.0
 *
 * The CPU backend: the stages of classify/, splat/ and draw/ as a graph of parallel loops.
 *
 * This header is the table of kernels: the loops over voxels and pixels. Each kernel is written
 * once and compiled once per instruction set (base/isa.h). table.c fills the table of each set. The
 * scalar set is the reference of all other sets.
 */
#ifndef SP_BACKEND_CPU_KERNELS_H
#define SP_BACKEND_CPU_KERNELS_H

#include "base/isa.h"
#include "draw/footprints/blend.h"
#include "draw/layers/cloud/kernels.h"
#include "draw/layers/mesh/kernels.h"
#include "draw/layers/splat_list/kernels.h"
#include "draw/layers/surface/surface.h"
#include "draw/light/kernels.h"
#include "draw/postconv/postconv.h"
#include "draw/resample/resample.h"
#include "splat/ewa.h"

struct cpu_kernels {
    const char *isa; /* "scalar", "sse41", … */
    unsigned lanes;  /* SP_WIDE of that set */
    /* The settings of a view for which splats are set up, added and composited `lanes` at a time;
     * ends with NULL. Classes, and the clipping of voxels by planes, are always computed one by
     * one. */
    const char *const *vectorised;
    uint32_t (*set_up)(const struct sp_ewa_frame *frame, const struct sp_ewa_run *run,
                       const struct sp_splats *out); /* sp_ewa_set_up() */
    /* By enum sp_compositing: sp_splat_add(), sp_sheet_add(), sp_slab_add(). */
    void (*add[3])(struct sp_tile *tile, const struct sp_blend *blend,
                   const struct sp_splats *records, uint32_t n);
    void (*tile_close)(struct sp_tile *tile, const struct sp_blend *blend); /* sp_tile_close() */
    sp_postconv_tile_fn *postconv_tile;                                     /* sp_postconv_tile() */
    sp_resample_tile_fn *resample_tile;                                     /* sp_resample_tile() */
    sp_ranges_compute_fn *ranges_compute; /* sp_ranges_compute() */
    struct sp_light_kernels light;        /* draw/light/kernels.h */
    struct sp_voxel_kernels voxels;       /* draw/layers/splat_list/kernels.h */
    sp_voxel_set_up_fn *cloud_set_up;     /* sp_cloud_set_up() */
    sp_surface_tile_fn *surface_tile;     /* sp_surface_tile() */
    struct sp_mesh_kernels mesh;          /* draw/layers/mesh/kernels.h */
    /* True if sheets are drawn by the fast path where possible (draw/postconv/). False for the
     * scalar set, which is the reference of the other sets: it draws every view by the general
     * path. */
    bool has_fast_path;
    void (*resolve_rgba8)(const float *const planes[4], uint32_t count, const float background[4],
                          unsigned char *out); /* sp_resolve_rgba8() */
    void (*resolve_rgbaf32)(const float *const planes[4], uint32_t count, const float background[4],
                            float *out); /* sp_resolve_rgbaf32() */
    void (*resolve_depth)(const float *const planes[3], const float *const place[2], uint32_t count,
                          float *depth, float *spread); /* sp_depth_resolve() */
};

/* The table of the set that the including source is compiled for: cpu_table for scalar,
 * cpu_table_avx2 for avx2, and so on. */
extern const struct cpu_kernels cpu_table;

/* Returns the name of instruction set i, also if this program was not compiled for it; NULL past
 * the end. The first set is "scalar"; later sets are preferred. */
const char *cpu_isa_at(unsigned i);

/* Copies the table of the named set; "auto" is the last set in the order of cpu_isa_at() that this
 * machine can run. SP_ERR_UNSUPPORTED if this machine or this build cannot run the set,
 * SP_ERR_INVALID if the name is unknown. */
bool cpu_kernels_init(struct cpu_kernels *kernels, const char *isa, struct sp_error *err);

#endif
