/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/bins.h"

#include <epoxy/gl.h>

#include "backend/gl/program.h"

bool gl_bins_init(struct gl_bins *bins, struct sp_error *err) {
    return (bins->scan = gl_program_open("bins scan scan_bins", "", err)) &&
           (bins->totals_program = gl_program_open("bins scan scan_totals", "", err)) &&
           (bins->scatter = gl_program_open("bins records scatter", "", err)) &&
           (bins->order = gl_program_open("bins sort_bins", "", err));
}

void gl_bins_finish(struct gl_bins *bins) {
    glDeleteProgram(bins->scan);
    glDeleteProgram(bins->totals_program);
    glDeleteProgram(bins->scatter);
    glDeleteProgram(bins->order);
    gl_buffer_finish(&bins->counts);
    gl_buffer_finish(&bins->totals);
    gl_buffer_finish(&bins->pairs);
}

bool gl_bins_reserve(struct gl_bins *bins, uint64_t count, uint64_t pairs, uint64_t most,
                     struct sp_error *err) {
    enum { WORD = sizeof(uint32_t) };
    return gl_buffer_reserve(&bins->counts, "bins", (count + GL_BINS_HEAD) * WORD, most,
                             GL_USE_SCRATCH, err) &&
           gl_buffer_reserve(&bins->totals, "bins", (count / GL_SCAN_BLOCK + 1) * WORD, most,
                             GL_USE_SCRATCH, err) &&
           gl_buffer_reserve(&bins->pairs, "pairs of splats and tiles", pairs * WORD, most,
                             GL_USE_SCRATCH, err);
}

static void clear(const struct gl_bins *bins, uint64_t first, uint64_t words) {
    enum { WORD = sizeof(uint32_t) };
    glBindBuffer(GL_SHADER_STORAGE_BUFFER, bins->counts.name);
    glClearBufferSubData(GL_SHADER_STORAGE_BUFFER, GL_R32UI, (GLintptr)(first * WORD),
                         (GLsizeiptr)(words * WORD), GL_RED_INTEGER, GL_UNSIGNED_INT,
                         &(GLuint){ 0 });
}

void gl_bins_clear_head(const struct gl_bins *bins) {
    clear(bins, 0, GL_BINS_HEAD);
}

void gl_bins_clear(const struct gl_bins *bins, const struct gl_bins_space *space) {
    clear(bins, GL_BINS_HEAD, gl_bins_count(space));
}

void gl_bins_set_space(const struct gl_bins_space *space) {
    glUniform4ui(0, space->columns, space->y, space->end, space->layers);
}

void gl_bins_sort(const struct gl_bins *bins, const struct gl_bins_space *space,
                  const struct gl_buffer *spans, uint32_t records, uint32_t pairs) {
    uint32_t count = gl_bins_count(space), blocks = gl_divide_up(count, GL_SCAN_BLOCK);
    gl_buffer_bind(&bins->counts, 7);
    gl_buffer_bind(&bins->totals, 6);
    glUseProgram(bins->scan);
    glUniform1ui(1, count);
    glDispatchCompute(blocks, 1, 1);
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
    glUseProgram(bins->totals_program);
    glUniform1ui(1, blocks);
    glDispatchCompute(1, 1, 1);
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
    glUseProgram(bins->scatter);
    gl_bins_set_space(space);
    glUniform2ui(1, records, pairs);
    gl_buffer_bind(spans, 1);
    gl_buffer_bind(&bins->totals, 2);
    gl_buffer_bind(&bins->pairs, 3);
    glDispatchCompute(gl_divide_up(records, GL_GROUP), 1, 1);
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
}

void gl_bins_order(const struct gl_bins *bins, const struct gl_bins_space *space, uint32_t pairs,
                   uint32_t longest) {
    uint32_t count = gl_bins_count(space);
    glUseProgram(bins->order);
    glUniform3ui(1, count, pairs, longest);
    gl_buffer_bind(&bins->totals, 2);
    gl_buffer_bind(&bins->pairs, 3);
    gl_buffer_bind(&bins->counts, 7);
    glDispatchCompute(gl_divide_up(count, GL_GROUP), 1, 1);
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
}
