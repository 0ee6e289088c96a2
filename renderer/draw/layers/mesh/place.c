/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "base/minmax.h"
#include "draw/layers/mesh/kernels.h"

/* Vertices farther beside the image than this are clipped: the edges of larger triangles would be
 * off by too much [px]. */
static const float beside = 8192;

static inline void place_vertices(const struct sp_mesh *m, const float (*positions)[3], int count,
                                  struct sp_mesh_place *places) {
    float axes[3][SP_WIDE] = { { 0 } }, out[4][SP_WIDE];
    sp_wide p[3], u[3];
    for (int i = 0; i < count; i++)
        for (int a = 0; a < 3; a++)
            axes[a][i] = positions[i][a];
    for (int a = 0; a < 3; a++)
        p[a] = sp_wide_load(axes[a]) - m->origin[a];
    for (int r = 0; r < 3; r++)
        u[r] = m->shift[r] + p[0] * m->to_camera[r][0] + p[1] * m->to_camera[r][1] +
               p[2] * m->to_camera[r][2];
    sp_wide inverse = m->is_perspective ? 1 / u[2] : -u[2];
    sp_wide scale = m->is_perspective ? m->scale * inverse : sp_wide_all(m->scale);
    sp_wide x = m->centre[0] + u[0] * scale, y = m->centre[1] + u[1] * scale;
    const float low = -beside, right = (float)m->size[0] + beside, end = (float)m->size[1] + beside;
    sp_wide_mask is_fine = sp_wide_lt(sp_wide_all(low), x) & sp_wide_lt(x, sp_wide_all(right)) &
                           sp_wide_lt(sp_wide_all(low), y) & sp_wide_lt(y, sp_wide_all(end)) &
                           sp_wide_lt(sp_wide_abs(u[2]), sp_wide_all(INFINITY));
    if (m->is_perspective)
        is_fine = is_fine & sp_wide_le(sp_wide_all(m->near), u[2]);
    sp_wide_store(out[0], sp_wide_select(is_fine, x, sp_wide_all(NAN)));
    sp_wide_store(out[1], y);
    sp_wide_store(out[2], inverse);
    sp_wide_store(out[3], u[2]);
    for (int i = 0; i < count; i++)
        places[i] = (struct sp_mesh_place){ out[0][i], out[1][i], out[2][i], out[3][i] };
}

void sp_mesh_place(const struct sp_mesh *mesh, uint32_t begin, uint32_t end,
                   struct sp_mesh_place *places) {
    for (uint32_t i = begin; i < end; i += SP_WIDE) {
        const uint32_t left = end - i;
        place_vertices(mesh, (const float(*)[3])mesh->elements->positions + i,
                       left < SP_WIDE ? (int)left : SP_WIDE, places + i);
    }
}

/* The tiles between two coordinates; false if that is beside the image. */
static inline bool bound_tiles(float low, float high, int size, uint8_t *first, uint8_t *last) {
    if (!(high >= 0 && low < (float)size))
        return false;
    const int end = size - 1, from = (int)sp_maxf(low, 0), to = (int)sp_minf(high, (float)end);
    *first = (uint8_t)(from / SP_FRAGMENT_TILE);
    *last = (uint8_t)(to / SP_FRAGMENT_TILE);
    return true;
}

void sp_mesh_compute_spans(const struct sp_mesh *mesh, uint32_t first, uint32_t count,
                           struct sp_mesh_span *spans) {
    const uint32_t(*triangles)[3] = (const uint32_t(*)[3])mesh->elements->triangles + first;
    for (uint32_t i = 0; i < count; i++) {
        const struct sp_mesh_place *a = &mesh->places[triangles[i][0]],
                                   *b = &mesh->places[triangles[i][1]],
                                   *c = &mesh->places[triangles[i][2]];
        struct sp_mesh_span *span = &spans[i];
        *span = (struct sp_mesh_span){ 1, 1, 0, 0 };
        if (isnan(a->x + b->x + c->x))
            continue;
        span->r1 = 1;
        const float x0 = sp_minf(sp_minf(a->x, b->x), c->x),
                    x1 = sp_maxf(sp_maxf(a->x, b->x), c->x);
        const float y0 = sp_minf(sp_minf(a->y, b->y), c->y),
                    y1 = sp_maxf(sp_maxf(a->y, b->y), c->y);
        uint8_t rows[2];
        if (bound_tiles(y0, y1, mesh->size[1], &rows[0], &rows[1]) &&
            bound_tiles(x0, x1, mesh->size[0], &span->c0, &span->c1)) {
            span->r0 = rows[0];
            span->r1 = rows[1];
        }
    }
}
