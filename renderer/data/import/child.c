/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/child.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/locate.h"

enum { POLL_MS = 50, FDS_MAX = 4 };

bool sp_import_find_program(const char *name, const char *given, char path[PATH_MAX],
                            struct sp_error *err) {
    struct sp_error why;
    if (given)
        snprintf(path, PATH_MAX, "%s", given);
    else if (!sp_locate(name, path, &why) && why.code == SP_ERR_IO)
        return sp_fail(err, SP_ERR_IO, why.place, "%s", why.text);
    if (access(path, X_OK) != 0)
        return sp_fail(err, SP_ERR_IO, path, "cannot run the importer: %s", strerror(errno));
    return true;
}

/* Moves a descriptor above the numbers that the child uses, so that placing one does not overwrite
 * another. */
static int raise_fd(int fd) {
    int high = fcntl(fd, F_DUPFD_CLOEXEC, 10);
    int error = errno;
    close(fd);
    errno = error;
    return high;
}

static bool open_channels(struct sp_import_child *c, const char *scratch, int *child_socket,
                          struct sp_error *err) {
    int pair[2];
    c->memory = scratch ? open(scratch, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600)
                        : memfd_create("splat-voxels", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    if (c->memory >= 0)
        c->memory = raise_fd(c->memory);
    if (c->memory < 0)
        return sp_fail(err, SP_ERR_IO, scratch ? scratch : c->title,
                       "cannot create shared memory: %s", strerror(errno));
    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair) != 0)
        return sp_fail(err, SP_ERR_IO, c->title, "cannot talk to the import process: %s",
                       strerror(errno));
    c->socket = raise_fd(pair[0]);
    *child_socket = raise_fd(pair[1]);
    return (c->socket >= 0 && *child_socket >= 0) ||
           sp_fail(err, SP_ERR_IO, c->title, "cannot hand the file to the import process: %s",
                   strerror(errno));
}

/* The variables that the loader and the sanitizers need, and where certificates are; none that a
 * format library reads. */
static void child_environment(char *out[8]) {
    static const char *const kept[] = { "LD_LIBRARY_PATH", "ASAN_OPTIONS", "UBSAN_OPTIONS",
                                        "TSAN_OPTIONS",    "LSAN_OPTIONS", "SSL_CERT_FILE" };
    int n = 0;
    for (size_t i = 0; i < sizeof kept / sizeof kept[0]; i++) {
        const char *value = getenv(kept[i]);
        char *line;
        if (value && asprintf(&line, "%s=%s", kept[i], value) > 0)
            out[n++] = line;
    }
    out[n] = NULL;
}

/* posix_spawn() runs none of our code in the child. The child gets default signals, an empty mask,
 * some descriptors, and the null device as standard input and output. */
static int spawn(const char *program, const int *fds, unsigned count, char *const argv[],
                 char *const envp[], pid_t *child) {
    posix_spawn_file_actions_t actions;
    posix_spawnattr_t attributes;
    sigset_t none, all;
    sigemptyset(&none);
    sigfillset(&all);
    int error = posix_spawn_file_actions_init(&actions);
    if (error)
        return error;
    error = posix_spawnattr_init(&attributes);
    if (error) {
        posix_spawn_file_actions_destroy(&actions);
        return error;
    }
    error = posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDWR, 0);
    if (!error)
        error = posix_spawn_file_actions_adddup2(&actions, 0, 1);
    for (unsigned i = 0; !error && i < count; i++)
        error = posix_spawn_file_actions_adddup2(&actions, fds[i], SP_IMPORT_SOCKET + (int)i);
    if (!error && (error = posix_spawnattr_setsigmask(&attributes, &none)) == 0 &&
        (error = posix_spawnattr_setsigdefault(&attributes, &all)) == 0 &&
        (error =
             posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF |
                                                       POSIX_SPAWN_SETPGROUP)) == 0)
        error = posix_spawn(child, program, &actions, &attributes, argv, envp);
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&actions);
    return error;
}

bool sp_import_child_start(struct sp_import_child *c, const char *program, char *const argv[],
                           const char *scratch, int fds[], unsigned count, struct sp_error *err) {
    int child_socket = -1, passed[FDS_MAX];
    char *environment[8];
    c->socket = c->memory = -1;
    c->pid = 0;
    bool ok = open_channels(c, scratch, &child_socket, err);
    for (unsigned i = 0; ok && i < count; i++)
        if ((fds[i] = raise_fd(fds[i])) < 0)
            ok = sp_fail(err, SP_ERR_IO, c->title, "cannot hand the file to the import process: %s",
                         strerror(errno));
    if (ok) {
        passed[0] = child_socket;
        passed[1] = c->memory;
        for (unsigned i = 0; i < count; i++)
            passed[2 + i] = fds[i];
        child_environment(environment);
        const int error = spawn(program, passed, count + 2, argv, environment, &c->pid);
        for (char **line = environment; *line; line++)
            free(*line);
        if (error) {
            c->pid = 0;
            ok = sp_fail(err, SP_ERR_IO, program, "cannot start the importer: %s", strerror(error));
        }
    }
    if (child_socket >= 0)
        close(child_socket);
    return ok;
}

bool sp_import_child_start_reader(struct sp_import_child *c, const char *program,
                                  const struct sp_import_request *request, const char *scratch,
                                  int fds[], unsigned count, struct sp_error *err) {
    const struct sp_source_parts *parts = request->parts;
    char seconds[16], step[16] = "", level[16];
    snprintf(seconds, sizeof seconds, "%d", c->timeout_ms / 1000 + 1);
    if (request->has_step)
        snprintf(step, sizeof step, "%" PRIu32, request->step);
    snprintf(level, sizeof level, "%d", parts->level);
    const char *arguments[SP_ARGUMENT_COUNT + 1] = {
        [SP_ARGUMENT_PROGRAM] = "splat-import",
        [SP_ARGUMENT_PATH] = request->path,
        [SP_ARGUMENT_ROOT] = request->root,
        [SP_ARGUMENT_FOLDER] = request->folder,
        [SP_ARGUMENT_CPU_SECONDS] = seconds,
        [SP_ARGUMENT_MODE] = request->mode,
        [SP_ARGUMENT_PATTERN] = request->pattern,
        [SP_ARGUMENT_STEP] = step,
        [SP_ARGUMENT_LEVEL] = level,
        [SP_ARGUMENT_SERIES] = parts->series,
        [SP_ARGUMENT_AS] = parts->as,
        [SP_ARGUMENT_UNIT] = parts->unit,
        [SP_ARGUMENT_VECTORS] = parts->vectors,
        [SP_ARGUMENT_FIELD] = parts->field,
    };
    /* posix_spawn() does not write to the strings, although its type allows it. */
    return sp_import_child_start(c, program, (char *const *)arguments, scratch, fds, count, err);
}

int sp_import_child_reap(struct sp_import_child *c) {
    int status = 0;
    if (c->pid == 0)
        return 0;
    kill(-c->pid, SIGKILL); /* the child leads a group: its own children die as well */
    kill(c->pid, SIGKILL);
    pid_t got;
    do
        got = waitpid(c->pid, &status, 0);
    while (got < 0 && errno == EINTR);
    c->pid = 0;
    /* If this process ignores SIGCHLD, the status is lost; the messages must suffice. */
    return got < 0 ? 0 : status;
}

/* Why a process dies of a signal. */
static const char *cause_of(int signal) {
    switch (signal) {
    case SIGKILL:
        return "most likely the machine or its container ran out of memory";
    case SIGABRT:
        return "a library gave up, because the file is damaged or needs more than 1 GiB beside the "
               "samples";
    case SIGSYS:
        return "the reader did what the sandbox forbids; the file may be hostile";
    case SIGSEGV:
    case SIGBUS:
    case SIGILL:
    case SIGFPE:
        return "the reader crashed; the file is damaged, or the reader has a bug";
    default:
        return "another program ended it";
    }
}

bool sp_import_child_fail_ended(struct sp_import_child *c, struct sp_error *err) {
    int status = sp_import_child_reap(c);
    if (WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU)
        return sp_fail(err, SP_ERR_TIMEOUT, c->title,
                       "the import process took more than the %d s of CPU time that a load may "
                       "take; a smaller file or one with less compression may load",
                       c->timeout_ms / 1000 + 1);
    if (WIFSIGNALED(status) && WTERMSIG(status) == SIGBUS && c->is_sparse)
        return sp_fail(err, SP_ERR_IO, c->title,
                       "cannot write the samples: the disk is full or fails");
    if (WIFSIGNALED(status)) {
        const char *name = sigabbrev_np(WTERMSIG(status));
        return sp_fail(err, SP_ERR_CRASHED, c->title,
                       "the import process was killed by signal %d (SIG%s): %s", WTERMSIG(status),
                       name ? name : "?", cause_of(WTERMSIG(status)));
    }
    return sp_fail(err, SP_ERR_CRASHED, c->title,
                   "the import process exited with status %d and without a result; the file is "
                   "damaged, or the reader has a bug",
                   WEXITSTATUS(status));
}

void sp_import_child_close(struct sp_import_child *c) {
    sp_import_child_reap(c);
    if (c->socket >= 0)
        close(c->socket);
    if (c->memory >= 0)
        close(c->memory);
    c->socket = c->memory = -1;
}

bool sp_import_child_receive(struct sp_import_child *c, struct sp_handover *message,
                             bool (*check)(void *user, struct sp_error *err), void *user,
                             bool *ended, struct sp_error *err) {
    *ended = false;
    for (;;) {
        if (!check(user, err))
            return false;
        struct pollfd wait = { .fd = c->socket, .events = POLLIN };
        int ready = poll(&wait, 1, POLL_MS);
        if (ready == 0 || (ready < 0 && errno == EINTR))
            continue;
        /* One byte more than any message, so that a longer message is recognized. */
        unsigned char bytes[sizeof *message + 1];
        ssize_t n = recv(c->socket, bytes, sizeof bytes, MSG_DONTWAIT);
        if (n < 0 && (errno == EAGAIN || errno == EINTR))
            continue;
        if (n <= 0) {
            *ended = true;
            return false;
        }
        return sp_handover_decode(bytes, (size_t)n, message, c->title, err);
    }
}

bool sp_import_child_send(struct sp_import_child *c, const struct sp_handover *message) {
    const size_t size = sp_handover_size((enum sp_handover_kind)message->kind);
    ssize_t sent;
    do
        sent = send(c->socket, message, size, MSG_NOSIGNAL);
    while (sent < 0 && errno == EINTR);
    return sent == (ssize_t)size;
}

bool sp_import_child_provide(struct sp_import_child *c, uint64_t bytes, enum sp_import_memory kind,
                             struct sp_error *err) {
    struct sp_handover go;
    int failed;
    c->is_sparse = kind == SP_IMPORT_SPARSE;
    do
        failed = !c->is_sparse ? posix_fallocate(c->memory, 0, (off_t)bytes)
                 : ftruncate(c->memory, (off_t)bytes) != 0 ? errno
                                                           : 0;
    while (failed == EINTR);
    if (failed)
        return sp_fail(err, SP_ERR_MEMORY, c->title,
                       "cannot allocate %" PRIu64 " bytes for the samples: %s", bytes,
                       strerror(failed));
    if (kind == SP_IMPORT_SEALED && fcntl(c->memory, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW) != 0)
        return sp_fail(err, SP_ERR_IO, c->title, "cannot protect the samples from changes: %s",
                       strerror(errno));
    sp_handover_init(&go, SP_HANDOVER_GO);
    go.bytes = bytes;
    return sp_import_child_send(c, &go) || sp_import_child_fail_ended(c, err);
}

bool sp_import_child_refuse(const struct sp_import_child *c, const struct sp_handover *message,
                            struct sp_error *err) {
    const struct sp_handover_error *e = &message->error;
    if (message->kind == SP_HANDOVER_ERROR)
        return sp_fail(err, (enum sp_code)e->code, e->place[0] ? e->place : c->title, "%s",
                       e->text);
    return sp_fail(err, SP_ERR_CRASHED, c->title, "the import process sent message %u out of order",
                   message->kind);
}
