/* SPDX-License-Identifier: Apache-2.0 */
#include "render/frame_depth.h"

#include <stdlib.h>
#include <string.h>

#include "protocol/frame_header.h"

bool srv_frame_depth_init(struct srv_bytes *depth, struct sp_encoder *encoder,
                          const struct sp_frame *frame, const struct sp_camera *camera,
                          struct sp_error *err) {
    struct sp_depth_image image = { .byte_count = 0 };
    if (frame->depth && !sp_encode_depth(encoder, frame, camera->projection, &image, err))
        return false;
    const size_t size = PROTO_FRAME_DEPTH_BYTES + image.byte_count;
    uint8_t *bytes = malloc(size);
    if (!bytes)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a depth of %zu bytes", size);
    const struct proto_frame_depth head = { .depth_bytes = (uint32_t)image.byte_count,
                                            .columns = (uint16_t)image.cells[0],
                                            .rows = (uint16_t)image.cells[1],
                                            .near = image.near,
                                            .far = image.far,
                                            .camera = *camera };
    proto_frame_depth_encode(&head, bytes);
    if (image.byte_count > 0)
        memcpy(bytes + PROTO_FRAME_DEPTH_BYTES, image.bytes, image.byte_count);
    *depth = (struct srv_bytes){ .bytes = bytes, .size = size };
    return true;
}

void srv_frame_depth_finish(struct srv_bytes *depth) {
    free(depth->bytes);
    *depth = (struct srv_bytes){ .size = 0 };
}

uint64_t srv_frame_depth_bytes(const uint32_t size[2]) {
    const uint32_t cells[2] = { size[0] / SP_DEPTH_CELL + 1, size[1] / SP_DEPTH_CELL + 1 };
    return PROTO_FRAME_DEPTH_BYTES + 2 * sp_encode_bytes(SP_IMAGE_PNG, cells);
}
