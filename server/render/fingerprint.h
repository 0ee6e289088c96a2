/* SPDX-License-Identifier: Apache-2.0
 *
 * What something holds, in 128 bits (XXH3): the same in every run of the daemon. Equal only for
 * equal content, for all purposes but an attack, and there is nothing to gain from one.
 *
 * Two volumes of the same fingerprint look the same in every view. It says nothing of their lives:
 * who needs to know that compares handles (catalog.h).
 */
#ifndef SRV_RENDER_FINGERPRINT_H
#define SRV_RENDER_FINGERPRINT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/volume.h"

enum { SRV_PARTS_MAX = 16, SRV_FINGERPRINT_TEXT = 33 };

struct srv_fingerprint {
    uint64_t high, low;
};

struct srv_part {
    const void *bytes; /* NULL if there are none */
    size_t size;
};
/* Of parts in this order, at most SRV_PARTS_MAX; where one ends and the next begins counts. */
struct srv_fingerprint srv_fingerprint_of(const struct srv_part *parts, unsigned count);
/* Of what decides a volume's pixels: grid, type and voxels. Reads all of it. */
struct srv_fingerprint srv_fingerprint_volume(const struct sp_volume *volume);
/* Of the file of the running program; false: it cannot be read. */
bool srv_fingerprint_program(struct srv_fingerprint *fingerprint);

bool srv_fingerprint_equal(const struct srv_fingerprint *a, const struct srv_fingerprint *b);
/* 32 hexadecimal digits and a NUL, and back. */
void srv_fingerprint_encode(const struct srv_fingerprint *fingerprint,
                            char text[SRV_FINGERPRINT_TEXT]);
bool srv_fingerprint_decode(const char *text, struct srv_fingerprint *fingerprint);

#endif
