/* SPDX-License-Identifier: Apache-2.0 */
#include <sqlite3.h>
#include <stddef.h>

#include "support/fake_memory.h"

static sqlite3_mem_methods real_memory;

static void *fake_malloc(int size) {
    return memory_is_available() ? real_memory.xMalloc(size) : NULL;
}

static void *fake_realloc(void *old, int size) {
    return memory_is_available() ? real_memory.xRealloc(old, size) : NULL;
}

void memory_fake_sqlite(void) {
    sqlite3_config(SQLITE_CONFIG_GETMALLOC, &real_memory);
    sqlite3_mem_methods faked = real_memory;
    faked.xMalloc = fake_malloc;
    faked.xRealloc = fake_realloc;
    sqlite3_config(SQLITE_CONFIG_MALLOC, &faked);
}
