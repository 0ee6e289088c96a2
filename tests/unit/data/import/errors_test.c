/* SPDX-License-Identifier: Apache-2.0
 *
 * Every error tells a cause, and files open whatever their names are.
 */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "data/import/warnings.h"
#include "unit/data/import/support.h"

static bool ends_with(const char *text, const char *end) {
    const size_t n = strlen(text), m = strlen(end);
    return n >= m && strcmp(text + n - m, end) == 0;
}

/* True if the text has nothing that a user cannot act on. */
static bool is_readable(const char *text) {
    static const char *const never[] = { "/proc/", "no reason", "std::",   "(null)", "\"\"",
                                         "''",     "  ",        " ,",      "..",     "\n",
                                         "0x",     "errno",     "_bridge", "libtiff" };
    bool is_good = true;
    for (size_t i = 0; i < sizeof never / sizeof *never; i++)
        is_good = is_good && !strstr(text, never[i]);
    return is_good;
}

/* Fails unless the error names the file, is readable and is a part of a sentence. */
static void assert_is_told(const char *name, const struct sp_error *err) {
    static const char *const ends[] = { " has", ":", ";", ",", " ", "." };
    bool is_good = strlen(err->text) >= 12 && strstr(err->place, name) && is_readable(err->text) &&
                   is_readable(err->place);
    for (size_t i = 0; i < sizeof ends / sizeof *ends; i++)
        is_good = is_good && !ends_with(err->text, ends[i]);
    if (!is_good)
        fail_msg("%s: place \"%s\", text \"%s\"", name, err->place, err->text);
}

/* Fails unless each warning is a sentence. */
static void assert_warns_well(const char *name, const struct sp_volume *volume) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    for (int i = 0; i < SP_WARNINGS_MAX && info->warnings[i][0]; i++) {
        const char *text = info->warnings[i];
        const bool is_begun = isupper((unsigned char)text[0]) || isdigit((unsigned char)text[0]);
        if (!is_begun || !ends_with(text, ".") || strlen(text) < 12 || !is_readable(text))
            fail_msg("%s: warning \"%s\"", name, text);
    }
}

/* Each format with an empty file, with text, and with its first bytes before zeros. */
static void errors_of_every_format_tell_a_cause(void **state) {
    (void)state;
    static const struct {
        const char *name, *start;
        size_t size;
    } files[] = {
        { "bad.nrrd", "NRRD0004\n", 9 },
        { "bad.nii", "\134\1\0\0", 4 },
        { "bad.nii.gz", "\37\213\10\0", 4 },
        { "bad.mha", "ObjectType = Image\n", 19 },
        { "bad.pvm", "PVM\n", 4 },
        { "bad.vdb", "\40BDV\0\0\0\0", 8 },
        { "bad.h5", "\211HDF\r\n\32\n", 8 },
        { "bad.nc", "CDF\1", 4 },
        { "bad.am", "# AmiraMesh BINARY-LITTLE-ENDIAN 2.1\n", 37 },
        { "bad.vol", "VOL\3", 4 },
        { "bad.vtk", "# vtk DataFile Version 3.0\n", 27 },
        { "bad.vti", "<VTKFile type=\"ImageData\">", 26 },
        { "bad.pvti", "<VTKFile type=\"PImageData\">", 27 },
        { "bad.pvd", "<VTKFile type=\"Collection\">", 27 },
        { "bad.series", "{", 1 },
        { "bad.json", "{", 1 },
        { "bad.tif", "II*\0\10\0\0\0", 8 },
        { "bad.png", "\211PNG\r\n\32\n", 8 },
        { "bad.jpg", "\377\330\377\340", 4 },
        { "bad.ply", "ply\nformat ascii 1.0\n", 21 },
        { "bad.spz", "\37\213\10\0", 4 },
        { "bad.csv", "x,y,z\n", 6 },
        { "bad.p3d", "\1\0\0\0", 4 },
        { "bad.stl", "solid x\n", 8 },
        { "bad.gltf", "{", 1 },
        { "bad.glb", "glTF\2\0\0\0", 8 },
        { "bad.dcm", "\10\0\5\0CS\12\0ISO_IR 100", 18 },
        { "bad.mrc", "\2\0\0\0\2\0\0\0\2\0\0\0\2", 13 },
        { "bad.mgh", "\0\0\0\1\0\0\0\2\0\0\0\2\0\0\0\2", 16 },
        { "bad.gipl", "\0\2\0\2\0\2\0\1\0\10", 10 },
        { "bad.bmp", "BM", 2 },
    };
    struct sp_load_options options = importer_options();
    for (size_t i = 0; i < sizeof files / sizeof *files; i++)
        for (int kind = 0; kind < 3; kind++) {
            char bytes[1024] = "this is a text, not a volume\n";
            struct sp_error err = { .text = "" };
            size_t size = kind == 0 ? 0 : strlen(bytes);
            if (kind == 2) {
                memset(bytes, 0, sizeof bytes);
                memcpy(bytes, files[i].start, files[i].size);
                size = sizeof bytes;
            }
            write_file(files[i].name, bytes, size);
            struct sp_volume *volume = sp_volume_load(in_folder(files[i].name), &options, &err);
            if (volume)
                assert_warns_well(files[i].name, volume);
            else
                assert_is_told(files[i].name, &err);
            sp_volume_unref(&volume);
            remove(in_folder(files[i].name));
        }
}

/* Copies the first bytes of a file of dicom/, at most `most`. Returns how many there were. */
static size_t copy_dicom(const char *from, const char *to, size_t most) {
    char path[1024], bytes[1 << 14];
    snprintf(path, sizeof path, SPLATD_SOURCE_DIR "/tests/unit/data/import/dicom/%s", from);
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    const size_t size = fread(bytes, 1, sizeof bytes, file);
    fclose(file);
    write_file(to, bytes, size < most ? size : most);
    return size;
}

/* DICOM files that end after each part, alone and as one slice of a folder. */
static void errors_of_cut_dicom_files_tell_a_cause(void **state) {
    (void)state;
    static const char *const names[] = { "series0.dcm", "jpeg.dcm", "enhanced.dcm" };
    struct sp_load_options options = importer_options();
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        const size_t size = copy_dicom(names[i], "cut.dcm", SIZE_MAX);
        for (size_t part = 1; part < 4; part++) {
            struct sp_error err = { .text = "" };
            copy_dicom(names[i], "cut.dcm", size * part / 4);
            struct sp_volume *volume = sp_volume_load(in_folder("cut.dcm"), &options, &err);
            assert_null(volume);
            assert_is_told("cut.dcm", &err);
        }
    }
    struct sp_error err = { .text = "" };
    assert_null(sp_volume_load(folder_path(), &options, &err));
    assert_is_told(folder_path(), &err);
    assert_non_null(strstr(err.text, "cut.dcm"));
    copy_dicom("series0.dcm", "s0.dcm", SIZE_MAX);
    const size_t size = copy_dicom("series1.dcm", "s1.dcm", SIZE_MAX);
    copy_dicom("series1.dcm", "cut.dcm", size - 100);
    copy_dicom("series2.dcm", "s2.dcm", SIZE_MAX);
    remove(in_folder("s1.dcm"));
    struct sp_volume *volume = sp_volume_load(folder_path(), &options, &err);
    assert_non_null(volume);
    assert_int_equal(sp_volume_info(volume)->grid.dims[2], 2);
    assert_warns_well("folder", volume);
    sp_volume_unref(&volume);
    load_warns("s0.dcm", "Left out 1 file that cannot be read: cut.dcm: ");
    static const char *const left[] = { "cut.dcm", "s0.dcm", "s2.dcm" };
    for (size_t i = 0; i < sizeof left / sizeof *left; i++)
        remove(in_folder(left[i]));
}

/* Files that no reader knows tell what they are and what to do. */
static void packed_and_foreign_files_are_named(void **state) {
    (void)state;
    static const struct {
        const char *name, *start;
        size_t size;
        const char *what, *remedy;
    } files[] = {
        { "a.nii.bz2", "BZh91AY", 7, "packed with bzip2", "unpack it first, with \"bunzip2 a.nii" },
        { "a.nii", "BZh91AY", 7, "packed with bzip2", "bunzip2" },
        { "a.tar.gz", "\37\213\10\0", 4, "tar and gzip", "tar xzf a.tar.gz" },
        { "a.nrrd.gz", "\37\213\10\0", 4, "packed with gzip", "gunzip a.nrrd.gz" },
        { "a.xz", "\3757zXZ\0", 6, "packed with xz", "unxz" },
        { "a.zst", "\50\265\57\375", 4, "packed with Zstandard", "unzstd" },
        { "a.zip", "PK\3\4", 4, "a zip archive", "unzip a.zip" },
        { "a.7z", "7z\274\257\47\34", 6, "a 7z archive", "7z x" },
        { "a.npz", "PK\3\4", 4, "NumPy", "NRRD" },
        { "a.czi", "ZISRAWFILE", 10, "Zeiss", "bfconvert a.czi" },
        { "a.dm4", "\0\0\0\4", 4, "Gatan", "bfconvert a.dm4" },
        { "a.splat", "\1\2\3", 3, "a .splat file", "splat-transform a.splat out.ply" },
        { "a.ksplat", "\0\1", 2, "a .ksplat file", "splat-transform a.ksplat" },
        { "e.hdr", "ENVI\n", 5, "ENVI", "NRRD" },
        { "pair.img", "\1\2\3", 3, "a pair of files", "pair.hdr" },
        { "a.raw", "\1\2\3", 3, "without a header", "a.mhd or .nhdr, or write a sidecar, a.json" },
        { "a.mif", "mrtrix image\n", 13, "MRtrix", "\"mrconvert a.mif out.nii.gz\"" },
        { "a+orig.HEAD", "\ntype = ", 8, "AFNI", "\"3dAFNItoNIFTI a+orig.HEAD\"" },
        { "a+orig.BRIK.gz", "\37\213\10\0", 4, "AFNI", "3dAFNItoNIFTI a+orig.BRIK.gz" },
        { "a.PAR", "# === DATA DESCRIPTION FILE", 27, "Philips", "\"dcm2niix a.PAR\"" },
        { "a.v", "MATRIX70v", 9, "ECAT", "\"medcon -c nifti -f a.v\"" },
        { "a.h33", "!INTERFILE :=", 13, "Interfile", "medcon" },
        { "a.gif", "GIF89a", 6, "a GIF image", "\"magick a.gif out.tif\"" },
        { "a.bmp", "BM", 2, "a BMP image", "\"magick a.bmp out.png\"" },
        { "a.jp2", "\0\0\0\14jP  \r\n\207\n", 12, "JPEG 2000", "\"magick a.jp2 out.tif\"" },
        { "a.xmf", "<?xml version=\"1.0\"?><Xdmf>", 27, "XDMF",
          "\"meshio convert a.xmf out.vtu\"" },
        { "a.dae", "<?xml version=\"1.0\"?><COLLADA>", 30, "COLLADA", "assimp export a.dae" },
        { "a.html", "<!DOCTYPE html><html>", 21, "a web page", "download the file itself" },
        { "a.kml", "<kml></kml>", 11, "XML of the kind <kml>", "<VTKFile>" },
        { "a.gii", "<?xml version=\"1.0\"?><GIFTI>", 29, "GIFTI", "PLY" },
    };
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        char bytes[1024] = { 0 };
        memcpy(bytes, files[i].start, files[i].size);
        write_file(files[i].name, bytes, sizeof bytes);
        load_error(files[i].name, SP_ERR_UNSUPPORTED, files[i].name, files[i].what);
        load_error(files[i].name, SP_ERR_UNSUPPORTED, files[i].name, files[i].remedy);
        remove(in_folder(files[i].name));
    }
    assert_int_equal(mkdir(in_folder("bitmaps"), 0700), 0);
    write_text("bitmaps/b1.bmp", "BM");
    load_error("bitmaps", SP_ERR_UNSUPPORTED, "b1.bmp", "\"magick b1.bmp out.png\"");
}

#define VTI                                                                                        \
    "<VTKFile type=\"ImageData\"><ImageData><Piece Extent=\"0 1 0 0 0 0\"><PointData>"             \
    "<DataArray type=\"UInt8\" Name=\"s\">%d 2</DataArray></PointData></Piece></ImageData>"        \
    "</VTKFile>"

static void choices_that_cannot_be_read_are_named(void **state) {
    (void)state;
    load_error("a.vti?as=", SP_ERR_NOT_FOUND, "a.vti", "\"as=\" needs a value");
    load_error("a.vti?as=time&unit=", SP_ERR_NOT_FOUND, "a.vti", "\"unit=\" needs a value");
    load_error("a.vti?field=", SP_ERR_NOT_FOUND, "a.vti", "\"field=\" needs a value");
    load_error("a.vti?step=1", SP_ERR_NOT_FOUND, "a.vti", "\"step=\" is not known behind '?'");
    load_error("a.vti?unit=mm&unit=um", SP_ERR_NOT_FOUND, "a.vti", "once each");
    load_error("x?as=time.vti", SP_ERR_NOT_FOUND, "x", "\"?as=time.vti\" was read as a choice");
    write_text("hu.vti", VTI, 71);
    load_warns("hu.vti?unit=HU", "no unit of length that is known");
    struct sp_load_options options = importer_options();
    struct sp_error err = { .text = "" };
    assert_null(sp_volume_load("", &options, &err));
    assert_non_null(strstr(err.text, "the name is empty"));
}

static void assert_first(const char *source, uint8_t first) {
    struct sp_volume *volume = load(source);
    assert_int_equal(*(const uint8_t *)sp_volume_voxels(volume), first);
    sp_volume_unref(&volume);
}

static void files_open_whatever_their_names_are(void **state) {
    (void)state;
    static const char *const names[] = { "a*b.vti",   "a?b.vti",         "a:b.vti",
                                         "a#b.vti",   "50%.vti",         "%20%d.vti",
                                         "a&b=c.vti", "it's \"it\".vti", "Größe ä 1.vti",
                                         "a\\b.vti",  "[1].vti",         "-x.vti" };
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        write_text(names[i], VTI, (int)i + 1);
        assert_first(names[i], (uint8_t)(i + 1));
        /* The same name as that of samples beside a header. */
        write_text("one.nhdr",
                   "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 1 1\nencoding: raw\n"
                   "data file: %s\n",
                   names[i]);
        assert_first("one.nhdr", '<');
    }
    /* A '*' stands for numbers, unless a file has this very name. */
    write_text("t1.vti", VTI, 71);
    write_text("t2.vti", VTI, 72);
    struct sp_volume *volume = load("t*.vti");
    assert_int_equal(sp_volume_info(volume)->steps.count, 2);
    sp_volume_unref(&volume);
    write_text("t*.vti", VTI, 73);
    assert_first("t*.vti", 73);
}

static void lists_and_descriptors_are_written_for_readers(void **state) {
    (void)state;
    char text[64] = "has", path[] = "cannot open /proc/self/fd/12: /proc/self/fd/5 is short";
    struct import_list list;
    import_list_begin(&list, text, sizeof text);
    for (int i = 0; i < 10; i++)
        import_list_add(&list, i ? ", " : " ", "a name");
    import_list_end(&list, false);
    assert_string_equal(text, "has a name, a name, a name, a name and 6 more");
    import_list_begin(&list, text, sizeof text);
    import_list_end(&list, true);
    assert_non_null(strstr(text, " and others"));
    write_text("alone.mhd", "ObjectType = Image\nNDims = 3\nDimSize = 2 2 2\n"
                            "ElementType = MET_UCHAR\nElementDataFile = gone.raw\n");
    load_error("alone.mhd", SP_ERR_NOT_FOUND, "gone.raw",
               "alone.mhd names it: put it there, or correct the name");
    import_hide_descriptors(path);
    assert_string_equal(path, "cannot open the file: the file is short");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(errors_of_every_format_tell_a_cause),
        cmocka_unit_test(packed_and_foreign_files_are_named),
        cmocka_unit_test(choices_that_cannot_be_read_are_named),
        cmocka_unit_test(errors_of_cut_dicom_files_tell_a_cause),
        cmocka_unit_test(files_open_whatever_their_names_are),
        cmocka_unit_test(lists_and_descriptors_are_written_for_readers),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
