/* SPDX-License-Identifier: Apache-2.0
 *
 * A fingerprint: a hash of 128 bits (XXH3) that is the same in every run of the daemon. It does
 * not resist deliberate collisions, which would gain an attacker nothing here.
 *
 * Two volumes with the same fingerprint look the same in every view. The fingerprint does not
 * identify a load: to tell an old handle from a new one, compare the handles (catalog.h).
 */
#ifndef SRV_RENDER_FINGERPRINT_H
#define SRV_RENDER_FINGERPRINT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/volume.h"

enum { SRV_PIECES_MAX = 16, SRV_FINGERPRINT_TEXT = 33 };

struct srv_fingerprint {
    uint64_t high, low;
};

struct srv_piece {
    const void *bytes; /* NULL only if size is 0 */
    size_t size;
};
/* Hashes the parts in this order, at most SRV_PIECES_MAX. The boundaries between parts count. */
struct srv_fingerprint srv_fingerprint_of(const struct srv_piece *pieces, unsigned count);
/* Hashes all that decides the pixels of a volume: grid, type and voxels, or elements. Reads all of
 * them. */
struct srv_fingerprint srv_fingerprint_volume(const struct sp_volume *volume);
/* Hashes the running program's file; false if it cannot be read. */
bool srv_fingerprint_program(struct srv_fingerprint *fingerprint);

bool srv_fingerprint_equal(const struct srv_fingerprint *a, const struct srv_fingerprint *b);
/* Converts to 32 hexadecimal digits and a NUL, and back. decode: false for NULL and for any other
 * text. */
void srv_fingerprint_encode(const struct srv_fingerprint *fingerprint,
                            char text[SRV_FINGERPRINT_TEXT]);
bool srv_fingerprint_decode(const char *text, struct srv_fingerprint *fingerprint);

#endif
