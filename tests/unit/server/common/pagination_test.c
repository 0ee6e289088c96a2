/* SPDX-License-Identifier: Apache-2.0
 *
 * Pages of a list that changes between requests.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#include "common/pagination.h"

enum { IDS = 500, BYTES = 8 };

static unsigned show(struct srv_page *page, const char *removed) {
    unsigned at = 7;
    for (int i = 0; i < IDS; i++) { /* every number once, in a scattered order */
        char id[BYTES];
        at = (at + 211) % IDS;
        snprintf(id, sizeof id, "%03u", at);
        char *slot = strcmp(id, removed) == 0 ? NULL : srv_page_slot(page, id);
        if (slot)
            strcpy(slot, id);
    }
    return page->count;
}

/* Pages of any length hold each id once and in order, also when the last item of a page is removed
 * before the next page is requested. */
static void pages_hold_every_id_once(void **state) {
    (void)state;
    static char items[IDS + 1][BYTES];
    for (unsigned max = 1; max <= IDS + 1; max += max < 9 ? 1 : 97) {
        bool is_last_removed = max % 2;
        char after[BYTES] = "", expected[BYTES];
        unsigned seen = 0;
        for (;;) {
            struct srv_page page = {
                .items = items, .item_bytes = BYTES, .max = max, .after = after
            };
            if (show(&page, is_last_removed ? after : "none") == 0)
                break;
            assert_in_range(page.count, 1, max);
            for (unsigned i = 0; i < page.count; i++) {
                snprintf(expected, sizeof expected, "%03u", seen++);
                assert_string_equal(items[i], expected);
            }
            strcpy(after, items[page.count - 1]);
        }
        assert_int_equal(seen, IDS);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(pages_hold_every_id_once) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
