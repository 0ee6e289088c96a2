/* SPDX-License-Identifier: Apache-2.0
 *
 * What the daemon shows to a TLS client: its certificate (a chain, its own first) and key, from PEM
 * files, and which versions and ciphers it takes (1.2 and 1.3, forward secrecy, authenticated
 * encryption). Immutable; each connection has a reference to those that it began with.
 */
#ifndef SRV_HTTP_TLS_KEYS_H
#define SRV_HTTP_TLS_KEYS_H

#include <gnutls/gnutls.h>
#include <stdbool.h>

#include "sp/status.h"

struct srv_tls_keys;

/* Reads both files, regular ones of at most 1 MiB. The key's may not be open to others, nor be
 * written by its group. A certificate that is not valid today is said in the log. NULL with *err
 * set: SP_ERR_IO, SP_ERR_DENIED or SP_ERR_FORMAT with the file as its place. */
struct srv_tls_keys *srv_tls_keys_create(const char *certificate, const char *key,
                                         struct sp_error *err);
/* Any thread. */
struct srv_tls_keys *srv_tls_keys_ref(struct srv_tls_keys *keys);
void srv_tls_keys_unref(struct srv_tls_keys **keys);

/* A server's session, not blocking, on a connected socket. The keys outlive it. */
bool srv_tls_keys_begin(const struct srv_tls_keys *keys, int socket, gnutls_session_t *session);

#endif
