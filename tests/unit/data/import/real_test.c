/* SPDX-License-Identifier: Apache-2.0
 *
 * Compares real volumes with the SHA-256 of their samples. The checksum is in the header of the
 * NRRD file, or was recorded here when another program read the file.
 */
#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "unit/data/import/support.h"

/* Runs sha256sum of coreutils on a temporary file with these bytes. */
static void sha256(const void *bytes, size_t size, char out[65]) {
    write_file("samples", bytes, size);
    char command[600];
    snprintf(command, sizeof command, "sha256sum %s", in_folder("samples"));
    FILE *pipe = popen(command, "r");
    assert_non_null(pipe);
    assert_int_equal(fread(out, 1, 64, pipe), 64);
    out[64] = 0;
    pclose(pipe);
}

static bool header_sha256(const char *path, char out[65]) {
    char text[4097];
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    text[fread(text, 1, sizeof text - 1, file)] = 0;
    fclose(file);
    const char *at = strstr(text, "\nraw_sha256:=");
    if (at)
        snprintf(out, 65, "%s", at + 13);
    return at != NULL;
}

static struct sp_volume *load_real(const char *path) {
    struct sp_load_options options = importer_options();
    struct sp_error err;
    struct sp_volume *volume = sp_volume_load(path, &options, &err);
    if (!volume)
        fail_msg("%s: %s [%s]", path, err.text, err.place);
    return volume;
}

static void nrrd_samples_match_the_checksum_in_the_header(void **state) {
    (void)state;
    DIR *folder = opendir(SPLATD_DATA_DIR "/volumes");
    int checked = 0;
    assert_non_null(folder);
    for (const struct dirent *entry; (entry = readdir(folder));) {
        char path[1024], expected[65], actual[65];
        const char *dot = strrchr(entry->d_name, '.');
        if (!dot || strcmp(dot, ".nrrd") != 0)
            continue;
        snprintf(path, sizeof path, "%s/volumes/%s", SPLATD_DATA_DIR, entry->d_name);
        if (!header_sha256(path, expected))
            continue;
        struct sp_volume *volume = load_real(path);
        sha256(sp_volume_voxels(volume), sp_volume_info(volume)->voxel_bytes, actual);
        sp_volume_unref(&volume);
        if (strcmp(actual, expected) != 0)
            fail_msg("%s: the checksum is %s, not %s", path, actual, expected);
        checked++;
    }
    closedir(folder);
    print_message("%d volumes checked\n", checked);
    assert_compare(checked, >=, 5); /* engine, bonsai, lobster, aneurism, cthead */
}

static void known_files_have_the_recorded_contents(void **state) {
    (void)state;
    static const struct {
        const char *path;
        enum sp_type type;
        uint32_t dims[3];
        double spacing[3], origin[3], range[2];
        const char *unit, *sha256;
    } files[] = {
        { "volumes/engine_256x256x128_uint8.nrrd",
          SP_UINT8,
          { 256, 256, 128 },
          { 1, 1, 1 },
          { 0, 0, 0 },
          { 0, 255 },
          "",
          NULL },
        { "volumes/bonsai_256x256x256_uint8.nrrd",
          SP_UINT8,
          { 256, 256, 256 },
          { 1, 1, 1 },
          { 0, 0, 0 },
          { 0, 255 },
          "",
          NULL },
        { "volumes/lobster_301x324x56_uint8.nrrd",
          SP_UINT8,
          { 301, 324, 56 },
          { 1, 1, 1.4 },
          { 0, 0, 0 },
          { 0, 255 },
          "",
          NULL },
        { "volumes/aneurism_256x256x256_uint8.nrrd",
          SP_UINT8,
          { 256, 256, 256 },
          { 1, 1, 1 },
          { 0, 0, 0 },
          { 0, 255 },
          "",
          NULL },
        { "volumes/cthead_256x256x113_uint16.nrrd",
          SP_UINT16,
          { 256, 256, 113 },
          { 1, 1, 2 },
          { 0, 0, 0 },
          { 0, 3272 },
          "",
          NULL },
        { "formats/nrrd/seed.nhdr",
          SP_INT16,
          { 256, 256, 55 },
          { 0.9375, 0.9375, 3 },
          { -119.531, 98.0435, -66.3661 },
          { 0, 1 },
          "",
          "f640d0bab132b7939993eee469f38c06bb96692da5542b45ed1e43703d6e3ca5" },
        { "formats/nrrd/stent_gzip_float.nrrd",
          SP_FLOAT32,
          { 128, 128, 256 },
          { 1, 1, 1 },
          { 0, 0, 0 },
          { 0, 1 },
          "",
          "333419669702cb240a0ac8b00ce2e4b1a962cae5ffb92f6d898fde94fe677bff" },
        { "formats/nifti/mni_icbm152_t1_2009a.nii.gz", /* nibabel 5 */
          SP_UINT8,
          { 197, 233, 189 },
          { 1, 1, 1 },
          { -98, -134, -72 },
          { 0, 255 },
          "mm",
          "93f07d06eb443f305f93ecce3d695d2c02c1928dde60047fec3144656f4b55f7" },
        { "formats/metaimage/HeadMRVolume.mhd", /* ITK 5 */
          SP_UINT8,
          { 48, 62, 42 },
          { 4, 4, 4 },
          { 0, 0, 0 },
          { 0, 255 },
          "mm", /* the unit of MetaImage where the header has none */
          "714ff5b2db59d3867675d0f2419c24a71ed234985b39dc1ea83ee7d72110de4b" },
        { "formats/dicom/CTHeadAxialDicom/CTHead50.dcm", /* pydicom 3 */
          SP_INT16,
          { 64, 64, 93 },
          { 3.2, 3.2, 1.5 },
          { 0, 0, 0 },
          { 0, 3926 },
          "mm",
          "4d30350342868370cb73681302a554fe6500c7f2560e072144614e5c3fd1ac94" },
        { "formats/vdb/smoke.vdb", /* OpenVDB 10 */
          SP_FLOAT32,
          { 111, 222, 112 },
          { 0.4761905, 0.4761905, 0.4761905 },
          { -33.571428, -12.142857, -25.952381 },
          { 0, 5.71484375 },
          "",
          "d169b485322974f559e87f4b39fb2b0b76c4e9b564fe3a7055528faad0dcef4b" },
        { "formats/vdb/bonsai_small_blosc.vdb", /* OpenVDB 10 */
          SP_FLOAT32,
          { 91, 197, 256 },
          { 1, 1, 1 },
          { 0, 0, 0 },
          { 0, 1 },
          "",
          "106d542b2fcc4aad30732ccb5058e2e20368aa0b39e98e86fcc2754ceaf16ab1" },
        { "formats/tiff/flybrain.tif",
          SP_UINT8,
          { 256, 256, 57 },
          { 2.6755208, 2.6755208, 3.9473684 },
          { 0, 0, 0 },
          { 0, 165 },
          "um",
          "b0948ec5156b72bef7f7492374a1ac504b88b84676cd61e72a8b8f17f3cca9f9" },
        { "formats/tiff/mini-t1-head_bigendian.tif",
          SP_UINT16,
          { 32, 32, 32 },
          { 1.5, 1.5, 1.5 },
          { 0, 0, 0 },
          { 0, 421 },
          "mm",
          "7035aa787b5d98a90a388e324bcdc76f4452ffd8c7fe56632407b14940886043" },
        { "formats/vtk/RectGrid2.vtk",
          SP_FLOAT32,
          { 47, 33, 11 },
          { 0.052083478, 0.078125, 0.09 },
          { -1.22396, -1.25, 0 },
          { 0, 10.3964005 },
          "",
          "0472736127623a3bdfbce22286c066d859f5ff19fdf898d9614774fc0b2a491f" },
        { "formats/vtk/carotid.vtk",
          SP_FLOAT32,
          { 76, 49, 45 },
          { 1, 1, 1 },
          { 100, 80, 1 },
          { 0, 580 },
          "",
          "9a675d4040f6ce60e8b37deda7d615912c1567c9a2d9d82e9ea5c5fcb03d8d54" },
        { "formats/vtk/heart.vtk",
          SP_FLOAT32,
          { 32, 32, 12 },
          { 1, 1, 4 },
          { 0, 0, 0 },
          { 0, 255 },
          "",
          "ed975e948820aa4c387e65602f12c0b6f87f1e79573046b337e60c58a918e06d" },
        { "formats/vti/heart.vti",
          SP_FLOAT32,
          { 32, 32, 12 },
          { 1, 1, 4 },
          { 0, 0, 0 },
          { 0, 255 },
          "",
          "ed975e948820aa4c387e65602f12c0b6f87f1e79573046b337e60c58a918e06d" },
        { "formats/vti/engine_zlib_appended.vti",
          SP_UINT8,
          { 256, 256, 128 },
          { 1, 1, 1 },
          { 0, 0, 0 },
          { 0, 255 },
          "",
          "15cf29cdde69cd6c8b5ab9eeef4d1bb21f276056da4111cb5069ebfbe5b6ff90" },
        { "formats/vti/isabel_02.vti",
          SP_FLOAT64,
          { 125, 125, 25 },
          { 4.0080321286, 4.0080321286, 4.0408163266 },
          { 0, 0, 0 },
          { 0, 68.2454776917825 },
          "",
          "f626212a67175dca1f7a79c93a8ad5fdf4500aad62c8e5051ad76ca75e09f9e5" },
    };
    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
        char path[1024], actual[65];
        snprintf(path, sizeof path, "%s/%s", SPLATD_DATA_DIR, files[i].path);
        if (access(path, R_OK) != 0) {
            print_message("skipped: %s does not exist\n", path);
            continue;
        }
        struct sp_volume *volume = load_real(path);
        const struct sp_volume_info *info = sp_volume_info(volume);
        assert_int_equal(info->type, files[i].type);
        for (int a = 0; a < 3; a++) {
            assert_int_equal(info->grid.dims[a], files[i].dims[a]);
            assert_float_equal(info->grid.spacing[a], files[i].spacing[a], 1e-5);
            assert_float_equal(info->grid.origin[a], files[i].origin[a], 1e-9);
        }
        for (int r = 0; r < 2; r++)
            assert_float_equal(info->range[r], files[i].range[r], 1e-5);
        assert_string_equal(info->unit, files[i].unit);
        if (files[i].sha256) {
            sha256(sp_volume_voxels(volume), info->voxel_bytes, actual);
            if (strcmp(actual, files[i].sha256) != 0)
                fail_msg("%s: the checksum is %s, not %s", path, actual, files[i].sha256);
        }
        if (strstr(path, "seed")) {
            assert_compare(info->grid.direction[1][1], ==, -1);
        }
        bool rectilinear = strstr(path, "RectGrid2") != NULL;
        for (int a = 0; a < 3; a++)
            assert_int_equal(info->grid.coordinates[a] != NULL, rectilinear);
        if (rectilinear) {
            assert_float_equal(info->grid.coordinates[2][7], 0.7, 1e-7);
            assert_float_equal(info->grid.coordinates[2][8], 0.75, 1e-7);
        }
        /* The longest vector, as VTK 9.7 reads it. */
        double longest = rectilinear ? 10.3964 : strstr(path, "carotid") ? 22.6949 : 0;
        assert_float_equal(info->longest, longest, 1e-4);
        sp_volume_unref(&volume);
    }
}

static void structured_grids_are_points(void **state) {
    (void)state;
    const char *path = SPLATD_DATA_DIR "/formats/vtk/SampleStructGrid.vtk";
    if (access(path, R_OK) != 0) {
        print_message("skipped: %s does not exist\n", path);
        skip();
    }
    struct sp_load_options options = importer_options();
    struct sp_volume *volume = sp_volume_load(path, &options, NULL);
    assert_non_null(volume);
    const struct sp_elements_shape *shape = &sp_volume_info(volume)->elements;
    assert_int_equal(shape->kind, SP_KIND_POINTS);
    assert_int_equal(shape->count, 20 * 30 * 40);
    sp_volume_unref(&volume);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nrrd_samples_match_the_checksum_in_the_header),
        cmocka_unit_test(known_files_have_the_recorded_contents),
        cmocka_unit_test(structured_grids_are_points),
    };
    if (access(SPLATD_DATA_DIR "/volumes", R_OK) != 0) {
        printf("skipped: no real volumes in " SPLATD_DATA_DIR "\n");
        return 77;
    }
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
