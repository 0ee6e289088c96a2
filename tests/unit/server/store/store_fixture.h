/* SPDX-License-Identifier: Apache-2.0
 *
 * A folder for a store, and the disk below it, which fails on demand (bad_disk.h).
 */
#ifndef TESTS_UNIT_SERVER_STORE_STORE_FIXTURE_H
#define TESTS_UNIT_SERVER_STORE_STORE_FIXTURE_H

#include "store/store.h"
#include "unit/server/store/bad_disk.h"

extern struct bad_disk *store_disk; /* valid after store_main_set_up() */

/* Call once in main(), before SQLite is used. */
int store_main_set_up(void);

/* For cmocka; *state is the path of an empty folder. */
int store_set_up(void **state);
int store_tear_down(void **state);

/* Options that write and retry at once. */
struct srv_store_options store_options(const char *folder);
struct srv_store *store_create(const char *folder);
struct srv_store *store_started(const char *folder); /* with its writer */

/* Returns whether all records are durable. */
bool store_flush(struct srv_store *store);
bool store_put(struct srv_store *store, enum srv_kind kind, const char *id, const char *text);
/* Asserts that the record has this text, or does not exist (NULL). */
void store_holds(struct srv_store *store, enum srv_kind kind, const char *id, const char *text);
/* Asserts that a store cannot be created there, with this error. */
void store_is_refused(const char *folder, enum sp_code code, const char *text);

void store_database_path(const char *folder, char path[128]);
/* Runs a statement on the database of the folder, without the store. */
void store_sql(const char *folder, const char *sql);

#endif
