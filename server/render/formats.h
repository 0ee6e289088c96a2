/* SPDX-License-Identifier: Apache-2.0
 *
 * What the daemon knows about file formats without reading voxels: names, and what the first bytes
 * of a file say. The importer decides whether a file is really a volume.
 */
#ifndef SRV_RENDER_FORMATS_H
#define SRV_RENDER_FORMATS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/elements.h"

/* Returns the format of a file by its name ("NRRD", "VTK", "TIFF", "raw samples"); NULL = no format
 * that the importer reads. A constant. */
const char *srv_format_of(const char *name);
/* Returns the extension of such a name with its dot, in lower case (".nrrd"); NULL = as above, or a
 * folder is meant. A constant, so it is safe as a part of a path. */
const char *srv_format_extension(const char *name);
/* True for a format, as srv_format_of() names it, whose numbered files are the steps of a time
 * series. In other formats numbered files are the slices of one volume. */
bool srv_format_has_steps(const char *format);
enum { SRV_FORMAT_LIST = 768 };
/* True if a name has no extension, or one without letters: so do many DICOM files, "IM0001" or
 * "1.2.840.113619.2". Their first bytes tell. */
bool srv_format_has_no_extension(const char *name);
enum { SRV_FORMAT_DICOM = 132 }; /* bytes for the next function */
/* True if a file that begins with these bytes is DICOM with a preamble. */
bool srv_format_is_dicom(const char *bytes, size_t size);
/* Writes the extensions of all files for a person: ".nrrd, .nhdr, … or .glb". */
void srv_format_list(char list[SRV_FORMAT_LIST]);
/* True if an open folder is a Zarr hierarchy with an image, by its metadata. A plate or well of
 * several images is none. Blocks. */
bool srv_format_is_zarr(int folder);
/* Returns the length of a file name without its extensions: 1 for "x.nii.gz". */
size_t srv_format_stem(const char *name);

enum { SRV_FORMAT_PEEK = 4096 }; /* bytes at the beginning of a file that are enough for most */

struct srv_format_peek {
    uint32_t dims[3];  /* 0 = not found, or something that cannot be */
    char type[16];     /* as the protocol names it: "uint8"; "" = not found */
    enum sp_kind kind; /* by the format, or by what the file says; SP_KIND_COUNT = not known */
};
/* Tells what the name of a file and its first bytes, [0, size), say. The bytes need no NUL. */
void srv_format_look(const char *name, const char *bytes, size_t size,
                     struct srv_format_peek *peek);

#endif
