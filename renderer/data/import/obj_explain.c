/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/mesh_check.h"

enum { LINE = 1024 }; /* bytes; what follows is not looked at */

struct lines {
    const struct import_file *file;
    const unsigned char *at, *end;
    uint64_t number;
    char text[LINE + 1];
};

static bool next(struct lines *l) {
    size_t n = 0;
    if (l->at == l->end)
        return false;
    for (; l->at < l->end && *l->at != '\n'; l->at++)
        if (n < LINE)
            l->text[n++] = *l->at ? (char)*l->at : '?';
    l->at += l->at < l->end;
    l->text[n] = 0;
    l->number++;
    return true;
}

static bool refuse(const struct lines *l, struct sp_error *err, const char *text,
                   const char *word) {
    char place[SP_ERROR_PLACE];
    snprintf(place, sizeof place, "%.120s: line %" PRIu64, l->file->title, l->number);
    return sp_fail(err, SP_ERR_FORMAT, place, "%s: \"%.40s\"", text, word);
}

static bool check_vertex(const struct lines *l, char *rest, struct sp_error *err) {
    for (int a = 0; a < 3; a++) {
        char *word = strtok_r(NULL, " \t\r", &rest), *end;
        if (!word)
            return refuse(l, err, "a vertex has fewer than three numbers", l->text);
        strtod(word, &end);
        if (*end)
            return refuse(l, err, "a vertex has a word that is not a number", word);
    }
    return true;
}

/* Corners are numbers from 1, or −1 for the last vertex so far; a slash and more may follow. */
static bool check_corners(const struct lines *l, char *rest, uint64_t vertices,
                          struct sp_error *err) {
    for (char *word; (word = strtok_r(NULL, " \t\r", &rest)) && *word != '#';) {
        char *end;
        const long long i = strtoll(word, &end, 10);
        if (end == word || (*end && *end != '/'))
            return refuse(l, err, "a corner is not a number", word);
        if (i == 0 || i > (long long)vertices || i < -(long long)vertices)
            return refuse(l, err, "a vertex of this number does not exist", word);
    }
    return true;
}

/* A comment, a vertex, a point or what only names and groups. */
static bool draws_nothing(const char *word) {
    static const char *const known[] = { "v", "vt", "vn", "vp",     "p",     "o",
                                         "g", "mg", "s",  "mtllib", "usemtl" };
    bool is_known = !word || *word == '#';
    for (size_t i = 0; i < sizeof known / sizeof *known && !is_known; i++)
        is_known = strcmp(word, known[i]) == 0;
    return is_known;
}

bool import_obj_explain(const struct import_file *file, const struct mesh_bytes *bytes,
                        bool *is_empty, struct sp_error *err) {
    const struct lines all = { .file = file,
                               .at = bytes->start,
                               .end = bytes->start + bytes->size };
    uint64_t vertices = 0, faces = 0;
    bool ok = true;
    *is_empty = true;
    for (struct lines l = all; next(&l);)
        vertices += l.text[0] == 'v' && (l.text[1] == ' ' || l.text[1] == '\t');
    for (struct lines l = all; ok && next(&l);) {
        char copy[LINE + 1], *rest = NULL;
        strcpy(copy, l.text);
        const char *word = strtok_r(copy, " \t\r", &rest);
        const bool is_face = word && (strcmp(word, "f") == 0 || strcmp(word, "l") == 0);
        faces += is_face;
        *is_empty = *is_empty && draws_nothing(word);
        if (is_face)
            ok = check_corners(&l, rest, vertices, err);
        else if (word && strcmp(word, "v") == 0)
            ok = check_vertex(&l, rest, err);
    }
    if (ok && !faces && !*is_empty)
        return sp_fail(err, SP_ERR_FORMAT, file->title,
                       "%" PRIu64 " vertices, no faces and no lines (\"f\", \"l\")", vertices);
    return ok;
}
