/* SPDX-License-Identifier: Apache-2.0
 *
 * The records of a store in memory, and which of them changed since they were written. Not
 * thread-safe.
 *
 * Why not a library: a hash table is a few lines here, and each record is also a member of two
 * lists, one in the order of adding and one of the changed records.
 */
#ifndef SRV_STORE_TABLE_H
#define SRV_STORE_TABLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "store/kind.h"

struct srv_table;
struct srv_table *srv_table_create(void); /* NULL when out of memory */
void srv_table_destroy(struct srv_table **table);

/* Stores a copy. is_changed = the database does not have it yet. False: out of memory, nothing has
 * changed. */
bool srv_table_put(struct srv_table *table, enum srv_kind kind, const char *id, const char *text,
                   size_t size, bool is_changed);
/* Removes a record; is_changed = the database still has it. False: there is no such record. */
bool srv_table_remove(struct srv_table *table, enum srv_kind kind, const char *id, bool is_changed);
/* Returns the text, valid until the next change; NULL = no such record. */
const char *srv_table_get(const struct srv_table *table, enum srv_kind kind, const char *id,
                          size_t *size);
/* Marks a record as damaged, until it is put again; `why` is copied. False: there is no such
 * record, or no memory. */
bool srv_table_damage(struct srv_table *table, enum srv_kind kind, const char *id, const char *why);
/* Returns why a record is damaged; NULL = it is not damaged, or there is no such record. */
const char *srv_table_damaged(const struct srv_table *table, enum srv_kind kind, const char *id);
/* Iterates over the ids of a kind in the order in which they were first put. Start with *at = NULL;
 * NULL = the end. */
const char *srv_table_next(const struct srv_table *table, enum srv_kind kind, const void **at,
                           const char **text, size_t *size);
unsigned srv_table_count(const struct srv_table *table, enum srv_kind kind);
uint64_t srv_table_bytes(const struct srv_table *table);

/* A copy of one change, for the database. */
struct srv_change {
    struct srv_change *next;
    uint64_t stamp;
    enum srv_kind kind;
    const char *id;
    const char *text; /* NULL = removed */
    size_t size;
};
unsigned srv_table_changes(const struct srv_table *table); /* their number */
/* Copies all changes, oldest first. False: out of memory, and *changes is NULL. */
bool srv_table_copy_changes(const struct srv_table *table, struct srv_change **changes);
/* Marks all records as changed, in the order of adding, for a database that has none of them. */
void srv_table_change_all(struct srv_table *table);
/* Marks the changes as written, except for records that changed again since the copy. */
void srv_table_written(struct srv_table *table, const struct srv_change *changes);
void srv_changes_free(struct srv_change **changes);

#endif
