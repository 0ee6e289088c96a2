/* SPDX-License-Identifier: Apache-2.0 */
#include "protocol/nearest.h"

#include <ctype.h>
#include <string.h>

enum { LONGEST = 32 }; /* bytes; longer names are not compared */

/* Returns the Levenshtein distance (Wagner and Fischer 1974), one row at a time. Both names have at
 * most LONGEST bytes. */
static unsigned distance(const char *a, const char *b) {
    unsigned row[LONGEST + 1];
    size_t bn = strlen(b);
    for (size_t j = 0; j <= bn; j++)
        row[j] = (unsigned)j;
    for (size_t i = 1; a[i - 1]; i++) {
        unsigned diagonal = row[0];
        row[0] = (unsigned)i;
        for (size_t j = 1; j <= bn; j++) {
            unsigned above = row[j];
            unsigned same = tolower((unsigned char)a[i - 1]) == tolower((unsigned char)b[j - 1]);
            unsigned least = diagonal + !same;
            least = above + 1 < least ? above + 1 : least;
            row[j] = row[j - 1] + 1 < least ? row[j - 1] + 1 : least;
            diagonal = above;
        }
    }
    return row[bn];
}

const char *proto_nearest_name(const char *misspelt, const struct proto_group *group) {
    if (strlen(misspelt) > LONGEST)
        return NULL;
    const char *nearest = NULL;
    unsigned least = 0;
    for (size_t i = 0; i < group->count; i++) {
        const char *name = group->fields[i].name;
        unsigned d = distance(misspelt, name);
        if (3 * d <= strlen(name) + 1 && (!nearest || d < least)) {
            nearest = name;
            least = d;
        }
    }
    return nearest;
}
