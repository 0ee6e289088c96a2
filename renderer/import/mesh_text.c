/* SPDX-License-Identifier: Apache-2.0 */
#include "import/mesh_text.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum { LINE = 256 }; /* bytes, in which the coordinates of a vertex lie */

const char *import_mesh_text_word(const char *extension, const struct mesh_bytes *bytes) {
    const size_t near = bytes->size < 512 ? bytes->size : 512;
    if (strcmp(extension, "obj") == 0)
        return "v";
    return strcmp(extension, "stl") == 0 && !memchr(bytes->start, 0, near) ? "vertex" : NULL;
}

/* Writes the moved vertex of a line. Returns how many bytes of the line it replaces; 0 = the line
 * is no vertex. */
static size_t put_vertex(const char *line, size_t size, const char *word,
                         struct import_shift *shift, FILE *out) {
    char copy[LINE], *end;
    const size_t n = size < LINE - 1 ? size : LINE - 1, length = strlen(word);
    float moved[3];
    memcpy(copy, line, n);
    copy[n] = 0;
    const size_t start = strspn(copy, " \t");
    if (strncasecmp(copy + start, word, length) != 0 || !copy[start + length] ||
        !strchr(" \t", copy[start + length]))
        return 0;
    char *at = copy + start + length;
    for (int a = 0; a < 3; a++, at = end) {
        const double coordinate = strtod(at, &end);
        if (end == at || end == copy + LINE - 1)
            return 0;
        moved[a] = import_shift_put(shift, a, coordinate);
    }
    fprintf(out, "%s %.9g %.9g %.9g", word, (double)moved[0], (double)moved[1], (double)moved[2]);
    return (size_t)(at - copy);
}

bool import_mesh_text_move(const struct mesh_bytes *bytes, const char *word,
                           struct import_shift *shift, char **text, struct mesh_bytes *moved) {
    size_t size = 0;
    *text = NULL;
    FILE *out = open_memstream(text, &size);
    if (!out)
        return false;
    const char *at = (const char *)bytes->start, *end = at + bytes->size;
    while (at < end && !ferror(out)) {
        const char *newline = memchr(at, '\n', (size_t)(end - at));
        const char *next = newline ? newline + 1 : end;
        at += put_vertex(at, (size_t)(next - at), word, shift, out);
        fwrite(at, 1, (size_t)(next - at), out);
        at = next;
    }
    const bool failed = ferror(out) != 0;
    const bool ok = fclose(out) == 0 && !failed;
    *moved = (struct mesh_bytes){ (const unsigned char *)*text, size };
    return ok;
}
