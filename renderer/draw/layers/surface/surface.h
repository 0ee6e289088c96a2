/* SPDX-License-Identifier: Apache-2.0
 *
 * Iso-surfaces by surface splatting (Zwicker et al. 2001, section 5).
 *
 *   points (points.h) ─► blocks in front-to-back order, by tile     sp_surface_prepare()
 *                        └─► per tile: footprints ─► sheets ─► fragments     sp_surface_tile()
 *
 * A sheet holds one layer of the surface at a pixel: sums of the weights, depths and normals of
 * footprints. Footprints with the same facing and similar depths form a sheet. Each sheet is shaded
 * once per pixel. README.md of this folder derives the formulas.
 */
#ifndef SP_SURFACE_SURFACE_H
#define SP_SURFACE_SURFACE_H

#include "base/arena.h"
#include "base/isa.h"
#include "draw/footprints/bin.h"
#include "draw/layers/surface/focus.h"
#include "frame/fragments.h"
#include "splat/ewa.h"

enum {
    SURFACE_SHEETS = 4, /* per pixel and facing; the last one also holds all footprints behind it */
    SURFACE_STRIDE = SP_FRAGMENT_TILE + 16 /* floats per row: vectors may go beyond the tile */
};

/* The inputs for one layer of a frame. */
struct sp_surface_input {
    const struct sp_view *view;
    const struct sp_layer *layer;
    const struct sp_volume *volume; /* NULL: discs close to the eye stay large */
    const struct sp_grid *grid;     /* of the volume */
    const struct sp_surface_points *points;
    const struct sp_camera_transform *camera;
    const struct sp_shade *shade; /* NULL = not lit */
    bool is_enlarged;             /* the level of the points is coarser than the image needs */
    struct sp_interrupt interrupt;
    struct sp_pool *pool;
    struct sp_arena *arena; /* of the frame */
};

/* A surface in a frame. */
struct sp_surface {
    struct sp_ewa_frame frame;
    const struct sp_surface_points *points;
    struct sp_surface_points near; /* of the blocks close to the eye, instead of `points` */
    struct sp_surface_focus focus; /* growth is 0 if no block is close */
    const struct sp_shade *shade;
    float color[3], opacity;
    bool is_opaque;
    float facing[3][3]; /* vector area in index space → camera space [cells²] */
    float squeeze;      /* 1 − 1/flatness */
    float bend;         /* factor of points->bend: cells per step times σ² */
    float tolerance;    /* largest difference of depth in a sheet [deviations] */
    float reach;        /* reach of the largest kernel [cells] */
    float stretch;      /* largest factor by which kernels look larger beside the image's centre */
    float depth_first;  /* depths of sheets are relative to this [cells] */
    float to_camera[3][3];
    struct sp_clip_frame clip;
    struct sp_clip_frame borders; /* faces of the volume that are close to the surface */
    bool cuts_near;               /* a part of the surface is nearer than the near plane */
    uint64_t drawn;               /* points of the blocks that are in the image */
    int columns, rows;            /* of tiles */
    struct sp_splat *blocks;      /* in front-to-back order: box, `sheet` = number of the block,
                                     `depth` = where it begins [cells] */
    struct sp_bins bins;          /* entries: numbers of `blocks` */
};

/* The block of a number: those of `points` come first, those of `near` follow. *points: its points.
 */
static inline const struct sp_surface_block *
sp_surface_block_at(const struct sp_surface *s, uint32_t number,
                    const struct sp_surface_points **points) {
    const uint32_t far = s->points->block_count;
    *points = number < far ? s->points : &s->near;
    return &(*points)->blocks[number < far ? number : number - far];
}

/* Returns the area of a step of sp_surface_points.area [cell faces, of the surface's level]. */
static inline float sp_surface_area_step(const struct sp_surface *s,
                                         const struct sp_surface_points *points) {
    const unsigned coarser = s->points->level - points->level;
    return 1 / (SURFACE_AREA_STEPS * (float)(1u << 2 * coarser));
}

struct sp_surface_sheet_row {
    float weight[SURFACE_STRIDE], depth[SURFACE_STRIDE], normal[3][SURFACE_STRIDE];
};

/* The memory of a worker for one tile. */
struct sp_surface_scratch {
    _Alignas(64) struct sp_surface_sheet_row sheets[2][SURFACE_SHEETS][SP_FRAGMENT_TILE];
    _Alignas(64) float hidden[SP_FRAGMENT_TILE][SURFACE_STRIDE]; /* what is behind is not seen */
    float ends[4][4]; /* by cells of the tile: the largest of `hidden` */
    unsigned changed; /* cells whose `hidden` is not up to date, bit 4·row + column */
    int used[2];      /* sheets that are not empty, by facing */
};

/* Prepares the surface for the tiles of the image. *surface is valid until the arena is reset.
 * SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sp_surface_prepare(const struct sp_surface_input *input, struct sp_surface *surface,
                        struct sp_error *err);

/* Adds the fragments of the surface in the tile at (tile->x, tile->y). */
typedef void sp_surface_tile_fn(const struct sp_surface *surface,
                                struct sp_surface_scratch *scratch, struct sp_fragment_tile *tile);
sp_surface_tile_fn sp_surface_tile;

#endif
