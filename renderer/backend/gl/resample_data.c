/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/resample_data.h"

#include <math.h>

#include "backend/gl/pass.h"
#include "backend/gl/visible_ranges.h"
#include "data/volume/sample.h"

enum { UPLOAD_BYTES = 1 << 26 /* between two checks of the cancel flag */ };

struct source {
    struct gl_residency *residency;
    struct sp_volume *volume;
    const struct sp_resample *resample;
    struct sp_pool *pool;
};

static uint64_t sample_count(const struct sp_samples *samples) {
    return (uint64_t)samples->dims[0] * samples->dims[1] * samples->dims[2];
}

static uint64_t round_up(uint64_t bytes) {
    return (bytes + sizeof(uint32_t) - 1) / sizeof(uint32_t) * sizeof(uint32_t);
}

/* Uploads `bytes` to an offset of a buffer. */
static bool send(const struct source *from, const struct gl_buffer *to, uint64_t at,
                 const void *data, uint64_t bytes, struct sp_error *err) {
    for (uint64_t done = 0, n; done < bytes; done += n) {
        n = bytes - done < UPLOAD_BYTES ? bytes - done : UPLOAD_BYTES;
        if (gl_pass_cancelled(from->resample->interrupt.cancel, err))
            return false;
        gl_buffer_update(to, at + done, (const char *)data + done, n);
        from->residency->uploaded += n;
    }
    return true;
}

static struct gl_resident *get_item(const struct source *from, enum gl_resident_kind kind,
                                    uint64_t made, uint64_t bytes, const char *what,
                                    struct sp_error *err) {
    return gl_residency_get_item(from->residency, from->volume, kind, made, round_up(bytes), what,
                                 err);
}

/* An item with a copy of memory. */
static const struct gl_buffer *copy(const struct source *from, enum gl_resident_kind kind,
                                    uint64_t made, const void *data, uint64_t bytes,
                                    const char *what, struct sp_error *err) {
    struct gl_resident *item = get_item(from, kind, made, bytes, what, err);
    if (item && !item->is_filled)
        item->is_filled = send(from, &item->buffer, 0, data, bytes, err);
    return item && item->is_filled ? &item->buffer : NULL;
}

/* A shader computes codes of 32-bit numbers in single precision. */
static bool has_codes(const struct source *from) {
    const double most = 1e30;
    double scale = from->resample->curve.codes_per_unit;
    const struct sp_volume_info *info = sp_volume_info(from->volume);
    return info->type == SP_FLOAT64 ||
           (info->type == SP_FLOAT32 &&
            !(gl_visible_ranges_is_possible(info) && scale < most && scale > 1 / most));
}

struct filling {
    const struct sp_samples *samples;
    const struct sp_curve *curve;
    const struct sp_interrupt *interrupt;
    float *codes;
};

/* Codes as draw/resample/refine.c reads them. */
static void fill_codes(void *user, size_t begin, size_t end, unsigned worker) {
    const double farthest = 1e6;
    const struct filling *f = user;
    const uint32_t *dims = f->samples->dims;
    (void)worker;
    for (size_t row = begin; row < end && !sp_interrupt_is_cancelled(f->interrupt); row++)
        for (uint64_t i = row * dims[0]; i < (row + 1) * dims[0]; i++) {
            double x = sp_sample(f->samples->voxels, f->samples->type, i);
            double code = (x - f->curve->base) * f->curve->codes_per_unit + CURVE_CODE_MIN;
            f->codes[i] = isfinite(x) ? (float)fmin(fmax(code, -farthest), farthest) : 0;
        }
}

static bool make_codes(const struct source *from, struct gl_resident *item, struct sp_error *err) {
    const struct sp_resample *r = from->resample;
    uint64_t bytes = sample_count(r->samples) * sizeof(float);
    struct filling filling = { r->samples, &r->curve, &r->interrupt,
                               gl_buffer_map(&item->buffer, bytes, err) };
    if (!filling.codes)
        return false;
    sp_parallel_for(from->pool, (size_t)r->samples->dims[1] * r->samples->dims[2], 16, fill_codes,
                    &filling);
    from->residency->uploaded += bytes;
    return gl_buffer_unmap(&item->buffer, err) && !gl_pass_cancelled(r->interrupt.cancel, err);
}

static const struct gl_buffer *get_codes(const struct source *from, struct sp_error *err) {
    const struct sp_resample *r = from->resample;
    struct gl_resident *item = get_item(from, GL_RESIDENT_CODES, r->class->made,
                                        sample_count(r->samples) * sizeof(float), "samples", err);
    if (item && !item->is_filled)
        item->is_filled = make_codes(from, item, err);
    return item && item->is_filled ? &item->buffer : NULL;
}

/* The samples as they are. Samples of the volume itself also serve other views. */
static const struct gl_buffer *get_samples(const struct source *from, struct sp_error *err) {
    const struct sp_samples *samples = from->resample->samples;
    struct gl_voxels *voxels =
        samples->owned ? NULL : gl_residency_voxels(from->residency, from->volume);
    if (voxels)
        return gl_residency_load(from->residency, voxels, SP_TF_PRE,
                                 from->resample->interrupt.cancel, err)
                   ? &voxels->samples
                   : NULL;
    return copy(from, GL_RESIDENT_SAMPLES, samples->made, samples->voxels,
                sample_count(samples) * sp_type_size(samples->type), "samples", err);
}

static bool fill_places(const struct source *from, const struct gl_buffer *to,
                        struct sp_error *err) {
    uint64_t at = 0;
    bool ok = true;
    for (int a = 0; a < 3; a++) {
        const struct sp_resample_axis *axis = &from->resample->axes[a];
        uint64_t place = from->resample->samples->dims[a] * sizeof *axis->place;
        uint64_t index = ((uint64_t)axis->steps + 1) * sizeof *axis->index;
        if (!axis->place)
            continue;
        ok = ok && send(from, to, at, axis->place, place, err) &&
             send(from, to, at + place, axis->index, index, err);
        at += place + index;
    }
    return ok;
}

/* False on failure; *places is NULL if all axes are evenly spaced. */
static bool get_places(const struct source *from, const struct gl_buffer **places,
                       struct sp_error *err) {
    const struct sp_resample *r = from->resample;
    uint64_t floats = 0;
    for (int a = 0; a < 3; a++)
        floats += r->axes[a].place ? r->samples->dims[a] + (uint64_t)r->axes[a].steps + 1 : 0;
    *places = NULL;
    if (!floats)
        return true;
    struct gl_resident *item = get_item(from, GL_RESIDENT_PLACES, r->samples->made,
                                        floats * sizeof(float), "coordinates", err);
    if (item && !item->is_filled)
        item->is_filled = fill_places(from, &item->buffer, err);
    *places = item && item->is_filled ? &item->buffer : NULL;
    return *places != NULL;
}

/* The intervals between slices of the axis r->axis that may be visible. */
static const struct gl_buffer *get_visible(const struct source *from, struct sp_error *err) {
    const struct sp_resample *r = from->resample;
    const uint32_t *regions = r->samples->regions;
    return copy(from, GL_RESIDENT_VISIBLE, r->class->made, r->class->visible,
                (uint64_t)regions[0] * regions[1] * regions[2], "visible intervals", err);
}

const struct gl_buffer *gl_resample_data_turn(struct gl_residency *residency,
                                              struct sp_volume *volume, const struct sp_resample *r,
                                              struct sp_error *err) {
    const struct source from = { residency, volume, r, NULL };
    return get_visible(&from, err);
}

bool gl_resample_data_get(struct gl_resample_data *data, struct gl_residency *residency,
                          struct sp_volume *volume, const struct sp_resample *r,
                          struct sp_pool *pool, struct sp_error *err) {
    static const enum gl_samples_kind kinds[SP_TYPE_COUNT] = {
        [SP_UINT8] = GL_SAMPLES_UINT8,   [SP_INT8] = GL_SAMPLES_INT8,
        [SP_UINT16] = GL_SAMPLES_UINT16, [SP_INT16] = GL_SAMPLES_INT16,
        [SP_INT32] = GL_SAMPLES_INT32,   [SP_FLOAT32] = GL_SAMPLES_FLOAT32,
        [SP_FLOAT64] = GL_SAMPLES_CODES,
    };
    const struct source from = { residency, volume, r, pool };
    const struct sp_samples *samples = r->samples;
    bool is_made = has_codes(&from);
    gl_residency_begin(residency);
    data->kind = is_made ? GL_SAMPLES_CODES : kinds[samples->type];
    data->samples = is_made ? get_codes(&from, err) : get_samples(&from, err);
    if (!data->samples)
        return false;
    data->visible = get_visible(&from, err);
    if (!data->visible)
        return false;
    data->integral = copy(&from, GL_RESIDENT_INTEGRAL, r->class->made, r->curve.integral,
                          CURVE_BYTES, "transfer function", err);
    return data->integral && get_places(&from, &data->places, err);
}
