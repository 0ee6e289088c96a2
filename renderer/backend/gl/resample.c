/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/resample.h"

#include <epoxy/gl.h>
#include <string.h>

#include "backend/gl/resample_constants.h"
#include "data/volume/grid.h"
#include "draw/resample/rays.h"

enum {
    INTERVALS_SOFTWARE = 32, /* llvmpipe ends loops after 65535 rounds; a sheet takes up to 900 */
    INTERVALS_LEAST = 16     /* three more sheets are read at the beginning of each dispatch */
};

/* Of a projection. */
static bool upload_colors(const struct gl_resample_frame *f, struct gl_state *s,
                          struct sp_error *err) {
    const uint64_t bytes = (REDUCTION_COLORS + 1) * sizeof f->resample.colors[0];
    if (!f->resample.reduction.is_on)
        return true;
    if (!gl_buffer_reserve(&s->resample.uploads.colors, "colours", bytes, s->block_bytes,
                           GL_USE_STREAM, err))
        return false;
    gl_buffer_update(&s->resample.uploads.colors, 0, f->resample.colors, bytes);
    s->upload.bytes += bytes;
    return true;
}

/* Uploads the constants of the axis f->resample.axis, and adds its passes. */
static bool add_passes(struct gl_resample_frame *f, struct gl_state *s,
                       const struct gl_buffer *visible, struct sp_error *err) {
    struct gl_resample_constants constants;
    struct gl_resample_squares squares;
    struct gl_buffer *buffer = &s->resample.uploads.constants[f->resample.axis];
    struct gl_buffer *of_squares = &s->resample.uploads.squares[f->resample.axis];
    gl_resample_constants_init(&constants, &f->resample);
    if (!gl_resample_squares_init(&squares, &f->resample, &s->arena))
        return sp_arena_fail(&s->arena, "data", err);
    uint64_t bytes = squares.count * sizeof squares.squares[0];
    if (!gl_buffer_reserve(buffer, "constants", sizeof constants, s->block_bytes, GL_USE_STREAM,
                           err) ||
        !gl_buffer_reserve(of_squares, "squares of pixels", bytes, s->block_bytes, GL_USE_STREAM,
                           err))
        return false;
    gl_buffer_update(buffer, 0, &constants, sizeof constants);
    gl_buffer_update(of_squares, 0, squares.squares, bytes);
    s->upload.bytes += sizeof constants + bytes;
    for (int sheets = RESAMPLE_WHOLE; sheets <= RESAMPLE_HALVES; sheets++)
        if (squares.sheets & sheets)
            f->passes[f->pass_count++] =
                (struct gl_resample_pass){ .constants = buffer,
                                           .squares = of_squares,
                                           .visible = visible,
                                           .share = (float)f->resample.share[f->resample.axis],
                                           .sheets = sheets,
                                           .intervals = (squares.slices + 2) * sheets };
    return true;
}

/* Adds the passes of another axis. */
static bool add_axis(struct gl_resample_frame *f, const struct sp_resample_input *input, int axis,
                     struct gl_state *s, struct sp_error *err) {
    const struct gl_buffer *visible;
    return sp_resample_turn(input, &f->resample, axis, err) &&
           (visible = gl_resample_data_turn(&s->residency, input->volume, &f->resample, err)) &&
           add_passes(f, s, visible, err);
}

/* Lists the passes of all axes that have a share of the image. Without memory for an axis the
 * others have its share. */
static bool list_passes(struct gl_resample_frame *f, const struct sp_resample_input *input,
                        struct gl_state *s, struct sp_error *err) {
    const int best = f->resample.axis;
    float sum = (float)f->resample.share[best];
    f->pass_count = 0;
    if (!add_passes(f, s, f->data.visible, err))
        return false;
    for (int a = 0; a < 3; a++) {
        struct sp_error why = { .code = SP_OK };
        if (a == best || !(f->resample.share[a] > 0))
            continue;
        if (add_axis(f, input, a, s, &why))
            sum += (float)f->resample.share[a];
        else if (why.code != SP_ERR_BUDGET)
            return sp_fail(err, why.code, why.place, "%s", why.text);
    }
    for (int i = 0; i < f->pass_count; i++)
        f->passes[i].share /= sum;
    return true;
}

/* The depth of the middle of the volume: depths count from here, for the sake of rounding. */
static float compute_depth_origin(const struct gl_resample_frame *f,
                                  const struct sp_backend_job *job) {
    const struct sp_camera_transform *camera = &f->camera;
    const struct sp_grid *grid = &sp_volume_info(job->volume)->grid;
    double depth = 0;
    for (int r = 0; r < 3; r++) {
        double middle = grid->origin[r] - camera->eye.v[r];
        for (unsigned a = 0; a < 3; a++)
            middle += grid->direction[r][a] * sp_grid_distance(grid, a, grid->dims[a] / 2);
        depth += camera->w.m[2][r] * middle;
    }
    return (float)depth;
}

bool gl_resample_begin(struct gl_resample_frame *f, const struct gl_band *band,
                       struct sp_error *err) {
    struct gl_state *s = band->state;
    const struct sp_backend_job *job = band->job;
    double start_ms = sp_job_clock_ms(job);
    bool is_lit = job->view->shading.mode == SP_SHADING_PHONG;
    enum gl_resample_use use;
    uint64_t used = sp_classify_cache_bytes(&s->cache, NULL) + gl_layers_bytes(&s->layers, NULL);
    sp_camera_transform_init(&f->camera, &job->view->camera, job->view->size);
    sp_shade_init(&f->shade, &f->camera, &job->view->shading);
    const struct sp_resample_input input = { .view = job->view,
                                             .whole = job->light_clip,
                                             .volume = job->volume,
                                             .frame = job->frame,
                                             .interrupt = sp_job_interrupt(job),
                                             .camera = &f->camera,
                                             .shade = is_lit ? &f->shade : NULL,
                                             .cache = &s->samples,
                                             .bytes_max = used < s->memory_bytes
                                                              ? s->memory_bytes - used
                                                              : 0,
                                             .mip_level = job->mip_level,
                                             .keeps_layout = true,
                                             .pool = s->pool,
                                             .arena = &s->arena };
    if (!sp_resample_prepare(&input, &f->resample, err) ||
        !gl_resample_data_get(&f->data, &s->residency, job->volume, &f->resample, s->pool, err) ||
        !gl_upload_shading(&s->upload, &f->camera, job->view, s->block_bytes, err) ||
        !upload_colors(f, s, err) || !list_passes(f, &input, s, err))
        return false;
    use = f->resample.reduction.is_on  ? GL_RESAMPLE_PROJECTION
          : f->resample.needs_gradient ? GL_RESAMPLE_GRADIENTS
                                       : GL_RESAMPLE_PLAIN;
    f->program = gl_resample_open(&s->resample, f->data.kind, use, band->fragments != NULL,
                                  !f->data.places, job->frame->depth, s->device, err);
    if (!f->program)
        return false;
    band->slot->depth_origin = compute_depth_origin(f, job);
    band->slot->mip_level = job->frame->stats.mip_level;
    band->slot->visible = job->frame->stats.visible_voxels;
    band->slot->stage_ms[GL_STAGE_CLASSIFY] += sp_job_clock_ms(job) - start_ms;
    return true;
}

/* Divides the band into dispatches. */
static void divide(struct gl_resample_frame *f, struct gl_band *band) {
    const struct gl_state *s = band->state;
    bool is_software = gl_context_info(s->context)->software;
    int most = is_software ? INTERVALS_SOFTWARE : GL_RESAMPLE_INTERVALS;
    uint32_t rows = gl_band_rows(band), work = s->resample.work;
    f->rows = work / INTERVALS_LEAST / band->columns;
    f->rows = f->rows < 1 ? 1 : f->rows < rows ? f->rows : rows;
    uint32_t at_once = work / (f->rows * band->columns);
    f->intervals_at_once = at_once < INTERVALS_LEAST  ? INTERVALS_LEAST
                           : at_once < (uint32_t)most ? (int)at_once
                                                      : most;
    f->dispatches = 0;
    for (int i = 0; i < f->pass_count; i++) {
        uint32_t intervals = (uint32_t)f->passes[i].intervals;
        f->dispatches +=
            gl_divide_up(rows, f->rows) * gl_divide_up(intervals, (uint32_t)f->intervals_at_once);
    }
    band->queued_max = GL_QUEUED_MAX;
}

bool gl_resample_plan(struct gl_resample_frame *f, struct gl_band *band, struct sp_error *err) {
    if (!gl_band_plan(band, err))
        return false;
    divide(f, band);
    return true;
}

static void bind(const struct gl_resample_frame *f, const struct gl_resample_pass *pass,
                 const struct gl_band *band) {
    const struct gl_state *s = band->state;
    gl_buffer_bind(&s->upload.constants.buffer, 0);
    gl_buffer_bind_constants(pass->constants, 1);
    gl_buffer_bind(pass->squares, 1);
    gl_buffer_bind(f->data.samples, 2);
    gl_buffer_bind(pass->visible, 3);
    gl_buffer_bind(&s->buffers.image, 4);
    gl_buffer_bind(f->resample.reduction.is_on ? &s->resample.uploads.colors : f->data.integral, 5);
    gl_buffer_bind(f->data.places ? f->data.places : pass->squares, 6);
    gl_buffer_bind(&s->bins.counts, 7);
    if (band->fragments)
        gl_buffer_bind(&s->buffers.fragments, GL_FRAGMENTS);
}

/* Draws `rows` rows of blocks from row y on, front to back. */
static bool draw_rows(const struct gl_resample_frame *f, const struct gl_resample_pass *pass,
                      struct gl_band *band, uint32_t y, uint32_t rows, struct sp_error *err) {
    for (int first = 0; first < pass->intervals; first += f->intervals_at_once) {
        bool ends = first + f->intervals_at_once >= pass->intervals;
        if (sp_job_is_cancelled(band->job))
            return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
        glUniform4ui(0, band->job->frame->width, band->y, band->end, y);
        glUniform2i(1, first, first + f->intervals_at_once);
        glUniform3i(2, pass->sheets, ends, ends && f->pass_count > 1);
        glUniform1f(3, pass->share);
        if (band->job->frame->depth)
            glUniform1f(4, band->slot->depth_origin);
        glDispatchCompute(band->columns, rows, 1);
        gl_band_barrier();
        gl_timer_stamp(&band->slot->timer, GL_STAGE_TILE);
        if (!gl_band_follow(band, err))
            return false;
    }
    return true;
}

bool gl_resample_draw(const struct gl_resample_frame *f, struct gl_band *band,
                      struct sp_error *err) {
    const uint32_t rows = gl_band_rows(band), layer_of_sum = 2;
    band->layer = f->pass_count > 1 ? layer_of_sum : 0;
    if (band->layer)
        gl_band_clear(band, band->layer);
    if (band->job->frame->depth)
        gl_band_clear(band, GL_LAYER_OF_MOMENTS);
    glUseProgram(f->program);
    for (int i = 0; i < f->pass_count; i++) {
        bind(f, &f->passes[i], band);
        for (uint32_t row = 0, n; row < rows; row += n) {
            n = rows - row < f->rows ? rows - row : f->rows;
            if (!draw_rows(f, &f->passes[i], band, band->y + row * GL_TILE, n, err))
                return false;
        }
    }
    return true;
}
