/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/depth_order.h"

#include <epoxy/gl.h>
#include <string.h>

#include "backend/gl/band.h"
#include "draw/layers/cloud/order.h"

enum {
    DIGIT_BITS = 8,
    DIGITS = 1 << DIGIT_BITS,
    PASSES = 3,
    ITEMS = 32 * GL_GROUP, /* of a work group: shaders/depth_order.glsl */
    ITEM_BYTES = 8,
    PARTS = 40, /* locations in shaders/passes/compute_depths.glsl */
    PART_AT = 41
};
_Static_assert((int)DIGITS == (int)GL_GROUP, "a thread per digit");

/* A linear form of camera space as one of an element's position. */
static void write_form(float to[4], const struct sp_cloud *cloud, const float normal[3],
                       float offset) {
    to[3] = -offset;
    for (int r = 0; r < 3; r++)
        to[3] += normal[r] * cloud->offset[r];
    for (int a = 0; a < 3; a++)
        to[a] = normal[0] * cloud->place[0][a] + normal[1] * cloud->place[1][a] +
                normal[2] * cloud->place[2][a];
}

static void compute_depths(struct gl_state *s, const struct gl_splats_made *made, uint32_t count,
                           bool is_chosen) {
    const struct sp_cloud *cloud = &made->cloud;
    const struct sp_voxel_frame *frame = &made->source.frame;
    const struct sp_clip_frame *clip = &frame->ewa.clip;
    const float forward[3] = { 0, 0, 1 };
    float depth[4], planes[GL_CLIP_PLANES][4];
    write_form(depth, cloud, forward, 0);
    for (uint32_t i = 0; i < clip->count; i++)
        write_form(planes[i], cloud, clip->planes[i].normal, clip->planes[i].offset);
    glUseProgram(s->depth_order.depths.program);
    glUniform4ui(0, count, gl_cloud_elements(cloud), is_chosen, made->kind == GL_SPLAT_GAUSSIANS);
    glUniform4fv(1, 1, depth);
    glUniform4f(2, frame->ewa.near, cloud->opacity, SP_TRAINED_OPACITY_MIN,
                sp_cloud_reach(cloud, frame));
    glUniform1ui(3, clip->count);
    if (clip->count)
        glUniform4fv(4, (GLsizei)clip->count, planes[0]);
    glUniform2f(PARTS, (float)cloud->parts, cloud->size);
    glUniform1fv(PART_AT, SP_CLOUD_PARTS_MAX, cloud->part_at);
    glDispatchCompute(gl_divide_up(count, GL_GROUP), 1, 1);
    gl_band_barrier();
}

/* Sorts the items by a digit; the last one gives the order. */
static void sort_digit(struct gl_state *s, uint32_t count, int pass) {
    const uint32_t groups = gl_divide_up(count, ITEMS), shift = (uint32_t)pass * DIGIT_BITS;
    gl_buffer_bind(&s->buffers.items[pass % 2], 1);
    gl_buffer_bind(&s->buffers.items[1 - pass % 2], 2);
    glUseProgram(s->depth_order.digits.program);
    glUniform2ui(0, count, shift);
    glDispatchCompute(groups, 1, 1);
    gl_band_barrier();
    glUseProgram(s->depth_order.starts.program);
    glUniform1ui(0, DIGITS * groups);
    glDispatchCompute(1, 1, 1);
    gl_band_barrier();
    glUseProgram(s->depth_order.move.program);
    glUniform3ui(0, count, shift, pass + 1 == PASSES);
    glDispatchCompute(groups, 1, 1);
    gl_band_barrier();
}

bool gl_depth_order_open(struct gl_state *s, struct sp_error *err) {
    static const char what[] = "the order of elements";
    return gl_program_late(&s->depth_order.depths, "ordinal depth_order compute_depths", "",
                           s->device, what, err) &&
           gl_program_late(&s->depth_order.digits, "ordinal depth_order count_digits", "",
                           s->device, what, err) &&
           gl_program_late(&s->depth_order.starts, "scan scan_digits", "", s->device, what, err) &&
           gl_program_late(&s->depth_order.move, "ordinal depth_order move_items", "", s->device,
                           what, err);
}

bool gl_depth_order_reserve(struct gl_state *s, uint32_t count, struct sp_error *err) {
    const uint64_t bytes = (uint64_t)count * ITEM_BYTES, most = s->block_bytes;
    const uint64_t counts = (uint64_t)gl_divide_up(count, ITEMS) * DIGITS * sizeof(uint32_t);
    return gl_buffer_reserve(&s->buffers.items[0], "depths of elements", bytes, most,
                             GL_USE_SCRATCH, err) &&
           gl_buffer_reserve(&s->buffers.items[1], "depths of elements", bytes, most,
                             GL_USE_SCRATCH, err) &&
           gl_buffer_reserve(&s->buffers.digits, "order of elements", counts, most, GL_USE_SCRATCH,
                             err) &&
           gl_buffer_reserve(&s->buffers.range, "order of elements", 2 * sizeof(int32_t), most,
                             GL_USE_STREAM, err);
}

void gl_depth_order_make(struct gl_state *s, const struct gl_splats_made *made,
                         const struct gl_buffer *elements, const struct gl_buffer *choice,
                         const struct gl_buffer *order) {
    static const int32_t nothing[2] = { INT32_MAX, -INT32_MAX };
    const uint32_t count = made->source.order.count * made->cloud.parts;
    gl_buffer_write(&s->buffers.range, nothing, sizeof nothing);
    gl_buffer_bind(&s->buffers.digits, 0);
    gl_buffer_bind(&s->buffers.items[0], 2);
    gl_buffer_bind(&s->buffers.range, 3);
    gl_buffer_bind(elements, 4);
    gl_buffer_bind(choice ? choice : elements, 5);
    compute_depths(s, made, count, choice != NULL);
    gl_buffer_bind(order, 4);
    for (int pass = 0; pass < PASSES; pass++)
        sort_digit(s, count, pass);
}

void gl_depth_order_finish(struct gl_state *s) {
    glDeleteProgram(s->depth_order.depths.program);
    glDeleteProgram(s->depth_order.digits.program);
    glDeleteProgram(s->depth_order.starts.program);
    glDeleteProgram(s->depth_order.move.program);
    memset(&s->depth_order, 0, sizeof s->depth_order);
}
