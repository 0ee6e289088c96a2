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

/* Opens or creates the database; errors as in srv_store_create(). */
struct srv_database *srv_database_open(const char *folder, const char *vfs, struct sp_error *err);
void srv_database_close(struct srv_database **database);

/* Puts every row into the table. False: SP_ERR_IO, SP_ERR_FORMAT, SP_ERR_MEMORY. */
bool srv_database_read(struct srv_database *database, struct srv_table *table,
                       struct sp_error *err);
/* True if the files are still the files that were opened, or written last: not deleted, replaced or
 * truncated, and not written by another program. If not, call srv_database_rewrite(). */
bool srv_database_is_intact(struct srv_database *database);
/* Writes all changes in one transaction: all of them or, on failure, none. SP_ERR_IO also if the
 * files were deleted or replaced meanwhile. */
bool srv_database_write(struct srv_database *database, const struct srv_change *changes,
                        struct sp_error *err);
/* Writes a new database with these records, all that there are, and puts it in the place of the old
 * one. Another file that is there is kept under a name that the log tells. */
bool srv_database_rewrite(struct srv_database *database, const struct srv_change *records,
                          struct sp_error *err);

#endif
