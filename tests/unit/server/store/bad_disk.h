/* SPDX-License-Identifier: Apache-2.0
 *
 * A disk for SQLite that misbehaves on demand: the system's, with a counter of writes (and of
 * syncs and truncations) that may still succeed.
 */
#ifndef TESTS_BAD_DISK_H
#define TESTS_BAD_DISK_H

#include <stdatomic.h>
#include <stdbool.h>

enum bad_disk_end { BAD_DISK_FULL, BAD_DISK_BROKEN, BAD_DISK_DEATH };

struct bad_disk {
    atomic_long left;          /* operations that still succeed; < 0 = all */
    atomic_long done;          /* operations so far */
    bool has_no_shared_memory; /* as on a network: no write-ahead log */
    enum bad_disk_end end; /* what the one after them does: SQLITE_FULL, SQLITE_IOERR, _exit(9) */
};

/* Registers it as SQLite's VFS "bad-disk"; call once. */
struct bad_disk *bad_disk_register(void);

#endif
