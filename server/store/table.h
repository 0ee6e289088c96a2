/* SPDX-License-Identifier: Apache-2.0
 *
 * The records of a store in memory, and which of them changed since they were written. Not
 * thread-safe.
 */
#ifndef SRV_STORE_TABLE_H
#define SRV_STORE_TABLE_H

#include "store/store.h"

struct srv_table;
struct srv_table *srv_table_create(void); /* NULL when out of memory */
void srv_table_destroy(struct srv_table **table);

/* `is_changed`: it is not in the database as it is here. False when out of memory: as before. */
bool srv_table_put(struct srv_table *table, enum srv_kind kind, const char *id, const char *text,
                   size_t size, bool is_changed);
/* Is remembered as a change if `is_changed`. False: it is not there. */
bool srv_table_remove(struct srv_table *table, enum srv_kind kind, const char *id, bool is_changed);
/* NULL = there is none; until the next change. */
const char *srv_table_get(const struct srv_table *table, enum srv_kind kind, const char *id,
                          size_t *size);
/* In the order in which they were put first: start with *at = NULL, stop at NULL. */
const char *srv_table_next(const struct srv_table *table, enum srv_kind kind, const void **at,
                           const char **text, size_t *size);
unsigned srv_table_count(const struct srv_table *table, enum srv_kind kind);
uint64_t srv_table_bytes(const struct srv_table *table);

/* One change on its way to the database: a copy of its own. */
struct srv_change {
    struct srv_change *next;
    uint64_t stamp;
    enum srv_kind kind;
    const char *id;
    const char *text; /* NULL = removed */
    size_t size;
};
unsigned srv_table_changes(const struct srv_table *table); /* how many */
/* All changes, oldest first; false when out of memory, and then *changes is NULL. */
bool srv_table_copy_changes(const struct srv_table *table, struct srv_change **changes);
/* They are written: what has not changed again since the copy no longer counts as changed. */
void srv_table_written(struct srv_table *table, const struct srv_change *changes);
void srv_changes_free(struct srv_change **changes);

#endif
