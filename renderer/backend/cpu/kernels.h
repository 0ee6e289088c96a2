/* SPDX-License-Identifier: Apache-2.0
 *
 * The CPU backend: the stages of classify/, splat/ and tile/ as a graph of parallel loops.
 *
 * This header is its table of kernels, the loops over voxels and pixels that instruction sets will
 * replace one by one. The table is filled with the scalar reference first.
 */
#ifndef SP_BACKEND_CPU_KERNELS_H
#define SP_BACKEND_CPU_KERNELS_H

#include "splat/ewa.h"
#include "tile/blend.h"

struct cpu_kernels {
    const char *isa; /* the most advanced set in the table */
    uint32_t (*set_up)(const struct sp_ewa_frame *frame, const struct sp_ewa_run *run,
                       const struct sp_splats *out); /* sp_ewa_set_up() */
    /* By enum sp_compositing: sp_splat_add(), sp_sheet_add(), sp_slab_add(). */
    void (*add[3])(struct sp_tile *tile, const struct sp_blend *blend,
                   const struct sp_splats *records, uint32_t n);
    void (*tile_close)(struct sp_tile *tile, const struct sp_blend *blend); /* sp_tile_close() */
    void (*resolve_rgba8)(const float *const planes[4], uint32_t count, const float background[4],
                          unsigned char *out); /* sp_resolve_rgba8() */
    void (*resolve_rgbaf32)(const float *const planes[4], uint32_t count, const float background[4],
                            float *out); /* sp_resolve_rgbaf32() */
};

/* Fills the table for "auto" or the name of an instruction set; SP_ERR_INVALID for another. */
bool cpu_kernels_init(struct cpu_kernels *kernels, const char *isa, struct sp_error *err);

#endif
