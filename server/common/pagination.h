/* SPDX-License-Identifier: Apache-2.0
 *
 * One page of a list that is sorted by id. The caller shows all items, in any order; the page keeps
 * the first `max` of those whose ids come after `after`. So a client that continues after the last
 * id of its page misses nothing and sees nothing twice, even if items come and go in between.
 */
#ifndef SRV_COMMON_PAGINATION_H
#define SRV_COMMON_PAGINATION_H

#include <stddef.h>

struct srv_page {
    void *items;       /* the caller's array of `max` items; each begins with its id as text */
    size_t item_bytes; /* size of one item */
    unsigned max, count;
    const char *after; /* "" = from the first id */
};

/* Returns the place for the item with this id; the caller fills it at once. NULL = the item is not
 * on the page. */
void *srv_page_slot(struct srv_page *page, const char *id);

#endif
