/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/warnings.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

enum { LIST_END = 24 }; /* bytes for " and N more" */

void import_hide_descriptors(char *text) {
    static const char hidden[] = "/proc/self/fd/", replacement[] = "the file";
    for (char *at = strstr(text, hidden); at; at = strstr(at, hidden)) {
        const char *rest = at + strlen(hidden);
        rest += strspn(rest, "0123456789");
        memcpy(at, replacement, strlen(replacement)); /* which is shorter */
        at += strlen(replacement);
        memmove(at, rest, strlen(rest) + 1);
    }
}

void import_list_begin(struct import_list *list, char *text, size_t capacity) {
    *list = (struct import_list){ .text = text, .capacity = capacity, .used = strlen(text) };
}

void import_list_add(struct import_list *list, const char *before, const char *name) {
    const size_t more = strlen(before) + strlen(name);
    if (list->left_out || list->used + more + LIST_END >= list->capacity) {
        list->left_out++;
        return;
    }
    list->used += (size_t)snprintf(list->text + list->used, list->capacity - list->used, "%s%s",
                                   before, name);
}

void import_list_end(struct import_list *list, bool has_more) {
    if (has_more)
        snprintf(list->text + list->used, list->capacity - list->used,
                 list->used ? " and others" : "others");
    else if (list->left_out)
        snprintf(list->text + list->used, list->capacity - list->used,
                 list->used ? " and %u more" : "%u", list->left_out);
}

void import_warn(struct import_warnings *warnings, const char *format, ...) {
    enum { LAST = SP_WARNINGS_MAX - 1 };
    char text[SP_WARNING_BYTES];
    va_list args;
    if (!warnings)
        return;
    va_start(args, format);
    int n = vsnprintf(text, sizeof text, format, args);
    va_end(args);
    import_hide_descriptors(text);
    if (n < (int)sizeof text)
        n = (int)strlen(text);
    if (n >= (int)sizeof text) { /* not inside of a UTF-8 character */
        for (n = sizeof text - sizeof "…"; n > 0 && ((unsigned char)text[n] & 0xc0) == 0x80;)
            n--;
        memcpy(text + n, "…", sizeof "…");
    }
    for (unsigned i = 0; i < warnings->count && i < SP_WARNINGS_MAX; i++)
        if (strcmp(warnings->texts[i], text) == 0)
            return;
    if (warnings->count < SP_WARNINGS_MAX)
        memcpy(warnings->texts[warnings->count], text, sizeof text);
    else
        snprintf(warnings->texts[LAST], SP_WARNING_BYTES, "%u more warnings are not listed.",
                 warnings->count - LAST + 1);
    warnings->count++;
}
