/* SPDX-License-Identifier: Apache-2.0 */
#include <sqlite3.h>
#include <stddef.h>

#include "support/fake_memory.h"

static sqlite3_mem_methods real_memory;

static void *play_malloc(int size) {
    return memory_is_left() ? real_memory.xMalloc(size) : NULL;
}

static void *play_realloc(void *old, int size) {
    return memory_is_left() ? real_memory.xRealloc(old, size) : NULL;
}

void memory_play_sqlite(void) {
    sqlite3_config(SQLITE_CONFIG_GETMALLOC, &real_memory);
    sqlite3_mem_methods played = real_memory;
    played.xMalloc = play_malloc;
    played.xRealloc = play_realloc;
    sqlite3_config(SQLITE_CONFIG_MALLOC, &played);
}
