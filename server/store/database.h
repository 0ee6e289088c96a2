/* SPDX-License-Identifier: Apache-2.0
 *
 * The database of a store: one file in a folder that one daemon at a time uses. One thread at a
 * time.
 *
 *   record(kind, id, body)   kind: "volume", "session", "view", "preset", "path",
 *                                  "clock"
 *                            rows in order of adding
 *
 * PRAGMA application_id says that it is ours, PRAGMA user_version how it is laid out. An older
 * layout is brought up to date when it is opened, a newer one is left alone.
 */
#ifndef SRV_STORE_DATABASE_H
#define SRV_STORE_DATABASE_H

#include "store/table.h"

struct srv_database;

#define SRV_DATABASE_NAME "splatd.db"
#define SRV_DATABASE_LOCK "splatd.lock"

/* See srv_store_create(). */
struct srv_database *srv_database_open(const char *folder, const char *vfs, struct sp_error *err);
void srv_database_close(struct srv_database **database);

/* Puts every row into the table. */
bool srv_database_read(struct srv_database *database, struct srv_table *table,
                       struct sp_error *err);
/* All of them or, on failure, none. */
bool srv_database_write(struct srv_database *database, const struct srv_change *changes,
                        struct sp_error *err);

#endif
