/* SPDX-License-Identifier: Apache-2.0 */
#include "common/pagination.h"

#include <string.h>

void *srv_page_slot(struct srv_page *page, const char *id) {
    char *items = page->items;
    size_t bytes = page->item_bytes;
    if (strcmp(id, page->after) <= 0)
        return NULL;
    unsigned at = 0, end = page->count;
    while (at < end) {
        unsigned middle = (at + end) / 2;
        if (strcmp(items + middle * bytes, id) < 0)
            at = middle + 1;
        else
            end = middle;
    }
    if (at == page->max)
        return NULL;
    if (page->count < page->max)
        page->count++; /* else the last item drops out */
    memmove(items + (at + 1) * bytes, items + at * bytes, (page->count - 1 - at) * bytes);
    return items + at * bytes;
}
