/* SPDX-License-Identifier: Apache-2.0
 *
 * NRRD0005 with the header in the file. The samples are raw, so that other programs can map them.
 */
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "data/export/job.h"

enum { HEADER_MAX = 4096 };

struct text {
    char bytes[HEADER_MAX];
    size_t size;
};

__attribute__((format(printf, 2, 3))) static void add(struct text *t, const char *format, ...) {
    va_list args;
    va_start(args, format);
    const int n = vsnprintf(t->bytes + t->size, sizeof t->bytes - t->size, format, args);
    va_end(args);
    t->size += n > 0 ? (size_t)n : 0; /* names and units have limits: it all fits */
}

/* A name on one line; with `is_quoted` as a string in quotation marks. */
static void add_name(struct text *t, const char *name, bool is_quoted) {
    for (; *name; name++) {
        const char c = (unsigned char)*name < 0x20 || *name == 0x7f ? ' ' : *name;
        add(t, is_quoted && (c == '"' || c == '\\') ? "\\%c" : "%c", c);
    }
}

static void add_vector(struct text *t, const double v[3]) {
    add(t, " (%.17g,%.17g,%.17g)", v[0], v[1], v[2]);
}

/* Of the anatomical spaces NRRD has these two right-handed ones; others become LPS. */
static void add_place(struct text *t, const struct sp_volume_info *info) {
    const bool is_ras = strcmp(info->anatomy, "RAS") == 0;
    double direction[3][3], origin[3];
    sp_export_place(info, is_ras ? "RAS" : "LPS", direction, origin);
    if (info->anatomy[0])
        add(t, "space: %s-superior\n", is_ras ? "right-anterior" : "left-posterior");
    else
        add(t, "space dimension: 3\n");
    add(t, "space directions:");
    for (int axis = 0; axis < 3; axis++) {
        const double s = info->grid.spacing[axis];
        const double v[3] = { direction[0][axis] * s, direction[1][axis] * s,
                              direction[2][axis] * s };
        add_vector(t, v);
    }
    add(t, "\nspace origin:");
    add_vector(t, origin);
    add(t, "\n");
    if (info->unit[0]) {
        add(t, "space units:");
        for (int axis = 0; axis < 3; axis++) {
            add(t, " \"");
            add_name(t, info->unit, true);
            add(t, "\"");
        }
        add(t, "\n");
    }
}

bool sp_export_nrrd(const struct sp_export_job *job, struct sp_error *err) {
    static const char *const types[SP_TYPE_COUNT] = { "uint8", "int8",  "uint16", "int16",
                                                      "int32", "float", "double" };
    const struct sp_volume_info *info = job->info;
    const uint32_t *dims = info->grid.dims;
    struct text t = { .size = 0 };
    add(&t, "NRRD0005\n# written by splatctl convert\ntype: %s\ndimension: 3\nsizes: %u %u %u\n",
        types[info->type], dims[0], dims[1], dims[2]);
    add(&t, "kinds: domain domain domain\n");
    if (sp_type_size(info->type) > 1)
        add(&t, "endian: %s\n", __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__ ? "big" : "little");
    add(&t, "encoding: raw\n");
    add_place(&t, info);
    if (info->value_name[0]) {
        add(&t, "content: ");
        add_name(&t, info->value_name, false);
        add(&t, "\n");
    }
    if (info->value_unit[0]) {
        add(&t, "sample units: ");
        add_name(&t, info->value_unit, false);
        add(&t, "\n");
    }
    add(&t, "\n");
    return sp_export_stream(job, t.bytes, t.size, false, err);
}
