/* SPDX-License-Identifier: Apache-2.0
 *
 * Ambient occlusion and soft shadows from a coarse grid of extinction (README.md).
 *
 *   volume ─► extinction ─┬► sweeps along fixed directions ─► moments of A ──┬─► field ─► integrate
 *             per cell    └► sweeps away from the light ────► transmittance ─┘   11 × 8 bits
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
 *
 * R is the fading distance: matter that is farther away occludes less. A cell keeps the moments of
 * A over the sphere up to the second one,
 *
 *   Ā = mean of A     D = mean of A ω     Q = mean of A (ω ωᵀ − 1/3)
 *
 * which give the occlusion of the cosine hemisphere around a normal n,
 *
 *   4·mean of A max(0, n·ω)  ≈  Ā + 2 n·D + 15/8 nᵀ Q n
 *
 * because a cosine hemisphere is 1 + 2 cos + 5/4 P₂(cos) and higher terms that are small
 * (Ramamoorthi, Hanrahan 2001, eq. 8). A closed half space behind the normal gives 1/2 − 1/2 + 0,
 * so that a plane does not occlude itself. Where there is no normal, the occlusion is Ā − 2|D|.
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
    /* Bytes, from the lowest: 1 − Ā, transmittance, and the clearness e^−depth of the cell;
     * 255 = 1. */
    const uint32_t *cells;
    /* Bytes, from the lowest: D along x, y and z, and Q xx; Q yy, xy, xz and yz. In units of
     * 1/LIGHT_DIPOLE and 1/LIGHT_QUADRUPOLE, 128 = 0. Valid if occlusion > 0. */
    const uint32_t (*moments)[2];
    int dims[3];
    float per_sample, first; /* cell coordinate = sample coordinate · per_sample + first */
    /* World direction → cell coordinates, so that a unit vector moves by about one cell. */
    float offset[3][3];
    float occlusion, shadow; /* strengths, [0, 1] */
    bool is_made;            /* extinction or moments were missing and have been computed */
};

/* The light of one volume under one transfer function and clipping. */
struct sp_light_slot {
    struct sp_slot base;
    struct sp_transfer_function tf;
    struct sp_clip clip;
    uint32_t dims[3]; /* cells, with the empty layer */
    unsigned side;
    float *extinction;      /* [cells]: optical depth per width of a cell */
    uint32_t *field;        /* [cells]: sp_light_field.cells */
    uint32_t (*moments)[2]; /* [cells]: sp_light_field.moments */
    /* World, towards the light whose transmittance the field has; zero = the field has no
     * transmittance. */
    double direction[3];
    double reach; /* whose moments the field has; 0 = the field has none */
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

/* Returns the cells of a slot, with the empty layer. */
static inline size_t sp_light_cell_count(const struct sp_light_slot *slot) {
    return (size_t)slot->dims[0] * slot->dims[1] * slot->dims[2];
}

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
    bool is_ambient; /* light fades and adds to the moments; false: sets the transmittance */
    float moment[LIGHT_DIRECTIONS][LIGHT_MOMENTS]; /* as sp_light_slice.moment */
};

/* sweep.c: runs a sweep and writes the sums to slot->field and slot->moments.
 * SP_ERR_CANCELLED, SP_ERR_MEMORY. */
bool sp_sweep_run(const struct sp_light_slot *slot, const struct sp_sweep *sweep,
                  const struct sp_light_job *job, struct sp_light_scratch *scratch,
                  struct sp_error *err);

/* Returns the axis whose slices a direction crosses most directly, measured in cells; *rises: true
 * if the direction leads to higher slices. The first direction of a sweep decides for all its
 * directions. */
int sp_sweep_axis(const struct sp_light_slot *slot, struct sp_vec3 towards, bool *rises);

#endif
