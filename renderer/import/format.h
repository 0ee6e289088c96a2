/* SPDX-License-Identifier: Apache-2.0
 *
 * A file format as the import process `splat-import` sees it: one static const table per format.
 * This folder turns a file into samples in memory:
 *
 *   launch.c (parent) ─► splat-import ─► probe ─► open (header) ─► read (samples) ─► memfd
 *
 * launch.c, load.c, handover.c and confine.c are part of the parent. Everything else, and every
 * format library, runs only in the child. A reader checks its input and names file, field and byte
 * in its errors. If it crashes, only the child dies.
 */
#ifndef SP_IMPORT_FORMAT_H
#define SP_IMPORT_FORMAT_H

#include <limits.h>

#include "sp/volume.h"

struct import_file {
    int fd;             /* readable, at byte 0; owned by the caller */
    uint64_t size;      /* bytes */
    const char *shown;  /* the name in errors */
    const char *root;   /* resolved; other files are opened only below this folder */
    const char *folder; /* resolved folder of this file; relative names start here */
};

/* How a file stores a number. The kind and the size in bytes (1, 2, 4, 8; 4 or 8 for FLOAT). */
struct import_number {
    enum { IMPORT_SIGNED, IMPORT_UNSIGNED, IMPORT_FLOAT } kind;
    size_t size;
};

struct import_header {   /* result of open() */
    struct sp_grid grid; /* the reader owns its coordinates until close() */
    enum sp_type type;
    char unit[SP_UNIT_BYTES];
    char anatomy[4]; /* as in struct sp_volume_info */
    uint64_t bytes;  /* of all samples */
    bool has_vectors;
    bool samples_are_lengths; /* the file has vectors only */
    double frame[3][3]; /* columns: the axes of the file's vectors, along the axes of the world */
    char value_name[SP_FIELD_BYTES], vector_name[SP_FIELD_BYTES]; /* as in struct sp_volume_info */
};

struct import_progress {
    void (*report)(void *user, uint64_t bytes_done);
    void *user;
    uint64_t before; /* bytes that other arrays of the file have filled */
};

struct import_format {
    const char *name;
    /* True if the first bytes or the name of the file identify this format. */
    bool (*probe)(const uint8_t *start, size_t size, const char *shown);
    /* Reads the header. Returns a reader for the calls below, or NULL with *err set. *file must
     * stay valid until close(). The grid has passed sp_grid_check(). */
    void *(*open)(const struct import_file *file, struct import_header *header,
                  struct sp_error *err);
    /* Reads all samples, i0 fastest, native byte order, into header->bytes of memory; the vectors
     * into `vectors`, which is NULL if there are none. Leaves samples that are lengths and the
     * frame to import_vectors_finish(). */
    bool (*read)(void *reader, void *voxels, float (*vectors)[3],
                 const struct import_progress *progress, struct sp_error *err);
    void (*close)(void *reader);
};

extern const struct import_format import_nrrd, import_raw, import_tiff, import_vtk, import_vtk_xml;

/* Writes the folder of this program, without a trailing slash, and returns it; "" if it is unknown.
 */
const char *import_program_folder(char folder[PATH_MAX]);

/* Writes the place of an error, "SHOWN: byte N: FIELD". FIELD may be NULL. */
void import_place(char place[SP_ERROR_PLACE], const char *shown, uint64_t byte, const char *field);

/* Fills err->place with "SHOWN: byte N: FIELD" and fails with the printf-style text. FIELD may be
 * NULL. */
__attribute__((format(printf, 6, 7))) bool import_fail(struct sp_error *err, enum sp_code code,
                                                       const char *shown, uint64_t byte,
                                                       const char *field, const char *format, ...);

/* Sets spacing 1, origin 0, identity direction, even axes, and vectors along the axes of the world;
 * keeps everything else. */
void import_header_init(struct import_header *header);

/* Adds vectors of this name, which may be any bytes. */
void import_header_add_vectors(struct import_header *header, const char *name);

/* Makes the lengths of the vectors the samples. */
void import_header_use_lengths(struct import_header *header);

/* Copies the name of an array. Cuts it to SP_FIELD_BYTES − 1, not inside of a UTF-8 character. */
void import_name(char out[SP_FIELD_BYTES], const char *name);

/* Reports that `bytes` of the current array are in memory. `progress` may be NULL. */
void import_report(const struct import_progress *progress, uint64_t bytes);

/* Makes an axis rectilinear. `positions` holds the positions of its dims[axis] samples along the
 * axis, in world units. The function converts them in place to distances from the first one; the
 * caller keeps owning them. The origin moves to the first sample. Falling positions reverse the
 * direction of the axis. A single sample only moves the origin. sp_grid_check() checks the result.
 */
void import_grid_place(struct sp_grid *grid, unsigned axis, double *positions);

/* Sets the anatomical letters of the world, valid and not empty, once the grid is complete. The
 * world of a view is right-handed: a left-handed one would show the patient as in a mirror. So its
 * axis between front and back changes its sign: "LAS" becomes "LPS". Vectors change with it, so the
 * frame must be set. */
void import_header_set_anatomy(struct import_header *header, const char letters[4]);

#endif
