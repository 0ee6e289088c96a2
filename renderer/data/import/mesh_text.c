/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/mesh_text.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum { LINE = 256 }; /* bytes, in which the word and the coordinates of a vertex lie */

static const struct mesh_word obj = { "v", true }, stl = { "vertex", false };

const struct mesh_word *import_mesh_text_word(const char *extension,
                                              const struct mesh_bytes *bytes) {
    const size_t near = bytes->size < 512 ? bytes->size : 512;
    if (strcmp(extension, "obj") == 0)
        return &obj;
    return strcmp(extension, "stl") == 0 && !memchr(bytes->start, 0, near) ? &stl : NULL;
}

static bool is_space(char c) {
    return c == ' ' || c == '\t';
}

struct moving {
    const struct mesh_word *word;
    struct import_shift *shift;
    FILE *out;
    uint64_t moved, lost; /* vertices; those whose coordinates were not found */
};

/* Writes the moved vertex that a text begins with. Returns how many bytes of the text it replaces;
 * 0 = the text does not begin with a vertex. */
static size_t put_vertex(struct moving *m, const char *text, size_t size) {
    const size_t n = size < LINE - 1 ? size : LINE - 1, length = strlen(m->word->text);
    char copy[LINE], *end;
    float moved[3];
    if (n <= length || strncasecmp(text, m->word->text, length) != 0 || !is_space(text[length]))
        return 0;
    memcpy(copy, text, n);
    copy[n] = 0;
    char *at = copy + length;
    for (int a = 0; a < 3; a++, at = end) {
        const double coordinate = strtod(at, &end);
        if (end == at || end == copy + LINE - 1) {
            m->lost++;
            return 0;
        }
        moved[a] = import_shift_put(m->shift, a, coordinate);
    }
    m->moved++;
    fprintf(m->out, "%s %.9g %.9g %.9g", m->word->text, (double)moved[0], (double)moved[1],
            (double)moved[2]);
    return (size_t)(at - copy);
}

/* Writes a line with its vertices moved. */
static void put_line(struct moving *m, const char *at, const char *end) {
    bool is_first = true;
    while (at < end) {
        const char *word = at;
        while (word < end && is_space(*word))
            word++;
        fwrite(at, 1, (size_t)(word - at), m->out);
        at = word;
        if (is_first || !m->word->begins_line)
            at += put_vertex(m, at, (size_t)(end - at));
        is_first = false;
        for (word = at; word < end && !(is_space(*word) && !m->word->begins_line);)
            word++;
        fwrite(at, 1, (size_t)(word - at), m->out);
        at = word;
    }
}

bool import_mesh_text_move(const struct mesh_bytes *bytes, const struct mesh_word *word,
                           struct import_shift *shift, char **text, struct mesh_bytes *moved) {
    size_t size = 0;
    *text = NULL;
    struct moving m = { .word = word, .shift = shift, .out = open_memstream(text, &size) };
    if (!m.out)
        return false;
    const char *at = (const char *)bytes->start, *end = at + bytes->size;
    while (at < end && !ferror(m.out)) {
        const char *newline = memchr(at, '\n', (size_t)(end - at));
        const char *next = newline ? newline + 1 : end;
        put_line(&m, at, next);
        at = next;
    }
    const bool failed = ferror(m.out) != 0;
    const bool ok = fclose(m.out) == 0 && !failed;
    *moved = (struct mesh_bytes){ (const unsigned char *)*text, size };
    if (m.moved == 0 || m.lost > 0) { /* all or none */
        memset(shift->offset, 0, sizeof shift->offset);
        *moved = *bytes;
    }
    return ok;
}
