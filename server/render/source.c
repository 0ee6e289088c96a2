/* SPDX-License-Identifier: Apache-2.0 */
#include "render/source.h"

#include <ctype.h>
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/text.h"
#include "render/data_folder.h"
#include "render/formats.h"
#include "sp/volume.h"

enum { SUFFIX_BYTES = 7 };

static const char demo_prefix[] = "demo:";
enum { DEMO_PREFIX = sizeof demo_prefix - 1 };

bool srv_source_is_demo(const char *source) {
    return strncmp(source, demo_prefix, DEMO_PREFIX) == 0;
}

bool srv_source_is_upload(const char *source) {
    return strncmp(source, SRV_SOURCE_UPLOAD, sizeof SRV_SOURCE_UPLOAD - 1) == 0;
}

bool srv_source_is_memory(const char *source) {
    return strncmp(source, SRV_SOURCE_MEMORY, sizeof SRV_SOURCE_MEMORY - 1) == 0;
}

bool srv_source_upload_id(const char *source, char id[SP_NAME_BYTES]) {
    const char *text = source + (srv_source_is_upload(source) ? sizeof SRV_SOURCE_UPLOAD - 1 : 0);
    snprintf(id, SP_NAME_BYTES, "%.*s", (int)strcspn(text, "?"), text);
    return text != source;
}

static char *copy(const char *text, struct sp_error *err) {
    char *text_copy = strdup(text);
    if (!text_copy)
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a path");
    return text_copy;
}

static char *resolve_demo(const char *source, const char *pointer, struct sp_error *err) {
    struct sp_error why;
    if (sp_demo_check(source, &why))
        return copy(source, err);
    if (pointer)
        sp_fail(err, why.code, pointer, "%.100s: %s", source, why.text);
    else if (err)
        *err = why;
    return NULL;
}

static char *resolve_trusted(const char *source, struct sp_error *err) {
    char *real = realpath(source, NULL);
    if (!real)
        sp_fail(err, SP_ERR_NOT_FOUND, source, "cannot open the volume: %s", strerror(errno));
    return real;
}

static char *resolve_confined(const char *source, const char *data, const char *pointer,
                              struct sp_error *err) {
    char real[PATH_MAX];
    return srv_data_resolve(data, source, pointer, real, err) ? copy(real, err) : NULL;
}

static char *resolve_path(const char *path, const char *pointer, const char *data,
                          struct sp_error *err) {
    return pointer ? resolve_confined(path, data, pointer, err) : resolve_trusted(path, err);
}

/* Resolves the folder of the numbered files of a time series, "run/t*.vti". */
static char *resolve_series(const char *path, const char *pointer, const char *data,
                            struct sp_error *err) {
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path;
    char folder[PATH_MAX], *key = NULL;
    snprintf(folder, sizeof folder, "%.*s", (int)(name - path), path);
    char *real = resolve_path(folder[0] || pointer ? folder : ".", pointer, data, err);
    if (real && asprintf(&key, "%s%s%s", real, strcmp(real, "/") == 0 ? "" : "/", name) < 0) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a path");
        key = NULL;
    }
    free(real);
    return key;
}

/* Resolves a path whose name may have a '*': to a file with this very name, or else to a series. */
static char *resolve_name(const char *path, const char *pointer, const char *data,
                          struct sp_error *err) {
    const char *slash = strrchr(path, '/');
    if (!strchr(slash ? slash : path, '*'))
        return resolve_path(path, pointer, data, err);
    char *real = resolve_path(path, pointer, data, NULL);
    return real ? real : resolve_series(path, pointer, data, err);
}

/* No file has the name: says how what follows '?' was read. */
static void explain_query(const char *source, const char *selection, struct sp_error *err) {
    const char *query = strrchr(source, '?');
    const size_t used = strlen(err->text);
    if (*selection == '?')
        snprintf(err->text + used, sizeof err->text - used,
                 "; \"%.60s\" was read as a choice: rename a file that is called so", selection);
    else if (query && strchr(query, '='))
        snprintf(err->text + used, sizeof err->text - used,
                 "; behind '?' may stand level=, series=, as=, unit=, vectors= and field=, once "
                 "each, with a value, the last two at the end");
}

/* Resolves the path of a file, to which the field is added again. */
static char *resolve_file(const char *source, const char *pointer, const char *data,
                          struct sp_error *err) {
    const size_t length = sp_source_split(source).path_bytes;
    const char *selection = source + length;
    char *path = *selection ? strndup(source, length) : copy(source, err), *key = NULL;
    char *real = path ? resolve_name(path, pointer, data, err) : NULL;
    free(path);
    if (!real && pointer && err && err->code == SP_ERR_NOT_FOUND)
        explain_query(source, selection, err);
    if (!real || !*selection)
        return real;
    if (asprintf(&key, "%s%s", real, selection) < 0)
        key = NULL;
    free(real);
    if (!key)
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a path");
    return key;
}

char *srv_source_resolve(const char *source, const char *pointer, const char *data,
                         struct sp_error *err) {
    return srv_source_is_demo(source) ? resolve_demo(source, pointer, err)
                                      : resolve_file(source, pointer, data, err);
}

static bool is_id_char(char c) {
    return isalnum((unsigned char)c) || strchr("._-", c);
}

bool srv_source_is_id(const char *id) {
    size_t length = strlen(id);
    for (size_t i = 0; i < length; i++)
        if (!is_id_char(id[i]))
            return false;
    return length >= 1 && length < SP_NAME_BYTES && strcmp(id, ".") != 0 && strcmp(id, "..") != 0;
}

/* The letters of Latin-1 Supplement and Latin Extended-A, U+00C0 to U+017F, in plain ASCII: as a
 * German, a Dane or a Pole writes them where the letter is missing. "-" = no letter. */
/* clang-format off */
static const char *const latin[] = {
    /* U+00C0 */
    "A", "A", "A", "A", "Ae", "A", "Ae", "C", "E", "E", "E", "E", "I", "I", "I", "I",
    "D", "N", "O", "O", "O", "O", "Oe", "-", "Oe", "U", "U", "U", "Ue", "Y", "Th", "ss",
    "a", "a", "a", "a", "ae", "a", "ae", "c", "e", "e", "e", "e", "i", "i", "i", "i",
    "d", "n", "o", "o", "o", "o", "oe", "-", "oe", "u", "u", "u", "ue", "y", "th", "y",
    /* U+0100 */
    "A", "a", "A", "a", "A", "a", "C", "c", "C", "c", "C", "c", "C", "c", "D", "d",
    "D", "d", "E", "e", "E", "e", "E", "e", "E", "e", "E", "e", "G", "g", "G", "g",
    "G", "g", "G", "g", "H", "h", "H", "h", "I", "i", "I", "i", "I", "i", "I", "i",
    "I", "i", "Ij", "ij", "J", "j", "K", "k", "k", "L", "l", "L", "l", "L", "l", "L",
    "l", "L", "l", "N", "n", "N", "n", "N", "n", "n", "N", "n", "O", "o", "O", "o",
    "O", "o", "Oe", "oe", "R", "r", "R", "r", "R", "r", "S", "s", "S", "s", "S", "s",
    "S", "s", "T", "t", "T", "t", "T", "t", "U", "u", "U", "u", "U", "u", "U", "u",
    "U", "u", "U", "u", "W", "w", "Y", "y", "Y", "Z", "z", "Z", "z", "Z", "z", "s",
};
/* clang-format on */
enum { LATIN_FIRST = 0xC0, LATIN_COUNT = sizeof latin / sizeof *latin };

/* Reads one character of UTF-8 text of `left` bytes, and its length. Returns 0 for anything but
 * the first 2048 characters, which are all that the table needs. */
static unsigned read_character(const char *text, size_t left, size_t *length) {
    const unsigned char *c = (const unsigned char *)text;
    *length = 1;
    if (c[0] < 0x80)
        return c[0];
    if ((c[0] & 0xE0) == 0xC0 && left >= 2 && (c[1] & 0xC0) == 0x80) {
        *length = 2;
        return (c[0] & 0x1Fu) << 6 | (c[1] & 0x3Fu);
    }
    while (*length < left && (c[*length] & 0xC0) == 0x80)
        ++*length;
    return 0;
}

/* Appends what stands for a character in an id. Several that have no letter become one '-'. */
static void append_character(char *id, size_t *used, unsigned character) {
    char plain[2] = { (char)character, 0 };
    const char *text = character && character < 0x80 && is_id_char(plain[0]) ? plain : "-";
    if (character >= 0x300 && character < 0x370)
        return; /* an accent of its own: the letter before it stays */
    if (character >= LATIN_FIRST && character < LATIN_FIRST + LATIN_COUNT)
        text = latin[character - LATIN_FIRST];
    if (strcmp(text, "-") == 0 && (*used == 0 || id[*used - 1] == '-'))
        return;
    size_t length = strlen(text);
    if (*used + length > SP_NAME_BYTES - 1 - SUFFIX_BYTES)
        return;
    memcpy(id + *used, text, length);
    *used += length;
}

enum { STEM_BYTES = 512 };

/* Writes the part of a source that names it: of a file with a field both names. Returns its length.
 */
static size_t write_stem(const char *source, char stem[STEM_BYTES]) {
    if (srv_source_is_demo(source)) {
        const char *start = source + DEMO_PREFIX;
        snprintf(stem, STEM_BYTES, "%.*s", (int)strcspn(start, "?"), start);
        return strlen(stem);
    }
    const struct sp_source_parts parts = sp_source_split(source);
    const char *end = source + parts.path_bytes, *start = end;
    while (start > source && start[-1] != '/')
        start--;
    snprintf(stem, STEM_BYTES, "%.*s", (int)(end - start), start);
    size_t length = srv_format_stem(stem);
    stem[length] = 0;
    if (parts.level >= 0)
        snprintf(stem + length, STEM_BYTES - length, " level %d", parts.level);
    length = strlen(stem);
    if (parts.series[0])
        snprintf(stem + length, STEM_BYTES - length, " %s", parts.series);
    length = strlen(stem);
    if (parts.as[0])
        snprintf(stem + length, STEM_BYTES - length, " as %s", parts.as);
    length = strlen(stem);
    if (parts.field[0])
        snprintf(stem + length, STEM_BYTES - length, " %s", parts.field);
    length = strlen(stem);
    if (parts.vectors[0])
        snprintf(stem + length, STEM_BYTES - length, " %s", parts.vectors);
    return strlen(stem);
}

void srv_source_default_id(const char *source, char id[SP_NAME_BYTES]) {
    char stem[STEM_BYTES];
    size_t length = write_stem(source, stem), used = 0, step;
    for (size_t i = 0; i < length; i += step)
        append_character(id, &used, read_character(stem + i, length - i, &step));
    while (used > 0 && id[used - 1] == '-')
        used--;
    id[used] = 0;
    if (!srv_source_is_id(id))
        strcpy(id, "volume");
}

void srv_source_default_name(const char *source, char name[SP_NAME_BYTES]) {
    char stem[STEM_BYTES];
    size_t length = write_stem(source, stem), end = 0, step;
    for (size_t i = 0; i < length && i + 4 < SP_NAME_BYTES; i += step) {
        read_character(stem + i, length - i, &step);
        end = i + step;
    }
    snprintf(name, SP_NAME_BYTES, "%.*s", (int)end, stem);
    proto_text_clean(name);
}
