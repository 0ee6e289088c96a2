/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <string.h>

#include "draw/layers/mesh/mesh.h"

enum {
    VERTICES = 4096, /* that a worker places at a time */
    CHUNK = 256,     /* triangles whose spans are found at a time */
    BLOCK_MIN = 4096,
    BLOCKS_MAX = 64 /* of triangles: each counts the entries of all tiles */
};

/* Light behind opaque triangles that does not count. */
static const double dark = 1.0 / 512;

/* An entry of the tiles of its span. */
struct seen {
    uint32_t entry;
    struct sp_mesh_span span;
};

struct preparation {
    const struct sp_mesh_input *input;
    struct sp_mesh *mesh;
    struct sp_mesh_place *places;
    struct sp_mesh_piece *pieces;
    float *opacities; /* by block of vertices: the least */
    bool *is_cut;     /* the same: some of them have no place */
    uint32_t block;   /* triangles per block */
    uint32_t blocks, tiles;
    uint32_t *piece_counts; /* [blocks + 1], then where they begin */
    struct seen *seen;      /* of block b from b · block + pieces before it */
    uint32_t *seen_counts;  /* [blocks] */
    uint32_t *counts;       /* [blocks][tiles], then where entries go */
    uint32_t *entries;
};

static bool is_cancelled(const struct preparation *p) {
    return sp_interrupt_is_cancelled(&p->input->interrupt);
}

static void init_transform(struct sp_mesh *m, const struct sp_mesh_input *input) {
    const double *t = input->layer->transform;
    const struct sp_camera_transform *camera = input->camera;
    double offset[3];
    struct sp_mat3 linear;
    for (uint32_t i = 0; i < m->elements->shape.vertex_count; i++) {
        const float *p = m->elements->positions[i];
        if (!isfinite(p[0] + p[1] + p[2]))
            continue;
        memcpy(m->origin, p, sizeof m->origin);
        break;
    }
    for (int r = 0; r < 3; r++) {
        offset[r] = t[4 * r + 3] - camera->eye.v[r];
        for (int a = 0; a < 3; a++) {
            linear.m[r][a] = t[4 * r + a];
            offset[r] += t[4 * r + a] * (double)m->origin[a];
        }
    }
    const struct sp_mat3 whole = sp_mat3_multiply(&camera->w, &linear);
    const struct sp_vec3 shift = sp_mat3_apply(&camera->w, sp_vec3_from(offset));
    for (int r = 0; r < 3; r++) {
        m->shift[r] = (float)shift.v[r];
        for (int a = 0; a < 3; a++) {
            const int p = (r + 1) % 3, q = (r + 2) % 3, b = (a + 1) % 3, c = (a + 2) % 3;
            m->to_camera[r][a] = (float)whole.m[r][a];
            m->normal_to_world[r][a] = /* normals are turned by the cofactors */
                (float)(linear.m[p][b] * linear.m[q][c] - linear.m[q][b] * linear.m[p][c]);
        }
    }
}

/* Half-spaces as samples see them: of a ray's direction and 1/u2, or of its start and −u2. */
static void init_halves(struct sp_mesh *m, const struct sp_mesh_input *input) {
    struct sp_clip_frame clip;
    sp_clip_frame_init(&clip, input->camera, input->grid, &input->view->clip, 1);
    m->half_count = clip.count;
    for (uint32_t i = 0; i < clip.count; i++) {
        const struct sp_clip_half *h = &clip.planes[i];
        const float a = h->normal[0] / m->scale, b = h->normal[1] / m->scale;
        const float at_corner = -a * m->centre[0] - b * m->centre[1];
        m->halves[i] = m->is_perspective
                           ? (struct sp_mesh_half){ a, b, at_corner + h->normal[2], -h->offset }
                           : (struct sp_mesh_half){ a, b, at_corner - h->offset, -h->normal[2] };
    }
    if (!m->is_perspective)
        m->halves[m->half_count++] = (struct sp_mesh_half){ 0, 0, -m->near, -1 };
}

void sp_mesh_init(const struct sp_mesh_input *input, struct sp_mesh *m) {
    const struct sp_camera_transform *camera = input->camera;
    *m = (struct sp_mesh){ .elements = input->elements,
                           .shade = input->shade,
                           .is_perspective = camera->projection == SP_PERSPECTIVE,
                           .scale = (float)camera->scale,
                           .near = (float)camera->near,
                           .has_own_colors = input->layer->colors == SP_COLORS_OWN &&
                                             !input->elements->shape.lacks_colors,
                           .opacity = input->layer->opacity,
                           .apart = 4 };
    for (int i = 0; i < 2; i++) {
        m->size[i] = (int)input->view->size[i];
        m->centre[i] = (float)camera->centre[i];
    }
    for (int c = 0; c < 3; c++)
        m->color[c] = input->layer->color[c];
    m->columns = (m->size[0] + SP_FRAGMENT_TILE - 1) / SP_FRAGMENT_TILE;
    m->rows = (m->size[1] + SP_FRAGMENT_TILE - 1) / SP_FRAGMENT_TILE;
    init_transform(m, input);
    init_halves(m, input);
}

float sp_mesh_least_opacity(const struct sp_elements *e, uint32_t begin, uint32_t end) {
    float least = 1;
    for (uint32_t i = begin; i < end; i++)
        if (!(e->colors[i][3] >= least))
            least = e->colors[i][3] > 0 ? e->colors[i][3] : 0;
    return least;
}

static void place_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    const struct preparation *p = user;
    const struct sp_elements *e = p->input->elements;
    (void)worker;
    for (size_t n = begin; n < end && !is_cancelled(p); n++) {
        const uint32_t from = (uint32_t)n * VERTICES, left = e->shape.vertex_count - from;
        const uint32_t to = from + (left < VERTICES ? left : VERTICES);
        p->input->kernels->place(p->mesh, from, to, p->places);
        p->is_cut[n] = false;
        for (uint32_t i = from; i < to; i++)
            p->is_cut[n] = p->is_cut[n] || isnan(p->places[i].x);
        p->opacities[n] = sp_mesh_least_opacity(e, from, to);
    }
}

int sp_mesh_count_sheets(const struct sp_mesh *mesh, float least) {
    const double opacity = (double)least * (double)mesh->opacity;
    int count = 1;
    for (double light = 1 - opacity; count < SP_MESH_SHEETS && light > dark; count++)
        light *= 1 - opacity;
    return opacity > 0 ? count : SP_MESH_SHEETS;
}

/* Places the vertices. Sets *is_cut if triangles must be clipped. */
static bool place_all(struct preparation *p, bool *is_cut) {
    const uint32_t vertices = p->input->elements->shape.vertex_count;
    const uint32_t blocks = (vertices + VERTICES - 1) / VERTICES;
    struct sp_arena *arena = p->input->arena;
    float opacity = 1;
    p->places = sp_arena_alloc(arena, "places", vertices, sizeof *p->places);
    p->opacities = sp_arena_alloc(arena, "places", blocks, sizeof *p->opacities);
    p->is_cut = sp_arena_alloc(arena, "places", blocks, sizeof *p->is_cut);
    if (!p->places || !p->opacities || !p->is_cut)
        return false;
    sp_parallel_for(p->input->pool, blocks, 1, place_blocks, p);
    *is_cut = false;
    for (uint32_t n = 0; n < blocks && !is_cancelled(p); n++) {
        *is_cut = *is_cut || p->is_cut[n];
        opacity = fminf(opacity, p->opacities[n]);
    }
    p->mesh->places = p->places;
    p->mesh->has_opacities = opacity < 1;
    p->mesh->sheets = sp_mesh_count_sheets(p->mesh, opacity);
    return true;
}

static bool must_be_clipped(const struct sp_mesh_span *span) {
    return span->c1 < span->c0 && span->r1 < span->r0;
}

static uint32_t block_end(const struct preparation *p, size_t block) {
    const uint32_t count = p->input->elements->shape.count, from = (uint32_t)block * p->block;
    return count - from < p->block ? count : from + p->block;
}

static void count_pieces(void *user, size_t begin, size_t end, unsigned worker) {
    struct preparation *p = user;
    struct sp_mesh_span spans[CHUNK];
    struct sp_mesh_piece pieces[SP_MESH_PIECES_MAX];
    (void)worker;
    for (size_t n = begin; n < end && !is_cancelled(p); n++) {
        const uint32_t last = block_end(p, n);
        uint32_t count = 0;
        for (uint32_t from = (uint32_t)n * p->block; from < last; from += CHUNK) {
            const uint32_t here = last - from < CHUNK ? last - from : CHUNK;
            p->input->kernels->compute_spans(p->mesh, from, here, spans);
            for (uint32_t i = 0; i < here; i++)
                if (must_be_clipped(&spans[i]))
                    count += (uint32_t)sp_mesh_clip(p->mesh, from + i, pieces);
        }
        p->piece_counts[n] = count;
    }
}

/* Counts the pieces of triangles by block, and allocates them. */
static bool allocate_pieces(struct preparation *p, bool is_cut) {
    uint32_t at = 0;
    p->piece_counts =
        sp_arena_alloc(p->input->arena, "pieces", p->blocks + 1, sizeof *p->piece_counts);
    if (!p->piece_counts)
        return false;
    memset(p->piece_counts, 0, (p->blocks + 1) * sizeof *p->piece_counts);
    if (!is_cut)
        return true;
    sp_parallel_for(p->input->pool, p->blocks, 1, count_pieces, p);
    for (uint32_t n = 0; n <= p->blocks && !is_cancelled(p); n++) {
        const uint32_t count = p->piece_counts[n];
        p->piece_counts[n] = at;
        at += count;
    }
    p->pieces = sp_arena_alloc(p->input->arena, "pieces", at, sizeof *p->pieces);
    p->mesh->pieces = p->pieces;
    return p->pieces;
}

/* The span of a piece. */
static struct sp_mesh_span piece_span(const struct preparation *p,
                                      const struct sp_mesh_piece *piece) {
    static const uint32_t corners[1][3] = { { 0, 1, 2 } };
    struct sp_elements one = { .triangles = (uint32_t(*)[3])corners };
    struct sp_mesh mesh = *p->mesh;
    struct sp_mesh_span span;
    mesh.elements = &one;
    mesh.places = piece->corners;
    p->input->kernels->compute_spans(&mesh, 0, 1, &span);
    return span;
}

/* Adds an entry to a block; returns how many it has then. */
static uint32_t add_seen(const struct preparation *p, size_t block, struct seen *seen, uint32_t at,
                         uint32_t entry, const struct sp_mesh_span *span) {
    uint32_t *counts = p->counts + block * p->tiles;
    if (span->c1 < span->c0)
        return at;
    seen[at] = (struct seen){ entry, *span };
    for (unsigned r = span->r0; r <= span->r1; r++)
        for (unsigned c = span->c0; c <= span->c1; c++)
            counts[r * (unsigned)p->mesh->columns + c]++;
    return at + 1;
}

static void see_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    struct preparation *p = user;
    struct sp_mesh_span spans[CHUNK];
    const uint32_t count = p->input->elements->shape.count;
    (void)worker;
    for (size_t n = begin; n < end && !is_cancelled(p); n++) {
        const uint32_t last = block_end(p, n);
        struct seen *seen = p->seen + (size_t)n * p->block + p->piece_counts[n];
        uint32_t at = 0, piece = p->piece_counts[n];
        memset(p->counts + n * p->tiles, 0, p->tiles * sizeof *p->counts);
        for (uint32_t from = (uint32_t)n * p->block; from < last; from += CHUNK) {
            const uint32_t here = last - from < CHUNK ? last - from : CHUNK;
            p->input->kernels->compute_spans(p->mesh, from, here, spans);
            for (uint32_t i = 0; i < here; i++) {
                if (!must_be_clipped(&spans[i])) {
                    at = add_seen(p, n, seen, at, from + i, &spans[i]);
                    continue;
                }
                struct sp_mesh_piece pieces[SP_MESH_PIECES_MAX];
                const int parts = sp_mesh_clip(p->mesh, from + i, pieces);
                for (int k = 0; k < parts; k++, piece++) {
                    const struct sp_mesh_span span = piece_span(p, &pieces[k]);
                    p->pieces[piece] = pieces[k];
                    at = add_seen(p, n, seen, at, count + piece, &span);
                }
            }
        }
        p->seen_counts[n] = at;
    }
}

static void fill_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    const struct preparation *p = user;
    const unsigned columns = (unsigned)p->mesh->columns;
    (void)worker;
    for (size_t n = begin; n < end && !is_cancelled(p); n++) {
        const struct seen *seen = p->seen + (size_t)n * p->block + p->piece_counts[n];
        uint32_t *next = p->counts + n * p->tiles;
        for (uint32_t i = 0; i < p->seen_counts[n]; i++)
            for (unsigned r = seen[i].span.r0; r <= seen[i].span.r1; r++)
                for (unsigned c = seen[i].span.c0; c <= seen[i].span.c1; c++)
                    p->entries[next[r * columns + c]++] = seen[i].entry;
    }
}

/* Turns counts into starts. False if there are too many entries. */
static bool sum_counts(struct preparation *p, uint32_t *first) {
    uint64_t at = 0;
    for (uint32_t t = 0; t < p->tiles; t++) {
        first[t] = (uint32_t)at;
        for (uint32_t n = 0; n < p->blocks; n++) {
            uint32_t *count = &p->counts[(size_t)n * p->tiles + t], had = *count;
            *count = (uint32_t)at;
            at += had;
        }
        if (at > UINT32_MAX)
            return false;
    }
    first[p->tiles] = (uint32_t)at;
    return true;
}

/* Sorts the triangles into tiles. False: out of memory. */
static bool sort_triangles(struct preparation *p) {
    struct sp_arena *arena = p->input->arena;
    const uint32_t count = p->input->elements->shape.count, pieces = p->piece_counts[p->blocks];
    uint32_t *first = sp_arena_alloc(arena, "tiles", p->tiles + 1, sizeof *first);
    p->seen = sp_arena_alloc(arena, "triangles", (size_t)count + pieces, sizeof *p->seen);
    p->seen_counts = sp_arena_alloc(arena, "triangles", p->blocks, sizeof *p->seen_counts);
    p->counts = sp_arena_alloc(arena, "tiles", (size_t)p->blocks * p->tiles, sizeof *p->counts);
    if (!first || !p->seen || !p->seen_counts || !p->counts)
        return false;
    sp_parallel_for(p->input->pool, p->blocks, 1, see_blocks, p);
    if (is_cancelled(p))
        return true;
    if (!sum_counts(p, first))
        return false;
    p->entries = sp_arena_alloc(arena, "entries", first[p->tiles], sizeof *p->entries);
    if (!p->entries)
        return false;
    sp_parallel_for(p->input->pool, p->blocks, 1, fill_blocks, p);
    p->mesh->first = first;
    p->mesh->entries = p->entries;
    return true;
}

bool sp_mesh_prepare(const struct sp_mesh_input *input, struct sp_mesh *mesh,
                     struct sp_error *err) {
    struct preparation p = { .input = input, .mesh = mesh };
    const uint32_t count = input->elements->shape.count,
                   least = (count + BLOCKS_MAX - 1) / BLOCKS_MAX;
    bool is_cut;
    sp_mesh_init(input, mesh);
    p.block = least > BLOCK_MIN ? least : BLOCK_MIN;
    p.blocks = (count + p.block - 1) / p.block;
    p.tiles = (uint32_t)(mesh->columns * mesh->rows);
    bool is_done = place_all(&p, &is_cut) && allocate_pieces(&p, is_cut) && sort_triangles(&p);
    if (is_cancelled(&p))
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    return is_done || sp_arena_fail(input->arena, "entries", err);
}

struct sp_mesh_scratch *sp_mesh_scratch_alloc(struct sp_arena *arena, int sheets) {
    struct sp_mesh_scratch *scratch =
        sp_arena_alloc(arena, "samples of meshes", 1, sizeof *scratch);
    if (scratch)
        scratch->sheets =
            sp_arena_alloc(arena, "samples of meshes", (size_t)sheets, sizeof *scratch->sheets);
    return scratch && scratch->sheets ? scratch : NULL;
}
