/* SPDX-License-Identifier: Apache-2.0
 *
 * What the fourth and the fifth dimension of a NIfTI file mean. The intent code says it, or the
 * source; but the tools of FSL write directions as three volumes without any code, as if they were
 * steps in time.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>
#include <zlib.h>

#include "data/import/nifti_header.h"
#include "data/import/number.h"
#include "data/volume/grid.h"

enum { TYPE_BYTE = 2, TYPE_FLOAT = 16, TYPE_DOUBLE = 64, TYPE_RGB = 128, TYPE_RGBA = 2304 };

/* True for "dti_V1.nii.gz": FSL's dtifit calls the directions V1, V2 and V3. */
static bool has_name_of_directions(const char *title) {
    const char *slash = strrchr(title, '/'), *name = slash ? slash + 1 : title;
    const char *dot = strcasestr(name, ".nii");
    return dot && dot - name >= 2 && dot[-2] == 'V' && strchr("123", dot[-1]) &&
           (dot - name == 2 || dot[-3] == '_');
}

static bool has_name_of_tensor(const char *title) {
    const char *slash = strrchr(title, '/'), *name = slash ? slash + 1 : title;
    const char *dot = strcasestr(name, ".nii");
    return dot && dot - name >= 6 && strncasecmp(dot - 6, "tensor", 6) == 0;
}

/* Adds the squares of one volume to the sums of squares. */
static bool add_squares(gzFile stream, const struct nifti_fields *f, float *squares,
                        uint64_t count) {
    enum { RUN = 4096 };
    const struct import_number number = { IMPORT_FLOAT, f->datatype == TYPE_FLOAT ? 4 : 8 };
    const bool has_slope = isfinite(f->slope) && f->slope != 0;
    const double slope = has_slope ? f->slope : 1;
    const double inter = has_slope && isfinite(f->inter) ? f->inter : 0;
    char run[RUN * sizeof(double)];
    for (uint64_t at = 0; at < count;) {
        const size_t n = count - at < RUN ? (size_t)(count - at) : RUN;
        if (gzread(stream, run, (unsigned)(n * number.size)) != (int)(n * number.size))
            return false;
        if (f->is_swapped)
            import_swap(run, number.size, n);
        for (size_t i = 0; i < n; i++) {
            const float value =
                (float)(slope * import_widen(run + i * number.size, number) + inter);
            squares[at + i] += value * value;
        }
        at += n;
    }
    return true;
}

/* True if the three volumes of the file are the components of unit vectors. Reads all of them. */
static bool are_directions(const struct import_file *file, const struct nifti_fields *f) {
    const double most = 1 << 26, samples = f->dims[1] * f->dims[2] * f->dims[3];
    const double least = (double)f->layout->size + NIFTI_SINGLE_START;
    if (!f->is_single || !(samples <= most) || !(f->offset <= INT32_MAX))
        return false;
    const uint64_t count = (uint64_t)samples;
    const uint64_t start = (uint64_t)fmax(f->offset, least);
    float *squares = calloc(count, sizeof *squares);
    const int fd = lseek(file->fd, 0, SEEK_SET) == 0 ? dup(file->fd) : -1;
    gzFile stream = squares && fd >= 0 ? gzdopen(fd, "rb") : NULL;
    bool ok = stream && gzseek(stream, (z_off_t)start, SEEK_SET) == (z_off_t)start;
    for (int i = 0; i < 3 && ok; i++)
        ok = add_squares(stream, f, squares, count);
    if (stream)
        gzclose_r(stream);
    else if (fd >= 0)
        close(fd);
    ok = ok && import_meaning_are_directions(squares, count);
    free(squares);
    return ok;
}

/* What three volumes of real numbers are, of which the file says nothing. */
static enum import_as guess(const struct import_file *file, struct nifti_fields *f) {
    const bool is_named = has_name_of_directions(file->title);
    if (f->dims[4] != 3 || (f->datatype != TYPE_FLOAT && f->datatype != TYPE_DOUBLE) ||
        f->intent != 0 || (!is_named && !are_directions(file, f)))
        return IMPORT_AS_TIME;
    f->are_fsl = is_named;
    if (file->selection.as == IMPORT_AS_FILE && !is_named)
        import_warn(file->warnings,
                    "The three volumes are unit vectors along the axes of the world, although the "
                    "file does not say so. ?as=time reads them as time steps.");
    return IMPORT_AS_VECTORS;
}

/* What the file says about the entries of the dimension that holds them. */
static enum import_as meaning_of(const struct import_file *file, struct nifti_fields *f,
                                 uint64_t entries, bool is_fifth) {
    const enum import_as said = import_intent_of(f->intent).as;
    const bool is_number = f->datatype != 32 && f->datatype != 1792;
    const bool are_bytes = f->datatype == TYPE_BYTE && said == IMPORT_AS_VECTORS;
    if ((are_bytes || said == IMPORT_AS_RGB) && (entries == 3 || entries == 4))
        return IMPORT_AS_RGB; /* SimpleITK calls colours a vector */
    if (said == IMPORT_AS_VECTORS && entries == 3 && is_number) {
        f->are_fsl = f->intent == IMPORT_INTENT_FNIRT;
        return IMPORT_AS_VECTORS;
    }
    if (is_fifth || said == IMPORT_AS_VECTORS || said == IMPORT_AS_RGB)
        return said == IMPORT_AS_TIME && f->dims[4] == 1 ? IMPORT_AS_TIME : IMPORT_AS_CHANNELS;
    if (entries == 6 && has_name_of_tensor(file->title))
        return IMPORT_AS_CHANNELS;
    return guess(file, f);
}

bool nifti_check_intent(const struct import_file *file, const struct nifti_fields *f,
                        struct sp_error *err) {
    const struct import_intent intent = import_intent_of(f->intent);
    const bool is_cifti = f->intent >= 3000;
    if (intent.refusal)
        return import_fail(
            err, SP_ERR_UNSUPPORTED, file->title, f->layout->intent, "intent_code",
            "the file holds %s (intent %d%s%s), which is no volume; %s", intent.refusal, f->intent,
            f->intent_name[0] ? ", " : "", f->intent_name,
            is_cifti ? "write its voxels with \"wb_command -cifti-separate FILE COLUMN -volume-all "
                       "OUT.nii.gz\""
                     : "save it as VTK, PLY or OBJ");
    if (intent.warning)
        import_warn(file->warnings,
                    "The samples are %s (intent %d); the field itself is made of them by FSL.",
                    intent.warning, f->intent);
    return true;
}

/* Time that is none. */
static void warn_of_frequency(const struct import_file *file, const struct nifti_fields *f) {
    static const char *const names[8] = { [4] = "a frequency in Hz",
                                          [5] = "a chemical shift in ppm",
                                          [6] = "an angular frequency in rad/s" };
    if (f->dims[4] > 1 && names[f->time_units])
        import_warn(file->warnings,
                    "The fourth axis is %s, not time; its %.0f entries are shown as steps.",
                    names[f->time_units], f->dims[4]);
}

bool nifti_choose_axes(const struct import_file *file, struct nifti_fields *f,
                       struct import_header *header, struct sp_error *err) {
    const bool are_colors = f->datatype == TYPE_RGB || f->datatype == TYPE_RGBA;
    const bool is_fifth = f->dims[5] > 1, has_both = f->dims[4] > 1 && (is_fifth || are_colors);
    struct import_extra extra = { .count = (uint64_t)fmin(is_fifth ? f->dims[5] : f->dims[4], 1e9),
                                  .are_parts = has_both };
    const enum import_as wanted = file->selection.as;
    if (are_colors) {
        extra.count = f->datatype == TYPE_RGB ? 3 : 4;
        extra.are_parts = true; /* bytes of a colour are no steps and no vectors */
        extra.meaning = IMPORT_AS_RGB;
        return import_meaning_choose(file, &extra, header, &f->as, err);
    }
    if (extra.count > 1)
        extra.meaning = meaning_of(file, f, extra.count, is_fifth);
    if (!import_meaning_choose(file, &extra, header, &f->as, err))
        return false;
    if (wanted == IMPORT_AS_VECTORS)
        f->are_fsl = f->intent == IMPORT_INTENT_FNIRT || has_name_of_directions(file->title);
    if (f->as == IMPORT_AS_VECTORS && f->intent == IMPORT_INTENT_FNIRT)
        import_warn(file->warnings,
                    "The vectors are taken as relative displacements of FSL's FNIRT. If the field "
                    "is absolute, they are coordinates; convertwarp --relout makes it relative.");
    if (!is_fifth && f->as != IMPORT_AS_TIME && f->dims[4] > NIFTI_COMPONENTS_MAX)
        return import_fail(err, SP_ERR_UNSUPPORTED, file->title, f->layout->dims, "dim",
                           "%.0f components are more than %d, the limit", f->dims[4],
                           NIFTI_COMPONENTS_MAX);
    if (!is_fifth && f->as != IMPORT_AS_TIME && f->dims[4] > 1) {
        f->dims[5] = f->dims[4];
        f->dims[4] = 1;
    } else if (is_fifth && f->as == IMPORT_AS_TIME) {
        f->dims[4] = f->dims[5];
        f->dims[5] = 1;
    }
    warn_of_frequency(file, f);
    return true;
}

void nifti_place_vectors(const struct nifti_fields *f, struct import_header *header) {
    const struct sp_mat3 direction = sp_grid_directions(&header->grid);
    const double determinant = sp_mat3_determinant(&direction);
    if (!f->are_fsl)
        return;
    /* Vectors of FSL lie along the axes of the grid, the first of which points to the left. */
    for (int row = 0; row < 3; row++)
        for (int axis = 0; axis < 3; axis++)
            header->frame[row][axis] =
                axis == 0 && determinant > 0 ? 0 - direction.m[row][0] : direction.m[row][axis];
}

const char *const *nifti_component_names(const struct import_file *file,
                                         const struct nifti_fields *f) {
    const struct import_intent intent = import_intent_of(f->intent);
    if (f->as != IMPORT_AS_CHANNELS)
        return NULL;
    if (intent.names && f->dims[5] == intent.name_count)
        return intent.names;
    return f->dims[5] == 6 && has_name_of_tensor(file->title) ? import_tensor_names : NULL;
}
