/* SPDX-License-Identifier: Apache-2.0
 *
 * The CPU backend: the stages of classify/, splat/ and tile/ as a graph of parallel loops.
 *
 * This header is its table of kernels, the loops over voxels and pixels. They are written once and
 * compiled once an instruction set (base/isa.h); each set has a table of its own, which table.c
 * fills in the same way. The scalar one is the reference that the others are held to.
 */
#ifndef SP_BACKEND_CPU_KERNELS_H
#define SP_BACKEND_CPU_KERNELS_H

#include "base/isa.h"
#include "postconv/postconv.h"
#include "splat/ewa.h"
#include "tile/blend.h"

struct cpu_kernels {
    const char *isa; /* "scalar", "sse41", … */
    unsigned lanes;  /* SP_WIDE of that set */
    /* What of a view is set up, added and composited so many at a time; ends with NULL. A voxel's
     * class and a pixel's class are looked up one by one, and so is how planes cut a voxel. */
    const char *const *vectorised;
    uint32_t (*set_up)(const struct sp_ewa_frame *frame, const struct sp_ewa_run *run,
                       const struct sp_splats *out); /* sp_ewa_set_up() */
    /* By enum sp_compositing: sp_splat_add(), sp_sheet_add(), sp_slab_add(). */
    void (*add[3])(struct sp_tile *tile, const struct sp_blend *blend,
                   const struct sp_splats *records, uint32_t n);
    void (*tile_close)(struct sp_tile *tile, const struct sp_blend *blend); /* sp_tile_close() */
    sp_postconv_tile_fn *postconv_tile;                                     /* sp_postconv_tile() */
    /* Draws sheets by the fast path where it can (postconv/). False for the scalar set: as the
     * reference of the others it draws every view by the general path. */
    bool has_fast_path;
    void (*resolve_rgba8)(const float *const planes[4], uint32_t count, const float background[4],
                          unsigned char *out); /* sp_resolve_rgba8() */
    void (*resolve_rgbaf32)(const float *const planes[4], uint32_t count, const float background[4],
                            float *out); /* sp_resolve_rgbaf32() */
};

/* Of the set that a source is compiled for: scalar's is called cpu_table, avx2's cpu_table_avx2. */
extern const struct cpu_kernels cpu_table;

/* The names of instruction sets, those that this program was not compiled for too; NULL past the
 * end. The first is "scalar", and later ones are preferred. */
const char *cpu_isa_at(unsigned i);

/* The table of that set; "auto" is the last in cpu_isa_at()'s order that this machine can run. A
 * set that there is not here is SP_ERR_UNSUPPORTED, another name SP_ERR_INVALID. */
bool cpu_kernels_init(struct cpu_kernels *kernels, const char *isa, struct sp_error *err);

#endif
