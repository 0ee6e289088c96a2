/* SPDX-License-Identifier: Apache-2.0 */
#include "session/outbox.h"

#include <string.h>

void srv_outbox_init(struct srv_outbox *outbox) {
    memset(outbox, 0, sizeof *outbox);
}

void srv_outbox_finish(struct srv_outbox *outbox) {
    srv_blob_unref(&outbox->blob);
}

bool srv_outbox_put(struct srv_outbox *outbox, uint64_t order,
                    const struct proto_frame_header *header, struct srv_blob *blob) {
    if (order <= outbox->order) {
        outbox->dropped++;
        return false;
    }
    if (outbox->blob)
        outbox->dropped++;
    srv_blob_unref(&outbox->blob);
    outbox->blob = srv_blob_ref(blob);
    outbox->header = *header;
    outbox->order = order;
    return true;
}

struct srv_blob *srv_outbox_pop(struct srv_outbox *outbox, struct proto_frame_header *header) {
    struct srv_blob *blob = outbox->blob;
    *header = outbox->header;
    outbox->blob = NULL;
    return blob;
}
