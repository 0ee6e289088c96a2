/* SPDX-License-Identifier: Apache-2.0
 *
 * A disk for SQLite that fails on demand: the disk of the system, with a limit on the writes, syncs
 * and truncations that still succeed.
 */
#ifndef TESTS_UNIT_SERVER_STORE_BAD_DISK_H
#define TESTS_UNIT_SERVER_STORE_BAD_DISK_H

#include <stdatomic.h>
#include <stdbool.h>

enum bad_disk_failure { BAD_DISK_FULL, BAD_DISK_IO_ERROR, BAD_DISK_EXIT };

struct bad_disk {
    atomic_long left;          /* operations that still succeed; < 0 = all */
    atomic_long done;          /* operations so far */
    bool has_no_shared_memory; /* as on a network file system: no write-ahead log */
    enum bad_disk_failure end; /* of the next operation: SQLITE_FULL, SQLITE_IOERR or _exit(9) */
};

/* Registers the disk as SQLite's VFS "bad-disk"; call once. */
struct bad_disk *bad_disk_register(void);

#endif
