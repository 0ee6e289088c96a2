/* SPDX-License-Identifier: Apache-2.0
 *
 * A file format, as the child process `splat-import` sees it: one static const table entry a
 * format. The room turns a file into samples in memory:
 *
 *   launch.c (parent) ─► splat-import ─► probe ─► open (header) ─► read (samples) ─► memfd
 *
 * Everything below but launch.c, load.c, handover.c and confine.c runs in the child alone, and so
 * do the format libraries. A reader checks what it reads, gives errors that name file, field and
 * byte, and may crash: then only the child dies.
 */
#ifndef SP_IMPORT_FORMAT_H
#define SP_IMPORT_FORMAT_H

#include <limits.h>

#include "sp/volume.h"

struct import_file {
    int fd;             /* readable, at byte 0; owned by the caller */
    uint64_t size;      /* bytes */
    const char *shown;  /* how errors call it */
    const char *root;   /* other files are opened below this folder alone; resolved */
    const char *folder; /* of this file; resolved; relative names start here */
};

struct import_header {   /* what a reader's open() gives */
    struct sp_grid grid; /* its coordinates are the reader's, until close */
    enum sp_type type;
    char unit[SP_UNIT_BYTES];
    uint64_t bytes; /* of all samples */
};

struct import_progress {
    void (*report)(void *user, uint64_t bytes_done);
    void *user;
};

struct import_format {
    const char *name;
    /* Whether the file is of this format, by its first bytes and its name. */
    bool (*probe)(const uint8_t *start, size_t size, const char *shown);
    /* Reads the header. Returns a reader for the calls below, or NULL with *err set. *file lives
     * until close. The header passed sp_grid_check(). */
    void *(*open)(const struct import_file *file, struct import_header *header,
                  struct sp_error *err);
    /* Reads all samples, i0 fastest, native byte order, into header->bytes of memory. */
    bool (*read)(void *reader, void *voxels, const struct import_progress *progress,
                 struct sp_error *err);
    void (*close)(void *reader);
};

extern const struct import_format import_nrrd, import_raw, import_vtk, import_vtk_xml;

/* The TIFF reader brings OpenImageIO, 130 MB that only a TIFF should pay for: it lives in
 * splat-import-tiff.so beside the program, which exports this function. */
#define IMPORT_TIFF_MODULE "splat-import-tiff.so"
#define IMPORT_TIFF_SYMBOL "splat_import_tiff"
typedef const struct import_format *import_format_fn(void);

/* "SHOWN: byte N: FIELD", as places of errors are written. FIELD may be NULL. */
void import_place(char place[SP_ERROR_PLACE], const char *shown, uint64_t byte, const char *field);

/* Fills err->place with "SHOWN: byte N: FIELD" and fails with the printf-style text. FIELD may be
 * NULL. */
__attribute__((format(printf, 6, 7))) bool import_fail(struct sp_error *err, enum sp_code code,
                                                       const char *shown, uint64_t byte,
                                                       const char *field, const char *format, ...);

/* Sets a grid to spacing 1, origin 0, identity, even axes. Dims stay. */
void import_grid_init(struct sp_grid *grid);

/* Makes an axis rectilinear. `positions` are the places of its dims[axis] samples along the axis,
 * in world units: they become distances from the first one, in place, and stay the caller's; the
 * origin moves to the first. If they fall, the axis's direction is turned round. A single sample
 * moves the origin and no more. sp_grid_check() judges the result. */
void import_grid_place(struct sp_grid *grid, unsigned axis, double *positions);

#endif
