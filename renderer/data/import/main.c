/* SPDX-License-Identifier: Apache-2.0
 *
 * splat-import: reads one file on behalf of its parent. handover.h describes their messages,
 * sandbox.h what this process may do, even if the file takes control of it.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "data/import/address.h"
#include "data/import/child.h"
#include "data/import/elements.h"
#include "data/import/format.h"
#include "data/import/handover.h"
#include "data/import/sandbox.h"
#include "data/import/shift.h"
#include "data/import/vectors.h"
#include "data/volume/elements.h"

#if defined(__SANITIZE_THREAD__)
/* TSan does not understand OpenImageIO's spin locks; encode/exr.c has the same suppression. */
__attribute__((visibility("default"))) const char *__tsan_default_suppressions(void);
const char *__tsan_default_suppressions(void) {
    return "called_from_lib:libOpenImageIO_Util.so\n";
}
#endif

struct job {
    struct import_file file;
    uint8_t start[IMPORT_START_BYTES];
    ssize_t start_size; /* < 0 = the file cannot be read */
    const struct import_format *format;
    struct import_header header;
    struct sp_handover_layout layout; /* of the shared memory */
    uint64_t reported;                /* bytes in the last progress message */
    uint64_t folded;                  /* as in struct sp_volume_info */
    struct import_warnings warnings;
    struct import_shift shift;
    bool is_remote; /* remote.h */
    bool serves;    /* chunks, as they are asked for */
    bool lists;     /* series */
};

static bool say(const struct sp_handover *message) {
    size_t size = sp_handover_size((enum sp_handover_kind)message->kind);
    ssize_t sent;
    do
        sent = send(SP_IMPORT_SOCKET, message, size, MSG_NOSIGNAL);
    while (sent < 0 && errno == EINTR);
    return sent == (ssize_t)size;
}

/* Some libraries explain nothing, or name the file as this process opens it. */
static int say_error(const struct sp_error *err) {
    struct sp_handover message;
    struct sp_handover_error *error = &message.error;
    sp_handover_init(&message, SP_HANDOVER_ERROR);
    error->code = err->code;
    memcpy(error->place, err->place, sizeof err->place);
    memcpy(error->text, err->text, sizeof err->text);
    if (!error->text[0])
        snprintf(error->text, sizeof error->text,
                 "the library that reads this format tells no cause; the file may be damaged, cut "
                 "off, or of a kind that it does not read");
    import_hide_descriptors(error->text);
    import_hide_descriptors(error->place);
    say(&message);
    return 1;
}

/* Enters the sandbox, where only the root folder is readable; for formats that may need a module,
 * also the folders of libraries. */
static bool enter_sandbox(const struct job *job, int cpu_seconds, struct sp_error *err) {
    enum { FOLDERS = 32 };
    char own[PATH_MAX],
        *libraries = strdup(getenv("LD_LIBRARY_PATH") ? getenv("LD_LIBRARY_PATH") : ""),
        *rest = NULL;
    const char *readable[FOLDERS + 1] = { job->file.root };
    const size_t size = job->start_size > 0 ? (size_t)job->start_size : 0;
    if (job->is_remote || job->file.is_folder ||
        import_format_needs_module(job->start, size, job->file.title)) {
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
    const struct import_sandbox sandbox = { .cpu_seconds = cpu_seconds < 1 ? 1 : cpu_seconds,
                                            .first_fd = SP_IMPORT_FILE + 1 + job->is_remote,
                                            .readable = readable };
    bool ok = libraries ? import_sandbox_enter(&sandbox, job->file.title, err)
                        : sp_fail(err, SP_ERR_MEMORY, job->file.title, "out of memory");
    free(libraries);
    return ok;
}

static const struct import_format *find_format(const struct job *job, struct sp_error *err) {
    const struct import_file *file = &job->file;
    if (job->is_remote)
        return &import_zarr_remote;
    if (job->file.is_folder)
        return &import_folder;
    if (job->start_size < 0) {
        sp_fail(err, SP_ERR_IO, file->title,
                "cannot read the file: the file became shorter, or its disk or network fails");
        return NULL;
    }
    return *file->pattern
               ? &import_series
               : import_format_find(job->start, (size_t)job->start_size, file->title, err);
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

/* Of open(). */
static void report_opening(void *user, uint64_t bytes_done) {
    struct job *job = user;
    const uint64_t size = job->file.size;
    if (bytes_done < job->reported + size / 100 || bytes_done > size)
        return;
    job->reported = bytes_done;
    struct sp_handover message;
    sp_handover_init(&message, SP_HANDOVER_OPENING);
    message.share = (double)bytes_done / (double)size;
    if (!say(&message)) /* the parent closed the socket */
        exit(1);
}

/* Sends one message per percent, so that progress costs nothing. It never goes back, even where a
 * search among the points starts again. */
static void report(void *user, uint64_t bytes_done) {
    struct job *job = user;
    if (bytes_done < job->reported + job->layout.bytes / 100)
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
    message.header.kind = h->elements.kind;
    message.header.count = h->elements.count;
    message.header.vertex_count = h->elements.vertex_count;
    message.header.degree = h->elements.degree;
    message.header.lacks_colors = h->elements.lacks_colors;
    message.header.has_vectors = h->has_vectors;
    message.header.level = h->level;
    message.header.level_count = h->level_count;
    message.header.steps = h->steps.count;
    message.header.step = h->steps.index;
    message.header.has_times = h->steps.times || h->steps.interval > 0;
    memcpy(message.header.time_unit, h->steps.unit, sizeof h->steps.unit);
    message.header.bytes = h->bytes;
    memcpy(message.header.unit, h->unit, sizeof h->unit);
    message.header.vertical = h->vertical;
    memcpy(message.header.anatomy, h->anatomy, sizeof h->anatomy);
    message.header.meaning = h->meaning;
    memcpy(message.header.value_name, h->value_name, sizeof h->value_name);
    memcpy(message.header.vector_name, h->vector_name, sizeof h->vector_name);
    memcpy(message.header.value_unit, h->value_unit, sizeof h->value_unit);
    memcpy(message.header.others, h->others, sizeof h->others);
    memcpy(message.header.other_vectors, h->other_vectors, sizeof h->other_vectors);
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

static void write_times(const struct job *job, char *memory) {
    const struct import_steps *steps = &job->header.steps;
    double *times = (double *)(void *)(memory + job->layout.times_at);
    for (uint32_t i = 0; job->layout.times_at && i < steps->count; i++)
        times[i] = steps->times ? steps->times[i] : steps->first + i * steps->interval;
}

static bool read_elements(struct job *job, void *reader, char *memory, struct sp_error *err) {
    const struct import_progress progress = { .report = report, .user = job };
    const struct sp_elements elements = sp_elements_at(&job->header.elements, memory);
    const size_t count = elements.triangles ? elements.shape.vertex_count : elements.shape.count;
    bool ok = job->format->read_elements(reader, &elements, &progress, err);
    while (ok && import_shift_choose(&job->shift, elements.positions, sizeof *elements.positions,
                                     count)) {
        memset(memory, 0, sp_elements_bytes(&job->header.elements));
        ok = job->format->read_elements(reader, &elements, &progress, err);
    }
    *(float *)(void *)memory = NAN; /* the only sample */
    import_shift_warn(&job->file);
    return ok && import_elements_finish(&job->file, &job->header, &elements, &progress,
                                        &job->folded, err);
}

/* Fills the shared memory. */
static bool read_all(struct job *job, void *reader, char *memory, struct sp_error *err) {
    const struct import_progress progress = { .report = report, .user = job };
    uint64_t at = job->layout.vectors_at;
    float(*vectors)[3] = at ? (float(*)[3])(void *)(memory + at) : NULL;
    write_times(job, memory);
    if (job->header.elements.kind != SP_KIND_GRID)
        return read_elements(job, reader, memory, err);
    copy_coordinates(job, memory);
    if (!job->format->read(reader, memory, vectors, &progress, err))
        return false;
    if (vectors) {
        const uint32_t *dims = job->header.grid.dims;
        import_vectors_finish(&job->header, vectors, memory);
        import_vectors_warn(&job->file, (const float(*)[3])vectors,
                            (uint64_t)dims[0] * dims[1] * dims[2]);
    }
    return true;
}

/* Writes ", NAME" for each name of a list. */
static void list_names(const char (*names)[SP_FIELD_BYTES], int count, bool has_more, char *list,
                       size_t size) {
    struct import_list out;
    list[0] = 0;
    import_list_begin(&out, list, size);
    for (int i = 0; i < count && names[i][0]; i++)
        import_list_add(&out, ", ", names[i]);
    import_list_end(&out, has_more);
}

/* Not every reader chooses among fields. */
static bool check_field(const struct job *job, struct sp_error *err) {
    const struct import_header *h = &job->header;
    const char *vectors = job->file.vectors;
    char list[200], wanted[SP_FIELD_BYTES];
    import_name(wanted, job->file.field);
    if (*vectors && strcmp(vectors, h->vector_name) != 0) {
        list_names((const char(*)[SP_FIELD_BYTES])h->other_vectors, SP_OTHER_VECTORS_MAX,
                   h->has_more, list, sizeof list);
        return sp_fail(err, SP_ERR_NOT_FOUND, job->file.title,
                       "there are no vectors \"%.60s\"; the file has %.60s%s", vectors,
                       h->vector_name[0] ? h->vector_name : "none of a name", list);
    }
    list_names((const char(*)[SP_FIELD_BYTES])h->others, SP_OTHER_FIELDS_MAX, h->has_more, list,
               sizeof list);
    return !*wanted || strcmp(wanted, h->value_name) == 0 ||
           sp_fail(err, SP_ERR_NOT_FOUND, job->file.title,
                   "there is no field \"%.60s\" of scalars; the file has %.60s%s", wanted,
                   h->value_name[0] ? h->value_name : "one without a name", list);
}

/* The chunk that was asked for; false if the parent closed the socket. */
static bool await_read(struct sp_handover *read) {
    ssize_t n;
    do
        n = recv(SP_IMPORT_SOCKET, read, sizeof *read, 0);
    while (n < 0 && errno == EINTR);
    return n == (ssize_t)sp_handover_size(SP_HANDOVER_READ) && read->magic == SP_HANDOVER_MAGIC &&
           read->kind == SP_HANDOVER_READ;
}

/* Reads chunks into the shared memory, as they are asked for, until the parent closes the socket.
 */
static int read_chunks(struct job *job, void *reader, const struct sp_handover_levels *levels) {
    const size_t capacity = job->layout.bytes;
    struct sp_handover message;
    struct sp_error err;
    void *memory = mmap(NULL, capacity, PROT_READ | PROT_WRITE, MAP_SHARED, SP_IMPORT_MEMORY, 0);
    if (memory == MAP_FAILED) {
        sp_fail(&err, SP_ERR_MEMORY, job->file.title, "cannot use the memory for the samples: %s",
                strerror(errno));
        return say_error(&err);
    }
    while (await_read(&message)) {
        const struct sp_handover_read read = message.read;
        if (read.level >= levels->count)
            break;
        if (!job->format->read_chunk(reader, read.level, read.place, memory, &err)) {
            say_error(&err);
            continue;
        }
        sp_handover_init(&message, SP_HANDOVER_CHUNK);
        message.read = read;
        say(&message);
    }
    munmap(memory, capacity);
    return 0;
}

/* The other way: the volume is shown from its chunks. */
static int serve(struct job *job, void *reader) {
    struct sp_handover message;
    struct sp_error err;
    sp_handover_init(&message, SP_HANDOVER_LEVELS);
    struct sp_handover_levels *levels = &message.levels;
    if (job->format->levels)
        levels->count = job->format->levels(reader, levels->level, BRICK_LEVELS_MAX);
    if (!levels->count) {
        sp_fail(&err, SP_ERR_UNSUPPORTED, job->file.title,
                "this file is not stored in chunks, so it is loaded as a whole only");
        return say_error(&err);
    }
    struct sp_chunk_source source = { .levels = levels->count,
                                      .info = { .type = job->header.type } };
    memcpy(source.level, levels->level, sizeof source.level);
    const struct sp_handover_levels copy = *levels;
    if (!say_header(job) || !say(&message))
        return 0;
    job->layout.bytes = sp_chunk_bytes_max(&source);
    if (!await_go(job))
        return 0;
    if (!import_sandbox_allow_samples(job->layout.bytes, job->file.title, &err))
        return say_error(&err);
    return read_chunks(job, reader, &copy);
}

/* Keeps the holes of a sparse file: without this advice a write to one page allocates its
 * neighbours as well, because the kernel reads them ahead as one large folio. */
static void keep_holes(void *memory, size_t capacity) {
    struct stat st;
    if (fstat(SP_IMPORT_MEMORY, &st) == 0 && st.st_blocks * 512 < st.st_size)
        madvise(memory, capacity, MADV_RANDOM);
}

static int say_done(const struct job *job) {
    struct sp_handover done;
    sp_handover_init(&done, SP_HANDOVER_DONE);
    done.done.folded = job->folded;
    memcpy(done.done.warnings, job->warnings.texts, sizeof done.done.warnings);
    return say(&done) ? 0 : 1;
}

/* Lists the series of the folder; none if it has no known format. */
static int list_series(struct job *job) {
    struct sp_handover message;
    struct sp_error err;
    struct import_series_list list = { .items = calloc(SP_SERIES_MAX, sizeof *list.items) };
    const struct import_format *format = find_format(job, &err);
    bool ok = list.items || sp_fail(&err, SP_ERR_MEMORY, job->file.title, "out of memory");
    if (ok && format && format->list)
        ok = format->list(&job->file, &list, &err);
    for (uint32_t i = 0; ok && i < list.count; i++) {
        sp_handover_init(&message, SP_HANDOVER_SERIES);
        message.series = list.items[i];
        if (!say(&message)) /* the parent closed the socket */
            exit(1);
    }
    free(list.items);
    return ok ? say_done(job) : say_error(&err);
}

static int run(struct job *job) {
    struct sp_error err;
    struct import_header *header = &job->header;
    const struct import_progress opening = { .report = report_opening, .user = job };
    job->format = find_format(job, &err);
    job->file.opening = job->serves ? NULL : &opening;
    void *reader = job->format ? import_format_open(job->format, &job->file, header, &err) : NULL;
    job->file.opening = NULL;
    job->reported = 0;
    if (!reader)
        return say_error(&err);
    const bool has_step =
        header->steps.count > 0 || import_header_use_steps(header, &job->file, 1, &err);
    if (!has_step || !import_header_use_selection(header, &job->file, &err) ||
        !check_field(job, &err)) {
        import_format_close(job->format, reader);
        return say_error(&err);
    }
    if (header->has_more)
        import_warn(job->file.warnings,
                    "The file has more fields than are listed, at most %d of scalars and %d of "
                    "vectors; ?field=NAME and ?vectors=NAME read any of them.",
                    SP_OTHER_FIELDS_MAX, SP_OTHER_VECTORS_MAX);
    if (job->serves) {
        const int status = serve(job, reader);
        import_format_close(job->format, reader);
        return status;
    }
    if (!say_header(job) || !await_go(job)) {
        import_format_close(job->format, reader);
        return 0; /* the parent refused or is gone: not our failure */
    }
    if (!import_sandbox_allow_samples(job->layout.bytes, job->file.title, &err)) {
        import_format_close(job->format, reader);
        return say_error(&err);
    }
    size_t capacity = job->layout.bytes;
    void *memory = mmap(NULL, capacity, PROT_READ | PROT_WRITE, MAP_SHARED, SP_IMPORT_MEMORY, 0);
    bool ok = memory != MAP_FAILED;
    if (ok) {
        keep_holes(memory, capacity);
        ok = read_all(job, reader, memory, &err);
        munmap(memory, capacity);
    } else {
        sp_fail(&err, SP_ERR_MEMORY, job->file.title, "cannot use the memory for the samples: %s",
                strerror(errno));
    }
    import_format_close(job->format, reader);
    if (!ok)
        return say_error(&err);
    return say_done(job);
}

int main(int argc, char **argv) {
    struct stat st;
    if (argc != SP_ARGUMENT_COUNT || fstat(SP_IMPORT_FILE, &st) != 0) {
        fprintf(stderr,
                "splat-import is started by splatd and splatctl; it has no use on its own\n");
        return 2;
    }
    struct job job = { .file = { .fd = SP_IMPORT_FILE,
                                 .size = (uint64_t)st.st_size,
                                 .title = argv[SP_ARGUMENT_PATH],
                                 .root = argv[SP_ARGUMENT_ROOT],
                                 .folder = argv[SP_ARGUMENT_FOLDER],
                                 .pattern = argv[SP_ARGUMENT_PATTERN],
                                 .step = (uint32_t)strtoul(argv[SP_ARGUMENT_STEP], NULL, 10),
                                 .has_step = argv[SP_ARGUMENT_STEP][0] != 0,
                                 .level = atoi(argv[SP_ARGUMENT_LEVEL]),
                                 .selection = { .series = argv[SP_ARGUMENT_SERIES],
                                                .unit = argv[SP_ARGUMENT_UNIT] },
                                 .vectors = argv[SP_ARGUMENT_VECTORS],
                                 .field = argv[SP_ARGUMENT_FIELD] },
                       .serves = strcmp(argv[SP_ARGUMENT_MODE], SP_IMPORT_CHUNKS) == 0,
                       .lists = strcmp(argv[SP_ARGUMENT_MODE], SP_IMPORT_LIST) == 0 };
    struct sp_error err;
    job.file.warnings = &job.warnings;
    job.file.shift = &job.shift;
    job.is_remote = sp_address_is_remote(argv[SP_ARGUMENT_PATH]);
    job.file.is_folder = S_ISDIR(st.st_mode);
    job.start_size = pread(SP_IMPORT_FILE, job.start, sizeof job.start, 0);
    if (!import_as_parse(argv[SP_ARGUMENT_AS], &job.file.selection.as, job.file.title, &err) ||
        !import_unit_check(job.file.selection.unit, job.file.title, &err) ||
        !enter_sandbox(&job, atoi(argv[SP_ARGUMENT_CPU_SECONDS]), &err))
        return say_error(&err);
    return job.lists ? list_series(&job) : run(&job);
}
