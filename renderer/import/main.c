/* SPDX-License-Identifier: Apache-2.0
 *
 * splat-import: reads one file on behalf of its parent. handover.h describes their messages,
 * sandbox.h what this process may do, even if the file takes control of it.
 */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "import/format.h"
#include "import/handover.h"
#include "import/launch.h"
#include "import/sandbox.h"
#include "import/vectors.h"

#if defined(__SANITIZE_THREAD__)
/* TSan does not understand OpenImageIO's spin locks; encode/exr.c has the same suppression. */
__attribute__((visibility("default"))) const char *__tsan_default_suppressions(void);
const char *__tsan_default_suppressions(void) {
    return "called_from_lib:libOpenImageIO_Util.so\n";
}
#endif

struct job {
    struct import_file file;
    uint8_t start[64];  /* first bytes of the file, which tell its format */
    ssize_t start_size; /* < 0 = the file cannot be read */
    const struct import_format *format;
    struct import_header header;
    struct sp_handover_layout layout; /* of the shared memory */
    uint64_t reported;                /* bytes in the last progress message */
};

static bool say(const struct sp_handover *message) {
    size_t size = sp_handover_size((enum sp_handover_kind)message->kind);
    ssize_t sent;
    do
        sent = send(SP_IMPORT_SOCKET, message, size, MSG_NOSIGNAL);
    while (sent < 0 && errno == EINTR);
    return sent == (ssize_t)size;
}

static int say_error(const struct sp_error *err) {
    struct sp_handover message;
    sp_handover_init(&message, SP_HANDOVER_ERROR);
    message.error.code = err->code;
    memcpy(message.error.place, err->place, sizeof err->place);
    memcpy(message.error.text, err->text, sizeof err->text);
    say(&message);
    return 1;
}

static bool has_format(const struct job *job, const struct import_format *format) {
    return job->start_size > 0 &&
           format->probe(job->start, (size_t)job->start_size, job->file.shown);
}

/* Enters the sandbox, where only the root folder is readable; for TIFF, which needs a module
 * (tiff_bridge.h), also the folders of libraries. */
static bool enter_sandbox(const struct job *job, int cpu_seconds, struct sp_error *err) {
    enum { FOLDERS = 32 };
    char own[PATH_MAX],
        *libraries = strdup(getenv("LD_LIBRARY_PATH") ? getenv("LD_LIBRARY_PATH") : ""),
        *rest = NULL;
    const char *readable[FOLDERS + 1] = { job->file.root };
    if (has_format(job, &import_tiff)) {
        static const char *const known[] = { "/usr", "/lib",       "/lib64",
                                             "/opt", "/nix/store", "/etc/ld.so.cache" };
        size_t n = 1;
        readable[n++] = import_program_folder(own);
        for (size_t i = 0; i < sizeof known / sizeof *known; i++)
            readable[n++] = known[i];
        for (char *one = strtok_r(libraries, ":", &rest); one && n < FOLDERS;
             one = strtok_r(NULL, ":", &rest))
            readable[n++] = one;
    }
    bool ok = libraries ? import_sandbox_enter(cpu_seconds, SP_IMPORT_FILE + 1, readable,
                                               job->file.shown, err)
                        : sp_fail(err, SP_ERR_MEMORY, job->file.shown, "out of memory");
    free(libraries);
    return ok;
}

static const struct import_format *find_format(const struct job *job, struct sp_error *err) {
    const struct import_file *file = &job->file;
    if (job->start_size < 0) {
        sp_fail(err, SP_ERR_IO, file->shown, "cannot read the file");
        return NULL;
    }
    if (job->start_size == 0) {
        import_fail(err, SP_ERR_FORMAT, file->shown, 0, NULL, "the file is empty");
        return NULL;
    }
    static const struct import_format *const formats[] = { &import_tiff, &import_nrrd, &import_vtk,
                                                           &import_vtk_xml, &import_raw };
    for (size_t i = 0; i < sizeof formats / sizeof formats[0]; i++)
        if (has_format(job, formats[i]))
            return formats[i];
    import_fail(
        err, SP_ERR_UNSUPPORTED, file->shown, 0, NULL,
        "unknown file format; supported are NRRD (.nrrd, .nhdr), VTK (.vtk, .vti, .vtr), raw "
        "samples with a JSON sidecar (.json) and TIFF stacks (.tif)");
    return NULL;
}

static bool await_go(const struct job *job) {
    struct sp_handover go;
    ssize_t n;
    do
        n = recv(SP_IMPORT_SOCKET, &go, sizeof go, 0);
    while (n < 0 && errno == EINTR);
    return n == (ssize_t)sp_handover_size(SP_HANDOVER_GO) && go.magic == SP_HANDOVER_MAGIC &&
           go.kind == SP_HANDOVER_GO && go.bytes == job->layout.bytes;
}

/* Sends one message per percent, so that progress costs nothing. */
static void report(void *user, uint64_t bytes_done) {
    struct job *job = user;
    if (bytes_done - job->reported < job->layout.bytes / 100)
        return;
    job->reported = bytes_done;
    struct sp_handover message;
    sp_handover_init(&message, SP_HANDOVER_PROGRESS);
    message.bytes = bytes_done;
    if (!say(&message)) /* the parent closed the socket */
        exit(1);
}

static bool say_header(struct job *job) {
    struct sp_handover message;
    sp_handover_init(&message, SP_HANDOVER_HEADER);
    const struct import_header *h = &job->header;
    message.header.type = h->type;
    memcpy(message.header.dims, h->grid.dims, sizeof h->grid.dims);
    memcpy(message.header.spacing, h->grid.spacing, sizeof h->grid.spacing);
    memcpy(message.header.origin, h->grid.origin, sizeof h->grid.origin);
    memcpy(message.header.direction, h->grid.direction, sizeof h->grid.direction);
    for (int axis = 0; axis < 3; axis++)
        message.header.rectilinear |= (uint32_t)(h->grid.coordinates[axis] != NULL) << axis;
    message.header.has_vectors = h->has_vectors;
    message.header.bytes = h->bytes;
    memcpy(message.header.unit, h->unit, sizeof h->unit);
    memcpy(message.header.anatomy, h->anatomy, sizeof h->anatomy);
    memcpy(message.header.value_name, h->value_name, sizeof h->value_name);
    memcpy(message.header.vector_name, h->vector_name, sizeof h->vector_name);
    job->layout = sp_handover_layout(&message.header);
    return say(&message);
}

static void copy_coordinates(const struct job *job, char *memory) {
    const struct sp_grid *grid = &job->header.grid;
    for (int axis = 0; axis < 3; axis++)
        if (grid->coordinates[axis])
            memcpy(memory + job->layout.coordinates_at[axis], grid->coordinates[axis],
                   grid->dims[axis] * sizeof(double));
}

/* Fills the shared memory. */
static bool read_all(struct job *job, void *reader, char *memory, struct sp_error *err) {
    const struct import_progress progress = { .report = report, .user = job };
    uint64_t at = job->layout.vectors_at;
    float(*vectors)[3] = at ? (float(*)[3])(void *)(memory + at) : NULL;
    copy_coordinates(job, memory);
    if (!job->format->read(reader, memory, vectors, &progress, err))
        return false;
    if (vectors)
        import_vectors_finish(&job->header, vectors, memory);
    return true;
}

static int run(struct job *job) {
    struct sp_error err;
    job->format = find_format(job, &err);
    void *reader = job->format ? job->format->open(&job->file, &job->header, &err) : NULL;
    if (!reader)
        return say_error(&err);
    if (!say_header(job) || !await_go(job)) {
        job->format->close(reader);
        return 0; /* the parent refused or is gone: not our failure */
    }
    if (!import_sandbox_allow_samples(job->layout.bytes, job->file.shown, &err)) {
        job->format->close(reader);
        return say_error(&err);
    }
    size_t capacity = job->layout.bytes;
    void *memory = mmap(NULL, capacity, PROT_READ | PROT_WRITE, MAP_SHARED, SP_IMPORT_MEMORY, 0);
    bool ok = memory != MAP_FAILED;
    if (ok) {
        ok = read_all(job, reader, memory, &err);
        munmap(memory, capacity);
    } else {
        sp_fail(&err, SP_ERR_MEMORY, job->file.shown, "cannot map the shared memory: %s",
                strerror(errno));
    }
    job->format->close(reader);
    if (!ok)
        return say_error(&err);
    struct sp_handover done;
    sp_handover_init(&done, SP_HANDOVER_DONE);
    return say(&done) ? 0 : 1;
}

int main(int argc, char **argv) {
    struct stat st;
    if (argc != 5 || fstat(SP_IMPORT_FILE, &st) != 0) {
        fprintf(stderr,
                "splat-import is started by splatd and splatctl; it has no use on its own\n");
        return 2;
    }
    struct job job = { .file = { .fd = SP_IMPORT_FILE,
                                 .size = (uint64_t)st.st_size,
                                 .shown = argv[1],
                                 .root = argv[2],
                                 .folder = argv[3] } };
    struct sp_error err;
    job.start_size = pread(SP_IMPORT_FILE, job.start, sizeof job.start, 0);
    if (!enter_sandbox(&job, atoi(argv[4]), &err))
        return say_error(&err);
    return run(&job);
}
