/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/foreign.h"

#include <stdbool.h>
#include <string.h>

#include "data/import/format.h"

enum { ANYWHERE = -1 };

struct kind {
    const char *bytes;
    size_t size;
    int at;             /* ANYWHERE = in the first bytes */
    const char *ending; /* NULL = any */
    const char *name;
    const char *command; /* before the name of the file; NULL = none */
    const char *rest;    /* of the command, behind the name; NULL = none */
};

#define KIND(bytes, at, ending, name, command)                                                     \
    { bytes, sizeof bytes - 1, at, ending, name, command, NULL }
#define CONVERTED(bytes, at, ending, name, command, rest)                                          \
    { bytes, sizeof bytes - 1, at, ending, name, command, rest }

static const struct kind packed[] = {
    KIND("\37\213", 0, ".tar.gz", "packed with tar and gzip", "tar xzf"),
    KIND("\37\213", 0, ".tgz", "packed with tar and gzip", "tar xzf"),
    KIND("\37\213", 0, NULL, "packed with gzip", "gunzip"),
    KIND("BZh", 0, ".tar.bz2", "packed with tar and bzip2", "tar xjf"),
    KIND("BZh", 0, NULL, "packed with bzip2", "bunzip2"),
    KIND("\3757zXZ\0", 0, ".tar.xz", "packed with tar and xz", "tar xJf"),
    KIND("\3757zXZ\0", 0, NULL, "packed with xz", "unxz"),
    KIND("\50\265\57\375", 0, ".tar.zst", "packed with tar and Zstandard", "tar --zstd -xf"),
    KIND("\50\265\57\375", 0, NULL, "packed with Zstandard", "unzstd"),
    KIND("\4\"M\30", 0, NULL, "packed with LZ4", "unlz4"),
    KIND("\37\235", 0, NULL, "packed with compress", "uncompress"),
    KIND("PK\3\4", 0, NULL, "a zip archive", "unzip"),
    KIND("PK\5\6", 0, NULL, "an empty zip archive", "unzip"),
    KIND("7z\274\257\47\34", 0, NULL, "a 7z archive", "7z x"),
    KIND("Rar!", 0, NULL, "a RAR archive", "unrar x"),
    KIND("ustar", 257, NULL, "a tar archive", "tar xf"),
};

/* Of microscopes, which Bio-Formats converts. */
static const struct kind microscopes[] = {
    KIND("ZISRAWFILE", 0, NULL, "a CZI file of Zeiss", "bfconvert"),
    KIND("\320\317\21\340\241\261\32\341", 0, NULL, "a compound file, such as OIB or ZVI",
         "bfconvert"),
    KIND("\332\316\276\12", 0, NULL, "an ND2 file of Nikon", "bfconvert"),
    KIND("\160\0\0\0", 0, ".lif", "a LIF file of Leica", "bfconvert"),
    KIND("\0\0\0\3", 0, ".dm3", "a DM3 file of Gatan", "bfconvert"),
    KIND("\0\0\0\4", 0, ".dm4", "a DM4 file of Gatan", "bfconvert"),
};

/* Trained scenes; their endings tell what they are. */
static const struct kind scenes[] = {
    KIND("", 0, ".splat", "a .splat file", "splat-transform"),
    KIND("", 0, ".ksplat", "a .ksplat file", "splat-transform"),
    KIND("PK\3\4", 0, ".sog", "an SOG file", "splat-transform"),
};

/* Of other programs, with a command that writes what is read. */
static const struct kind converted[] = {
    CONVERTED("mrtrix image", 0, NULL, "an image of MRtrix", "mrconvert", " out.nii.gz"),
    CONVERTED("mrtrix tracks", 0, NULL, "a file of streamlines of MRtrix", "tckconvert",
              " out.vtk"),
    CONVERTED("", 0, ".HEAD", "a header of AFNI", "3dAFNItoNIFTI", ""),
    CONVERTED("", 0, ".BRIK", "a data set of AFNI", "3dAFNItoNIFTI", ""),
    CONVERTED("", 0, ".BRIK.gz", "a data set of AFNI", "3dAFNItoNIFTI", ""),
    CONVERTED("# === DATA DESCRIPTION FILE", 0, NULL, "a PAR file of Philips", "dcm2niix", ""),
    CONVERTED("MATRIX7", 0, NULL, "an ECAT file", "medcon -c nifti -f", ""),
    CONVERTED("!INTERFILE", 0, NULL, "a header of Interfile", "medcon -c nifti -f", ""),
    CONVERTED("GIF8", 0, NULL, "a GIF image", "magick", " out.tif"),
    CONVERTED("BM", 0, ".bmp", "a BMP image", "magick", " out.png"),
    CONVERTED("\0\0\0\14jP  ", 0, NULL, "a JPEG 2000 image", "magick", " out.tif"),
    CONVERTED("\377\117\377\121", 0, NULL, "a JPEG 2000 code stream", "magick", " out.tif"),
    CONVERTED("WEBP", 8, NULL, "a WebP image", "magick", " out.png"),
    CONVERTED("#?RADIANCE", 0, NULL, "an image of Radiance", "magick", " out.tif"),
    CONVERTED("\166\57\61\1", 0, NULL, "an OpenEXR image", "oiiotool", " -o out.tif"),
    CONVERTED("ftyp", 4, NULL, "a movie", "ffmpeg -i", " out%04d.png"),
    CONVERTED("AVI ", 8, NULL, "a movie", "ffmpeg -i", " out%04d.png"),
    CONVERTED("<Xdmf", ANYWHERE, NULL, "an XDMF file", "meshio convert", " out.vtu"),
    CONVERTED("$MeshFormat", 0, NULL, "a mesh of Gmsh", "meshio convert", " out.vtu"),
    CONVERTED("OFF", 0, ".off", "a mesh of the format OFF", "meshio convert", " out.ply"),
    CONVERTED("Kaydara FBX", 0, NULL, "a mesh of the format FBX", "assimp export", " out.glb"),
    CONVERTED("<COLLADA", ANYWHERE, NULL, "a mesh of COLLADA", "assimp export", " out.glb"),
    CONVERTED("PK\3\4", 0, ".3mf", "a mesh of the format 3MF", "assimp export", " out.glb"),
};

static const struct kind pages[] = {
    KIND("<!DOCTYPE html", ANYWHERE, NULL, "", NULL),
    KIND("<html", ANYWHERE, NULL, "", NULL),
    KIND("<HTML", ANYWHERE, NULL, "", NULL),
};

static const struct kind others[] = {
    KIND("\223NUMPY", 0, NULL, "an array of NumPy", NULL),
    KIND("PK\3\4", 0, ".npz", "a file of NumPy", NULL),
    KIND("SIMPLE  =", 0, NULL, "a FITS file", NULL),
    KIND("MATLAB 5.0", 0, NULL, "a file of MATLAB 5", NULL),
    KIND("ENVI", 0, ".hdr", "a header of ENVI", NULL),
    KIND("TRACK\0", 0, NULL, "a file of streamlines of TrackVis", NULL),
    KIND("", 0, ".foam", "a case of OpenFOAM", NULL),
    KIND("type:  ensight", ANYWHERE, ".case", "a case of EnSight", NULL),
    KIND("type: ensight", ANYWHERE, ".case", "a case of EnSight", NULL),
    KIND("<ParaView", ANYWHERE, NULL, "a state of ParaView, without data", NULL),
    KIND("LASF", 0, NULL, "a LAS file", NULL),
    KIND("ASTM-E57", 0, NULL, "an E57 file", NULL),
    KIND("# .PCD", 0, NULL, "a PCD file", NULL),
    KIND("<GIFTI", ANYWHERE, NULL, "a surface of GIFTI", NULL),
    KIND("\377\377\376", 0, NULL, "a surface of FreeSurfer", NULL),
};

static const struct kind *find_kind(const struct kind *kinds, size_t count, const uint8_t *start,
                                    size_t size, const char *title) {
    for (size_t i = 0; i < count; i++) {
        const struct kind *k = &kinds[i];
        const bool is_there = k->at == ANYWHERE ? memmem(start, size, k->bytes, k->size) != NULL
                                                : size >= (size_t)k->at + k->size &&
                                                      memcmp(start + k->at, k->bytes, k->size) == 0;
        if (is_there && (!k->ending || import_ends_with(title, k->ending)))
            return k;
    }
    return NULL;
}

#define FIND(kinds) find_kind(kinds, sizeof kinds / sizeof *kinds, start, size, title)

/* Coordinates as text, without the line that names them. */
static bool check_text(const uint8_t *start, size_t size, const char *title, struct sp_error *err) {
    const bool is_table = import_ends_with(title, ".xyz") || import_ends_with(title, ".pts") ||
                          import_ends_with(title, ".asc") || import_ends_with(title, ".txt");
    for (size_t i = 0; i < size; i++)
        if ((start[i] < ' ' && !strchr("\t\r\n", start[i])) || start[i] > '~' || start[i] == 0)
            return true;
    return !is_table ||
           sp_fail(err, SP_ERR_UNSUPPORTED, title,
                   "this is text; points are read from .csv: write the names of the columns, such "
                   "as x,y,z,value, as the first line, and separate by commas, semicolons or tabs");
}

bool import_foreign_check(const uint8_t *start, size_t size, const char *title,
                          struct sp_error *err) {
    const char *slash = strrchr(title, '/'), *name = slash ? slash + 1 : title;
    const struct kind *k = FIND(others);
    if (k)
        return sp_fail(err, SP_ERR_UNSUPPORTED, title,
                       "this is %s, which is not read; write it as NRRD, NIfTI, TIFF or HDF5, "
                       "points as PLY or CSV, a surface as VTK, PLY or STL",
                       k->name);
    k = FIND(converted);
    if (k)
        return sp_fail(err, SP_ERR_UNSUPPORTED, title,
                       "this is %s, which is not read; convert it, with \"%s %.60s%s\"", k->name,
                       k->command, name, k->rest);
    if (FIND(pages))
        return sp_fail(err, SP_ERR_UNSUPPORTED, title,
                       "this is a web page; if it was saved in place of a file, download the file "
                       "itself");
    k = FIND(scenes);
    if (k)
        return sp_fail(err, SP_ERR_UNSUPPORTED, title,
                       "this is %s of Gaussians, which is not read; save it as PLY or SPZ, with "
                       "\"%s %.60s out.ply\" of PlayCanvas",
                       k->name, k->command, name);
    k = FIND(microscopes);
    if (k)
        return sp_fail(err, SP_ERR_UNSUPPORTED, title,
                       "this is %s, which is not read; save it as OME-TIFF, with \"%s %.60s "
                       "out.ome.tif\" of Bio-Formats",
                       k->name, k->command, name);
    if (!check_text(start, size, title, err))
        return false;
    k = FIND(packed);
    return !k ||
           sp_fail(err, SP_ERR_UNSUPPORTED, title,
                   "this is %s%s, which is not read; unpack it first, with \"%s %.60s\"",
                   strncmp(k->name, "packed", 6) == 0 ? "a file " : "", k->name, k->command, name);
}

bool import_foreign_check_name(const char *title, struct sp_error *err) {
    static const char *const endings[] = { ".img", ".img.gz", ".raw", ".zraw", ".bin", ".dat" };
    const char *slash = strrchr(title, '/'), *name = slash ? slash + 1 : title;
    for (size_t i = 0; i < sizeof endings / sizeof *endings; i++)
        if (import_ends_with(title, endings[i]))
            return sp_fail(err, SP_ERR_UNSUPPORTED, title,
                           i < 2 ? "these are the samples of a pair of files; open the header "
                                   "beside them, %.*s.hdr"
                                 : "these are samples without a header; open the header that names "
                                   "them, such as %.*s.mhd or .nhdr, or write a sidecar, %.*s.json",
                           (int)(strlen(name) - strlen(endings[i])), name,
                           (int)(strlen(name) - strlen(endings[i])), name);
    return true;
}
