/* SPDX-License-Identifier: Apache-2.0
 *
 * Ambient occlusion and soft shadows from a coarse grid of extinction (README.md).
 *
 *   volume ─► extinction ─┬► sweeps along fixed directions ─► openness ──────┬─► field ─► integrate
 *             per cell    └► sweeps away from the light ────► transmittance ─┘   3 × 8 bits
 *
 * A cell holds side³ samples. One layer of empty cells surrounds the volume, so that light arrives
 * from outside. Cell (i, j, k) has its centre at cell coordinate (i, j, k):
 *
 *   cell coordinate = sample coordinate/side + first      first: sp_light_first()
 *
 * Sample coordinates count samples of the finest level; on a rectilinear axis they are distances
 * over the mean spacing. For a direction ω towards the light, with the optical depth τ counted from
 * half a step before the cell's centre, so that a surface does not shade itself:
 *
 *   transmittance  T(ω) = e^−τ(∞)
 *   occlusion      A(ω) = ∫ e^−s/R e^−τ(s) dτ(s)         (Zhukov, Iones, Kronin 1998, eq. 2)
 *   openness       1 + E − 2·mean of A over the sphere, in [0, 1];   E = ∫ e^−h/(R μ) dμ, [0, 1]
 *
 * E is 2·mean of A at the distance h from a plane at which rays read the field before surfaces.
 * Therefore a free point and a point in front of a plane are both fully open. R is the fading
 * distance: matter that is farther away occludes less.
 */
#ifndef SP_LIGHT_LIGHT_H
#define SP_LIGHT_LIGHT_H

#include "base/interrupt.h"
#include "base/parallel_for.h"
#include "base/vec.h"
#include "data/volume/slots.h"
#include "draw/light/kernels.h"
#include "sp/view.h"
#include "sp/volume.h"

enum {
    LIGHT_SLOTS = 6,
    LIGHT_AHEAD = 2, /* rays read the light at points this far in front of surfaces [samples] */
    LIGHT_CELLS_MAX = 9 << 18, /* limit of cells; larger volumes have more samples per cell */
    LIGHT_BEAMS = 4            /* directions within the light's disc */
};

/* The field of light that a frame reads. Borrowed from the cache. */
struct sp_light_field {
    /* Bytes, from the lowest: openness, transmittance, and the clearness e^−depth of the cell;
     * 255 = 1. */
    const uint32_t *cells;
    int dims[3];
    float per_sample, first; /* cell coordinate = sample coordinate · per_sample + first */
    /* World direction → cell coordinates, so that a unit vector moves by about one cell. */
    float offset[3][3];
    float occlusion, shadow; /* strengths, [0, 1] */
    bool is_made;            /* extinction or openness were missing and have been computed */
};

/* The light of one volume under one transfer function and clipping. */
struct sp_light_slot {
    struct sp_slot base;
    struct sp_transfer_function tf;
    struct sp_clip clip;
    uint32_t dims[3]; /* cells, with the empty layer */
    unsigned side;
    float *extinction; /* [cells]: optical depth per width of a cell */
    uint32_t *field;   /* [cells]: as sp_light_field.cells */
    /* World, towards the light whose transmittance the field has; zero = the field has no
     * transmittance. */
    double direction[3];
    bool has_openness;
};

/* Memory for the slices of a sweep. It grows when a sweep needs more. */
struct sp_light_scratch {
    float *floats;
    size_t count;
};

struct sp_light_cache {
    struct sp_light_slot slots[LIGHT_SLOTS];
    struct sp_light_scratch scratch;
    uint64_t clock;
};

struct sp_light_job {
    struct sp_volume *volume;
    const struct sp_view *view;
    const struct sp_clip *clip; /* of the volume that casts shadows; NULL = the view's clip */
    const float *direction;     /* unit, world, towards the first light; NULL = no light */
    uint64_t bytes_max;         /* of the cache */
    const struct sp_light_kernels *kernels; /* of an instruction set */
    struct sp_pool *pool;
    struct sp_interrupt interrupt;
};

/* True if the view asks for occlusion or a shadow that has an effect. */
bool sp_light_is_wanted(const struct sp_view *view);

/* Fills the field, which is valid until the next call. Bit-equal for any number of threads. One
 * thread per cache. SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
bool sp_light_get(struct sp_light_cache *cache, const struct sp_light_job *job,
                  struct sp_light_field *field, struct sp_error *err);

/* Evict the cached data of the volume, or return its bytes; NULL = of all volumes. */
void sp_light_evict(struct sp_light_cache *cache, const struct sp_volume *volume);
uint64_t sp_light_bytes(const struct sp_light_cache *cache, const struct sp_volume *volume);

/* Returns the width of a cell: the edge of a cube with the volume of the cell [world unit]. */
double sp_light_cell_width(const struct sp_light_slot *slot);

/* Returns the number of positions per cell and axis at which samples are read. */
static inline unsigned sp_light_per_cell(const struct sp_light_slot *slot) {
    return slot->side < LIGHT_PER_CELL_MAX ? slot->side : LIGHT_PER_CELL_MAX;
}

/* Returns the cell coordinate of sample 0. A third of the pairs of neighbours at a position lie
 * along an axis. Therefore the mean middle of all pairs lies a sixth of a position beyond the
 * position. */
static inline double sp_light_first(const struct sp_light_slot *slot) {
    double n = sp_light_per_cell(slot);
    return 1 - ((n - 1) / 2 + 1.0 / 6) / n;
}

/* extinction.c: fills slot->extinction, and slot->field with the clearness of the cells and full
 * light. SP_ERR_CANCELLED, SP_ERR_MEMORY. */
bool sp_extinction_compute(struct sp_light_slot *slot, const struct sp_light_job *job,
                           struct sp_error *err);

/* One sweep: light from a set of directions that cross the slices of one axis the same way. */
struct sp_sweep {
    int count;                                /* of directions, [1, LIGHT_DIRECTIONS] */
    struct sp_vec3 towards[LIGHT_DIRECTIONS]; /* world, unit, towards the light */
    double fading;   /* R, world units; INFINITY = occlusion does not fade */
    bool is_ambient; /* light fades and is added to the openness; false: sets the transmittance */
    float scale;     /* of the sum of 1 − A over the directions */
};

/* sweep.c: runs a sweep and writes the sums to slot->field (see sp_light_slice.field).
 * SP_ERR_CANCELLED, SP_ERR_MEMORY. */
bool sp_sweep_run(const struct sp_light_slot *slot, const struct sp_sweep *sweep,
                  const struct sp_light_job *job, struct sp_light_scratch *scratch,
                  struct sp_error *err);

/* Returns the axis whose slices a direction crosses most directly, measured in cells; *rises: true
 * if the direction leads to higher slices. The first direction of a sweep decides for all its
 * directions. */
int sp_sweep_axis(const struct sp_light_slot *slot, struct sp_vec3 towards, bool *rises);

#endif
