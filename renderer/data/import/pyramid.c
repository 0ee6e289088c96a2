/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/pyramid.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "base/clock.h"
#include "data/import/child.h"
#include "data/import/input.h"
#include "data/volume/volume.h"

enum {
    READERS_MAX = 4,
    CHUNK_BYTES_MAX = 64 << 20,
    COPIES = 4,        /* of a chunk that a reader has: packed, unpacked, sorted, shared */
    CHUNK_MS = 120000, /* limit of one chunk */
};

/* One process, for one thread at a time. */
struct reader {
    struct pyramid *pyramid;
    struct sp_import_input input;
    struct sp_import_child child;
    void *memory; /* NULL = the process does not run */
    double deadline_ms;
    int limit_ms; /* until then */
    bool (*is_cancelled)(void *user);
    void *user;
};

struct pyramid {
    struct sp_import_place place; /* a copy */
    char importer[PATH_MAX];
    char *field, *allowed;        /* owned; the hosts, NULL = none */
    struct sp_source_parts parts; /* its field is the one above */
    uint32_t step;
    int timeout_ms;
    enum sp_type type;
    struct sp_handover_levels levels;
    uint64_t chunk_bytes;
    unsigned count;
    struct reader readers[READERS_MAX];
};

static bool check(void *user, struct sp_error *err) {
    const struct reader *r = user;
    const char *title = r->pyramid->place.path;
    if (r->is_cancelled && r->is_cancelled(r->user))
        return sp_fail(err, SP_ERR_CANCELLED, title, "loading was cancelled");
    return sp_clock_ms() < r->deadline_ms ||
           sp_fail(err, SP_ERR_TIMEOUT, title,
                   "reading a chunk took longer than the limit of %.3g s", r->limit_ms / 1000.0);
}

static void set_limit(struct reader *r, int ms) {
    r->limit_ms = ms;
    r->deadline_ms = sp_clock_ms() + ms;
}

static void stop_reader(struct reader *r) {
    if (r->memory)
        munmap(r->memory, r->pyramid->chunk_bytes);
    r->memory = NULL;
    sp_import_child_close(&r->child);
    sp_import_input_close(&r->input);
}

/* Receives a message of one kind. */
static bool expect(struct reader *r, enum sp_handover_kind kind, struct sp_handover *message,
                   struct sp_error *err) {
    bool ended;
    if (!sp_import_child_receive(&r->child, message, check, r, &ended, err))
        return ended ? sp_import_child_fail_ended(&r->child, err) : false;
    return message->kind == kind || sp_import_child_refuse(&r->child, message, err);
}

static bool spawn(struct reader *r, struct sp_error *err) {
    struct pyramid *p = r->pyramid;
    if (!sp_import_input_open(&r->input, &p->place, p->importer, p->allowed, err))
        return false;
    const struct sp_import_request request = { .path = p->place.path,
                                               .root = p->place.root,
                                               .folder = r->input.folder,
                                               .pattern = p->place.series,
                                               .parts = &p->parts,
                                               .step = p->step,
                                               .has_step = true,
                                               .mode = SP_IMPORT_CHUNKS };
    r->child = (struct sp_import_child){
        .title = p->place.path, .timeout_ms = p->timeout_ms, .socket = -1, .memory = -1
    };
    const bool ok = sp_import_child_start_reader(&r->child, p->importer, &request, NULL,
                                                 r->input.fds, r->input.count, err);
    sp_import_input_hand_over(&r->input);
    return ok;
}

static uint64_t bytes_of(const struct pyramid *p) {
    struct sp_chunk_source source = { .levels = p->levels.count, .info = { .type = p->type } };
    memcpy(source.level, p->levels.level, sizeof source.level);
    return sp_chunk_bytes_max(&source);
}

/* Starts a process and receives what it has. */
static bool greet(struct reader *r, struct sp_handover_header *header,
                  struct sp_handover_levels *levels, struct sp_error *err) {
    struct sp_handover message;
    if (!spawn(r, err) || !expect(r, SP_HANDOVER_HEADER, &message, err))
        return false;
    *header = message.header;
    if (!expect(r, SP_HANDOVER_LEVELS, &message, err))
        return false;
    *levels = message.levels;
    const bool is_grid = header->kind == SP_KIND_GRID && !header->rectilinear;
    if (!is_grid || header->has_vectors)
        return sp_fail(err, SP_ERR_UNSUPPORTED, r->child.title,
                       "only scalars on evenly spaced axes can be shown from chunks");
    return memcmp(header->dims, levels->level[0].dims, sizeof header->dims) == 0 ||
           sp_fail(err, SP_ERR_CRASHED, r->child.title,
                   "the import process sent levels of another volume");
}

/* Lets the process begin. */
static bool let_go(struct reader *r, struct sp_error *err) {
    const uint64_t bytes = r->pyramid->chunk_bytes;
    if (!sp_import_child_provide(&r->child, bytes, SP_IMPORT_SEALED, err))
        return false;
    void *memory = mmap(NULL, bytes, PROT_READ, MAP_SHARED, r->child.memory, 0);
    if (memory == MAP_FAILED)
        return sp_fail(err, SP_ERR_MEMORY, r->child.title,
                       "cannot map a chunk of %" PRIu64 " bytes: %s", bytes, strerror(errno));
    r->memory = memory;
    return true;
}

static bool start_reader(struct reader *r, struct sp_error *err) {
    struct pyramid *p = r->pyramid;
    struct sp_handover_header header;
    struct sp_handover_levels levels;
    bool ok = greet(r, &header, &levels, err);
    if (ok && (header.type != p->type || levels.count != p->levels.count ||
               memcmp(levels.level, p->levels.level, sizeof levels.level) != 0))
        ok = sp_fail(err, SP_ERR_FORMAT, p->place.path,
                     "its metadata has changed since it was opened; load it again");
    ok = ok && let_go(r, err);
    if (!ok)
        stop_reader(r);
    return ok;
}

static bool ask(struct reader *r, unsigned level, const uint32_t place[3], void *out,
                struct sp_error *err) {
    struct pyramid *p = r->pyramid;
    uint32_t first[3], size[3];
    struct sp_handover message;
    sp_handover_init(&message, SP_HANDOVER_READ);
    message.read.level = level;
    memcpy(message.read.place, place, sizeof message.read.place);
    const struct sp_handover_read asked = message.read;
    if (!sp_import_child_send(&r->child, &message))
        return sp_import_child_fail_ended(&r->child, err);
    if (!expect(r, SP_HANDOVER_CHUNK, &message, err))
        return false;
    if (memcmp(&message.read, &asked, sizeof asked) != 0)
        return sp_fail(err, SP_ERR_CRASHED, r->child.title,
                       "the import process sent another chunk");
    sp_chunk_box(&p->levels.level[level], place, first, size);
    memcpy(out, r->memory, (size_t)size[0] * size[1] * size[2] * sp_type_size(p->type));
    return true;
}

/* A process that has reached its limit of CPU time, or was killed, is started again. */
static bool read_chunk(void *user, unsigned reader, unsigned level, const uint32_t place[3],
                       void *out, bool (*is_cancelled)(void *cancel), void *cancel,
                       struct sp_error *err) {
    struct pyramid *p = user;
    struct reader *r = &p->readers[reader];
    r->is_cancelled = is_cancelled;
    r->user = cancel;
    for (;;) {
        const bool was_running = r->memory != NULL;
        struct sp_error why;
        set_limit(r, CHUNK_MS);
        if ((r->memory || start_reader(r, &why)) && ask(r, level, place, out, &why))
            return true;
        const bool is_gone = why.code == SP_ERR_CRASHED || why.code == SP_ERR_TIMEOUT ||
                             why.code == SP_ERR_CANCELLED;
        if (is_gone)
            stop_reader(r);
        if (!is_gone || !was_running || why.code == SP_ERR_CANCELLED)
            return sp_fail(err, why.code, why.place, "%s", why.text);
    }
}

static void close_pyramid(void *user) {
    struct pyramid *p = user;
    for (unsigned i = 0; i < p->count; i++)
        stop_reader(&p->readers[i]);
    free(p->field);
    free(p->allowed);
    free(p);
}

static bool is_load_cancelled(void *user) {
    const struct sp_load_options *options = user;
    return options->progress && !options->progress(options->user, 0);
}

/* Fewer readers if chunks are large. */
static bool choose_readers(struct pyramid *p, struct sp_error *err) {
    const unsigned threads = sp_volume_threads();
    p->chunk_bytes = bytes_of(p);
    if (p->chunk_bytes > CHUNK_BYTES_MAX)
        return sp_fail(err, SP_ERR_UNSUPPORTED, p->place.path,
                       "a chunk has %" PRIu64 " bytes, more than %d MiB; convert it: splatctl "
                       "convert",
                       p->chunk_bytes, CHUNK_BYTES_MAX >> 20);
    /* A remote host answers several at once, whatever the cores do. */
    p->count = threads < READERS_MAX && !p->place.is_remote ? threads : READERS_MAX;
    while (p->count > 1 && p->count * p->chunk_bytes > CHUNK_BYTES_MAX)
        p->count--;
    return true;
}

bool sp_pyramid_open(const struct sp_pyramid_job *job, struct sp_handover_header *header,
                     struct sp_chunk_source *source, struct sp_error *err) {
    struct pyramid *p = calloc(1, sizeof *p);
    if (!p || !(p->field = strdup(job->parts->field))) {
        free(p);
        return sp_fail(err, SP_ERR_MEMORY, job->place->path, "out of memory");
    }
    if (job->options->allowed_hosts && !(p->allowed = strdup(job->options->allowed_hosts))) {
        free(p->field);
        free(p);
        return sp_fail(err, SP_ERR_MEMORY, job->place->path, "out of memory");
    }
    p->place = *job->place;
    p->parts = *job->parts;
    p->parts.field = p->field;
    p->parts.vectors[0] = 0;
    p->parts.level = -1;
    snprintf(p->importer, sizeof p->importer, "%s", job->importer);
    p->step = job->options->has_step ? job->options->step : 0;
    p->timeout_ms = job->timeout_ms;
    for (unsigned i = 0; i < READERS_MAX; i++) {
        p->readers[i].pyramid = p;
        p->readers[i].child.socket = p->readers[i].child.memory = -1;
        p->readers[i].input.fetch.socket = p->readers[i].input.fetch.memory = -1;
        p->readers[i].input.fds[0] = p->readers[i].input.fds[1] = -1;
    }
    struct reader *first = &p->readers[0];
    first->is_cancelled = is_load_cancelled;
    first->user = (void *)job->options; /* only read */
    set_limit(first, job->timeout_ms);
    bool ok = greet(first, header, &p->levels, err);
    p->type = ok ? (enum sp_type)header->type : SP_UINT8;
    p->count = 1;
    ok = ok && choose_readers(p, err) && let_go(first, err);
    if (!ok) {
        close_pyramid(p);
        return false;
    }
    *source = (struct sp_chunk_source){ .levels = p->levels.count,
                                        .readers = p->count,
                                        .is_remote = p->place.is_remote,
                                        .bytes = p->count * COPIES * p->chunk_bytes,
                                        .user = p,
                                        .read = read_chunk,
                                        .close = close_pyramid };
    memcpy(source->level, p->levels.level, sizeof source->level);
    return true;
}
