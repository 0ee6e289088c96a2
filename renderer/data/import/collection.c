/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/collection.h"

#include <errno.h>
#include <expat.h>
#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/grow.h"

enum { TEXT_MAX = 16 << 20 }; /* bytes */

bool collection_probe(const uint8_t *start, size_t size, const char *title) {
    (void)start;
    (void)size;
    return import_ends_with(title, ".pvd") || import_ends_with(title, ".series");
}

static bool add(struct collection *c, const struct import_file *file, double time, const char *name,
                struct sp_error *err) {
    if (c->count == SP_STEPS_MAX)
        return sp_fail(err, SP_ERR_UNSUPPORTED, file->title,
                       "the list has more than %u files, the limit", SP_STEPS_MAX);
    if (!isfinite(time) || !*name)
        return sp_fail(err, SP_ERR_FORMAT, file->title,
                       *name ? "the time of file %.80s is not a number" : "a file has no name%s",
                       name);
    char *copy = sp_grow(&c->files, c->count, sizeof *c->files) ? strdup(name) : NULL;
    if (!copy)
        return sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for the list");
    c->files[c->count++] = (struct collection_file){ .time = time, .name = copy };
    return true;
}

void collection_finish(struct collection *c) {
    for (uint32_t i = 0; i < c->count; i++)
        free(c->files[i].name);
    free(c->files);
    free(c->times);
    *c = (struct collection){ .count = 0 };
}

/* XML: <DataSet timestep="0.5" part="0" file="a.vti"/> */

struct xml {
    XML_Parser parser;
    const struct import_file *file;
    struct collection *collection;
    struct sp_error *err;
    bool failed;
};

static void stop(struct xml *x) {
    x->failed = true;
    XML_StopParser(x->parser, XML_FALSE);
}

static void XMLCALL begin_element(void *user, const char *tag, const char **attributes) {
    struct xml *x = user;
    const char *name = "", *time = "", *part = "0";
    char *end;
    if (strcmp(tag, "DataSet") != 0)
        return;
    for (const char **a = attributes; *a; a += 2) {
        const char **value = strcmp(a[0], "file") == 0       ? &name
                             : strcmp(a[0], "timestep") == 0 ? &time
                             : strcmp(a[0], "part") == 0     ? &part
                                                             : NULL;
        if (value)
            *value = a[1];
    }
    if (strtol(part, NULL, 10) != 0) {
        sp_fail(x->err, SP_ERR_UNSUPPORTED, x->file->title,
                "line %lu: a step has several parts; save each step as one file",
                (unsigned long)XML_GetCurrentLineNumber(x->parser));
        stop(x);
        return;
    }
    double number = *time ? strtod(time, &end) : x->collection->count;
    if (*time && (end == time || *end))
        number = NAN;
    if (!add(x->collection, x->file, number, name, x->err))
        stop(x);
}

static void XMLCALL refuse_doctype(void *user, const char *name, const char *system,
                                   const char *public, int has_subset) {
    struct xml *x = user;
    (void)name;
    (void)system;
    (void)public;
    (void)has_subset;
    sp_fail(x->err, SP_ERR_UNSUPPORTED, x->file->title, "document types are not supported");
    stop(x);
}

static bool read_xml(const struct import_file *file, const char *text, size_t size,
                     struct collection *c, struct sp_error *err) {
    struct xml x = { .parser = XML_ParserCreate(NULL), .file = file, .collection = c, .err = err };
    if (!x.parser)
        return sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for the list");
    XML_SetUserData(x.parser, &x);
    XML_SetStartElementHandler(x.parser, begin_element);
    XML_SetStartDoctypeDeclHandler(x.parser, refuse_doctype);
    const bool ok = XML_Parse(x.parser, text, (int)size, 1) == XML_STATUS_OK;
    if (!ok && !x.failed)
        sp_fail(err, SP_ERR_FORMAT, file->title, "line %lu: the XML is damaged: %s",
                (unsigned long)XML_GetCurrentLineNumber(x.parser),
                XML_ErrorString(XML_GetErrorCode(x.parser)));
    XML_ParserFree(x.parser);
    return ok && !x.failed;
}

/* JSON: {"file-series-version": "1.0", "files": [{"name": "a.vti", "time": 0.5}]} */
static bool read_json(const struct import_file *file, const char *text, size_t size,
                      struct collection *c, struct sp_error *err) {
    json_error_t why;
    json_t *root = json_loadb(text, size, JSON_REJECT_DUPLICATES, &why), *entry;
    const json_t *files = json_object_get(root, "files");
    size_t i;
    bool ok = json_is_array(files);
    if (!root)
        sp_fail(err, SP_ERR_FORMAT, file->title, "line %d: %s", why.line, why.text);
    else if (!ok)
        sp_fail(err, SP_ERR_FORMAT, file->title, "the list \"files\" is missing");
    json_array_foreach(files, i, entry) {
        const char *name = json_string_value(json_object_get(entry, "name"));
        const json_t *time = json_object_get(entry, "time");
        const double number = json_is_number(time) ? json_number_value(time)
                              : time               ? NAN
                                                   : (double)i;
        if (ok)
            ok = add(c, file, number, name ? name : "", err);
    }
    json_decref(root);
    return ok;
}

static int by_time(const void *a, const void *b) {
    const struct collection_file *p = a, *q = b;
    return (p->time > q->time) - (p->time < q->time);
}

/* Puts the steps in the order of time. */
static bool sort(const struct import_file *file, struct collection *c, struct sp_error *err) {
    if (c->count == 0)
        return sp_fail(err, SP_ERR_FORMAT, file->title, "the list names no file");
    qsort(c->files, c->count, sizeof *c->files, by_time);
    c->times = malloc(c->count * sizeof *c->times);
    if (!c->times)
        return sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for the list");
    for (uint32_t i = 0; i < c->count; i++) {
        c->times[i] = c->files[i].time;
        if (i > 0 && c->times[i] == c->times[i - 1])
            return sp_fail(err, SP_ERR_UNSUPPORTED, file->title,
                           "%.80s and %.80s have the same time; a step is one file",
                           c->files[i - 1].name, c->files[i].name);
    }
    return true;
}

bool collection_read(const struct import_file *file, struct collection *c, struct sp_error *err) {
    if (file->size > TEXT_MAX)
        return sp_fail(err, SP_ERR_UNSUPPORTED, file->title, "the list is larger than %d bytes",
                       TEXT_MAX);
    char *text = malloc(file->size + 1);
    if (!text)
        return sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory for the list");
    const ssize_t got = pread(file->fd, text, file->size, 0);
    const bool is_json = import_ends_with(file->title, ".series");
    const bool ok =
        got < 0 ? sp_fail(err, SP_ERR_IO, file->title, "cannot read the file: %s", strerror(errno))
        : is_json ? read_json(file, text, (size_t)got, c, err)
                  : read_xml(file, text, (size_t)got, c, err);
    free(text);
    return ok && sort(file, c, err);
}
