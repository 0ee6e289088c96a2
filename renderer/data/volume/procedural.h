/* SPDX-License-Identifier: Apache-2.0
 *
 * The built-in volumes. Each is a pure function of the size: the same bytes for any number of
 * threads. Boundaries between materials are anti-aliased over two voxels.
 */
#ifndef SP_VOLUME_PROCEDURAL_H
#define SP_VOLUME_PROCEDURAL_H

#include "data/volume/volume.h"

enum { SP_DEMO_SIZE_MIN = 8, SP_DEMO_SIZE_MAX = 1024 }; /* voxels along the longest axis */

/* True if `source` starts with "demo:". */
bool sp_source_is_demo(const char *source);

/* Creates the volume "demo:NAME[?size=N]". Uses options->reserve, progress and user; `options` may
 * be NULL. SP_ERR_NOT_FOUND (unknown name; the text lists the names), SP_ERR_INVALID (the rest of
 * the source), SP_ERR_MEMORY, SP_ERR_CANCELLED, or the error of reserve(). */
struct sp_volume *sp_demo_load(const char *source, const struct sp_load_options *options,
                               struct sp_error *err);

/* Writes the samples of a built-in volume to a file, a few slices at a time, so that they need no
 * memory, and its vectors as sp_volume_layout() says; the size may be up to SP_DEMO_STREAM_MAX.
 * Fills *info without range and histogram; the caller frees *numbers, the coordinates. Without
 * keeps_axes, rectilinear axes are refused. SP_ERR_UNSUPPORTED: it is no grid, or its axes are
 * refused; SP_ERR_IO. Otherwise as sp_demo_load(), without reserve(). */
enum { SP_DEMO_STREAM_MAX = 4096 };
bool sp_demo_stream(const char *source, const struct sp_load_options *options, int fd,
                    bool keeps_axes, struct sp_volume_info *info, double **numbers,
                    struct sp_error *err);

/* Writes slices [begin, end) of the volume. `voxels` is the start of the whole array. `prepared` is
 * the result of the demo's prepare(). */
typedef void sp_demo_fill(const void *prepared, const uint32_t dims[3], size_t begin, size_t end,
                          void *voxels);

/* Writes the vectors of slices [begin, end). `vectors` is the start of the whole array. */
typedef void sp_demo_flow(const uint32_t dims[3], size_t begin, size_t end, float (*vectors)[3]);

struct sp_demo_maker {
    struct sp_demo demo;
    enum sp_type type;
    void (*shape)(uint32_t size, uint32_t dims[3]); /* NULL = a cube */
    double (*grade)(uint32_t n, uint32_t i);        /* distance of sample i of n from sample 0 along
                                                       each axis, n − 1 the last; NULL = i */
    void *(*prepare)(const uint32_t dims[3]); /* malloc'ed table shared by all slices, NULL when out
                                                 of memory; the slot is NULL when there is none */
    sp_demo_fill *fill; /* NULL = the samples are the lengths of the vectors */
    sp_demo_flow *flow; /* NULL = no vectors */
    /* Elements instead of samples; everything above but `demo` is NULL. The size has no unit. */
    void (*count)(uint32_t size, struct sp_elements_shape *shape);
    void (*place)(uint32_t size, const struct sp_elements *elements, size_t begin, size_t end);
    void (*finish)(uint32_t size, const struct sp_elements *elements); /* of all; may be NULL */
};

/* procedural_formulas.c: phantom, marschner-lobb, checkerboard, hydrogen */
extern const struct sp_demo_maker sp_demo_phantom, sp_demo_marschner_lobb, sp_demo_checkerboard,
    sp_demo_hydrogen;
/* procedural_engine.c, procedural_vessels.c, procedural_galaxy.c and procedural_sparse.c */
extern const struct sp_demo_maker sp_demo_engine, sp_demo_vessels, sp_demo_galaxy, sp_demo_sparse;
/* procedural_dense.c */
extern const struct sp_demo_maker sp_demo_turbulence, sp_demo_noise;
/* procedural_winds.c */
extern const struct sp_demo_maker sp_demo_tornado, sp_demo_jet;
/* procedural_elements.c */
extern const struct sp_demo_maker sp_demo_polar, sp_demo_points, sp_demo_gaussians, sp_demo_torus;

/* Returns the fraction of a sample's cell that is inside, for a sample that lies `distance` voxels
 * outside a surface (negative = inside): a smooth step over two voxels, as a scanner blurs it, so
 * that gradients are smooth as well. */
static inline float sp_demo_coverage(float distance) {
    float t = 0.5f - 0.5f * distance;
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    return t * t * (3 - 2 * t);
}

#endif
