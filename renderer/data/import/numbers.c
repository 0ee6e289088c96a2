/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/numbers.h"

#include <ctype.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

static const char digits[] = "0123456789";

static const struct {
    const char *word;
    enum import_number_kind meaning;
} words[] = {
    { "z", IMPORT_NUMBER_SLICE },        { "slice", IMPORT_NUMBER_SLICE },
    { "plane", IMPORT_NUMBER_SLICE },    { "section", IMPORT_NUMBER_SLICE },
    { "t", IMPORT_NUMBER_TIME },         { "time", IMPORT_NUMBER_TIME },
    { "tp", IMPORT_NUMBER_TIME },        { "timepoint", IMPORT_NUMBER_TIME },
    { "step", IMPORT_NUMBER_TIME },      { "timestep", IMPORT_NUMBER_TIME },
    { "c", IMPORT_NUMBER_CHANNEL },      { "ch", IMPORT_NUMBER_CHANNEL },
    { "chan", IMPORT_NUMBER_CHANNEL },   { "channel", IMPORT_NUMBER_CHANNEL },
    { "w", IMPORT_NUMBER_CHANNEL },      { "sub", IMPORT_NUMBER_OTHER },
    { "subj", IMPORT_NUMBER_OTHER },     { "subject", IMPORT_NUMBER_OTHER },
    { "pat", IMPORT_NUMBER_OTHER },      { "patient", IMPORT_NUMBER_OTHER },
    { "ses", IMPORT_NUMBER_OTHER },      { "session", IMPORT_NUMBER_OTHER },
    { "echo", IMPORT_NUMBER_OTHER },     { "well", IMPORT_NUMBER_OTHER },
    { "scene", IMPORT_NUMBER_OTHER },    { "tile", IMPORT_NUMBER_OTHER },
    { "position", IMPORT_NUMBER_OTHER }, { "pos", IMPORT_NUMBER_OTHER },
    { "x", IMPORT_NUMBER_OTHER },        { "y", IMPORT_NUMBER_OTHER },
};

/* Returns the k-th number of a name, or the end of the name. */
static const char *find_number(const char *name, unsigned k) {
    for (name += strcspn(name, digits); *name && k > 0; k--) {
        name += strspn(name, digits);
        name += strcspn(name, digits);
    }
    return name;
}

/* Numbers of more than 19 digits become equal only if both have so many. */
static uint64_t number_at(const char *name, unsigned k) {
    return strtoull(find_number(name, k), NULL, 10);
}

/* Wells of a plate have a letter and two digits: A01 to P24. */
static bool is_well(const char *word, size_t length, const char *number) {
    return length == 1 && *word >= 'A' && *word <= 'P' && strspn(number, digits) == 2 &&
           word + 1 == number;
}

/* A word begins at the start, behind another character, or with a capital letter behind a small
 * one. One character may separate it from its number. */
static enum import_number_kind meaning_of(const char *name, unsigned k) {
    const char *number = find_number(name, k), *end = number;
    if (end > name && strchr("_- .", end[-1]))
        end--;
    const char *word = end;
    while (word > name && isalpha((unsigned char)word[-1]) &&
           !(word < end && isupper((unsigned char)*word) && islower((unsigned char)word[-1])))
        word--;
    const size_t length = (size_t)(end - word);
    if (is_well(word, length, number) && *word != 'C') /* a channel, unless another number is */
        return IMPORT_NUMBER_OTHER;
    for (size_t i = 0; i < sizeof words / sizeof *words; i++)
        if (strlen(words[i].word) == length && strncasecmp(words[i].word, word, length) == 0)
            return words[i].meaning;
    return IMPORT_NUMBER_UNKNOWN;
}

static int by_value(const void *a, const void *b) {
    const uint64_t p = *(const uint64_t *)a, q = *(const uint64_t *)b;
    return (p > q) - (p < q);
}

/* How many different values the k-th number has. */
static uint32_t count_values(const struct import_names *files, unsigned k, uint64_t *values) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < files->count; i++)
        values[i] = number_at(files->names[i], k);
    qsort(values, files->count, sizeof *values, by_value);
    for (uint32_t i = 0; i < files->count; i++)
        if (i == 0 || values[i] != values[count - 1])
            values[count++] = values[i];
    return count;
}

struct search {
    struct import_numbers *numbers;
    const char *name;
    bool has[IMPORT_NUMBER_OTHER + 1]; /* numbers that vary have this meaning */
    bool is_fixed_slice;               /* a number that does not vary counts slices */
    unsigned unknown;
    int alone; /* this number is different in all files; −1 = none is */
};

static void guess_meanings(struct search *s, const struct import_names *files,
                           enum import_number_kind main, uint64_t *values) {
    enum import_number_kind *meanings = s->numbers->meanings;
    for (unsigned k = 0; k < s->numbers->count; k++) {
        const uint32_t count = count_values(files, k, values);
        const enum import_number_kind found = meaning_of(s->name, k);
        s->is_fixed_slice |= count == 1 && found == IMPORT_NUMBER_SLICE;
        meanings[k] = count > 1 ? found : IMPORT_NUMBER_FIXED;
        if (count == files->count && (s->alone < 0 || found == main))
            s->alone = (int)k;
    }
}

/* One number tells all files apart. */
static void use_alone(struct search *s, enum import_number_kind main) {
    enum import_number_kind *meanings = s->numbers->meanings, *alone = &meanings[s->alone];
    const enum import_number_kind word = *alone;
    for (unsigned k = 0; k < s->numbers->count; k++)
        meanings[k] = IMPORT_NUMBER_FIXED;
    *alone = main;
    if (main == IMPORT_NUMBER_SLICE && s->is_fixed_slice &&
        (word == IMPORT_NUMBER_TIME || word == IMPORT_NUMBER_CHANNEL))
        *alone = word;
    s->numbers->is_doubtful = *alone != word && word != IMPORT_NUMBER_UNKNOWN;
}

/* Several numbers tell the files apart. From the last one on, since names end with the finest. */
static void use_several(struct search *s, enum import_number_kind main) {
    enum import_number_kind *meanings = s->numbers->meanings;
    for (unsigned k = s->numbers->count; k-- > 0;) {
        if (meanings[k] >= IMPORT_NUMBER_SLICE) {
            if (s->has[meanings[k]])
                meanings[k] = IMPORT_NUMBER_OTHER;
            s->has[meanings[k]] = true;
        }
        s->unknown += meanings[k] == IMPORT_NUMBER_UNKNOWN;
    }
    bool is_told = s->has[IMPORT_NUMBER_SLICE] || s->has[IMPORT_NUMBER_TIME] ||
                   s->has[IMPORT_NUMBER_CHANNEL] || s->has[IMPORT_NUMBER_OTHER];
    s->numbers->are_mixed = !is_told && s->unknown > 1;
    bool has_main = s->has[main];
    for (unsigned k = s->numbers->count; k-- > 0;)
        if (meanings[k] == IMPORT_NUMBER_UNKNOWN) {
            meanings[k] = has_main && is_told ? IMPORT_NUMBER_OTHER : main;
            has_main = true;
        }
}

bool import_numbers_guess(const struct import_names *files, enum import_number_kind main,
                          struct import_numbers *numbers) {
    uint64_t *values = files->count > 1 ? malloc(files->count * sizeof *values) : NULL;
    *numbers = (struct import_numbers){ .count = 0 };
    if (!values)
        return files->count < 2;
    struct search s = { .numbers = numbers, .name = files->names[0], .alone = -1 };
    while (*find_number(s.name, numbers->count))
        numbers->count++;
    guess_meanings(&s, files, main, values);
    free(values);
    if (s.alone >= 0)
        use_alone(&s, main);
    else
        use_several(&s, main);
    return true;
}

static int number_of(const struct import_numbers *numbers, enum import_number_kind meaning) {
    for (unsigned k = 0; k < numbers->count; k++)
        if (numbers->meanings[k] == meaning)
            return (int)k;
    return -1;
}

uint32_t import_numbers_count(const struct import_names *files,
                              const struct import_numbers *numbers, enum import_number_kind meaning,
                              uint64_t *values) {
    const int k = number_of(numbers, meaning);
    uint64_t *own = values ? values : malloc(files->count * sizeof *own);
    const uint32_t count = k >= 0 && own ? count_values(files, (unsigned)k, own) : 1;
    if (!values)
        free(own);
    return count;
}

uint64_t import_numbers_value(const struct import_numbers *numbers, enum import_number_kind meaning,
                              const char *name) {
    const int k = number_of(numbers, meaning);
    return k >= 0 ? number_at(name, (unsigned)k) : 0;
}

static bool is_alike(const struct import_numbers *numbers, enum import_number_kind meaning,
                     const char *a, const char *b) {
    for (unsigned k = 0; k < numbers->count; k++)
        if (numbers->meanings[k] == meaning && number_at(a, k) != number_at(b, k))
            return false;
    return true;
}

uint32_t import_numbers_hold(struct import_names *files, const struct import_numbers *numbers,
                             enum import_number_kind meaning, const char *own,
                             char example[NAME_MAX + 1]) {
    uint32_t kept = 0;
    const uint32_t all = files->count;
    char wanted[NAME_MAX + 1]; /* `own` may be one of the names */
    snprintf(wanted, sizeof wanted, "%s", own);
    for (uint32_t i = 0; i < all; i++) {
        if (is_alike(numbers, meaning, wanted, files->names[i])) {
            char *name = files->names[i];
            files->names[i] = files->names[kept];
            files->names[kept++] = name;
        } else if (example && i == kept) {
            snprintf(example, NAME_MAX + 1, "%s", files->names[i]);
        }
    }
    for (uint32_t i = kept; i < all; i++)
        free(files->names[i]);
    files->count = kept;
    return all - kept;
}

void import_numbers_warn_left_out(uint32_t left_out, const char *example, const char *own,
                                  struct import_warnings *warnings) {
    if (left_out > 0)
        import_warn(warnings,
                    "%" PRIu32 " numbered %s left out, such as %.60s: the numbers tell another "
                    "subject, well, position or channel than those of %.60s. Open %s by name.",
                    left_out, left_out == 1 ? "file was" : "files were", example, own,
                    left_out == 1 ? "it" : "them");
}

/* Numbers that are missing, beside the usual distance between two. */
static void warn_gaps(const uint64_t *values, uint32_t count, const char *what,
                      struct import_warnings *warnings) {
    uint64_t least = UINT64_MAX;
    uint32_t gaps = 0, first = 0;
    for (uint32_t i = 1; i < count; i++)
        if (values[i] - values[i - 1] < least)
            least = values[i] - values[i - 1];
    for (uint32_t i = 1; i < count; i++)
        if (values[i] - values[i - 1] != least) {
            first = gaps == 0 ? i : first;
            gaps++;
        }
    if (gaps > 0)
        import_warn(warnings,
                    "The numbers of the files have %" PRIu32 " %s, such as that from %" PRIu64
                    " to %" PRIu64 ": the %s are shown as if none were missing.",
                    gaps, gaps == 1 ? "gap" : "gaps", values[first - 1], values[first], what);
}

void import_numbers_warn(const struct import_names *files, const struct import_numbers *numbers,
                         enum import_number_kind main, const char *what,
                         struct import_warnings *warnings) {
    if (numbers->are_mixed)
        import_warn(warnings,
                    "Several numbers in the names differ, and nothing tells what they mean: the "
                    "files are %s in the order of all of them. Names such as a_t0_z3_c1 tell time "
                    "(t), slice (z) and channel (c).",
                    what);
    uint64_t *values = malloc((files->count + 1) * sizeof *values);
    if (values && !numbers->are_mixed)
        warn_gaps(values, import_numbers_count(files, numbers, main, values), what, warnings);
    free(values);
}
