/* SPDX-License-Identifier: Apache-2.0
 *
 * A volume: one grid of samples, loaded once, immutable and shared by reference count.
 *
 *   world = origin + direction · (spacing ∘ i)        i = (i0, i1, i2), i0 fastest in memory
 *
 * Along an axis of a rectilinear grid the distances are given one by one: coordinates[a][i] takes
 * the place of spacing[a]·i.
 *
 * Files are read by the child process `splat-import`, which has limits on memory, time and files
 * and hands the voxels over in shared memory: a reader that crashes is an error here, nothing more.
 * Built-in volumes ("demo:NAME[?size=N]") are computed in process.
 * All functions are thread-safe; a `struct sp_volume` never changes once it is returned.
 */
#ifndef SP_VOLUME_H
#define SP_VOLUME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/status.h"

enum sp_type {
    SP_UINT8,
    SP_INT8,
    SP_UINT16,
    SP_INT16,
    SP_INT32,
    SP_FLOAT32,
    SP_FLOAT64,
    SP_TYPE_COUNT
};

enum { SP_HISTOGRAM_BINS = 256, SP_UNIT_BYTES = 32, SP_NAME_BYTES = 128 };
#define SP_DIM_MAX 65536u                 /* voxels an axis */
#define SP_VOXELS_MAX (UINT64_C(1) << 36) /* voxels a volume */

struct sp_grid {
    uint32_t dims[3];       /* [1, SP_DIM_MAX] voxels; product at most SP_VOXELS_MAX */
    double spacing[3];      /* > 0, world units between neighbouring samples of an axis;
                               rectilinear: their mean */
    double origin[3];       /* world position of sample (0,0,0) */
    double direction[3][3]; /* direction[row][axis]: column `axis` is the unit vector along that
                               axis; not singular; identity when the file says nothing */
    const double *coordinates[3]; /* NULL = evenly spaced. Else dims[a] rising distances along the
                                     axis from sample 0, the first of them 0, world units, the
                                     largest gap at most 10^6 times the smallest; a volume's belong
                                     to it and live as long as it does */
};

struct sp_volume_info {
    struct sp_grid grid;
    enum sp_type type;
    uint32_t components;      /* always 1 so far */
    char unit[SP_UNIT_BYTES]; /* of world coordinates: "mm", …; "" = not said */
    char name[SP_NAME_BYTES]; /* file name without extension, or the demo's name */
    char source[1024];        /* what it was loaded from */
    double range[2];          /* smallest and largest finite sample; {0,0} if there is none */
    uint64_t nonfinite;       /* samples that are NaN or infinite; they are transparent */
    uint64_t
        histogram[SP_HISTOGRAM_BINS]; /* finite samples; bin b covers range[0] +
                                         (range[1]-range[0])·[b, b+1)/256, the last bin closed */
    uint64_t voxel_bytes;             /* size of the sample array */
};

struct sp_volume; /* opaque, reference-counted */

/* Size of one sample in bytes, and the name used in the protocol ("uint8", …, "float64"). */
size_t sp_type_size(enum sp_type type);
const char *sp_type_name(enum sp_type type);

struct sp_load_options {
    /* Called once, after the header was read and before `bytes` are allocated. Returns false and
     * fills *err to refuse (SP_ERR_BUDGET with the bytes needed and the bytes free). NULL = accept.
     */
    bool (*reserve)(void *user, uint64_t bytes, struct sp_error *err);
    /* Called now and then from the loading thread with a fraction in [0,1]. Returns false to
     * cancel. NULL = none. */
    bool (*progress)(void *user, double fraction);
    void *user;
    const char *root;     /* files are read below this folder alone (symlinks resolved); NULL = the
                             file's own folder */
    const char *importer; /* path of splat-import; NULL = beside the running program */
    int timeout_ms;       /* > 0, for the whole import; 0 = 300,000 */
};

/* Loads `source`: a path (NRRD .nrrd/.nhdr, VTK .vtk/.vti/.vtr, raw with a JSON sidecar .json, TIFF
 * stack .tif/.tiff) or "demo:NAME[?size=N]". Blocks until done; returns one reference, or NULL with
 * *err set. `options` may be NULL. */
struct sp_volume *sp_volume_load(const char *source, const struct sp_load_options *options,
                                 struct sp_error *err);

/* Wraps samples made in memory (tests, procedural volumes). Copies the grid's coordinates and
 * `voxels` (i0 fastest, native byte order, product(dims)·size bytes), and computes range and
 * histogram. One reference, or NULL
 * with *err set. */
struct sp_volume *sp_volume_create(const struct sp_grid *grid, enum sp_type type,
                                   const void *voxels, const char *name, struct sp_error *err);

struct sp_volume *sp_volume_ref(struct sp_volume *volume); /* returns its argument */
void sp_volume_unref(
    struct sp_volume **volume); /* accepts NULL; nulls the pointer; the last one frees */

const struct sp_volume_info *
sp_volume_info(const struct sp_volume *volume); /* lives as long as the reference */
const void *
sp_volume_voxels(const struct sp_volume *volume); /* 64-byte aligned, as long as the reference */

/* One built-in volume a call, i from 0; NULL past the end. `doc` is a phrase for --help. */
struct sp_demo {
    const char *name, *doc;
    uint32_t default_size; /* voxels along the longest axis */
};
const struct sp_demo *sp_demo_at(size_t i);
/* Would sp_volume_load() know this "demo:…" source? SP_ERR_NOT_FOUND (name), SP_ERR_INVALID (size).
 */
bool sp_demo_check(const char *source, struct sp_error *err);

#endif
