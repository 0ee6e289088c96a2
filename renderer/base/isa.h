/* SPDX-License-Identifier: Apache-2.0
 *
 * Kernels are written once and compiled once per instruction set. The scalar reference uses the
 * compiler's plain flags and the names as written; the others are compiled with SP_ISA defined
 * (-DSP_ISA=avx2), which appends the set's name to each of their functions:
 *
 *   sheet.c ─┬─ SP_ISA not defined ─► sp_sheet_add          scalar: the reference
 *            ├─ -DSP_ISA=sse41      ─► sp_sheet_add_sse41
 *            └─ -DSP_ISA=avx2 …     ─► sp_sheet_add_avx2
 *
 * Every header that declares such a function includes this one. The list below names all functions
 * that the kernel sources (splat_kernels() in the CMakeLists.txt of their folders) share with each
 * other and with the table (backend/cpu/table.c). If a function is missing in the list, the linker
 * reports that it is defined twice.
 */
#ifndef SP_BASE_ISA_H
#define SP_BASE_ISA_H

#ifdef SP_ISA

#define SP_ISA_JOIN(name, isa) name##_##isa
#define SP_ISA_EXPAND(name, isa) SP_ISA_JOIN(name, isa)
#define SP_ISA_NAME(name) SP_ISA_EXPAND(name, SP_ISA)
#define SP_ISA_QUOTE(isa) #isa
#define SP_ISA_QUOTE_EXPANDED(isa) SP_ISA_QUOTE(isa)
#define SP_ISA_TEXT SP_ISA_QUOTE_EXPANDED(SP_ISA)

/* splat/ */
#define sp_ewa_set_up SP_ISA_NAME(sp_ewa_set_up)
#define sp_clip_frame_init SP_ISA_NAME(sp_clip_frame_init)
#define sp_extent_span SP_ISA_NAME(sp_extent_span)
#define sp_extent_cut SP_ISA_NAME(sp_extent_cut)
#define sp_shade_direction SP_ISA_NAME(sp_shade_direction)
#define sp_shade_terms SP_ISA_NAME(sp_shade_terms)
#define sp_shade_apply SP_ISA_NAME(sp_shade_apply)
#define sp_shade_microflakes SP_ISA_NAME(sp_shade_microflakes)
/* draw/footprints/ */
#define sp_tile_init SP_ISA_NAME(sp_tile_init)
#define sp_tile_check SP_ISA_NAME(sp_tile_check)
#define sp_tile_close SP_ISA_NAME(sp_tile_close)
#define sp_layer_close SP_ISA_NAME(sp_layer_close)
#define sp_post_curve_init SP_ISA_NAME(sp_post_curve_init)
#define sp_post_class SP_ISA_NAME(sp_post_class)
#define sp_post_classify SP_ISA_NAME(sp_post_classify)
#define sp_sheet_add SP_ISA_NAME(sp_sheet_add)
#define sp_slab_add SP_ISA_NAME(sp_slab_add)
#define sp_splat_add SP_ISA_NAME(sp_splat_add)
/* frame/ */
#define sp_resolve_rgba8 SP_ISA_NAME(sp_resolve_rgba8)
#define sp_resolve_rgbaf32 SP_ISA_NAME(sp_resolve_rgbaf32)
#define sp_depth_resolve SP_ISA_NAME(sp_depth_resolve)
/* backend/cpu/ */
#define cpu_table SP_ISA_NAME(cpu_table)
/* draw/postconv/ */
#define sp_postconv_tile SP_ISA_NAME(sp_postconv_tile)
#define sp_postconv_start_group SP_ISA_NAME(sp_postconv_start_group)
#define sp_postconv_add_run SP_ISA_NAME(sp_postconv_add_run)
#define sp_postconv_add_footprints SP_ISA_NAME(sp_postconv_add_footprints)
#define sp_postconv_close_group SP_ISA_NAME(sp_postconv_close_group)
#define sp_postconv_close_sum SP_ISA_NAME(sp_postconv_close_sum)
#define sp_postconv_check_cells SP_ISA_NAME(sp_postconv_check_cells)
#define sp_postconv_resolve SP_ISA_NAME(sp_postconv_resolve)
#define sp_postconv_open_fragments SP_ISA_NAME(sp_postconv_open_fragments)
#define sp_postconv_composite_fragments SP_ISA_NAME(sp_postconv_composite_fragments)
#define sp_postconv_finish_fragments SP_ISA_NAME(sp_postconv_finish_fragments)
/* draw/resample/ */
#define sp_resample_tile SP_ISA_NAME(sp_resample_tile)
#define sp_ranges_compute SP_ISA_NAME(sp_ranges_compute)
#define sp_resample_refine SP_ISA_NAME(sp_resample_refine)
#define sp_resample_near_ranges SP_ISA_NAME(sp_resample_near_ranges)
#define sp_resample_near_visible SP_ISA_NAME(sp_resample_near_visible)
#define sp_resample_open_fragments SP_ISA_NAME(sp_resample_open_fragments)
#define sp_resample_prefetch_fragments SP_ISA_NAME(sp_resample_prefetch_fragments)
#define sp_resample_insert_before SP_ISA_NAME(sp_resample_insert_before)
#define sp_resample_fragment_s SP_ISA_NAME(sp_resample_fragment_s)
#define sp_resample_insert SP_ISA_NAME(sp_resample_insert)
#define sp_resample_start_sheets SP_ISA_NAME(sp_resample_start_sheets)
#define sp_rows_init SP_ISA_NAME(sp_rows_init)
#define sp_rows_prefetch SP_ISA_NAME(sp_rows_prefetch)
#define sp_rows_read SP_ISA_NAME(sp_rows_read)
#define sp_resample_integrate SP_ISA_NAME(sp_resample_integrate)
#define sp_resample_reduce SP_ISA_NAME(sp_resample_reduce)
#define sp_resample_reduce_close SP_ISA_NAME(sp_resample_reduce_close)
#define sp_resample_reduce_add SP_ISA_NAME(sp_resample_reduce_add)
#define sp_resample_init_blocks SP_ISA_NAME(sp_resample_init_blocks)
#define sp_resample_open_block SP_ISA_NAME(sp_resample_open_block)
#define sp_resample_reduce_open SP_ISA_NAME(sp_resample_reduce_open)
#define sp_resample_resolve SP_ISA_NAME(sp_resample_resolve)
#define sp_resample_open_sides SP_ISA_NAME(sp_resample_open_sides)
#define sp_resample_is_crossed SP_ISA_NAME(sp_resample_is_crossed)
#define sp_resample_open_cover SP_ISA_NAME(sp_resample_open_cover)
#define sp_resample_close_cover SP_ISA_NAME(sp_resample_close_cover)
/* draw/layers/surface/ */
#define sp_surface_tile SP_ISA_NAME(sp_surface_tile)
#define sp_surface_set_up SP_ISA_NAME(sp_surface_set_up)
#define sp_surface_resolve SP_ISA_NAME(sp_surface_resolve)
#define sp_surface_clip_share SP_ISA_NAME(sp_surface_clip_share)
/* draw/layers/splat_list/ */
#define sp_voxel_set_up SP_ISA_NAME(sp_voxel_set_up)
#define sp_voxel_start SP_ISA_NAME(sp_voxel_start)
#define sp_voxel_add SP_ISA_NAME(sp_voxel_add)
#define sp_voxel_resolve SP_ISA_NAME(sp_voxel_resolve)
#define sp_voxel_merge SP_ISA_NAME(sp_voxel_merge)
/* draw/layers/cloud/ */
#define sp_cloud_set_up SP_ISA_NAME(sp_cloud_set_up)
#define sp_cloud_set_up_gaussians SP_ISA_NAME(sp_cloud_set_up_gaussians)
/* draw/layers/mesh/ */
#define sp_mesh_place SP_ISA_NAME(sp_mesh_place)
#define sp_mesh_compute_spans SP_ISA_NAME(sp_mesh_compute_spans)
#define sp_mesh_cover SP_ISA_NAME(sp_mesh_cover)
#define sp_mesh_tile SP_ISA_NAME(sp_mesh_tile)
/* draw/light/ */
#define sp_light_compute_cells SP_ISA_NAME(sp_light_compute_cells)
#define sp_light_pass SP_ISA_NAME(sp_light_pass)
#define sp_light_turn_in SP_ISA_NAME(sp_light_turn_in)
#define sp_light_turn_out SP_ISA_NAME(sp_light_turn_out)

#else
#define SP_ISA_TEXT "scalar"
#endif

#endif
