/* SPDX-License-Identifier: Apache-2.0 */
#include "protocol/frame_header.h"

#include <string.h>

static const uint8_t magic[4] = { 'S', 'P', 'F', '1' };

static void put_u16(uint8_t *out, uint16_t value) {
    out[0] = (uint8_t)value;
    out[1] = (uint8_t)(value >> 8);
}

static void put_u32(uint8_t *out, uint32_t value) {
    put_u16(out, (uint16_t)value);
    put_u16(out + 2, (uint16_t)(value >> 16));
}

static void put_f32(uint8_t *out, float value) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_u32(out, bits);
}

static void put_f64(uint8_t *out, double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_u32(out, (uint32_t)bits);
    put_u32(out + 4, (uint32_t)(bits >> 32));
}

static uint16_t get_u16(const uint8_t *bytes) {
    return (uint16_t)(bytes[0] | bytes[1] << 8);
}

static uint32_t get_u32(const uint8_t *bytes) {
    return get_u16(bytes) | (uint32_t)get_u16(bytes + 2) << 16;
}

static float get_f32(const uint8_t *bytes) {
    const uint32_t bits = get_u32(bytes);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static double get_f64(const uint8_t *bytes) {
    const uint64_t bits = get_u32(bytes) | (uint64_t)get_u32(bytes + 4) << 32;
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static uint16_t header_bytes_of(uint8_t flags) {
    const bool has_depth = flags & PROTO_FRAME_DEPTH;
    return PROTO_FRAME_HEADER_BYTES + (has_depth ? PROTO_FRAME_DEPTH_BYTES : 0);
}

void proto_frame_header_encode(const struct proto_frame_header *header,
                               uint8_t out[PROTO_FRAME_HEADER_BYTES]) {
    memcpy(out, magic, sizeof magic);
    out[4] = header->codec;
    out[5] = header->flags;
    put_u16(out + 6, header_bytes_of(header->flags));
    put_u32(out + 8, header->frame);
    put_u32(out + 12, header->seq);
    put_u16(out + 16, header->width);
    put_u16(out + 18, header->height);
    put_u32(out + 20, header->render_us);
    put_u32(out + 24, header->encode_us);
    put_u32(out + 28, header->payload_bytes);
    put_u32(out + 32, header->queue_us);
}

bool proto_frame_header_decode(const uint8_t *bytes, size_t size,
                               struct proto_frame_header *header) {
    if (size < PROTO_FRAME_HEADER_BYTES || memcmp(bytes, magic, sizeof magic) != 0)
        return false;
    size_t header_bytes = get_u16(bytes + 6), payload_bytes = get_u32(bytes + 28);
    if (header_bytes < header_bytes_of(bytes[5]) || header_bytes > size || bytes[4] == 0)
        return false;
    const bool has_depth = bytes[5] & PROTO_FRAME_DEPTH;
    const uint64_t depth_bytes = has_depth ? get_u32(bytes + PROTO_FRAME_HEADER_BYTES) : 0;
    if (size - header_bytes != payload_bytes + depth_bytes)
        return false;
    *header = (struct proto_frame_header){
        .codec = bytes[4],
        .flags = bytes[5],
        .frame = get_u32(bytes + 8),
        .seq = get_u32(bytes + 12),
        .width = get_u16(bytes + 16),
        .height = get_u16(bytes + 18),
        .render_us = get_u32(bytes + 20),
        .encode_us = get_u32(bytes + 24),
        .payload_bytes = get_u32(bytes + 28),
        .queue_us = get_u32(bytes + 32),
    };
    return true;
}

void proto_frame_depth_encode(const struct proto_frame_depth *depth,
                              uint8_t out[PROTO_FRAME_DEPTH_BYTES]) {
    const struct sp_camera *camera = &depth->camera;
    const bool is_flat = camera->projection == SP_ORTHOGRAPHIC;
    put_u32(out, depth->depth_bytes);
    put_u16(out + 4, depth->columns);
    put_u16(out + 6, depth->rows);
    put_f32(out + 8, depth->near);
    put_f32(out + 12, depth->far);
    put_u32(out + 16, is_flat);
    for (int i = 0; i < 3; i++) {
        put_f64(out + 20 + 8 * i, camera->position[i]);
        put_f64(out + 44 + 8 * i, camera->target[i]);
        put_f64(out + 68 + 8 * i, camera->up[i]);
    }
    put_f64(out + 92, is_flat ? camera->height : camera->fov_y);
}

bool proto_frame_depth_decode(const uint8_t *bytes, size_t size, struct proto_frame_depth *depth) {
    struct proto_frame_header header;
    if (!proto_frame_header_decode(bytes, size, &header) || !(header.flags & PROTO_FRAME_DEPTH))
        return false;
    const uint8_t *from = bytes + PROTO_FRAME_HEADER_BYTES;
    const bool is_flat = get_u32(from + 16) == 1;
    *depth = (struct proto_frame_depth){
        .depth_bytes = get_u32(from),
        .columns = get_u16(from + 4),
        .rows = get_u16(from + 6),
        .near = get_f32(from + 8),
        .far = get_f32(from + 12),
        .camera = { .projection = is_flat ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE,
                    .fov_y = is_flat ? 0 : get_f64(from + 92),
                    .height = is_flat ? get_f64(from + 92) : 0 },
    };
    for (int i = 0; i < 3; i++) {
        depth->camera.position[i] = get_f64(from + 20 + 8 * i);
        depth->camera.target[i] = get_f64(from + 44 + 8 * i);
        depth->camera.up[i] = get_f64(from + 68 + 8 * i);
    }
    return true;
}
