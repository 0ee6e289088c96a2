/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/memory.h"

#include <math.h>

#include "base/minmax.h"

enum {
    PAIRS_MAX = 1 << 25,
    RECORDS_MAX = 4000000, /* a pair has 22 bits for it; the count of GL_SCAN_BLOCK bins fits
                               a word */
    BINS_MAX = 1 << 25,
    TILES_MAX = 1 << 17, /* 8 million px */
    LOOPS_MAX = 1 << 19, /* per work group: about 10 ms without waits for memory */
    STALL_FACTOR = 8,    /* times as long if each round waits for memory */
    DISPATCH_MS = 25,    /* half of the acceptable time: the next frame may take twice as long */
    BINS_SOFTWARE = 1 << 22,
    TILES_SOFTWARE = 1 << 15,
    LOOPS_SOFTWARE = 30000, /* llvmpipe ends loops after 65535 rounds without an error; an
                               iteration of a nested loop counts as two */
    PARTS = 8,              /* parts of the budget: each of four kinds of scratch gets one */
    PIXEL_BYTES = GL_PIXEL_BYTES + 16 + 2 * 16, /* image, pixels and two readbacks */
    LOOKS = 256, /* frames between two checks for oversized scratch memory */
    LARGER = 4   /* times larger than needed counts as oversized */
};

void gl_memory_limit(struct gl_state *s) {
    uint64_t part =
        s->residency.limit_bytes / PARTS * 4 / 5; /* buffers are a quarter larger than asked */
    uint64_t block = s->block_bytes ? s->block_bytes : UINT64_MAX;
    uint64_t words = sp_minu(part / sizeof(uint32_t), block / sizeof(uint32_t) - GL_BINS_HEAD);
    uint64_t px = sp_minu(part / PIXEL_BYTES, block / GL_PIXEL_BYTES);
    bool software = gl_context_info(s->context)->software;
    struct gl_limits *limits = &s->workload.limits;
    *limits =
        (struct gl_limits){ .records = RECORDS_MAX,
                            .record_bytes = part,
                            .bins = (uint32_t)sp_minu(software ? BINS_SOFTWARE : BINS_MAX, words),
                            .tiles = (uint32_t)sp_minu(software ? TILES_SOFTWARE : TILES_MAX,
                                                       px / (GL_TILE * GL_TILE)),
                            .pairs = sp_minu(PAIRS_MAX, words),
                            .loops = software ? LOOPS_SOFTWARE : LOOPS_MAX,
                            .stall_factor = software ? 1 : STALL_FACTOR,
                            .dispatch_ms = software ? INFINITY : DISPATCH_MS };
}

static uint64_t of_slots(const struct gl_state *s) {
    uint64_t bytes = 0;
    for (int i = 0; i < GL_IN_FLIGHT; i++)
        bytes += s->slots[i].readback.buffer.bytes;
    return bytes;
}

uint64_t gl_draw_bytes(const struct gl_state *s) {
    const struct gl_buffer *buffers = (const struct gl_buffer *)&s->buffers;
    uint64_t bytes = gl_resample_bytes(&s->resample);
    for (size_t i = 0; i < sizeof s->buffers / sizeof *buffers; i++)
        bytes += buffers[i].bytes;
    for (int i = 0; i < SP_LAYERS_MAX; i++)
        bytes += s->surfaces.constants[i].bytes + s->meshes.constants[i].bytes +
                 s->splats.constants[i].bytes + s->splats.order[i].bytes +
                 s->splats.choice[i].bytes;
    return bytes + s->bins.counts.bytes + s->bins.totals.bytes + s->bins.pairs.bytes +
           s->curve.buffer.bytes + s->upload.constants.buffer.bytes +
           s->upload.before.buffer.bytes + s->upload.chunks.bytes +
           s->residency.classify.listed.bytes + s->residency.classify.counts.bytes +
           s->residency.classify.firsts.bytes + s->residency.classify.points.bytes +
           s->residency.classify.cell_bounds.ends.bytes + of_slots(s);
}

/* The buffers of scratch memory; ends with NULL. */
struct scratch {
    struct gl_buffer *buffers[14];
};

static struct scratch scratch_of(struct gl_state *s) {
    return (struct scratch){ { &s->buffers.records, &s->buffers.spans, &s->buffers.image,
                               &s->buffers.pixels, &s->buffers.fragments, &s->buffers.sheets,
                               &s->buffers.items[0], &s->buffers.items[1], &s->buffers.digits,
                               &s->bins.counts, &s->bins.totals, &s->bins.pairs, &s->upload.chunks,
                               NULL } };
}

bool gl_memory_release(struct gl_state *s) {
    const struct scratch scratch = scratch_of(s);
    bool had = false;
    for (int i = 0; scratch.buffers[i]; i++) {
        had = had || scratch.buffers[i]->name;
        gl_buffer_finish(scratch.buffers[i]);
    }
    s->surfaces.per_pixel = 0;
    s->workload.pairs = sp_minu(GL_PAIRS_MIN, gl_workload_limits(&s->workload).pairs);
    s->residency.beside_bytes = gl_draw_bytes(s);
    return had;
}

static bool is_too_large(struct gl_buffer *buffer) {
    bool is = buffer->bytes / LARGER > buffer->asked;
    buffer->asked = 0;
    return is;
}

void gl_memory_begin(struct gl_state *s) {
    struct gl_slot *slot = &s->slots[(s->oldest + s->begun) % GL_IN_FLIGHT];
    const struct scratch scratch = scratch_of(s);
    if (++slot->frames % LOOKS == 0 && is_too_large(&slot->readback.buffer))
        gl_readback_finish(&slot->readback);
    if (slot == &s->slots[0] && slot->frames % LOOKS == 0) {
        if (s->workload.pairs / LARGER > s->needed)
            s->workload.pairs = s->needed > GL_PAIRS_MIN ? s->needed : GL_PAIRS_MIN;
        s->needed = 0;
        for (int i = 0; scratch.buffers[i]; i++)
            if (is_too_large(scratch.buffers[i]))
                gl_buffer_finish(scratch.buffers[i]);
    }
    s->residency.beside_bytes = gl_draw_bytes(s);
}

bool gl_memory_fit(struct gl_state *s, struct sp_error *err) {
    s->residency.beside_bytes = gl_draw_bytes(s);
    return gl_residency_trim(&s->residency, err);
}
