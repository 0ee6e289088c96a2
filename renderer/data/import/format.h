/* SPDX-License-Identifier: Apache-2.0
 *
 * A file format as the import process `splat-import` sees it: one static const table per format.
 * This folder turns a file into samples in memory:
 *
 *   launch.c (parent) ─► splat-import ─► probe ─► open (header) ─► read (samples) ─► memfd
 *
 * launch.c, place.c, load.c, handover.c and confine.c are part of the parent. Everything else, and
 * every format library, runs only in the child. A reader checks its input and names file, field and
 * byte in its errors. If it crashes, only the child dies.
 */
#ifndef SP_IMPORT_FORMAT_H
#define SP_IMPORT_FORMAT_H

#include <limits.h>

#include "data/bricks/chunks.h"
#include "data/import/selection.h"
#include "data/import/warnings.h"
#include "sp/series.h"

struct import_progress {
    void (*report)(void *user, uint64_t bytes_done);
    void *user;
    uint64_t before; /* bytes that other arrays of the file have filled */
};

struct import_file {
    int fd;             /* readable, at byte 0; owned by the caller */
    bool is_folder;     /* `fd` is a folder; for import_folder and import_dicom */
    uint64_t size;      /* bytes */
    const char *title;  /* the name in errors */
    const char *root;   /* resolved; other files are opened only below this folder */
    const char *folder; /* resolved: the folder itself, or the folder of the file; relative names
                           start here */
    const char *field, *vectors; /* what to read; "" = the reader chooses */
    /* for import_warn(), at any time until close(); NULL = warnings are dropped */
    struct import_warnings *warnings;
    /* For import_report() in open(), in bytes of the file, if open() reads the whole file; NULL =
     * progress is not reported. */
    const struct import_progress *opening;
    /* Pattern of the names of the time series to which this file belongs (numbered.h); "" = only
     * this file is read. */
    const char *pattern;
    bool is_guess; /* the pattern comes from the first file of a folder, not from a path that the
                      user gave */
    struct import_selection selection; /* of the source */
    uint32_t step;                     /* step of a time series, from 0; 0 without has_step */
    bool has_step;              /* false: the step of the opened file, if it belongs to a series */
    struct import_shift *shift; /* shift of the positions of elements (shift.h); NULL = none */
    int level; /* level of detail, for formats with several levels: 0 = the finest, −1 = the reader
                  chooses */
};

/* How a file stores a number. The size in bytes is 1, 2, 4 or 8 for a whole number and 2, 4 or 8
 * for FLOAT. A complex number is a real and an imaginary part and has twice the size; the parts are
 * FLOAT in COMPLEX and whole numbers in COMPLEX_SIGNED. */
struct import_number {
    enum {
        IMPORT_SIGNED,
        IMPORT_UNSIGNED,
        IMPORT_FLOAT,
        IMPORT_COMPLEX,
        IMPORT_COMPLEX_SIGNED
    } kind;
    size_t size;
};

/* Samples that are computed from the vectors of the file (derived.h). */
enum import_derived { IMPORT_NOT_DERIVED, IMPORT_LENGTH, IMPORT_X, IMPORT_Y, IMPORT_Z };

/* The time series of a file. A reader without time steps leaves all fields zero. */
struct import_steps {
    uint32_t count; /* 0 = 1 */
    uint32_t index; /* the step that is read, below `count`; 0 if count is 0 */
    /* The time of each step: times[i], or first + i·interval; interval 0 = unknown. The reader owns
     * the times until close(). A file of one step may have a time; it is used if the file is part
     * of a series. */
    const double *times;
    double first, interval;
    char unit[SP_UNIT_BYTES];
};

struct import_header {   /* result of open() */
    struct sp_grid grid; /* the reader owns its coordinates until close() */
    struct import_steps steps;
    bool used_as, used_series; /* the reader honoured file->selection */
    bool took_folder; /* the volume includes all files of the folder that belong to the opened file
                       */
    bool lacks_distance; /* the file gives no distance of slices: the distance of columns is used */
    enum sp_type type;
    unsigned bits; /* bits of a number in the file, if numbers of several sizes become one type; 0 =
                      not used */
    enum sp_meaning meaning; /* as in struct sp_volume_info */
    char unit[SP_UNIT_BYTES];
    struct sp_vertical vertical;
    char anatomy[4];             /* as in struct sp_volume_info */
    uint64_t bytes;              /* bytes of all samples */
    uint32_t level, level_count; /* level of detail that is read, and the number of levels */
    /* If the kind is not SP_KIND_GRID, the file has elements; import_header_use_elements() then
     * sets the grid, type and bytes. */
    struct sp_elements_shape elements;
    bool has_factors; /* points: the file gives factors and volumes; otherwise they are computed
                         from neighbours */
    /* Gaussians that are points with colours: the reader leaves the numbers of the file in the
     * harmonics, the neighbours give the factors, and import_elements_finish() does the rest.
     * `color_most`: the number of full colour; 0 = 1, 255 or 65535, whichever holds all numbers. */
    bool are_colored_points;
    double color_most;
    /* Of points: they are the nodes of curvilinear grids, which give factors and volumes. The dims
     * of each, whose nodes follow one another; their products add up to the number of points. The
     * reader owns them until close(). */
    const uint32_t (*blocks)[3];
    uint32_t block_count; /* 0 = the points are no nodes */
    bool has_normals;     /* mesh: the file gives normals; otherwise they are computed from the
                             triangles */
    bool has_vectors;
    enum import_derived derived; /* how the samples are computed from the vectors */
    double frame[3][3];          /* columns: the axes of the file's vectors in world coordinates */
    char value_name[SP_FIELD_BYTES], vector_name[SP_FIELD_BYTES]; /* as in struct sp_volume_info */
    char value_unit[SP_UNIT_BYTES];
    char others[SP_OTHER_FIELDS_MAX][SP_FIELD_BYTES];         /* the same */
    char other_vectors[SP_OTHER_VECTORS_MAX][SP_FIELD_BYTES]; /* the same */
    bool has_more; /* the file has more fields or vectors than these lists hold */
};

struct import_series_list {
    struct sp_series *items; /* SP_SERIES_MAX of them */
    uint32_t count;
};

struct import_format {
    const char *name;  /* name in the list of supported formats */
    bool needs_module; /* module.h */
    /* True if the first bytes or the name of the file identify this format. With the name "", the
     * bytes alone must identify it without doubt. */
    bool (*probe)(const uint8_t *start, size_t size, const char *title);
    size_t reader_size; /* bytes of a reader */
    /* Fills a zeroed reader, and the header, which import_header_init() has initialised. *file must
     * stay valid until close(). The grid has passed sp_grid_check(). */
    bool (*open)(void *reader, const struct import_file *file, struct import_header *header,
                 struct sp_error *err);
    /* Reads all samples, i0 fastest, native byte order, into header->bytes bytes of memory, and the
     * vectors into `vectors`, which is NULL if there are none. import_vectors_finish() applies the
     * frame, and computes samples that are derived from vectors. NULL = the format has elements
     * only. */
    bool (*read)(void *reader, void *voxels, float (*vectors)[3],
                 const struct import_progress *progress, struct sp_error *err);
    /* Reads all elements into zeroed arrays; NULL = the format has no elements.
     * import_elements_finish() computes factors, volumes and normals that the file does not
     * give. */
    bool (*read_elements)(void *reader, const struct sp_elements *elements,
                          const struct import_progress *progress, struct sp_error *err);
    /* For a grid with levels of detail whose chunks can be read one by one: describes the level of
     * the header, as level 0, and up to `most` − 1 coarser levels. Returns the number of levels.
     * NULL = the whole grid must be read. */
    unsigned (*levels)(void *reader, struct sp_chunk_level *levels, unsigned most);
    /* Reads one chunk of a level as in data/bricks/chunks.h. */
    bool (*read_chunk)(void *reader, unsigned level, const uint32_t place[3], void *out,
                       struct sp_error *err);
    /* Frees what the reader owns, also after open() failed. */
    void (*close)(void *reader);
    /* Reads the time of a file of one step; false if the file gives no time. NULL = the format has
     * no times. open() stores this time in header->steps.times[0]. */
    bool (*read_time)(const struct import_file *file, double *time);
    /* Lists the series of the file's folder (sp/series.h). NULL = the format has none. */
    bool (*list)(const struct import_file *file, struct import_series_list *list,
                 struct sp_error *err);
};

/* Number of first bytes of a file from which its format is found. In HDF5, a user block of 512,
 * 1024, … bytes may precede the signature. */
enum { IMPORT_START_BYTES = 8192 + 8 };

/* Finds the format of a file by its first bytes and its name. NULL with *err set. */
const struct import_format *import_format_find(const uint8_t *start, size_t size, const char *title,
                                               struct sp_error *err);

/* True if the first bytes or the name show a format; with the name "" only the bytes count. */
bool import_format_is_known(const uint8_t *start, size_t size, const char *title);

/* True if a format that may suit the file needs a module. */
bool import_format_needs_module(const uint8_t *start, size_t size, const char *title);

/* Returns a reader for the calls of the format, or NULL with *err set. *file must stay valid until
 * import_format_close(), which accepts NULL as a reader. */
void *import_format_open(const struct import_format *format, const struct import_file *file,
                         struct import_header *header, struct sp_error *err);
void import_format_close(const struct import_format *format, void *reader);

/* Reads a remote hierarchy (remote.h); not in the list of file formats. */
extern const struct import_format import_zarr_remote;

/* Files of a folder beyond these are not looked at. */
enum { IMPORT_FILES_MAX = 1 << 16 };

/* Reads the volume that a folder stands for (folder.c); not in the list of file formats. */
extern const struct import_format import_folder;

/* Reads the time series of the files that match file->pattern. */
extern const struct import_format import_series;

extern const struct import_format import_collection, import_csv, import_dicom, import_gipl,
    import_image, import_image_stack, import_mesh, import_metaimage, import_mgh, import_mrc,
    import_nifti, import_nrrd, import_plot3d, import_ply, import_pvm, import_raw, import_spz,
    import_tiff, import_tiff_stack, import_vdb, import_vtk, import_vtk_xml, import_zarr,
    import_hdf5, import_netcdf, import_amira, import_vol;

/* Writes the folder of this program, without a trailing slash, and returns it; "" if it is unknown.
 */
const char *import_program_folder(char folder[PATH_MAX]);

/* Writes the place of an error, "TITLE: byte N: FIELD". FIELD may be NULL. */
void import_place(char place[SP_ERROR_PLACE], const char *title, uint64_t byte, const char *field);

/* Fills err->place with "TITLE: byte N: FIELD" and fails with the printf-style text. FIELD may be
 * NULL. */
__attribute__((format(printf, 6, 7))) bool import_fail(struct sp_error *err, enum sp_code code,
                                                       const char *title, uint64_t byte,
                                                       const char *field, const char *format, ...);

/* Reads `size` bytes of the file from byte `at` on; *got is less only where the file ends.
 * SP_ERR_IO. */
bool import_read(const struct import_file *file, void *out, size_t size, uint64_t at, size_t *got,
                 struct sp_error *err);

/* After open(): fails if the reader has not honoured file->selection, and sets the unit.
 * SP_ERR_UNSUPPORTED. */
bool import_header_use_selection(struct import_header *header, const struct import_file *file,
                                 struct sp_error *err);

/* Sets the number of time steps of the file, and the step that `file` selects. Fails if the file
 * has no such step. */
bool import_header_use_steps(struct import_header *header, const struct import_file *file,
                             uint64_t count, struct sp_error *err);

/* Sets the times of the steps: `first`, and then every `interval` [unit]. If the interval is not
 * positive or is NaN, the times are unknown. */
void import_header_use_interval(struct import_header *header, double first, double interval,
                                const char *unit);

/* Sets spacing 1, origin 0, identity direction, even axes, and vectors along the axes of the world;
 * keeps everything else. */
void import_header_init(struct import_header *header);

/* Warns if the files of a stack do not give the distance of slices. */
void import_warn_distance(const struct import_header *header, struct import_warnings *warnings);

/* Sets the grid, type and size of a file that has elements, and whether it has vectors. */
void import_header_use_elements(struct import_header *header,
                                const struct sp_elements_shape *shape);

/* Adds vectors of this name, which may be any bytes. */
void import_header_add_vectors(struct import_header *header, const char *name);

/* Adds the name of scalars that are not read, unless the name is empty or already in the list. If
 * the list is full, sets has_more; so a reader that stops early must first pass one name that does
 * not fit. */
void import_header_add_other(struct import_header *header, const char *name);

/* Like import_header_add_other(), for vectors. */
void import_header_add_other_vectors(struct import_header *header, const char *name);

/* Chooses which of the `count` components of each sample is read: the component with the name
 * `wanted`, or else the first. Lists the other components. Up to four colours have the names of
 * colours; other components are called "component 1" and so on. Returns the number of the chosen
 * component, from 0. */
unsigned import_header_choose_component(struct import_header *header, const char *wanted,
                                        unsigned count, bool are_colors);

/* True if a name is longer than the ending and ends with it, ignoring case. */
bool import_ends_with(const char *name, const char *ending);

/* Copies the name of an array. Cuts it to SP_FIELD_BYTES − 1, not inside of a UTF-8 character. */
void import_name(char out[SP_FIELD_BYTES], const char *name);

/* Reports that `bytes` of the current array are in memory. `progress` may be NULL. */
void import_report(const struct import_progress *progress, uint64_t bytes);

/* Makes an axis rectilinear. `positions` holds the positions of its dims[axis] samples along the
 * axis, in world units. The function converts them in place to distances from the first one; the
 * caller keeps owning them. The origin moves to the first sample. Falling positions reverse the
 * direction of the axis. A single sample only moves the origin. sp_grid_check() checks the result.
 */
void import_grid_set_positions(struct sp_grid *grid, unsigned axis, double *positions);

/* Moves the lengths of the directions into the spacing, so that the grid stays where it is and each
 * direction has the length 1. A length within 1e-5 of 1 is the rounding of written digits and
 * changes no spacing. A direction of length 0 stays. */
void import_grid_normalize(struct sp_grid *grid);

/* Sets the anatomical letters of the world, valid and not empty, once the grid is complete. The
 * world of a view is right-handed: a left-handed one would show the patient as in a mirror. So its
 * axis between front and back changes its sign: "LAS" becomes "LPS". Vectors change with it, so the
 * frame must be set. */
void import_header_set_anatomy(struct import_header *header, const char letters[4]);

#endif
