/* SPDX-License-Identifier: Apache-2.0
 *
 * The loops over vertices, triangles and samples of a mesh, compiled once per instruction set
 * (base/isa.h).
 *
 *   place ─► compute_spans ─► (tiles, prepare.c) ─► tile: cover ─► sheets ─► resolve ─► fragments
 */
#ifndef SP_MESH_KERNELS_H
#define SP_MESH_KERNELS_H

#include "base/isa.h"
#include "frame/fragments.h"
#include "sp/elements.h"
#include "splat/extent.h"
#include "splat/shade.h"

enum {
    SP_MESH_SAMPLES = 16, /* per pixel */
    SP_MESH_SHEETS = 16,  /* most triangles, one behind the other, of a sample */
    SP_MESH_NONE = -1     /* a sample without a triangle */
};

/* A vertex in the image. x is NaN if the vertex is not finite, nearer than the near plane, or too
 * far beside the image. Triangles with such a vertex are clipped. */
struct sp_mesh_place {
    float x, y;    /* px */
    float inverse; /* 1/u2; orthographic: −u2. Linear in the image; nearer is larger. */
    float u2;      /* world units */
};

/* A part of a triangle that was clipped. */
struct sp_mesh_piece {
    struct sp_mesh_place corners[3];
    uint32_t triangle;
};

/* Tiles that a triangle touches: columns [c0, c1], rows [r0, r1]. */
struct sp_mesh_span {
    uint8_t c0, r0, c1, r1; /* c1 < c0: no tiles; if r1 < r0 as well: it must be clipped */
};

/* A half-space in the image: it keeps samples with x·a + y·b + c + inverse·d ≥ 0. */
struct sp_mesh_half {
    float a, b, c, d;
};

/* A mesh in a frame. */
struct sp_mesh {
    const struct sp_elements *elements;
    const struct sp_shade *shade; /* NULL = not lit */
    bool is_perspective;
    int size[2];                 /* of the image, px */
    float scale, centre[2];      /* struct sp_camera_transform */
    float near;                  /* world units */
    float origin[3];             /* of the mesh, world; `to_camera` and `shift` refer to it */
    float to_camera[3][3];       /* mesh → camera space */
    float shift[3];              /* the origin in camera space */
    float normal_to_world[3][3]; /* for the mesh's normals; it changes their length */
    bool has_own_colors;         /* the colours of the vertices are drawn */
    bool has_opacities;          /* the vertices have opacities below 1 */
    float color[3], opacity;     /* of the layer */
    int sheets;                  /* number of sheets that may be visible, [1, SP_MESH_SHEETS] */
    float apart; /* fragments of a pixel stay apart if their depths differ by more [px] */
    uint32_t half_count;
    struct sp_mesh_half halves[SP_CUTS_MAX + 1];
    const struct sp_mesh_place *places; /* [vertex_count] */
    const struct sp_mesh_piece *pieces; /* entry number count + i is piece i */
    int columns, rows;                  /* of tiles */
    const uint32_t *first;              /* [columns · rows + 1] */
    const uint32_t *entries; /* of tile t: [first[t], first[t + 1]), in the order of triangles */
};

/* Per sample, the nearest triangle behind the previous sheet. Pixels follow each other row by
 * row. */
struct sp_mesh_sheet {
    _Alignas(64) float inverse[SP_FRAGMENT_PIXELS * SP_MESH_SAMPLES]; /* −∞ = none */
    _Alignas(64) int32_t triangle[SP_FRAGMENT_PIXELS * SP_MESH_SAMPLES];
};

enum {
    SP_MESH_ROW = SP_FRAGMENT_TILE * SP_MESH_SAMPLES * SP_MESH_SHEETS, /* a multiple of SP_WIDE */
};

/* The visible parts of triangles in the pixels of one row. A part is a set of samples of one pixel
 * that lie in one triangle. */
struct sp_mesh_parts {
    int first[SP_FRAGMENT_TILE + 1]; /* by pixel */
    uint16_t samples[SP_MESH_ROW];   /* bit s: sample s */
    _Alignas(64) int32_t triangle[SP_MESH_ROW];
    float x[SP_MESH_ROW], y[SP_MESH_ROW]; /* middle of these samples, px; y from the row */
    float depth[SP_MESH_ROW];             /* u2 there */
    float color[3][SP_MESH_ROW], alpha[SP_MESH_ROW]; /* not premultiplied */
};

/* The memory of a worker for one tile. */
struct sp_mesh_scratch {
    struct sp_mesh_sheet *sheets; /* as many as a mesh of the frame has */
    struct sp_mesh_parts parts;
};

struct sp_mesh_kernels {
    /* Fills places[begin … end) of the mesh. */
    void (*place)(const struct sp_mesh *mesh, uint32_t begin, uint32_t end,
                  struct sp_mesh_place *places);
    /* Fills the spans of triangles [first, first + count). */
    void (*compute_spans)(const struct sp_mesh *mesh, uint32_t first, uint32_t count,
                          struct sp_mesh_span *spans);
    /* Adds the fragments of a tile, at (tile->x, tile->y). */
    void (*tile)(const struct sp_mesh *mesh, struct sp_mesh_scratch *scratch,
                 struct sp_fragment_tile *tile);
};

/* The functions of the instruction set that the including source is compiled for. */
void sp_mesh_place(const struct sp_mesh *mesh, uint32_t begin, uint32_t end,
                   struct sp_mesh_place *places);
void sp_mesh_compute_spans(const struct sp_mesh *mesh, uint32_t first, uint32_t count,
                           struct sp_mesh_span *spans);
void sp_mesh_tile(const struct sp_mesh *mesh, struct sp_mesh_scratch *scratch,
                  struct sp_fragment_tile *tile);

#endif
