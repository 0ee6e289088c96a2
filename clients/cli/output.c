/* SPDX-License-Identifier: Apache-2.0 */
#include "cli/output.h"

#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static bool write_all(int fd, const char *bytes, size_t size) {
    while (size > 0) {
        ssize_t n = write(fd, bytes, size);
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0)
            return false;
        bytes += n;
        size -= (size_t)n;
    }
    return true;
}

static bool fail_io(struct sp_error *err, const char *path, const char *what) {
    return sp_fail(err, SP_ERR_IO, path, "%s: %s", what, strerror(errno));
}

/* Makes the names in a folder survive a crash of the machine. Some file systems do not support it.
 */
static bool sync_parent(const char *path) {
    char *copy = strdup(path);
    int fd = copy ? open(dirname(copy), O_RDONLY | O_DIRECTORY | O_CLOEXEC) : -1;
    bool ok = fd >= 0 && (fsync(fd) == 0 || errno == EINVAL);
    int why = errno;
    if (fd >= 0)
        close(fd);
    free(copy);
    errno = why;
    return ok;
}

static void hold_signals(struct output *o) {
    sigset_t held;
    sigemptyset(&held);
    sigaddset(&held, SIGINT);
    sigaddset(&held, SIGTERM);
    sigaddset(&held, SIGHUP);
    sigprocmask(SIG_BLOCK, &held, &o->signals);
}

/* Initializes a closed output. */
static void release(struct output *o) {
    bool is_new = o->temporary != NULL;
    free(o->target);
    free(o->temporary);
    o->path = o->target = o->temporary = NULL;
    if (is_new)
        sigprocmask(SIG_SETMASK, &o->signals, NULL); /* a pending signal may end the program here */
}

void output_drop(struct output *o) {
    if (!o->path)
        return;
    if (o->fd >= 0 && o->fd != STDOUT_FILENO)
        close(o->fd);
    if (o->temporary)
        unlink(o->temporary);
    release(o);
}

static bool fail_output(struct output *o, const char *what, struct sp_error *err) {
    fail_io(err, o->path, what);
    output_drop(o);
    return false;
}

static bool open_temporary(struct output *o, struct sp_error *err) {
    if (!o->target || asprintf(&o->temporary, "%s.XXXXXX", o->target) < 0) {
        o->temporary = NULL;
        return fail_output(o, "cannot create", err);
    }
    hold_signals(o);
    o->fd = mkstemp(o->temporary);
    if (o->fd < 0) {
        o->temporary[0] = 0; /* no temporary file exists */
        return fail_output(o, "cannot create", err);
    }
    mode_t mask = umask(0); /* safe: only one thread creates files */
    umask(mask);
    fchmod(o->fd, 0666 & ~mask);
    return true;
}

bool output_open(struct output *o, const char *path, struct sp_error *err) {
    struct stat status;
    *o = (struct output){ .path = path, .fd = -1 };
    if (strcmp(path, "-") == 0) {
        o->path = "standard output";
        o->fd = STDOUT_FILENO;
        return true;
    }
    bool is_there = stat(path, &status) == 0;
    if (is_there && S_ISDIR(status.st_mode)) {
        o->path = NULL;
        return sp_fail(err, SP_ERR_IO, path, "is a folder; name a file in it");
    }
    if (!is_there || S_ISREG(status.st_mode)) {
        o->target = is_there ? realpath(path, NULL) : strdup(path); /* a link stays a link */
        return open_temporary(o, err);
    }
    o->fd = open(path, O_WRONLY | O_CLOEXEC);
    return o->fd >= 0 || fail_output(o, "cannot open", err);
}

bool output_add(struct output *o, const void *bytes, size_t size, struct sp_error *err) {
    return write_all(o->fd, bytes, size) || fail_output(o, "cannot write", err);
}

bool output_restart(struct output *o) {
    return !o->path || (o->temporary && lseek(o->fd, 0, SEEK_SET) == 0 && ftruncate(o->fd, 0) == 0);
}

bool output_close(struct output *o, struct sp_error *err) {
    if (o->temporary && fsync(o->fd) != 0)
        return fail_output(o, "cannot write", err);
    int fd = o->fd;
    o->fd = -1;
    if (fd != STDOUT_FILENO && close(fd) != 0)
        return fail_output(o, "cannot write", err);
    if (o->temporary && rename(o->temporary, o->target) != 0)
        return fail_output(o, "cannot rename to it", err);
    bool ok = !o->temporary || sync_parent(o->target) || fail_io(err, o->path, "cannot write");
    release(o);
    return ok;
}

bool output_write(const char *path, const void *bytes, size_t size, struct sp_error *err) {
    struct output output;
    return output_open(&output, path, err) && output_add(&output, bytes, size, err) &&
           output_close(&output, err);
}

bool output_make_folder(const char *path, bool *is_new, struct sp_error *err) {
    struct stat status;
    *is_new = mkdir(path, 0777) == 0;
    if (*is_new)
        return sync_parent(path) || fail_io(err, path, "cannot write");
    int why = errno;
    if (why == EEXIST && stat(path, &status) == 0 && S_ISDIR(status.st_mode))
        return true;
    errno = why;
    return fail_io(err, path, "cannot create this folder");
}

bool output_check(const char *path, bool is_folder, struct sp_error *err) {
    struct stat status;
    if (!is_folder && strcmp(path, "-") == 0)
        return true;
    if (stat(path, &status) == 0) {
        errno = EEXIST;
        if (is_folder)
            return S_ISDIR(status.st_mode) || fail_io(err, path, "cannot create this folder");
        return !S_ISDIR(status.st_mode) ||
               sp_fail(err, SP_ERR_IO, path, "is a folder; name a file in it");
    }
    char *copy = strdup(path);
    bool ok = copy && access(dirname(copy), W_OK | X_OK) == 0;
    free(copy);
    return ok || fail_io(err, path, is_folder ? "cannot create this folder" : "cannot create");
}

char *input_read(const char *path, size_t limit, size_t *size, struct sp_error *err) {
    bool standard = strcmp(path, "-") == 0;
    FILE *file = standard ? stdin : fopen(path, "rb");
    if (standard)
        path = "standard input";
    if (!file) {
        fail_io(err, path, "cannot open");
        return NULL;
    }
    char *bytes = malloc(limit + 2);
    *size = bytes ? fread(bytes, 1, limit + 1, file) : 0;
    bool failed = ferror(file);
    if (failed)
        fail_io(err, path, "cannot read");
    else if (!bytes)
        sp_fail(err, SP_ERR_MEMORY, path, "out of memory");
    else if (*size > limit)
        failed = !sp_fail(err, SP_ERR_INVALID, path, "is larger than %zu bytes", limit);
    else
        bytes[*size] = 0;
    if (!standard)
        fclose(file);
    if (failed) {
        free(bytes);
        return NULL;
    }
    return bytes;
}
