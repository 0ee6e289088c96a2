/* SPDX-License-Identifier: Apache-2.0
 *
 * One connection of a Unix socket whose first byte begins the message of an array (UNIX.md). It is
 * received in as many parts as it comes, without waiting.
 */
#ifndef SRV_HTTP_UNIX_PASSING_H
#define SRV_HTTP_UNIX_PASSING_H

#include "http/arrays.h"
#include "protocol/array.h"

struct srv_tokens;

struct srv_passing {
    uint8_t bytes[PROTO_ARRAY_HELLO_MAX + 1]; /* one more shows that bytes follow */
    size_t size;
    int fd;            /* that has come; −1 = none */
    bool has_too_many; /* descriptors */
};

void srv_passing_init(struct srv_passing *passing);
void srv_passing_finish(struct srv_passing *passing); /* closes the descriptor */

/* Receives what has come; `peer` is the user of the other end. When the message is whole or wrong,
 * it is answered, and the result is true: the connection is over. */
bool srv_passing_receive(struct srv_passing *passing, int socket, unsigned peer,
                         struct srv_arrays *arrays, struct srv_tokens *tokens, double now_ms);

#endif
