/* SPDX-License-Identifier: Apache-2.0
 *
 * The TLS acceptor: handshakes delay no open connection, closing, and a lack of file descriptors.
 * The tests can pause the handshakes of the daemon.
 */
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cmocka.h>
#include <gnutls/x509.h>

#include "http/tls.h"
#include "support/compare.h"
#include "support/metric_value.h"

enum { LIMIT_MS = 30000 /* timeout of waits that must not be necessary */, GIVEN = 64 };

/* The pause. */

static struct {
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    bool is_paused;
    unsigned waiting; /* handshakes that are paused */
    int given[GIVEN]; /* HTTP sides of the connections, in order */
    unsigned count;
} pause_point = { .mutex = PTHREAD_MUTEX_INITIALIZER };

int __real_gnutls_handshake(gnutls_session_t session);
int __wrap_gnutls_handshake(gnutls_session_t session);
int __wrap_gnutls_handshake(gnutls_session_t session) {
    pthread_mutex_lock(&pause_point.mutex);
    pause_point.waiting++;
    pthread_cond_broadcast(&pause_point.changed);
    while (pause_point.is_paused)
        pthread_cond_wait(&pause_point.changed, &pause_point.mutex);
    pause_point.waiting--;
    pthread_mutex_unlock(&pause_point.mutex);
    return __real_gnutls_handshake(session);
}

static void pause_handshakes(bool is_paused) {
    pthread_mutex_lock(&pause_point.mutex);
    pause_point.is_paused = is_paused;
    pthread_cond_broadcast(&pause_point.changed);
    pthread_mutex_unlock(&pause_point.mutex);
}

static void wait_until(const unsigned *number, unsigned is) {
    struct timespec limit;
    clock_gettime(CLOCK_MONOTONIC, &limit);
    limit.tv_sec += LIMIT_MS / 1000;
    int code = 0;
    pthread_mutex_lock(&pause_point.mutex);
    while (*number < is && code == 0)
        code = pthread_cond_timedwait(&pause_point.changed, &pause_point.mutex, &limit);
    pthread_mutex_unlock(&pause_point.mutex);
    assert_int_equal(code, 0);
}

static bool give(void *user, int socket, const struct sockaddr *peer, socklen_t size) {
    (void)user, (void)peer, (void)size;
    pthread_mutex_lock(&pause_point.mutex);
    bool has_capacity = pause_point.count < GIVEN;
    if (has_capacity)
        pause_point.given[pause_point.count++] = socket;
    pthread_cond_broadcast(&pause_point.changed);
    pthread_mutex_unlock(&pause_point.mutex);
    if (!has_capacity)
        close(socket);
    return has_capacity;
}

/* The acceptor. */

static void write_file(const char *path, const gnutls_datum_t *text) {
    int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    assert_compare(fd, >=, 0);
    assert_int_equal(write(fd, text->data, text->size), text->size);
    close(fd);
}

/* Creates a self-signed certificate for the test. */
static struct srv_tls_keys *make_keys(void) {
    char folder[] = "/tmp/splatd-tls-XXXXXX", certificate_path[64], key_path[64];
    unsigned char serial = 1;
    gnutls_x509_privkey_t key;
    gnutls_x509_crt_t certificate;
    gnutls_datum_t key_text, certificate_text;
    assert_non_null(mkdtemp(folder));
    snprintf(certificate_path, sizeof certificate_path, "%s/cert.pem", folder);
    snprintf(key_path, sizeof key_path, "%s/key.pem", folder);
    assert_int_equal(gnutls_x509_privkey_init(&key), 0);
    assert_int_equal(gnutls_x509_privkey_generate(
                         key, GNUTLS_PK_ECDSA, GNUTLS_CURVE_TO_BITS(GNUTLS_ECC_CURVE_SECP256R1), 0),
                     0);
    assert_int_equal(gnutls_x509_crt_init(&certificate), 0);
    gnutls_x509_crt_set_version(certificate, 3);
    gnutls_x509_crt_set_serial(certificate, &serial, sizeof serial);
    gnutls_x509_crt_set_activation_time(certificate, time(NULL) - 3600);
    gnutls_x509_crt_set_expiration_time(certificate, time(NULL) + 3600);
    gnutls_x509_crt_set_key(certificate, key);
    assert_int_equal(gnutls_x509_crt_sign2(certificate, certificate, key, GNUTLS_DIG_SHA256, 0), 0);
    assert_int_equal(gnutls_x509_crt_export2(certificate, GNUTLS_X509_FMT_PEM, &certificate_text),
                     0);
    assert_int_equal(gnutls_x509_privkey_export2(key, GNUTLS_X509_FMT_PEM, &key_text), 0);
    write_file(certificate_path, &certificate_text);
    write_file(key_path, &key_text);
    gnutls_free(certificate_text.data);
    gnutls_free(key_text.data);
    gnutls_x509_crt_deinit(certificate);
    gnutls_x509_privkey_deinit(key);
    struct sp_error err;
    struct srv_tls_keys *keys = srv_tls_keys_create(certificate_path, key_path, &err);
    assert_non_null(keys);
    unlink(certificate_path);
    unlink(key_path);
    rmdir(folder);
    return keys;
}

struct acceptor {
    struct srv_tls *tls;
    struct srv_metrics *metrics;
    struct sockaddr_in address;
    gnutls_certificate_credentials_t
        trust; /* credentials of clients, which trust any certificate */
};

static int begin(void **state) {
    struct acceptor *a = calloc(1, sizeof *a);
    socklen_t size = sizeof a->address;
    assert_non_null(a);
    a->address.sin_family = AF_INET;
    a->address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    assert_int_equal(bind(fd, (const struct sockaddr *)&a->address, size), 0);
    assert_int_equal(listen(fd, GIVEN), 0);
    assert_int_equal(getsockname(fd, (struct sockaddr *)&a->address, &size), 0);
    assert_int_equal(gnutls_certificate_allocate_credentials(&a->trust), 0);
    a->metrics = srv_metrics_create();
    struct srv_tls_options options = { .keys = make_keys(),
                                       .socket = fd,
                                       .handshake_ms = 10 * LIMIT_MS,
                                       .linger_ms = 10 * LIMIT_MS,
                                       .handshakes_max = GIVEN,
                                       .connections_max = GIVEN,
                                       .metrics = a->metrics,
                                       .give = give };
    struct sp_error err;
    pause_point.count = 0;
    a->tls = srv_tls_create(&options, &err);
    assert_non_null(a->tls);
    *state = a;
    return 0;
}

static int end(void **state) {
    struct acceptor *a = *state;
    pause_handshakes(false);
    srv_tls_close(a->tls);
    for (unsigned i = 0; i < pause_point.count; i++)
        close(pause_point.given[i]);
    srv_tls_destroy(&a->tls);
    gnutls_certificate_free_credentials(a->trust);
    srv_metrics_destroy(&a->metrics);
    free(a);
    return 0;
}

/* Clients. */

struct client {
    int fd;
    bool is_not_reading; /* does not read from the socket */
    gnutls_session_t session;
};

static void call(const struct acceptor *a, struct client *c) {
    assert_int_equal(connect(c->fd, (const struct sockaddr *)&a->address, sizeof a->address), 0);
}

static ssize_t pull(gnutls_transport_ptr_t client, void *bytes, size_t size) {
    const struct client *c = client;
    if (!c->is_not_reading)
        return recv(c->fd, bytes, size, 0);
    gnutls_transport_set_errno(c->session, EAGAIN);
    return -1;
}

/* Connects and sends the ClientHello, without reading the answer. */
static void send_client_hello(const struct acceptor *a, struct client *c) {
    c->fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    call(a, c);
    assert_int_equal(fcntl(c->fd, F_SETFL, O_NONBLOCK), 0);
    assert_int_equal(gnutls_init(&c->session, GNUTLS_CLIENT | GNUTLS_NONBLOCK | GNUTLS_NO_SIGNAL),
                     0);
    assert_int_equal(gnutls_set_default_priority(c->session), 0);
    assert_int_equal(gnutls_credentials_set(c->session, GNUTLS_CRD_CERTIFICATE, a->trust), 0);
    gnutls_handshake_set_timeout(c->session, GNUTLS_INDEFINITE_TIMEOUT);
    gnutls_transport_set_ptr2(c->session, c, (gnutls_transport_ptr_t)(intptr_t)c->fd);
    gnutls_transport_set_pull_function(c->session, pull);
    c->is_not_reading = true;
    assert_int_equal(__real_gnutls_handshake(c->session), GNUTLS_E_AGAIN);
    c->is_not_reading = false;
}

static void wait_for(int fd, short what) {
    struct pollfd look = { .fd = fd, .events = what };
    assert_int_equal(poll(&look, 1, LIMIT_MS), 1);
}

static void finish_handshake(struct client *c) {
    int code;
    while ((code = __real_gnutls_handshake(c->session)) != 0) {
        assert_int_equal(code, GNUTLS_E_AGAIN);
        wait_for(c->fd, gnutls_record_get_direction(c->session) ? POLLOUT : POLLIN);
    }
}

static void hang_up(struct client *c) {
    if (c->session)
        gnutls_deinit(c->session);
    close(c->fd);
}

/* Checks that bytes pass in both directions. */
static void exchange(struct client *c, int server) {
    static const char text[] = "a message over an open connection of two sides";
    char got[sizeof text] = "";
    assert_int_equal(gnutls_record_send(c->session, text, sizeof text), sizeof text);
    wait_for(server, POLLIN);
    assert_int_equal(recv(server, got, sizeof got, 0), sizeof text);
    assert_string_equal(got, text);
    assert_int_equal(send(server, text, sizeof text, MSG_NOSIGNAL), sizeof text);
    ssize_t size;
    do
        wait_for(c->fd, POLLIN);
    while ((size = gnutls_record_recv(c->session, got, sizeof got)) == GNUTLS_E_AGAIN);
    assert_int_equal(size, sizeof text);
}

/* Waits until the daemon ends the connection; ignores what it sends. */
static void until_ended(const struct client *c) {
    char bytes[512];
    do
        wait_for(c->fd, POLLIN);
    while (recv(c->fd, bytes, sizeof bytes, 0) > 0);
}

/* Tests. */

static void paused_and_queued_handshakes_delay_no_open_connection(void **state) {
    struct acceptor *a = *state;
    enum { MANY = 20 };
    struct client open, more[MANY];
    send_client_hello(a, &open);
    finish_handshake(&open);
    wait_until(&pause_point.count, 1);
    exchange(&open, pause_point.given[0]);
    pause_handshakes(true);
    for (int i = 0; i < MANY; i++)
        send_client_hello(a, &more[i]);
    wait_until(&pause_point.waiting, 1);
    for (int i = 0; i < 100; i++)
        exchange(&open, pause_point.given[0]);
    /* The end of an open connection arrives as well. */
    hang_up(&open);
    wait_for(pause_point.given[0], POLLIN);
    char byte;
    assert_int_equal(recv(pause_point.given[0], &byte, 1, 0), 0);
    assert_int_equal(pause_point.count, 1);
    pause_handshakes(false);
    for (int i = 0; i < MANY; i++)
        finish_handshake(&more[i]);
    wait_until(&pause_point.count, 1 + MANY);
    for (int i = 0; i < MANY; i++)
        hang_up(&more[i]);
}

static void closing_ends_handshakes_and_leaves_open_connections(void **state) {
    struct acceptor *a = *state;
    struct client open, half;
    send_client_hello(a, &open);
    finish_handshake(&open);
    wait_until(&pause_point.count, 1);
    send_client_hello(a, &half);
    wait_for(half.fd, POLLIN); /* the connection was accepted and answered */
    srv_tls_close(a->tls);
    until_ended(&half);
    exchange(&open, pause_point.given[0]);
    assert_int_equal(pause_point.count, 1);
    hang_up(&half);
    hang_up(&open);
}

static int count_retry(gnutls_session_t session, unsigned type, unsigned when, unsigned incoming,
                       const gnutls_datum_t *message) {
    (void)type, (void)when, (void)incoming, (void)message;
    ++*(unsigned *)gnutls_session_get_ptr(session);
    return 0;
}

/* A ClientHello as browsers send it: several groups, and a key share for the first group. */
static void a_key_share_of_x25519_needs_no_retry(void **state) {
    struct acceptor *a = *state;
    static const char *const groups[] = { "+GROUP-X25519:+GROUP-SECP256R1:+GROUP-SECP384R1",
                                          "+GROUP-SECP384R1", "+GROUP-SECP256R1" };
    for (size_t i = 0; i < sizeof groups / sizeof *groups; i++) {
        struct client c = { .fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0) };
        unsigned retries = 0;
        char priorities[128];
        snprintf(priorities, sizeof priorities, "NORMAL:-GROUP-ALL:%s", groups[i]);
        call(a, &c);
        assert_int_equal(
            gnutls_init(&c.session, GNUTLS_CLIENT | GNUTLS_NO_SIGNAL | GNUTLS_KEY_SHARE_TOP), 0);
        assert_int_equal(gnutls_priority_set_direct(c.session, priorities, NULL), 0);
        assert_int_equal(gnutls_credentials_set(c.session, GNUTLS_CRD_CERTIFICATE, a->trust), 0);
        gnutls_session_set_ptr(c.session, &retries);
        gnutls_handshake_set_hook_function(c.session, GNUTLS_HANDSHAKE_HELLO_RETRY_REQUEST,
                                           GNUTLS_HOOK_POST, count_retry);
        gnutls_transport_set_int(c.session, c.fd);
        gnutls_handshake_set_timeout(c.session, LIMIT_MS);
        assert_int_equal(__real_gnutls_handshake(c.session), 0);
        assert_int_equal(gnutls_protocol_get_version(c.session), GNUTLS_TLS1_3);
        assert_int_equal(retries, 0);
        hang_up(&c);
    }
}

static void without_descriptors_a_client_is_refused_at_once(void **state) {
    struct acceptor *a = *state;
    struct rlimit limit, none;
    struct client first, refused, later;
    send_client_hello(a, &first);
    finish_handshake(&first);
    wait_until(&pause_point.count, 1);
    refused = (struct client){ .fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0) };
    int lowest = dup(refused.fd); /* the descriptor that would be next */
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &limit), 0);
    none = limit;
    none.rlim_cur = (rlim_t)lowest;
    close(lowest);
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &none), 0);
    call(a, &refused);
    until_ended(&refused);
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &limit), 0);
    assert_int_equal(
        metric_value(a->metrics, "splatd_connections_refused_total{reason=\"connections\"}"), 1);
    exchange(&first, pause_point.given[0]);
    send_client_hello(a, &later);
    finish_handshake(&later);
    wait_until(&pause_point.count, 2);
    hang_up(&refused);
    hang_up(&later);
    hang_up(&first);
}

int main(void) {
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&pause_point.changed, &monotonic);
    pthread_condattr_destroy(&monotonic);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(paused_and_queued_handshakes_delay_no_open_connection,
                                        begin, end),
        cmocka_unit_test_setup_teardown(closing_ends_handshakes_and_leaves_open_connections, begin,
                                        end),
        cmocka_unit_test_setup_teardown(a_key_share_of_x25519_needs_no_retry, begin, end),
        cmocka_unit_test_setup_teardown(without_descriptors_a_client_is_refused_at_once, begin,
                                        end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
