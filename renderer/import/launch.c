/* SPDX-License-Identifier: Apache-2.0 */
#include "import/launch.h"

#include <assert.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/locate.h"
#include "bricks/store.h"
#include "bricks/transfer.h"
#include "bricks/unpack.h"
#include "import/confine.h"
#include "import/handover.h"
#include "import/numbered.h"
#include "import/place.h"
#include "volume/volume.h"

enum { TIMEOUT_DEFAULT_MS = 300000, POLL_MS = 50 };

struct import {
    const char *source, *field;   /* as the caller gave them; "" = the reader chooses the field */
    char vectors[SP_FIELD_BYTES]; /* the same */
    int level;                    /* −1 = the reader chooses */
    bool is_coarser;              /* there was no memory for a finer level */
    struct sp_import_place place;
    const struct sp_load_options *options;
    char real[PATH_MAX], importer[PATH_MAX];
    const char *scratch;      /* folder of a file that takes the place of memory; NULL = none */
    int file, memory, socket; /* -1 = not open */
    pid_t child;              /* 0 = none */
    int timeout_ms;
    double deadline_ms;
    struct sp_handover_header header;
    struct sp_handover_layout layout; /* of the memory */
    uint64_t done;                    /* bytes that the child reports as read */
    struct sp_handover_done end;
};

/* Before the child starts. */

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
    im->memory = im->scratch ? open(im->scratch, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600)
                             : memfd_create("splat-voxels", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    if (im->memory >= 0)
        im->memory = raise_fd(im->memory);
    if (im->memory < 0)
        return sp_fail(err, SP_ERR_IO, im->scratch ? im->scratch : im->place.path,
                       "cannot create shared memory: %s", strerror(errno));
    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair) != 0)
        return sp_fail(err, SP_ERR_IO, im->place.path, "cannot create a socket: %s",
                       strerror(errno));
    im->socket = raise_fd(pair[0]);
    *child_socket = raise_fd(pair[1]);
    im->file = raise_fd(im->file);
    if (im->socket >= 0 && *child_socket >= 0 && im->file >= 0)
        return true;
    int error = errno;
    if (*child_socket >= 0)
        close(*child_socket);
    return sp_fail(err, SP_ERR_IO, im->place.path, "cannot pass descriptors: %s", strerror(error));
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
    char name[] = "splat-import", folder[PATH_MAX], seconds[16], step[16], level[16],
         *environment[8];
    snprintf(folder, sizeof folder, "%s", im->real);
    char *slash = strrchr(folder, '/');
    slash[slash == folder] = 0;
    snprintf(seconds, sizeof seconds, "%d", im->timeout_ms / 1000 + 1);
    snprintf(step, sizeof step, "%u", im->options->step);
    snprintf(level, sizeof level, "%d", im->level);
    char *argv[] = {
        name, im->place.path, im->place.root, folder, seconds, (char *)im->field, im->place.series,
        step, level,          im->vectors,    NULL
    };
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
        return sp_fail(err, SP_ERR_TIMEOUT, im->place.path,
                       "the import process took more than %d s of CPU time",
                       im->timeout_ms / 1000 + 1);
    if (WIFSIGNALED(status)) {
        const char *name = sigabbrev_np(WTERMSIG(status));
        return sp_fail(
            err, SP_ERR_CRASHED, im->place.path,
            "the import process was killed by signal %d (SIG%s): the file is damaged, or the "
            "reader has a bug",
            WTERMSIG(status), name ? name : "?");
    }
    return sp_fail(err, SP_ERR_CRASHED, im->place.path,
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
            return sp_fail(err, SP_ERR_CANCELLED, im->place.path, "loading was cancelled");
    }
    if (now >= im->deadline_ms)
        return sp_fail(err, SP_ERR_TIMEOUT, im->place.path,
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
        return sp_handover_decode(bytes, (size_t)n, message, im->place.path, err);
    }
}

static bool unexpected(const struct import *im, const struct sp_handover *message,
                       struct sp_error *err) {
    return sp_fail(err, SP_ERR_CRASHED, im->place.path,
                   "the import process sent message %u out of order", message->kind);
}

static bool pass_error_on(const struct import *im, const struct sp_handover *message,
                          struct sp_error *err) {
    const struct sp_handover_error *e = &message->error;
    return sp_fail(err, (enum sp_code)e->code, e->place[0] ? e->place : im->place.path, "%s",
                   e->text);
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
        return sp_fail(err, SP_ERR_MEMORY, im->place.path,
                       "cannot allocate %" PRIu64 " bytes for the samples: %s", bytes,
                       strerror(failed));
    if (!im->scratch && fcntl(im->memory, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW) != 0)
        return sp_fail(err, SP_ERR_IO, im->place.path, "cannot seal shared memory: %s",
                       strerror(errno));
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
                   sp_fail(err, SP_ERR_CRASHED, im->place.path,
                           "the import process failed after its last message (status %d)", status);
        }
        if (done)
            return unexpected(im, &message, err);
        switch (message.kind) {
        case SP_HANDOVER_PROGRESS:
            im->done = message.bytes < im->layout.bytes ? message.bytes : im->layout.bytes;
            break;
        case SP_HANDOVER_DONE:
            if (message.done.folded > im->header.count)
                return sp_fail(err, SP_ERR_CRASHED, im->place.path,
                               "the import process folded more cells than there are");
            im->end = message.done;
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

/* Appends a word to a name, unless it is empty or does not fit. */
static void append_word(char name[SP_NAME_BYTES], const char *word) {
    const size_t used = strlen(name), length = strlen(word);
    if (length == 0 || used + length + 2 > SP_NAME_BYTES)
        return;
    name[used] = ' ';
    memcpy(name + used + 1, word, length + 1);
}

static void describe(const struct import *im, struct sp_volume_info *info) {
    sp_handover_describe(&im->header, &im->end, info);
    for (int i = 0; i < SP_WARNINGS_MAX && im->is_coarser; i++)
        if (!info->warnings[i][0]) {
            snprintf(info->warnings[i], sizeof info->warnings[i],
                     "There was no memory for finer levels of detail: level %u was read, of 0 to "
                     "%u.",
                     im->header.level, im->header.level_count - 1);
            break;
        }
    memcpy(info->name, im->place.name, sizeof info->name);
    append_word(info->name, im->field);
    append_word(info->name, im->vectors);
    snprintf(info->source, sizeof info->source, "%s", im->source);
}

static bool are_finite(const double *numbers, uint32_t count) {
    for (uint32_t i = 0; numbers && i < count; i++)
        if (!isfinite(numbers[i]))
            return false;
    return true;
}

/* Seals the memory against writing, so that checked coordinates cannot change. Sealing fails while
 * a process still maps the memory for writing. */
static struct sp_volume *take_over(const struct import *im, struct sp_error *err) {
    if (fcntl(im->memory, F_ADD_SEALS, F_SEAL_WRITE | F_SEAL_SEAL) != 0) {
        sp_fail(err, SP_ERR_CRASHED, im->place.path,
                "the import process still maps the samples: %s", strerror(errno));
        return NULL;
    }
    size_t bytes = (size_t)im->layout.bytes;
    void *voxels = mmap(NULL, bytes, PROT_READ, MAP_SHARED, im->memory, 0);
    if (voxels == MAP_FAILED) {
        sp_fail(err, SP_ERR_MEMORY, im->place.path, "cannot map %zu bytes of samples: %s", bytes,
                strerror(errno));
        return NULL;
    }
    struct sp_volume_info info;
    describe(im, &info);
    uint64_t samples;
    struct sp_error why;
    if (im->layout.times_at)
        info.steps.times = (double *)(void *)((char *)voxels + im->layout.times_at);
    if (!are_finite(info.steps.times, info.steps.count)) {
        munmap(voxels, bytes);
        sp_fail(err, SP_ERR_CRASHED, im->place.path,
                "the import process sent times that are no numbers");
        return NULL;
    }
    if (info.elements.kind != SP_KIND_GRID)
        return sp_volume_adopt_elements(&info, voxels, bytes, release_mapping, err);
    for (int axis = 0; axis < 3; axis++)
        if (im->header.rectilinear >> axis & 1)
            info.grid.coordinates[axis] =
                (double *)((char *)voxels + im->layout.coordinates_at[axis]);
    if (!sp_grid_check(&info.grid, info.type, im->place.path, &samples, &why)) {
        munmap(voxels, bytes);
        sp_fail(err, SP_ERR_CRASHED, im->place.path, "the import process sent a bad grid: %s",
                why.text);
        return NULL;
    }
    const void *vectors = im->layout.vectors_at ? (char *)voxels + im->layout.vectors_at : NULL;
    return sp_volume_adopt(&info, voxels, vectors, bytes, release_mapping, err);
}

static void finish(struct import *im) {
    const int fds[] = { im->file, im->memory, im->socket };
    reap(im);
    for (size_t i = 0; i < sizeof fds / sizeof fds[0]; i++)
        if (fds[i] >= 0)
            close(fds[i]);
}

static struct import *create(const char *source, const struct sp_load_options *options,
                             const char *scratch, struct sp_error *err) {
    static const struct sp_load_options none;
    const struct sp_source_parts parts = sp_source_split(source);
    const size_t length = parts.path_bytes;
    struct import *im = calloc(1, sizeof *im);
    if (length >= sizeof im->place.path) {
        free(im);
        sp_fail(err, SP_ERR_NOT_FOUND, source, "cannot open the file: %s", strerror(ENAMETOOLONG));
        return NULL;
    }
    if (!im) {
        sp_fail(err, SP_ERR_MEMORY, source, "out of memory while starting an import");
        return NULL;
    }
    im->source = source;
    snprintf(im->place.path, sizeof im->place.path, "%.*s", (int)length, source);
    im->field = parts.field;
    im->level = parts.level;
    memcpy(im->vectors, parts.vectors, sizeof im->vectors);
    im->options = options ? options : &none;
    im->file = im->memory = im->socket = -1;
    assert(im->options->timeout_ms >= 0);
    im->timeout_ms = im->options->timeout_ms ? im->options->timeout_ms : TIMEOUT_DEFAULT_MS;
    im->deadline_ms = sp_clock_ms() + im->timeout_ms;
    im->scratch = scratch;
    return im;
}

/* Everything until the child has ended and the memory is filled. */
static bool attempt(struct import *im, struct sp_error *err) {
    uint64_t size;
    im->header.level_count = 0;
    im->memory = im->socket = -1;
    im->file =
        sp_open_confined(im->place.root, im->place.path, im->place.path, im->real, &size, err);
    return im->file >= 0 && start_child(im, err) && receive_header(im, err) &&
           provide_memory(im, err) && await_samples(im, err);
}

/* If the caller leaves the level open, the finest one that gets its memory is loaded. */
static bool run(struct import *im, struct sp_error *err) {
    const bool is_open = im->level < 0 && !im->options->is_finest;
    struct sp_error why = { .code = SP_OK };
    bool ok = attempt(im, &why);
    while (!ok && is_open && why.code == SP_ERR_BUDGET &&
           im->header.level + 1 < im->header.level_count) {
        im->level = (int)im->header.level + 1;
        im->is_coarser = true;
        finish(im);
        ok = attempt(im, &why);
    }
    if (!ok && err)
        *err = why;
    return ok;
}

static bool find(struct import *im, struct sp_error *err) {
    return sp_import_place_find(&im->place, im->options->root, err) && find_importer(im, err);
}

/* Opens a brick file, which this process reads and checks (bricks/README.md). -1 = it is none. */
static int open_bricks(const struct import *im) {
    char real[PATH_MAX];
    uint64_t size;
    int file = sp_open_confined(im->place.root, im->place.path, im->place.path, real, &size, NULL);
    if (file >= 0 && !sp_brick_file_is(file)) {
        close(file);
        file = -1;
    }
    return file;
}

struct sp_volume *sp_import(const char *source, const struct sp_load_options *options,
                            struct sp_error *err) {
    struct sp_volume *volume = NULL;
    struct import *im = create(source, options, NULL, err);
    if (!im)
        return NULL;
    const bool is_found = find(im, err);
    const int bricks = is_found ? open_bricks(im) : -1;
    if (bricks >= 0)
        volume = sp_brick_store_open(bricks, im->place.name, im->source, im->options, err);
    else if (is_found && run(im, err))
        volume = take_over(im, err);
    if (volume && im->options->progress)
        im->options->progress(im->options->user, 1);
    finish(im);
    free(im);
    return volume;
}

/* Copies the times of the series from the file of samples; the caller frees them. */
static bool take_times(const struct import *im, struct sp_volume_info *info, struct sp_error *err) {
    const size_t size = info->steps.count * sizeof(double);
    if (!im->layout.times_at)
        return true;
    double *times = malloc(size);
    if (!times)
        return sp_fail(err, SP_ERR_MEMORY, im->place.path, "out of memory for the times");
    if (sp_read_at(im->memory, times, size, im->layout.times_at) &&
        are_finite(times, info->steps.count)) {
        info->steps.times = times;
        return true;
    }
    free(times);
    return sp_fail(err, SP_ERR_CRASHED, im->place.path,
                   "the import process sent times that are no numbers");
}

/* Describes the samples in the file. The child has ended, so the size does not change any more. */
static bool take_samples(const struct import *im, struct sp_volume_info *info,
                         struct sp_error *err) {
    struct sp_error why;
    struct stat st;
    uint64_t samples;
    describe(im, info);
    if (info->elements.kind != SP_KIND_GRID || im->header.rectilinear)
        return sp_fail(err, SP_ERR_UNSUPPORTED, im->place.path,
                       "only volumes with evenly spaced axes can be converted");
    if (!sp_grid_check(&info->grid, info->type, im->place.path, &samples, &why))
        return sp_fail(err, SP_ERR_CRASHED, im->place.path,
                       "the import process sent a bad grid: %s", why.text);
    if (fstat(im->memory, &st) != 0 || (uint64_t)st.st_size < samples)
        return sp_fail(err, SP_ERR_CRASHED, im->place.path, "the import process cut the samples");
    if (im->layout.vectors_at)
        info->vector_bytes = samples / sp_type_size(info->type) * 3 * sizeof(float);
    return take_times(im, info, err);
}

int sp_import_samples(const char *source, const struct sp_load_options *options, const char *folder,
                      struct sp_volume_info *info, struct sp_error *err) {
    struct import *im = create(source, options, folder, err);
    int samples = -1;
    if (!im)
        return -1;
    const bool is_found = find(im, err);
    const int bricks = is_found ? open_bricks(im) : -1;
    if (bricks >= 0) {
        samples = sp_bricks_unpack(bricks, im->place.path, folder, im->options, info, err);
        if (samples >= 0)
            snprintf(info->name, sizeof info->name, "%s", im->place.name);
    } else if (is_found && run(im, err) && take_samples(im, info, err)) {
        samples = im->memory;
        im->memory = -1;
    }
    finish(im);
    free(im);
    return samples;
}
