/* SPDX-License-Identifier: Apache-2.0 */
#include "render/redact.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* True for a character that separates a file name from the text around it. */
static bool is_edge(char c) {
    return !c || strchr(" :,;()'\"\n", c) != NULL;
}

void srv_redact_folder(const char *folder, const char *as, const char *text, char *out,
                       size_t size) {
    size_t length = folder ? strlen(folder) : 0, used = 0;
    for (const char *c = text; *c && used + 1 < size;) {
        bool found = length > 1 && (c == text || is_edge(c[-1])) && strncmp(c, folder, length) == 0;
        if (found && c[length] == '/') {
            c += length + 1;
        } else if (found && is_edge(c[length])) {
            used += (size_t)snprintf(out + used, size - used, "%s", as);
            used = used < size ? used : size - 1;
            c += length;
        } else {
            out[used++] = *c++;
        }
    }
    out[used] = 0;
}

/* Returns the folder of an absolute path, malloc'ed. NULL if there is none, or memory is out. */
static char *folder_of(const char *source) {
    const char *slash = *source == '/' ? strrchr(source, '/') : NULL;
    return slash && slash > source ? strndup(source, (size_t)(slash - source)) : NULL;
}

void srv_redact_text(const char *data, const char *source, char *text, size_t size) {
    char *folder = folder_of(source), *once = malloc(size);
    if (once) {
        srv_redact_folder(data, "--data", text, once, size);
        srv_redact_folder(folder, "its folder", once, text, size);
    } else {
        snprintf(text, size, "out of memory");
    }
    free(folder);
    free(once);
}

void srv_redact_source(const char *data, const char *source, char *out, size_t size) {
    srv_redact_folder(data, "--data", source, out, size);
    const char *slash = *out == '/' ? strrchr(out, '/') : NULL;
    if (slash)
        memmove(out, slash + 1, strlen(slash + 1) + 1);
}
