/* SPDX-License-Identifier: Apache-2.0
 *
 * The certificate (a chain, the daemon's own first) and private key from PEM files, and the TLS
 * versions and ciphers (1.2 and 1.3, forward secrecy, authenticated encryption). Immutable; each
 * connection holds a reference to the keys it started with.
 */
#ifndef SRV_HTTP_TLS_KEYS_H
#define SRV_HTTP_TLS_KEYS_H

#include <gnutls/gnutls.h>
#include <stdbool.h>

#include "sp/status.h"

struct srv_tls_keys;

/* Reads both regular files of at most 1 MiB. Others must not have access to the key file, and its
 * group must not write it. Warns in the log if the certificate is not valid today. NULL with *err
 * set: SP_ERR_IO, SP_ERR_DENIED or SP_ERR_FORMAT with the file as its place. */
struct srv_tls_keys *srv_tls_keys_create(const char *certificate, const char *key,
                                         struct sp_error *err);
/* Any thread. */
struct srv_tls_keys *srv_tls_keys_ref(struct srv_tls_keys *keys);
void srv_tls_keys_unref(struct srv_tls_keys **keys);

/* Starts a non-blocking server session on a connected socket. The keys must outlive it. */
bool srv_tls_keys_begin(const struct srv_tls_keys *keys, int socket, gnutls_session_t *session);

#endif
