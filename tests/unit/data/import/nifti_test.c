/* SPDX-License-Identifier: Apache-2.0
 *
 * NIfTI files that this test writes with the structures of nifti1.h and nifti2.h. The expected
 * transforms follow the formulas in those headers.
 */
#include <math.h>
#include <nifti1.h>
#include <nifti2.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/samples.h"
#include "unit/data/import/support.h"

enum { NX = 5, NY = 4, NZ = 3, COUNT = NX * NY * NZ };

static nifti_1_header header_of(short datatype, short bits) {
    nifti_1_header h = { .sizeof_hdr = sizeof h,
                         .dim = { 3, NX, NY, NZ, 1, 1, 1, 1 },
                         .datatype = datatype,
                         .bitpix = bits,
                         .pixdim = { 1, 2, 3, 4, 0, 0, 0, 0 },
                         .vox_offset = 352,
                         .xyzt_units = NIFTI_UNITS_MM };
    memcpy(h.magic, "n+1", 4);
    return h;
}

/* Writes the header, four bytes that announce no extensions, and the samples. */
static void write_nifti(const char *name, const nifti_1_header *h, const void *samples,
                        size_t size) {
    char *file = calloc(1, 352 + size);
    memcpy(file, h, sizeof *h);
    memcpy(file + 352, samples, size);
    size_t packed, n = strlen(name);
    if (n > 3 && strcmp(name + n - 3, ".gz") == 0) {
        void *bytes = gzip(file, 352 + size, &packed);
        write_file(name, bytes, packed);
        free(bytes);
    } else {
        write_file(name, file, 352 + size);
    }
    free(file);
}

static void swap_header(nifti_1_header *h) {
    import_swap(&h->sizeof_hdr, 4, 1);
    import_swap(h->dim, 2, 8);
    import_swap(&h->datatype, 2, 1);
    import_swap(&h->bitpix, 2, 1);
    import_swap(h->pixdim, 4, 8);
    import_swap(&h->vox_offset, 4, 1);
    import_swap(&h->scl_slope, 4, 2);
    import_swap(&h->qform_code, 2, 2);
    import_swap(&h->quatern_b, 4, 6);
    import_swap(h->srow_x, 4, 12);
}

static void every_type_and_byte_order_is_read(void **state) {
    (void)state;
    static const struct {
        enum sp_type type;
        short code;
    } types[] = { { SP_UINT8, DT_UINT8 },    { SP_INT8, DT_INT8 },   { SP_UINT16, DT_UINT16 },
                  { SP_INT16, DT_INT16 },    { SP_INT32, DT_INT32 }, { SP_FLOAT32, DT_FLOAT32 },
                  { SP_FLOAT64, DT_FLOAT64 } };
    for (size_t t = 0; t < sizeof types / sizeof *types; t++)
        for (int variant = 0; variant < 4; variant++) {
            const bool is_swapped = variant & 1, is_packed = variant & 2;
            const size_t size = sp_type_size(types[t].type);
            double samples[COUNT];
            nifti_1_header h = header_of(types[t].code, (short)(8 * size));
            make_ramp(types[t].type, COUNT, samples);
            if (is_swapped) {
                import_swap(samples, size, COUNT);
                swap_header(&h);
            }
            write_nifti(is_packed ? "a.nii.gz" : "a.nii", &h, samples, COUNT * size);
            struct sp_volume *volume = load(is_packed ? "a.nii.gz" : "a.nii");
            assert_int_equal(sp_volume_info(volume)->type, types[t].type);
            assert_string_equal(sp_volume_info(volume)->unit, "mm");
            assert_is_ramp(volume, COUNT);
            sp_volume_unref(&volume);
        }
}

static void check_grid(const char *name, const double spacing[3], const double origin[3],
                       double direction[3][3], const char *anatomy) {
    struct sp_volume *volume = load(name);
    const struct sp_volume_info *info = sp_volume_info(volume);
    for (int a = 0; a < 3; a++) {
        assert_compare(fabs(info->grid.spacing[a] - spacing[a]), <=, 1e-6);
        assert_compare(fabs(info->grid.origin[a] - origin[a]), <=, 1e-5);
        for (int r = 0; r < 3; r++)
            assert_compare(fabs(info->grid.direction[r][a] - direction[r][a]), <=, 1e-6);
    }
    assert_string_equal(info->anatomy, anatomy);
    sp_volume_unref(&volume);
}

static void assert_unit(const char *name, const char *unit) {
    struct sp_volume *volume = load(name);
    assert_string_equal(sp_volume_info(volume)->unit, unit);
    sp_volume_unref(&volume);
}

static void the_grid_is_that_of_sform_qform_or_pixdim(void **state) {
    (void)state;
    uint8_t samples[COUNT] = { 0 };
    nifti_1_header h = header_of(DT_UINT8, 8);
    write_nifti("plain.nii", &h, samples, sizeof samples);
    check_grid("plain.nii", (double[]){ 2, 3, 4 }, (double[]){ 0, 0, 0 },
               (double[3][3]){ { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } }, "");
    assert_unit("plain.nii", "mm");
    h.xyzt_units = 0;
    write_nifti("none.nii", &h, samples, sizeof samples);
    assert_unit("none.nii", "");
    /* A quarter turn about z; qfac −1 reverses the third axis. */
    h.qform_code = NIFTI_XFORM_SCANNER_ANAT;
    h.quatern_d = (float)sqrt(0.5);
    h.qoffset_x = 10;
    h.qoffset_y = 20;
    h.qoffset_z = 30;
    h.pixdim[0] = -1;
    write_nifti("q.nii", &h, samples, sizeof samples);
    check_grid("q.nii", (double[]){ 2, 3, 4 }, (double[]){ 10, 20, 30 },
               (double[3][3]){ { 0, -1, 0 }, { 1, 0, 0 }, { 0, 0, -1 } }, "RAS");
    assert_unit("q.nii", "mm"); /* without a unit in the file */
    /* The sform counts more than the qform. */
    h.sform_code = NIFTI_XFORM_MNI_152;
    memcpy(h.srow_x, (float[]){ -2, 0, 0, 90 }, sizeof h.srow_x);
    memcpy(h.srow_y, (float[]){ 0, 0, 4, -126 }, sizeof h.srow_y);
    memcpy(h.srow_z, (float[]){ 0, 3, 0, -72 }, sizeof h.srow_z);
    write_nifti("s.nii", &h, samples, sizeof samples);
    check_grid("s.nii", (double[]){ 2, 3, 4 }, (double[]){ 90, -126, -72 },
               (double[3][3]){ { -1, 0, 0 }, { 0, 0, 1 }, { 0, 1, 0 } }, "RAS");
}

static void check_samples(const char *name, enum sp_type type, const double *expected,
                          size_t count) {
    struct sp_volume *volume = load(name);
    const void *voxels = sp_volume_voxels(volume);
    const struct import_number number = import_number_of(type);
    assert_int_equal(sp_volume_info(volume)->type, type);
    for (size_t i = 0; i < count; i++)
        assert_compare(
            fabs(import_widen((const char *)voxels + i * number.size, number) - expected[i]), <=,
            1e-6 * fabs(expected[i]));
    sp_volume_unref(&volume);
}

static void samples_are_rescaled(void **state) {
    (void)state;
    int16_t samples[COUNT] = { -1024, 0, 3071, 32767, -32768 };
    nifti_1_header h = header_of(DT_INT16, 16);
    h.scl_slope = 1;
    h.scl_inter = -24;
    write_nifti("whole.nii", &h, samples, sizeof samples);
    check_samples("whole.nii", SP_INT32, (double[]){ -1048, -24, 3047, 32743, -32792 }, 5);
    h.scl_slope = 0.5f;
    write_nifti("half.nii", &h, samples, sizeof samples);
    check_samples("half.nii", SP_FLOAT32, (double[]){ -536, -24, 1511.5, 16359.5, -16408 }, 5);
    h.scl_slope = 0; /* no scaling */
    write_nifti("none.nii", &h, samples, sizeof samples);
    check_samples("none.nii", SP_INT16, (double[]){ -1024, 0, 3071, 32767, -32768 }, 5);
    uint32_t large[COUNT] = { 0, 4294967295u };
    h = header_of(DT_UINT32, 32);
    write_nifti("large.nii", &h, large, sizeof large);
    check_samples("large.nii", SP_FLOAT64, (double[]){ 0, 4294967295.0 }, 2);
}

static void components_are_fields(void **state) {
    (void)state;
    uint8_t colors[3 * COUNT];
    for (int i = 0; i < 3 * COUNT; i++)
        colors[i] = (uint8_t)i;
    nifti_1_header h = header_of(DT_RGB24, 24);
    write_nifti("rgb.nii", &h, colors, sizeof colors);
    check_samples("rgb.nii", SP_UINT8, (double[]){ 0, 3, 6 }, 3);
    check_samples("rgb.nii?field=blue", SP_UINT8, (double[]){ 2, 5, 8 }, 3);
    struct sp_volume *volume = load("rgb.nii?field=green");
    assert_string_equal(sp_volume_info(volume)->value_name, "green");
    assert_string_equal(sp_volume_info(volume)->others[0], "red");
    assert_string_equal(sp_volume_info(volume)->others[1], "blue");
    sp_volume_unref(&volume);
    load_error("rgb.nii?field=alpha", SP_ERR_NOT_FOUND, "rgb.nii", "red, green, blue");
    h = header_of(DT_UINT8, 8);
    h.dim[0] = 5;
    h.dim[5] = 3;
    write_nifti("three.nii", &h, colors, sizeof colors);
    check_samples("three.nii?field=component 2", SP_UINT8, (double[]){ COUNT, COUNT + 1 }, 2);
}

static void vectors_are_read(void **state) {
    (void)state;
    int16_t samples[3 * COUNT];
    make_ramp(SP_INT16, 3 * COUNT, samples);
    nifti_1_header h = header_of(DT_INT16, 16);
    h.dim[0] = 5;
    h.dim[5] = 3;
    h.intent_code = NIFTI_INTENT_VECTOR;
    write_nifti("v.nii", &h, samples, sizeof samples);
    struct sp_volume *volume = load("v.nii");
    assert_are_vectors(volume, SP_INT16, true);
    sp_volume_unref(&volume);
}

static void a_header_finds_its_samples(void **state) {
    (void)state;
    uint8_t samples[COUNT];
    size_t packed;
    nifti_1_header h = header_of(DT_UINT8, 8);
    memcpy(h.magic, "ni1", 4);
    h.vox_offset = 0;
    make_ramp(SP_UINT8, COUNT, samples);
    write_file("pair.hdr", &h, sizeof h);
    load_error("pair.hdr", SP_ERR_NOT_FOUND, "pair.hdr", "pair.img or .img.gz");
    void *bytes = gzip(samples, sizeof samples, &packed);
    write_file("pair.img.gz", bytes, packed);
    free(bytes);
    struct sp_volume *volume = load("pair.hdr");
    assert_is_ramp(volume, COUNT);
    sp_volume_unref(&volume);
    write_file("pair.img", samples, sizeof samples);
    volume = load("pair.hdr");
    assert_is_ramp(volume, COUNT);
    sp_volume_unref(&volume);
}

static void version_two_is_read(void **state) {
    (void)state;
    nifti_2_header h = { .sizeof_hdr = sizeof h,
                         .dim = { 3, NX, NY, NZ, 1, 1, 1, 1 },
                         .datatype = DT_UINT8,
                         .bitpix = 8,
                         .pixdim = { 1, 2, 3, 4, 0, 0, 0, 0 },
                         .vox_offset = 544 };
    memcpy(h.magic, "n+2\0\r\n\032\n", 8);
    uint8_t file[544 + COUNT] = { 0 };
    make_ramp(SP_UINT8, COUNT, file + 544);
    h.dim[0] = 4;
    h.dim[4] = UINT32_MAX;
    h.intent_code = 1007; /* the entries of a vector */
    memcpy(file, &h, sizeof h);
    write_file("two.nii", file, sizeof file);
    load_error("two.nii", SP_ERR_UNSUPPORTED, "dim", "4294967295 components are more than 65536");
    h.dim[0] = 3;
    h.dim[4] = 1;
    h.intent_code = 0;
    memcpy(file, &h, sizeof h);
    write_file("two.nii", file, sizeof file);
    struct sp_volume *volume = load("two.nii");
    assert_is_ramp(volume, COUNT);
    assert_compare(fabs(sp_volume_info(volume)->grid.spacing[2] - 4), <=, 1e-9);
    sp_volume_unref(&volume);
}

static void bad_files_are_refused(void **state) {
    (void)state;
    uint8_t samples[COUNT] = { 0 };
    nifti_1_header h = header_of(DT_UINT8, 8);
    write_nifti("short.nii", &h, samples, COUNT - 1);
    load_error("short.nii", SP_ERR_FORMAT, "dim", "it is cut off");
    h.dim[0] = 4;
    h.dim[4] = 7;
    write_nifti("time.nii", &h, samples, sizeof samples);
    load_error("time.nii", SP_ERR_FORMAT, "dim", "it is cut off");
    h = header_of(DT_BINARY, 1);
    write_nifti("bits.nii", &h, samples, sizeof samples);
    load_error("bits.nii", SP_ERR_UNSUPPORTED, "datatype", "type 1 (bits)");
    h = header_of(DT_UINT8, 8);
    h.dim[1] = h.dim[2] = h.dim[3] = 2000;
    write_nifti("huge.nii", &h, samples, sizeof samples);
    load_error("huge.nii", SP_ERR_FORMAT, "dim", "it is cut off");
    h.dim[0] = 99;
    write_nifti("dims.nii", &h, samples, sizeof samples);
    load_error("dims.nii", SP_ERR_FORMAT, "", "outside [1, 7]");
    write_text("text.nii", "not an image");
    load_error("text.nii", SP_ERR_FORMAT, "sizeof_hdr", "348 or 540");
    /* A file with another ending is recognised by its content. */
    h = header_of(DT_UINT8, 8);
    make_ramp(SP_UINT8, COUNT, samples);
    write_nifti("named.wrong", &h, samples, sizeof samples);
    struct sp_volume *volume = load("named.wrong");
    assert_is_ramp(volume, COUNT);
    sp_volume_unref(&volume);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_type_and_byte_order_is_read),
        cmocka_unit_test(the_grid_is_that_of_sform_qform_or_pixdim),
        cmocka_unit_test(samples_are_rescaled),
        cmocka_unit_test(components_are_fields),
        cmocka_unit_test(vectors_are_read),
        cmocka_unit_test(a_header_finds_its_samples),
        cmocka_unit_test(version_two_is_read),
        cmocka_unit_test(bad_files_are_refused),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
