/* SPDX-License-Identifier: Apache-2.0
 *
 * A volume: one grid of samples, loaded once, immutable and shared by reference count. Instead of
 * samples it may have points, Gaussians or triangles (sp/elements.h).
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
#include "sp/elements.h"
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

/* What samples mean, beyond their numbers; it decides how the first view shows them. */
enum sp_meaning {
    SP_MEANING_UNKNOWN,   /* amounts of something, as in most files */
    SP_MEANING_LABELS,    /* numbers of categories, such as tissues; 0 = none of them */
    SP_MEANING_STATISTIC, /* of a test: 0 = no effect, both signs count alike */
    SP_MEANING_DISTANCE,  /* from a surface at 0, negative on one side: a level set */
    SP_MEANING_COUNT
};

enum {
    SP_HISTOGRAM_BINS = 256,
    SP_UNIT_BYTES = 32,
    SP_FIELD_BYTES = 64,
    SP_SERIES_BYTES = 68,
    SP_OTHER_FIELDS_MAX = 16,
    SP_OTHER_VECTORS_MAX = 8,
    SP_WARNINGS_MAX = 8,
    SP_WARNING_BYTES = 256,
    SP_NAME_BYTES = 128,
    SP_SOURCE_BYTES = 1024
};
/* Largest coordinate of a position that a client gives, world units: of cameras, slices, and
 * measurements. Beyond every volume, and its square is a float. */
#define SP_POSITION_MAX 1e18
#define SP_DIM_MAX 65536u                 /* voxels per axis */
#define SP_VOXELS_MAX (UINT64_C(1) << 36) /* voxels per volume */
#define SP_STEPS_MAX 65536u               /* steps of a time series */

struct sp_grid {
    uint32_t dims[3];       /* [1, SP_DIM_MAX] voxels; product at most SP_VOXELS_MAX */
    double spacing[3];      /* world units between neighbouring samples of an axis, > 0;
                               rectilinear: their mean; of a level of a brick file, or a part of it:
                               2^level times the mean of the finest level */
    double origin[3];       /* world position of sample (0, 0, 0) */
    double direction[3][3]; /* direction[row][axis]: column `axis` is the unit vector along that
                               axis; not singular; identity if the file has none */
    /* NULL = evenly spaced (default). Otherwise dims[a] positions along the axis, relative to
     * sample 0 [world unit]: the first is 0, they rise, and the largest gap is at most 10^6 times
     * the smallest. Owned by the volume, for as long as it lives. */
    const double *coordinates[3];
};

/* Between which numbers nearly all rays of a projection lie, as shares of the range of the data:
 * 0 = data[0], 1 = data[1]. The upper ends are 0 where it is not known. */
struct sp_projected {
    double maximum[2], mean[2];
    double sum; /* upper end of the sums above range[0], times length [world unit] */
};

/* The place of a volume in the time series of its source. */
struct sp_steps {
    uint32_t count;           /* [1, SP_STEPS_MAX]; 1 = no series */
    uint32_t index;           /* of this volume, from 0 */
    char unit[SP_UNIT_BYTES]; /* of times, "s", …; "" = unknown */
    /* `count` finite numbers [unit]; NULL = unknown. Owned by the volume, for as long as it lives.
     */
    const double *times;
};

/* The file's own numbers of an axis z that was scaled, because its unit, such as hPa, has no length
 * in the unit of x. */
struct sp_vertical {
    double per_unit; /* world z = per_unit · number of the file; < 0: the numbers fall as z
                        rises; 0 = z was not scaled */
    char unit[SP_UNIT_BYTES]; /* of the numbers; "" = unknown */
};

/* Where the samples of struct sp_volume lie in a level of a volume that is larger than memory. */
struct sp_whole_part {
    double step[3];    /* samples of the finest level per sample; 0 = it has all samples */
    uint32_t level;    /* 0 = the finest */
    uint32_t first[3]; /* sample of the level that is sample (0, 0, 0) */
    uint32_t dims[3];  /* of the level */
};

/* A volume that is larger than memory (sp/bricks.h), of which struct sp_volume has a coarse level.
 */
struct sp_whole {
    uint32_t dims[3];  /* of the finest level; 0 = struct sp_volume has all samples */
    double spacing[3]; /* of the finest level [world unit] */
    double origin[3];  /* of the finest level: position of its sample (0, 0, 0) [world unit] */
    double limits[2];  /* no finite sample of any level lies outside; the range of struct
                          sp_volume_info may be that of a coarse level. Of float chunks an estimate:
                          samples beyond a limit look like the limit */
    struct sp_whole_part part;
    uint32_t levels;  /* in the file */
    uint64_t content; /* a hash of all samples; of chunks, of the samples of struct sp_volume */
};

struct sp_volume_info {
    struct sp_grid grid;
    struct sp_whole whole;
    struct sp_steps steps;
    struct sp_elements_shape elements; /* kind SP_KIND_GRID: samples on the grid */
    uint64_t element_bytes;            /* of all elements, without vectors; 0 = none */
    double element_spacing; /* typical size of an element, world units; 0 = there is none */
    uint64_t folded; /* points of a curvilinear grid that are not drawn, because their cells are
                        flat or turned inside out; their values are NaN */
    enum sp_type type;
    enum sp_meaning meaning; /* as far as the file or its source says it */
    uint32_t components;     /* values per sample; always 1 */
    /* Names of the samples and of the vectors in the file; "" = unknown. Samples that are the
     * lengths of the vectors are called "magnitude". */
    char value_name[SP_FIELD_BYTES], vector_name[SP_FIELD_BYTES];
    char value_unit[SP_UNIT_BYTES]; /* unit of the samples and the vectors, "HU", …; "" = unknown */
    /* Names of other fields of the file, which "?field=NAME" loads in place of the samples, and of
     * other vectors, which "?vectors=NAME" loads in place of these; "" ends them. A file may have
     * more of them. */
    char others[SP_OTHER_FIELDS_MAX][SP_FIELD_BYTES];
    char other_vectors[SP_OTHER_VECTORS_MAX][SP_FIELD_BYTES];
    /* What differs from the file, because the reader left it out or changed it: sentences for the
     * user, UTF-8; "" ends them. */
    char warnings[SP_WARNINGS_MAX][SP_WARNING_BYTES];
    double longest;           /* length of the longest finite vector, data unit; 0 = none has any */
    char unit[SP_UNIT_BYTES]; /* unit of world coordinates, "mm", …; "" = unknown */
    struct sp_vertical vertical;
    /* Where world +x, +y and +z point to in a patient: three of R L A P S I, as in "LPS" (left,
     * posterior, superior); "" = the file does not say. */
    char anatomy[4];
    char name[SP_NAME_BYTES];     /* file name without its extension, or the demo's name */
    char source[SP_SOURCE_BYTES]; /* what sp_volume_load() was called with */
    double range[2];              /* smallest and largest finite sample, or value of a point; {0, 0}
                                     if there is none */
    double data[2];               /* the same without values that stand for missing data, such as
                                     −9999, of which a warning tells; range[] if there are none */
    uint64_t nonfinite;           /* number of NaN and infinite samples or values; they are
                                     transparent */
    /* Counts of samples in data[]. Bin b covers data[0] + (data[1] − data[0])·[b, b + 1)/256; the
     * last bin includes data[1]. */
    uint64_t histogram[SP_HISTOGRAM_BINS];
    struct sp_projected projected; /* of a grid */
    uint64_t voxel_bytes;          /* size of the sample array */
    uint64_t vector_bytes;         /* of the vectors; 0 = none */
};

struct sp_volume; /* opaque, reference-counted */

/* Returns the size of one sample in bytes. */
SP_API size_t sp_type_size(enum sp_type type);
/* Returns the name that the protocol uses: "uint8", …, "float64". A constant string. */
SP_API const char *sp_type_name(enum sp_type type);
/* Returns "" for SP_MEANING_UNKNOWN, "labels", "statistic" or "distance". A constant string. */
SP_API const char *sp_meaning_name(enum sp_meaning meaning);
/* True if slices show more of the volume than an image of all of it: it has a few thick slices. */
SP_API bool sp_volume_is_thick_stack(const struct sp_volume_info *info);

/* The source of a file is PATH, PATH?field=NAME, PATH?vectors=NAME or PATH?level=N, or has several
 * of them, joined by '&'; vectors and field are the last two: PATH?vectors=NAME&field=NAME. Before
 * them, "series=ID" chooses a DICOM series of a folder, "as=KIND" says what the extra axis or the
 * components of the file are, and "unit=UNIT" the unit of its spacing. HDF5 and NetCDF files also
 * have PATH:/NAME, with the extension before the colon. */
struct sp_source_parts {
    size_t path_bytes; /* length of PATH; of a built-in volume of the whole source */
    size_t file_bytes; /* length of everything before vectors and field */
    int level;         /* of detail, 0 = the finest; −1 = the reader chooses */
    const char *field; /* a part of the source; "" = the reader chooses */
    /* Values that are longer are cut; "" = the reader chooses. */
    char vectors[SP_FIELD_BYTES];
    char series[SP_SERIES_BYTES]; /* SeriesInstanceUID, number or description of a series */
    char as[16];                  /* "time", "vectors", "rgb", "channels", "labels" */
    char unit[SP_UNIT_BYTES];
};
SP_API struct sp_source_parts sp_source_split(const char *source);

struct sp_brick_memory;

/* All zero = all defaults. Pointers are borrowed for the call of sp_volume_load(). */
struct sp_load_options {
    /* Called after the header was read and before `bytes` are allocated. Returns false and fills
     * *err to refuse (SP_ERR_BUDGET, with the bytes needed and the bytes available). A file with
     * several levels of detail, of which the source names none, calls it again: with the bytes for
     * showing it from its chunks, then with those of coarser levels. NULL = accept every size. */
    bool (*reserve)(void *user, uint64_t bytes, struct sp_error *err);
    /* Called a few times per second by the loading thread, with the finished fraction in [0, 1].
     * Returns false to cancel (SP_ERR_CANCELLED). NULL = none. */
    bool (*progress)(void *user, double fraction);
    void *user;           /* passed to both callbacks */
    const char *root;     /* files are read only below this folder, symbolic links resolved; NULL =
                             the folder of the file */
    const char *importer; /* path of the program splat-import; NULL = search beside the running
                             program, then beside the library, then the installation's prefix */
    const char *allowed_hosts; /* of remote volumes: "HOST,HOST:PORT,*.DOMAIN". Without a port, 80
                                  and 443 are allowed. *.DOMAIN allows public IP addresses only,
                                  HOST any address. NULL = none */
    int timeout_ms;            /* limit for the whole import, >= 0; 0 = 300,000 */
    uint32_t step;             /* of a time series, from 0, if has_step is set */
    bool has_step;  /* false: the step of the file that the source names, or else the first */
    bool is_finest; /* do not read a coarser level if the finest does not fit (reserve()) */
    /* Of a brick file (sp/bricks.h) and of chunks: bytes of the samples that are kept in memory for
     * all frames; reserve() is asked for them at once, and for half of them if it refuses, and so
     * on. 0 = a quarter of the machine's memory; never more than four times the samples. */
    uint64_t window_bytes;
    /* Memory that brick files share (sp/bricks.h); borrowed. reserve() is then asked only for what
     * a file needs besides. NULL = the file has window_bytes of its own. */
    struct sp_brick_memory *windows;
};

/* True for the address of a remote volume, "http://…" or "https://…". */
SP_API bool sp_source_is_remote(const char *source);
#define SP_SOURCE_HOST_BYTES 264
/* Writes the entry of allowed_hosts that allows an address: "HOST" for the ports 80 and 443, so
 * that redirections from http to https are followed, or else "HOST:PORT". "" for other sources.
 * SP_ERR_INVALID. */
SP_API bool sp_source_host(const char *source, char host[SP_SOURCE_HOST_BYTES],
                           struct sp_error *err);
/* Checks a list of hosts, as in allowed_hosts: SP_ERR_INVALID. */
SP_API bool sp_hosts_check(const char *allowed, struct sp_error *err);
/* Checks that the host of an address is in the list (allowed_hosts): SP_ERR_DENIED,
 * SP_ERR_INVALID. */
SP_API bool sp_source_check_host(const char *source, const char *allowed, struct sp_error *err);

/* Loads `source`: the path of a file (NRRD .nrrd/.nhdr, VTK .vtk/.vti/.vtr/.vts/.vtu/.vtp, raw
 * samples with a JSON sidecar .json, NIfTI .nii/.nii.gz/.hdr, MetaImage .mhd/.mha, PVM .pvm, TIFF
 * stack .tif/.tiff, points, Gaussians or a mesh .ply,
 * Gaussians .spz, points .csv, PLOT3D .xyz/.p3d, meshes .stl/.obj/.gltf/.glb) or
 * "demo:NAME[?size=N]". Of a folder its first file is opened, in the order of numbers in names:
 * with it the DICOM series, the stack of images, or the time series of files whose names differ in
 * numbers only. "https://HOST/PATH" is an OME-Zarr that is shown from its chunks; it needs the
 * program splat-fetch. A path whose name has a '*' for each number opens such a time series, too.
 * Blocks until it is done. `options` may be NULL. Returns one reference, or NULL with one of:
 * SP_ERR_NOT_FOUND, SP_ERR_DENIED (outside of root, host not allowed), SP_ERR_FORMAT,
 * SP_ERR_UNSUPPORTED, SP_ERR_INVALID (demo size, address), SP_ERR_IO, SP_ERR_MEMORY,
 * SP_ERR_BUDGET, SP_ERR_TIMEOUT, SP_ERR_CRASHED, SP_ERR_CANCELLED. */
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

/* Bytes of the samples, vectors and elements. */
static inline uint64_t sp_volume_bytes(const struct sp_volume_info *info) {
    return info->voxel_bytes + info->vector_bytes + info->element_bytes;
}

/* Adds a reference and returns its argument. */
SP_API struct sp_volume *sp_volume_ref(struct sp_volume *volume);
/* Drops a reference and nulls *volume, which may be NULL. The last reference frees the volume. */
SP_API void sp_volume_unref(struct sp_volume **volume);

/* Valid as long as the caller's reference. */
SP_API const struct sp_volume_info *sp_volume_info(const struct sp_volume *volume);
/* The samples, 64-byte aligned; valid as long as the caller's reference. */
SP_API const void *sp_volume_voxels(const struct sp_volume *volume);
/* The vectors, one per sample or point in the same order, along the axes of the world [data unit];
 * NULL = the volume has none. Components may be NaN or infinite. Valid as long as the caller's
 * reference.
 */
SP_API const float (*sp_volume_vectors(const struct sp_volume *volume))[3];

/* The elements; NULL = the volume has a grid of samples. Valid as long as the caller's reference.
 */
SP_API const struct sp_elements *sp_volume_elements(const struct sp_volume *volume);

/* Makes a volume of elements in memory, whose arrays it copies. Returns one reference, or NULL:
 * SP_ERR_INVALID (shape, or a triangle whose vertex does not exist), SP_ERR_MEMORY. */
SP_API struct sp_volume *sp_volume_create_elements(const struct sp_elements *elements,
                                                   const char *name, struct sp_error *err);

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
