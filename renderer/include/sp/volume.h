/* SPDX-License-Identifier: Apache-2.0
 *
 * A volume: one grid of samples, loaded once, immutable and shared by reference count.
 *
 *   world = origin + direction · (spacing ∘ i)        i = (i0, i1, i2), i0 fastest in memory
 *
 * Along an axis of a rectilinear grid, coordinates[a][i] replaces spacing[a]·i.
 *
 * Files are read by the child process `splat-import`, which has limits on memory, time and file
 * access and passes the voxels on in shared memory. A reader that crashes is an error for the
 * caller, nothing more. Built-in volumes ("demo:NAME[?size=N]") are computed in this process.
 *
 * All functions are thread-safe; a `struct sp_volume` never changes once it is returned.
 */
#ifndef SP_VOLUME_H
#define SP_VOLUME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/api.h"
#include "sp/status.h"

#ifdef __cplusplus
extern "C" {
#endif

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

enum {
    SP_HISTOGRAM_BINS = 256,
    SP_UNIT_BYTES = 32,
    SP_FIELD_BYTES = 64,
    SP_NAME_BYTES = 128,
    SP_SOURCE_BYTES = 1024
};
/* Largest coordinate of a position that a client gives, world units: of cameras, slices, and
 * measurements. Beyond every volume, and its square is a float. */
#define SP_POSITION_MAX 1e18
#define SP_DIM_MAX 65536u                 /* voxels per axis */
#define SP_VOXELS_MAX (UINT64_C(1) << 36) /* voxels per volume */

struct sp_grid {
    uint32_t dims[3];       /* [1, SP_DIM_MAX] voxels; product at most SP_VOXELS_MAX */
    double spacing[3];      /* world units between neighbouring samples of an axis, > 0;
                               rectilinear: their mean */
    double origin[3];       /* world position of sample (0, 0, 0) */
    double direction[3][3]; /* direction[row][axis]: column `axis` is the unit vector along that
                               axis; not singular; identity if the file has none */
    /* NULL = evenly spaced (default). Otherwise dims[a] positions along the axis, relative to
     * sample 0 [world unit]: the first is 0, they rise, and the largest gap is at most 10^6 times
     * the smallest. Owned by the volume, for as long as it lives. */
    const double *coordinates[3];
};

struct sp_volume_info {
    struct sp_grid grid;
    enum sp_type type;
    uint32_t components; /* values per sample; always 1 */
    /* Names of the samples and of the vectors in the file; "" = unknown. Samples that are the
     * lengths of the vectors are called "magnitude". */
    char value_name[SP_FIELD_BYTES], vector_name[SP_FIELD_BYTES];
    double longest;           /* length of the longest finite vector, data unit; 0 = none has any */
    char unit[SP_UNIT_BYTES]; /* unit of world coordinates, "mm", …; "" = unknown */
    /* Where world +x, +y and +z point to in a patient: three of R L A P S I, as in "LPS" (left,
     * posterior, superior); "" = the file does not say. */
    char anatomy[4];
    char name[SP_NAME_BYTES];     /* file name without its extension, or the demo's name */
    char source[SP_SOURCE_BYTES]; /* what sp_volume_load() was called with */
    double range[2];              /* smallest and largest finite sample; {0, 0} if there is none */
    uint64_t nonfinite;           /* number of NaN and infinite samples; they are transparent */
    /* Counts of finite samples. Bin b covers range[0] + (range[1] − range[0])·[b, b + 1)/256; the
     * last bin includes range[1]. */
    uint64_t histogram[SP_HISTOGRAM_BINS];
    uint64_t voxel_bytes;  /* size of the sample array */
    uint64_t vector_bytes; /* of the vectors; 0 = none */
};

struct sp_volume; /* opaque, reference-counted */

/* Returns the size of one sample in bytes. */
SP_API size_t sp_type_size(enum sp_type type);
/* Returns the name that the protocol uses: "uint8", …, "float64". A constant string. */
SP_API const char *sp_type_name(enum sp_type type);

/* All zero = all defaults. Pointers are borrowed for the call of sp_volume_load(). */
struct sp_load_options {
    /* Called once, after the header was read and before `bytes` are allocated. Returns false and
     * fills *err to refuse (SP_ERR_BUDGET, with the bytes needed and the bytes available). NULL =
     * accept every size. */
    bool (*reserve)(void *user, uint64_t bytes, struct sp_error *err);
    /* Called a few times per second by the loading thread, with the finished fraction in [0, 1].
     * Returns false to cancel (SP_ERR_CANCELLED). NULL = none. */
    bool (*progress)(void *user, double fraction);
    void *user;           /* passed to both callbacks */
    const char *root;     /* files are read only below this folder, symbolic links resolved; NULL =
                             the folder of the file */
    const char *importer; /* path of the program splat-import; NULL = search beside the running
                             program, then beside the library, then the installation's prefix */
    int timeout_ms;       /* limit for the whole import, >= 0; 0 = 300,000 */
};

/* Loads `source`: the path of a file (NRRD .nrrd/.nhdr, VTK .vtk/.vti/.vtr, raw samples with a JSON
 * sidecar .json, TIFF stack .tif/.tiff) or "demo:NAME[?size=N]". Blocks until it is done. `options`
 * may be NULL. Returns one reference, or NULL with one of: SP_ERR_NOT_FOUND, SP_ERR_DENIED (outside
 * of root), SP_ERR_FORMAT, SP_ERR_UNSUPPORTED, SP_ERR_INVALID (demo size), SP_ERR_IO,
 * SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_TIMEOUT, SP_ERR_CRASHED, SP_ERR_CANCELLED. */
SP_API struct sp_volume *sp_volume_load(const char *source, const struct sp_load_options *options,
                                        struct sp_error *err);

/* Makes a volume of samples in memory. Copies the grid's coordinates and `voxels` (i0 fastest,
 * native byte order, product(dims) · sp_type_size(type) bytes) and computes range and histogram.
 * Returns one reference, or NULL: SP_ERR_INVALID (grid), SP_ERR_MEMORY. */
SP_API struct sp_volume *sp_volume_create(const struct sp_grid *grid, enum sp_type type,
                                          const void *voxels, const char *name,
                                          struct sp_error *err);

/* The same with vectors, of which product(dims) are copied. */
SP_API struct sp_volume *sp_volume_create_vectors(const struct sp_grid *grid, enum sp_type type,
                                                  const void *voxels, const float (*vectors)[3],
                                                  const char *name, struct sp_error *err);

/* Adds a reference and returns its argument. */
SP_API struct sp_volume *sp_volume_ref(struct sp_volume *volume);
/* Drops a reference and nulls *volume, which may be NULL. The last reference frees the volume. */
SP_API void sp_volume_unref(struct sp_volume **volume);

/* Valid as long as the caller's reference. */
SP_API const struct sp_volume_info *sp_volume_info(const struct sp_volume *volume);
/* The samples, 64-byte aligned; valid as long as the caller's reference. */
SP_API const void *sp_volume_voxels(const struct sp_volume *volume);
/* The vectors, one per sample in the same order, along the axes of the world [data unit]; NULL =
 * the volume has none. Components may be NaN or infinite. Valid as long as the caller's reference.
 */
SP_API const float (*sp_volume_vectors(const struct sp_volume *volume))[3];

/* A built-in volume. Strings are constants. */
struct sp_demo {
    const char *name;
    const char *doc;       /* a phrase for --help */
    uint32_t default_size; /* voxels along the longest axis */
};
/* Enumerates the built-in volumes: i from 0; NULL past the end. */
SP_API const struct sp_demo *sp_demo_at(size_t i);
/* Checks a "demo:…" source as sp_volume_load() would, without computing it. SP_ERR_NOT_FOUND
 * (name), SP_ERR_INVALID (size). */
SP_API bool sp_demo_check(const char *source, struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
