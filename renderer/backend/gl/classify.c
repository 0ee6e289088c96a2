/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/classify.h"

#include <assert.h>
#include <epoxy/gl.h>
#include <stdlib.h>
#include <string.h>

#include "backend/gl/back.h"
#include "backend/gl/bins.h"
#include "backend/gl/program.h"
#include "classify/gradient.h"
#include "volume/grid.h"

enum {
    BRICKS_MOST = 8192,        /* of a dispatch: some 10 ms */
    BRICKS_SOFTWARE = 64,      /* the same */
    IN_FLIGHT = 2,             /* dispatches that the GPU may lie behind */
    UPLOAD_BYTES = 1 << 26,    /* between two looks at the cancel flag */
    LISTED_WORDS = 65536 / 32, /* a bit a key */
    WORD = sizeof(uint32_t)
};

static unsigned open_pass(const char *names, int pass, struct sp_error *err) {
    static const char *const defines[] = { "#define PASS 0\n", "#define PASS 1\n",
                                           "#define PASS 2\n", "#define PASS 3\n" };
    return gl_program_open(names, defines[pass], err);
}

bool gl_classify_init(struct gl_classify *c, bool software, struct sp_error *err) {
    c->bricks = software ? BRICKS_SOFTWARE : BRICKS_MOST;
    return (c->range = open_pass("00_classify", 0, err)) &&
           (c->count = open_pass("00_classify", 1, err)) &&
           (c->fill = open_pass("00_classify", 2, err)) &&
           (c->histogram = open_pass("00_classify", 3, err)) &&
           (c->coarse_count = open_pass("gradient 01_coarse", 0, err)) &&
           (c->coarse_fill = open_pass("gradient 01_coarse", 1, err));
}

void gl_classify_finish(struct gl_classify *c) {
    glDeleteProgram(c->range);
    glDeleteProgram(c->count);
    glDeleteProgram(c->fill);
    glDeleteProgram(c->histogram);
    glDeleteProgram(c->coarse_count);
    glDeleteProgram(c->coarse_fill);
    gl_buffer_finish(&c->listed);
    gl_buffer_finish(&c->counts);
    gl_buffer_finish(&c->firsts);
}

static bool is_cancelled(const atomic_bool *cancel, struct sp_error *err) {
    if (!cancel || !atomic_load_explicit(cancel, memory_order_relaxed))
        return false;
    sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    return true;
}

/* Runs the program in use over all bricks, a work group each, and waits for it. A pass that is
 * cancelled leaves two dispatches behind. */
static bool run(const struct gl_classify *c, uint32_t bricks, const atomic_bool *cancel,
                struct sp_error *err) {
    void *sent[IN_FLIGHT] = { NULL };
    uint32_t turn = 0;
    bool ok = true;
    for (uint32_t done = 0, n; ok && done < bricks; done += n, turn = (turn + 1) % IN_FLIGHT) {
        n = bricks - done < c->bricks ? bricks - done : c->bricks;
        ok = gl_fence_wait(&sent[turn], cancel, err) && !is_cancelled(cancel, err);
        if (!ok)
            break;
        glUniform1ui(0, done);
        glDispatchCompute(n, 1, 1);
        gl_fence_set(&sent[turn]);
    }
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT | GL_BUFFER_UPDATE_BARRIER_BIT);
    for (int i = 0; i < IN_FLIGHT; i++)
        ok = ok && gl_fence_wait(&sent[(turn + (uint32_t)i) % IN_FLIGHT], cancel, err);
    for (int i = 0; i < IN_FLIGHT; i++)
        gl_fence_drop(&sent[i]);
    return ok && gl_check("classified", err);
}

static uint32_t count_bricks(const struct sp_grid *grid) {
    uint32_t bricks = 1;
    for (int a = 0; a < 3; a++)
        bricks *= (grid->dims[a] + SP_BRICK - 1) / SP_BRICK;
    return bricks;
}

/* The program, and what all passes are told of the volume. */
static void use(unsigned program, const struct gl_voxels *voxels, uint32_t normal_bytes) {
    const struct sp_volume_info *info = sp_volume_info(voxels->volume);
    bool is_signed = info->type == SP_INT8 || info->type == SP_INT16;
    glUseProgram(program);
    glUniform3ui(1, info->grid.dims[0], info->grid.dims[1], info->grid.dims[2]);
    glUniform4i(2, (GLint)sp_type_size(info->type), is_signed, (GLint)info->range[0],
                (GLint)normal_bytes);
    gl_buffer_bind(&voxels->samples, 0);
    gl_buffer_bind(&voxels->ranges, 1);
}

static bool upload(struct gl_classify *c, const struct gl_voxels *voxels, const atomic_bool *cancel,
                   struct sp_error *err) {
    const char *samples = sp_volume_voxels(voxels->volume);
    uint64_t bytes = sp_volume_info(voxels->volume)->voxel_bytes;
    for (uint64_t at = 0, n; at < bytes; at += n) {
        n = bytes - at < UPLOAD_BYTES ? bytes - at : UPLOAD_BYTES;
        if (is_cancelled(cancel, err))
            return false;
        glBindBuffer(GL_SHADER_STORAGE_BUFFER, voxels->samples.name);
        glBufferSubData(GL_SHADER_STORAGE_BUFFER, (GLintptr)at, (GLsizeiptr)n, samples + at);
        *c->uploaded += n;
    }
    return true;
}

bool gl_classify_load(struct gl_classify *c, struct gl_voxels *voxels, const atomic_bool *cancel,
                      struct sp_error *err) {
    const struct sp_volume_info *info = sp_volume_info(voxels->volume);
    uint32_t bricks = count_bricks(&info->grid);
    uint64_t words = (info->voxel_bytes + WORD - 1) / WORD;
    if (voxels->samples.name)
        return true;
    bool ok = gl_buffer_reserve(&voxels->samples, "voxels", words * WORD, c->block_bytes,
                                GL_USE_KEPT, err) &&
              gl_buffer_reserve(&voxels->ranges, "ranges of bricks", (uint64_t)bricks * WORD,
                                c->block_bytes, GL_USE_KEPT, err) &&
              upload(c, voxels, cancel, err);
    if (ok) {
        use(c->range, voxels, 0);
        ok = run(c, bricks, cancel, err);
    }
    if (!ok)
        gl_voxels_drop(voxels);
    return ok;
}

/* A bit a key: what is listed. */
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

/* Words that are sent or come back, and one more. */
static uint32_t *allocate(uint32_t count, struct sp_error *err) {
    uint32_t *words = malloc((count + (size_t)1) * sizeof *words);
    if (!words)
        sp_fail(err, SP_ERR_MEMORY, "", "no memory for %u counts", count);
    return words;
}

/* Where each brick's entries begin, and where the last ones end. */
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

/* Runs the program in use over all bricks and gets what it counted, `count` words. */
static bool run_count(const struct gl_classify *c, uint32_t bricks, const atomic_bool *cancel,
                      uint32_t count, uint64_t *counts, struct sp_error *err) {
    uint32_t *words = allocate(count, err);
    bool ok = words && run(c, bricks, cancel, err);
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

bool gl_classify_count(struct gl_classify *c, const struct gl_voxels *voxels,
                       const struct sp_level *level, const atomic_bool *cancel, uint64_t *counts,
                       struct sp_error *err) {
    uint32_t bricks = sp_visible_bricks(&level->visible);
    if (!write_listed(c, level, err) || !reserve_places(c, &c->counts, bricks, err))
        return false;
    use(c->count, voxels, 0);
    gl_buffer_bind(&c->listed, 2);
    gl_buffer_bind(&c->counts, 3);
    return run_count(c, bricks, cancel, bricks, counts, err);
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
    use(c->histogram, voxels, 0);
    gl_buffer_bind(&c->counts, 3);
    return run_count(c, count_bricks(&sp_volume_info(voxels->volume)->grid), cancel, keys, counts,
                     err);
}

/* Differences a spacing → world gradient over its bound. */
static void set_gradients(const struct sp_volume *volume) {
    struct sp_gradient_grid grid;
    float columns[9];
    sp_gradient_units_init(&grid, sp_volume_info(volume));
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            columns[3 * a + r] = (float)(grid.to_world[r][a] / grid.unit);
    glUniformMatrix3fv(4, 1, GL_FALSE, columns);
}

/* Where in the tables a list's axes are, and one thing more. */
static void set_rows(int location, const struct gl_list *list, uint32_t last) {
    const uint32_t *row = list->axis_row;
    glUniform4ui(location, row[0], row[1], row[2], last);
}

bool gl_classify_fill(struct gl_classify *c, const struct gl_voxels *voxels,
                      const struct sp_level *level, const struct gl_list *list,
                      const atomic_bool *cancel, struct sp_error *err) {
    uint32_t bricks = sp_visible_bricks(&level->visible);
    if (!write_listed(c, level, err) || !reserve_places(c, &c->counts, bricks, err) ||
        !write_places(c, &c->counts, level->visible.first, bricks, err))
        return false;
    if (list->normal_bytes == 2)
        clear(&list->normals, level->visible.count / 2 + 1);
    use(c->fill, voxels, list->normal_bytes);
    set_rows(3, list, sp_grid_is_rectilinear(&level->grid));
    set_gradients(voxels->volume);
    gl_buffer_bind(&c->listed, 2);
    gl_buffer_bind(&c->counts, 3);
    gl_buffer_bind(&list->entries, 4);
    gl_buffer_bind(list->normal_bytes ? &list->normals : &list->entries, 5);
    gl_buffer_bind(&list->tables, 6);
    return run(c, bricks, cancel, err);
}

/* The program, and what it is told of the finer level, of which it reads normals or not. */
static bool use_coarse(struct gl_classify *c, unsigned program, const struct gl_list *finer,
                       bool normals, const struct sp_level *level, struct sp_error *err) {
    const uint32_t *dims = finer->grid.dims, bricks = gl_list_bricks(finer);
    if (!reserve_places(c, &c->firsts, bricks, err) ||
        !reserve_places(c, &c->counts, sp_visible_bricks(&level->visible), err) ||
        !write_places(c, &c->firsts, finer->first, bricks, err))
        return false;
    assert(finer->is_rising);
    glUseProgram(program);
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

bool gl_classify_count_coarse(struct gl_classify *c, const struct gl_list *finer,
                              const struct sp_level *level, const atomic_bool *cancel,
                              uint64_t *counts, struct sp_error *err) {
    uint32_t bricks = sp_visible_bricks(&level->visible);
    return use_coarse(c, c->coarse_count, finer, false, level, err) &&
           run_count(c, bricks, cancel, bricks, counts, err);
}

bool gl_classify_fill_coarse(struct gl_classify *c, const struct gl_list *finer,
                             const struct sp_level *level, const struct gl_list *list,
                             const atomic_bool *cancel, struct sp_error *err) {
    uint32_t bricks = sp_visible_bricks(&level->visible);
    const double *fine = finer->grid.spacing, *coarse = level->grid.spacing;
    if (!use_coarse(c, c->coarse_fill, finer, list->normal_bytes > 0, level, err) ||
        !write_places(c, &c->counts, level->visible.first, bricks, err))
        return false;
    set_rows(3, finer, sp_grid_is_rectilinear(&finer->grid));
    set_rows(4, list, list->first_class);
    glUniform3f(5, (float)(fine[0] / coarse[0]), (float)(fine[1] / coarse[1]),
                (float)(fine[2] / coarse[2]));
    gl_buffer_bind(&list->entries, 5);
    gl_buffer_bind(&list->tables, 6);
    gl_buffer_bind(list->normal_bytes ? &list->normals : &list->entries, 7);
    return run(c, bricks, cancel, err);
}
