/* SPDX-License-Identifier: Apache-2.0
 *
 * Addresses of remote volumes, and the hosts that a list allows.
 */
#include "data/import/address.h"

#include <string.h>

#include "unit/data/import/support.h"

static void only_simple_addresses_are_accepted(void **state) {
    (void)state;
    static const char *const bad[] = {
        "ftp://h/x",     "http://",           "http:///x",      "http://u@h/x",  "http://h:/x",
        "http://h:0/x",  "http://h:65536/x",  "http://h:80a/x", "http://[::1]/", "http://h/a?b",
        "http://h/a#b",  "http://h/a/../b",   "http://h/a b",   "http://h\\x/",  "http://h%41/",
        "http://h/\x01", "http://h:123456/x",
    };
    struct sp_address parts;
    struct sp_error err;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        if (sp_address_parse(bad[i], &parts, &err))
            fail_msg("%s is accepted", bad[i]);
        assert_int_equal(err.code, SP_ERR_INVALID);
    }
    assert_true(sp_address_parse("https://data.example.org/a/b.zarr", &parts, &err));
    assert_string_equal(parts.host, "data.example.org");
    assert_int_equal(parts.port, 443);
    assert_true(parts.is_secure);
    assert_true(sp_address_parse("http://127.0.0.1:8080", &parts, &err));
    assert_int_equal(parts.port, 8080);
    assert_false(parts.is_secure);
    char longest[SP_ADDRESS_BYTES + 8] = "http://h/";
    memset(longest + 9, 'x', sizeof longest - 10);
    assert_false(sp_address_parse(longest, &parts, &err));
}

static void a_list_allows_names_ports_and_patterns(void **state) {
    (void)state;
    static const char list[] = "data.example.org,127.0.0.1:8080,*.open.org,other:81";
    static const struct {
        const char *address;
        enum sp_allowed allowed;
    } cases[] = {
        { "https://data.example.org/x", SP_ALLOWED_ANY },
        { "http://DATA.example.org/x", SP_ALLOWED_ANY },
        { "http://data.example.org:8080/x", SP_NOT_ALLOWED },
        { "http://example.org/x", SP_NOT_ALLOWED },
        { "http://data.example.org.evil.com/x", SP_NOT_ALLOWED },
        { "http://xdata.example.org/x", SP_NOT_ALLOWED },
        { "http://127.0.0.1:8080/x", SP_ALLOWED_ANY },
        { "http://127.0.0.1/x", SP_NOT_ALLOWED },
        { "https://a.open.org/x", SP_ALLOWED_PUBLIC },
        { "https://a.b.open.org/x", SP_ALLOWED_PUBLIC },
        { "https://open.org/x", SP_NOT_ALLOWED },
        { "https://evilopen.org/x", SP_NOT_ALLOWED },
        { "http://other/x", SP_NOT_ALLOWED },
        { "http://other:81/x", SP_ALLOWED_ANY },
    };
    struct sp_address parts;
    struct sp_error err;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        assert_true(sp_address_parse(cases[i].address, &parts, &err));
        if (sp_address_allowed(&parts, list) != cases[i].allowed)
            fail_msg("%s: %d", cases[i].address, sp_address_allowed(&parts, list));
        assert_int_equal(sp_address_allowed(&parts, NULL), SP_NOT_ALLOWED);
    }
    assert_true(sp_address_check_list(list, "list", &err));
    for (const char *const *bad =
             (const char *const[]){ "http://x", "*", "*.", "a b", "h:", "h:x", ",", NULL };
         *bad; bad++)
        if (sp_address_check_list(*bad, "list", &err))
            fail_msg("'%s' is accepted", *bad);
}

static void private_networks_are_known(void **state) {
    (void)state;
    static const struct {
        uint8_t bytes[16];
        unsigned size;
        bool is_private;
    } cases[] = {
        { { 127, 0, 0, 1 }, 4, true },
        { { 10, 1, 2, 3 }, 4, true },
        { { 172, 31, 0, 1 }, 4, true },
        { { 172, 32, 0, 1 }, 4, false },
        { { 192, 168, 9, 9 }, 4, true },
        { { 169, 254, 169, 254 }, 4, true },
        { { 100, 64, 0, 1 }, 4, true },
        { { 8, 8, 8, 8 }, 4, false },
        { { 224, 0, 0, 1 }, 4, true },
        { { 0 }, 16, true },
        { { [15] = 1 }, 16, true },
        { { 0xfe, 0x80 }, 16, true },
        { { 0xfc }, 16, true },
        { { 0x26, 0x06, 0x47 }, 16, false },
        { { [10] = 0xff, 0xff, 10, 0, 0, 1 }, 16, true },
        { { [10] = 0xff, 0xff, 8, 8, 8, 8 }, 16, false },
        { { 0x20, 0x02, 10 }, 16, true },
        { { 0 }, 0, true },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        if (sp_address_is_private(cases[i].bytes, cases[i].size) != cases[i].is_private)
            fail_msg("case %zu", i);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(only_simple_addresses_are_accepted),
        cmocka_unit_test(a_list_allows_names_ports_and_patterns),
        cmocka_unit_test(private_networks_are_known),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
