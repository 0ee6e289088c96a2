/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "http/address.h"

static void addresses(void **state) {
    (void)state;
    struct srv_address a, b;
    char text[SRV_ADDRESS_TEXT];
    static const struct {
        const char *text, *shown;
        bool loopback;
    } good[] = {
        { "127.0.0.1:8080", "127.0.0.1:8080", true },
        { "127.3.2.1:0", "127.3.2.1:0", true },
        { "localhost:1", "127.0.0.1:1", true },
        { "0.0.0.0:65535", "0.0.0.0:65535", false },
        { "10.1.2.3:80", "10.1.2.3:80", false },
        { "[::1]:80", "[::1]:80", true },
        { "[::]:80", "[::]:80", false },
        { "[::ffff:127.0.0.1]:80", "[::ffff:127.0.0.1]:80", true },
        { "[::ffff:10.0.0.1]:80", "[::ffff:10.0.0.1]:80", false },
    };
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        assert_true(srv_address_parse(good[i].text, &a, NULL));
        srv_address_to_text((const struct sockaddr *)&a.storage, text);
        assert_string_equal(text, good[i].shown);
        assert_int_equal(srv_address_is_loopback((struct sockaddr *)&a.storage), good[i].loopback);
    }
    static const char *const bad[] = { "",       "8080",      ":8080",      "127.0.0.1",
                                       "a.b:80", "::1:80",    "[::1]",      "127.0.0.1:65536",
                                       "[]:80",  "1.2.3.4:x", "1.2.3.4:-1", "1.2.3.4:80 " };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_false(srv_address_parse(bad[i], &a, NULL));
    static const struct {
        const char *a, *b;
        bool same;
    } pairs[] = {
        { "10.0.0.1:1", "10.0.0.1:2", true },
        { "10.0.0.1:1", "10.0.0.2:1", false },
        { "10.0.0.1:1", "[::1]:1", false },
        { "[2001:db8::1]:1", "[2001:db8::ffff:0:0:2]:1", true },
        { "[2001:db8::1]:1", "[2001:db8:0:1::1]:1", false },
        { "[::ffff:10.0.0.1]:1", "[::ffff:10.0.0.1]:2", true },
        { "[::ffff:10.0.0.1]:1", "[::ffff:10.0.0.2]:1", false },
        { "[::ffff:10.0.0.1]:1", "[::1]:1", false },
    };
    for (size_t i = 0; i < sizeof pairs / sizeof *pairs; i++) {
        assert_true(srv_address_parse(pairs[i].a, &a, NULL));
        assert_true(srv_address_parse(pairs[i].b, &b, NULL));
        bool same =
            srv_address_same_host((struct sockaddr *)&a.storage, (struct sockaddr *)&b.storage);
        if (same != pairs[i].same)
            fail_msg("%s and %s", pairs[i].a, pairs[i].b);
    }
}

static void listen_lists(void **state) {
    (void)state;
    static const struct {
        const char *text, *tcp, *path;
    } good[] = {
        { "127.0.0.1:80", "127.0.0.1:80", "" },
        { "unix:/run/s", "", "/run/s" },
        { "[::1]:80,unix:s", "[::1]:80", "s" },
        { "unix:@a:b,10.0.0.1:1", "10.0.0.1:1", "@a:b" },
    };
    struct srv_listen listen;
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        char text[SRV_ADDRESS_TEXT] = "";
        assert_true(srv_listen_parse(good[i].text, &listen, NULL));
        if (listen.has_tcp)
            srv_address_to_text((const struct sockaddr *)&listen.tcp.storage, text);
        assert_string_equal(text, good[i].tcp);
        assert_string_equal(listen.path, good[i].path);
    }
    static const char *const bad[] = {
        "",  "unix:",    "unix:a,unix:b",          "1.2.3.4:1,5.6.7.8:2",
        ",", "unix:a,b", "unix:a,1.2.3.4:1,unix:b"
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_false(srv_listen_parse(bad[i], &listen, NULL));
}

static void users(void **state) {
    (void)state;
    struct sockaddr_un one, same, other;
    const struct sockaddr *address = (struct sockaddr *)&one;
    char text[SRV_ADDRESS_TEXT], host[SRV_ADDRESS_HOST];
    assert_int_equal(srv_address_of_user(1000, &one), sizeof one);
    srv_address_of_user(1000, &same);
    srv_address_of_user(4294967294U, &other);
    assert_true(srv_address_same_host(address, (struct sockaddr *)&same));
    assert_false(srv_address_same_host(address, (struct sockaddr *)&other));
    assert_true(srv_address_is_loopback(address));
    assert_int_equal(srv_address_size(address), sizeof one);
    srv_address_to_text((struct sockaddr *)&other, text);
    assert_string_equal(text, "user 4294967294");
    srv_address_to_host((struct sockaddr *)&other, host);
    assert_string_equal(host, "@user 4294967294");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(addresses),
        cmocka_unit_test(listen_lists),
        cmocka_unit_test(users),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
