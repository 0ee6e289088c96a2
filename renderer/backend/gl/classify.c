/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/classify.h"

#include <epoxy/gl.h>
#include <stdlib.h>
#include <string.h>

#include "backend/gl/back.h"
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

static unsigned open_pass(int pass, struct sp_error *err) {
    static const char *const defines[] = { "#define PASS 0\n", "#define PASS 1\n",
                                           "#define PASS 2\n" };
    return gl_program_open("00_classify", defines[pass], err);
}

bool gl_classify_init(struct gl_classify *c, bool software, struct sp_error *err) {
    c->bricks = software ? BRICKS_SOFTWARE : BRICKS_MOST;
    return (c->range = open_pass(0, err)) && (c->count = open_pass(1, err)) &&
           (c->fill = open_pass(2, err));
}

void gl_classify_finish(struct gl_classify *c) {
    glDeleteProgram(c->range);
    glDeleteProgram(c->count);
    glDeleteProgram(c->fill);
    gl_buffer_finish(&c->listed);
    gl_buffer_finish(&c->counts);
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
    uint64_t words = info->voxel_bytes / WORD + 1;
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

/* What is listed, and room for a word a brick. */
static bool reserve(struct gl_classify *c, const struct sp_level *level, struct sp_error *err) {
    uint32_t words[LISTED_WORDS] = { 0 };
    uint64_t bytes = (level->transfer.count / 32u + 1u) * (uint64_t)WORD;
    for (uint32_t k = 0; k < level->transfer.count; k++)
        words[k / 32] |= (uint32_t)(level->listed[k] != 0) << k % 32;
    if (!gl_buffer_reserve(&c->listed, "visible values", sizeof words, 0, GL_USE_STREAM, err) ||
        !gl_buffer_reserve(&c->counts, "bricks",
                           sp_visible_bricks(&level->visible) * (uint64_t)WORD, c->block_bytes,
                           GL_USE_STREAM, err))
        return false;
    bytes = bytes < sizeof words ? bytes : sizeof words;
    gl_buffer_write(&c->listed, words, bytes);
    *c->uploaded += bytes;
    return true;
}

/* Words of bricks, to and from the GPU. */
static uint32_t *allocate(uint32_t bricks, struct sp_error *err) {
    uint32_t *words = malloc(bricks * sizeof *words);
    if (!words)
        sp_fail(err, SP_ERR_MEMORY, "", "no memory for %u bricks", bricks);
    return words;
}

bool gl_classify_count(struct gl_classify *c, const struct gl_voxels *voxels,
                       const struct sp_level *level, const atomic_bool *cancel, uint64_t *counts,
                       struct sp_error *err) {
    uint32_t bricks = sp_visible_bricks(&level->visible);
    uint32_t *words = allocate(bricks, err);
    bool ok = words && reserve(c, level, err);
    if (ok) {
        use(c->count, voxels, 0);
        gl_buffer_bind(&c->listed, 2);
        gl_buffer_bind(&c->counts, 3);
        ok = run(c, bricks, cancel, err);
    }
    if (ok) {
        glBindBuffer(GL_COPY_READ_BUFFER, c->counts.name);
        glGetBufferSubData(GL_COPY_READ_BUFFER, 0, (GLsizeiptr)(bricks * sizeof *words), words);
        ok = gl_check("classified", err);
    }
    for (uint32_t b = 0; ok && b < bricks; b++)
        counts[b] = words[b];
    free(words);
    return ok;
}

/* Where each brick's entries begin. */
static bool write_places(struct gl_classify *c, const struct sp_visible *list,
                         struct sp_error *err) {
    uint32_t bricks = sp_visible_bricks(list), *words = allocate(bricks, err);
    if (!words)
        return false;
    for (uint32_t b = 0; b < bricks; b++)
        words[b] = (uint32_t)list->first[b];
    gl_buffer_write(&c->counts, words, bricks * sizeof *words);
    *c->uploaded += bricks * sizeof *words;
    free(words);
    return true;
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

static void clear(const struct gl_buffer *buffer) {
    glBindBuffer(GL_SHADER_STORAGE_BUFFER, buffer->name);
    glClearBufferData(GL_SHADER_STORAGE_BUFFER, GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT,
                      &(GLuint){ 0 });
}

bool gl_classify_fill(struct gl_classify *c, const struct gl_voxels *voxels,
                      const struct sp_level *level, const struct gl_classify_list *list,
                      const atomic_bool *cancel, struct sp_error *err) {
    const struct sp_grid *grid = &sp_volume_info(voxels->volume)->grid;
    const uint32_t *row = list->axis_row;
    if (!reserve(c, level, err) || !write_places(c, &level->visible, err))
        return false;
    if (list->normal_bytes == 2)
        clear(list->normals);
    use(c->fill, voxels, list->normal_bytes);
    glUniform4ui(3, row[0], row[1], row[2], sp_grid_is_rectilinear(grid));
    set_gradients(voxels->volume);
    gl_buffer_bind(&c->listed, 2);
    gl_buffer_bind(&c->counts, 3);
    gl_buffer_bind(list->entries, 4);
    gl_buffer_bind(list->normal_bytes ? list->normals : list->entries, 5);
    gl_buffer_bind(list->tables, 6);
    return run(c, sp_visible_bricks(&level->visible), cancel, err);
}
