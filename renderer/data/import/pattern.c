/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/pattern.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

bool import_integer(const char *text, long long low, long long high, long long *out) {
    char *end;
    size_t n = strlen(text);
    if (n == 0 || n > 18 || strspn(text, "+-0123456789") != n)
        return false;
    *out = strtoll(text, &end, 10);
    return !*end && *out >= low && *out <= high;
}

/* Cuts the last word off `text` and returns it; NULL if only one word is left. */
static char *cut_word(char *text) {
    size_t n = strlen(text);
    while (n > 0 && (text[n - 1] == ' ' || text[n - 1] == '\t'))
        text[--n] = 0;
    char *space = strrchr(text, ' ');
    if (!space)
        return NULL;
    *space = 0;
    return space + 1;
}

bool import_pattern_parse(const char *value, struct import_pattern *f) {
    snprintf(f->value, sizeof f->value, "%s", value);
    if (!strchr(f->value, '%'))
        return false;
    long long numbers[4];
    int count = 0;
    for (char *word; count < 4; count++) {
        char copy[sizeof f->value];
        snprintf(copy, sizeof copy, "%s", f->value);
        if (!(word = cut_word(copy)) || !import_integer(word, -1000000, 1000000, &numbers[count]))
            break;
        cut_word(f->value);
    }
    if (count < 3)
        return false;
    f->subdim = count == 4 ? numbers[0] : 0;
    f->step = numbers[count - 3];
    f->high = numbers[count - 2];
    f->low = numbers[count - 1];
    const char *percent = strchr(f->value, '%'), *c = percent + 1;
    f->before = (size_t)(percent - f->value);
    f->zeros = *c == '0';
    f->width = 0;
    while (*c >= '0' && *c <= '9' && f->width < 10)
        f->width = f->width * 10 + (*c++ - '0');
    f->after = (size_t)(c + 1 - f->value);
    return (*c == 'd' || *c == 'u' || *c == 'i') && f->width <= 20 && !strchr(c, '%');
}

bool import_pattern_is_sound(const struct import_pattern *f) {
    return f->step > 0 ? f->high >= f->low : f->step < 0 && f->high <= f->low;
}

void import_pattern_name(const struct import_pattern *f, long long number,
                         char name[IMPORT_PATTERN_NAME]) {
    snprintf(name, IMPORT_PATTERN_NAME, f->zeros ? "%.*s%0*lld%s" : "%.*s%*lld%s", (int)f->before,
             f->value, f->width, number, f->value + f->after);
}
