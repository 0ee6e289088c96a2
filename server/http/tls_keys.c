/* SPDX-License-Identifier: Apache-2.0 */
#include "http/tls_keys.h"

#include <errno.h>
#include <gnutls/x509.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "common/clock.h"
#include "config/config.h"
#include "sp/log.h"

enum { PEM_BYTES_MAX = 1 << 20 };

/* No RSA key exchange, because it has no forward secrecy. No CBC, because of its history of
 * attacks. No finite-field groups, because they cost a server tens of times as much. X25519 is
 * first, because clients send a key share for it without being asked: any other group would cost
 * them another round trip. */
static const char priorities[] = "SECURE128:-VERS-ALL:+VERS-TLS1.3:+VERS-TLS1.2:-RSA:-DHE-RSA:"
                                 "-GROUP-ALL:+GROUP-X25519:+GROUP-SECP256R1:+GROUP-SECP384R1:"
                                 "-AES-128-CBC:-AES-256-CBC:%SERVER_PRECEDENCE";

struct srv_tls_keys {
    atomic_uint references;
    gnutls_certificate_credentials_t credentials;
    gnutls_priority_t priorities;
};

struct srv_tls_keys *srv_tls_keys_ref(struct srv_tls_keys *keys) {
    atomic_fetch_add_explicit(&keys->references, 1, memory_order_relaxed);
    return keys;
}

void srv_tls_keys_unref(struct srv_tls_keys **keys_pointer) {
    struct srv_tls_keys *keys = *keys_pointer;
    *keys_pointer = NULL;
    if (!keys || atomic_fetch_sub_explicit(&keys->references, 1, memory_order_acq_rel) != 1)
        return;
    if (keys->priorities)
        gnutls_priority_deinit(keys->priorities);
    if (keys->credentials)
        gnutls_certificate_free_credentials(keys->credentials);
    free(keys);
}

/* Returns the malloc'ed bytes of a file; data == NULL with *err set. */
static gnutls_datum_t read_pem(const char *path, bool is_secret, struct sp_error *err) {
    gnutls_datum_t pem = { NULL, 0 };
    struct stat st;
    FILE *file = srv_open_regular(path);
    if (!file || fstat(fileno(file), &st) != 0) {
        sp_fail(err, SP_ERR_IO, path, "cannot read the file: %s", strerror(errno));
    } else if (is_secret && st.st_mode & (S_IRWXO | S_IWGRP)) {
        sp_fail(err, SP_ERR_DENIED, path,
                "users other than its owner can read or change the private key (mode %04o); "
                "run: chmod 600 FILE",
                (unsigned)st.st_mode & 07777);
    } else if (st.st_size > PEM_BYTES_MAX) {
        sp_fail(err, SP_ERR_FORMAT, path, "has %lld bytes; the limit of a PEM file is %d",
                (long long)st.st_size, PEM_BYTES_MAX);
    } else if (!(pem.data = malloc(PEM_BYTES_MAX))) {
        sp_fail(err, SP_ERR_MEMORY, path, "out of memory while reading the file");
    } else {
        pem.size = (unsigned)fread(pem.data, 1, PEM_BYTES_MAX, file);
        if (ferror(file)) {
            sp_fail(err, SP_ERR_IO, path, "cannot read the file: %s", strerror(errno));
            free(pem.data);
            pem.data = NULL;
        }
    }
    if (file)
        fclose(file);
    return pem;
}

static void release_pem(gnutls_datum_t *pem) {
    if (pem->data)
        gnutls_memset(pem->data, 0, pem->size);
    free(pem->data);
    pem->data = NULL;
}

static void warn_of_dates(const struct srv_tls_keys *keys, const char *path) {
    gnutls_datum_t raw;
    gnutls_x509_crt_t certificate;
    if (gnutls_certificate_get_crt_raw(keys->credentials, 0, 0, &raw) != 0 ||
        gnutls_x509_crt_init(&certificate) != 0)
        return;
    if (gnutls_x509_crt_import(certificate, &raw, GNUTLS_X509_FMT_DER) == 0) {
        const time_t now = srv_clock_date().tv_sec;
        if (now < gnutls_x509_crt_get_activation_time(certificate))
            sp_log(SP_LOG_WARN, "%s: the certificate is not valid yet", path);
        else if (now > gnutls_x509_crt_get_expiration_time(certificate))
            sp_log(SP_LOG_WARN, "%s: the certificate has expired: clients will refuse it", path);
    }
    gnutls_x509_crt_deinit(certificate);
}

/* Writes to *err why certificate and key cannot be used: one of them is invalid, or they do not
 * match. Returns false. */
static bool explain(const gnutls_datum_t *certificate, const char *certificate_path,
                    const char *key_path, int code, struct sp_error *err) {
    gnutls_x509_crt_t *list = NULL;
    unsigned count = 0;
    int listed = gnutls_x509_crt_list_import2(&list, &count, certificate, GNUTLS_X509_FMT_PEM, 0);
    for (unsigned i = 0; listed >= 0 && i < count; i++)
        gnutls_x509_crt_deinit(list[i]);
    gnutls_free(list);
    if (code == GNUTLS_E_MEMORY_ERROR)
        return sp_fail(err, SP_ERR_MEMORY, certificate_path, "out of memory for the certificate");
    if (listed < 0)
        return sp_fail(err, SP_ERR_FORMAT, certificate_path, "is not a PEM certificate: %s",
                       gnutls_strerror(listed));
    if (code == GNUTLS_E_CERTIFICATE_KEY_MISMATCH)
        return sp_fail(err, SP_ERR_FORMAT, key_path, "is not the key of the certificate in %s",
                       certificate_path);
    return sp_fail(err, SP_ERR_FORMAT, key_path, "is not a PEM private key without a password: %s",
                   gnutls_strerror(code));
}

struct srv_tls_keys *srv_tls_keys_create(const char *certificate_path, const char *key_path,
                                         struct sp_error *err) {
    gnutls_datum_t key = { NULL, 0 }, certificate = read_pem(certificate_path, false, err);
    if (certificate.data)
        key = read_pem(key_path, true, err);
    struct srv_tls_keys *keys = key.data ? calloc(1, sizeof *keys) : NULL;
    bool ok = keys != NULL;
    if (ok) {
        atomic_init(&keys->references, 1);
        int code = gnutls_certificate_allocate_credentials(&keys->credentials);
        if (code == 0)
            code = gnutls_priority_init(&keys->priorities, priorities, NULL);
        ok = code == 0 || sp_fail(err, SP_ERR_MEMORY, NULL, "TLS: %s", gnutls_strerror(code));
        if (ok)
            code = gnutls_certificate_set_x509_key_mem(keys->credentials, &certificate, &key,
                                                       GNUTLS_X509_FMT_PEM);
        ok = ok && (code >= 0 || explain(&certificate, certificate_path, key_path, code, err));
        if (ok)
            warn_of_dates(keys, certificate_path);
    } else if (key.data) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the certificate");
    }
    release_pem(&certificate);
    release_pem(&key);
    if (!ok)
        srv_tls_keys_unref(&keys);
    return keys;
}

bool srv_tls_keys_begin(const struct srv_tls_keys *keys, int socket, gnutls_session_t *session) {
    static const gnutls_datum_t http = { (unsigned char *)"http/1.1", 8 };
    if (gnutls_init(session, GNUTLS_SERVER | GNUTLS_NONBLOCK | GNUTLS_NO_SIGNAL) != 0)
        return false;
    if (gnutls_priority_set(*session, keys->priorities) == 0 &&
        gnutls_credentials_set(*session, GNUTLS_CRD_CERTIFICATE, keys->credentials) == 0 &&
        gnutls_alpn_set_protocols(*session, &http, 1, 0) == 0) {
        gnutls_handshake_set_timeout(
            *session, GNUTLS_INDEFINITE_TIMEOUT); /* srv_tls_options.handshake_ms limits it */
        gnutls_transport_set_int(*session, socket);
        return true;
    }
    gnutls_deinit(*session);
    return false;
}
