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

static uint16_t get_u16(const uint8_t *bytes) {
    return (uint16_t)(bytes[0] | bytes[1] << 8);
}

static uint32_t get_u32(const uint8_t *bytes) {
    return get_u16(bytes) | (uint32_t)get_u16(bytes + 2) << 16;
}

void proto_frame_header_encode(const struct proto_frame_header *header,
                               uint8_t out[PROTO_FRAME_HEADER_BYTES]) {
    memcpy(out, magic, sizeof magic);
    out[4] = header->codec;
    out[5] = header->flags;
    put_u16(out + 6, PROTO_FRAME_HEADER_BYTES);
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
    if (header_bytes < PROTO_FRAME_HEADER_BYTES || header_bytes > size ||
        size - header_bytes != payload_bytes || bytes[4] == 0)
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
