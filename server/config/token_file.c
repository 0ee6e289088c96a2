/* SPDX-License-Identifier: Apache-2.0 */
#include "config/token_file.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "config/config.h"
#include "sp/log.h"
#include "sp/view.h"

enum { LINE_BYTES = 512, TOKEN_MIN = 16, NUMBER_DIGITS = 6 };
#define NAME_CHARACTERS "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-"

static const struct {
    const char *name;
    unsigned rights;
} roles[] = {
    { "admin",
      SRV_RIGHT_METRICS | SRV_RIGHT_VIEW | SRV_RIGHT_RENDER | SRV_RIGHT_CONTROL | SRV_RIGHT_ADMIN },
    { "control", SRV_RIGHT_VIEW | SRV_RIGHT_RENDER | SRV_RIGHT_CONTROL },
    { "render", SRV_RIGHT_VIEW | SRV_RIGHT_RENDER },
    { "view", SRV_RIGHT_VIEW },
    { "metrics", SRV_RIGHT_METRICS },
};

static bool read_role(const char *value, struct srv_token *token) {
    for (size_t i = 0; i < sizeof roles / sizeof *roles; i++)
        if (strcmp(value, roles[i].name) == 0)
            token->rights = roles[i].rights;
    return token->rights != 0;
}

static bool read_name(const char *value, struct srv_token *token) {
    size_t length = strlen(value);
    if (length == 0 || length >= sizeof token->name || strspn(value, NAME_CHARACTERS) != length)
        return false;
    memcpy(token->name, value, length + 1);
    return true;
}

static bool read_number(const char *value, unsigned max, unsigned *number) {
    size_t length = strlen(value);
    if (length == 0 || length > NUMBER_DIGITS || strspn(value, "0123456789") != length)
        return false;
    *number = (unsigned)strtoul(value, NULL, 10);
    return *number >= 1 && *number <= max;
}

/* Reads a value with the syntax and range of the setting of the same name. */
static bool read_setting(const char *name, const char *value, uint64_t *number, const char *place,
                         struct sp_error *err) {
    struct sp_error why;
    int64_t read;
    if (!srv_config_number(name, value, &read, &why))
        return sp_fail(err, why.code, place, "%s: %s", name, why.text);
    *number = (uint64_t)read;
    return true;
}

static bool fail(struct sp_error *err, const char *place, const char *what) {
    return sp_fail(err, SP_ERR_INVALID, place, "%s", what);
}

static bool check_unset(bool is_unset, const char *word, const char *place, struct sp_error *err) {
    return is_unset || sp_fail(err, SP_ERR_INVALID, place, "%s is given twice", word);
}

#define AT(field) offsetof(struct srv_quota, field)

static const struct {
    const char *name;
    size_t offset; /* of an unsigned in struct srv_quota */
    unsigned max;
} numbers[] = {
    { "sessions", AT(sessions), 100000 },
    { "snapshots", AT(snapshots), 10000 },
    { "views", AT(views), 100000 },
    { "paths", AT(paths), 10000 },
    { "uploads", AT(uploads), 10000 },
    { "volumes", AT(volumes), 1024 },
    { "fps", AT(fps), 120 },
};

static const struct {
    const char *name; /* also the name of a setting */
    size_t offset;    /* of a uint64_t in struct srv_quota */
} sizes[] = {
    { "path-bytes", AT(path_bytes) },
    { "upload-bytes", AT(upload_bytes) },
    { "frame-size", AT(frame_px) },
};

static bool read_quota(const char *word, const char *value, struct srv_quota *quota,
                       const char *place, struct sp_error *err) {
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        unsigned *number = (unsigned *)((char *)quota + numbers[i].offset);
        if (strcmp(word, numbers[i].name) == 0)
            return check_unset(!*number, word, place, err) &&
                   (read_number(value, numbers[i].max, number) ||
                    sp_fail(err, SP_ERR_INVALID, place,
                            "%s: '%.32s' is not a whole number in [1, %u]", word, value,
                            numbers[i].max));
    }
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        uint64_t *number = (uint64_t *)((char *)quota + sizes[i].offset);
        if (strcmp(word, sizes[i].name) == 0)
            return check_unset(!*number, word, place, err) &&
                   read_setting(word, value, number, place, err);
    }
    return fail(err, place, /* the key is not quoted: it could be a mistyped token */
                "unknown key; the keys are role, name, sessions, snapshots, fps, views, paths, "
                "path-bytes, uploads, upload-bytes, volumes and frame-size");
}

/* Reads one "key=value" after the token. */
static bool read_word(char *word, struct srv_token *token, const char *place,
                      struct sp_error *err) {
    char *value = strchr(word, '=');
    if (!value)
        return fail(err, place, "expected key=value after the token, without spaces around =");
    *value++ = 0;
    if (strcmp(word, "role") == 0)
        return check_unset(!token->rights, word, place, err) &&
               (read_role(value, token) ||
                fail(err, place, "role must be one of admin, control, render, view, metrics"));
    if (strcmp(word, "name") == 0)
        return check_unset(!token->name[0], word, place, err) &&
               (read_name(value, token) ||
                fail(err, place, "name must have 1 to 32 characters of [A-Za-z0-9._-]"));
    return read_quota(word, value, &token->quota, place, err);
}

/* Reads a line that is neither empty nor a comment. */
static bool read_line(char *line, const char *place, struct srv_token *token,
                      struct sp_error *err) {
    char *rest = NULL, *word = strtok_r(line, " \t", &rest);
    size_t length = strlen(word);
    *token = (struct srv_token){ .rights = 0 };
    if (length < TOKEN_MIN || length >= SRV_TOKEN_BYTES ||
        strspn(word, NAME_CHARACTERS "~") != length)
        return fail(err, place,
                    "a line must begin with a token of 16 to 128 characters of [A-Za-z0-9._~-]");
    memcpy(token->text, word, length + 1);
    while ((word = strtok_r(NULL, " \t", &rest)))
        if (!read_word(word, token, place, err))
            return false;
    if (!token->rights)
        token->rights = roles[0].rights;
    return true;
}

static bool check_unique(const struct srv_token *list, size_t count, const struct srv_token *token,
                         const char *place, struct sp_error *err) {
    for (size_t i = 0; i < count; i++) {
        if (strcmp(list[i].text, token->text) == 0)
            return fail(err, place, "an earlier line has the same token");
        if (strcmp(list[i].name, token->name) == 0)
            return sp_fail(err, SP_ERR_INVALID, place, "an earlier line has the same name, %s",
                           token->name);
    }
    return true;
}

/* Adds the token of one line to the list; skips empty lines and comments. */
static bool add(const char *text, size_t size, unsigned number, struct srv_token *list,
                size_t *count, struct sp_error *err) {
    char line[LINE_BYTES], place[32];
    snprintf(place, sizeof place, "line %u", number);
    while (size > 0 && strchr(" \t\r", text[size - 1]) && text[size - 1])
        size--;
    while (size > 0 && (*text == ' ' || *text == '\t')) {
        text++;
        size--;
    }
    if (size == 0 || *text == '#')
        return true;
    if (size >= sizeof line)
        return sp_fail(err, SP_ERR_INVALID, place, "the line has %zu bytes; at most %d are allowed",
                       size, LINE_BYTES - 1);
    if (memchr(text, 0, size))
        return fail(err, place, "the line contains a NUL byte");
    if (*count == SRV_TOKENS_MAX)
        return fail(err, place, "at most 1000 tokens are allowed");
    memcpy(line, text, size);
    line[size] = 0;
    struct srv_token *token = &list[*count];
    if (!read_line(line, place, token, err))
        return false;
    token->has_name = token->name[0] != 0;
    if (!token->has_name)
        snprintf(token->name, sizeof token->name, "token-%u", number);
    if (!check_unique(list, *count, token, place, err))
        return false;
    ++*count;
    return true;
}

bool srv_token_file_parse(const char *text, size_t size, struct srv_token **list, size_t *count,
                          struct sp_error *err) {
    size_t lines = 1;
    for (size_t i = 0; i < size; i++)
        lines += text[i] == '\n';
    *count = 0;
    *list = calloc(lines < SRV_TOKENS_MAX ? lines : SRV_TOKENS_MAX, sizeof **list);
    bool ok = *list || sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while reading the tokens");
    const char *end = text + size;
    for (unsigned number = 1; ok && text < end; number++) {
        const char *stop = memchr(text, '\n', (size_t)(end - text));
        size_t length = (size_t)((stop ? stop : end) - text);
        ok = add(text, length, number, *list, count, err);
        text += length + 1;
    }
    if (ok && *count == 0)
        ok = fail(err, "line 1", "the file contains no token");
    if (!ok) {
        free(*list);
        *list = NULL;
    }
    return ok;
}

/* Refuses a file that other users can change: they could grant themselves the role admin. A file
 * that they can read is only reported, because the user of a container may need that. */
static bool check_permissions(FILE *file, const char *path, struct sp_error *err) {
    struct stat st;
    if (fstat(fileno(file), &st) != 0)
        return sp_fail(err, SP_ERR_IO, path, "cannot read the token file: %s", strerror(errno));
    if (st.st_mode & (S_IWGRP | S_IWOTH))
        return sp_fail(err, SP_ERR_DENIED, path,
                       "other users can change this file (mode %04o); run chmod 600 on it",
                       (unsigned)(st.st_mode & 07777));
    if (st.st_mode & S_IROTH)
        sp_log(SP_LOG_WARN,
               "%s: other users can read the tokens (mode %04o); run chmod 600 on this file", path,
               (unsigned)(st.st_mode & 07777));
    return true;
}

/* Warns about tokens without a name that can own objects. The role admin is left out: it may use
 * the objects of all tokens anyway. */
static void warn_of_nameless(const char *path, const struct srv_token *list, size_t count) {
    const char *first = NULL;
    unsigned nameless = 0;
    for (size_t i = 0; i < count; i++)
        if (!list[i].has_name && list[i].rights & SRV_RIGHT_RENDER &&
            !(list[i].rights & SRV_RIGHT_ADMIN)) {
            first = first ? first : list[i].name;
            nameless++;
        }
    if (nameless > 0)
        sp_log(SP_LOG_WARN,
               "%s: %u tokens with the role control or render have no name (first: %s); their "
               "sessions, views and paths belong to the line number, so add name=NAME to each",
               path, nameless, first);
}

bool srv_token_file_read(const char *path, struct srv_token **list, size_t *count,
                         struct sp_error *err) {
    struct sp_error why = { .code = SP_OK };
    FILE *file = srv_open_regular(path);
    if (!file)
        return sp_fail(err, SP_ERR_IO, path, "cannot read the token file: %s", strerror(errno));
    if (!check_permissions(file, path, err)) {
        fclose(file);
        return false;
    }
    char *text = malloc(SRV_TOKEN_FILE_BYTES + 1);
    size_t size = text ? fread(text, 1, SRV_TOKEN_FILE_BYTES + 1, file) : 0;
    int why_not = ferror(file) ? errno : 0;
    fclose(file);
    bool ok = false;
    if (!text)
        sp_fail(err, SP_ERR_MEMORY, path, "out of memory while reading the tokens");
    else if (why_not)
        sp_fail(err, SP_ERR_IO, path, "cannot read the token file: %s", strerror(why_not));
    else if (size > SRV_TOKEN_FILE_BYTES)
        sp_fail(err, SP_ERR_INVALID, path, "the file is larger than %d bytes",
                SRV_TOKEN_FILE_BYTES);
    else if (!(ok = srv_token_file_parse(text, size, list, count, &why)))
        sp_fail(err, why.code, path, "%s%s%s", why.place, why.place[0] ? ": " : "", why.text);
    if (ok)
        warn_of_nameless(path, *list, *count);
    if (text)
        explicit_bzero(text, SRV_TOKEN_FILE_BYTES + 1);
    free(text);
    return ok;
}
