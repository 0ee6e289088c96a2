/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/classify.h"

#include <assert.h>
#include <epoxy/gl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "backend/gl/bins.h"
#include "backend/gl/pass.h"
#include "backend/gl/program.h"
#include "backend/gl/readback.h"
#include "backend/gl/visible_ranges.h"
#include "classify/gradient.h"
#include "data/volume/grid.h"

enum {
    BRICKS_MAX = 8192,         /* bricks per dispatch: about 10 ms */
    BRICKS_SOFTWARE = 64,      /* the same for software GL */
    UPLOAD_BYTES = 1 << 26,    /* bytes between two checks of the cancel flag */
    LISTED_WORDS = 65536 / 32, /* one bit per key */
    WORD = sizeof(uint32_t)
};

/* classify.glsl */
enum { BY_KEY, BY_VALUE, BY_CELL };
enum { NO_CLASSES, COLORS, VALUES };

static unsigned open_pass(const char *names, int pass, struct sp_error *err) {
    static const char *const defines[] = { "#define PASS 0\n", "#define PASS 1\n",
                                           "#define PASS 2\n", "#define PASS 3\n",
                                           "#define PASS 4\n" };
    return gl_program_open(names, defines[pass], err);
}

bool gl_classify_init(struct gl_classify *c, bool software, struct sp_error *err) {
    static const char finest[] = "samples gradient post compact classify";
    static const char coarse[] = "gradient compact make_level";
    c->bricks = software ? BRICKS_SOFTWARE : BRICKS_MAX;
    return (c->range = open_pass(finest, 0, err)) && (c->count = open_pass(finest, 1, err)) &&
           (c->fill = open_pass(finest, 2, err)) && (c->histogram = open_pass(finest, 3, err)) &&
           (c->classes = open_pass(finest, 4, err)) && (c->mip_count = open_pass(coarse, 0, err)) &&
           (c->mip_fill = open_pass(coarse, 1, err)) && gl_cell_bounds_init(&c->cell_bounds, err);
}

void gl_classify_finish(struct gl_classify *c) {
    glDeleteProgram(c->range);
    glDeleteProgram(c->count);
    glDeleteProgram(c->fill);
    glDeleteProgram(c->histogram);
    glDeleteProgram(c->classes);
    glDeleteProgram(c->mip_count);
    glDeleteProgram(c->mip_fill);
    gl_cell_bounds_finish(&c->cell_bounds);
    gl_buffer_finish(&c->listed);
    gl_buffer_finish(&c->points);
    gl_buffer_finish(&c->counts);
    gl_buffer_finish(&c->firsts);
}

static uint32_t count_bricks(const struct sp_grid *grid) {
    uint32_t bricks = 1;
    for (int a = 0; a < 3; a++)
        bricks *= (grid->dims[a] + SP_BRICK - 1) / SP_BRICK;
    return bricks;
}

static bool upload(struct gl_classify *c, const struct gl_voxels *voxels, const atomic_bool *cancel,
                   struct sp_error *err) {
    const char *samples = sp_volume_voxels(voxels->volume);
    uint64_t bytes = sp_volume_info(voxels->volume)->voxel_bytes;
    for (uint64_t at = 0, n; at < bytes; at += n) {
        n = bytes - at < UPLOAD_BYTES ? bytes - at : UPLOAD_BYTES;
        if (gl_pass_cancelled(cancel, err))
            return false;
        glBindBuffer(GL_SHADER_STORAGE_BUFFER, voxels->samples.name);
        glBufferSubData(GL_SHADER_STORAGE_BUFFER, (GLintptr)at, (GLsizeiptr)n, samples + at);
        *c->uploaded += n;
    }
    return true;
}

static bool load_samples(struct gl_classify *c, struct gl_voxels *voxels, const atomic_bool *cancel,
                         struct sp_error *err) {
    const struct sp_volume_info *info = sp_volume_info(voxels->volume);
    uint32_t bricks = count_bricks(&info->grid);
    uint64_t words = (info->voxel_bytes + WORD - 1) / WORD;
    bool ok = gl_buffer_reserve(&voxels->samples, "voxels", words * WORD, c->block_bytes,
                                GL_USE_KEPT, err) &&
              gl_buffer_reserve(&voxels->ranges, "ranges of bricks", (uint64_t)bricks * 2 * WORD,
                                c->block_bytes, GL_USE_KEPT, err) &&
              upload(c, voxels, cancel, err);
    if (ok) {
        gl_pass_use(c->range, voxels, 0);
        ok = gl_pass_run(bricks, c->bricks, cancel, err);
    }
    return ok;
}

bool gl_classify_load(struct gl_classify *c, struct gl_voxels *voxels, bool cells,
                      const atomic_bool *cancel, struct sp_error *err) {
    if ((voxels->samples.name || load_samples(c, voxels, cancel, err)) &&
        (!cells ||
         gl_cell_bounds_load(&c->cell_bounds, voxels, c->bricks, c->block_bytes, cancel, err)))
        return true;
    gl_voxels_drop(voxels);
    return false;
}

/* Uploads one bit per key: set if the key is listed. */
static bool write_listed(struct gl_classify *c, const struct sp_level *level,
                         struct sp_error *err) {
    uint32_t words[LISTED_WORDS] = { 0 };
    uint64_t bytes = gl_divide_up(level->transfer.count, 32) * (uint64_t)WORD;
    for (uint32_t k = 0; k < level->transfer.count; k++)
        words[k / 32] |= (uint32_t)(level->listed[k] != 0) << k % 32;
    if (!gl_buffer_reserve(&c->listed, "visible values", sizeof words, 0, GL_USE_STREAM, err))
        return false;
    gl_buffer_write(&c->listed, words, bytes);
    *c->uploaded += bytes;
    return true;
}

/* Uploads the same information as intervals of values. */
static bool write_visible_ranges(struct gl_classify *c, const struct sp_level *level,
                                 uint32_t *count, struct sp_error *err) {
    struct gl_visible_ranges ranges;
    gl_visible_ranges_init(&ranges, &level->transfer);
    uint64_t bytes = ranges.count * (uint64_t)sizeof ranges.ends[0];
    if (!gl_buffer_reserve(&c->listed, "visible values", LISTED_WORDS * WORD, 0, GL_USE_STREAM,
                           err))
        return false;
    if (bytes)
        gl_buffer_write(&c->listed, ranges.ends, bytes);
    *count = ranges.count;
    *c->uploaded += bytes;
    return true;
}

/* Allocates `count` words and one more, for an upload or a readback. The caller frees them. */
static uint32_t *allocate(uint32_t count, struct sp_error *err) {
    uint32_t *words = malloc((count + (size_t)1) * sizeof *words);
    if (!words)
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for %u counts", count);
    return words;
}

/* Uploads the index of each brick's first entry, and the end of the last brick's entries. */
static bool write_places(struct gl_classify *c, const struct gl_buffer *to, const uint64_t *first,
                         uint32_t bricks, struct sp_error *err) {
    uint32_t *words = allocate(bricks, err);
    if (!words)
        return false;
    for (uint32_t b = 0; b <= bricks; b++)
        words[b] = (uint32_t)first[b];
    gl_buffer_write(to, words, (bricks + UINT64_C(1)) * WORD);
    *c->uploaded += (bricks + UINT64_C(1)) * WORD;
    free(words);
    return true;
}

static bool reserve_places(const struct gl_classify *c, struct gl_buffer *buffer, uint32_t bricks,
                           struct sp_error *err) {
    return gl_buffer_reserve(buffer, "counts", (bricks + UINT64_C(1)) * WORD, c->block_bytes,
                             GL_USE_STREAM, err);
}

/* Runs the program in use over all bricks and reads back its `count` counters. */
static bool run_count(const struct gl_classify *c, uint32_t bricks, const atomic_bool *cancel,
                      uint32_t count, uint64_t *counts, struct sp_error *err) {
    uint32_t *words = allocate(count, err);
    bool ok = words && gl_pass_run(bricks, c->bricks, cancel, err);
    if (ok) {
        glBindBuffer(GL_COPY_READ_BUFFER, c->counts.name);
        glGetBufferSubData(GL_COPY_READ_BUFFER, 0, (GLsizeiptr)(count * sizeof *words), words);
        ok = gl_check("classified", err);
    }
    for (uint32_t i = 0; ok && i < count; i++)
        counts[i] = words[i];
    free(words);
    return ok;
}

/* Sets the uniforms of a pass: how it finds visible voxels, and which classes the list has per
 * entry. list NULL = the pass writes no list. */
static void set_list(uint32_t way, uint32_t intervals, const struct sp_level *level,
                     const struct gl_visible_list *list) {
    uint32_t classes = level->transfer.tf.order == SP_TF_POST ? VALUES : COLORS;
    glUniform4ui(5, way, intervals, !list || list->has_keys ? NO_CLASSES : classes,
                 list ? list->first_class : 0);
}

/* Uploads what the level's list will contain, and selects the program. */
static bool use(struct gl_classify *c, unsigned program, const struct gl_voxels *voxels,
                const struct sp_level *level, const struct gl_visible_list *list,
                const atomic_bool *cancel, struct sp_error *err) {
    bool is_post = level->transfer.tf.order == SP_TF_POST;
    uint32_t way = level->listed ? BY_KEY : is_post ? BY_CELL : BY_VALUE, intervals = 0;
    if (way == BY_CELL && !gl_cell_bounds_widen(&c->cell_bounds, voxels, level, c->bricks,
                                                c->block_bytes, c->uploaded, cancel, err))
        return false;
    if (!(way == BY_KEY ? write_listed(c, level, err)
                        : write_visible_ranges(c, level, &intervals, err)))
        return false;
    gl_pass_use(program, voxels, list ? list->normal_bytes : 0);
    set_list(way, intervals, level, list);
    gl_buffer_bind(&c->listed, 2);
    gl_buffer_bind(&c->counts, 3);
    if (way == BY_CELL)
        gl_buffer_bind(&c->cell_bounds.scratch[0], 1);
    return true;
}

bool gl_classify_count(struct gl_classify *c, const struct gl_voxels *voxels,
                       const struct sp_level *level, const atomic_bool *cancel, uint64_t *counts,
                       struct sp_error *err) {
    uint32_t bricks = sp_visible_bricks(&level->visible);
    bool ok = reserve_places(c, &c->counts, bricks, err) &&
              use(c, c->count, voxels, level, NULL, cancel, err) &&
              run_count(c, bricks, cancel, bricks, counts, err);
    gl_cell_bounds_drop(&c->cell_bounds);
    return ok;
}

static void clear(const struct gl_buffer *buffer, uint64_t words) {
    glBindBuffer(GL_SHADER_STORAGE_BUFFER, buffer->name);
    glClearBufferSubData(GL_SHADER_STORAGE_BUFFER, GL_R32UI, 0, (GLsizeiptr)(words * WORD),
                         GL_RED_INTEGER, GL_UNSIGNED_INT, &(GLuint){ 0 });
}

bool gl_classify_histogram(struct gl_classify *c, const struct gl_voxels *voxels, uint32_t keys,
                           const atomic_bool *cancel, uint64_t *counts, struct sp_error *err) {
    if (!reserve_places(c, &c->counts, keys, err))
        return false;
    clear(&c->counts, keys);
    gl_pass_use(c->histogram, voxels, 0);
    gl_buffer_bind(&c->counts, 3);
    return run_count(c, count_bricks(&sp_volume_info(voxels->volume)->grid), cancel, keys, counts,
                     err);
}

/* Sets the base of values, and the matrix from differences per spacing to the world gradient
 * divided by its bound. Reals are scaled by a power of two, so that they do not overflow. */
static void set_units(const struct sp_volume *volume, double base) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    bool is_real = info->type == SP_FLOAT32;
    double whole = is_real ? (double)(float)base : floor(base), scale = 1;
    struct sp_gradient_grid grid;
    float columns[9];
    int exponent;
    sp_gradient_units_init(&grid, info);
    frexp(fmax(fabs(info->range[0]), fabs(info->range[1])), &exponent);
    if (is_real)
        scale = ldexp(1, exponent > 100 ? -100 : exponent < -100 ? 100 : -exponent);
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            columns[3 * a + r] = (float)(grid.to_world[r][a] / (grid.unit * scale));
    glUniformMatrix3fv(4, 1, GL_FALSE, columns);
    glUniform3f(6, (float)whole, (float)(base - whole), (float)scale);
    glUniform1i(7, is_real ? 0 : (GLint)whole);
}

/* Sets the rows of the tables where a list's axes begin, and one more value. */
static void set_rows(int location, const struct gl_visible_list *list, uint32_t last) {
    const uint32_t *row = list->axis_row;
    glUniform4ui(location, row[0], row[1], row[2], last);
}

/* Uploads the index of each brick's first entry, and the points of the transfer function for the
 * classes. */
static bool prepare_list(struct gl_classify *c, const struct sp_level *level,
                         const struct gl_visible_list *list, struct sp_error *err) {
    uint32_t bricks = sp_visible_bricks(&level->visible);
    return reserve_places(c, &c->counts, bricks, err) &&
           write_places(c, &c->counts, level->visible.first, bricks, err) &&
           (list->has_keys ||
            gl_visible_ranges_write_points(&c->points, &level->transfer, c->uploaded, err));
}

/* Runs the program in use, which writes the list. */
static bool run_list(const struct gl_classify *c, const struct gl_voxels *voxels,
                     const struct sp_level *level, const struct gl_visible_list *list,
                     const atomic_bool *cancel, struct sp_error *err) {
    set_rows(3, list, sp_grid_is_rectilinear(&level->grid));
    set_units(voxels->volume, sp_transfer_base(&level->transfer));
    gl_buffer_bind(&list->entries, 4);
    gl_buffer_bind(list->has_keys ? &list->entries : &c->points, 5);
    gl_buffer_bind(&list->tables, 6);
    gl_buffer_bind(list->normal_bytes ? &list->normals : &list->entries, 7);
    return gl_pass_run(sp_visible_bricks(&level->visible), c->bricks, cancel, err);
}

bool gl_classify_fill(struct gl_classify *c, const struct gl_voxels *voxels,
                      const struct sp_level *level, const struct gl_visible_list *list,
                      const atomic_bool *cancel, struct sp_error *err) {
    if (list->normal_bytes == 2)
        clear(&list->normals, level->visible.count / 2 + 1);
    bool ok = prepare_list(c, level, list, err) &&
              use(c, c->fill, voxels, level, list, cancel, err) &&
              run_list(c, voxels, level, list, cancel, err);
    gl_cell_bounds_drop(&c->cell_bounds);
    return ok;
}

bool gl_classify_color(struct gl_classify *c, const struct gl_voxels *voxels,
                       const struct sp_level *level, const struct gl_visible_list *list,
                       const atomic_bool *cancel, struct sp_error *err) {
    assert(!list->has_keys);
    if (!prepare_list(c, level, list, err))
        return false;
    gl_pass_use(c->classes, voxels, 0);
    set_list(BY_KEY, 0, level, list);
    gl_buffer_bind(&c->counts, 3);
    return run_list(c, voxels, level, list, cancel, err);
}

/* Selects the program and sets its uniforms for the finer level. `normals`: it reads that level's
 * normals. */
static bool use_coarse(struct gl_classify *c, unsigned program, const struct gl_visible_list *finer,
                       bool normals, bool is_post, const struct sp_level *level,
                       struct sp_error *err) {
    const uint32_t *dims = finer->grid.dims, bricks = sp_visible_brick_count(finer->bricks);
    if (!reserve_places(c, &c->firsts, bricks, err) ||
        !reserve_places(c, &c->counts, sp_visible_bricks(&level->visible), err) ||
        !write_places(c, &c->firsts, finer->first, bricks, err))
        return false;
    assert(finer->is_rising);
    glUseProgram(program);
    glUniform1ui(6, is_post);
    glUniform3ui(1, dims[0], dims[1], dims[2]);
    glUniform4ui(2, finer->has_keys, normals ? finer->normal_bytes : 0, finer->first_class,
                 finer->has_scales);
    gl_buffer_bind(&finer->entries, 0);
    gl_buffer_bind(&finer->tables, 1);
    gl_buffer_bind(finer->normal_bytes ? &finer->normals : &finer->entries, 2);
    gl_buffer_bind(&c->firsts, 3);
    gl_buffer_bind(&c->counts, 4);
    return true;
}

bool gl_classify_count_mip(struct gl_classify *c, const struct gl_visible_list *finer, bool is_post,
                           const struct sp_level *level, const atomic_bool *cancel,
                           uint64_t *counts, struct sp_error *err) {
    uint32_t bricks = sp_visible_bricks(&level->visible);
    return use_coarse(c, c->mip_count, finer, false, is_post, level, err) &&
           run_count(c, bricks, cancel, bricks, counts, err);
}

bool gl_classify_fill_mip(struct gl_classify *c, const struct gl_visible_list *finer, bool is_post,
                          const struct sp_level *level, const struct gl_visible_list *list,
                          const atomic_bool *cancel, struct sp_error *err) {
    uint32_t bricks = sp_visible_bricks(&level->visible);
    const double *fine = finer->grid.spacing, *coarse = level->grid.spacing;
    if (!use_coarse(c, c->mip_fill, finer, list->normal_bytes > 0, is_post, level, err) ||
        !write_places(c, &c->counts, level->visible.first, bricks, err))
        return false;
    set_rows(3, finer, sp_grid_is_rectilinear(&finer->grid));
    set_rows(4, list, list->first_class);
    glUniform3f(5, (float)(fine[0] / coarse[0]), (float)(fine[1] / coarse[1]),
                (float)(fine[2] / coarse[2]));
    gl_buffer_bind(&list->entries, 5);
    gl_buffer_bind(&list->tables, 6);
    gl_buffer_bind(list->normal_bytes ? &list->normals : &list->entries, 7);
    return gl_pass_run(bricks, c->bricks, cancel, err);
}
