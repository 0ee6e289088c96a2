/* SPDX-License-Identifier: Apache-2.0
 *
 * The table of one instruction set. It is compiled once per set, with the flags and names of its
 * kernels (base/isa.h).
 */
#include "backend/cpu/kernels.h"
#include "draw/footprints/sheet.h"
#include "draw/footprints/slab.h"
#include "draw/footprints/splat.h"
#include "frame/depth.h"
#include "frame/resolve.h"

static const char *const vectorised[] = {
    "adaptive", "ewa",  "reconstruction", "lowpass", "swan", "none", "gaussian", "cubic", "splat",
    "sheet",    "slab", "exponential",    "linear",  "pre",  "post", "phong",    "clip",  NULL
};

const struct cpu_kernels cpu_table = {
    .isa = SP_ISA_TEXT,
    .lanes = SP_WIDE,
    .vectorised = vectorised,
    .set_up = sp_ewa_set_up,
    .add = { [SP_COMPOSITE_SPLAT] = sp_splat_add,
             [SP_COMPOSITE_SHEET] = sp_sheet_add,
             [SP_COMPOSITE_SLAB] = sp_slab_add },
    .tile_close = sp_tile_close,
    .postconv_tile = sp_postconv_tile,
    .resample_tile = sp_resample_tile,
    .surface_tile = sp_surface_tile,
    .mesh = { sp_mesh_place, sp_mesh_compute_spans, sp_mesh_tile },
    .ranges_compute = sp_ranges_compute,
    .light = { sp_light_compute_cells, sp_light_pass, sp_light_turn_in, sp_light_turn_out },
    .voxels = { sp_voxel_set_up, sp_voxel_start, sp_voxel_add, sp_voxel_resolve, sp_voxel_merge },
    .cloud_set_up = sp_cloud_set_up,
#ifdef SP_ISA
    .has_fast_path = true,
#endif
    .resolve_rgba8 = sp_resolve_rgba8,
    .resolve_rgbaf32 = sp_resolve_rgbaf32,
    .resolve_depth = sp_depth_resolve
};
