/* SPDX-License-Identifier: Apache-2.0 */
#include "import/launch.h"

#include <assert.h>
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

#include "base/clock.h"
#include "base/locate.h"
#include "import/confine.h"
#include "import/handover.h"
#include "volume/volume.h"

enum { TIMEOUT_DEFAULT_MS = 300000, POLL_MS = 50 };

struct import {
    const char *path; /* as the caller gave it; the name in errors */
    const struct sp_load_options *options;
    char root[PATH_MAX], real[PATH_MAX], importer[PATH_MAX];
    int file, memory, socket; /* -1 = not open */
    pid_t child;              /* 0 = none */
    int timeout_ms;
    double deadline_ms;
    struct sp_handover_header header;
    struct sp_handover_layout layout; /* of the memory */
    uint64_t done;                    /* bytes that the child reports as read */
};

/* Before the child starts. */

static bool find_root(struct import *im, struct sp_error *err) {
    const char *root = im->options->root;
    if (root) {
        if (realpath(root, im->root))
            return true;
        return sp_fail(err, SP_ERR_IO, root, "cannot resolve this folder: %s", strerror(errno));
    }
    /* The folder of the file itself, after links are resolved. */
    if (!realpath(im->path, im->root)) {
        if (errno == ENOENT || errno == ENOTDIR)
            return sp_fail(err, SP_ERR_NOT_FOUND, im->path, "there is no such file");
        return sp_fail(err, SP_ERR_IO, im->path, "cannot resolve the path: %s", strerror(errno));
    }
    char *slash = strrchr(im->root, '/');
    slash[slash == im->root] = 0;
    return true;
}

static bool find_importer(struct import *im, struct sp_error *err) {
    struct sp_error why;
    if (im->options->importer)
        snprintf(im->importer, sizeof im->importer, "%s", im->options->importer);
    else if (!sp_locate("splat-import", im->importer, &why) && why.code == SP_ERR_IO)
        return sp_fail(err, SP_ERR_IO, why.place, "%s", why.text);
    if (access(im->importer, X_OK) != 0)
        return sp_fail(err, SP_ERR_IO, im->importer, "cannot run the importer: %s",
                       strerror(errno));
    return true;
}

/* Moves a descriptor above those of the child, so that placing one does not overwrite another. */
static int raise_fd(int fd) {
    int high = fcntl(fd, F_DUPFD_CLOEXEC, 10);
    int error = errno;
    close(fd);
    errno = error;
    return high;
}

static bool open_channels(struct import *im, int *child_socket, struct sp_error *err) {
    int pair[2];
    im->memory = memfd_create("splat-voxels", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    if (im->memory >= 0)
        im->memory = raise_fd(im->memory);
    if (im->memory < 0)
        return sp_fail(err, SP_ERR_IO, im->path, "cannot create shared memory: %s",
                       strerror(errno));
    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair) != 0)
        return sp_fail(err, SP_ERR_IO, im->path, "cannot create a socket: %s", strerror(errno));
    im->socket = raise_fd(pair[0]);
    *child_socket = raise_fd(pair[1]);
    im->file = raise_fd(im->file);
    if (im->socket >= 0 && *child_socket >= 0 && im->file >= 0)
        return true;
    int error = errno;
    if (*child_socket >= 0)
        close(*child_socket);
    return sp_fail(err, SP_ERR_IO, im->path, "cannot pass descriptors: %s", strerror(error));
}

/* The variables that the loader and the sanitizers need; none that a format library reads. */
static void child_environment(char *out[8]) {
    static const char *const kept[] = { "LD_LIBRARY_PATH", "ASAN_OPTIONS", "UBSAN_OPTIONS",
                                        "TSAN_OPTIONS", "LSAN_OPTIONS" };
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
 * three descriptors, and the null device as standard input and output. */
static int spawn(const struct import *im, int child_socket, char *const argv[], char *const envp[],
                 pid_t *child) {
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
    if ((error = posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDWR, 0)) == 0 &&
        (error = posix_spawn_file_actions_adddup2(&actions, 0, 1)) == 0 &&
        (error = posix_spawn_file_actions_adddup2(&actions, child_socket, SP_IMPORT_SOCKET)) == 0 &&
        (error = posix_spawn_file_actions_adddup2(&actions, im->memory, SP_IMPORT_MEMORY)) == 0 &&
        (error = posix_spawn_file_actions_adddup2(&actions, im->file, SP_IMPORT_FILE)) == 0 &&
        (error = posix_spawnattr_setsigmask(&attributes, &none)) == 0 &&
        (error = posix_spawnattr_setsigdefault(&attributes, &all)) == 0 &&
        (error =
             posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF |
                                                       POSIX_SPAWN_SETPGROUP)) == 0)
        error = posix_spawn(child, im->importer, &actions, &attributes, argv, envp);
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&actions);
    return error;
}

static bool start_child(struct import *im, struct sp_error *err) {
    int child_socket = -1;
    if (!open_channels(im, &child_socket, err))
        return false;
    char name[] = "splat-import", folder[PATH_MAX], seconds[16], *environment[8];
    snprintf(folder, sizeof folder, "%s", im->real);
    char *slash = strrchr(folder, '/');
    slash[slash == folder] = 0;
    snprintf(seconds, sizeof seconds, "%d", im->timeout_ms / 1000 + 1);
    char *argv[] = { name, (char *)im->path, im->root, folder, seconds, NULL };
    child_environment(environment);
    int error = spawn(im, child_socket, argv, environment, &im->child);
    for (char **line = environment; *line; line++)
        free(*line);
    close(child_socket);
    if (error) {
        im->child = 0;
        return sp_fail(err, SP_ERR_IO, im->importer, "cannot start the importer: %s",
                       strerror(error));
    }
    return true;
}

/* The end of the child. */

/* Kills the child if it still runs, and returns its exit status. */
static int reap(struct import *im) {
    int status = 0;
    if (im->child == 0)
        return 0;
    kill(-im->child, SIGKILL); /* the child leads a group: its own children die as well */
    kill(im->child, SIGKILL);
    pid_t got;
    do
        got = waitpid(im->child, &status, 0);
    while (got < 0 && errno == EINTR);
    im->child = 0;
    /* If this process ignores SIGCHLD, the status is lost; the messages must suffice. */
    return got < 0 ? 0 : status;
}

static bool fail_ended(struct import *im, struct sp_error *err) {
    int status = reap(im);
    if (WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU)
        return sp_fail(err, SP_ERR_TIMEOUT, im->path,
                       "the import process took more than %d s of CPU time",
                       im->timeout_ms / 1000 + 1);
    if (WIFSIGNALED(status)) {
        const char *name = sigabbrev_np(WTERMSIG(status));
        return sp_fail(
            err, SP_ERR_CRASHED, im->path,
            "the import process was killed by signal %d (SIG%s): the file is damaged, or the "
            "reader has a bug",
            WTERMSIG(status), name ? name : "?");
    }
    return sp_fail(err, SP_ERR_CRASHED, im->path,
                   "the import process exited with status %d and without a result",
                   WEXITSTATUS(status));
}

/* Cancellation comes before the timeout: callers rely on it. */
static bool check_in(const struct import *im, double *next_call_ms, struct sp_error *err) {
    double now = sp_clock_ms();
    if (im->options->progress && now >= *next_call_ms) {
        *next_call_ms = now + POLL_MS / 2.0;
        /* The rest of the progress belongs to range and histogram. */
        uint64_t bytes = im->layout.bytes;
        double fraction = bytes ? 0.95 * (double)im->done / (double)bytes : 0;
        if (!im->options->progress(im->options->user, fraction))
            return sp_fail(err, SP_ERR_CANCELLED, im->path, "loading was cancelled");
    }
    if (now >= im->deadline_ms)
        return sp_fail(err, SP_ERR_TIMEOUT, im->path,
                       "the import process took longer than the timeout of %d ms", im->timeout_ms);
    return true;
}

/* Receives and checks the next message. False with *err set if there is none, or with *ended if the
 * child closed its end. */
static bool receive(struct import *im, struct sp_handover *message, bool *ended,
                    struct sp_error *err) {
    double next_call_ms = 0;
    *ended = false;
    for (;;) {
        if (!check_in(im, &next_call_ms, err))
            return false;
        struct pollfd wait = { .fd = im->socket, .events = POLLIN };
        double left = im->deadline_ms - sp_clock_ms();
        int ready = poll(&wait, 1, left < POLL_MS ? (int)left + 1 : POLL_MS);
        if (ready == 0 || (ready < 0 && errno == EINTR))
            continue;
        /* One byte more than any message, so that a longer message is recognized. */
        unsigned char bytes[sizeof *message + 1];
        ssize_t n = recv(im->socket, bytes, sizeof bytes, MSG_DONTWAIT);
        if (n < 0 && (errno == EAGAIN || errno == EINTR))
            continue;
        if (n <= 0) {
            *ended = true;
            return false;
        }
        return sp_handover_decode(bytes, (size_t)n, message, im->path, err);
    }
}

static bool unexpected(const struct import *im, const struct sp_handover *message,
                       struct sp_error *err) {
    return sp_fail(err, SP_ERR_CRASHED, im->path, "the import process sent message %u out of order",
                   message->kind);
}

static bool pass_error_on(const struct import *im, const struct sp_handover *message,
                          struct sp_error *err) {
    const struct sp_handover_error *e = &message->error;
    return sp_fail(err, (enum sp_code)e->code, e->place[0] ? e->place : im->path, "%s", e->text);
}

/* The two phases. */

static bool receive_header(struct import *im, struct sp_error *err) {
    struct sp_handover message;
    bool ended;
    if (!receive(im, &message, &ended, err))
        return ended ? fail_ended(im, err) : false;
    if (message.kind == SP_HANDOVER_ERROR)
        return pass_error_on(im, &message, err);
    if (message.kind != SP_HANDOVER_HEADER)
        return unexpected(im, &message, err);
    im->header = message.header;
    im->layout = sp_handover_layout(&im->header);
    return true;
}

/* Allocates the memory now: a lack of memory is an error here and would be a signal later. */
static bool provide_memory(struct import *im, struct sp_error *err) {
    uint64_t bytes = im->layout.bytes;
    if (im->options->reserve && !im->options->reserve(im->options->user, bytes, err))
        return false;
    int failed;
    do
        failed = posix_fallocate(im->memory, 0, (off_t)bytes);
    while (failed == EINTR);
    if (failed)
        return sp_fail(err, SP_ERR_MEMORY, im->path,
                       "cannot allocate %" PRIu64 " bytes for the samples: %s", bytes,
                       strerror(failed));
    if (fcntl(im->memory, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW) != 0)
        return sp_fail(err, SP_ERR_IO, im->path, "cannot seal shared memory: %s", strerror(errno));
    struct sp_handover go;
    sp_handover_init(&go, SP_HANDOVER_GO);
    go.bytes = bytes;
    if (send(im->socket, &go, sp_handover_size(SP_HANDOVER_GO), MSG_NOSIGNAL) < 0)
        return fail_ended(im, err);
    return true;
}

static bool await_samples(struct import *im, struct sp_error *err) {
    struct sp_handover message;
    bool ended, done = false;
    for (;;) {
        if (!receive(im, &message, &ended, err)) {
            if (!ended)
                return false;
            if (!done)
                return fail_ended(im, err);
            int status = reap(im);
            return status == 0 ||
                   sp_fail(err, SP_ERR_CRASHED, im->path,
                           "the import process failed after its last message (status %d)", status);
        }
        if (done)
            return unexpected(im, &message, err);
        switch (message.kind) {
        case SP_HANDOVER_PROGRESS:
            im->done = message.bytes < im->layout.bytes ? message.bytes : im->layout.bytes;
            break;
        case SP_HANDOVER_DONE:
            done = true;
            break;
        case SP_HANDOVER_ERROR:
            return pass_error_on(im, &message, err);
        default:
            return unexpected(im, &message, err);
        }
    }
}

static void release_mapping(void *voxels, size_t bytes) {
    munmap(voxels, bytes);
}

static void describe(const struct import *im, struct sp_volume_info *info) {
    memset(info, 0, sizeof *info);
    const struct sp_handover_header *h = &im->header;
    memcpy(info->grid.dims, h->dims, sizeof h->dims);
    memcpy(info->grid.spacing, h->spacing, sizeof h->spacing);
    memcpy(info->grid.origin, h->origin, sizeof h->origin);
    memcpy(info->grid.direction, h->direction, sizeof h->direction);
    info->type = (enum sp_type)h->type;
    memcpy(info->unit, h->unit, sizeof info->unit);
    memcpy(info->anatomy, h->anatomy, sizeof info->anatomy);
    memcpy(info->value_name, h->value_name, sizeof info->value_name);
    memcpy(info->vector_name, h->vector_name, sizeof info->vector_name);
    const char *slash = strrchr(im->path, '/'), *base = slash ? slash + 1 : im->path;
    const char *dot = strrchr(base, '.');
    snprintf(info->name, sizeof info->name, "%.*s",
             dot && dot > base ? (int)(dot - base) : (int)strlen(base), base);
    snprintf(info->source, sizeof info->source, "%s", im->path);
}

/* Seals the memory against writing, so that checked coordinates cannot change. Sealing fails while
 * a process still maps the memory for writing. */
static struct sp_volume *take_over(const struct import *im, struct sp_error *err) {
    if (fcntl(im->memory, F_ADD_SEALS, F_SEAL_WRITE | F_SEAL_SEAL) != 0) {
        sp_fail(err, SP_ERR_CRASHED, im->path, "the import process still maps the samples: %s",
                strerror(errno));
        return NULL;
    }
    size_t bytes = (size_t)im->layout.bytes;
    void *voxels = mmap(NULL, bytes, PROT_READ, MAP_SHARED, im->memory, 0);
    if (voxels == MAP_FAILED) {
        sp_fail(err, SP_ERR_MEMORY, im->path, "cannot map %zu bytes of samples: %s", bytes,
                strerror(errno));
        return NULL;
    }
    struct sp_volume_info info;
    describe(im, &info);
    uint64_t samples;
    struct sp_error why;
    for (int axis = 0; axis < 3; axis++)
        if (im->header.rectilinear >> axis & 1)
            info.grid.coordinates[axis] =
                (double *)((char *)voxels + im->layout.coordinates_at[axis]);
    if (!sp_grid_check(&info.grid, info.type, im->path, &samples, &why)) {
        munmap(voxels, bytes);
        sp_fail(err, SP_ERR_CRASHED, im->path, "the import process sent a bad grid: %s", why.text);
        return NULL;
    }
    const void *vectors = im->layout.vectors_at ? (char *)voxels + im->layout.vectors_at : NULL;
    struct sp_volume *volume = sp_volume_adopt(&info, voxels, vectors, bytes, release_mapping, err);
    if (volume && im->options->progress)
        im->options->progress(im->options->user, 1);
    return volume;
}

static void finish(struct import *im) {
    const int fds[] = { im->file, im->memory, im->socket };
    reap(im);
    for (size_t i = 0; i < sizeof fds / sizeof fds[0]; i++)
        if (fds[i] >= 0)
            close(fds[i]);
}

struct sp_volume *sp_import(const char *path, const struct sp_load_options *options,
                            struct sp_error *err) {
    static const struct sp_load_options none;
    struct sp_volume *volume = NULL;
    uint64_t size;
    struct import *im = calloc(1, sizeof *im);
    if (!im) {
        sp_fail(err, SP_ERR_MEMORY, path, "out of memory while starting an import");
        return NULL;
    }
    im->path = path;
    im->options = options ? options : &none;
    im->file = im->memory = im->socket = -1;
    assert(im->options->timeout_ms >= 0);
    im->timeout_ms = im->options->timeout_ms ? im->options->timeout_ms : TIMEOUT_DEFAULT_MS;
    im->deadline_ms = sp_clock_ms() + im->timeout_ms;
    if (find_root(im, err) && find_importer(im, err) &&
        (im->file = sp_open_confined(im->root, path, path, im->real, &size, err)) >= 0 &&
        start_child(im, err) && receive_header(im, err) && provide_memory(im, err) &&
        await_samples(im, err))
        volume = take_over(im, err);
    finish(im);
    free(im);
    return volume;
}
