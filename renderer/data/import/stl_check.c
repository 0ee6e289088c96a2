/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "data/import/mesh_check.h"

enum {
    HEAD = 84,
    FACET = 50,
    WORD = 40
}; /* bytes; a title and the number of triangles come first */

/* Text begins with the word "solid" and has no zero byte at its start, unlike the titles of binary
 * files that begin with that word. */
static bool is_text(const struct mesh_bytes *bytes) {
    size_t start = 0, near = bytes->size < 512 ? bytes->size : 512;
    while (start < near && strchr(" \t\r\n", bytes->start[start]))
        start++;
    return near - start >= 5 && strncasecmp((const char *)bytes->start + start, "solid", 5) == 0 &&
           !memchr(bytes->start, 0, near);
}

bool import_stl_check(const struct import_file *file, struct mesh_bytes *bytes, bool *is_empty,
                      struct sp_error *err) {
    const unsigned char *n = bytes->start + 80;
    *is_empty = false;
    if (bytes->size < HEAD)
        return is_text(bytes) ||
               import_fail(err, SP_ERR_FORMAT, file->title, 0, NULL,
                           "%zu bytes that do not begin with \"solid\": a binary STL file has at "
                           "least %d",
                           bytes->size, HEAD);
    const uint64_t count = n[0] | (uint32_t)n[1] << 8 | (uint32_t)n[2] << 16 | (uint64_t)n[3] << 24;
    const uint64_t needed = HEAD + FACET * count;
    if (bytes->size != needed && is_text(bytes))
        return true;
    if (bytes->size < needed)
        return import_fail(err, SP_ERR_FORMAT, file->title, 80, "triangles",
                           "%" PRIu64 " triangles need %" PRIu64 " bytes, the file has %zu: it is "
                           "cut off or the number is wrong",
                           count, needed, bytes->size);
    if (bytes->size > needed)
        import_warn(file->warnings,
                    "The file goes on after its last triangle; these %" PRIu64
                    " bytes are not read.",
                    bytes->size - needed);
    bytes->size = needed;
    *is_empty = count == 0;
    return true;
}

/* Words of a text, with the number of their line. */
struct words {
    const unsigned char *at, *end;
    uint64_t line;
    char word[WORD + 1]; /* "" = the end */
};

static void next(struct words *w) {
    size_t n = 0;
    for (; w->at < w->end && (*w->at <= ' '); w->at++)
        w->line += *w->at == '\n';
    for (; w->at<w->end && * w->at> ' '; w->at++)
        if (n < WORD)
            w->word[n++] = (char)*w->at;
    w->word[n] = 0;
}

static void skip_line(struct words *w) {
    while (w->at < w->end && *w->at != '\n')
        w->at++;
}

static bool is_number(const char *word) {
    char *end;
    strtod(word, &end);
    return *word && !*end;
}

/* `wanted`: words of a facet; "#" = a number. Returns the one that is not there; NULL = all are. */
static const char *check_facet(struct words *w) {
    static const char *const wanted[] = { "normal", "#",      "#", "#",       "outer",
                                          "loop",   "vertex", "#", "#",       "#",
                                          "vertex", "#",      "#", "#",       "vertex",
                                          "#",      "#",      "#", "endloop", "endfacet" };
    for (size_t i = 0; i < sizeof wanted / sizeof *wanted; i++) {
        next(w);
        if (*wanted[i] == '#' ? !is_number(w->word) : strcasecmp(w->word, wanted[i]) != 0)
            return *wanted[i] == '#' ? "a number" : wanted[i];
    }
    return NULL;
}

bool import_stl_explain(const struct import_file *file, const struct mesh_bytes *bytes,
                        bool *is_empty, struct sp_error *err) {
    struct words w = { bytes->start, bytes->start + bytes->size, 1, "" };
    const char *missing = NULL;
    char place[SP_ERROR_PLACE];
    bool has_facet = false, has_end = false;
    *is_empty = false;
    if (!is_text(bytes))
        return true;
    for (next(&w); w.word[0] && !missing; next(&w)) {
        const bool is_facet = strcasecmp(w.word, "facet") == 0;
        has_facet |= is_facet;
        has_end = strcasecmp(w.word, "endsolid") == 0;
        if (has_end || strcasecmp(w.word, "solid") == 0)
            skip_line(&w);
        else
            missing = is_facet ? check_facet(&w) : "facet\" or \"endsolid";
        if (missing)
            break;
    }
    *is_empty = !missing && !has_facet && has_end;
    if (!missing && (has_facet || has_end))
        return true;
    snprintf(place, sizeof place, "%.120s: line %" PRIu64, file->title, w.line);
    if (!missing)
        return sp_fail(err, SP_ERR_FORMAT, place,
                       "the file ends before \"endsolid\": it is cut off");
    if (!w.word[0])
        return sp_fail(err, SP_ERR_FORMAT, place, "the file ends inside of a facet: it is cut off");
    return sp_fail(err, SP_ERR_FORMAT, place, "\"%s\" stands where %s%s%s is expected", w.word,
                   missing[1] == ' ' ? "" : "\"", missing, missing[1] == ' ' ? "" : "\"");
}
