/* SPDX-License-Identifier: Apache-2.0
 *
 * Binary PLOT3D files: the nodes of curvilinear grids in one file, and the flow at them in another
 * one beside it (combxyz.bin and combq.bin). Nothing in a file says how its numbers are stored, so
 * the form is the one whose records fill the file exactly:
 *
 *   grid   [blocks] [ni nj nk of each block]  of each block: [x… y… z… (blanks…)]
 *   flow   [blocks] [ni nj nk of each block]  of each block: [mach, angle, re, time] [q1… … q5…]
 *
 * Brackets are records. Fortran puts their length in bytes before and after each. A file with one
 * block may leave out the number of blocks.
 *
 * Why this parser is our own: parsers.md.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "base/transfer.h"
#include "data/import/confine.h"
#include "data/import/derived.h"
#include "data/import/samples.h"
#include "data/import/vectors.h"

enum { BLOCKS_MAX = 4096, RUN = 1 << 16 /* bytes, a multiple of 8 */ };

struct form {
    bool is_flow;
    unsigned marker; /* bytes of the length of a record: 0 or 4 */
    bool big_endian, has_count, has_blanks;
    unsigned real; /* bytes: 4 or 8 */
};

struct plot_file { /* one of the two files */
    int fd;
    const char *title;
    uint64_t size;
    struct form form;
    uint32_t blocks;
    uint32_t dims[BLOCKS_MAX][3];
    uint64_t begin; /* of the first block */
};

struct plot3d {
    const struct import_file *file;
    struct plot_file grid, flow; /* flow.fd < 0 = there is none */
    int field;                   /* of the flow, see choose_field() */
    char flow_name[512];
};

static bool probe(const uint8_t *start, size_t size, const char *title) {
    (void)start;
    (void)size;
    return import_ends_with(title, "xyz.bin") || import_ends_with(title, ".xyz") ||
           import_ends_with(title, ".p3d");
}

static bool read_words(const struct plot_file *p, uint64_t at, uint32_t *out, size_t n) {
    if (!sp_read_at(p->fd, out, 4 * n, at))
        return false;
    if (p->form.big_endian != (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__))
        import_swap(out, 4, n);
    return true;
}

/* Checks the length before and after a record of so many bytes and moves *at behind it. */
static bool pass(const struct plot_file *p, uint64_t bytes, uint64_t *at) {
    uint32_t before, after;
    uint64_t end = *at + 2 * p->form.marker + bytes;
    if (end > p->size)
        return false;
    if (p->form.marker && (!read_words(p, *at, &before, 1) || !read_words(p, end - 4, &after, 1) ||
                           before != (uint32_t)bytes || after != (uint32_t)bytes))
        return false;
    *at = end;
    return true;
}

static uint64_t nodes(const uint32_t dims[3]) {
    return (uint64_t)dims[0] * dims[1] * dims[2];
}

/* The bytes of the last record of a block. */
static uint64_t block_bytes(const struct plot_file *p, uint32_t block) {
    const struct form *f = &p->form;
    return nodes(p->dims[block]) * (f->is_flow ? 5 * f->real : 3 * f->real + 4 * f->has_blanks);
}

/* True if records of this form fill the file. */
static bool fits(struct plot_file *p, const struct form *form) {
    uint64_t at = 0, total = 0;
    p->form = *form;
    p->blocks = 1;
    if (form->has_count && (!read_words(p, form->marker, &p->blocks, 1) || !pass(p, 4, &at)))
        return false;
    if (p->blocks < 1 || p->blocks > BLOCKS_MAX ||
        !read_words(p, at + form->marker, p->dims[0], 3 * (size_t)p->blocks) ||
        !pass(p, 12 * (uint64_t)p->blocks, &at))
        return false;
    p->begin = at;
    for (uint32_t b = 0; b < p->blocks; b++) {
        for (int a = 0; a < 3; a++)
            if (p->dims[b][a] < 1 || p->dims[b][a] > SP_DIM_MAX)
                return false;
        total += nodes(p->dims[b]);
        if (total > SP_VOXELS_MAX || (form->is_flow && !pass(p, 4 * form->real, &at)) ||
            !pass(p, block_bytes(p, b), &at))
            return false;
    }
    return at == p->size;
}

static bool find_form(struct plot_file *p, bool is_flow, struct sp_error *err) {
    for (unsigned i = 0; i < 32; i++) {
        const struct form form = { .is_flow = is_flow,
                                   .big_endian = i & 1,
                                   .has_count = i & 2,
                                   .marker = i & 4,
                                   .real = i & 8 ? 8 : 4,
                                   .has_blanks = i & 16 };
        if (!(is_flow && form.has_blanks) && fits(p, &form))
            return true;
    }
    return import_fail(err, SP_ERR_FORMAT, p->title, 0, NULL,
                       "no binary form of a PLOT3D %s, in either byte order, precision, and with "
                       "or without the lengths of records, has %" PRIu64 " bytes: the file is cut "
                       "off, or text",
                       is_flow ? "flow" : "grid", p->size);
}

/* Opens the file of the flow, which has q for xyz in its name, or .q for .p3d. */
static bool open_flow(struct plot3d *p, struct sp_error *err) {
    const char *slash = strrchr(p->file->title, '/'), *name = slash ? slash + 1 : p->file->title;
    const char *found = NULL;
    size_t n = strlen(name), cut = 3;
    for (size_t i = 0; i + 3 <= n; i++)
        if (strncasecmp(name + i, "xyz", 3) == 0 || strncasecmp(name + i, "p3d", 3) == 0)
            found = name + i;
    p->flow.fd = -1;
    if (!found || n >= sizeof p->flow_name)
        return true;
    snprintf(p->flow_name, sizeof p->flow_name, "%.*sq%s", (int)(found - name), name, found + cut);
    char path[2 * PATH_MAX], real[PATH_MAX];
    struct sp_error why;
    snprintf(path, sizeof path, "%s/%s", p->file->folder, p->flow_name);
    p->flow.title = p->flow_name;
    p->flow.fd = sp_open_confined(p->file->root, path, p->flow_name, real, &p->flow.size, &why);
    if (p->flow.fd < 0)
        return why.code == SP_ERR_NOT_FOUND || sp_fail(err, why.code, why.place, "%s", why.text);
    if (!find_form(&p->flow, true, err))
        return false;
    return (p->flow.blocks == p->grid.blocks &&
            memcmp(p->flow.dims, p->grid.dims, 12 * (size_t)p->grid.blocks) == 0) ||
           import_fail(err, SP_ERR_FORMAT, p->flow_name, 0, NULL,
                       "this flow has other dimensions than its grid; it belongs to another grid");
}

static void close_plot3d(void *reader) {
    struct plot3d *p = reader;
    if (p->flow.fd >= 0)
        close(p->flow.fd);
}

/* The columns of the flow, q1 to q5, and what comes from the momentum. */
enum { DENSITY, MOMENTUM_X, MOMENTUM_Z = 3, ENERGY, MOMENTUM_LENGTH, FIELDS };

static void choose_field(struct plot3d *p, struct import_header *header) {
    static const char *const names[FIELDS] = { "density",    "momentum x", "momentum y",
                                               "momentum z", "energy",     "momentum magnitude" };
    for (int i = 1; i < FIELDS; i++)
        if (strcmp(p->file->field, names[i]) == 0)
            p->field = i;
    import_name(header->value_name, names[p->field]);
    for (int i = 0; i < FIELDS; i++)
        if (i != p->field)
            import_header_add_other(header, names[i]);
    import_name(header->vector_name, "momentum");
}

static bool open_plot3d(void *reader, const struct import_file *file, struct import_header *header,
                        struct sp_error *err) {
    struct plot3d *p = reader;
    uint64_t count = 0;
    p->file = file;
    p->flow.fd = -1;
    p->grid.fd = file->fd;
    p->grid.size = file->size;
    p->grid.title = file->title;
    if (!find_form(&p->grid, false, err) || !open_flow(p, err))
        return false;
    for (uint32_t b = 0; b < p->grid.blocks; b++)
        count += nodes(p->grid.dims[b]);
    if (count > SP_ELEMENTS_MAX)
        return import_fail(err, SP_ERR_UNSUPPORTED, file->title, 0, NULL,
                           "%" PRIu64 " nodes are more than the %d points that a volume may have",
                           count, SP_ELEMENTS_MAX);
    import_header_use_elements(header,
                               &(struct sp_elements_shape){ .kind = SP_KIND_POINTS,
                                                            .count = (uint32_t)count,
                                                            .has_vectors = p->flow.fd >= 0 });
    header->blocks = (const uint32_t(*)[3])p->grid.dims;
    header->block_count = p->grid.blocks;
    if (p->flow.fd >= 0)
        choose_field(p, header);
    return true;
}

/* Reads `count` numbers of `size` bytes and passes them on in runs. */
static bool read_numbers(const struct plot_file *p, uint64_t at, uint64_t count,
                         const struct import_vectors *out, struct sp_error *err) {
    union {
        double align;
        char bytes[RUN];
    } run;
    const size_t size = out->number.size, most = RUN / size;
    for (uint64_t done = 0; done < count;) {
        size_t n = count - done < most ? (size_t)(count - done) : most;
        if (!sp_read_at(p->fd, run.bytes, n * size, at + done * size))
            return import_fail(
                err, SP_ERR_IO, p->title, at + done * size, NULL,
                "cannot read the numbers: the file became shorter, or its disk or network fails");
        if (p->form.big_endian != (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__))
            import_swap(run.bytes, size, n);
        import_vectors_put(out, done, run.bytes, n);
        done += n;
    }
    return true;
}

/* Nodes whose blank is 0 are not drawn. The blanks wait in the place of the volumes. */
static bool read_blanks(const struct plot3d *reader, uint64_t at, const struct sp_elements *e,
                        uint64_t first, uint64_t count, struct sp_error *err) {
    const struct plot_file *p = &reader->grid;
    const struct import_vectors out = { .number = { IMPORT_SIGNED, 4 },
                                        .out = (float(*)[3])(void *)(e->volumes + first) };
    uint64_t hidden = 0;
    if (!p->form.has_blanks)
        return true;
    if (!read_numbers(p, at, count, &out, err))
        return false;
    for (uint64_t i = first; i < first + count; i++)
        if (e->volumes[i] == 0) {
            e->values[i] = NAN;
            hidden++;
        }
    if (reader->file->warnings)
        reader->file->warnings->hidden += hidden;
    return true;
}

/* Reads the values and the momentum of a block from its flow at `at`. */
static bool read_flow(const struct plot3d *p, uint64_t at, const struct sp_elements *e,
                      uint64_t first, uint64_t count, struct sp_error *err) {
    const uint64_t column = count * p->flow.form.real;
    float *values = e->values + first;
    const struct import_vectors out = { .number = { IMPORT_FLOAT, p->flow.form.real },
                                        .out = (float(*)[3])(void *)values };
    for (uint64_t i = 0; p->flow.fd < 0 && i < count; i++)
        values[i] = 1;
    if (p->flow.fd < 0)
        return true;
    const struct import_vectors momentum = {
        .number = out.number, .count = count, .planar = true, .out = e->vectors + first
    };
    if (!read_numbers(&p->flow, at + MOMENTUM_X * column, 3 * count, &momentum, err))
        return false;
    if (p->field != MOMENTUM_LENGTH)
        return read_numbers(&p->flow, at + (uint64_t)p->field * column, count, &out, err);
    import_derive(IMPORT_LENGTH, (const float(*)[3])momentum.out, count, values);
    return true;
}

static bool read_elements(void *reader, const struct sp_elements *e,
                          const struct import_progress *progress, struct sp_error *err) {
    struct plot3d *p = reader;
    const struct form *grid = &p->grid.form, *flow = &p->flow.form;
    uint64_t first = 0, at = p->grid.begin, flow_at = p->flow.begin;
    for (uint32_t b = 0; b < p->grid.blocks; b++) {
        const uint64_t n = nodes(p->grid.dims[b]);
        const struct import_vectors out = { .number = { IMPORT_FLOAT, grid->real },
                                            .count = n,
                                            .planar = true,
                                            .out = e->positions + first,
                                            .shift = p->file->shift };
        const uint64_t start = at + grid->marker;
        flow_at += 3 * flow->marker + 4 * flow->real;
        if (!read_numbers(&p->grid, start, 3 * n, &out, err) ||
            !read_flow(p, flow_at, e, first, n, err) ||
            !read_blanks(p, start + 3 * n * grid->real, e, first, n, err))
            return false;
        at += 2 * grid->marker + block_bytes(&p->grid, b);
        flow_at += flow->marker + (p->flow.fd >= 0 ? block_bytes(&p->flow, b) : 0);
        first += n;
        import_report(progress, first * 4 * sizeof(float));
    }
    return true;
}

const struct import_format import_plot3d = { .name = "PLOT3D (.xyz, .p3d)",
                                             .probe = probe,
                                             .reader_size = sizeof(struct plot3d),
                                             .open = open_plot3d,
                                             .read_elements = read_elements,
                                             .close = close_plot3d };
