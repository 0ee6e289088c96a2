/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/numbered.h"

#include <ctype.h>
#include <dirent.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "base/grow.h"

static const char digits[] = "0123456789";

bool import_names_append(struct import_names *list, const char *name) {
    if (!sp_grow(&list->names, list->count, sizeof *list->names))
        return false;
    char *copy = list->names[list->count] = strdup(name);
    list->count += copy != NULL;
    return copy != NULL;
}

void import_names_finish(struct import_names *list) {
    for (uint32_t i = 0; i < list->count; i++)
        free(list->names[i]);
    free(list->names);
    *list = (struct import_names){ .count = 0 };
}

bool sp_numbered_pattern(const char *name, char pattern[NAME_MAX + 1]) {
    size_t used = 0;
    bool has_number = false;
    if (strlen(name) > NAME_MAX)
        return false;
    while (*name) {
        const size_t number = strspn(name, digits);
        has_number = has_number || number > 0;
        pattern[used++] = number > 0 ? '*' : *name;
        name += number > 0 ? number : 1;
    }
    pattern[used] = 0;
    return has_number;
}

bool sp_numbered_matches(const char *pattern, const char *name) {
    bool has_number = false;
    for (; *pattern; pattern++) {
        const size_t number = *pattern == '*' ? strspn(name, digits) : 0;
        if (number == 0 && tolower((unsigned char)*pattern) != tolower((unsigned char)*name))
            return false;
        has_number = has_number || number > 0;
        name += number > 0 ? number : 1;
    }
    return has_number && !*name;
}

/* Compares the numbers in two names that match one pattern. */
static int by_number(const void *a, const void *b) {
    const char *p = *(const char *const *)a, *q = *(const char *const *)b;
    while (*p && *q) {
        const size_t zeros[2] = { strspn(p, "0"), strspn(q, "0") };
        const size_t n = strspn(p + zeros[0], digits), m = strspn(q + zeros[1], digits);
        if (n != m)
            return n < m ? -1 : 1;
        const int order = strncmp(p + zeros[0], q + zeros[1], n);
        if (order != 0)
            return order;
        p += zeros[0] + n ? zeros[0] + n : 1;
        q += zeros[1] + n ? zeros[1] + n : 1;
    }
    return 0;
}

bool sp_numbered_list(const char *folder, const char *pattern, uint32_t most,
                      struct import_names *files, const char *place, struct sp_error *err) {
    DIR *listed = opendir(folder);
    bool ok = true;
    if (!listed)
        return sp_fail(err, SP_ERR_IO, place, "cannot list the folder: %s", strerror(errno));
    for (const struct dirent *entry; ok && files->count < most && (entry = readdir(listed));)
        if (sp_numbered_matches(pattern, entry->d_name))
            ok = import_names_append(files, entry->d_name);
    closedir(listed);
    if (files->count > 1)
        qsort(files->names, files->count, sizeof *files->names, by_number);
    return ok || sp_fail(err, SP_ERR_MEMORY, place, "out of memory for the names of files");
}
