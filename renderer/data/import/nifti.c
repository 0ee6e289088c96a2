/* SPDX-License-Identifier: Apache-2.0
 *
 * NIfTI-1 and NIfTI-2, in one file (.nii, .nii.gz) or as a header beside its samples (.hdr, .img,
 * which may be .img.gz), and the ANALYZE 7.5 files that NIfTI-1 extends. The parser of the header
 * is our own, because libnifti2 writes beyond its stack for damaged headers. ITK's reader holds a
 * packed file twice, shows bytes of the header as voxels if vox_offset is too small, fills files
 * that are cut off with zeros, and ignores an sform that is not orthogonal.
 *
 *   header ─► nifti_header.c: struct nifti_fields ─► nifti_place.c: grid
 *                                                └► conversion, place of the samples ─► samples.c
 */
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <zlib.h>

#include "data/import/derived.h"
#include "data/import/nifti_header.h"
#include "data/import/samples.h"
#include "data/volume/volume.h"

enum { TYPE_RGB = 128, TYPE_RGBA = 2304, UNIT_MM = 2 };

/* The first bytes that come out of the start of a gzip file. */
static bool unpack_start(const uint8_t *start, size_t size, uint8_t out[4]) {
    z_stream z = { .next_in = (uint8_t *)(uintptr_t)start,
                   .avail_in = (unsigned)size,
                   .next_out = out,
                   .avail_out = 4 };
    if (inflateInit2(&z, 15 + 16) != Z_OK)
        return false;
    inflate(&z, Z_SYNC_FLUSH);
    inflateEnd(&z);
    return z.avail_out == 0;
}

static bool probe(const uint8_t *start, size_t size, const char *title) {
    uint8_t unpacked[4];
    if (import_ends_with(title, ".nii") || import_ends_with(title, ".nii.gz") ||
        import_ends_with(title, ".hdr"))
        return true;
    if (size >= 2 && start[0] == 0x1f && start[1] == 0x8b)
        return unpack_start(start, size, unpacked) && nifti_is_header(unpacked);
    return size >= 4 && nifti_is_header(start);
}

/* Dimensions that the file does not have count as one sample, and so does a length of 0, which some
 * programs write. Dimensions after the time are components. */
static bool check_dims(const struct import_file *file, struct nifti_fields *f,
                       struct import_header *header, struct sp_error *err) {
    const uint64_t at = f->layout->dims;
    if (!(f->dims[0] >= 1 && f->dims[0] <= 7))
        return import_fail(err, SP_ERR_FORMAT, file->title, at, "dim",
                           "%g dimensions are outside [1, 7]", f->dims[0]);
    for (int i = (int)f->dims[0] + 1; i < 8; i++)
        f->dims[i] = 1;
    for (int i = 3; i < 8; i++)
        f->dims[i] = f->dims[i] == 0 ? 1 : f->dims[i];
    for (int axis = 0; axis < 3; axis++) {
        const double count = f->dims[axis + 1];
        if (!(count >= 1 && count <= SP_DIM_MAX))
            return import_fail(err, SP_ERR_FORMAT, file->title, at, "dim",
                               "axis %d has %g samples, outside [1, %u]", axis + 1, count,
                               SP_DIM_MAX);
        header->grid.dims[axis] = (uint32_t)count;
    }
    if (!(f->dims[4] >= 1 && trunc(f->dims[4]) == f->dims[4]))
        return import_fail(
            err, SP_ERR_FORMAT, file->title, at, "dim",
            "the file declares %g time steps; they must be a whole number of at least 1",
            f->dims[4]);
    for (int i = 5; i < 8; i++)
        if (!(f->dims[i] >= 1 && f->dims[i] <= NIFTI_COMPONENTS_MAX &&
              trunc(f->dims[i]) == f->dims[i]))
            return import_fail(err, SP_ERR_FORMAT, file->title, at, "dim",
                               "dimension %d has %g samples, outside [1, %d]", i, f->dims[i],
                               NIFTI_COMPONENTS_MAX);
    f->dims[5] *= f->dims[6] * f->dims[7];
    return f->dims[5] <= NIFTI_COMPONENTS_MAX ||
           import_fail(err, SP_ERR_UNSUPPORTED, file->title, at, "dim",
                       "%g components are more than %d, the limit", f->dims[5],
                       NIFTI_COMPONENTS_MAX);
}

static bool set_steps(const struct import_file *file, const struct nifti_fields *f,
                      struct import_header *header, struct sp_error *err) {
    static const char *const units[8] = { "", "s", "ms", "us", "Hz", "ppm", "rad/s", "" };
    if (!import_header_use_steps(header, file, (uint64_t)fmin(f->dims[4], 1e9), err))
        return false;
    if (f->dims[4] > 1)
        import_header_use_interval(header, f->start, f->pixdim[4], units[f->time_units]);
    return true;
}

static bool find_number(const struct import_file *file, const struct nifti_fields *f,
                        struct import_number *number, struct sp_error *err) {
    static const struct import_number_entry known[] = {
        { NULL, 2, { IMPORT_UNSIGNED, 1 } },        { NULL, 256, { IMPORT_SIGNED, 1 } },
        { NULL, 512, { IMPORT_UNSIGNED, 2 } },      { NULL, 4, { IMPORT_SIGNED, 2 } },
        { NULL, 768, { IMPORT_UNSIGNED, 4 } },      { NULL, 8, { IMPORT_SIGNED, 4 } },
        { NULL, 1280, { IMPORT_UNSIGNED, 8 } },     { NULL, 1024, { IMPORT_SIGNED, 8 } },
        { NULL, 16, { IMPORT_FLOAT, 4 } },          { NULL, 64, { IMPORT_FLOAT, 8 } },
        { NULL, 32, { IMPORT_COMPLEX, 8 } },        { NULL, 1792, { IMPORT_COMPLEX, 16 } },
        { NULL, TYPE_RGB, { IMPORT_UNSIGNED, 1 } }, { NULL, TYPE_RGBA, { IMPORT_UNSIGNED, 1 } },
    };
    return import_number_by_code(known, sizeof known / sizeof *known, f->datatype, number) ||
           import_fail(
               err, SP_ERR_UNSUPPORTED, file->title, f->layout->datatype, "datatype",
               "samples of type %d (%s) are not supported; save them as uint8, int16, int32 "
               "or float32",
               f->datatype,
               f->datatype == 1                             ? "bits"
               : f->datatype == 1536 || f->datatype == 2048 ? "numbers of 16 bytes"
                                                            : "unknown");
}

/* The components of a sample: colours, which alternate in the file, or images one after another.
 * Returns which of these images is read. */
static unsigned choose_component(const struct import_file *file, const struct nifti_fields *f,
                                 struct import_sampled *n, struct import_header *header) {
    const unsigned colors = f->datatype == TYPE_RGB ? 3 : f->datatype == TYPE_RGBA ? 4 : 1;
    const unsigned images = (unsigned)f->dims[5];
    if (colors > 1) {
        if (images > 1)
            import_warn(file->warnings,
                        "Each voxel has %u colours (dimension 5); the first one is shown.", images);
        n->conversion.components = colors;
        n->conversion.component =
            import_meaning_choose_component(file, header, colors, f->as, NULL);
    } else if (images > 1) {
        const unsigned chosen = import_meaning_choose_component(file, header, images, f->as,
                                                                nifti_component_names(file, f));
        /* Behind a statistic are its parameters. */
        const enum sp_meaning meaning = import_intent_of(f->intent).meaning;
        if (meaning == SP_MEANING_LABELS || chosen == 0)
            header->meaning = meaning;
        return chosen;
    } else {
        import_name(header->value_name,
                    f->intent_name[0] ? f->intent_name : import_intent_of(f->intent).name);
        header->meaning = import_intent_of(f->intent).meaning;
    }
    return 0;
}

/* A slope of 0 or no number means that there is none. */
static void set_slope(const struct import_file *file, const struct nifti_fields *f,
                      struct import_conversion *c) {
    double low, high, inter = f->inter;
    if (!isfinite(f->slope) || f->slope == 0 || f->datatype == TYPE_RGB || f->datatype == TYPE_RGBA)
        return;
    if (!isfinite(inter)) {
        import_warn(file->warnings, "scl_inter is no number; it is taken as 0.");
        inter = 0;
    }
    c->slope = f->slope;
    c->offset = inter;
    if (import_number_is_complex(c->number)) { /* of the magnitude */
        c->slope = fabs(f->slope);
        c->offset = 0;
        if (inter != 0)
            import_warn(file->warnings, "scl_inter of complex numbers was ignored.");
    }
    import_number_range(c->number, &low, &high);
    import_conversion_choose(c, low, high);
}

static bool describe_vectors(const struct import_file *file, const struct nifti_fields *f,
                             struct import_sampled *n, struct import_header *header,
                             struct sp_error *err) {
    if (header->steps.count > 1)
        return import_fail(err, SP_ERR_UNSUPPORTED, file->title, f->layout->intent, "intent_code",
                           "vectors with several time steps are not supported; save one step as a "
                           "file");
    n->samples.is_vectors = n->samples.is_planar = true;
    n->samples.bytes *= 3;
    n->samples.conversion =
        n->conversion.slope != 1 || n->conversion.offset != 0 ? &n->conversion : NULL;
    import_header_add_vectors(header, f->intent_name);
    import_header_use_vectors(header, file->field);
    return sp_grid_check(&header->grid, header->type, file->title, &header->bytes, err);
}

/* Which numbers of the file are read, and how they become samples. */
static bool describe(const struct import_file *file, const struct nifti_fields *f,
                     struct import_sampled *n, struct import_header *header, struct sp_error *err) {
    struct import_samples *s = &n->samples;
    struct import_conversion *c = &n->conversion;
    if (!find_number(file, f, &s->number, err))
        return false;
    *c = import_conversion_of(s->number, file->warnings);
    set_slope(file, f, c);
    header->type = c->type;
    if (!sp_grid_check(&header->grid, header->type, file->title, &header->bytes, err))
        return false;
    s->bytes = header->bytes / sp_type_size(header->type) * s->number.size;
    s->big_endian = f->is_swapped == (__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__);
    s->rest = IMPORT_REST_IGNORED; /* some programs write more than they need */
    if (f->as == IMPORT_AS_VECTORS)
        return describe_vectors(file, f, n, header, err);
    const uint64_t images = (uint64_t)f->dims[5], steps = header->steps.count;
    const uint64_t image = choose_component(file, f, n, header);
    s->bytes *= c->components;
    s->conversion = import_conversion_is_copy(c) ? NULL : c;
    return import_samples_choose_block(s, images * steps, image * steps + file->step) ||
           import_fail(err, SP_ERR_FORMAT, file->title, f->layout->dims, "dim",
                       "all samples together are too many: a dimension is wrong");
}

/* The file of the samples has the name of the header with another ending. */
static bool find_samples(const struct import_file *file, const struct nifti_fields *f,
                         struct import_samples *s, struct sp_error *err) {
    if (f->is_single) {
        s->encoding = f->is_packed ? IMPORT_GZIP : IMPORT_RAW;
        return true;
    }
    const char *slash = strrchr(file->title, '/'), *name = slash ? slash + 1 : file->title;
    const int stem = (int)strlen(name) - 4;
    static const char *const endings[] = { ".img", ".img.gz", ".IMG" };
    for (size_t i = 0; i < sizeof endings / sizeof *endings && import_ends_with(name, ".hdr");
         i++) {
        char beside[NAME_MAX + 8], path[PATH_MAX + NAME_MAX + 10];
        snprintf(beside, sizeof beside, "%.*s%s", stem, name, endings[i]);
        snprintf(path, sizeof path, "%s/%s", file->folder, beside);
        s->encoding = i == 1 ? IMPORT_GZIP : IMPORT_RAW;
        if (faccessat(AT_FDCWD, path, F_OK, AT_SYMLINK_NOFOLLOW) == 0)
            return import_samples_add(s, beside, strlen(beside)) ||
                   sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory");
    }
    if (!import_ends_with(name, ".hdr"))
        return import_fail(err, SP_ERR_UNSUPPORTED, file->title, f->layout->magic, "magic",
                           "the samples are in another file, so this header must be called "
                           "NAME.hdr and lie beside NAME.img or NAME.img.gz; unpack or rename it");
    return import_fail(err, SP_ERR_NOT_FOUND, file->title, f->layout->magic, "magic",
                       "the samples are in another file, %.*s.img or .img.gz, which is not there",
                       stem > 0 ? stem : 0, name);
}

/* Where the samples begin. In one file that cannot be inside of the header, whatever it says. */
static bool set_offset(const struct import_file *file, const struct nifti_fields *f,
                       struct import_samples *s, struct sp_error *err) {
    const uint64_t end = (uint64_t)f->layout->size, least = end + NIFTI_SINGLE_START;
    const uint64_t all = s->before_bytes + s->bytes + s->after_bytes;
    if (!(f->offset >= 0 && f->offset <= (double)(INT64_C(1) << 48)))
        return import_fail(err, SP_ERR_FORMAT, file->title, f->layout->offset_at, "vox_offset",
                           "%g is outside [0, 2^48]", f->offset);
    s->skip_bytes = (uint64_t)f->offset;
    if (!f->is_single || s->skip_bytes >= least)
        return true;
    /* The four bytes of extensions are missing if the file ends where samples right after the
     * header end. */
    s->skip_bytes = !f->is_packed && file->size == end + all ? end : least;
    import_warn(file->warnings,
                "vox_offset is %g, inside of the header; the samples are read from byte %d.",
                f->offset, (int)s->skip_bytes);
    return true;
}

/* SPM writes the place of an ANALYZE file into a file of MATLAB beside it. */
static void warn_of_analyze(const struct import_file *file) {
    const char *slash = strrchr(file->title, '/'), *name = slash ? slash + 1 : file->title;
    char beside[NAME_MAX + 8], path[PATH_MAX + NAME_MAX + 10];
    import_warn(file->warnings, "An ANALYZE file does not say where left and right are.");
    if (!import_ends_with(name, ".hdr"))
        return;
    snprintf(beside, sizeof beside, "%.*s.mat", (int)strlen(name) - 4, name);
    snprintf(path, sizeof path, "%s/%s", file->folder, beside);
    if (faccessat(AT_FDCWD, path, F_OK, AT_SYMLINK_NOFOLLOW) == 0)
        import_warn(file->warnings,
                    "The place of the volume is in %.100s, which is not read: position and "
                    "orientation are wrong. Save the image as NIfTI with SPM.",
                    beside);
}

static bool open_nifti(void *reader, const struct import_file *file, struct import_header *header,
                       struct sp_error *err) {
    struct import_sampled *n = reader;
    static const char *const units[8] = { "", "m", "mm", "um", "", "", "", "" };
    struct nifti_fields f = { .layout = NULL };
    n->samples.file = file;
    n->samples.field = "dim";
    if (!nifti_header_read(file, &f, err) || !nifti_check_intent(file, &f, err) ||
        !check_dims(file, &f, header, err) || !nifti_choose_axes(file, &f, header, err) ||
        !set_steps(file, &f, header, err))
        return false;
    nifti_place(file, &f, header);
    nifti_place_vectors(&f, header);
    /* Programs that place a patient without a unit mean mm, and ANALYZE has no other unit. */
    const bool is_mm = f.units == 0 && (header->anatomy[0] || f.is_analyze);
    snprintf(header->unit, sizeof header->unit, "%s", units[is_mm ? UNIT_MM : f.units]);
    if (f.is_analyze)
        warn_of_analyze(file);
    return describe(file, &f, n, header, err) && set_offset(file, &f, &n->samples, err) &&
           find_samples(file, &f, &n->samples, err) && import_samples_check(&n->samples, err);
}

const struct import_format import_nifti = { .name = "NIfTI",
                                            .probe = probe,
                                            .reader_size = sizeof(struct import_sampled),
                                            .open = open_nifti,
                                            .read = import_sampled_read,
                                            .close = import_sampled_close };
