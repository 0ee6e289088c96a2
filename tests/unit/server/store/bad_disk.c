/* SPDX-License-Identifier: Apache-2.0 */
#include "unit/server/store/bad_disk.h"

#include <sqlite3.h>
#include <stdlib.h>
#include <unistd.h>

struct file {
    sqlite3_file base;
    sqlite3_file *real;
};

static struct bad_disk disk = { .left = -1 };
static sqlite3_io_methods methods;
static sqlite3_vfs vfs, *system_vfs;

static sqlite3_file *real(sqlite3_file *file) {
    return ((struct file *)file)->real;
}

/* Returns what the next operation does; `broken` is its error on a broken disk. */
static int spend(int broken) {
    atomic_fetch_add(&disk.done, 1);
    long left = atomic_load(&disk.left);
    if (left < 0)
        return SQLITE_OK;
    if (left > 0) {
        atomic_store(&disk.left, left - 1);
        return SQLITE_OK;
    }
    if (disk.end == BAD_DISK_EXIT)
        _exit(9);
    return disk.end == BAD_DISK_FULL ? SQLITE_FULL : broken;
}

static int on_close(sqlite3_file *f) {
    int code = real(f)->pMethods ? real(f)->pMethods->xClose(real(f)) : SQLITE_OK;
    free(real(f));
    return code;
}

static int on_read(sqlite3_file *f, void *bytes, int size, sqlite3_int64 at) {
    return real(f)->pMethods->xRead(real(f), bytes, size, at);
}

static int on_write(sqlite3_file *f, const void *bytes, int size, sqlite3_int64 at) {
    int code = spend(SQLITE_IOERR_WRITE);
    return code ? code : real(f)->pMethods->xWrite(real(f), bytes, size, at);
}

static int on_truncate(sqlite3_file *f, sqlite3_int64 size) {
    int code = spend(SQLITE_IOERR_TRUNCATE);
    return code ? code : real(f)->pMethods->xTruncate(real(f), size);
}

static int on_sync(sqlite3_file *f, int flags) {
    int code = spend(SQLITE_IOERR_FSYNC);
    return code ? code : real(f)->pMethods->xSync(real(f), flags);
}

static int on_size(sqlite3_file *f, sqlite3_int64 *size) {
    return real(f)->pMethods->xFileSize(real(f), size);
}

static int on_lock(sqlite3_file *f, int kind) {
    return real(f)->pMethods->xLock(real(f), kind);
}

static int on_unlock(sqlite3_file *f, int kind) {
    return real(f)->pMethods->xUnlock(real(f), kind);
}

static int on_reserved(sqlite3_file *f, int *out) {
    return real(f)->pMethods->xCheckReservedLock(real(f), out);
}

static int on_control(sqlite3_file *f, int what, void *argument) {
    return real(f)->pMethods->xFileControl(real(f), what, argument);
}

static int on_sector(sqlite3_file *f) {
    return real(f)->pMethods->xSectorSize(real(f));
}

static int on_character(sqlite3_file *f) {
    return real(f)->pMethods->xDeviceCharacteristics(real(f));
}

static int on_map(sqlite3_file *f, int page, int size, int extend, void volatile **out) {
    return real(f)->pMethods->xShmMap(real(f), page, size, extend, out);
}

static int on_shm_lock(sqlite3_file *f, int offset, int count, int flags) {
    return real(f)->pMethods->xShmLock(real(f), offset, count, flags);
}

static void on_barrier(sqlite3_file *f) {
    real(f)->pMethods->xShmBarrier(real(f));
}

static int on_unmap(sqlite3_file *f, int remove) {
    return real(f)->pMethods->xShmUnmap(real(f), remove);
}

static int on_open(sqlite3_vfs *self, const char *name, sqlite3_file *f, int flags, int *out) {
    (void)self;
    struct file *file = (struct file *)f;
    file->base.pMethods = NULL;
    file->real = calloc(1, (size_t)system_vfs->szOsFile);
    if (!file->real)
        return SQLITE_NOMEM;
    int code = system_vfs->xOpen(system_vfs, name, file->real, flags, out);
    methods.iVersion = disk.has_no_shared_memory ? 1 : 2;
    if (code == SQLITE_OK)
        file->base.pMethods = &methods;
    else
        free(file->real);
    return code;
}

struct bad_disk *bad_disk_register(void) {
    system_vfs = sqlite3_vfs_find(NULL);
    methods = (sqlite3_io_methods){ 2,          on_close,  on_read,      on_write,  on_truncate,
                                    on_sync,    on_size,   on_lock,      on_unlock, on_reserved,
                                    on_control, on_sector, on_character, on_map,    on_shm_lock,
                                    on_barrier, on_unmap,  NULL,         NULL };
    vfs = *system_vfs;
    vfs.zName = "bad-disk";
    vfs.szOsFile = (int)sizeof(struct file);
    vfs.xOpen = on_open;
    vfs.pNext = NULL;
    sqlite3_vfs_register(&vfs, 0);
    return &disk;
}
