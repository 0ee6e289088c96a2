/* SPDX-License-Identifier: Apache-2.0
 *
 * Puts the values of pieces in their places: a box of a grid, or after the values of other pieces.
 * Leaves out copies of points of other pieces (ghosts). Where pieces overlap, the last one counts.
 */
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/vectors.h"
#include "data/import/vtk.h"

enum { BOXES_MAX = 1 << 14 };

struct placing { /* one array of one piece */
    const struct vtk_stream *stream;
    const struct vtk_entry *entry;
    bool in_grid;
    uint32_t dims[3], at[3]; /* of the piece in the grid, in tuples */
    uint64_t base;           /* without a grid: tuples of earlier pieces */
    const uint8_t *ghosts;   /* one per tuple; NULL = none */
    const uint32_t *whole;   /* dims of the grid */
    uint64_t done;           /* bytes of earlier pieces in the output */
    uint64_t put;            /* tuples of this piece that are no ghosts */
};

/* Computes the box of a piece; cells lie between points. */
static void compute_box(const struct vtk_volume *v, const struct vtk_piece *piece, uint32_t dims[3],
                        uint32_t at[3]) {
    for (int axis = 0; axis < 3; axis++) {
        dims[axis] = piece->dims[axis];
        at[axis] = (uint32_t)(piece->first[axis] - v->first[axis]);
        if (v->home == VTK_OF_CELLS && v->points[axis] > 1)
            dims[axis]--;
    }
}

/* Describes the values of a piece. False if it has none. */
static bool describe_placing(const struct vtk_volume *v, const struct vtk_piece *piece,
                             const struct vtk_stream *stream, struct placing *p) {
    const struct vtk_entry *e = stream->choice.entry;
    *p =
        (struct placing){ .stream = stream, .in_grid = v->set <= VTK_STRUCTURED, .whole = v->dims };
    p->entry = vtk_find_entry(v, piece, e->home, e->part, e->name);
    compute_box(v, piece, p->dims, p->at);
    return p->entry != NULL;
}

static uint64_t tuples_of(const struct placing *p, const struct vtk_piece *piece) {
    return p->in_grid ? (uint64_t)p->dims[0] * p->dims[1] * p->dims[2] : piece->count;
}

static size_t sample_bytes(const struct vtk_stream *s) {
    return s->conversion ? sp_type_size(s->conversion->type) : 3 * sizeof(float);
}

/* Puts `n` tuples where tuple `at` of the output is. */
static void put(const struct placing *p, uint64_t at, const char *values, size_t n) {
    const struct vtk_stream *s = p->stream;
    const struct import_number number = p->entry->array.type->number;
    if (!s->conversion) {
        const struct import_vectors out = { .number = number,
                                            .out = (float(*)[3])(void *)s->out + at,
                                            .shift = s->shift };
        import_vectors_put(&out, 0, values, 3 * n);
    } else if (import_conversion_is_copy(s->conversion)) {
        memcpy(s->out + at * number.size, values, n * number.size);
    } else {
        import_conversion_put(s->conversion, values, n, s->out + at * sample_bytes(s));
    }
}

/* Puts tuples of a box row by row. */
static void put_in_grid(const struct placing *p, uint64_t first, const char *values, size_t n,
                        size_t tuple_bytes) {
    while (n > 0) {
        const uint64_t row = first / p->dims[0], i = first % p->dims[0];
        const uint64_t j = row % p->dims[1] + p->at[1], k = row / p->dims[1] + p->at[2];
        const size_t part = n < p->dims[0] - i ? n : (size_t)(p->dims[0] - i);
        put(p, (k * p->whole[1] + j) * p->whole[0] + p->at[0] + i, values, part);
        values += part * tuple_bytes;
        first += part;
        n -= part;
    }
}

static void place_values(void *user, uint64_t first, const void *values, size_t n) {
    struct placing *p = user;
    const unsigned components = p->entry->components;
    const size_t tuple_bytes = components * p->entry->array.type->number.size;
    first /= components;
    n /= components;
    if (values && p->in_grid) {
        put_in_grid(p, first, values, n, tuple_bytes);
    } else if (values && !p->ghosts) {
        put(p, p->base + first, values, n);
    } else if (values) {
        for (size_t i = 0; i < n; i++)
            if (!p->ghosts[first + i])
                put(p, p->base + p->put++, (const char *)values + i * tuple_bytes, 1);
    }
    import_report(p->stream->progress, p->done + (first + n) * sample_bytes(p->stream));
}

/* Ghosts. */

struct ghosts {
    uint8_t *are;
    bool are_levels;
    struct import_number number;
    uint64_t kept;
};

/* Of vtkGhostType, a byte, the bits 1 (copy) and 2 (hidden) count, of vtkGhostLevels all. */
static void mark_ghosts(void *user, uint64_t first, const void *values, size_t n) {
    struct ghosts *g = user;
    for (size_t i = 0; i < n; i++) {
        const double value = import_widen((const char *)values + i * g->number.size, g->number);
        const bool is =
            g->are_levels ? value > 0 : value >= 1 && value <= UINT8_MAX && ((int)value & 3) != 0;
        g->kept += !is;
        if (g->are)
            g->are[first + i] = is;
    }
}

static const struct vtk_entry *find_ghosts(const struct vtk_volume *v,
                                           const struct vtk_piece *piece) {
    const struct vtk_entry *e = vtk_find_entry(v, piece, VTK_OF_POINTS, 0, "vtkGhostType");
    if (!e)
        e = vtk_find_entry(v, piece, VTK_OF_POINTS, 0, "vtkGhostLevels");
    return e && e->components == 1 ? e : NULL;
}

/* Reads which points of a piece are ghosts. `are` may be NULL. */
static bool read_ghosts(struct vtk_volume *v, const struct vtk_piece *piece,
                        const struct vtk_entry *e, uint8_t *are, uint64_t *kept,
                        struct sp_error *err) {
    struct vtk_array a = e->array;
    struct ghosts g = { .are = are,
                        .are_levels = strcmp(e->name, "vtkGhostLevels") == 0,
                        .number = a.type->number };
    a.count = piece->count;
    const struct import_file *file = vtk_open_file(v, piece->file, err);
    if (!file || !vtk_array_check(file, &a, err) ||
        !vtk_array_read(file, &a, &(struct vtk_sink){ mark_ghosts, &g }, err))
        return false;
    *kept = g.kept;
    return true;
}

bool vtk_count_kept(struct vtk_volume *v, uint64_t *count, struct sp_error *err) {
    *count = 0;
    for (size_t p = 0; p < v->piece_count; p++) {
        struct vtk_piece *piece = &v->pieces[p];
        const struct vtk_entry *e = find_ghosts(v, piece);
        piece->kept = piece->count;
        if (e && piece->count && !read_ghosts(v, piece, e, NULL, &piece->kept, err))
            return false;
        *count += piece->kept;
    }
    return true;
}

struct hidden {
    struct import_number number;
    unsigned bit;
    uint64_t count;
};

static void count_hidden(void *user, uint64_t first, const void *values, size_t n) {
    struct hidden *h = user;
    (void)first;
    for (size_t i = 0; i < n; i++) {
        const double value = import_widen((const char *)values + i * h->number.size, h->number);
        h->count += value >= 1 && value <= UINT8_MAX && ((unsigned)value & h->bit);
    }
}

bool vtk_warn_of_hidden(struct vtk_volume *v, struct sp_error *err) {
    struct hidden h = { .bit = v->home == VTK_OF_CELLS ? 32 : 2 };
    for (size_t i = 0; i < v->piece_count; i++) {
        const struct vtk_piece *piece = &v->pieces[i];
        const struct vtk_entry *e = vtk_find_entry(v, piece, v->home, 0, "vtkGhostType");
        uint32_t dims[3], at[3];
        compute_box(v, piece, dims, at);
        if (!e || e->components != 1 || !dims[0] || !dims[1] || !dims[2])
            continue;
        struct vtk_array a = e->array;
        a.count = (uint64_t)dims[0] * dims[1] * dims[2];
        h.number = a.type->number;
        const struct import_file *file = vtk_open_file(v, piece->file, err);
        if (!file || !vtk_array_check(file, &a, err) ||
            !vtk_array_read(file, &a, &(struct vtk_sink){ count_hidden, &h }, err))
            return false;
    }
    if (h.count > 0)
        import_warn(v->file->warnings,
                    "%" PRIu64 " %s of the grid are hidden (vtkGhostType); their numbers are "
                    "also shown.",
                    h.count, v->home == VTK_OF_CELLS ? "cells" : "points");
    return true;
}

/* Streams. */

bool vtk_stream_check(struct vtk_volume *v, const struct vtk_stream *stream, struct sp_error *err) {
    for (size_t i = 0; stream->choice.entry && i < v->piece_count; i++) {
        const struct vtk_piece *piece = &v->pieces[i];
        struct placing p;
        if (!describe_placing(v, piece, stream, &p) || tuples_of(&p, piece) == 0)
            continue;
        struct vtk_array a = p.entry->array;
        a.count = tuples_of(&p, piece) * p.entry->components;
        const struct import_file *file = vtk_open_file(v, piece->file, err);
        if (!file || !vtk_array_check(file, &a, err))
            return false;
    }
    return true;
}

/* True if the values of the piece are the bytes of the output, one after another. */
static bool is_direct(const struct placing *p) {
    const struct vtk_stream *s = p->stream;
    const struct import_number number = p->entry->array.type->number;
    const bool is_copy = s->conversion
                             ? import_conversion_is_copy(s->conversion)
                             : number.kind == IMPORT_FLOAT && number.size == sizeof(float);
    return is_copy && !p->ghosts && !import_shift_is_there(s->shift) &&
           (!p->in_grid || memcmp(p->dims, p->whole, sizeof p->dims) == 0);
}

/* Passes the values of a piece to place_values(). */
static bool read_piece(struct vtk_volume *v, const struct vtk_piece *piece, struct placing *p,
                       struct sp_error *err) {
    struct vtk_array a = p->entry->array;
    a.tuple = p->entry->components;
    a.count = tuples_of(p, piece) * p->entry->components;
    const struct import_file *file = vtk_open_file(v, piece->file, err);
    const struct vtk_sink sink = { place_values, p };
    if (!file)
        return false;
    if (!is_direct(p))
        return vtk_array_read(file, &a, &sink, err);
    return vtk_array_copy(file, &a, p->stream->out + p->base * sample_bytes(p->stream), &sink, err);
}

bool vtk_stream_read(struct vtk_volume *v, const struct vtk_stream *stream, struct sp_error *err) {
    uint64_t base = 0, done = 0;
    bool ok = true;
    for (size_t i = 0; ok && i < v->piece_count; i++) {
        const struct vtk_piece *piece = &v->pieces[i];
        struct placing p;
        if (describe_placing(v, piece, stream, &p) && tuples_of(&p, piece) > 0) {
            const struct vtk_entry *e = p.in_grid ? NULL : find_ghosts(v, piece);
            uint8_t *ghosts = e ? malloc((size_t)piece->count) : NULL;
            uint64_t kept;
            p.base = base;
            p.done = done;
            p.ghosts = ghosts;
            ok = !e || (ghosts ? read_ghosts(v, piece, e, ghosts, &kept, err)
                               : sp_fail(err, SP_ERR_MEMORY, v->file->title,
                                         "out of memory for the ghosts of %zu points",
                                         (size_t)piece->count));
            ok = ok && read_piece(v, piece, &p, err);
            free(ghosts);
            done += tuples_of(&p, piece) * sample_bytes(stream);
        }
        base += piece->kept;
    }
    return ok;
}

/* Gaps: what is left of the grid when the box of every piece is taken from it. */

struct box {
    uint32_t low[3], high[3];
};

struct boxes {
    size_t count;
    struct box list[BOXES_MAX];
};

static bool is_apart(const struct box *a, const struct box *b) {
    for (int axis = 0; axis < 3; axis++)
        if (a->high[axis] <= b->low[axis] || b->high[axis] <= a->low[axis])
            return true;
    return false;
}

/* Replaces a box by up to six parts of it that lie outside of `piece`. False if the list is full.
 */
static bool cut(struct boxes *boxes, size_t i, const struct box *piece) {
    struct box rest = boxes->list[i];
    boxes->list[i] = boxes->list[--boxes->count];
    for (int axis = 0; axis < 3; axis++)
        for (int side = 0; side < 2; side++) {
            struct box part = rest;
            if (side == 0 ? rest.low[axis] >= piece->low[axis]
                          : rest.high[axis] <= piece->high[axis])
                continue;
            if (boxes->count == BOXES_MAX)
                return false;
            if (side == 0)
                part.high[axis] = rest.low[axis] = piece->low[axis];
            else
                part.low[axis] = rest.high[axis] = piece->high[axis];
            boxes->list[boxes->count++] = part;
        }
    return true;
}

bool vtk_has_gaps(const struct vtk_volume *v) {
    struct boxes *boxes = v->piece_count > 1 ? malloc(sizeof *boxes) : NULL;
    if (!boxes)
        return false;
    boxes->count = 1;
    boxes->list[0] = (struct box){ .low = { 0 } };
    memcpy(boxes->list[0].high, v->dims, sizeof v->dims);
    bool is_known = true;
    for (size_t p = 0; p < v->piece_count && is_known; p++) {
        struct box piece;
        uint32_t dims[3];
        compute_box(v, &v->pieces[p], dims, piece.low);
        for (int axis = 0; axis < 3; axis++)
            piece.high[axis] = piece.low[axis] + dims[axis];
        /* The parts that cut() adds are outside of the piece. */
        for (size_t i = boxes->count; i-- > 0 && is_known;)
            if (!is_apart(&boxes->list[i], &piece))
                is_known = cut(boxes, i, &piece);
    }
    const bool has = boxes->count > 0;
    free(boxes);
    return has;
}
