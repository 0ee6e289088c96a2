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

/* Allocates memory for one more item of an array of `count` items of `size` bytes. `array` is the
 * address of the pointer to it, which is NULL at first; free() frees it. Its capacity is always the
 * power of two at or above the count. False, and the array stays, if memory ran out. */
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
