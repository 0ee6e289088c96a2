/* SPDX-License-Identifier: Apache-2.0
 *
 * Remote hierarchies of Zarr. The process that decodes them has no access to the network. The
 * process that has access decodes nothing:
 *
 *   splat-import ══ socket: a key and a range of bytes ══► splat-fetch ══ HTTP ══► host
 *        └──────────── memfd of REMOTE_BUFFER bytes ─────────────┘
 *
 * The parent starts both and gives splat-fetch the address, below which all keys lie. splat-import
 * may be under the control of a hostile file, so splat-fetch checks each key.
 */
#ifndef SP_IMPORT_REMOTE_H
#define SP_IMPORT_REMOTE_H

#include <stdint.h>

#include "sp/status.h"

enum {
    REMOTE_MAGIC = 0x52505331,
    REMOTE_KEY_BYTES = 1024,
    REMOTE_BUFFER = 1 << 20, /* most bytes of one request */
    REMOTE_FILE = 5,         /* descriptors of splat-import */
    REMOTE_MEMORY = 6,
};

struct remote_request {
    uint32_t magic, size; /* size <= REMOTE_BUFFER */
    uint64_t offset;
    char key[REMOTE_KEY_BYTES]; /* ends with 0 */
};

enum remote_found { REMOTE_FAILED, REMOTE_MISSING, REMOTE_FOUND };

struct remote_reply {
    uint32_t magic, found;
    uint32_t code;   /* FAILED: enum sp_code */
    uint32_t status; /* HTTP status; 0 = there was no answer */
    uint64_t total;  /* FOUND: bytes of the object */
    uint64_t got;    /* FOUND: bytes in the memory, from the offset on */
    char text[SP_ERROR_TEXT];
};

#endif
