/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/splat_layers.h"

#include <epoxy/gl.h>
#include <stdio.h>
#include <string.h>

#include "backend/gl/depth_order.h"
#include "backend/gl/elements.h"

enum {
    COPIED = 4096, /* voxels that a worker copies at a time */
    STATE_WORDS = 2 + 2 * SP_FRAGMENTS_MAX,
    ROW_WORDS = 2,           /* of a sample of a rectilinear axis */
    PIECE_WORDS = 9,         /* of a transfer function */
    PLAIN_RECORD_BYTES = 64, /* of a splat without streaks */
    BLOCK_LEAST = 64,        /* records of a batch that are in one layer of the bins */
    PAIRS_PER_BIN = 4,       /* about, if a splat lies on a few tiles */
    LAYERS_MAX = 1 << 14,    /* a span has 14 bits for a layer */
    /* Bits of shaders/passes/draw_splats.glsl. */
    BEGINS = 1,
    ENDS = 2
};

/* shaders/splats.glsl: std430. */
struct constants {
    float steps[3][4], kernel[3][4];
    float view[4], filter[4], bounds[4], cell[4];
    uint32_t kind[4], rows[4];
    float streak_axes[3][4], streaks[4], streak_color[4], eye[4];
    uint32_t cloud[4];
};
_Static_assert(sizeof(struct sp_voxel) == 6 * sizeof(uint32_t), "six words in the shader");

static bool is_cloud(enum gl_splat_kind kind) {
    return kind == GL_SPLAT_POINTS || kind == GL_SPLAT_POINT_VECTORS || kind == GL_SPLAT_GAUSSIANS;
}

static bool has_streaks(enum gl_splat_kind kind) {
    return kind == GL_SPLAT_VECTORS || kind == GL_SPLAT_POINT_VECTORS;
}

static void write_common(struct constants *c, const struct sp_voxel_frame *frame) {
    const struct sp_ewa_frame *f = &frame->ewa;
    *c = (struct constants){
        .view = { f->scale, f->centre[0], f->centre[1], f->near },
        .filter = { f->lowpass2, f->radius, f->cut, f->peak },
        .bounds = { f->ratio_max[0], f->ratio_max[1], f->flat, f->gain },
        .cell = { (float)f->unit, frame->opaque, frame->apart },
        .kind = { frame->mode == SP_FILTER_NONE, frame->linear, frame->is_rectilinear },
    };
}

/* sigma: of all kernels, or 1 where each has its own. */
static void write_streaks(struct constants *c, const struct sp_streaks *streaks, float sigma) {
    for (int r = 0; r < 3; r++) {
        memcpy(c->streak_axes[r], streaks->to_camera[r], sizeof streaks->to_camera[r]);
        c->streak_color[r] = streaks->color[r];
    }
    c->streaks[0] = streaks->widen * sigma * sigma;
    c->streaks[1] = streaks->length * sigma;
    c->streaks[2] = streaks->phase;
    c->streaks[3] = streaks->blends;
}

static void write_voxels(struct constants *c, const struct sp_voxel_frame *frame) {
    const struct sp_ewa_frame *f = &frame->ewa;
    for (int r = 0; r < 3; r++) {
        memcpy(c->steps[r], f->step[r], sizeof f->step[r]);
        memcpy(c->kernel[r], f->kernel[r], sizeof f->kernel[r]);
        c->steps[r][3] = (float)f->base[r];
    }
    for (unsigned a = 0, row = 0; a < 3; row += f->grid->dims[a++])
        c->rows[a] = row;
    if (frame->has_streaks)
        write_streaks(c, &frame->streaks, f->sigma);
}

_Static_assert(SP_CLOUD_PARTS_MAX * sizeof(float) == sizeof((struct constants *)0)->kernel,
               "kernel holds the depths of parts");

static void write_cloud(struct constants *c, const struct sp_cloud *cloud,
                        const struct sp_voxel_frame *frame) {
    for (int r = 0; r < 3; r++) {
        memcpy(c->steps[r], cloud->place[r], sizeof cloud->place[r]);
        c->steps[r][3] = cloud->offset[r];
        c->eye[r] = cloud->eye[r];
    }
    c->cell[3] = cloud->size;
    c->cloud[0] = gl_cloud_elements(cloud);
    if (frame->is_trained) {
        c->eye[3] = cloud->opacity;
        c->cloud[1] = sp_harmonics_count(cloud->elements->shape.degree);
        c->cloud[2] = cloud->is_normalised;
    } else {
        c->eye[0] = cloud->base;
        c->eye[3] = cloud->per_volume;
        c->cloud[3] = cloud->pieces->count;
        memcpy(c->kernel, cloud->part_at, sizeof cloud->part_at);
        c->streaks[0] = cloud->part_deviation;
        c->rows[0] = cloud->parts;
        c->cloud[1] = cloud->color_values ? 1 : cloud->color_vectors ? 3 : 0;
        c->cloud[2] = cloud->elements->shape.count;
    }
    if (frame->has_streaks)
        write_streaks(c, &frame->streaks, 1);
    if (!frame->is_trained)
        memcpy(c->streak_axes[0],
               (const float[4]){ cloud->color_low, cloud->color_scale, cloud->color_first,
                                 cloud->tree ? sp_cloud_spread_step(cloud->tree) : 0 },
               sizeof c->streak_axes[0]);
}

/* Coordinates of a rectilinear grid; returns how many words there are. to: NULL = they are only
 * counted. */
static uint32_t write_coordinates(float *to, const struct sp_voxel_frame *frame) {
    const uint32_t *dims = frame->ewa.grid->dims;
    for (unsigned a = 0; a < 3 && to; a++)
        for (uint32_t i = 0; i < dims[a]; i++, to += ROW_WORDS) {
            to[0] = frame->place[a][i];
            to[1] = frame->size[a][i];
        }
    return ROW_WORDS * (dims[0] + dims[1] + dims[2]);
}

/* The same for a transfer function. */
static uint32_t write_pieces(float *to, const struct sp_pieces *pieces) {
    for (uint32_t p = 0; p < pieces->count && to; p++, to += PIECE_WORDS) {
        to[0] = pieces->start[p];
        for (int c = 0; c < 4; c++) {
            to[1 + c] = pieces->at[c][p];
            to[5 + c] = pieces->slope[c][p];
        }
    }
    return PIECE_WORDS * pieces->count;
}

/* The same for the words of a layer. */
static uint32_t write_words(float *to, const struct gl_splats_made *made) {
    if (made->kind == GL_SPLAT_POINTS || made->kind == GL_SPLAT_POINT_VECTORS)
        return write_pieces(to, made->cloud.pieces);
    return made->source.frame.is_rectilinear ? write_coordinates(to, &made->source.frame) : 0;
}

static bool send_constants(const struct gl_buffer **to, struct gl_buffer *buffer,
                           const struct gl_splats_made *made, struct gl_state *s,
                           struct sp_error *err) {
    const uint64_t bytes = sizeof(struct constants) + write_words(NULL, made) * sizeof(float);
    struct constants c;
    write_common(&c, &made->source.frame);
    if (is_cloud(made->kind))
        write_cloud(&c, &made->cloud, &made->source.frame);
    else
        write_voxels(&c, &made->source.frame);
    if (!gl_buffer_reserve(buffer, "constants of splats", bytes, s->block_bytes, GL_USE_STREAM,
                           err))
        return false;
    struct constants *mapped = gl_buffer_map(buffer, bytes, err);
    if (!mapped)
        return false;
    *mapped = c;
    write_words((float *)(void *)(mapped + 1), made);
    s->upload.bytes += bytes;
    *to = buffer;
    return gl_buffer_unmap(buffer, err);
}

/* Voxels that are copied in order. */
struct copying {
    const struct sp_voxel *voxels;
    const uint32_t *order;
    struct sp_voxel *to;
};

static void copy_voxels(void *user, size_t begin, size_t end, unsigned worker) {
    const struct copying *copying = user;
    (void)worker;
    for (size_t i = begin; i < end; i++)
        copying->to[i] = copying->voxels[copying->order[i]];
}

static void *map_buffer(struct gl_buffer *buffer, uint64_t bytes, struct gl_state *s,
                        struct sp_error *err) {
    s->upload.bytes += bytes;
    return gl_buffer_reserve(buffer, "order of splats", bytes, s->block_bytes, GL_USE_STREAM, err)
               ? gl_buffer_map(buffer, bytes, err)
               : NULL;
}

/* Uploads the voxels of a list in their order. */
static bool send_voxels(struct gl_buffer *to, const struct gl_splats_made *made, struct gl_state *s,
                        struct sp_error *err) {
    const struct sp_voxel_order *order = &made->source.order;
    const struct sp_voxel_list *list = made->source.from;
    struct copying copying = { list->voxels, order->voxels, NULL };
    copying.to = map_buffer(to, (uint64_t)order->count * sizeof *copying.to, s, err);
    if (!copying.to)
        return false;
    sp_parallel_for(s->pool, order->count, COPIED, copy_voxels, &copying);
    return gl_buffer_unmap(to, err);
}

/* Uploads which elements of a cloud are chosen, and reserves memory for their order. */
static bool send_choice(struct gl_buffer *to, struct gl_buffer *order,
                        const struct gl_splats_made *made, struct gl_state *s,
                        struct sp_error *err) {
    const struct sp_voxel_order *chosen = &made->source.order;
    const uint64_t bytes = (uint64_t)chosen->count * sizeof *chosen->voxels;
    if (!gl_depth_order_open(s, err) ||
        !gl_buffer_reserve(order, "order of splats", bytes * made->cloud.parts, s->block_bytes,
                           GL_USE_STREAM, err))
        return false;
    if (!chosen->voxels)
        return true;
    void *mapped = map_buffer(to, bytes, s, err);
    if (!mapped)
        return false;
    memcpy(mapped, chosen->voxels, bytes);
    return gl_buffer_unmap(to, err);
}

/* Appends an array of elements, and the same of merged points behind it. `merged`: of the first
 * one. */
static void add_array(struct gl_elements_array *arrays, int *count, const void *own,
                      const void *merged, const struct sp_cloud *cloud, size_t size) {
    const struct sp_cloud_tree *tree = cloud->tree;
    arrays[(*count)++] =
        (struct gl_elements_array){ .data = own, .bytes = cloud->elements->shape.count * size };
    if (tree)
        arrays[(*count)++] = (struct gl_elements_array){ merged, tree->count * size, size,
                                                         sizeof(struct sp_cloud_node) };
}

/* Makes the numbers that give the colours of points, and of merged points, resident. */
static bool load_colors(struct gl_splats *to, const struct gl_band *band, struct sp_error *err) {
    const struct sp_cloud *cloud = &to->made->cloud;
    const uint64_t count = cloud->elements->shape.count;
    const bool by_length = cloud->color_vectors;
    const struct gl_elements_array arrays[] = {
        { .data = by_length ? (const void *)cloud->color_vectors : cloud->color_values,
          .bytes = count * sizeof(float) * (by_length ? 3 : 1) },
        { .data = cloud->merged_colors,
          .bytes = cloud->tree ? cloud->tree->count * sizeof(float) : 0 }
    };
    struct gl_resident *item = gl_elements_load(band, to->made->colors, GL_RESIDENT_HARMONICS,
                                                cloud->merged_colors_id << 2 | (by_length ? 2 : 1),
                                                arrays, 2, "colours of points", err);
    to->harmonics = item ? &item->buffer : NULL;
    return item;
}

/* Makes the elements of a cloud resident. */
static bool load_cloud(struct gl_splats *to, const struct gl_band *band, struct sp_error *err) {
    const struct sp_cloud *cloud = &to->made->cloud;
    const struct sp_elements *e = cloud->elements;
    static const struct sp_cloud_node none;
    const struct sp_cloud_node *m = cloud->tree ? cloud->tree->nodes : &none;
    const bool is_trained = to->made->kind == GL_SPLAT_GAUSSIANS;
    const bool has_vectors = to->made->kind == GL_SPLAT_POINT_VECTORS;
    struct gl_elements_array arrays[10];
    int count = 0;
    add_array(arrays, &count, e->positions, m->position, cloud, sizeof *e->positions);
    add_array(arrays, &count, e->factors, m->factor, cloud, sizeof *e->factors);
    if (is_trained)
        add_array(arrays, &count, e->opacities, NULL, cloud, sizeof *e->opacities);
    else
        add_array(arrays, &count, e->values, &m->value, cloud, sizeof *e->values);
    if (!is_trained)
        add_array(arrays, &count, e->volumes, &m->volume, cloud, sizeof *e->volumes);
    if (cloud->tree)
        arrays[count++] =
            (struct gl_elements_array){ &m->values, cloud->tree->count * sizeof m->values,
                                        sizeof m->values, sizeof *m };
    if (has_vectors)
        arrays[count++] =
            (struct gl_elements_array){ .data = e->vectors,
                                        .bytes = e->shape.count * sizeof *e->vectors };
    struct gl_resident *item = gl_elements_load(band, to->made->volume, GL_RESIDENT_ELEMENTS,
                                                has_vectors ? 2 : cloud->tree != NULL, arrays,
                                                count, "points or Gaussians", err);
    if (!item)
        return false;
    to->elements = to->harmonics = &item->buffer;
    if (!is_trained && !to->made->colors)
        return true;
    if (!is_trained)
        return load_colors(to, band, err);
    const uint64_t size = 3 * sizeof(float) * sp_harmonics_count(e->shape.degree);
    arrays[0] = (struct gl_elements_array){ .data = e->harmonics, .bytes = e->shape.count * size };
    item = gl_elements_load(band, to->made->volume, GL_RESIDENT_HARMONICS, 0, arrays, 1,
                            "colours of Gaussians", err);
    to->harmonics = item ? &item->buffer : NULL;
    return item;
}

static bool open_programs(struct gl_state *s, enum gl_splat_kind kind, bool is_alone,
                          struct sp_error *err) {
    char defines[120];
    const int used = snprintf(defines, sizeof defines,
                              "#define STREAKS %d\n#define TRAINED %d\n#define ALONE %d\n",
                              has_streaks(kind), kind == GL_SPLAT_GAUSSIANS, is_alone);
    if (!is_alone)
        snprintf(defines + used, sizeof defines - (size_t)used, "#define FRAGMENTS_ACCESS\n");
    if (!gl_program_late(&s->splats.blend[kind][is_alone],
                         is_alone
                             ? "bins records normal splats draw_splats"
                             : "bins records fragments fragment_lists normal splats draw_splats",
                         defines, s->device, "layers of splats", err))
        return false;
    snprintf(defines + used, sizeof defines - (size_t)used, "#define RECORDS_ACCESS\n");
    return gl_program_late(
        &s->splats.set_up[kind],
        is_cloud(kind)
            ? "frame bins records counts splats footprints close streaks cloud set_up_splats"
            : "frame bins records counts gradient shade splats footprints close streaks "
              "voxels set_up_splats",
        defines, s->device, "layers of splats", err);
}

bool gl_splat_layers_begin(struct gl_splat_layers *layers, const struct gl_band *band,
                           struct sp_error *err) {
    struct gl_state *s = band->state;
    const struct gl_layers_made *made = &band->fragments->made;
    layers->count = 0;
    layers->is_alone = band->job->view->layer_count == 1;
    layers->is_sorted = false;
    for (unsigned i = 0; i < made->splat_count; i++) {
        struct gl_splats *to = &layers->items[layers->count];
        const unsigned n = layers->count;
        to->made = &made->splats[i];
        if (!to->made->source.order.count)
            continue;
        to->order = &s->splats.order[n];
        to->choice = to->made->source.order.voxels ? &s->splats.choice[n] : NULL;
        if (!open_programs(s, to->made->kind, layers->is_alone, err) ||
            !send_constants(&to->constants, &s->splats.constants[n], to->made, s, err) ||
            !(is_cloud(to->made->kind)
                  ? load_cloud(to, band, err) &&
                        send_choice(&s->splats.choice[n], &s->splats.order[n], to->made, s, err)
                  : send_voxels(&s->splats.order[n], to->made, s, err)))
            return false;
        layers->count++;
    }
    return true;
}

static uint32_t count_records(const struct gl_splats *splats) {
    const struct gl_splats_made *made = splats->made;
    return made->source.order.count * (is_cloud(made->kind) ? made->cloud.parts : 1);
}

void gl_splat_layers_divide(struct gl_splat_layers *layers, const struct gl_pieces *pieces) {
    layers->dispatches = layers->words = 0;
    for (unsigned i = 0; i < layers->count; i++) {
        const uint32_t batches = gl_divide_up(count_records(&layers->items[i]), pieces->records);
        layers->dispatches += batches * (1 + pieces->element_passes);
        if (batches * pieces->element_passes > 1 && !layers->is_alone)
            layers->words = STATE_WORDS;
    }
}

/* A batch: its layers in the bins have `block` records each. */
struct batch {
    uint32_t first, count, block, layers;
};

static struct batch make_batch(const struct gl_band *band, uint32_t first, uint32_t count) {
    const uint32_t tiles = gl_band_tiles(band);
    const uint32_t bins = gl_workload_limits(&band->state->workload).bins;
    const uint32_t sorted = band->slot->pieces.bin_pairs; /* a splat is in a bin once */
    uint32_t block = tiles / PAIRS_PER_BIN, most = bins / tiles;
    block = block < BLOCK_LEAST ? BLOCK_LEAST : block < sorted ? block : sorted;
    most = most < 1 ? 1 : most < LAYERS_MAX ? most : LAYERS_MAX;
    if (gl_divide_up(count, block) > most)
        block = gl_divide_up(count, most);
    return (struct batch){ first, count, block, gl_divide_up(count, block) };
}

static uint32_t record_bytes(const struct gl_splats *splats) {
    return has_streaks(splats->made->kind) ? GL_SPLAT_RECORD_BYTES : PLAIN_RECORD_BYTES;
}

bool gl_splat_layers_reserve(const struct gl_splat_layers *layers, const struct gl_band *band,
                             struct sp_error *err) {
    for (unsigned i = 0; i < layers->count; i++) {
        const struct gl_splats *splats = &layers->items[i];
        const uint32_t all = count_records(splats), most = band->slot->pieces.records;
        const struct batch batch = make_batch(band, 0, all < most ? all : most);
        if (!gl_elements_reserve(band, batch.count, batch.layers, record_bytes(splats), err) ||
            (is_cloud(splats->made->kind) && !gl_depth_order_reserve(band->state, all, err)))
            return false;
    }
    return true;
}

/* Makes the records of a batch and sorts them. */
static bool sort_batch(const struct gl_splats *splats, struct gl_band *band,
                       const struct batch *batch, struct sp_error *err) {
    struct gl_state *s = band->state;
    const struct gl_pieces *pieces = &band->slot->pieces;
    const struct gl_bins_space space = gl_elements_space(band, batch->layers);
    glUseProgram(s->splats.set_up[splats->made->kind].program);
    glUniform4ui(1, batch->first, batch->count, batch->block, band->job->frame->width);
    gl_buffer_bind(&s->upload.constants.buffer, 0);
    gl_buffer_bind(splats->constants, 1);
    gl_buffer_bind(splats->order, 2);
    if (splats->elements)
        gl_buffer_bind(splats->elements, 3);
    if (splats->harmonics)
        gl_buffer_bind(splats->harmonics, 4);
    gl_buffer_bind(&s->buffers.records, 5);
    if (!gl_elements_sort(band, &space, batch->count, err))
        return false;
    gl_bins_order(&s->bins, &space, (uint32_t)pieces->pairs, pieces->bin_pairs);
    gl_timer_stamp(&band->slot->timer, GL_STAGE_LAYERS);
    return true;
}

/* Draws the pairs of a batch; `bits`: whether the layer begins and ends with it. */
static bool draw_batch(const struct gl_splat_layers *layers, const struct gl_splats *splats,
                       struct gl_band *band, const struct batch *batch, uint32_t bits,
                       struct sp_error *err) {
    struct gl_state *s = band->state;
    const struct gl_pieces *pieces = &band->slot->pieces;
    const struct gl_bins_space space = gl_elements_space(band, batch->layers);
    glUseProgram(s->splats.blend[splats->made->kind][layers->is_alone].program);
    gl_bins_set_space(&space);
    glUniform3ui(1, band->job->frame->width, (GLuint)pieces->pairs, pieces->element_pairs);
    glUniform2ui(3, band->slot->fragments_most, band->fragments->insert.planes);
    gl_buffer_bind(splats->constants, 1);
    gl_buffer_bind(&s->bins.totals, 2);
    gl_buffer_bind(&s->bins.pairs, 3);
    gl_buffer_bind(layers->words ? &s->buffers.sheets : &s->buffers.image, 4);
    gl_buffer_bind(&s->buffers.records, 5);
    gl_buffer_bind(&s->bins.counts, 7);
    gl_buffer_bind(&s->buffers.fragments, GL_FRAGMENTS);
    for (uint32_t pass = 0; pass < pieces->element_passes; pass++) {
        const uint32_t begins = pass ? 0 : bits & BEGINS;
        glUniform3ui(2, pass, pieces->element_passes,
                     begins | (pass + 1 == pieces->element_passes ? bits & ENDS : 0));
        if (!gl_band_draw_layer(band, err))
            return false;
    }
    return true;
}

static bool draw(const struct gl_splat_layers *layers, const struct gl_splats *splats,
                 struct gl_band *band, struct sp_error *err) {
    const uint32_t all = count_records(splats), records = band->slot->pieces.records;
    for (uint32_t first = 0, n; first < all; first += n) {
        n = all - first < records ? all - first : records;
        const struct batch batch = make_batch(band, first, n);
        const uint32_t bits = (first ? 0u : BEGINS) | (first + n == all ? ENDS : 0u);
        if (!sort_batch(splats, band, &batch, err) ||
            !draw_batch(layers, splats, band, &batch, bits, err))
            return false;
    }
    return true;
}

/* Sorts the elements of clouds, once per frame. */
static void sort_clouds(struct gl_splat_layers *layers, struct gl_band *band) {
    for (unsigned i = 0; i < layers->count && !layers->is_sorted; i++) {
        const struct gl_splats *splats = &layers->items[i];
        if (!is_cloud(splats->made->kind))
            continue;
        gl_depth_order_make(band->state, splats->made, splats->elements, splats->choice,
                            splats->order);
        gl_timer_stamp(&band->slot->timer, GL_STAGE_LAYERS);
    }
    layers->is_sorted = true;
}

bool gl_splat_layers_draw(struct gl_splat_layers *layers, struct gl_band *band,
                          struct sp_error *err) {
    sort_clouds(layers, band);
    for (unsigned i = 0; i < layers->count; i++)
        if (!draw(layers, &layers->items[i], band, err))
            return false;
    return true;
}

void gl_splat_layers_finish(struct gl_state *s) {
    for (int kind = 0; kind < GL_SPLAT_KINDS; kind++) {
        glDeleteProgram(s->splats.set_up[kind].program);
        for (int i = 0; i < 2; i++)
            glDeleteProgram(s->splats.blend[kind][i].program);
    }
    for (int i = 0; i < SP_LAYERS_MAX; i++) {
        gl_buffer_finish(&s->splats.constants[i]);
        gl_buffer_finish(&s->splats.order[i]);
        gl_buffer_finish(&s->splats.choice[i]);
    }
    memset(&s->splats, 0, sizeof s->splats);
}
