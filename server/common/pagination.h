/* SPDX-License-Identifier: Apache-2.0
 *
 * A page of a list in the order of its ids, so that one goes on where the last one ended whatever
 * came and went meanwhile: of all that is shown to it, the first `max` behind `after`.
 */
#ifndef SRV_COMMON_PAGINATION_H
#define SRV_COMMON_PAGINATION_H

#include <stddef.h>

struct srv_page {
    void *items;       /* the caller's: max items, each of which begins with its id, a text */
    size_t item_bytes; /* of one */
    unsigned max, count;
    const char *after; /* "" = from the first */
};

/* Room for the item of this id, in its place, which the caller fills at once; NULL: it is not on
 * the page. */
void *srv_page_slot(struct srv_page *page, const char *id);

#endif
