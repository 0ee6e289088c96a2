/* SPDX-License-Identifier: Apache-2.0 */
#include "data/volume/procedural.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/parallel_for.h"
#include "base/transfer.h"
#include "data/volume/elements.h"

static const struct sp_demo_maker *const makers[] = {
    &sp_demo_phantom,      &sp_demo_engine,   &sp_demo_vessels,   &sp_demo_marschner_lobb,
    &sp_demo_checkerboard, &sp_demo_hydrogen, &sp_demo_galaxy,    &sp_demo_sparse,
    &sp_demo_turbulence,   &sp_demo_noise,    &sp_demo_tornado,   &sp_demo_jet,
    &sp_demo_polar,        &sp_demo_points,   &sp_demo_gaussians, &sp_demo_torus,
};
enum { MAKERS = sizeof makers / sizeof makers[0] };

static const char prefix[] = "demo:";

const struct sp_demo *sp_demo_at(size_t i) {
    return i < MAKERS ? &makers[i]->demo : NULL;
}

bool sp_source_is_demo(const char *source) {
    return strncmp(source, prefix, sizeof prefix - 1) == 0;
}

static const struct sp_demo_maker *find_maker(const char *name, size_t length) {
    for (int i = 0; i < MAKERS; i++)
        if (strlen(makers[i]->demo.name) == length &&
            memcmp(makers[i]->demo.name, name, length) == 0)
            return makers[i];
    return NULL;
}

/* Parses decimal digits without a leading zero; the number must be within the limits. */
static bool parse_size(const char *text, uint32_t size_max, uint32_t *size) {
    size_t digits = strspn(text, "0123456789");
    if (digits < 1 || digits > 4 || text[digits] || text[0] == '0')
        return false;
    *size = (uint32_t)strtoul(text, NULL, 10);
    return *size >= SP_DEMO_SIZE_MIN && *size <= size_max;
}

static const struct sp_demo_maker *parse_source(const char *source, uint32_t size_max,
                                                uint32_t *size, struct sp_error *err) {
    const char *name = source + sizeof prefix - 1;
    size_t length = strcspn(name, "?");
    const struct sp_demo_maker *maker = find_maker(name, length);
    if (!maker) {
        char names[SP_ERROR_TEXT] = "";
        size_t at = 0;
        for (int i = 0; i < MAKERS; i++)
            at += (size_t)snprintf(names + at, sizeof names - at, "%s%s", i ? ", " : "",
                                   makers[i]->demo.name);
        sp_fail(err, SP_ERR_NOT_FOUND, source,
                "no such built-in volume; the built-in volumes are %s", names);
        return NULL;
    }
    *size = maker->demo.default_size;
    if (!name[length])
        return maker;
    static const char key[] = "?size=";
    if (strncmp(name + length, key, sizeof key - 1) != 0 ||
        !parse_size(name + length + sizeof key - 1, size_max, size)) {
        sp_fail(err, SP_ERR_INVALID, source,
                "expected nothing or ?size=N after the name, with N a whole number in [%d, %u]",
                SP_DEMO_SIZE_MIN, size_max);
        return NULL;
    }
    return maker;
}

bool sp_demo_check(const char *source, struct sp_error *err) {
    uint32_t size;
    return parse_source(source, SP_DEMO_SIZE_MAX, &size, err) != NULL;
}

struct making {
    const struct sp_demo_maker *maker;
    const void *prepared;
    const uint32_t *dims;
    void *voxels;
    float (*vectors)[3]; /* NULL = none */
    const struct sp_load_options *options;
    atomic_size_t done; /* slices */
    atomic_bool cancelled;
};

static void make_slices(void *user, size_t begin, size_t end, unsigned worker) {
    struct making *m = user;
    if (atomic_load_explicit(&m->cancelled, memory_order_relaxed))
        return;
    if (m->maker->flow)
        m->maker->flow(m->dims, begin, end, m->vectors);
    if (m->maker->fill) {
        m->maker->fill(m->prepared, m->dims, begin, end, m->voxels);
    } else {
        size_t area = (size_t)m->dims[0] * m->dims[1], first = begin * area;
        sp_volume_lengths((const float(*)[3])m->vectors + first, (end - begin) * area,
                          (float *)m->voxels + first);
    }
    size_t done = atomic_fetch_add_explicit(&m->done, end - begin, memory_order_relaxed);
    /* Worker 0 is the loading thread. Only this thread may call the progress callback. */
    if (worker == 0 && m->options && m->options->progress &&
        !m->options->progress(m->options->user, (double)done / m->dims[2]))
        atomic_store_explicit(&m->cancelled, true, memory_order_relaxed);
}

static bool make_voxels(struct making *m, struct sp_error *err) {
    void *prepared = NULL;
    if (m->maker->prepare && !(prepared = m->maker->prepare(m->dims)))
        return sp_fail(err, SP_ERR_MEMORY, m->maker->demo.name, "out of memory for its tables");
    m->prepared = prepared;
    struct sp_pool *pool = sp_pool_create(sp_volume_threads(), err);
    if (pool)
        sp_parallel_for(pool, m->dims[2], 1, make_slices, m);
    bool made = pool != NULL;
    sp_pool_destroy(&pool);
    free(prepared);
    if (made && atomic_load(&m->cancelled))
        return sp_fail(err, SP_ERR_CANCELLED, m->maker->demo.name, "loading was cancelled");
    return made;
}

static void release_heap(void *voxels, size_t bytes) {
    (void)bytes;
    free(voxels);
}

static struct sp_volume *make_volume(const struct sp_demo_maker *maker,
                                     const struct sp_volume_info *info,
                                     const struct sp_load_options *options, struct sp_error *err) {
    const uint32_t *dims = info->grid.dims;
    uint64_t bytes, vectors_at;
    if (!sp_grid_check(&info->grid, maker->type, info->source, &bytes, err))
        return NULL;
    uint64_t voxels = bytes / sp_type_size(maker->type);
    uint64_t capacity = sp_volume_layout(bytes, voxels, maker->flow != NULL, &vectors_at);
    if (options && options->reserve && !options->reserve(options->user, capacity, err))
        return NULL;
    struct making making = {
        .maker = maker, .dims = dims, .options = options, .voxels = aligned_alloc(64, capacity)
    };
    if (!making.voxels) {
        sp_fail(err, SP_ERR_MEMORY, info->source, "out of memory for %" PRIu64 " bytes of samples",
                capacity);
        return NULL;
    }
    if (maker->flow)
        making.vectors = (float(*)[3])(void *)((char *)making.voxels + vectors_at);
    if (!make_voxels(&making, err)) {
        free(making.voxels);
        return NULL;
    }
    struct sp_volume *volume = sp_volume_adopt(
        info, making.voxels, (const float(*)[3])making.vectors, capacity, release_heap, err);
    if (volume && options && options->progress)
        options->progress(options->user, 1);
    return volume;
}

struct placing {
    const struct sp_demo_maker *maker;
    uint32_t size;
    struct sp_elements elements;
    const struct sp_load_options *options;
    atomic_size_t done; /* elements */
    atomic_bool cancelled;
};

static void place_elements(void *user, size_t begin, size_t end, unsigned worker) {
    struct placing *p = user;
    if (atomic_load_explicit(&p->cancelled, memory_order_relaxed))
        return;
    p->maker->place(p->size, &p->elements, begin, end);
    size_t done = atomic_fetch_add_explicit(&p->done, end - begin, memory_order_relaxed);
    if (worker == 0 && p->options && p->options->progress &&
        !p->options->progress(p->options->user, (double)done / p->elements.shape.count))
        atomic_store_explicit(&p->cancelled, true, memory_order_relaxed);
}

static bool fill_elements(struct placing *p, struct sp_error *err) {
    enum { GRAIN = 1 << 14 };
    struct sp_pool *pool = sp_pool_create(sp_volume_threads(), err);
    if (!pool)
        return false;
    sp_parallel_for(pool, p->elements.shape.count, GRAIN, place_elements, p);
    sp_pool_destroy(&pool);
    if (atomic_load(&p->cancelled))
        return sp_fail(err, SP_ERR_CANCELLED, p->maker->demo.name, "loading was cancelled");
    if (p->maker->finish)
        p->maker->finish(p->size, &p->elements);
    return true;
}

static struct sp_volume *make_elements(const struct sp_demo_maker *maker, uint32_t size,
                                       struct sp_volume_info *info,
                                       const struct sp_load_options *options,
                                       struct sp_error *err) {
    struct placing placing = { .maker = maker, .size = size, .options = options };
    maker->count(size, &info->elements);
    const uint64_t bytes = sp_elements_bytes(&info->elements);
    if (options && options->reserve && !options->reserve(options->user, bytes, err))
        return NULL;
    float *memory = aligned_alloc(64, bytes);
    if (!memory) {
        sp_fail(err, SP_ERR_MEMORY, info->source, "out of memory for %" PRIu64 " bytes of elements",
                bytes);
        return NULL;
    }
    memset(memory, 0, bytes);
    *memory = NAN; /* the only sample */
    placing.elements = sp_elements_at(&info->elements, memory);
    if (!fill_elements(&placing, err)) {
        free(memory);
        return NULL;
    }
    struct sp_volume *volume = sp_volume_adopt_elements(info, memory, bytes, release_heap, err);
    if (volume && options && options->progress)
        options->progress(options->user, 1);
    return volume;
}

/* Describes the grid of a volume of samples, but for rectilinear axes. */
static void describe(const struct sp_demo_maker *maker, uint32_t size, const char *source,
                     struct sp_volume_info *info) {
    *info = (struct sp_volume_info){ .type = maker->type };
    snprintf(info->name, sizeof info->name, "%s", maker->demo.name);
    snprintf(info->source, sizeof info->source, "%s", source);
    if (maker->count)
        return;
    for (int axis = 0; axis < 3; axis++) {
        info->grid.dims[axis] = size;
        info->grid.spacing[axis] = 1;
        info->grid.direction[axis][axis] = 1;
    }
    if (maker->shape)
        maker->shape(size, info->grid.dims);
    if (maker->flow) {
        snprintf(info->value_name, sizeof info->value_name, "magnitude");
        snprintf(info->vector_name, sizeof info->vector_name, "wind");
    }
}

/* Gives the grid its rectilinear axes, whose coordinates go to `numbers`. */
static void grade(const struct sp_demo_maker *maker, struct sp_grid *grid, double *numbers) {
    for (int axis = 0; axis < 3 && maker->grade; axis++) {
        for (uint32_t i = 0; i < grid->dims[axis]; i++)
            numbers[i] = maker->grade(grid->dims[axis], i);
        grid->coordinates[axis] = numbers;
        numbers += grid->dims[axis];
    }
}

struct sp_volume *sp_demo_load(const char *source, const struct sp_load_options *options,
                               struct sp_error *err) {
    uint32_t size;
    struct sp_volume_info info;
    const struct sp_demo_maker *maker = parse_source(source, SP_DEMO_SIZE_MAX, &size, err);
    if (!maker)
        return NULL;
    describe(maker, size, source, &info);
    if (maker->count)
        return make_elements(maker, size, &info, options, err);
    double coordinates[3 * SP_DEMO_SIZE_MAX];
    grade(maker, &info.grid, coordinates);
    return make_volume(maker, &info, options, err);
}

/* Some slices of an array of a volume. */
struct slices {
    char *bytes;        /* NULL = the volume has no such array */
    size_t slice_bytes; /* of one of them */
    uint64_t at;        /* of the array in the file */
};

/* A few slices of a volume on their way to a file. */
struct stream {
    const struct sp_demo_maker *maker;
    const void *prepared;
    const uint32_t *dims;
    struct slices samples, vectors;
    uint32_t first; /* of them */
};

/* Where the whole array would begin: makers want that, and write their slices only. */
static void *start_of(const struct stream *s, const struct slices *slices) {
    return (void *)((uintptr_t)slices->bytes - (uintptr_t)s->first * slices->slice_bytes);
}

static void make_some_slices(void *user, size_t begin, size_t end, unsigned worker) {
    const struct stream *s = user;
    const size_t area = (size_t)s->dims[0] * s->dims[1];
    (void)worker;
    if (s->maker->flow)
        s->maker->flow(s->dims, s->first + begin, s->first + end, start_of(s, &s->vectors));
    if (s->maker->fill)
        s->maker->fill(s->prepared, s->dims, s->first + begin, s->first + end,
                       start_of(s, &s->samples));
    else
        sp_volume_lengths((const float(*)[3])(void *)s->vectors.bytes + begin * area,
                          (end - begin) * area, (float *)(void *)s->samples.bytes + begin * area);
}

/* Blocks of zeros stay holes of the file. */
static bool write_slices(const struct stream *s, const struct slices *slices, uint32_t count,
                         int fd) {
    const uint64_t at = slices->at + (uint64_t)s->first * slices->slice_bytes;
    return !slices->bytes || sp_write_sparse(fd, slices->bytes, count * slices->slice_bytes, at);
}

static bool stream_slices(struct stream *s, struct sp_pool *pool,
                          const struct sp_load_options *options, int fd, struct sp_error *err) {
    const uint32_t step = sp_pool_threads(pool) * 2;
    for (s->first = 0; s->first < s->dims[2]; s->first += step) {
        const uint32_t left = s->dims[2] - s->first, count = left < step ? left : step;
        sp_parallel_for(pool, count, 1, make_some_slices, s);
        if (!write_slices(s, &s->samples, count, fd) || !write_slices(s, &s->vectors, count, fd))
            return sp_fail(err, SP_ERR_IO, s->maker->demo.name, "cannot write the samples: %s",
                           strerror(errno));
        if (options && options->progress &&
            !options->progress(options->user, (double)(s->first + count) / s->dims[2]))
            return sp_fail(err, SP_ERR_CANCELLED, s->maker->demo.name, "cancelled");
    }
    return true;
}

/* Memory for some slices, and the size of the file. */
static bool open_stream(struct stream *s, const struct sp_volume_info *info, unsigned threads,
                        int fd, struct sp_error *err) {
    const size_t area = (size_t)s->dims[0] * s->dims[1], count = (size_t)threads * 2;
    const uint64_t voxels = (uint64_t)area * s->dims[2], sample = sp_type_size(info->type);
    const bool has_vectors = s->maker->flow != NULL;
    const uint64_t size = sp_volume_layout(voxels * sample, voxels, has_vectors, &s->vectors.at);
    s->samples.slice_bytes = area * sample;
    s->vectors.slice_bytes = area * 3 * sizeof(float);
    s->samples.bytes = malloc(s->samples.slice_bytes * count);
    s->vectors.bytes = has_vectors ? malloc(s->vectors.slice_bytes * count) : NULL;
    if (!s->samples.bytes || (has_vectors && !s->vectors.bytes))
        return sp_fail(err, SP_ERR_MEMORY, info->source, "out of memory for some slices");
    return ftruncate(fd, (off_t)size) == 0 ||
           sp_fail(err, SP_ERR_IO, info->source, "cannot write the samples: %s", strerror(errno));
}

/* Describes the samples and vectors that are streamed. */
static bool describe_stream(const struct sp_demo_maker *maker, uint32_t size, const char *source,
                            struct sp_volume_info *info, double **numbers, struct sp_error *err) {
    describe(maker, size, source, info);
    if (maker->count)
        return sp_fail(err, SP_ERR_UNSUPPORTED, source,
                       "only grids of samples can be converted, and this volume has none");
    const uint32_t *dims = info->grid.dims;
    *numbers = malloc(sp_grid_axes_max(&info->grid) * sizeof **numbers);
    if (!*numbers)
        return sp_fail(err, SP_ERR_MEMORY, source, "out of memory for the axes");
    grade(maker, &info->grid, *numbers);
    if (maker->flow)
        info->vector_bytes = (uint64_t)dims[0] * dims[1] * dims[2] * 3 * sizeof(float);
    return true;
}

bool sp_demo_stream(const char *source, const struct sp_load_options *options, int fd,
                    bool keeps_axes, struct sp_volume_info *info, double **numbers,
                    struct sp_error *err) {
    uint32_t size;
    const struct sp_demo_maker *maker = parse_source(source, SP_DEMO_STREAM_MAX, &size, err);
    *numbers = NULL;
    if (!maker || !sp_grid_require_even(!keeps_axes && maker->grade, source, err))
        return false;
    struct stream s = { .maker = maker, .dims = info->grid.dims };
    struct sp_pool *pool = NULL;
    void *prepared = NULL;
    bool ok = describe_stream(maker, size, source, info, numbers, err) &&
              (pool = sp_pool_create(sp_volume_threads(), err)) &&
              open_stream(&s, info, sp_pool_threads(pool), fd, err);
    if (ok && maker->prepare && !(prepared = maker->prepare(s.dims)))
        ok = sp_fail(err, SP_ERR_MEMORY, source, "out of memory for its tables");
    s.prepared = prepared;
    ok = ok && stream_slices(&s, pool, options, fd, err);
    free(s.samples.bytes);
    free(s.vectors.bytes);
    free(prepared);
    sp_pool_destroy(&pool);
    if (!ok) {
        free(*numbers);
        *numbers = NULL;
    }
    return ok;
}
