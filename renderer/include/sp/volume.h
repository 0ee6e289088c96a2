/* SPDX-License-Identifier: Apache-2.0
 *
 * A volume: one grid of samples, loaded once, immutable and shared by reference count. Instead of
 * samples, a volume may have points, Gaussians or triangles (sp/elements.h).
 *
 *   world = origin + direction · (spacing ∘ i)        i = (i0, i1, i2), i0 fastest in memory
 *
 * Along an axis of a rectilinear grid, coordinates[a][i] replaces spacing[a]·i.
 *
 * Files are read by the child process `splat-import`, which has limits on memory, time and file
 * access and passes the voxels on in shared memory. If a reader crashes, the caller gets an error,
 * and its process continues. Built-in volumes ("demo:NAME[?size=N]") are computed in this process.
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

/* The meaning of the samples. The default view depends on it. */
enum sp_meaning {
    SP_MEANING_UNKNOWN,   /* plain quantities, as in most files */
    SP_MEANING_LABELS,    /* numbers of categories, such as tissues; 0 = no category */
    SP_MEANING_STATISTIC, /* results of a statistical test: 0 = no effect, both signs matter */
    SP_MEANING_DISTANCE,  /* signed distances from a surface at 0: a level set */
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
/* Largest coordinate of a position in a view or a measurement, world units. The limit is beyond
 * every volume, and its square fits a float. */
#define SP_POSITION_MAX 1e18
#define SP_DIM_MAX 65536u                 /* voxels per axis */
#define SP_VOXELS_MAX (UINT64_C(1) << 36) /* voxels per volume */
#define SP_STEPS_MAX 65536u               /* steps of a time series */

struct sp_grid {
    uint32_t dims[3];       /* [1, SP_DIM_MAX] voxels; product at most SP_VOXELS_MAX */
    double spacing[3];      /* world units between neighbouring samples of an axis, > 0. Rectilinear
                               axis: the mean of the gaps. Level of a brick file, or a part of it:
                               2^level times the mean of the finest level */
    double origin[3];       /* world position of sample (0, 0, 0) */
    double direction[3][3]; /* direction[row][axis]: column `axis` is the unit vector along that
                               axis; not singular; identity if the file gives no directions */
    /* NULL = evenly spaced (default). Otherwise dims[a] positions along the axis, relative to
     * sample 0 [world unit]: they start at 0 and rise strictly, and the largest gap is at most 10^6
     * times the smallest. Owned by the volume; valid as long as the volume. */
    const double *coordinates[3];
};

/* Ranges that contain the results of nearly all rays of a projection, as fractions of the data
 * range: 0 = data[0], 1 = data[1]. An upper end of 0 means that the range is not known. */
struct sp_projected {
    double maximum[2], mean[2];
    double sum; /* upper end of the sums of the values above range[0] along a ray, times length
                   [world unit] */
};

/* The place of a volume in the time series of its source. */
struct sp_steps {
    uint32_t count;           /* [1, SP_STEPS_MAX]; 1 = no series */
    uint32_t index;           /* step of this volume, from 0 */
    char unit[SP_UNIT_BYTES]; /* unit of the times, "s", …; "" = unknown */
    /* `count` finite numbers [unit]; NULL = unknown. Owned by the volume; valid as long as the
     * volume. */
    const double *times;
};

/* The original coordinates of the z axis, if the reader scaled it because its unit, such as hPa,
 * cannot be converted to the unit of x. */
struct sp_vertical {
    double per_unit; /* world z = per_unit · coordinate in the file; < 0: the coordinates fall as z
                        rises; 0 = z was not scaled */
    char unit[SP_UNIT_BYTES]; /* unit of the coordinates in the file; "" = unknown */
};

/* Where the samples of struct sp_volume lie in a level of a volume that is larger than memory. */
struct sp_whole_part {
    double step[3];    /* samples of the finest level per sample; 0 = the volume has all samples */
    uint32_t level;    /* 0 = the finest */
    uint32_t first[3]; /* index, in the level, of sample (0, 0, 0) of the volume */
    uint32_t dims[3];  /* size of the level, samples */
};

/* A volume that is larger than memory (sp/bricks.h). struct sp_volume holds only a coarse level of
 * it. */
struct sp_whole {
    uint32_t dims[3];  /* size of the finest level, samples; 0 = struct sp_volume has all samples */
    double spacing[3]; /* of the finest level [world unit] */
    double origin[3];  /* of the finest level: position of its sample (0, 0, 0) [world unit] */
    double limits[2];  /* range that contains the finite samples of all levels; sp_volume_info.range
                          may cover only a coarse level. For chunks of float it is an estimate: a
                          sample beyond a limit looks like the limit */
    struct sp_whole_part part;
    uint32_t levels;  /* number of levels in the file */
    uint64_t content; /* hash of all samples; for chunks, hash of the samples of struct sp_volume */
};

struct sp_volume_info {
    struct sp_grid grid;
    struct sp_whole whole;
    struct sp_steps steps;
    struct sp_elements_shape elements; /* kind SP_KIND_GRID: samples on the grid */
    uint64_t element_bytes;            /* bytes of all elements, without vectors; 0 = none */
    double element_spacing; /* typical size of an element, world units; 0 = no elements */
    uint64_t folded; /* points of a curvilinear grid that are not drawn, because their cells are
                        flat or inside out; their values are NaN */
    enum sp_type type;
    enum sp_meaning meaning; /* as far as the file or the source states it */
    uint32_t components;     /* values per sample; always 1 */
    /* Names of the samples and of the vectors in the file; "" = unknown. If the samples are the
     * lengths of the vectors, the name is "magnitude". */
    char value_name[SP_FIELD_BYTES], vector_name[SP_FIELD_BYTES];
    char value_unit[SP_UNIT_BYTES]; /* unit of the samples and the vectors, "HU", …; "" = unknown */
    /* Names of other fields of the file, which "?field=NAME" loads instead of the samples, and of
     * other vectors, which "?vectors=NAME" loads instead of these vectors. "" ends each list. A
     * file may have more names than a list can hold. */
    char others[SP_OTHER_FIELDS_MAX][SP_FIELD_BYTES];
    char other_vectors[SP_OTHER_VECTORS_MAX][SP_FIELD_BYTES];
    /* Differences from the file, because the reader left data out or changed it: sentences for the
     * user, UTF-8. "" ends the list. */
    char warnings[SP_WARNINGS_MAX][SP_WARNING_BYTES];
    double longest; /* length of the longest finite vector [data unit]; 0 = all vectors are 0, or
                       there are none */
    char unit[SP_UNIT_BYTES]; /* unit of world coordinates, "mm", …; "" = unknown */
    struct sp_vertical vertical;
    /* The directions in a patient to which world +x, +y and +z point: three of R L A P S I, as in
     * "LPS" (left, posterior, superior); "" = the file does not state them. */
    char anatomy[4];
    char name[SP_NAME_BYTES];     /* file name without its extension, or the demo's name */
    char source[SP_SOURCE_BYTES]; /* the source given to sp_volume_load() */
    double range[2]; /* smallest and largest finite sample or value of a point; {0, 0} if there is
                        no finite one */
    double data[2];  /* range[] without the values that stand for missing data, such as −9999; a
                        warning names such values. Equal to range[] if there are none */
    uint64_t nonfinite; /* number of NaN and infinite samples or values; they are
                           transparent */
    /* Standard deviation of the noise of the samples, estimated at surfaces [data unit]; 0 = none,
     * or no surfaces: labels, equal samples, fewer than 7 samples along an axis; NaN = unknown: the
     * samples are not all in memory. */
    double noise;
    /* Counts of samples in data[]. Bin b covers data[0] + (data[1] − data[0])·[b, b + 1)/256; the
     * last bin includes data[1]. */
    uint64_t histogram[SP_HISTOGRAM_BINS];
    struct sp_projected projected; /* only for a grid */
    uint64_t voxel_bytes;          /* size of the sample array, bytes */
    uint64_t vector_bytes;         /* size of the vectors, bytes; 0 = none */
};

struct sp_volume; /* opaque, reference-counted */

/* Returns the size of one sample in bytes. */
SP_API size_t sp_type_size(enum sp_type type);
/* Returns the name that the protocol uses: "uint8", …, "float64". A constant string. */
SP_API const char *sp_type_name(enum sp_type type);
/* Returns "" for SP_MEANING_UNKNOWN, "labels", "statistic" or "distance". A constant string. */
SP_API const char *sp_meaning_name(enum sp_meaning meaning);
/* True if the volume has few, thick slices, so that slices show more than a 3D image. */
SP_API bool sp_volume_is_thick_stack(const struct sp_volume_info *info);

/* The parts of the source of a file. A source is PATH, or PATH?KEY=VALUE with further KEY=VALUE
 * joined by '&'. The keys: "level=N" chooses a level of detail; "series=ID" chooses a DICOM series
 * of a folder; "as=KIND" gives the meaning of the extra axis or the components of the file;
 * "unit=UNIT" gives the unit of its spacing; "vectors=NAME" and "field=NAME" choose arrays and come
 * last, in this order. HDF5 and NetCDF files may also be written as PATH:/NAME, with the extension
 * before the colon. */
struct sp_source_parts {
    size_t path_bytes; /* length of PATH; built-in volume: length of the whole source */
    size_t file_bytes; /* length of everything before vectors and field */
    int level;         /* level of detail, 0 = the finest; −1 = the reader chooses */
    const char *field; /* points into the source; "" = the reader chooses */
    /* Longer values are cut; "" = the reader chooses. */
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
     * *err to refuse (SP_ERR_BUDGET, with the bytes needed and the bytes available). It is called
     * again for a file with several levels of detail if the source names no level: first with the
     * bytes for showing the file from its chunks, then with the bytes of coarser levels. NULL =
     * accept every size. */
    bool (*reserve)(void *user, uint64_t bytes, struct sp_error *err);
    /* Called a few times per second by the loading thread, with the finished fraction in [0, 1].
     * Returns false to cancel (SP_ERR_CANCELLED). NULL = none. */
    bool (*progress)(void *user, double fraction);
    void *user;       /* passed to both callbacks */
    const char *root; /* files are read only below this folder, after symbolic links are resolved;
                         NULL = the folder of the file */
    const char
        *importer; /* path of the program splat-import; NULL = search beside the running program,
                      then beside the library, then in the prefix of the installation */
    const char *allowed_hosts; /* hosts of remote volumes: "HOST,HOST:PORT,*.DOMAIN". Without a
                                  port, ports 80 and 443 are allowed. *.DOMAIN allows only public IP
                                  addresses, HOST allows any address. NULL = none */
    int timeout_ms;            /* limit for the whole import, >= 0; 0 = 300,000 */
    uint32_t step;             /* step of a time series, from 0; used only if has_step is set */
    bool has_step;  /* false: the step of the file that the source names, or else the first step */
    bool is_finest; /* true = fail if reserve() refuses the finest level; false = read a coarser
                       level then */
    /* For a brick file (sp/bricks.h) and for chunks: bytes of samples that are kept in memory for
     * all frames. reserve() is called with this number, and with half of it after each refusal. 0 =
     * a quarter of the machine's memory. The number is never more than four times the size of the
     * samples. */
    uint64_t subvolume_bytes;
    /* Memory that several brick files share (sp/bricks.h); borrowed. reserve() is then called only
     * for the other memory of a file. NULL = the file has subvolume_bytes of its own. */
    struct sp_brick_memory *subvolumes;
};

/* True for the address of a remote volume, "http://…" or "https://…". */
SP_API bool sp_source_is_remote(const char *source);
#define SP_SOURCE_HOST_BYTES 264
/* Writes the entry of allowed_hosts that allows the host of a source: "HOST" for the ports 80 and
 * 443, so that redirections from http to https are followed, otherwise "HOST:PORT". Writes "" for a
 * source that is not remote. SP_ERR_INVALID. */
SP_API bool sp_source_host(const char *source, char host[SP_SOURCE_HOST_BYTES],
                           struct sp_error *err);
/* Checks a list of hosts, as in allowed_hosts: SP_ERR_INVALID. */
SP_API bool sp_hosts_check(const char *allowed, struct sp_error *err);
/* Checks that the host of an address is in the list (allowed_hosts): SP_ERR_DENIED,
 * SP_ERR_INVALID. */
SP_API bool sp_source_check_host(const char *source, const char *allowed, struct sp_error *err);

/* Loads `source`: the path of a file (NRRD .nrrd/.nhdr, VTK .vtk/.vti/.vtr/.vts/.vtu/.vtp, raw
 * samples with a JSON sidecar .json, NIfTI .nii/.nii.gz/.hdr, MetaImage .mhd/.mha, PVM .pvm, TIFF
 * stack .tif/.tiff, points, Gaussians or a mesh .ply, Gaussians .spz, points .csv, PLOT3D
 * .xyz/.p3d, meshes .stl/.obj/.gltf/.glb) or "demo:NAME[?size=N]". If `source` is a folder, its
 * first file is opened, in the order of the numbers in file names, together with the files that
 * belong to it: a DICOM series, a stack of images, or a time series of files whose names differ
 * only in numbers. A path with '*' in place of each number opens such a time series as well.
 * "https://HOST/PATH" is an OME-Zarr that is shown from its chunks; it needs the program
 * splat-fetch. Blocks until the volume is loaded. `options` may be NULL. Returns one reference, or
 * NULL with one of: SP_ERR_NOT_FOUND, SP_ERR_DENIED (outside of root, host not allowed),
 * SP_ERR_FORMAT, SP_ERR_UNSUPPORTED, SP_ERR_INVALID (demo size, address), SP_ERR_IO, SP_ERR_MEMORY,
 * SP_ERR_BUDGET, SP_ERR_TIMEOUT, SP_ERR_CRASHED, SP_ERR_CANCELLED. */
SP_API struct sp_volume *sp_volume_load(const char *source, const struct sp_load_options *options,
                                        struct sp_error *err);

/* Makes a volume from samples in memory. Copies the grid's coordinates and `voxels` (i0 fastest,
 * native byte order, product(dims) · sp_type_size(type) bytes) and computes range and histogram.
 * Returns one reference, or NULL: SP_ERR_INVALID (grid), SP_ERR_MEMORY. */
SP_API struct sp_volume *sp_volume_create(const struct sp_grid *grid, enum sp_type type,
                                          const void *voxels, const char *name,
                                          struct sp_error *err);

/* Like sp_volume_create(), and also copies product(dims) vectors. */
SP_API struct sp_volume *sp_volume_create_vectors(const struct sp_grid *grid, enum sp_type type,
                                                  const void *voxels, const float (*vectors)[3],
                                                  const char *name, struct sp_error *err);

/* Returns the bytes of the samples, vectors and elements. */
static inline uint64_t sp_volume_bytes(const struct sp_volume_info *info) {
    return info->voxel_bytes + info->vector_bytes + info->element_bytes;
}

/* Adds a reference and returns its argument. */
SP_API struct sp_volume *sp_volume_ref(struct sp_volume *volume);
/* Drops a reference and nulls *volume, which may be NULL. The last reference frees the volume. */
SP_API void sp_volume_unref(struct sp_volume **volume);

/* Valid as long as the caller's reference. */
SP_API const struct sp_volume_info *sp_volume_info(const struct sp_volume *volume);
/* Returns the samples, 64-byte aligned; valid as long as the caller's reference. */
SP_API const void *sp_volume_voxels(const struct sp_volume *volume);
/* Returns the vectors, one per sample or point in the same order, with components along the world
 * axes [data unit]; NULL = the volume has no vectors. Components may be NaN or infinite. Valid as
 * long as the caller's reference.
 */
SP_API const float (*sp_volume_vectors(const struct sp_volume *volume))[3];

/* Returns the elements; NULL = the volume has a grid of samples. Valid as long as the caller's
 * reference.
 */
SP_API const struct sp_elements *sp_volume_elements(const struct sp_volume *volume);

/* Makes a volume from elements in memory. Copies the arrays. Returns one reference, or NULL:
 * SP_ERR_INVALID (shape, or a triangle with a vertex that does not exist), SP_ERR_MEMORY. */
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
/* Checks a "demo:…" source like sp_volume_load(), without computing the volume. SP_ERR_NOT_FOUND
 * (name), SP_ERR_INVALID (size). */
SP_API bool sp_demo_check(const char *source, struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
