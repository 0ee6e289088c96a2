/* SPDX-License-Identifier: Apache-2.0
 *
 * Arrays that grow item by item.
 */
#ifndef SP_BASE_GROW_H
#define SP_BASE_GROW_H

#include <stdbool.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

/* Makes space for one more item in an array of `count` items of `size` bytes. `array` is the
 * address of the pointer to the first item; the pointer is NULL while the array is empty. The
 * capacity is always the smallest power of two that holds the count. The caller frees the items
 * with free(). Returns false and leaves the array unchanged if memory runs out. */
static inline bool sp_grow(void *array, size_t count, size_t size) {
    void *items;
    if (count & (count - 1))
        return true;
    memcpy(&items, array, sizeof items);
    items = realloc(items, (count ? 2 * count : 1) * size);
    if (items)
        memcpy(array, &items, sizeof items);
    return items != NULL;
}

#endif
