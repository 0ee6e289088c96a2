/* SPDX-License-Identifier: Apache-2.0
 *
 * Replaces splat-import and misbehaves like an importer that a malicious file has taken over. The
 * name of the file selects the behaviour.
 */
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include "data/import/child.h"
#include "data/import/handover.h"

enum { BYTES = 8 * 8 * 8 };

static void send_message(const struct sp_handover *message) {
    size_t size = sp_handover_size((enum sp_handover_kind)message->kind);
    if (send(SP_IMPORT_SOCKET, message, size, MSG_NOSIGNAL) < 0)
        _exit(9);
}

static void send_kind(enum sp_handover_kind kind) {
    struct sp_handover message;
    sp_handover_init(&message, kind);
    send_message(&message);
}

static struct sp_handover valid_header(void) {
    struct sp_handover m;
    sp_handover_init(&m, SP_HANDOVER_HEADER);
    m.header.steps = 1;
    m.header.type = SP_UINT8;
    m.header.bytes = BYTES;
    for (int i = 0; i < 3; i++) {
        m.header.dims[i] = 8;
        m.header.spacing[i] = 1;
        m.header.direction[i][i] = 1;
    }
    return m;
}

static void await_go(void) {
    struct sp_handover go;
    if (recv(SP_IMPORT_SOCKET, &go, sizeof go, 0) <= 0)
        _exit(0);
}

static unsigned char *map(void) {
    unsigned char *p = mmap(NULL, BYTES, PROT_READ | PROT_WRITE, MAP_SHARED, SP_IMPORT_MEMORY, 0);
    if (p == MAP_FAILED)
        _exit(8);
    return p;
}

static void wait_for_ever(void) {
    for (;;)
        pause();
}

static bool misbehave_before_header(const char *what) {
    if (strcmp(what, "abort") == 0) {
        signal(SIGABRT, SIG_DFL);
        abort();
    } else if (strcmp(what, "segv") == 0) {
        signal(SIGSEGV, SIG_DFL);
        raise(SIGSEGV);
    } else if (strcmp(what, "quit") == 0) {
        _exit(7);
    } else if (strcmp(what, "hang") == 0) {
        wait_for_ever();
    } else if (strcmp(what, "spin") == 0) {
        for (volatile unsigned long i = 0;; i++)
            ;
    } else if (strcmp(what, "rubbish") == 0) {
        send(SP_IMPORT_SOCKET, "hello, I am a reader", 20, MSG_NOSIGNAL);
    } else if (strcmp(what, "short") == 0) {
        send(SP_IMPORT_SOCKET, "x", 1, MSG_NOSIGNAL);
    } else if (strcmp(what, "long") == 0) {
        static const char zeros[4096];
        send(SP_IMPORT_SOCKET, zeros, sizeof zeros, MSG_NOSIGNAL);
    } else if (strcmp(what, "done-first") == 0) {
        send_kind(SP_HANDOVER_DONE);
    } else if (strcmp(what, "progress-first") == 0) {
        send_kind(SP_HANDOVER_PROGRESS);
    } else if (strcmp(what, "closed") == 0) {
        close(SP_IMPORT_SOCKET);
        wait_for_ever();
    } else if (strcmp(what, "error-code") == 0) {
        struct sp_handover m;
        sp_handover_init(&m, SP_HANDOVER_ERROR);
        m.error.code = 999;
        send_message(&m);
    } else if (strcmp(what, "error-ok") == 0) {
        send_kind(SP_HANDOVER_ERROR); /* code SP_OK */
    } else if (strcmp(what, "error-endless") == 0) {
        struct sp_handover m;
        sp_handover_init(&m, SP_HANDOVER_ERROR);
        m.error.code = SP_ERR_FORMAT;
        memset(m.error.text, 'x', sizeof m.error.text);
        send_message(&m);
    } else if (strcmp(what, "error-escape") == 0) {
        struct sp_handover m;
        sp_handover_init(&m, SP_HANDOVER_ERROR);
        m.error.code = SP_ERR_FORMAT;
        snprintf(m.error.text, sizeof m.error.text, "bad\n\033[2Jfile");
        send_message(&m);
    } else {
        return false;
    }
    return true;
}

static bool set_elements(const char *what, struct sp_handover_header *h) {
    if (strcmp(what, "kind") == 0)
        h->kind = SP_KIND_COUNT;
    else if (strcmp(what, "degree") == 0)
        h->kind = SP_KIND_POINTS, h->degree = 1;
    else if (strcmp(what, "colors") == 0)
        h->kind = SP_KIND_MESH, h->lacks_colors = 2;
    else if (strcmp(what, "elements") == 0)
        h->kind = SP_KIND_GAUSSIANS;
    else
        return false;
    return true;
}

static bool damage_header(const char *what, struct sp_handover *m) {
    struct sp_handover_header *h = &m->header;
    if (strcmp(what, "version") == 0)
        m->version = 77;
    else if (strcmp(what, "magic") == 0)
        m->magic = 0;
    else if (strcmp(what, "type") == 0)
        h->type = 12;
    else if (strcmp(what, "zero") == 0)
        h->dims[1] = 0;
    else if (strcmp(what, "huge") == 0)
        h->dims[0] = h->dims[1] = h->dims[2] = 0xffffffff;
    else if (strcmp(what, "wrap") == 0) /* 2^48 voxels, whose size would be 2^51 */
        h->dims[0] = h->dims[1] = h->dims[2] = 65536;
    else if (strcmp(what, "bytes-more") == 0)
        h->bytes = BYTES + 1;
    else if (strcmp(what, "bytes-less") == 0)
        h->bytes = 1;
    else if (strcmp(what, "spacing") == 0)
        h->spacing[2] = NAN;
    else if (strcmp(what, "origin") == 0)
        h->origin[0] = INFINITY;
    else if (strcmp(what, "direction") == 0)
        memset(h->direction, 0, sizeof h->direction);
    else if (strcmp(what, "axes") == 0)
        h->rectilinear = 8;
    else if (strcmp(what, "anatomy") == 0)
        memcpy(h->anatomy, "LRS", 4);
    else if (strcmp(what, "vertical") == 0)
        h->vertical.per_unit = NAN;
    else if (strcmp(what, "vertical unit") == 0)
        memset(h->vertical.unit, 'm', sizeof h->vertical.unit);
    else if (strcmp(what, "unit") == 0)
        memset(h->unit, 'm', sizeof h->unit);
    else if (strcmp(what, "name") == 0)
        memset(h->value_name, 'n', sizeof h->value_name);
    else if (strcmp(what, "vectors") == 0)
        h->has_vectors = 3;
    else
        return set_elements(what, h);
    return true;
}

/* Writes the coordinates of the second axis. The parent can check them only after the samples are
 * written. */
static void write_coordinates(const char *what) {
    double *c = mmap(NULL, BYTES + 64, PROT_READ | PROT_WRITE, MAP_SHARED, SP_IMPORT_MEMORY, 0);
    if (c == MAP_FAILED)
        _exit(8);
    for (int i = 0; i < 8; i++)
        c[BYTES / 8 + i] = i < 4 ? 0.5 * i : 1.25 * i - 1.75;
    if (strcmp(what, "coordinates-fall") == 0)
        c[BYTES / 8 + 3] = -1;
    else if (strcmp(what, "coordinates-nan") == 0)
        c[BYTES / 8 + 7] = NAN;
    else if (strcmp(what, "coordinates-none") == 0)
        memset(c + BYTES / 8, 0, 64);
    munmap(c, BYTES + 64);
}

static void misbehave_after_go(const char *what) {
    if (strncmp(what, "coordinates", 11) == 0)
        write_coordinates(what);
    unsigned char *p = map();
    memset(p, 42, BYTES);
    if (strcmp(what, "abort-late") == 0) {
        signal(SIGABRT, SIG_DFL);
        abort();
    } else if (strcmp(what, "hang-late") == 0) {
        wait_for_ever();
    } else if (strcmp(what, "quit-late") == 0) {
        _exit(5);
    } else if (strcmp(what, "truncate") == 0) { /* the seals must prevent both */
        if (ftruncate(SP_IMPORT_MEMORY, 1) == 0 || ftruncate(SP_IMPORT_MEMORY, 1 << 20) == 0)
            _exit(3);
        munmap(p, BYTES);
    } else if (strcmp(what, "header-again") == 0) {
        struct sp_handover m = valid_header();
        send_message(&m);
        wait_for_ever();
    } else if (strcmp(what, "after-done") == 0) {
        send_kind(SP_HANDOVER_DONE);
        send_kind(SP_HANDOVER_DONE);
        wait_for_ever();
    } else if (strcmp(what, "hang-done") == 0) {
        send_kind(SP_HANDOVER_DONE);
        wait_for_ever();
    } else if (strcmp(what, "warning") == 0) {
        struct sp_handover m;
        sp_handover_init(&m, SP_HANDOVER_DONE);
        memset(m.done.warnings, 'w', sizeof m.done.warnings);
        send_message(&m);
        wait_for_ever();
    } else if (strcmp(what, "flood") == 0) {
        for (uint64_t i = 0; i < 20000; i++) {
            struct sp_handover m;
            sp_handover_init(&m, SP_HANDOVER_PROGRESS);
            m.bytes = ~i;
            send_message(&m);
        }
        munmap(p, BYTES);
    } else if (strcmp(what, "keeper") == 0) {
        /* A child process that keeps the memory could continue to write. */
        if (fork() == 0) {
            setsid(); /* leaves the process group that the parent kills */
            close(SP_IMPORT_SOCKET);
            alarm(5);
            wait_for_ever();
        }
        munmap(p, BYTES);
    } else {
        munmap(p, BYTES);
    }
    send_kind(SP_HANDOVER_DONE);
    _exit(strcmp(what, "status") == 0 ? 4 : 0);
}

/* Misbehaves as the reader of a volume that is shown from its chunks. */
static void misbehave_with_chunks(const char *what) {
    struct sp_handover m;
    sp_handover_init(&m, SP_HANDOVER_LEVELS);
    m.levels.count = strcmp(what, "levels-none") == 0   ? 0
                     : strcmp(what, "levels-many") == 0 ? 77
                                                        : 2;
    for (unsigned l = 0; l < 2; l++)
        for (int a = 0; a < 3; a++) {
            m.levels.level[l].dims[a] = m.levels.level[l].chunk[a] = 8 >> l;
            m.levels.level[l].step[a] = 1 << l;
        }
    if (strcmp(what, "levels-size") == 0)
        m.levels.level[1].dims[1] = 9;
    if (strcmp(what, "levels-chunk") == 0)
        m.levels.level[0].chunk[2] = 0;
    if (strcmp(what, "levels-step") == 0)
        m.levels.level[1].step[0] = NAN;
    if (strcmp(what, "levels-other") == 0)
        m.levels.level[0].dims[0] = m.levels.level[0].chunk[0] = 7;
    send_message(&m);
    await_go();
    while (recv(SP_IMPORT_SOCKET, &m, sizeof m, 0) > 0) {
        if (strcmp(what, "chunk-dies") == 0)
            _exit(6);
        m.kind = SP_HANDOVER_CHUNK;
        m.read.place[0]++;
        send_message(&m);
    }
    _exit(0);
}

int main(int argc, char **argv) {
    char what[64];
    if (argc != SP_ARGUMENT_COUNT)
        return 2;
    const char *slash = strrchr(argv[SP_ARGUMENT_PATH], '/');
    snprintf(what, sizeof what, "%s", slash ? slash + 1 : argv[SP_ARGUMENT_PATH]);
    if (misbehave_before_header(what))
        wait_for_ever();
    struct sp_handover m = valid_header();
    m.header.rectilinear = strncmp(what, "coordinates", 11) == 0 ? 2 : 0;
    if (damage_header(what, &m)) {
        send_message(&m);
        wait_for_ever();
    }
    if (strncmp(what, "levels-", 7) == 0 || strncmp(what, "chunk-", 6) == 0)
        m.header.level_count = 2;
    send_message(&m);
    if (strcmp(argv[SP_ARGUMENT_MODE], SP_IMPORT_CHUNKS) == 0)
        misbehave_with_chunks(what);
    await_go();
    misbehave_after_go(what);
}
