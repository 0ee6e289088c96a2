/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/meshes.h"

#include <epoxy/gl.h>
#include <float.h>
#include <math.h>
#include <string.h>

#include "backend/gl/elements.h"

enum {
    SHEET_WORDS = 8,         /* of four per pixel: samples of the open sheet */
    ALL_WORDS = 21 + 2 * 16, /* the same with what sheets before it show */
    /* Bits of shaders/passes/draw_mesh.glsl. */
    RESUMES = 1,
    ENDS_SHEET = 2,
    ENDS_MESH = 4
};

/* shaders/mesh.glsl: std430. */
struct constants {
    float place[3][4], turn[3][4], origin[4], view[4], look[4], lengths[4];
    uint32_t kind[4];
    float halves[GL_CLIP_PLANES + 1][4];
};
_Static_assert((int)SP_CUTS_MAX == (int)GL_CLIP_PLANES, "the shader holds every half-space");
_Static_assert(sizeof(struct sp_mesh_half) == sizeof(float[4]), "a word of four");

/* The power of two by which lengths are divided, so that their cubes stay in the range of floats:
 * about the distance of the mesh. */
static float choose_unit(const struct sp_mesh *m) {
    int exponent;
    const float away = fmaxf(fabsf(m->shift[0]), fmaxf(fabsf(m->shift[1]), fabsf(m->shift[2])));
    frexpf(fmaxf(away, m->near), &exponent);
    return ldexpf(1, exponent);
}

static void write_constants(struct constants *c, const struct sp_mesh *m) {
    const float unit = choose_unit(m), inverse = 1 / unit;
    const float across = m->is_perspective ? 1 : unit; /* from a length of the shader to px */
    *c = (struct constants){
        .origin = { m->origin[0], m->origin[1], m->origin[2] },
        .view = { m->scale * across, m->centre[0], m->centre[1],
                  m->is_perspective ? m->near * inverse : 0 },
        .look = { m->color[0], m->color[1], m->color[2], m->opacity },
        .lengths = { unit, m->apart / (m->scale * across) },
        .kind = { m->has_own_colors, m->half_count, m->elements->shape.vertex_count },
    };
    for (int r = 0; r < 3; r++) {
        for (int a = 0; a < 3; a++)
            c->place[r][a] = m->to_camera[r][a] * inverse;
        c->place[r][3] = m->shift[r] * inverse;
        memcpy(c->turn[r], m->normal_to_world[r], sizeof m->normal_to_world[r]);
    }
    memcpy(c->halves, m->halves, m->half_count * sizeof *c->halves);
    for (uint32_t i = 0; i < m->half_count; i++)
        c->halves[i][3] *= m->is_perspective ? inverse : unit;
}

/* Makes the vertices and triangles resident. */
static bool load(struct gl_mesh *to, const struct sp_mesh *mesh, const struct gl_band *band,
                 struct sp_volume *volume, struct sp_error *err) {
    const struct sp_elements *e = mesh->elements;
    const uint64_t n = e->shape.vertex_count;
    const struct gl_elements_array
        vertices[] = { { .data = e->positions, .bytes = n * sizeof *e->positions },
                       { .data = e->normals, .bytes = n * sizeof *e->normals },
                       { .data = e->colors, .bytes = n * sizeof *e->colors } },
        triangles[] = { { .data = e->triangles, .bytes = e->shape.count * sizeof *e->triangles } };
    struct gl_resident *item = gl_elements_load(band, volume, GL_RESIDENT_VERTICES, 0, vertices, 3,
                                                "vertices of a mesh", err);
    if (!item)
        return false;
    if (!(item->least > 0))
        item->least = fmaxf(sp_mesh_least_opacity(e, 0, e->shape.vertex_count), FLT_MIN);
    to->vertices = &item->buffer;
    to->sheets = (uint32_t)sp_mesh_count_sheets(mesh, item->least);
    item = gl_elements_load(band, volume, GL_RESIDENT_TRIANGLES, 0, triangles, 1,
                            "triangles of a mesh", err);
    if (!item)
        return false;
    to->triangles = &item->buffer;
    to->triangle_count = e->shape.count;
    return true;
}

static bool open_programs(struct gl_state *s, struct sp_error *err) {
    return gl_program_late(&s->meshes.triangles, "frame bins records counts mesh place_triangles",
                           "", s->device, "meshes", err) &&
           gl_program_late(&s->meshes.samples,
                           "frame bins shade fragments fragment_lists mesh mesh_resolve draw_mesh",
                           "#define FRAGMENTS_ACCESS\n", s->device, "meshes", err);
}

bool gl_meshes_begin(struct gl_meshes *meshes, const struct gl_band *band, struct sp_error *err) {
    struct gl_state *s = band->state;
    const struct gl_layers_made *made = &band->fragments->made;
    meshes->count = 0;
    for (unsigned i = 0; i < made->mesh_count; i++) {
        const struct sp_mesh *mesh = &made->meshes[i];
        struct gl_mesh *to = &meshes->items[meshes->count];
        struct gl_buffer *buffer = &s->meshes.constants[meshes->count];
        struct constants constants;
        if (!mesh->elements->shape.count)
            continue;
        if (!open_programs(s, err) || !load(to, mesh, band, made->mesh_volumes[i], err) ||
            !gl_buffer_reserve(buffer, "constants", sizeof constants, s->block_bytes, GL_USE_STREAM,
                               err))
            return false;
        write_constants(&constants, mesh);
        gl_buffer_write(buffer, &constants, sizeof constants);
        s->upload.bytes += sizeof constants;
        to->constants = buffer;
        meshes->count++;
    }
    return true;
}

/* Batches of triangles, and dispatches of draw_mesh per band. */
static uint32_t count_batches(const struct gl_mesh *mesh, const struct gl_pieces *pieces) {
    return gl_divide_up(mesh->triangle_count, pieces->records);
}

static uint32_t count_dispatches(const struct gl_mesh *mesh, const struct gl_pieces *pieces) {
    return mesh->sheets * count_batches(mesh, pieces) * pieces->element_passes;
}

void gl_meshes_divide(struct gl_meshes *meshes, const struct gl_pieces *pieces) {
    meshes->dispatches = meshes->words = 0;
    for (unsigned i = 0; i < meshes->count; i++) {
        const struct gl_mesh *mesh = &meshes->items[i];
        const uint32_t dispatches = count_dispatches(mesh, pieces);
        meshes->dispatches += dispatches + count_batches(mesh, pieces);
        if (dispatches > 1 && meshes->words < ALL_WORDS)
            meshes->words = mesh->sheets > 1 ? ALL_WORDS : SHEET_WORDS;
    }
}

bool gl_meshes_reserve(const struct gl_meshes *meshes, const struct gl_band *band,
                       struct sp_error *err) {
    const uint32_t records = band->slot->pieces.records;
    uint32_t most = 0;
    for (unsigned i = 0; i < meshes->count; i++)
        most = meshes->items[i].triangle_count > most ? meshes->items[i].triangle_count : most;
    return !most || gl_elements_reserve(band, most < records ? most : records, 1, 0, err);
}

/* Sorts a batch of triangles into the tiles of the band. */
static bool sort_batch(const struct gl_mesh *mesh, struct gl_band *band, uint32_t first,
                       uint32_t count, uint32_t sheet, struct sp_error *err) {
    struct gl_state *s = band->state;
    const struct gl_bins_space space = gl_elements_space(band, 1);
    glUseProgram(s->meshes.triangles.program);
    glUniform4ui(1, first, count, band->job->frame->width, sheet == 0);
    gl_buffer_bind(&s->upload.constants.buffer, 0);
    gl_buffer_bind(mesh->constants, 1);
    gl_buffer_bind(mesh->vertices, 2);
    gl_buffer_bind(mesh->triangles, 5);
    return gl_elements_sort(band, &space, count, err);
}

/* Draws the pairs of a batch; `bits`: RESUMES for its first pass, and what its last one ends. */
static bool draw_batch(const struct gl_meshes *meshes, const struct gl_mesh *mesh,
                       struct gl_band *band, uint32_t first, uint32_t sheet, uint32_t bits,
                       struct sp_error *err) {
    struct gl_state *s = band->state;
    const struct gl_pieces *pieces = &band->slot->pieces;
    const struct gl_bins_space space = gl_elements_space(band, 1);
    glUseProgram(s->meshes.samples.program);
    gl_bins_set_space(&space);
    glUniform4ui(1, band->job->frame->width, (GLuint)pieces->pairs, pieces->element_pairs, first);
    glUniform2ui(3, band->slot->fragments_most, band->fragments->insert.planes);
    gl_buffer_bind(&s->upload.constants.buffer, 0);
    gl_buffer_bind(mesh->constants, 1);
    gl_buffer_bind(mesh->vertices, 2);
    gl_buffer_bind(&s->bins.pairs, 3);
    gl_buffer_bind(meshes->words ? &s->buffers.sheets : &s->buffers.image, 4);
    gl_buffer_bind(mesh->triangles, 5);
    gl_buffer_bind(&s->bins.totals, 6);
    gl_buffer_bind(&s->bins.counts, 7);
    gl_buffer_bind(&s->buffers.fragments, GL_FRAGMENTS);
    for (uint32_t pass = 0; pass < pieces->element_passes; pass++) {
        const bool is_last = pass + 1 == pieces->element_passes;
        glUniform4ui(2, pass, pieces->element_passes, sheet,
                     (pass ? RESUMES : bits & RESUMES) | (is_last ? bits & ~RESUMES : 0u));
        if (!gl_band_draw_layer(band, err))
            return false;
    }
    return true;
}

static bool draw(const struct gl_meshes *meshes, const struct gl_mesh *mesh, struct gl_band *band,
                 struct sp_error *err) {
    const uint32_t records = band->slot->pieces.records, all = mesh->triangle_count;
    for (uint32_t sheet = 0; sheet < mesh->sheets; sheet++)
        for (uint32_t first = 0, n; first < all; first += n) {
            n = all - first < records ? all - first : records;
            uint32_t bits = first ? RESUMES : 0;
            if (first + n == all)
                bits |= ENDS_SHEET | (sheet + 1 == mesh->sheets ? ENDS_MESH : 0);
            /* One batch stays sorted from sheet to sheet. */
            if ((!sheet || n < all) && !sort_batch(mesh, band, first, n, sheet, err))
                return false;
            if (!draw_batch(meshes, mesh, band, first, sheet, bits, err))
                return false;
        }
    return true;
}

bool gl_meshes_draw(const struct gl_meshes *meshes, struct gl_band *band, struct sp_error *err) {
    for (unsigned i = 0; i < meshes->count; i++)
        if (!draw(meshes, &meshes->items[i], band, err))
            return false;
    return true;
}

void gl_meshes_finish(struct gl_state *s) {
    glDeleteProgram(s->meshes.triangles.program);
    glDeleteProgram(s->meshes.samples.program);
    for (int i = 0; i < SP_LAYERS_MAX; i++)
        gl_buffer_finish(&s->meshes.constants[i]);
    memset(&s->meshes, 0, sizeof s->meshes);
}
