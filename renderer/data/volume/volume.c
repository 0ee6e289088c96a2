/* SPDX-License-Identifier: Apache-2.0 */
#include "data/volume/volume.h"

#include <assert.h>
#include <inttypes.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/volume/elements.h"

/* Memory of samples and vectors. Derived volumes share the vectors of their original. */
struct memory {
    atomic_uint references;
    void *voxels;
    size_t bytes;
    sp_voxel_source_release *release;
    struct memory *coarser; /* that blocks here lead to, a reference; NULL = none */
};

struct sp_volume {
    atomic_uint references;
    struct sp_volume_info info;
    /* Coordinates of all rectilinear axes, and the times of the series, one after the other. NULL =
     * none. */
    double *numbers;
    struct memory *samples;
    const struct sp_blocks *blocks; /* in that memory; NULL = it is an array of samples */
    struct memory *vector_memory;   /* the same, or of the original; NULL = no vectors */
    const float (*vectors)[3];
    struct sp_elements elements;
    const struct sp_volume *original; /* only compared; NULL = not derived */
    void *source;                     /* owned; NULL = none */
    void (*destroy_source)(void *source);
    pthread_mutex_t mutex;     /* guards the fields below */
    struct sp_volume *derived; /* NULL = none */
    void *key;
    size_t key_bytes;
};

size_t sp_type_size(enum sp_type type) {
    static const unsigned char sizes[SP_TYPE_COUNT] = { 1, 1, 2, 2, 4, 4, 8 };
    assert(type < SP_TYPE_COUNT);
    return sizes[type];
}

const char *sp_type_name(enum sp_type type) {
    static const char *const names[SP_TYPE_COUNT] = { "uint8", "int8",    "uint16", "int16",
                                                      "int32", "float32", "float64" };
    assert(type < SP_TYPE_COUNT);
    return names[type];
}

static void release_heap(void *voxels, size_t bytes) {
    (void)bytes;
    free(voxels);
}

/* Copies the grid's coordinates and the times into memory that the volume owns. */
static bool keep_numbers(struct sp_volume *volume, struct sp_error *err) {
    struct sp_grid *grid = &volume->info.grid;
    struct sp_steps *steps = &volume->info.steps;
    size_t count = steps->times ? steps->count : 0;
    for (int a = 0; a < 3; a++)
        count += grid->coordinates[a] ? grid->dims[a] : 0;
    if (count == 0)
        return true;
    double *next = volume->numbers = malloc(count * sizeof *next);
    if (!next)
        return sp_fail(err, SP_ERR_MEMORY, volume->info.source,
                       "out of memory for coordinates and times");
    if (steps->times) {
        steps->times = memcpy(next, steps->times, steps->count * sizeof *next);
        next += steps->count;
    }
    sp_grid_copy_axes(grid, next);
    return true;
}

static void unref_memory(struct memory *memory) {
    if (!memory || atomic_fetch_sub_explicit(&memory->references, 1, memory_order_acq_rel) != 1)
        return;
    memory->release(memory->voxels, memory->bytes);
    unref_memory(memory->coarser);
    free(memory);
}

static struct memory *ref_memory(struct memory *memory) {
    atomic_fetch_add_explicit(&memory->references, 1, memory_order_relaxed);
    return memory;
}

static void share_vectors(struct sp_volume *volume, struct memory *memory,
                          const float (*vectors)[3]) {
    if (!vectors)
        return;
    volume->vector_memory = ref_memory(memory);
    volume->vectors = vectors;
}

/* Creates a volume that owns the samples, without coordinates. Releases them if it fails. */
static struct sp_volume *create(const struct sp_volume_info *info, void *voxels, size_t bytes,
                                sp_voxel_source_release *release, struct sp_error *err) {
    assert((uintptr_t)voxels % 64 == 0);
    struct sp_volume *volume = calloc(1, sizeof *volume);
    struct memory *memory = calloc(1, sizeof *memory);
    if (!volume || !memory || pthread_mutex_init(&volume->mutex, NULL) != 0) {
        free(volume);
        free(memory);
        release(voxels, bytes);
        sp_fail(err, SP_ERR_MEMORY, info->source, "out of memory for a volume");
        return NULL;
    }
    atomic_init(&volume->references, 1);
    *memory = (struct memory){ .voxels = voxels, .bytes = bytes, .release = release };
    atomic_init(&memory->references, 1);
    volume->info = *info;
    if (volume->info.steps.count == 0)
        volume->info.steps.count = 1;
    if (!(info->data[1] > info->data[0]))
        memcpy(volume->info.data, info->range, sizeof info->range);
    volume->samples = memory;
    return volume;
}

static uint64_t count_voxels(const struct sp_grid *grid) {
    return (uint64_t)grid->dims[0] * grid->dims[1] * grid->dims[2];
}

uint64_t sp_volume_layout(uint64_t voxel_bytes, uint64_t voxels, bool has_vectors,
                          uint64_t *vectors_at) {
    const uint64_t line = 64;
    *vectors_at = (voxel_bytes + line - 1) / line * line;
    uint64_t bytes = *vectors_at + (has_vectors ? voxels * 3 * sizeof(float) : 0);
    return (bytes + line - 1) / line * line;
}

static struct sp_volume *adopt(const struct sp_volume_info *info, void *voxels,
                               const float (*vectors)[3], size_t bytes, uint64_t most,
                               sp_voxel_source_release *release, struct sp_error *err) {
    struct sp_volume *volume = create(info, voxels, bytes, release, err);
    if (!volume)
        return NULL;
    uint64_t count = count_voxels(&info->grid);
    volume->info.components = 1;
    volume->info.voxel_bytes = count * sp_type_size(info->type);
    volume->info.vector_bytes = vectors ? count * sizeof *vectors : 0;
    assert(volume->info.voxel_bytes + volume->info.vector_bytes <= bytes);
    share_vectors(volume, volume->samples, vectors);
    if (!keep_numbers(volume, err) || !sp_volume_measure(&volume->info, voxels, count, most, err) ||
        !sp_volume_project(&volume->info, voxels, err) ||
        (vectors && !sp_volume_measure_vectors(vectors, count, &volume->info.longest, err)))
        sp_volume_unref(&volume);
    return volume;
}

struct sp_volume *sp_volume_adopt(const struct sp_volume_info *info, void *voxels,
                                  const float (*vectors)[3], size_t bytes,
                                  sp_voxel_source_release *release, struct sp_error *err) {
    return adopt(info, voxels, vectors, bytes, 0, release, err);
}

struct sp_volume *sp_volume_adopt_quickly(const struct sp_volume_info *info, void *voxels,
                                          size_t bytes, uint64_t most,
                                          sp_voxel_source_release *release, struct sp_error *err) {
    return adopt(info, voxels, NULL, bytes, most, release, err);
}

struct sp_volume *sp_volume_adopt_elements(const struct sp_volume_info *info, void *memory,
                                           size_t bytes, sp_voxel_source_release *release,
                                           struct sp_error *err) {
    struct sp_volume *volume = create(info, memory, bytes, release, err);
    if (!volume)
        return NULL;
    struct sp_volume_info *own = &volume->info;
    volume->elements = sp_elements_at(&info->elements, memory);
    const struct sp_elements *e = &volume->elements;
    own->type = SP_FLOAT32;
    own->components = 1;
    own->voxel_bytes = sizeof(float);
    own->vector_bytes = e->vectors ? e->shape.count * sizeof *e->vectors : 0;
    own->element_bytes = sp_elements_bytes(&info->elements) - own->vector_bytes;
    sp_elements_grid(e, &own->grid);
    own->element_spacing = sp_elements_spacing(e, &own->grid);
    if (!sp_elements_are_sound(e))
        sp_fail(err, SP_ERR_FORMAT, info->source, "a triangle names a vertex that does not exist");
    else if (keep_numbers(volume, err) &&
             (!e->values || sp_volume_measure(own, e->values, e->shape.count, 0, err)) &&
             (!e->vectors || sp_volume_measure_vectors((const float(*)[3])e->vectors,
                                                       e->shape.count, &own->longest, err)))
        return volume;
    sp_volume_unref(&volume);
    return NULL;
}

struct sp_volume *sp_volume_derive(const struct sp_volume *original, enum sp_type type,
                                   uint64_t nonfinite, void *voxels, size_t bytes,
                                   sp_voxel_source_release *release, struct sp_error *err) {
    struct sp_volume *volume = create(&original->info, voxels, bytes, release, err);
    if (!volume)
        return NULL;
    volume->info.type = type;
    volume->info.nonfinite = nonfinite;
    volume->info.voxel_bytes = count_voxels(&original->info.grid) * sp_type_size(type);
    volume->original = sp_volume_original(original);
    share_vectors(volume, original->vector_memory, original->vectors);
    if (!keep_numbers(volume, err))
        sp_volume_unref(&volume);
    return volume;
}

struct sp_volume *sp_volume_derive_part(const struct sp_volume *original,
                                        const struct sp_grid *grid,
                                        const struct sp_whole_part *part, void *voxels,
                                        const float (*vectors)[3], size_t bytes,
                                        sp_voxel_source_release *release, struct sp_error *err) {
    struct sp_volume_info info = original->info;
    info.grid = *grid;
    info.whole.part = *part;
    struct sp_volume *volume =
        sp_volume_adopt_measured(&info, voxels, vectors, bytes, release, err);
    if (volume)
        volume->original = sp_volume_original(original);
    return volume;
}

struct sp_volume *sp_volume_derive_blocks(const struct sp_volume *original,
                                          const struct sp_grid *grid,
                                          const struct sp_whole_part *part,
                                          struct sp_blocks *blocks, const struct sp_volume *coarser,
                                          size_t bytes, sp_voxel_source_release *release,
                                          struct sp_error *err) {
    struct sp_volume_info info = original->info;
    info.grid = *grid;
    info.whole.part = *part;
    info.components = 1;
    info.vector_bytes = 0;
    info.voxel_bytes = bytes;
    struct sp_volume *volume = create(&info, blocks, bytes, release, err);
    if (volume) {
        volume->blocks = blocks;
        volume->samples->coarser = coarser ? ref_memory(coarser->samples) : NULL;
        volume->original = sp_volume_original(original);
        if (!keep_numbers(volume, err))
            sp_volume_unref(&volume);
    }
    return volume;
}

const struct sp_blocks *sp_volume_blocks(const struct sp_volume *volume) {
    return volume->blocks;
}

struct sp_volume *sp_volume_adopt_measured(const struct sp_volume_info *info, void *voxels,
                                           const float (*vectors)[3], size_t bytes,
                                           sp_voxel_source_release *release, struct sp_error *err) {
    struct sp_volume *volume = create(info, voxels, bytes, release, err);
    if (volume) {
        volume->info.components = 1;
        volume->info.voxel_bytes = count_voxels(&info->grid) * sp_type_size(info->type);
        volume->info.vector_bytes = vectors ? count_voxels(&info->grid) * sizeof *vectors : 0;
        assert(volume->info.voxel_bytes + volume->info.vector_bytes <= bytes);
        share_vectors(volume, volume->samples, vectors);
        if (!keep_numbers(volume, err))
            sp_volume_unref(&volume);
    }
    return volume;
}

void sp_volume_set_source(struct sp_volume *volume, void *source, void (*destroy)(void *source)) {
    assert(!volume->source);
    volume->source = source;
    volume->destroy_source = destroy;
}

void *sp_volume_source(const struct sp_volume *volume) {
    return volume->source;
}

const struct sp_volume *sp_volume_original(const struct sp_volume *volume) {
    return volume->original ? volume->original : volume;
}

bool sp_volume_is_of(const struct sp_volume *volume, const struct sp_volume *original) {
    return !original || volume == original || (volume && volume->original == original);
}

struct sp_volume *sp_volume_derived(struct sp_volume *volume, void *key, size_t *key_bytes) {
    struct sp_volume *derived = NULL;
    pthread_mutex_lock(&volume->mutex);
    if (volume->derived && volume->key_bytes <= *key_bytes) {
        derived = sp_volume_ref(volume->derived);
        memcpy(key, volume->key, volume->key_bytes);
        *key_bytes = volume->key_bytes;
    }
    pthread_mutex_unlock(&volume->mutex);
    return derived;
}

void sp_volume_set_derived(struct sp_volume *volume, struct sp_volume *derived, const void *key,
                           size_t key_bytes) {
    void *copy = derived ? malloc(key_bytes) : NULL;
    if (derived && !copy)
        return;
    if (derived)
        memcpy(copy, key, key_bytes);
    pthread_mutex_lock(&volume->mutex);
    struct sp_volume *old = volume->derived;
    free(volume->key);
    volume->derived = derived ? sp_volume_ref(derived) : NULL;
    volume->key = copy;
    volume->key_bytes = key_bytes;
    pthread_mutex_unlock(&volume->mutex);
    sp_volume_unref(&old);
}

struct sp_volume *sp_volume_create(const struct sp_grid *grid, enum sp_type type,
                                   const void *voxels, const char *name, struct sp_error *err) {
    return sp_volume_create_vectors(grid, type, voxels, NULL, name, err);
}

struct sp_volume *sp_volume_create_vectors(const struct sp_grid *grid, enum sp_type type,
                                           const void *voxels, const float (*vectors)[3],
                                           const char *name, struct sp_error *err) {
    struct sp_volume_info info = { .grid = *grid, .type = type };
    uint64_t bytes, at;
    if (!sp_grid_check(grid, type, name, &bytes, err))
        return NULL;
    snprintf(info.name, sizeof info.name, "%s", name);
    snprintf(info.source, sizeof info.source, "memory:%s", name);
    size_t capacity = sp_volume_layout(bytes, count_voxels(grid), vectors != NULL, &at);
    char *copy = aligned_alloc(64, capacity);
    if (!copy) {
        sp_fail(err, SP_ERR_MEMORY, name, "out of memory for %zu bytes of samples", capacity);
        return NULL;
    }
    memcpy(copy, voxels, bytes);
    if (vectors)
        memcpy(copy + at, vectors, count_voxels(grid) * sizeof *vectors);
    return sp_volume_adopt(&info, copy,
                           vectors ? (const float(*)[3])(const void *)(copy + at) : NULL, capacity,
                           release_heap, err);
}

static void copy_elements(const struct sp_elements *from, const struct sp_elements *to) {
    const struct sp_elements_shape *shape = &to->shape;
    const size_t n = shape->count, vertices = shape->vertex_count;
    memcpy(to->positions, from->positions,
           (shape->kind == SP_KIND_MESH ? vertices : n) * sizeof *to->positions);
    if (to->factors)
        memcpy(to->factors, from->factors, n * sizeof *to->factors);
    if (to->values) {
        memcpy(to->values, from->values, n * sizeof *to->values);
        memcpy(to->volumes, from->volumes, n * sizeof *to->volumes);
    }
    if (to->vectors)
        memcpy(to->vectors, from->vectors, n * sizeof *to->vectors);
    if (to->opacities) {
        memcpy(to->opacities, from->opacities, n * sizeof *to->opacities);
        memcpy(to->harmonics, from->harmonics,
               n * sp_harmonics_count(shape->degree) * 3 * sizeof *to->harmonics);
    }
    if (to->triangles) {
        memcpy(to->normals, from->normals, vertices * sizeof *to->normals);
        memcpy(to->colors, from->colors, vertices * sizeof *to->colors);
        memcpy(to->triangles, from->triangles, n * sizeof *to->triangles);
    }
}

struct sp_volume *sp_volume_create_elements(const struct sp_elements *elements, const char *name,
                                            struct sp_error *err) {
    struct sp_volume_info info = { .elements = elements->shape };
    const char *problem = sp_elements_shape_problem(&elements->shape);
    if (problem || elements->shape.kind == SP_KIND_GRID) {
        sp_fail(err, SP_ERR_INVALID, name, "%s", problem ? problem : "a grid has no elements");
        return NULL;
    }
    snprintf(info.name, sizeof info.name, "%s", name);
    snprintf(info.source, sizeof info.source, "memory:%s", name);
    size_t capacity = sp_elements_bytes(&elements->shape);
    char *memory = aligned_alloc(64, capacity);
    if (!memory) {
        sp_fail(err, SP_ERR_MEMORY, name, "out of memory for %zu bytes of elements", capacity);
        return NULL;
    }
    struct sp_elements own = sp_elements_at(&elements->shape, memory);
    *(float *)(void *)memory = NAN;
    copy_elements(elements, &own);
    if (!sp_elements_are_sound(&own)) {
        free(memory);
        sp_fail(err, SP_ERR_INVALID, name, "a triangle names a vertex that does not exist");
        return NULL;
    }
    return sp_volume_adopt_elements(&info, memory, capacity, release_heap, err);
}

struct sp_volume *sp_volume_ref(struct sp_volume *volume) {
    unsigned before = atomic_fetch_add_explicit(&volume->references, 1, memory_order_relaxed);
    assert(before > 0);
    (void)before;
    return volume;
}

void sp_volume_unref(struct sp_volume **volume) {
    struct sp_volume *v = *volume;
    *volume = NULL;
    if (!v || atomic_fetch_sub_explicit(&v->references, 1, memory_order_acq_rel) != 1)
        return;
    sp_volume_unref(&v->derived);
    if (v->source)
        v->destroy_source(v->source);
    pthread_mutex_destroy(&v->mutex);
    unref_memory(v->samples);
    unref_memory(v->vector_memory);
    free(v->key);
    free(v->numbers);
    free(v);
}

const struct sp_volume_info *sp_volume_info(const struct sp_volume *volume) {
    return &volume->info;
}

const void *sp_volume_voxels(const struct sp_volume *volume) {
    assert(!volume->blocks);
    return volume->samples->voxels;
}

const float (*sp_volume_vectors(const struct sp_volume *volume))[3] {
    return volume->elements.vectors ? (const float(*)[3])volume->elements.vectors : volume->vectors;
}

const struct sp_elements *sp_volume_elements(const struct sp_volume *volume) {
    return volume->info.elements.kind == SP_KIND_GRID ? NULL : &volume->elements;
}
