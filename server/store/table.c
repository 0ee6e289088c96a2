/* SPDX-License-Identifier: Apache-2.0 */
#include "store/table.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

enum { BUCKETS_MIN = 64 };

struct record {
    struct record *in_bucket;      /* next in its bucket */
    struct record *before, *after; /* neighbours in the order of adding */
    struct record *older, *newer;  /* neighbours among the changed records */
    uint64_t stamp;                /* number of its newest change; 0 = written */
    enum srv_kind kind;
    char *text;   /* NULL = removed, and the database still has it */
    char *damage; /* why the text cannot be used; NULL = it can */
    size_t size;
    char id[];
};

struct srv_table {
    struct record **buckets;
    size_t bucket_count, record_count; /* record_count includes removed records */
    struct record *first, *last;
    struct record *oldest, *newest;
    unsigned changed, count[SRV_KINDS];
    uint64_t bytes, stamp;
};

struct srv_table *srv_table_create(void) {
    struct srv_table *table = calloc(1, sizeof *table);
    if (table)
        table->buckets = calloc(BUCKETS_MIN, sizeof *table->buckets);
    if (table && !table->buckets) {
        free(table);
        return NULL;
    }
    if (table)
        table->bucket_count = BUCKETS_MIN;
    return table;
}

void srv_table_destroy(struct srv_table **table_pointer) {
    struct srv_table *table = *table_pointer;
    *table_pointer = NULL;
    if (!table)
        return;
    while (table->first) {
        struct record *r = table->first;
        table->first = r->after;
        free(r->text);
        free(r->damage);
        free(r);
    }
    free(table->buckets);
    free(table);
}

static struct record **bucket_of(const struct srv_table *table, enum srv_kind kind,
                                 const char *id) {
    uint64_t h = UINT64_C(0xcbf29ce484222325) ^ (uint64_t)kind; /* FNV-1a */
    for (const unsigned char *c = (const unsigned char *)id; *c; c++)
        h = (h ^ *c) * UINT64_C(0x100000001b3);
    return &table->buckets[h & (table->bucket_count - 1)];
}

static struct record *find_record(const struct srv_table *table, enum srv_kind kind,
                                  const char *id) {
    struct record *r = *bucket_of(table, kind, id);
    while (r && (r->kind != kind || strcmp(r->id, id) != 0))
        r = r->in_bucket;
    return r;
}

/* Doubles the number of buckets. Without memory the table does not change and becomes slower. */
static void grow(struct srv_table *table) {
    struct record **larger = calloc(table->bucket_count * 2, sizeof *larger);
    if (!larger)
        return;
    free(table->buckets);
    table->buckets = larger;
    table->bucket_count *= 2;
    for (struct record *r = table->first; r; r = r->after) {
        struct record **bucket = bucket_of(table, r->kind, r->id);
        r->in_bucket = *bucket;
        *bucket = r;
    }
}

static void append(struct srv_table *table, struct record *r) {
    r->after = NULL;
    r->before = table->last;
    *(table->last ? &table->last->after : &table->first) = r;
    table->last = r;
}

static void unlink_record(struct srv_table *table, struct record *r) {
    *(r->before ? &r->before->after : &table->first) = r->after;
    *(r->after ? &r->after->before : &table->last) = r->before;
}

static void unmark(struct srv_table *table, struct record *r) {
    if (r->stamp == 0)
        return;
    *(r->older ? &r->older->newer : &table->oldest) = r->newer;
    *(r->newer ? &r->newer->older : &table->newest) = r->older;
    r->older = r->newer = NULL;
    r->stamp = 0;
    table->changed--;
}

static void mark(struct srv_table *table, struct record *r) {
    unmark(table, r);
    r->stamp = ++table->stamp;
    r->older = table->newest;
    *(table->newest ? &table->newest->newer : &table->oldest) = r;
    table->newest = r;
    table->changed++;
}

static void delete_record(struct srv_table *table, struct record *r) {
    struct record **link = bucket_of(table, r->kind, r->id);
    while (*link != r)
        link = &(*link)->in_bucket;
    *link = r->in_bucket;
    unmark(table, r);
    unlink_record(table, r);
    table->record_count--;
    free(r->text);
    free(r->damage);
    free(r);
}

/* Adds (sign +1) or subtracts (-1) the record from the totals. */
static void count(struct srv_table *table, const struct record *r, int sign) {
    uint64_t bytes = strlen(r->id) + r->size;
    table->count[r->kind] += (unsigned)sign;
    table->bytes += sign > 0 ? bytes : -bytes;
}

static struct record *add(struct srv_table *table, enum srv_kind kind, const char *id) {
    size_t length = strlen(id);
    assert(length <= SRV_STORE_ID_MAX && kind < SRV_KINDS);
    struct record *r = calloc(1, sizeof *r + length + 1);
    if (!r)
        return NULL;
    memcpy(r->id, id, length + 1);
    r->kind = kind;
    if (table->record_count >= table->bucket_count)
        grow(table);
    struct record **bucket = bucket_of(table, kind, id);
    r->in_bucket = *bucket;
    *bucket = r;
    append(table, r);
    table->record_count++;
    return r;
}

bool srv_table_put(struct srv_table *table, enum srv_kind kind, const char *id, const char *text,
                   size_t size, bool is_changed) {
    char *copy = malloc(size + 1);
    struct record *r = copy ? find_record(table, kind, id) : NULL;
    if (copy && !r)
        r = add(table, kind, id);
    if (!r) {
        free(copy);
        return false;
    }
    memcpy(copy, text, size);
    copy[size] = 0;
    if (r->text) {
        count(table, r, -1);
    } else { /* new, or put again after it was removed */
        unlink_record(table, r);
        append(table, r);
    }
    free(r->text);
    free(r->damage);
    r->damage = NULL;
    r->text = copy;
    r->size = size;
    count(table, r, 1);
    if (is_changed)
        mark(table, r);
    return true;
}

bool srv_table_remove(struct srv_table *table, enum srv_kind kind, const char *id,
                      bool is_changed) {
    struct record *r = find_record(table, kind, id);
    if (!r || !r->text)
        return false;
    count(table, r, -1);
    free(r->text);
    free(r->damage);
    r->text = r->damage = NULL;
    r->size = 0;
    if (is_changed)
        mark(table, r);
    else
        delete_record(table, r);
    return true;
}

const char *srv_table_get(const struct srv_table *table, enum srv_kind kind, const char *id,
                          size_t *size) {
    const struct record *r = find_record(table, kind, id);
    if (r && r->text)
        *size = r->size;
    return r ? r->text : NULL;
}

bool srv_table_damage(struct srv_table *table, enum srv_kind kind, const char *id,
                      const char *why) {
    struct record *r = find_record(table, kind, id);
    char *copy = r && r->text ? strdup(why) : NULL;
    if (!copy)
        return false;
    free(r->damage);
    r->damage = copy;
    return true;
}

const char *srv_table_damaged(const struct srv_table *table, enum srv_kind kind, const char *id) {
    const struct record *r = find_record(table, kind, id);
    return r ? r->damage : NULL;
}

const char *srv_table_next(const struct srv_table *table, enum srv_kind kind, const void **at,
                           const char **text, size_t *size) {
    const struct record *r = *at ? ((const struct record *)*at)->after : table->first;
    while (r && (r->kind != kind || !r->text))
        r = r->after;
    *at = r;
    if (!r)
        return NULL;
    *text = r->text;
    *size = r->size;
    return r->id;
}

unsigned srv_table_count(const struct srv_table *table, enum srv_kind kind) {
    return table->count[kind];
}

uint64_t srv_table_bytes(const struct srv_table *table) {
    return table->bytes;
}

unsigned srv_table_changes(const struct srv_table *table) {
    return table->changed;
}

void srv_table_change_all(struct srv_table *table) {
    for (struct record *r = table->first; r; r = r->after)
        mark(table, r);
}

/* Allocates one block for the change, its id and its text. */
static struct srv_change *copy_change(const struct record *r) {
    size_t id_size = strlen(r->id) + 1;
    struct srv_change *change = malloc(sizeof *change + id_size + r->size + 1);
    if (!change)
        return NULL;
    char *id = (char *)(change + 1), *text = id + id_size;
    memcpy(id, r->id, id_size);
    if (r->text)
        memcpy(text, r->text, r->size + 1);
    *change = (struct srv_change){
        .stamp = r->stamp, .kind = r->kind, .id = id, .text = r->text ? text : NULL, .size = r->size
    };
    return change;
}

bool srv_table_copy_changes(const struct srv_table *table, struct srv_change **changes) {
    struct srv_change **tail = changes;
    *changes = NULL;
    for (const struct record *r = table->oldest; r; r = r->newer) {
        *tail = copy_change(r);
        if (!*tail) {
            srv_changes_free(changes);
            return false;
        }
        tail = &(*tail)->next;
    }
    return true;
}

void srv_table_written(struct srv_table *table, const struct srv_change *changes) {
    for (const struct srv_change *c = changes; c; c = c->next) {
        struct record *r = find_record(table, c->kind, c->id);
        if (!r || r->stamp != c->stamp)
            continue;
        if (r->text)
            unmark(table, r);
        else
            delete_record(table, r);
    }
}

void srv_changes_free(struct srv_change **changes) {
    while (*changes) {
        struct srv_change *c = *changes;
        *changes = c->next;
        free(c);
    }
}
