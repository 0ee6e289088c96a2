/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/voxel_layers.h"

#include <epoxy/gl.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "backend/gl/tile_lists.h"
#include "volume/grid.h"

enum {
    BLOCK = 512, /* voxels that a worker lists at a time */
    ROUNDS = 16, /* loop rounds of a voxel, at most */
    STATE_WORDS = 2 + 2 * SP_FRAGMENTS_MAX,
    ROW_WORDS = 2 /* of a sample of a rectilinear axis */
};

/* shaders/voxels.glsl: std430. */
struct constants {
    float steps[3][4], kernel[3][4];
    float view[4], filter[4], bounds[4], cell[4];
    uint32_t kind[4], words[4], rows[3][4];
    float to_camera[3][4], streaks[4], streak_color[4];
};
_Static_assert(sizeof(struct sp_voxel) == 6 * sizeof(uint32_t), "six words in the shader");

/* The voxels of a frame, and on which tiles they lie. */
struct frame {
    const struct sp_voxel_layer *layer;
    struct gl_voxel_layer_kept *kept;
    struct sp_voxel *voxels; /* in order, in the buffer */
    float reach;             /* of a kernel of the mean spacing, in perspective as it looks at
                                most [cells] */
    struct sp_tile_grid grid;
    struct sp_bins bins; /* its entries are numbers of voxels */
};

static void write_constants(struct constants *c, const struct frame *frame) {
    const struct sp_voxel_layer *s = frame->layer;
    const struct sp_ewa_frame *f = &s->frame.ewa;
    *c = (struct constants){
        .view = { f->scale, f->centre[0], f->centre[1], f->near },
        .filter = { f->lowpass2, f->radius, f->cut, f->peak },
        .bounds = { f->ratio_max[0], f->ratio_max[1], f->flat, f->gain },
        .cell = { (float)f->unit, s->frame.opaque, s->frame.apart, frame->reach },
        .kind = { s->frame.mode == SP_FILTER_NONE, s->frame.linear, s->frame.is_rectilinear,
                  (uint32_t)frame->grid.columns },
    };
    for (int r = 0; r < 3; r++) {
        memcpy(c->steps[r], f->step[r], sizeof f->step[r]);
        memcpy(c->kernel[r], f->kernel[r], sizeof f->kernel[r]);
        c->steps[r][3] = (float)f->base[r];
    }
    for (unsigned a = 0, row = 0; a < 3; row += f->grid->dims[a++])
        c->rows[a][0] = row;
    const struct sp_streaks *streaks = &s->frame.streaks;
    for (int r = 0; r < 3 && s->frame.has_streaks; r++) {
        memcpy(c->to_camera[r], streaks->to_camera[r], sizeof streaks->to_camera[r]);
        c->streak_color[r] = streaks->color[r];
    }
    c->streaks[0] = streaks->widen;
    c->streaks[1] = streaks->length;
    c->streaks[2] = streaks->phase;
    c->streaks[3] = streaks->blends;
}

static int16_t bounded(float x, int limit) {
    return (int16_t)(x > 0 ? (x < (float)limit ? x : (float)limit) : 0);
}

/* Finds the box that a voxel's splat lies in; nothing on any tile if it is not drawn. */
static struct sp_splat find_box(const struct frame *frame, const struct sp_voxel *v) {
    const struct sp_splat nowhere = { .x0 = SP_TILE, .y0 = SP_TILE };
    const struct sp_voxel_frame *s = &frame->layer->frame;
    const struct sp_ewa_frame *f = &s->ewa;
    float at[3], u[3], size = 1;
    for (int a = 0; a < 3; a++) {
        at[a] = s->is_rectilinear ? s->place[a][v->at[a]] : (float)v->at[a];
        size = s->is_rectilinear ? fmaxf(size, s->size[a][v->at[a]]) : size;
    }
    for (int r = 0; r < 3; r++)
        u[r] = (float)f->base[r] + f->step[r][0] * at[0] + f->step[r][1] * at[1] +
               f->step[r][2] * at[2];
    if (!(u[2] >= f->near))
        return nowhere;
    float scale = f->scale / (f->projection == SP_PERSPECTIVE ? u[2] : 1);
    float x = f->centre[0] + scale * u[0], y = f->centre[1] + scale * u[1];
    float margin = frame->reach * size * scale + f->radius * sqrtf(f->lowpass2) + 1;
    struct sp_splat box = { .x0 = bounded(floorf(x - margin), f->size[0]),
                            .y0 = bounded(floorf(y - margin), f->size[1]),
                            .x1 = bounded(ceilf(x + margin), f->size[0]),
                            .y1 = bounded(ceilf(y + margin), f->size[1]) };
    return box.x0 < box.x1 && box.y0 < box.y1 ? box : nowhere;
}

/* Finds the boxes of a block of voxels; returns how many there are. */
static uint32_t find_boxes(const struct frame *frame, uint32_t block, struct sp_splat *boxes) {
    const struct sp_voxel_layer *s = frame->layer;
    const uint32_t first = block * BLOCK, left = s->order.count - first;
    const uint32_t count = left < BLOCK ? left : BLOCK;
    for (uint32_t i = 0; i < count; i++)
        boxes[i] = find_box(frame, &s->list->voxels[s->order.voxels[first + i]]);
    return count;
}

/* Copies blocks of voxels and counts their tiles. */
static void count_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    const struct frame *frame = user;
    const struct sp_voxel_layer *s = frame->layer;
    struct sp_splat boxes[BLOCK];
    (void)worker;
    for (uint32_t b = (uint32_t)begin; b < end; b++) {
        uint32_t count = find_boxes(frame, b, boxes);
        for (uint32_t i = b * BLOCK; i < b * BLOCK + count; i++)
            frame->voxels[i] = s->list->voxels[s->order.voxels[i]];
        sp_bins_clear(&frame->bins, b);
        sp_bins_count(&frame->bins, b, &frame->grid, boxes, count);
    }
}

static void fill_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    struct frame *frame = user;
    struct sp_splat boxes[BLOCK];
    (void)worker;
    for (uint32_t b = (uint32_t)begin; b < end; b++) {
        uint32_t count = find_boxes(frame, b, boxes);
        sp_bins_fill(&frame->bins, b, &frame->grid, boxes, count, b * BLOCK);
    }
}

static bool fail_memory(const struct sp_arena *arena, struct sp_error *err) {
    return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the layer's %s",
                   arena->failed ? arena->failed : "data");
}

static void init_frame(struct frame *frame) {
    const struct sp_ewa_frame *f = &frame->layer->frame.ewa;
    float square = 0;
    for (int i = 0; i < 9; i++)
        square += f->kernel[i / 3][i % 3] * f->kernel[i / 3][i % 3];
    if (frame->layer->frame.has_streaks)
        square += frame->layer->frame.streaks.widen;
    frame->reach = fmaxf(f->radius, f->flat) * sqrtf(square);
    if (f->projection == SP_PERSPECTIVE)
        frame->reach *= 1 + fmaxf(f->ratio_max[0], f->ratio_max[1]);
    frame->grid = (struct sp_tile_grid){ .columns = (f->size[0] + SP_TILE - 1) / SP_TILE,
                                         .rows = (f->size[1] + SP_TILE - 1) / SP_TILE };
    frame->bins = (struct sp_bins){ .tiles = (uint32_t)(frame->grid.columns * frame->grid.rows),
                                    .blocks = (frame->layer->order.count + BLOCK - 1) / BLOCK };
}

/* Uploads the voxels and lists them by tile. */
static bool send_voxels(struct frame *frame, struct gl_state *state, struct sp_error *err) {
    struct sp_bins *bins = &frame->bins;
    struct sp_arena *arena = &state->arena;
    const uint64_t bytes = (uint64_t)frame->layer->order.count * sizeof *frame->voxels;
    uint64_t total = 0;
    bins->counts = sp_arena_alloc(arena, "counts of tiles", (size_t)bins->blocks * bins->tiles,
                                  sizeof *bins->counts);
    bins->first = sp_arena_alloc(arena, "starts of tiles", bins->tiles + 1, sizeof *bins->first);
    if (!bins->counts || !bins->first)
        return fail_memory(arena, err);
    if (!gl_buffer_reserve(&frame->kept->voxels, "voxels of a layer", bytes, state->block_bytes,
                           GL_USE_STREAM, err) ||
        !(frame->voxels = gl_buffer_map(&frame->kept->voxels, bytes, err)))
        return false;
    sp_parallel_for(state->pool, bins->blocks, 4, count_blocks, frame);
    state->upload.bytes += bytes;
    if (!gl_buffer_unmap(&frame->kept->voxels, err))
        return false;
    for (uint32_t b = 0; b < bins->blocks; b++)
        total += sp_bins_block_total(bins, b);
    bins->entries = total < UINT32_MAX
                        ? sp_arena_alloc(arena, "lists of tiles", total + 1, sizeof *bins->entries)
                        : NULL;
    if (!bins->entries)
        return fail_memory(arena, err);
    bins->capacity = (uint32_t)total;
    sp_bins_start(bins, 0, bins->blocks);
    sp_parallel_for(state->pool, bins->blocks, 4, fill_blocks, frame);
    return true;
}

static uint32_t size_of(const void *user, uint32_t block) {
    (void)user;
    (void)block;
    return 1;
}

/* Fills the words; returns the most voxels of a tile. */
static uint32_t write_words(uint32_t *to, const uint32_t at[2], const struct frame *frame) {
    const struct sp_voxel_frame *s = &frame->layer->frame;
    float *row = (float *)(void *)(to + at[1]);
    for (unsigned a = 0; a < 3 && s->is_rectilinear; a++)
        for (uint32_t i = 0; i < s->ewa.grid->dims[a]; i++, row += ROW_WORDS) {
            row[0] = s->place[a][i];
            row[1] = s->size[a][i];
        }
    return gl_tile_lists_write(to, (struct gl_entry *)(void *)(to + at[0]), &frame->bins, size_of,
                               NULL);
}

static bool send_words(struct gl_voxel_drawing *to, const struct frame *frame,
                       struct gl_state *state, struct sp_error *err) {
    const struct sp_voxel_layer *s = frame->layer;
    const struct gl_buffer *buffer = &frame->kept->constants;
    const uint32_t *dims = s->frame.ewa.grid->dims;
    const uint32_t rows = gl_tile_lists_words(&frame->bins);
    uint64_t end =
        rows + (s->frame.is_rectilinear ? ROW_WORDS * ((uint64_t)dims[0] + dims[1] + dims[2]) : 0);
    uint64_t bytes = sizeof(struct constants) + end * sizeof(uint32_t);
    struct constants c;
    write_constants(&c, frame);
    memcpy(c.words, (uint32_t[]){ frame->bins.tiles + 1, rows }, 2 * sizeof(uint32_t));
    if (!gl_buffer_reserve(&frame->kept->constants, "lists of voxels", bytes, state->block_bytes,
                           GL_USE_STREAM, err))
        return false;
    struct constants *mapped = gl_buffer_map(buffer, bytes, err);
    if (!mapped)
        return false;
    *mapped = c;
    to->most = write_words((uint32_t *)(void *)(mapped + 1), c.words, frame);
    state->upload.bytes += bytes;
    return gl_buffer_unmap(buffer, err);
}

static unsigned open_program(struct gl_state *s, enum gl_voxel_layer kind, bool is_alone,
                             struct sp_error *err) {
    struct gl_late_program *own = &s->voxel_layers[kind].programs[is_alone];
    struct sp_error why = { .text = "it failed before; the log has the reason" };
    char defines[80];
    snprintf(defines, sizeof defines, "#define ALONE %d\n#define STREAKS %d\n%s", is_alone,
             kind == GL_VECTORS, is_alone ? "" : "#define FRAGMENTS_ACCESS\n");
    if (!own->program && !own->is_refused)
        own->program =
            gl_program_open(is_alone ? "frame bins gradient shade entries voxels 24_voxels"
                                     : "frame bins gradient shade fragments fragment_lists "
                                       "entries voxels 24_voxels",
                            defines, &why);
    own->is_refused = !own->program;
    if (own->is_refused)
        sp_fail(err, SP_ERR_UNSUPPORTED, "", "%s has no program for lists of voxels: %s", s->device,
                why.text);
    return own->program;
}

bool gl_voxel_layer_begin(struct gl_voxel_drawing *voxels, const struct gl_band *band,
                          enum gl_voxel_layer kind, struct sp_error *err) {
    struct gl_state *state = band->state;
    const struct gl_voxels_made *made = &band->fragments->made.voxels[kind];
    struct frame frame = { .layer = &made->layer, .kept = &state->voxel_layers[kind] };
    *voxels =
        (struct gl_voxel_drawing){ .kind = kind, .is_alone = band->job->view->layer_count == 1 };
    if (!made->is_there || !made->layer.order.count)
        return true;
    init_frame(&frame);
    if (!(voxels->program = open_program(state, kind, voxels->is_alone, err)) ||
        !send_voxels(&frame, state, err) || !send_words(voxels, &frame, state, err))
        return false;
    uint32_t most = gl_workload_limits(&state->workload).loops / ROUNDS;
    voxels->at_once = most > 0 ? most : 1;
    voxels->passes = gl_divide_up(voxels->most, voxels->at_once);
    voxels->words = voxels->passes > 1 && !voxels->is_alone ? STATE_WORDS : 0;
    voxels->is_drawn = voxels->most > 0;
    return true;
}

bool gl_voxel_layer_draw(const struct gl_voxel_drawing *voxels, struct gl_band *band,
                         struct sp_error *err) {
    struct gl_state *s = band->state;
    const struct gl_voxel_layer_kept *kept = &s->voxel_layers[voxels->kind];
    const struct gl_bins_space space = { band->columns, band->y, band->end, gl_band_rows(band), 1 };
    if (!voxels->is_drawn)
        return true;
    glUseProgram(voxels->program);
    gl_bins_set_space(&space);
    gl_buffer_bind(&s->upload.constants, 0);
    gl_buffer_bind(&kept->constants, 1);
    gl_buffer_bind(&kept->voxels, 2);
    gl_buffer_bind(voxels->words ? &s->buffers.sheets : &s->buffers.image, 4);
    gl_buffer_bind(&s->bins.counts, 7);
    if (!voxels->is_alone)
        gl_buffer_bind(&s->buffers.fragments, GL_FRAGMENTS);
    return gl_band_draw_lists(band, voxels->most, voxels->at_once, err);
}

void gl_voxel_layers_finish(struct gl_state *s) {
    for (int kind = 0; kind < GL_VOXEL_LAYERS; kind++) {
        struct gl_voxel_layer_kept *kept = &s->voxel_layers[kind];
        for (int i = 0; i < 2; i++)
            glDeleteProgram(kept->programs[i].program);
        gl_buffer_finish(&kept->constants);
        gl_buffer_finish(&kept->voxels);
        *kept = (struct gl_voxel_layer_kept){ 0 };
    }
}
