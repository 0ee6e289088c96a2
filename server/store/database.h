/* SPDX-License-Identifier: Apache-2.0
 *
 * The database of a store: one SQLite file in a folder, used by one daemon at a time. Functions are
 * for one thread at a time.
 *
 *   record(kind, id, body)   kind: "volume", "session", "view", "preset", "path" or "clock";
 *                            rows are in the order of adding
 *
 * PRAGMA application_id marks the file as ours, and PRAGMA user_version is the version of the
 * schema. An older schema is upgraded when the file is opened; a newer one is refused and not
 * touched.
 */
#ifndef SRV_STORE_DATABASE_H
#define SRV_STORE_DATABASE_H

#include "sp/status.h"
#include "store/table.h"

struct srv_database;

#define SRV_DATABASE_NAME "splatd.db"
#define SRV_DATABASE_LOCK "splatd.lock"

/* Opens or creates the database; errors as in srv_store_create(). */
struct srv_database *srv_database_open(const char *folder, const char *vfs, struct sp_error *err);
void srv_database_close(struct srv_database **database);

/* Puts every row into the table. False: SP_ERR_IO, SP_ERR_FORMAT, SP_ERR_MEMORY. */
bool srv_database_read(struct srv_database *database, struct srv_table *table,
                       struct sp_error *err);
/* Writes all changes in one transaction: all of them or, on failure, none. */
bool srv_database_write(struct srv_database *database, const struct srv_change *changes,
                        struct sp_error *err);

#endif
