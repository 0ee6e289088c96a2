/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/surfaces.h"

#include <assert.h>
#include <epoxy/gl.h>
#include <string.h>

#include "backend/gl/frame.h"
#include "backend/gl/pass.h"
#include "data/volume/grid.h"

enum {
    ROUNDS = 8,       /* loop rounds of a point, at most */
    SHEET_WORDS = 17, /* words of four per pixel, between two passes */
    CHUNK = 1 << 20,  /* points that are uploaded together */
    BORDERS = 6,      /* faces of the volume */
    ROW_WORDS = 3     /* of a cell of a rectilinear axis */
};

/* shaders/surface.glsl: std430. */
struct constants {
    float steps[3][4], areas[3][4], kernel[3][4];
    float view[4], filter[4], bounds[4], sheet[4], look[4], cell[4], focus[4];
    uint32_t kind[4], plane_counts[4], words[4], rows[3][4];
    float clip[GL_CLIP_PLANES][4], borders[BORDERS][4];
};

struct block {
    float base[3];
    uint32_t first, count;
    float depth;
    uint16_t box[4];
    uint32_t corner[3], is_near;
};

/* A block that a tile draws. shaders/entries.glsl declares the same struct. */
struct entry {
    uint32_t block, before; /* points of the tile before it */
};

/* 16-bit numbers of a point: place, area, normal, bend. */
struct point {
    uint16_t numbers[10];
};
_Static_assert(sizeof(struct point) == 5 * sizeof(uint32_t), "five words in the shader");

static void write_rows(float to[3][4], const float from[3][3]) {
    for (int r = 0; r < 3; r++)
        memcpy(to[r], from[r], sizeof from[r]);
}

/* Everything but the numbers of words. */
static void write_constants(struct constants *c, const struct sp_surface *s) {
    const struct sp_ewa_frame *f = &s->frame;
    assert(s->clip.count <= GL_CLIP_PLANES && s->borders.count <= BORDERS);
    *c = (struct constants){
        .view = { f->scale, f->centre[0], f->centre[1], f->near },
        .filter = { f->lowpass2, f->radius, f->cut, f->peak },
        .bounds = { f->ratio_max[0], f->ratio_max[1], s->reach, s->stretch },
        .sheet = { s->squeeze, s->bend, s->tolerance, s->depth_first },
        .look = { s->color[0], s->color[1], s->color[2], s->opacity },
        .cell = { (float)f->unit },
        .focus = { s->focus.growth, s->focus.least, s->focus.nearest,
                   sp_surface_area_step(s, &s->near) },
        .kind = { s->is_opaque, s->cuts_near, sp_grid_is_rectilinear(f->grid),
                  (uint32_t)s->columns },
        .plane_counts = { s->clip.count, s->borders.count },
    };
    write_rows(c->steps, f->step);
    write_rows(c->areas, s->facing);
    write_rows(c->kernel, f->kernel);
    gl_write_planes(c->clip, &s->clip);
    gl_write_planes(c->borders, &s->borders);
}

static struct block make_block(const struct sp_surface *s, const struct sp_splat *record) {
    const struct sp_surface_points *points;
    const struct sp_surface_block *from = sp_surface_block_at(s, record->sheet, &points);
    const struct sp_grid *grid = s->frame.grid;
    struct block to = { .first = (uint32_t)from->first,
                        .count = from->count,
                        .is_near = points == &s->near,
                        .depth = record->depth,
                        .box = { (uint16_t)record->x0, (uint16_t)record->y0, (uint16_t)record->x1,
                                 (uint16_t)record->y1 } };
    double start[3];
    for (unsigned a = 0; a < 3; a++) {
        start[a] = sp_grid_distance(grid, a, from->corner[a]) / grid->spacing[a];
        to.corner[a] = from->corner[a];
    }
    for (int r = 0; r < 3; r++) {
        const double *step = s->frame.step_hi[r];
        to.base[r] = (float)(s->frame.base[r] + step[0] * start[0] + step[1] * start[1] +
                             step[2] * start[2]);
    }
    return to;
}

/* The coordinates of a rectilinear axis, ROW_WORDS per sample. */
static void write_coordinates(float *to, const struct sp_grid *grid, unsigned a) {
    const double inverse = 1 / grid->spacing[a];
    for (uint32_t i = 0, last = grid->dims[a] - 1; i <= last; i++) {
        double at = sp_grid_distance(grid, a, i) * inverse;
        double next = sp_grid_distance(grid, a, i < last ? i + 1 : i) * inverse;
        to[ROW_WORDS * i] = (float)at;
        to[ROW_WORDS * i + 1] = (float)(next - at);
        to[ROW_WORDS * i + 2] = (float)(sp_grid_local_spacing(grid, a, i) * inverse);
    }
}

/* Where the words behind the constants begin. */
struct layout {
    /* The first entries of tiles are at 0. */
    uint32_t entries, blocks, coordinates, near, end;
    uint32_t block_count;
};

static struct layout lay_out(const struct sp_surface *s) {
    enum { WORD = sizeof(uint32_t) };
    const struct sp_grid *grid = s->frame.grid;
    struct layout at = { .entries = s->bins.tiles + 1 };
    const uint32_t entries = s->bins.first[s->bins.tiles];
    for (uint32_t e = 0; e < entries; e++)
        if (s->bins.entries[e] >= at.block_count)
            at.block_count = s->bins.entries[e] + 1;
    at.blocks = at.entries + entries * (uint32_t)(sizeof(struct entry) / WORD);
    at.coordinates = at.blocks + at.block_count * (uint32_t)(sizeof(struct block) / WORD);
    at.near = at.coordinates;
    if (sp_grid_is_rectilinear(grid))
        at.near += ROW_WORDS * (grid->dims[0] + grid->dims[1] + grid->dims[2]);
    at.end = at.near + (uint32_t)(s->near.count * (sizeof(struct point) / WORD));
    return at;
}

/* Writes the first entry of each tile and the end, and the entries; returns the most points of a
 * tile. */
static uint32_t write_lists(uint32_t *first, struct entry *entries, const struct sp_surface *s) {
    const struct sp_bins *bins = &s->bins;
    const struct sp_surface_points *points;
    uint32_t most = 0;
    memcpy(first, bins->first, (bins->tiles + (size_t)1) * sizeof *first);
    for (uint32_t t = 0; t < bins->tiles; t++) {
        uint32_t before = 0;
        for (uint32_t e = bins->first[t]; e < bins->first[t + 1]; e++) {
            entries[e] = (struct entry){ bins->entries[e], before };
            before += sp_surface_block_at(s, s->blocks[bins->entries[e]].sheet, &points)->count;
        }
        most = before > most ? before : most;
    }
    return most;
}

static void copy_points(struct point *to, const struct sp_surface_points *from, uint64_t first,
                        uint64_t count) {
    for (uint64_t i = 0; i < count; i++) {
        for (int a = 0; a < 3; a++) {
            to[i].numbers[a] = from->at[a][first + i];
            to[i].numbers[3 + a] = (uint16_t)from->area[a][first + i];
            to[i].numbers[6 + a] = (uint16_t)from->normal[a][first + i];
        }
        to[i].numbers[9] = (uint16_t)from->bend[first + i];
    }
}

/* Fills the words; returns the most points of a tile. */
static uint32_t write_words(uint32_t *to, const struct layout *at, const struct sp_surface *s) {
    struct block *blocks = (struct block *)(void *)(to + at->blocks);
    float *row = (float *)(void *)(to + at->coordinates);
    for (uint32_t b = 0; b < at->block_count; b++)
        blocks[b] = make_block(s, &s->blocks[b]);
    for (unsigned a = 0; a < 3 && at->near > at->coordinates; a++) {
        write_coordinates(row, s->frame.grid, a);
        row += ROW_WORDS * s->frame.grid->dims[a];
    }
    copy_points((struct point *)(void *)(to + at->near), &s->near, 0, s->near.count);
    return write_lists(to, (struct entry *)(void *)(to + at->entries), s);
}

static bool upload_words(struct gl_surface *to, struct gl_buffer *buffer, struct gl_state *state,
                         const struct sp_surface *s, struct sp_error *err) {
    const struct layout at = lay_out(s);
    uint64_t bytes = sizeof(struct constants) + (uint64_t)at.end * sizeof(uint32_t);
    struct constants c;
    write_constants(&c, s);
    memcpy(c.words, (uint32_t[]){ at.entries, at.blocks, at.coordinates, at.near }, sizeof c.words);
    for (unsigned a = 0, row = 0; a < 3; row += s->frame.grid->dims[a++]) {
        c.rows[a][0] = row;
        c.rows[a][1] = s->frame.grid->dims[a];
    }
    if (!gl_buffer_reserve(buffer, "blocks of a surface", bytes, state->block_bytes, GL_USE_STREAM,
                           err))
        return false;
    struct constants *mapped = gl_buffer_map(buffer, bytes, err);
    if (!mapped)
        return false;
    *mapped = c;
    to->most = write_words((uint32_t *)(void *)(mapped + 1), &at, s);
    to->constants = buffer;
    state->upload.bytes += bytes;
    return gl_buffer_unmap(buffer, err);
}

static bool send_points(struct gl_state *state, const struct gl_buffer *to,
                        const struct sp_surface_points *points, const atomic_bool *cancel,
                        struct sp_error *err) {
    uint64_t size = points->count < CHUNK ? points->count : CHUNK;
    struct point *chunk = sp_arena_alloc(&state->arena, "points of a surface", size, sizeof *chunk);
    if (!chunk)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the points of a surface");
    for (uint64_t done = 0, n; done < points->count; done += n) {
        n = points->count - done < CHUNK ? points->count - done : CHUNK;
        if (gl_pass_cancelled(cancel, err))
            return false;
        copy_points(chunk, points, done, n);
        gl_buffer_update(to, done * sizeof *chunk, chunk, n * sizeof *chunk);
        state->residency.uploaded += n * sizeof *chunk;
    }
    return true;
}

/* The points of a surface, uploaded unless they are resident. */
static const struct gl_buffer *get_points(const struct gl_band *band, const struct sp_surface *s,
                                          struct sp_error *err) {
    struct gl_state *state = band->state;
    struct gl_resident *item = gl_residency_get_item(
        &state->residency, band->job->volume, GL_RESIDENT_SURFACE, s->points->made,
        s->points->count * sizeof(struct point), "points of a surface", err);
    if (item && !item->is_filled)
        item->is_filled = send_points(state, &item->buffer, s->points, band->job->cancel, err);
    return item && item->is_filled ? &item->buffer : NULL;
}

static bool open_program(struct gl_state *s, struct sp_error *err) {
    return gl_program_late(
        &s->surfaces.program,
        "frame bins normal shade fragments fragment_lists entries surface surface_resolve "
        "ordinal draw_surface",
        "#define FRAGMENTS_ACCESS\n", s->device, "surfaces", err);
}

/* Divides bands into passes. Between them, sheets are kept in memory. */
static void divide(struct gl_surfaces *surfaces, const struct gl_band *band) {
    uint32_t points = gl_workload_limits(&band->state->workload).loops / ROUNDS;
    surfaces->at_once = points > 0 ? points : 1;
    surfaces->passes = 0;
    for (unsigned i = 0; i < surfaces->count; i++)
        surfaces->passes += gl_divide_up(surfaces->items[i].most, surfaces->at_once);
    surfaces->sheet_words = surfaces->passes > surfaces->count ? SHEET_WORDS : 0;
}

bool gl_surfaces_begin(struct gl_surfaces *surfaces, const struct gl_band *band,
                       struct sp_error *err) {
    struct gl_state *state = band->state;
    const struct gl_layers_made *made = &band->fragments->made;
    surfaces->count = 0;
    for (unsigned i = 0; i < made->surface_count; i++) {
        const struct sp_surface *s = &made->surfaces[i];
        struct gl_surface *to = &surfaces->items[surfaces->count];
        if (!s->bins.first[s->bins.tiles])
            continue;
        if (!open_program(state, err) || !(to->points = get_points(band, s, err)) ||
            !upload_words(to, &state->surfaces.constants[surfaces->count], state, s, err))
            return false;
        surfaces->count++;
    }
    divide(surfaces, band);
    return true;
}

/* Draws a surface in the band, in passes. */
static bool draw(const struct gl_surfaces *surfaces, const struct gl_surface *surface,
                 struct gl_band *band, struct sp_error *err) {
    const struct gl_bins_space space = { band->columns, band->y, band->end, gl_band_rows(band), 1 };
    gl_bins_set_space(&space);
    gl_buffer_bind(surface->constants, 1);
    gl_buffer_bind(surface->points, 2);
    for (uint32_t first = 0; first < surface->most; first += surfaces->at_once) {
        const uint32_t left = surface->most - first;
        const uint32_t n = left < surfaces->at_once ? left : surfaces->at_once;
        if (sp_job_is_cancelled(band->job))
            return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
        glUniform4ui(1, band->job->frame->width, first, first + n, first == 0);
        glUniform3ui(2, band->slot->fragments_most, band->fragments->insert.planes, n == left);
        if (!gl_band_draw_layer(band, err))
            return false;
    }
    return true;
}

bool gl_surfaces_draw(const struct gl_surfaces *surfaces, struct gl_band *band,
                      struct sp_error *err) {
    struct gl_state *s = band->state;
    if (!surfaces->count)
        return true;
    glUseProgram(s->surfaces.program.program);
    gl_buffer_bind(&s->upload.constants.buffer, 0);
    gl_buffer_bind(surfaces->sheet_words ? &s->buffers.sheets : &s->upload.constants.buffer, 3);
    gl_buffer_bind(&s->bins.counts, 7);
    gl_buffer_bind(&s->buffers.fragments, GL_FRAGMENTS);
    for (unsigned i = 0; i < surfaces->count; i++)
        if (!draw(surfaces, &surfaces->items[i], band, err))
            return false;
    return true;
}

void gl_surfaces_finish(struct gl_state *s) {
    glDeleteProgram(s->surfaces.program.program);
    for (int i = 0; i < SP_LAYERS_MAX; i++)
        gl_buffer_finish(&s->surfaces.constants[i]);
    s->surfaces = (struct gl_surfaces_kept){ .per_pixel = 0 };
}
