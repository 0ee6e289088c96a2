/* SPDX-License-Identifier: Apache-2.0
 *
 * The loops over voxels and pixels of a list, compiled once per instruction set (base/isa.h).
 *
 *   order ─► set_up ─► records ─► (tiles, draw.c) ─► add ─► resolve
 *                                                 └► merge ─► fragments
 */
#ifndef SP_SPLAT_LIST_KERNELS_H
#define SP_SPLAT_LIST_KERNELS_H

#include "base/isa.h"
#include "draw/layers/splat_list/list.h"
#include "frame/depth.h"
#include "frame/fragments.h"
#include "frame/resolve.h"
#include "sp/frame.h"
#include "splat/close.h"
#include "splat/ewa.h"

enum { SP_VOXEL_TILE = SP_FRAGMENT_TILE, SP_VOXEL_PIXELS = SP_FRAGMENT_PIXELS };

#define SP_STREAK_PERIOD 2.0f /* of the pattern, standard deviations along the vector */

/* Streaks of a layer of vectors (draw/layers/splat_list/streak.h). */
struct sp_streaks {
    float to_camera[3][3]; /* of a list: world → camera space, a rotation */
    float to_grid[3][3]; /* of a rectilinear list: directions → along its axes [mean spacings] */
    float widen;         /* stretch² − 1 */
    float length;        /* of a period of the pattern [standard deviations of the kernel] */
    float phase;         /* of the layer, [0, 1] */
    bool blends;         /* style blend: streaks of one colour */
    float color[3];
};

/* A fragment of another layer with at least this opacity is a wall: splats before it and splats
 * behind it do not become one fragment. */
#define SP_VOXEL_WALL 0.1f

/* The opacity of one trained Gaussian at a pixel: smaller ones are not drawn, larger ones are
 * limited (Kerbl et al. 2023). */
#define SP_TRAINED_OPACITY_MIN (1.0f / 255)
#define SP_TRAINED_OPACITY_MAX 0.99f

/* The constants of all splats of a layer in one frame. */
struct sp_voxel_frame {
    struct sp_ewa_frame ewa;
    enum sp_filter_mode mode;     /* EWA, or NONE for flat squares */
    const struct sp_shade *shade; /* NULL = not lit */
    bool is_rectilinear;
    bool linear;      /* attenuation */
    bool is_trained;  /* trained Gaussians: `depth` of a record is the opacity at its centre */
    bool has_streaks; /* of a layer of vectors */
    struct sp_streaks streaks;
    /* Rectilinear: by axis and index, distance from sample 0 and local spacing [mean spacings]. */
    const float *place[3], *size[3];
    float opaque; /* smallest optical depth of an opaque voxel over a cell; flat: per square */
    /* A splat joins the open fragment of a pixel if its u2 differs from the u2 of the fragment's
     * first splat by less than apart·(1 + n/2)/T [cells]. n fragments lie in front, and T is their
     * transmittance. So errors of depth have similar effects on all fragments, and few pixels need
     * more than 16. */
    float apart;
    /* [rows][columns]: true for tiles of the rows being drawn that are opaque already. NULL = no
     * tile is. */
    const bool *closed;
    int columns; /* of tiles */
};

/* One splat. Its weight on a pixel at (dx, dy) from the centre is 2^−p with
 * p = a·dx² + b·dx·dy + c·dy², and 0 where p exceeds the frame's cut or outside the box. Layers of
 * vectors: the place in the pattern is (a·dx + b·dy, c·dx + d·dy) standard deviations along and
 * across the vector, and p = ½·log2 e·|place|². */
struct sp_voxel_record {
    float x, y, a, b, c;    /* px */
    float depth;            /* optical depth at the centre */
    float color[3];         /* shaded, not premultiplied */
    float u2;               /* of the voxel [cells] */
    int16_t x0, y0, x1, y1; /* box in px, half open, inside the image, not empty */
    float area;             /* px */
    union {
        struct { /* vectors: */
            float d;
            float periods;           /* of the pattern per standard deviation along the vector */
            uint8_t contrast, shift; /* of the pattern [255ths]; of its rows [256ths of their
                                        distance] */
            uint16_t phase;          /* [65536ths of a period] */
        };
        struct sp_close close; /* other layers */
    };
};
_Static_assert(sizeof(struct sp_voxel_record) == 64, "one line of the cache");

/* A tile while it is composited. `cells` holds transmittance, red, green and blue of SP_WIDE pixels
 * each. */
struct sp_voxel_tile {
    _Alignas(64) float cells[SP_VOXEL_PIXELS * 4];
    uint64_t open[SP_VOXEL_PIXELS / 4 / 64]; /* bit n = cell n lets some light through */
    uint32_t open_count;                     /* number of open cells */
    int x, y;                                /* of its corner in the image */
    bool has_depth;
    /* If it has depth: in each cell two moments of SP_WIDE pixels (frame/depth.h). d: depth of the
     * splat less the depth of the tile's first splat, `origin` [world unit]; NaN = there is none.
     */
    _Alignas(64) float moments[SP_VOXEL_PIXELS * 2];
    float origin;
};

/* Sets up the splats of voxels[count] of the list `from` (struct sp_voxel_list), in order. Leaves
 * out splats that touch none of the rows being drawn, and splats that touch closed tiles only.
 * Returns the number of splats written. */
typedef uint32_t sp_voxel_set_up_fn(const struct sp_voxel_frame *frame, const void *from,
                                    const uint32_t *voxels, uint32_t count,
                                    struct sp_voxel_record *out);

struct sp_voxel_kernels {
    sp_voxel_set_up_fn *set_up;
    /* Empties the tile at (x, y); pixels outside the image count as opaque. */
    void (*start)(struct sp_voxel_tile *tile, int x, int y, const int size[2], bool has_depth);
    /* Composites records[entries[0 … count)], front to back. */
    void (*add)(struct sp_voxel_tile *tile, const struct sp_voxel_frame *frame,
                const struct sp_voxel_record *records, const uint32_t *entries, uint32_t count);
    /* Blends the tile over the background into the image. */
    void (*resolve)(const struct sp_voxel_tile *tile, const float background[4],
                    struct sp_frame *image);
    /* Like add(), but adds the splats to a tile of fragments. */
    void (*merge)(struct sp_fragment_tile *tile, const struct sp_voxel_frame *frame,
                  const struct sp_voxel_record *records, const uint32_t *entries, uint32_t count);
};

/* The functions of the instruction set that the including source is compiled for. */
uint32_t sp_voxel_set_up(const struct sp_voxel_frame *frame, const void *from,
                         const uint32_t *voxels, uint32_t count, struct sp_voxel_record *out);
void sp_voxel_start(struct sp_voxel_tile *tile, int x, int y, const int size[2], bool has_depth);
void sp_voxel_add(struct sp_voxel_tile *tile, const struct sp_voxel_frame *frame,
                  const struct sp_voxel_record *records, const uint32_t *entries, uint32_t count);
void sp_voxel_resolve(const struct sp_voxel_tile *tile, const float background[4],
                      struct sp_frame *image);
void sp_voxel_merge(struct sp_fragment_tile *tile, const struct sp_voxel_frame *frame,
                    const struct sp_voxel_record *records, const uint32_t *entries, uint32_t count);

#endif
