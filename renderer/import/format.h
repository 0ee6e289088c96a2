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

struct import_header {   /* result of open() */
    struct sp_grid grid; /* the reader owns its coordinates until close() */
    enum sp_type type;
    char unit[SP_UNIT_BYTES];
    char anatomy[4]; /* as in struct sp_volume_info */
    uint64_t bytes;  /* of all samples */
};

struct import_progress {
    void (*report)(void *user, uint64_t bytes_done);
    void *user;
};

struct import_format {
    const char *name;
    /* True if the first bytes or the name of the file identify this format. */
    bool (*probe)(const uint8_t *start, size_t size, const char *shown);
    /* Reads the header. Returns a reader for the calls below, or NULL with *err set. *file must
     * stay valid until close(). The grid has passed sp_grid_check(). */
    void *(*open)(const struct import_file *file, struct import_header *header,
                  struct sp_error *err);
    /* Reads all samples, i0 fastest, native byte order, into header->bytes of memory. */
    bool (*read)(void *reader, void *voxels, const struct import_progress *progress,
                 struct sp_error *err);
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

/* Sets spacing 1, origin 0, identity direction and even axes; keeps dims. */
void import_grid_init(struct sp_grid *grid);

/* Makes an axis rectilinear. `positions` holds the positions of its dims[axis] samples along the
 * axis, in world units. The function converts them in place to distances from the first one; the
 * caller keeps owning them. The origin moves to the first sample. Falling positions reverse the
 * direction of the axis. A single sample only moves the origin. sp_grid_check() checks the result.
 */
void import_grid_place(struct sp_grid *grid, unsigned axis, double *positions);

/* Sets the anatomical letters of the world, valid and not empty, once the grid is complete. The
 * world of a view is right-handed: a left-handed one would show the patient as in a mirror. So its
 * axis between front and back changes its sign: "LAS" becomes "LPS". */
void import_header_set_anatomy(struct import_header *header, const char letters[4]);

#endif
