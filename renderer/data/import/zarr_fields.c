/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/zarr_fields.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/zarr_chunk.h"

enum { FIELDS_MAX = 512, DEPTH_MAX = 8 };

struct field {
    char name[ARRAY_NAME_BYTES]; /* the path below the node; "" = the node itself */
    struct zarr_array array;
    json_t *attributes; /* owned; an object or NULL */
    json_t *fill;       /* owned: of the metadata of v2; NULL = none */
    bool is_sound;      /* else *why says what is wrong */
    struct sp_error why;
};

struct zarr_fields {
    const struct zarr_store *store;
    json_t *attributes; /* owned: of the node */
    struct field *fields[FIELDS_MAX];
    unsigned count;
    struct zarr_chunks chunks;
    bool has_memory; /* while listing */
};

/* Listing. */

static void add_field(struct zarr_fields *f, const struct zarr_node *node, const char *name) {
    struct field *field = f->count < FIELDS_MAX ? calloc(1, sizeof *field) : NULL;
    if (!field) {
        f->has_memory &= f->count == FIELDS_MAX;
        return;
    }
    f->fields[f->count++] = field;
    snprintf(field->name, sizeof field->name, "%s", name);
    field->is_sound = zarr_array_parse(&field->array, node, &field->why);
    field->attributes = json_incref((json_t *)(uintptr_t)node->attributes);
    if (node->version == 2)
        field->fill = json_incref(json_object_get(node->metadata, "fill_value"));
}

struct visit {
    struct zarr_fields *fields;
    const char *path; /* of the group in the store */
    const char *name; /* below the node, "" or ending with '/' */
    unsigned depth;
};

static bool visit(void *to, const char *name) {
    const struct visit *v = to;
    char path[ZARR_KEY_BYTES], own[ARRAY_NAME_BYTES], group[ARRAY_NAME_BYTES + 1];
    struct zarr_node node;
    struct sp_error ignored;
    if (!zarr_key(path, v->path, name) ||
        snprintf(own, sizeof own, "%s%s", v->name, name) >= (int)sizeof own ||
        zarr_node_open(&node, v->fields->store, path, &ignored) != ZARR_FOUND)
        return true;
    snprintf(group, sizeof group, "%s/", own);
    const struct visit below = { v->fields, path, group, v->depth + 1 };
    if (node.is_array)
        add_field(v->fields, &node, own);
    else if (v->depth < DEPTH_MAX && v->fields->store->list)
        v->fields->store->list(v->fields->store->user, path, visit, (void *)(uintptr_t)&below);
    zarr_node_close(&node);
    return v->fields->has_memory && v->fields->count < FIELDS_MAX;
}

/* Arrays of a group come before the arrays of the groups in it. */
static int by_name(const void *a, const void *b) {
    const char *const one = (*(struct field *const *)a)->name;
    const char *const two = (*(struct field *const *)b)->name;
    const bool is_deep[2] = { strchr(one, '/'), strchr(two, '/') };
    return is_deep[0] != is_deep[1] ? is_deep[0] - is_deep[1] : strverscmp(one, two);
}

struct zarr_fields *zarr_fields_open(const struct zarr_node *node, const struct import_file *file,
                                     struct sp_error *err) {
    struct zarr_fields *f = calloc(1, sizeof *f);
    if (!f) {
        sp_fail(err, SP_ERR_MEMORY, node->store->title, "out of memory");
        return NULL;
    }
    const struct visit root = { f, node->path, "", 0 };
    f->store = node->store;
    f->has_memory = true;
    f->attributes = json_incref((json_t *)(uintptr_t)node->attributes);
    zarr_chunks_init(&f->chunks, node->store, file);
    if (node->is_array)
        add_field(f, node, "");
    else if (node->store->list)
        node->store->list(node->store->user, node->path, visit, (void *)(uintptr_t)&root);
    qsort(f->fields, f->count, sizeof f->fields[0], by_name);
    bool ok = f->has_memory || sp_fail(err, SP_ERR_MEMORY, node->store->title, "out of memory");
    if (ok && f->count == 0)
        ok = zarr_node_fail(node, err, SP_ERR_UNSUPPORTED, "",
                            "this group has neither \"multiscales\" nor an array; open one of the "
                            "folders in it");
    if (ok && node->is_array && !f->fields[0]->is_sound) {
        *err = f->fields[0]->why;
        ok = false;
    }
    if (!ok)
        zarr_fields_close(&f);
    return f;
}

void zarr_fields_close(struct zarr_fields **fields) {
    struct zarr_fields *f = *fields;
    if (!f)
        return;
    for (unsigned i = 0; i < f->count; i++) {
        json_decref(f->fields[i]->attributes);
        json_decref(f->fields[i]->fill);
        free(f->fields[i]);
    }
    json_decref(f->attributes);
    zarr_chunks_finish(&f->chunks);
    free(f);
    *fields = NULL;
}

const struct zarr_array *zarr_fields_array(const struct zarr_fields *f, unsigned n) {
    return &f->fields[n]->array;
}

/* The functions of arrays. */

static bool describe(void *file, unsigned n, struct array_info *info) {
    const struct zarr_fields *f = file;
    memset(info, 0, sizeof *info);
    if (n >= f->count)
        return false;
    const struct zarr_array *a = &f->fields[n]->array;
    memcpy(info->name, f->fields[n]->name, sizeof info->name);
    info->is_number = f->fields[n]->is_sound;
    if (!info->is_number) {
        const char *place = strstr(f->fields[n]->why.place, ": ");
        snprintf(info->problem, sizeof info->problem, "%.80s: %.160s", place ? place + 2 : "",
                 f->fields[n]->why.text);
        if (a->number.size == 0) /* of no numbers */
            return true;
    }
    info->rank = a->rank;
    info->number = a->number;
    for (unsigned d = 0; d < a->rank; d++) {
        info->shape[d] = a->shape[d];
        info->chunk[d] = a->chunk[d];
        snprintf(info->dims[d], sizeof info->dims[d], "%s", a->names[d]);
    }
    return true;
}

/* Reads coordinates: arrays of one dimension. */
static bool read_line(void *file, unsigned n, const uint64_t *start, const uint64_t *count,
                      void *out, struct sp_error *err) {
    struct zarr_fields *f = file;
    const struct zarr_array *a = &f->fields[n]->array;
    const size_t size = a->number.size;
    char *chunk = a->rank == 1 ? malloc(a->chunk_bytes) : NULL;
    bool ok = chunk || sp_fail(err, SP_ERR_MEMORY, "", "out of memory for a chunk");
    for (uint64_t i = start[0], part; ok && i < start[0] + count[0]; i += part) {
        const uint64_t at[ZARR_RANK_MAX] = { i / a->chunk[0] }, left = start[0] + count[0] - i;
        part = a->chunk[0] - i % a->chunk[0];
        part = part < left ? part : left;
        ok = zarr_chunk_read(&f->chunks, a, at, chunk, err) != ZARR_FAILED;
        if (ok)
            memcpy((char *)out + (i - start[0]) * size, chunk + i % a->chunk[0] * size,
                   part * size);
    }
    free(chunk);
    return ok;
}

static const json_t *attribute_of(const struct zarr_fields *f, unsigned n, const char *name) {
    return json_object_get(n < f->count ? f->fields[n]->attributes : f->attributes, name);
}

/* xarray writes the _FillValue of v3 as the eight bytes of a float64 in base64. */
static bool from_base64(const char *text, double *value) {
    static const char letters[] =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    uint8_t bytes[9];
    if (strlen(text) != 12 || text[11] != '=')
        return false;
    for (int i = 0; i < 3; i++) {
        uint32_t bits = 0;
        for (int j = 0; j < 4; j++) {
            const char letter = text[4 * i + j], *at = strchr(letters, letter);
            if (!at && !(letter == '=' && 4 * i + j == 11))
                return false;
            bits = bits << 6 | (at ? (uint32_t)(at - letters) : 0);
        }
        for (int j = 0; j < 3; j++)
            bytes[3 * i + j] = (uint8_t)(bits >> (16 - 8 * j));
    }
    uint64_t number = 0;
    for (int i = 7; i >= 0; i--)
        number = number << 8 | bytes[i];
    memcpy(value, &number, sizeof *value);
    return true;
}

/* Leaves *value alone if it is no number. */
static bool number_of(const json_t *json, double *value) {
    const char *text = json_string_value(json);
    if (json_is_number(json))
        *value = json_number_value(json);
    return json_is_number(json) ||
           (text && (zarr_special_number(text, value) || from_base64(text, value)));
}

/* xarray stores _FillValue in Zarr v2 as the fill value of the array. Other writers of v2 set 0
 * there, which is a sample unless the numbers are packed. */
static const json_t *fill_of(const struct zarr_fields *f, unsigned n) {
    const struct field *field = f->fields[n];
    const bool is_packed = json_object_get(field->attributes, "scale_factor") ||
                           json_object_get(field->attributes, "add_offset");
    double value;
    const bool counts = json_object_get(field->attributes, "_ARRAY_DIMENSIONS") &&
                        number_of(field->fill, &value) && (is_packed || value != 0);
    return counts ? field->fill : NULL;
}

static size_t numbers(void *file, unsigned n, const char *name, double *out, size_t most) {
    const struct zarr_fields *f = file;
    const json_t *json = attribute_of(f, n, name);
    size_t count = 0;
    if (!json && n < f->count && strcmp(name, "_FillValue") == 0)
        json = fill_of(f, n);
    if (!json_is_array(json))
        return most > 0 && number_of(json, out);
    for (; count < most && count < json_array_size(json); count++)
        if (!number_of(json_array_get(json, count), &out[count]))
            return 0;
    return count;
}

static void text(void *file, unsigned n, const char *name, char *out, size_t capacity) {
    const json_t *json = attribute_of(file, n, name);
    const char *value = json_is_string(json)  ? json_string_value(json)
                        : json_is_true(json)  ? "true"
                        : json_is_false(json) ? "false"
                                              : "";
    snprintf(out, capacity, "%s", value);
}

const struct array_functions zarr_field_functions = {
    .describe = describe, .read = read_line, .numbers = numbers, .text = text
};
