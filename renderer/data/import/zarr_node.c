/* SPDX-License-Identifier: Apache-2.0
 *
 * Why this parser is our own: parsers.md.
 */
#include "data/import/zarr_node.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { JSON_BYTES_MAX = 4 << 20 };

bool zarr_node_fail(const struct zarr_node *node, struct sp_error *err, enum sp_code code,
                    const char *pointer, const char *format, ...) {
    char key[ZARR_KEY_BYTES], text[SP_ERROR_TEXT];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    zarr_key(key, node->path, node->name);
    return zarr_fail(node->store, err, code, key, pointer, "%s", text);
}

/* Python writes NaN and infinity as words, which are no JSON. They become strings of the same
 * length: "N", "Inf", "-Inf". */
static void quote_words(char *text) {
    static const char *const words[][2] = { { "NaN", "\"N\"" },
                                            { "-Infinity", "\"-Inf\"   " },
                                            { "Infinity", "\"Inf\"   " } };
    bool is_string = false;
    for (char *c = text; *c; c++) {
        if (is_string && *c == '\\' && c[1])
            c++;
        else if (*c == '"')
            is_string = !is_string;
        for (size_t i = 0; !is_string && i < sizeof words / sizeof *words; i++) {
            const size_t n = strlen(words[i][0]);
            if (strncmp(c, words[i][0], n) == 0) {
                memcpy(c, words[i][1], n);
                c += n - 1;
                break;
            }
        }
    }
}

/* Reads an object of JSON. */
static enum zarr_found load(const struct zarr_store *store, const char *path, const char *name,
                            json_t **json, struct sp_error *err) {
    char key[ZARR_KEY_BYTES];
    uint64_t size = 0;
    size_t got = 0;
    json_error_t why;
    *json = NULL;
    if (!zarr_key(key, path, name))
        return ZARR_MISSING;
    enum zarr_found found = store->size(store->user, key, &size, err);
    if (found != ZARR_FOUND)
        return found;
    if (size > JSON_BYTES_MAX) {
        zarr_fail(store, err, SP_ERR_FORMAT, key, "", "has more than %d MiB of metadata",
                  JSON_BYTES_MAX >> 20);
        return ZARR_FAILED;
    }
    char *text = malloc((size_t)size + 1);
    if (!text) {
        zarr_fail(store, err, SP_ERR_MEMORY, key, "", "out of memory");
        return ZARR_FAILED;
    }
    found = store->read(store->user, key, 0, text, (size_t)size, &got, err);
    text[got] = 0;
    if (found == ZARR_FOUND) {
        quote_words(text);
        *json = json_loadb(text, got, JSON_REJECT_DUPLICATES, &why);
        if (!json_is_object(*json)) {
            zarr_fail(store, err, SP_ERR_FORMAT, key, "", "line %d: %s", *json ? 1 : why.line,
                      *json ? "the metadata must be a JSON object" : why.text);
            json_decref(*json);
            *json = NULL;
            found = ZARR_FAILED;
        }
    }
    free(text);
    return found;
}

static bool check_version(struct zarr_node *node, const char *kind, struct sp_error *err) {
    const json_t *version = json_object_get(node->metadata, "zarr_format");
    if (json_integer_value(version) != node->version)
        return zarr_node_fail(node, err, SP_ERR_UNSUPPORTED, "/zarr_format",
                              "is not %d; supported are versions 2 and 3", node->version);
    if (kind && strcmp(kind, "group") != 0 && strcmp(kind, "array") != 0)
        return zarr_node_fail(node, err, SP_ERR_FORMAT, "/node_type",
                              "node_type must be \"array\" or \"group\"");
    return true;
}

static enum zarr_found open_v2(struct zarr_node *node, struct sp_error *err) {
    node->version = 2;
    node->is_array = true;
    node->name = ".zarray";
    enum zarr_found found = load(node->store, node->path, ".zarray", &node->metadata, err);
    if (found == ZARR_MISSING) {
        node->is_array = false;
        node->name = ".zgroup";
        found = load(node->store, node->path, ".zgroup", &node->metadata, err);
    }
    if (found == ZARR_FOUND && !check_version(node, NULL, err))
        found = ZARR_FAILED;
    const enum zarr_found has =
        found == ZARR_FAILED ? ZARR_FAILED
                             : load(node->store, node->path, ".zattrs", &node->separate, err);
    if (has == ZARR_FAILED)
        return ZARR_FAILED;
    node->attributes = node->separate;
    return has == ZARR_FOUND ? has : found;
}

enum zarr_found zarr_node_open(struct zarr_node *node, const struct zarr_store *store,
                               const char *path, struct sp_error *err) {
    *node = (struct zarr_node){ .store = store, .version = 3, .name = "zarr.json" };
    snprintf(node->path, sizeof node->path, "%s", path);
    enum zarr_found found = load(store, path, "zarr.json", &node->metadata, err);
    if (found == ZARR_MISSING) {
        found = open_v2(node, err);
    } else if (found == ZARR_FOUND) {
        const char *kind = json_string_value(json_object_get(node->metadata, "node_type"));
        node->is_array = kind && strcmp(kind, "array") == 0;
        node->attributes = json_object_get(node->metadata, "attributes");
        if (!check_version(node, kind ? kind : "", err))
            found = ZARR_FAILED;
    }
    if (found != ZARR_FOUND)
        zarr_node_close(node);
    return found;
}

void zarr_node_close(struct zarr_node *node) {
    json_decref(node->metadata);
    json_decref(node->separate);
    node->metadata = node->separate = NULL;
    node->attributes = NULL;
}
