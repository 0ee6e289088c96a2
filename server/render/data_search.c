/* SPDX-License-Identifier: Apache-2.0 */
#include "render/data_search.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "protocol/text.h"
#include "render/formats.h"

/* The time is looked at once per so many names. */
enum { NAMES_PER_LOOK = 64 };

enum { TEXT_MAX = 255 /* characters */, TEXT_BYTES = 4 * TEXT_MAX + 1 };

/* A name of a folder that is being searched. */
struct name {
    char *text;
    char *pattern; /* the same with '*' for each number */
    bool may_be_folder, matches;
};

struct names {
    struct name *list;
    unsigned count, capacity;
};

/* The folder that is being searched. */
struct place {
    const char *folder; /* relative to the data folder */
    char real[PATH_MAX];
    int fd;
    struct srv_data_hit *dicom; /* the hit of its DICOM files; NULL = none yet */
};

bool srv_data_search_check(const char *text, struct sp_error *err) {
    size_t characters = 0;
    for (const char *c = text; *c; c++)
        characters += ((unsigned char)*c & 0xC0) != 0x80;
    return (characters <= TEXT_MAX && strlen(text) < TEXT_BYTES && text[strspn(text, " ")]) ||
           sp_fail(err, SP_ERR_INVALID, "/find",
                   "must have 1 to %d characters, and not only spaces; state a part of a name",
                   TEXT_MAX);
}

/* True if the name has all words of the folded text. */
static bool matches(const char *name, const char *text) {
    char folded[NAME_MAX + 1], word[TEXT_BYTES];
    snprintf(folded, sizeof folded, "%s", name);
    proto_text_fold(folded);
    for (text += strspn(text, " "); *text; text += strspn(text, " ")) {
        const size_t length = strcspn(text, " ");
        memcpy(word, text, length);
        word[length] = 0;
        if (!strstr(folded, word))
            return false;
        text += length;
    }
    return true;
}

static bool fail_memory(struct sp_error *err) {
    return sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a search of the data folder");
}

/* Grows an array that is full. */
static bool reserve(void **list, unsigned count, unsigned *capacity, size_t item_bytes) {
    if (count < *capacity)
        return true;
    const unsigned larger = *capacity ? *capacity * 2 : 64;
    void *moved = realloc(*list, larger * item_bytes);
    if (!moved)
        return false;
    *list = moved;
    *capacity = larger;
    return true;
}

static bool add_folder(struct srv_data_search *search, const char *folder, const char *name,
                       struct sp_error *err) {
    char *path = NULL;
    if (!reserve((void **)&search->folders, search->folder_count, &search->folder_capacity,
                 sizeof *search->folders) ||
        asprintf(&path, "%s%s%s", folder, folder[0] && name[0] ? "/" : "", name) < 0)
        return fail_memory(err);
    search->folders[search->folder_count++] = path;
    return true;
}

static void free_names(struct names *names) {
    for (unsigned i = 0; i < names->count; i++)
        free(names->list[i].text);
    free(names->list);
}

static bool add_name(struct names *names, const struct dirent *item, const char *text) {
    const size_t length = strlen(item->d_name) + 1;
    char *copy = NULL;
    if (!reserve((void **)&names->list, names->count, &names->capacity, sizeof *names->list) ||
        !(copy = malloc(2 * length)))
        return false;
    memcpy(copy, item->d_name, length);
    char *out = copy + length;
    for (const char *c = copy; *c; c++) {
        if (!isdigit((unsigned char)*c))
            *out++ = *c;
        else if (c == copy || !isdigit((unsigned char)c[-1]))
            *out++ = '*';
    }
    *out = 0;
    names->list[names->count++] = (struct name){
        .text = copy,
        .pattern = copy + length,
        .may_be_folder = item->d_type == DT_DIR || item->d_type == DT_UNKNOWN,
        .matches = matches(copy, text),
    };
    return true;
}

/* True if the search of a folder may go on. If it read too many names, it still looks at them. */
static bool may_continue(struct srv_data_search *search) {
    const bool is_over = search->cut == SRV_DATA_CUT_LIMIT || search->cut == SRV_DATA_CUT_TIME;
    if (!is_over && srv_clock_ms() >= search->end_ms)
        search->cut = SRV_DATA_CUT_TIME;
    return !is_over && search->cut != SRV_DATA_CUT_TIME;
}

/* Reads the names of a folder that are not hidden. */
static bool read_names(struct srv_data_search *search, const char *text, DIR *folder,
                       struct names *names) {
    unsigned read = 0;
    for (struct dirent *item; (item = readdir(folder));) {
        if (item->d_name[0] == '.')
            continue;
        if (search->names_max == 0) {
            search->cut = SRV_DATA_CUT_NAMES;
            break;
        }
        search->names_max--;
        if (!add_name(names, item, text))
            return false;
        if (++read % NAMES_PER_LOOK == 0 && !may_continue(search))
            break;
    }
    return true;
}

/* Numbered files come together; a name that has a '*' itself comes before those it stands for. */
static int compare_names(const void *a, const void *b) {
    const struct name *first = a, *second = b;
    const int order = strcmp(first->pattern, second->pattern);
    return order ? order : strcmp(first->text, second->text);
}

/* Returns NULL if the array is full: the list is cut. */
static struct srv_data_hit *add_hit(struct srv_data_search *search, const struct place *place,
                                    const struct srv_data_entry *entry) {
    if (search->count == search->hits_max) {
        search->cut = SRV_DATA_CUT_LIMIT;
        return NULL;
    }
    struct srv_data_hit *hit = &search->hits[search->count++];
    *hit = (struct srv_data_hit){ .entry = *entry, .folder = place->folder, .files = 1 };
    return hit;
}

/* True for a file that opens with all others of its series. */
static bool is_dicom(const struct srv_data_entry *entry) {
    return !entry->is_folder && strcmp(entry->format, "DICOM") == 0;
}

static bool search_name(struct srv_data_search *search, struct place *place,
                        const struct name *name, struct sp_error *err) {
    struct srv_data_entry entry;
    if (!name->matches && !name->may_be_folder)
        return true;
    const enum srv_data_sight sight =
        srv_data_look(search->data, place->real, place->fd, name->text, &entry);
    if (sight == SRV_DATA_UNLISTABLE)
        search->unlisted++;
    if (sight < SRV_DATA_ENTRY)
        return true;
    if (entry.is_folder && sight == SRV_DATA_ENTRY &&
        !add_folder(search, place->folder, name->text, err))
        return false;
    if (!name->matches)
        return true;
    if (!is_dicom(&entry)) {
        add_hit(search, place, &entry);
    } else if (!place->dicom) {
        place->dicom = add_hit(search, place, &entry);
    } else {
        place->dicom->files++;
        place->dicom->entry.size_bytes += entry.size_bytes;
    }
    return true;
}

/* Adds numbered files as one hit. False if they are no time series, or one of them is no match. */
static bool add_series(struct srv_data_search *search, const struct place *place,
                       const struct name *names, unsigned count) {
    struct srv_data_entry series = { .key = "" };
    if (count < 2 || strcmp(names[0].text, names[0].pattern) == 0)
        return false;
    for (unsigned i = 0; i < count; i++) {
        struct srv_data_entry entry;
        if (!names[i].matches || (i % NAMES_PER_LOOK == 0 && !may_continue(search)) ||
            srv_data_look(search->data, place->real, place->fd, names[i].text, &entry) <
                SRV_DATA_ENTRY ||
            entry.is_folder || entry.is_zarr || !srv_format_has_steps(entry.format))
            return false;
        entry.size_bytes += series.size_bytes;
        series = entry;
    }
    snprintf(series.key, sizeof series.key, ":%s", names[0].pattern);
    struct srv_data_hit *hit = add_hit(search, place, &series);
    if (hit)
        hit->files = count;
    return true;
}

static bool search_names(struct srv_data_search *search, struct place *place,
                         const struct names *names, struct sp_error *err) {
    for (unsigned i = 0, end; i < names->count && may_continue(search); i = end) {
        const struct name *run = &names->list[i];
        for (end = i + 1; end < names->count; end++)
            if (strcmp(names->list[end].pattern, run->pattern) != 0)
                break;
        if (add_series(search, place, run, end - i))
            continue;
        for (unsigned k = i; k < end; k++) {
            if (k % NAMES_PER_LOOK == 0 && !may_continue(search))
                break;
            if (!search_name(search, place, &names->list[k], err))
                return false;
        }
    }
    return true;
}

static bool search_folder(struct srv_data_search *search, const char *folder, const char *text,
                          struct sp_error *err) {
    struct place place = { .folder = folder };
    struct names names = { .list = NULL };
    DIR *opened = srv_data_open(search->data, folder, place.real, err);
    if (!opened)
        return false;
    place.fd = dirfd(opened);
    bool ok = read_names(search, text, opened, &names) || fail_memory(err);
    if (ok && names.count > 0) {
        qsort(names.list, names.count, sizeof *names.list, compare_names);
        ok = search_names(search, &place, &names, err);
    }
    closedir(opened);
    free_names(&names);
    return ok;
}

bool srv_data_search(struct srv_data_search *search, const char *path, struct sp_error *err) {
    char text[TEXT_BYTES];
    if (!srv_data_search_check(search->text, err))
        return false;
    snprintf(text, sizeof text, "%s", search->text);
    proto_text_fold(text);
    if (!add_folder(search, path, "", err))
        return false;
    char *first = search->folders[0];
    for (size_t length = strlen(first); length > 1 && first[length - 1] == '/'; length--)
        first[length - 1] = 0;
    for (unsigned i = 0; i < search->folder_count && search->cut == SRV_DATA_CUT_NONE; i++) {
        struct sp_error why;
        if (search_folder(search, search->folders[i], text, &why))
            continue;
        if (i == 0 || why.code == SP_ERR_MEMORY) {
            if (err)
                *err = why;
            return false;
        }
        search->unread += why.code != SP_ERR_NOT_FOUND; /* else it vanished */
    }
    return true;
}

void srv_data_search_finish(struct srv_data_search *search) {
    for (unsigned i = 0; i < search->folder_count; i++)
        free(search->folders[i]);
    free(search->folders);
    search->folders = NULL;
    search->folder_count = search->folder_capacity = 0;
}
