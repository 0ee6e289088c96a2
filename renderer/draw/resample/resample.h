/* SPDX-License-Identifier: Apache-2.0
 *
 * Resampled sheets: sharp, post-classified images of dense volumes (README.md).
 *
 *   samples ──► refine ──► sample ──► integrate        one tile: the slices front to back
 *               2 × 2      a value    an interval of the ray between two slices
 *               per slice  per pixel  by the integral of the transfer function
 *
 * The ray of a pixel crosses slice z of the volume's major axis at
 *
 *   (u + s·du, v + s·dv)   with   s = ±(z − z_ref)   rising along the ray [slices]
 *
 * This is exact, also in perspective. All coordinates are in samples of the mip level that is
 * drawn; coordinates of a rectilinear axis are distances over the mean spacing.
 */
#ifndef SP_RESAMPLE_RESAMPLE_H
#define SP_RESAMPLE_RESAMPLE_H

#include "base/arena.h"
#include "base/interrupt.h"
#include "base/isa.h"
#include "base/parallel_for.h"
#include "draw/light/light.h"
#include "draw/resample/curve.h"
#include "draw/resample/levels.h"
#include "draw/resample/projection.h"
#include "draw/resample/ranges.h"
#include "frame/fragments.h"
#include "sp/frame.h"
#include "splat/shade.h"

enum {
    RESAMPLE_BLOCK = 8,      /* px: a tile is drawn in blocks of 8 × 8 pixels */
    RESAMPLE_PIXELS = 64,    /* of a block */
    RESAMPLE_QUADS = 16,     /* squares of 2 × 2 pixels of a block (quads.h) */
    RESAMPLE_ACROSS_MAX = 8, /* blocks of a tile per axis */
    RESAMPLE_BLOCKS = 64,    /* of a tile: the bits of a mask */
    RESAMPLE_TILE = 64,      /* px */
    RESAMPLE_BATCH = 4,      /* sheets that are drawn together */
    RESAMPLE_SHEETS = 7,     /* the sheets of a batch and the three before them, for gradients */
    RESAMPLE_SLACK = 64,     /* a sheet has memory for this many samples around the visible ones */
    RESAMPLE_TAPS = 6,       /* samples from which a sample between them is interpolated */
    RESAMPLE_SMOOTH = 4,     /* samples per axis from which a smooth gradient comes */
    /* Length of the gradient of the face of a cut (cut_face.h) [codes per sample]: four times the
     * range of codes, so that one slice behind it no edge is firmer. */
    RESAMPLE_FACE = 4 * (CURVE_CODE_MAX - CURVE_CODE_MIN),
    RESAMPLE_HALVES_MAX = 2 * 6 + 1 + SP_CLIP_PLANES_MAX,
    RESAMPLE_SIDES_MAX = 24 /* of a silhouette */
};

/* The half space normal·(sample coordinates) >= offset. */
struct sp_resample_half {
    double normal[3], offset;
    bool is_cut;   /* it cuts the volume, and is none of its own faces */
    bool is_joint; /* behind it, another image shows how the volume continues */
    float face[3]; /* a cut: the unit normal of its face (cut_face.h) */
};

/* The silhouette of the drawn part of the volume (silhouette.h). */
struct sp_silhouette {
    int count; /* of sides; 0 = no pixel is crossed by a side, or rays do not move */
    /* A pixel is (line[0]·x + line[1]·y + line[2]) px inside the side, where (x, y) is its centre
     * in px from the corner of the image. */
    double line[RESAMPLE_SIDES_MAX][3];
};

/* The positions of the samples of an axis. The coordinate of a sample is its distance along the
 * axis over the mean spacing of the level, so that rays are straight: sample i of an evenly spaced
 * axis is at i. */
struct sp_resample_axis {
    const float *place;           /* [dims]: coordinate of each sample; NULL = evenly spaced */
    const float *index;           /* [steps + 1]: sample index at evenly spaced coordinates */
    float first, steps_per_place; /* of that table */
    int steps;
    float narrowest, widest; /* distances between samples */
};

/* One frame, of one volume. All pointers are borrowed and valid until the frame is finished. */
struct sp_resample {
    struct sp_resample *next;        /* of the next channel; NULL = the last one */
    const struct sp_resample *first; /* of the first channel; NULL = this is the first one */
    double offset[3];                /* coordinates of the first channel's sample 0 */
    unsigned level;                  /* mip level of the samples */
    const struct sp_view *view;
    const struct sp_clip *whole; /* the clip without slices in the image; NULL = the view's clip */
    struct sp_frame *frame;
    struct sp_interrupt interrupt;
    const struct sp_camera_transform *camera;
    const struct sp_shade *shade;       /* NULL = not lit */
    const struct sp_light_field *light; /* NULL = no occlusion and no shadow */
    struct sp_fragments *fragments;     /* of other layers; NULL = none */
    float light_scale, light_first; /* cell coordinate = coordinate · light_scale + light_first */
    float light_firmness; /* gradients from 1/firmness on belong to surfaces [gradient_unit] */
    const struct sp_samples *samples;
    const struct sp_samples_class *class;
    struct sp_curve curve;
    struct sp_resample_axis axes[3];
    struct sp_reduction reduction;
    const float (*colors)[4]; /* of the projection, by number; NULL = the view is no projection */
    bool is_linear;           /* SP_ATTENUATION_LINEAR */
    bool is_fine;             /* sheets half a slice apart for all rays */
    float steep[2];      /* steepness: half sheets for some rays between these, for all rays above
                            (rays.h) */
    bool needs_gradient; /* lit, or the transfer function has a gradient axis */
    bool has_depth;      /* the frame has depth */
    bool has_quads;      /* a lit draft: light per 2 × 2 pixels (quads.h) */
    float dark;          /* rays end where transmittance falls below it */
    bool is_smoothed;    /* normals come from fine and smooth gradients (gradient.h) */
    float noise_square;  /* square of the difference that noise explains [gradient_unit²] */
    float keep_max;      /* largest part of a fine gradient's deviation that stays, [0, 1] */
    int axis;            /* of the slices; tiles of wide views may use another axis */
    double share[3];     /* of the image that slices along each axis have (axes.h) */
    int columns, rows;   /* of tiles */
    size_t refined_max;  /* refined samples that a sheet has memory for */
    double eye[3];       /* samples; perspective */
    double ray[3];       /* direction of the ray through the image's centre [samples] */
    double right[3], down[3]; /* change of `ray` per pixel; orthographic: of its start */
    double start[3];          /* orthographic: a point of the centre's ray [samples] */
    double metric[6];     /* of sample coordinates: xx, yy, zz, yz, xz, xy [reference length²] */
    float to_world[3][3]; /* gradient in codes per sample → gradient_unit, so that no product of
                             two overflows */
    float gradient_unit;  /* data unit per world unit */
    float rounding;       /* smaller gradients come from the rounding of samples [gradient_unit] */
    float lowest;         /* no value has a smaller code */
    uint32_t half_count;
    /* The volume, or the part of it that the clip box keeps; of a channel, both. Then the near
     * plane and the clip planes. */
    struct sp_resample_half halves[RESAMPLE_HALVES_MAX];
    struct sp_silhouette silhouette; /* of these; the same for all channels */
};

/* A block of pixels while its tile is drawn. */
struct sp_resample_block {
    _Alignas(64) float u[RESAMPLE_PIXELS], v[RESAMPLE_PIXELS]; /* at s = 0 [samples] */
    float du[RESAMPLE_PIXELS], dv[RESAMPLE_PIXELS];            /* per slice */
    float length[RESAMPLE_PIXELS]; /* of the ray per slice, reference lengths */
    float begin[RESAMPLE_PIXELS], end[RESAMPLE_PIXELS]; /* of the ray inside the halves [s] */
    float to_eye[3][RESAMPLE_PIXELS]; /* unit vector in world space; only if the volume is lit */
    float light[RESAMPLE_PIXELS];     /* transmittance so far */
    /* Premultiplied. A projection, until it is closed: color[0] is the number so far; color[1] is
     * the length of the ray that counts, if samples can be left out. */
    float color[3][RESAMPLE_PIXELS];
    /* Only if the frame has depth: moments of s − origin (depth.h); origin: NaN = none yet. */
    float moment[2][RESAMPLE_PIXELS], origin;
    _Alignas(64) float value[4][RESAMPLE_PIXELS]; /* on the last sheets that were read, by number
                                                     modulo 4 */
    int value_sheet[4];                           /* numbers of these sheets */
    /* Gradients on these sheets, along u and v. Maximum and minimum projections: the first one is
     * the largest sign·code of the refined samples around the value. */
    float slope[4][2][RESAMPLE_PIXELS];
    uint64_t has_slope[4];            /* bit per pixel */
    float normal[3][RESAMPLE_PIXELS]; /* gradient of the last surface on the ray */
    /* Lit: the cut by which the ray enters, by number in `halves`, and the opacity of a slice of
     * the material there (cut_face.h). */
    float face[RESAMPLE_PIXELS]; /* -1 = no cut */
    float face_opacity[RESAMPLE_PIXELS];
    bool has_faces; /* some rays enter by cuts */
    /* Only if light is per quad: the means of u, v, du, dv and to_eye over the pixels of quads. */
    _Alignas(64) float quad_ray[4][RESAMPLE_QUADS], quad_eye[3][RESAMPLE_QUADS];
    /* The curve's integral where the last interval ended, in an order that the kernel knows. */
    float entry[4][RESAMPLE_PIXELS];
    float entry_bin[RESAMPLE_PIXELS];
    int entry_sheet[RESAMPLE_PIXELS]; /* the sheet where it ended; by first pixel of a vector */
    float inside[2];                  /* s between which all rays are inside */
    int at[2];                        /* corner of the block in the tile [px] */
    bool is_crossed;                  /* a side of the silhouette crosses the block (cover.c) */
    float cover[RESAMPLE_PIXELS];     /* then: part of the pixel's area inside, [0, 1] */
    float moved[2][RESAMPLE_PIXELS];  /* then: to the right, down from the centre, ≤ 0.5 px */
    /* Fragments of other layers (insert.h), set only if the block has any: the remaining fragments,
     * and s, alpha and colour of the first one; s = infinity: none is left. */
    bool has_fragments;
    const struct sp_fragment *next[RESAMPLE_PIXELS];
    uint8_t left[RESAMPLE_PIXELS];
    _Alignas(64) float next_s[RESAMPLE_PIXELS], next_alpha[RESAMPLE_PIXELS];
    float next_color[3][RESAMPLE_PIXELS];
};

/* Bounds of the rays of a tile's blocks. */
struct sp_resample_bounds {
    _Alignas(64) float corner[4][4][RESAMPLE_BLOCKS]; /* [u, v, du, dv][corner] */
    float span[2][RESAMPLE_BLOCKS];                   /* s between which some ray is inside */
};

/* A slice with twice the samples per axis. */
struct sp_resample_sheet {
    int16_t *refined;
    int width;     /* samples per row */
    int origin[2]; /* slice sample at refined sample (0, 0) */
    /* coordinate on the sheet = 2·sample + shift, inside [first, last] */
    float shift[2], first[2], last[2];
    float s;     /* where it lies on the rays */
    float decay; /* of a surface's normal from this sheet to the next one */
    _Alignas(64) float range[2][RESAMPLE_BLOCKS]; /* of the codes that blocks see (near.c) */
};

/* Rows of a slice with twice the samples across, in codes that are raised for filtering. */
struct sp_resample_rows {
    uint16_t *doubled;
    uint64_t *filled; /* by row: the units of columns that it has, as bits */
    int slice;        /* INT_MIN = none */
    int width;        /* samples per row */
    int origin[2];    /* slice sample at the start */
};

/* The memory of a worker for one tile of a channel. */
struct sp_resample_scratch {
    struct sp_resample_scratch *next; /* of the next channel */
    struct sp_resample_block blocks[RESAMPLE_BLOCKS];
    struct sp_resample_bounds bounds;
    /* Transmittance, colour and moments of blocks that are drawn a second time. */
    _Alignas(64) float aside[RESAMPLE_BLOCKS][6][RESAMPLE_PIXELS];
    struct sp_resample_sheet sheets[RESAMPLE_SHEETS]; /* by number modulo RESAMPLE_SHEETS */
    struct sp_resample_rows rows[RESAMPLE_TAPS + 1];  /* by slice modulo RESAMPLE_TAPS; the last:
                                                         halfway between two slices */
    /* By row of the newest sheet (`seen`), and by row of the slices that are filtered for it
     * (`around`): the units of columns that blocks see. */
    uint64_t *seen, *around;
    uint64_t *active; /* by interval between slices: the blocks that may see a value in it */
    /* Maximum and minimum projections. most, open: by slab of regions, the largest number that each
     * block may see in the slab, and the blocks that the slab may change. least: by block, the
     * smallest number of its pixels. */
    float (*most)[RESAMPLE_BLOCKS];
    uint64_t *open;
    _Alignas(64) float least[RESAMPLE_BLOCKS];
    bool is_too_wide;          /* a block sees more of a sheet than there is memory for */
    uint64_t refined, sampled; /* slice samples; pixels of sheets */
};

/* Draws one tile into the frame. */
typedef void sp_resample_tile_fn(const struct sp_resample *resample,
                                 struct sp_resample_scratch *scratch, uint32_t tile);
sp_resample_tile_fn sp_resample_tile;

/* The inputs of a frame. */
struct sp_resample_input {
    /* The input of the next channel; NULL = this is the last one. Only view and volume differ. All
     * channels have the same distance of samples, but their volumes may cover different parts of
     * space. The clip box, background and fragments of the first channel hold for all. */
    const struct sp_resample_input *next;
    const struct sp_view *view;
    const struct sp_clip *whole; /* the view draws a part of this clip (draw/slices/); NULL = not */
    struct sp_volume *volume;
    struct sp_frame *frame;
    struct sp_interrupt interrupt;
    const struct sp_camera_transform *camera;
    const struct sp_shade *shade;         /* NULL = not lit */
    const struct sp_light_field *light;   /* NULL = no occlusion and no shadow */
    struct sp_fragments *fragments;       /* of other layers; NULL = none */
    struct sp_samples_cache *cache;       /* mip levels and ranges */
    uint64_t bytes_max;                   /* of the cache */
    unsigned mip_level;                   /* no finer level is drawn */
    bool is_draft;                        /* sp_render_options.draft */
    sp_resample_tile_fn *draw_tile;       /* sp_resample_tile() of an instruction set */
    sp_ranges_compute_fn *compute_ranges; /* sp_ranges_compute() of that set */
    bool keeps_layout; /* the cache makes no turned copy of the samples for faster reading */
    struct sp_pool *pool;
    struct sp_arena *arena;
};

/* True if this stage draws the view: sheets that are classified after interpolation, and slabs if
 * all fields of the filter have their defaults. */
bool sp_resample_draws(const struct sp_view *view);

/* Returns the finest mip level whose samples are wide enough in the image; 0 = the volume's own
 * samples. */
unsigned sp_resample_level(const struct sp_grid *grid, const struct sp_camera_transform *camera);

/* Returns the strength of the low-pass filter of the pixels (frame/antialias.h): 1 where samples
 * are narrower than 1.8 px in the middle of the volume, 0 where they are wider than 2.3 px: there a
 * pixel shows exactly what the ray through its centre meets, as images are compared. 0 also for
 * projections, whose pixels are values, for other drawing, and if quality.level_of_detail is off.
 * mip_level: no finer level is drawn. */
float sp_resample_antialiasing(const struct sp_view *view, const struct sp_grid *grid,
                               unsigned mip_level);

/* Draws every pixel and fills the stats. SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
bool sp_resample_draw(const struct sp_resample_input *input, struct sp_error *err);

#endif
