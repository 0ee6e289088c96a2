/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/launch.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/transfer.h"
#include "data/bricks/store.h"
#include "data/bricks/unpack.h"
#include "data/import/child.h"
#include "data/import/confine.h"
#include "data/import/handover.h"
#include "data/import/input.h"
#include "data/import/numbered.h"
#include "data/import/place.h"
#include "data/import/pyramid.h"
#include "data/volume/volume.h"

enum { TIMEOUT_DEFAULT_MS = 300000 };

/* The progress at the end of two steps: opening the file, if that reads all of it, and reading the
 * samples. Range and histogram take the rest. */
static const double OPENED = 0.1, READ = 0.95;

struct import {
    const char *source;           /* as the caller gave it */
    struct sp_source_parts parts; /* of the source; its level may become coarser */
    bool is_coarser;              /* there was no memory for a finer level */
    struct sp_import_place place;
    const struct sp_load_options *options;
    char importer[PATH_MAX];
    const char *scratch; /* folder of a file that takes the place of memory; NULL = none */
    bool has_holes;      /* the source is a sparse file, so is the file in place of memory */
    struct sp_import_input input;
    struct sp_import_child child;
    bool refuses_axes; /* that are rectilinear */
    int timeout_ms;
    double deadline_ms;
    struct sp_handover_header header;
    struct sp_handover_layout layout; /* of the memory */
    double opened;                    /* share of the file that was read to open it */
    uint64_t done;                    /* bytes that the child reports as read */
    struct sp_handover_done end;
};

/* Before the child starts. */

static bool find_importer(struct import *im, struct sp_error *err) {
    return sp_import_find_program("splat-import", im->options->importer, im->importer, err);
}

static bool is_sparse(int file) {
    struct stat st;
    return fstat(file, &st) == 0 && S_ISREG(st.st_mode) && st.st_blocks * 512 < st.st_size;
}

static bool start_child(struct import *im, struct sp_error *err) {
    const struct sp_import_request request = { .path = im->place.path,
                                               .root = im->place.root,
                                               .folder = im->input.folder,
                                               .pattern = im->place.series,
                                               .parts = &im->parts,
                                               .step = im->options->step,
                                               .has_step = im->options->has_step,
                                               .mode = "" };
    im->has_holes = is_sparse(im->input.fds[0]);
    im->child = (struct sp_import_child){ .title = im->place.path, .timeout_ms = im->timeout_ms };
    const bool ok = sp_import_child_start_reader(&im->child, im->importer, &request, im->scratch,
                                                 im->input.fds, im->input.count, err);
    sp_import_input_hand_over(&im->input);
    return ok;
}

/* Cancellation comes before the timeout: callers rely on it. */
static bool check_in(void *user, struct sp_error *err) {
    const struct import *im = user;
    if (im->options->progress) {
        const uint64_t bytes = im->layout.bytes;
        const double opened = OPENED * im->opened;
        const double read = bytes ? (double)im->done / (double)bytes : 0;
        const double fraction = opened + (READ - opened) * read;
        if (!im->options->progress(im->options->user, fraction))
            return sp_fail(err, SP_ERR_CANCELLED, im->place.path, "loading was cancelled");
    }
    if (sp_clock_ms() >= im->deadline_ms)
        return sp_fail(err, SP_ERR_TIMEOUT, im->place.path,
                       "the import process took longer than the timeout of %d ms", im->timeout_ms);
    return true;
}

/* Receives and checks the next message. False with *err set if there is none, or with *ended if the
 * child closed its end. */
static bool receive(struct import *im, struct sp_handover *message, bool *ended,
                    struct sp_error *err) {
    return sp_import_child_receive(&im->child, message, check_in, im, ended, err);
}

/* The two phases. */

static bool receive_header(struct import *im, struct sp_error *err) {
    struct sp_handover message;
    bool ended;
    do {
        if (!receive(im, &message, &ended, err))
            return ended ? sp_import_child_fail_ended(&im->child, err) : false;
        if (message.kind == SP_HANDOVER_OPENING && message.share > im->opened)
            im->opened = message.share;
    } while (message.kind == SP_HANDOVER_OPENING);
    if (message.kind != SP_HANDOVER_HEADER)
        return sp_import_child_refuse(&im->child, &message, err);
    im->header = message.header;
    im->layout = sp_handover_layout(&im->header);
    return !im->refuses_axes || sp_grid_require_even(im->header.rectilinear != 0, im->source, err);
}

static bool provide_memory(struct import *im, struct sp_error *err) {
    const uint64_t bytes = im->layout.bytes;
    const enum sp_import_memory memory = !im->scratch    ? SP_IMPORT_SEALED
                                         : im->has_holes ? SP_IMPORT_SPARSE
                                                         : SP_IMPORT_SCRATCH;
    return (!im->options->reserve || im->options->reserve(im->options->user, bytes, err)) &&
           sp_import_child_provide(&im->child, bytes, memory, err);
}

static bool await_samples(struct import *im, struct sp_error *err) {
    struct sp_handover message;
    bool ended, done = false;
    for (;;) {
        if (!receive(im, &message, &ended, err)) {
            if (!ended)
                return false;
            if (!done)
                return sp_import_child_fail_ended(&im->child, err);
            int status = sp_import_child_reap(&im->child);
            return status == 0 ||
                   sp_fail(err, SP_ERR_CRASHED, im->place.path,
                           "the import process failed after its last message (status %d)", status);
        }
        if (done)
            return sp_import_child_refuse(&im->child, &message, err);
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
        default:
            return sp_import_child_refuse(&im->child, &message, err);
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
    append_word(info->name, im->parts.series);
    append_word(info->name, im->parts.field);
    append_word(info->name, im->parts.vectors);
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
static struct sp_volume *adopt_samples(const struct import *im, struct sp_error *err) {
    if (fcntl(im->child.memory, F_ADD_SEALS, F_SEAL_WRITE | F_SEAL_SEAL) != 0) {
        sp_fail(err, SP_ERR_CRASHED, im->place.path,
                "the import process still maps the samples: %s", strerror(errno));
        return NULL;
    }
    size_t bytes = (size_t)im->layout.bytes;
    void *voxels = mmap(NULL, bytes, PROT_READ, MAP_SHARED, im->child.memory, 0);
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
    sp_import_child_close(&im->child);
    sp_import_input_close(&im->input);
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
    im->parts = parts;
    im->options = options ? options : &none;
    im->input.fds[0] = im->input.fds[1] = im->input.fetch.socket = im->input.fetch.memory = -1;
    im->child.memory = im->child.socket = -1;
    assert(im->options->timeout_ms >= 0);
    im->timeout_ms = im->options->timeout_ms ? im->options->timeout_ms : TIMEOUT_DEFAULT_MS;
    im->deadline_ms = sp_clock_ms() + im->timeout_ms;
    im->scratch = scratch;
    return im;
}

/* Everything until the child has ended and the memory is filled. */
static bool attempt(struct import *im, struct sp_error *err) {
    im->header.level_count = 0;
    im->child.memory = im->child.socket = -1;
    return sp_import_input_open(&im->input, &im->place, im->importer, im->options->allowed_hosts,
                                err) &&
           start_child(im, err) && receive_header(im, err) && provide_memory(im, err) &&
           await_samples(im, err);
}

/* If the caller leaves the level open, the finest one that gets its memory is loaded. *why: why a
 * finer one was not read. */
static bool read_coarser(struct import *im, struct sp_error *why) {
    const bool is_open = im->parts.level < 0 && !im->options->is_finest;
    bool ok = false;
    while (!ok && is_open && why->code == SP_ERR_BUDGET &&
           im->header.level + 1 < im->header.level_count) {
        im->parts.level = (int)im->header.level + 1;
        im->is_coarser = true;
        finish(im);
        ok = attempt(im, why);
    }
    return ok;
}

static bool resolve_source(struct import *im, struct sp_error *err) {
    return sp_import_place_resolve(&im->place, im->options->root, err) && find_importer(im, err);
}

/* Opens a brick file, which this process reads and checks (data/bricks/README.md). -1 = it is none.
 */
static int open_bricks(const struct import *im) {
    char real[PATH_MAX];
    uint64_t size;
    if (im->place.is_remote)
        return -1;
    int file = sp_open_confined(im->place.root, im->place.file, im->place.path, real, &size, NULL);
    if (file >= 0 && !sp_brick_file_is(file)) {
        close(file);
        file = -1;
    }
    return file;
}

/* Shows the volume from its chunks (pyramid.h) if it is remote, or if it has several levels, the
 * source names none, and the finest one does not fit. NULL with *err set: after SP_ERR_BUDGET and
 * SP_ERR_UNSUPPORTED the caller tries other ways. */
static struct sp_volume *open_chunks(struct import *im, const struct sp_error *why,
                                     struct sp_error *err) {
    struct sp_chunk_source chunks;
    *err = *why;
    if (im->parts.level >= 0 || im->scratch ||
        !(im->place.is_remote || (why->code == SP_ERR_BUDGET && im->header.level_count > 1)))
        return NULL;
    const struct sp_pyramid_job job = { .place = &im->place,
                                        .importer = im->importer,
                                        .parts = &im->parts,
                                        .options = im->options,
                                        .timeout_ms = im->timeout_ms };
    finish(im);
    if (!sp_pyramid_open(&job, &im->header, &chunks, err))
        return NULL;
    describe(im, &chunks.info);
    struct sp_load_options rest = *im->options;
    rest.timeout_ms = (int)fmax(im->deadline_ms - sp_clock_ms(), 1);
    return sp_brick_store_open_chunks(&chunks, chunks.info.name, im->source, &rest, err);
}

static bool is_no_way(enum sp_code code) {
    return code == SP_ERR_BUDGET || code == SP_ERR_UNSUPPORTED;
}

/* Reads all samples, or opens the volume for reading its chunks. Remote volumes are opened for
 * their chunks first; others only if they do not fit into memory. */
static struct sp_volume *read_or_open(struct import *im, struct sp_error *err) {
    struct sp_error why = { .code = SP_ERR_BUDGET }, other = why;
    struct sp_volume *volume = im->place.is_remote ? open_chunks(im, &why, &other) : NULL;
    if (volume)
        return volume;
    if (is_no_way(other.code)) {
        if (attempt(im, &why))
            return adopt_samples(im, err);
        if (!im->place.is_remote && (volume = open_chunks(im, &why, &other)))
            return volume;
    }
    if (!is_no_way(other.code))
        why = other;
    else if (why.code == SP_ERR_BUDGET && read_coarser(im, &why))
        return adopt_samples(im, err);
    if (err)
        *err = why;
    return NULL;
}

struct sp_volume *sp_import(const char *source, const struct sp_load_options *options,
                            struct sp_error *err) {
    struct sp_volume *volume = NULL;
    struct import *im = create(source, options, NULL, err);
    if (!im)
        return NULL;
    const bool is_found = resolve_source(im, err);
    const char *query = source + sp_source_split(source).path_bytes;
    if (!is_found && err && err->code == SP_ERR_NOT_FOUND && *query == '?') {
        const size_t used = strlen(err->text);
        snprintf(err->text + used, sizeof err->text - used,
                 "; \"%.60s\" was read as a choice: rename a file that is called so", query);
    }
    const int bricks = is_found ? open_bricks(im) : -1;
    if (bricks >= 0)
        volume = sp_brick_store_open(bricks, im->place.name, im->source, im->options, err);
    else if (is_found)
        volume = read_or_open(im, err);
    if (volume && im->options->progress)
        im->options->progress(im->options->user, 1);
    finish(im);
    free(im);
    return volume;
}

/* Copies `count` numbers from the file of samples, and moves the place where more go. */
static const double *copy_numbers(const struct import *im, uint64_t at, uint32_t count,
                                  double **next) {
    double *numbers = *next;
    *next += count;
    return sp_read_at(im->child.memory, numbers, count * sizeof *numbers, at) ? numbers : NULL;
}

/* Copies the coordinates of rectilinear axes, and the times of the series. */
static bool copy_axes(const struct import *im, struct sp_volume_info *info, double **numbers,
                      struct sp_error *err) {
    const size_t count = sp_grid_axes_max(&info->grid) + info->steps.count;
    double *next = *numbers = malloc(count * sizeof *next);
    if (!next)
        return sp_fail(err, SP_ERR_MEMORY, im->place.path, "out of memory for axes and times");
    bool ok = true;
    for (int a = 0; ok && a < 3; a++)
        if (im->header.rectilinear >> a & 1) {
            info->grid.coordinates[a] =
                copy_numbers(im, im->layout.coordinates_at[a], info->grid.dims[a], &next);
            ok = info->grid.coordinates[a] != NULL;
        }
    if (ok && im->layout.times_at) {
        info->steps.times = copy_numbers(im, im->layout.times_at, info->steps.count, &next);
        ok = info->steps.times && are_finite(info->steps.times, info->steps.count);
    }
    return ok || sp_fail(err, SP_ERR_CRASHED, im->place.path,
                         "the import process sent axes or times that are no numbers");
}

/* Describes the samples in the file. The child has ended, so the file does not change any more. */
static bool describe_samples(const struct import *im, struct sp_volume_info *info, double **numbers,
                             struct sp_error *err) {
    struct sp_error why;
    struct stat st;
    uint64_t samples;
    describe(im, info);
    if (info->elements.kind != SP_KIND_GRID)
        return sp_fail(err, SP_ERR_UNSUPPORTED, im->place.path,
                       "only grids of samples can be converted, and this volume has %s",
                       sp_kind_name(info->elements.kind));
    if (fstat(im->child.memory, &st) != 0 || (uint64_t)st.st_size < im->layout.bytes)
        return sp_fail(err, SP_ERR_CRASHED, im->place.path, "the import process cut the samples");
    if (!copy_axes(im, info, numbers, err))
        return false;
    if (!sp_grid_check(&info->grid, info->type, im->place.path, &samples, &why))
        return sp_fail(err, SP_ERR_CRASHED, im->place.path,
                       "the import process sent a bad grid: %s", why.text);
    if (im->layout.vectors_at)
        info->vector_bytes = samples / sp_type_size(info->type) * 3 * sizeof(float);
    return true;
}

int sp_import_samples(const char *source, const struct sp_load_options *options, const char *folder,
                      bool keeps_axes, struct sp_volume_info *info, double **numbers,
                      struct sp_error *err) {
    struct import *im = create(source, options, folder, err);
    int samples = -1;
    *numbers = NULL;
    if (!im)
        return -1;
    im->refuses_axes = !keeps_axes;
    const bool is_found = resolve_source(im, err);
    const int bricks = is_found ? open_bricks(im) : -1;
    if (bricks >= 0) {
        samples = sp_bricks_unpack(bricks, im->place.path, folder, keeps_axes, im->options, info,
                                   numbers, err);
        if (samples >= 0)
            snprintf(info->name, sizeof info->name, "%s", im->place.name);
    } else if (is_found && attempt(im, err) && describe_samples(im, info, numbers, err)) {
        samples = im->child.memory;
        im->child.memory = -1;
    }
    if (samples < 0) {
        free(*numbers);
        *numbers = NULL;
    }
    finish(im);
    free(im);
    return samples;
}
