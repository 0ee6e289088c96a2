/* SPDX-License-Identifier: Apache-2.0
 *
 * The files of an open database, by their names: whether they are still the files that were opened.
 * SQLite itself goes on to write into a file that was deleted or replaced. Functions are for one
 * thread at a time, and none opens the database: closing it again would drop SQLite's locks.
 */
#ifndef SRV_STORE_DATABASE_FILES_H
#define SRV_STORE_DATABASE_FILES_H

#include <limits.h>
#include <stdbool.h>
#include <sys/types.h>
#include <time.h>

#include "sp/status.h"

#define SRV_DATABASE_NAME "splatd.db"
#define SRV_DATABASE_LOCK "splatd.lock"
#define SRV_DATABASE_FOREIGN "was written by another program"

struct srv_file_mark { /* ino 0 = there is no such file */
    dev_t dev;
    ino_t ino;
    off_t size;
    struct timespec modified;
};

struct srv_database_files {
    char folder[PATH_MAX], path[PATH_MAX]; /* of the database */
    int lock;                              /* held while the daemon uses the folder; −1 = none */
    bool
        was_used; /* a daemon had a database here before: its lock says so, or files that it left */
    struct srv_file_mark root, main, log; /* as they were opened or written last */
};

/* Locks the folder, which exists, for this daemon. The lock ends with the process, however that
 * ends. False: SP_ERR_IO, SP_ERR_INVALID. */
bool srv_database_files_open(struct srv_database_files *files, const char *folder,
                             struct sp_error *err);
void srv_database_files_close(struct srv_database_files *files);
/* Writes into the lock file that the folder has a database. If that fails, only was_used is less
 * reliable at the next start. */
void srv_database_files_set_used(const struct srv_database_files *files);
/* Records the present state of the files. Call it after each own write. */
void srv_database_files_note(struct srv_database_files *files);
/* Records only the state of the log, which a failed own write may have changed. */
void srv_database_files_note_log(struct srv_database_files *files);
/* Compares the files with their recorded state. Returns the problem, a constant string; NULL = they
 * are the same files. `written` true: the noted sizes and times are older than an own write.
 * Otherwise they show other writes, except one in place that keeps the size within a tick of the
 * clock of the file system after an own write. */
const char *srv_database_files_changed(const struct srv_database_files *files, bool written);
/* True while the folder has its old place and the lock is held; takes the lock again if its file
 * was deleted. False: SP_ERR_IO with the remedy. */
bool srv_database_files_hold(struct srv_database_files *files, struct sp_error *err);
/* Puts the database `fresh`, a complete file in the same folder, in the place of what is there, and
 * syncs the folder. Another file that is found there is kept: *kept gets its new name; "" = none.
 * False: SP_ERR_IO. */
bool srv_database_files_replace(struct srv_database_files *files, const char *fresh,
                                char kept[PATH_MAX], struct sp_error *err);
/* Syncs a folder, so that new files in it survive a crash of the machine. */
bool srv_database_files_sync(const char *folder, struct sp_error *err);

#endif
