/* SPDX-License-Identifier: Apache-2.0 */
#include "store/store.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "common/fair_share.h"
#include "common/pagination.h"
#include "sp/log.h"
#include "store/database.h"
#include "store/database_files.h"
#include "store/table.h"

struct waiter {
    struct waiter *next;
    void (*done)(void *user, bool durable);
    void *user;
};

struct srv_store {
    struct srv_store_options options;
    struct srv_database *database; /* used by the writer thread; NULL = memory only */
    bool (*collect)(void *user);
    void *user;
    pthread_t writer;
    atomic_bool is_nudged;
    pthread_mutex_t mutex; /* guards all members below */
    pthread_cond_t wake;
    struct srv_table *table;
    struct waiter *waiters;
    bool is_running, stop;
    double next_ms;  /* earliest time of a write that no flush waits for */
    double check_ms; /* time of the next check of the files */
    struct srv_store_status status;
};

static const char *const kind_words[SRV_KINDS] = { "volumes", "sessions", "views",
                                                   "presets", "paths",    "clocks" };

static bool open_database(struct srv_store *store, struct sp_error *err) {
    const char *folder = store->options.folder;
    if (!folder) {
        sp_log(SP_LOG_INFO,
               "no --state: sessions, saved views and camera paths are lost when the daemon ends");
        return true;
    }
    store->status.has_folder = true;
    store->database = srv_database_open(folder, store->options.vfs, err);
    if (!store->database || !srv_database_read(store->database, store->table, err))
        return false;
    sp_log(SP_LOG_INFO,
           "state %s: loaded %u volumes, %u sessions, %u views, %u presets, %u camera paths",
           folder, srv_table_count(store->table, SRV_KIND_VOLUME),
           srv_table_count(store->table, SRV_KIND_SESSION),
           srv_table_count(store->table, SRV_KIND_VIEW),
           srv_table_count(store->table, SRV_KIND_PRESET),
           srv_table_count(store->table, SRV_KIND_PATH));
    return true;
}

struct srv_store *srv_store_create(const struct srv_store_options *options, struct sp_error *err) {
    struct srv_store *store = calloc(1, sizeof *store);
    if (!store || !(store->table = srv_table_create())) {
        free(store);
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while creating the store");
        return NULL;
    }
    store->options = *options;
    atomic_init(&store->is_nudged, false);
    pthread_mutex_init(&store->mutex, NULL);
    srv_clock_cond_init(&store->wake);
    if (!open_database(store, err))
        srv_store_destroy(&store);
    return store;
}

/* The writer. */

/* Updates the status after a write. The caller holds the mutex. */
static void note_result(struct srv_store *store, bool ok, const struct sp_error *err) {
    struct srv_store_status *status = &store->status;
    if (ok && status->is_failing)
        sp_log(SP_LOG_INFO, "state is being written again; nothing was lost");
    if (!ok && !status->is_failing)
        sp_log(SP_LOG_ERROR,
               "cannot write the state; keeping it in memory and trying again: %s: %s", err->place,
               err->text);
    status->is_failing = !ok;
    snprintf(status->reason, sizeof status->reason, "%s", ok ? "" : err->text);
    status->writes += ok;
    status->failures += !ok;
    store->next_ms = srv_clock_ms() + (ok ? store->options.pause_ms : store->options.retry_ms);
}

/* Writes the changes. The caller holds the mutex, which is released during collect() and the write.
 */
static bool write_changes(struct srv_store *store) {
    struct sp_error err = { .code = SP_OK };
    struct srv_change *changes = NULL;
    atomic_store(&store->is_nudged, false);
    pthread_mutex_unlock(&store->mutex);
    bool is_all = !store->collect || store->collect(store->user);
    bool is_intact = srv_database_is_intact(store->database);
    pthread_mutex_lock(&store->mutex);
    store->check_ms = srv_clock_ms() + store->options.check_ms;
    if (!is_intact)
        srv_table_change_all(store->table);
    if (!is_all)
        atomic_store(&store->is_nudged, true); /* try again after a pause */
    else if (srv_table_changes(store->table) == 0 && !store->status.is_failing && is_intact)
        return true;
    bool ok = srv_table_copy_changes(store->table, &changes) ||
              sp_fail(&err, SP_ERR_MEMORY, store->options.folder,
                      "out of memory while copying the changes");
    pthread_mutex_unlock(&store->mutex);
    double start_ms = srv_clock_ms();
    if (ok && !is_intact)
        ok = srv_database_rewrite(store->database, changes, &err);
    else if (ok && changes)
        ok = srv_database_write(store->database, changes, &err);
    double took_ms = srv_clock_ms() - start_ms;
    pthread_mutex_lock(&store->mutex);
    if (ok) {
        srv_table_written(store->table, changes);
        store->status.write_ms = took_ms;
    }
    if (ok && !is_all)
        ok = sp_fail(&err, SP_ERR_MEMORY, store->options.folder,
                     "out of memory while collecting changes of sessions");
    note_result(store, ok, &err);
    srv_changes_free(&changes);
    return ok;
}

static void answer(struct waiter *waiters, bool durable) {
    while (waiters) {
        struct waiter *w = waiters;
        waiters = w->next;
        w->done(w->user, durable);
        free(w);
    }
}

/* Checks that the database is still there. The caller holds the mutex, which is released in
 * between.
 */
static bool is_lost(struct srv_store *store) {
    pthread_mutex_unlock(&store->mutex);
    bool is_intact = srv_database_is_intact(store->database);
    pthread_mutex_lock(&store->mutex);
    store->check_ms = srv_clock_ms() + store->options.check_ms;
    return !is_intact;
}

/* The caller holds the mutex. */
static void wait_until(struct srv_store *store, double until_ms) {
    struct timespec until = srv_clock_at(until_ms);
    pthread_cond_timedwait(&store->wake, &store->mutex, &until);
}

static void *writer_main(void *user) {
    struct srv_store *store = user;
    bool must_write = false;
    pthread_mutex_lock(&store->mutex);
    for (;;) {
        bool has_work = atomic_load(&store->is_nudged) || srv_table_changes(store->table) > 0;
        if (store->waiters || store->stop || must_write ||
            (has_work && srv_clock_ms() >= store->next_ms)) {
            must_write = false;
            bool stop = store->stop;
            struct waiter *waiters = store->waiters;
            store->waiters = NULL;
            bool durable = write_changes(store);
            pthread_mutex_unlock(&store->mutex);
            answer(waiters, durable);
            pthread_mutex_lock(&store->mutex);
            if (stop)
                break;
        } else if (srv_clock_ms() >= store->check_ms) {
            must_write = is_lost(store); /* a flush may have come meanwhile: look again */
        } else {
            wait_until(store, has_work ? fmin(store->next_ms, store->check_ms) : store->check_ms);
        }
    }
    unsigned lost = srv_table_changes(store->table);
    if (lost > 0)
        sp_log(SP_LOG_ERROR, "lost %u changes of the state: %s", lost, store->status.reason);
    struct waiter *late = store->waiters;
    store->waiters = NULL;
    store->is_running = false;
    pthread_mutex_unlock(&store->mutex);
    answer(late, false);
    return NULL;
}

bool srv_store_start(struct srv_store *store, bool (*collect)(void *user), void *user,
                     struct sp_error *err) {
    store->collect = collect;
    store->user = user;
    if (!store->database)
        return true;
    store->is_running = true;
    int failed = pthread_create(&store->writer, NULL, writer_main, store);
    store->is_running = failed == 0;
    return !failed || sp_fail(err, SP_ERR_IO, NULL, "cannot start the store's writer thread: %s",
                              strerror(failed));
}

void srv_store_stop(struct srv_store *store) {
    pthread_mutex_lock(&store->mutex);
    bool join = store->is_running && !store->stop;
    store->stop = true;
    pthread_cond_signal(&store->wake);
    pthread_mutex_unlock(&store->mutex);
    if (join)
        pthread_join(store->writer, NULL);
}

void srv_store_destroy(struct srv_store **store_pointer) {
    struct srv_store *store = *store_pointer;
    *store_pointer = NULL;
    if (!store)
        return;
    srv_store_stop(store);
    srv_database_close(&store->database);
    srv_table_destroy(&store->table);
    pthread_cond_destroy(&store->wake);
    pthread_mutex_destroy(&store->mutex);
    free(store);
}

/* For any thread. */

/* The caller holds the mutex. */
static bool put(struct srv_store *store, enum srv_kind kind, const char *id, const char *text,
                size_t size, struct sp_error *err) {
    bool ok = true;
    size_t old;
    unsigned max = store->options.max[kind], count = srv_table_count(store->table, kind);
    if (max > 0 && count >= max && !srv_table_get(store->table, kind, id, &old))
        ok = sp_fail(err, SP_ERR_BUDGET, NULL, "there are %u %s and --%s allows %u; delete some",
                     count, kind_words[kind], kind_words[kind], max);
    else if (!srv_table_put(store->table, kind, id, text, size, store->database != NULL))
        ok = sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while storing %zu bytes", size);
    else
        pthread_cond_signal(&store->wake);
    return ok;
}

bool srv_store_put(struct srv_store *store, enum srv_kind kind, const char *id, const char *text,
                   size_t size, struct sp_error *err) {
    pthread_mutex_lock(&store->mutex);
    bool ok = put(store, kind, id, text, size, err);
    pthread_mutex_unlock(&store->mutex);
    return ok;
}

/* Counts the records of a kind whose texts begin with `beginning`. The caller holds the mutex. */
static unsigned count_beginning(const struct srv_store *store, enum srv_kind kind,
                                const char *beginning) {
    const void *at = NULL;
    const char *text;
    size_t size, length = strlen(beginning);
    unsigned count = 0;
    while (srv_table_next(store->table, kind, &at, &text, &size))
        count += strncmp(text, beginning, length) == 0;
    return count;
}

/* Checks the owner's quota and share. The caller holds the mutex. */
static bool may_add(const struct srv_store *store, enum srv_kind kind,
                    const struct srv_store_owner *owner, struct sp_error *err) {
    const unsigned max = store->options.max[kind], used = srv_table_count(store->table, kind);
    if (!owner->most && !owner->is_limited)
        return true;
    const unsigned own = count_beginning(store, kind, owner->beginning);
    const struct srv_pool pool = { max > 0 ? max : UINT32_MAX, used, own };
    if (owner->most && own >= owner->most)
        return sp_fail(err, SP_ERR_QUOTA, NULL, "%s has %u %s and its token allows %u; delete some",
                       owner->name, own, kind_words[kind], owner->most);
    return used >= max || srv_fair_left(&pool, owner->is_limited && !owner->most) > 0 ||
           sp_fail(err, SP_ERR_QUOTA, NULL,
                   "%s has %u %s and all tokens %u of the %u that --%s allows; the rest is kept "
                   "for the others; delete some",
                   owner->name, own, kind_words[kind], used, max, kind_words[kind]);
}

bool srv_store_add(struct srv_store *store, enum srv_kind kind, const char *id, const char *text,
                   size_t size, const struct srv_store_owner *owner, struct sp_error *err) {
    size_t old;
    pthread_mutex_lock(&store->mutex);
    bool ok = srv_table_get(store->table, kind, id, &old) ||
              (may_add(store, kind, owner, err) && put(store, kind, id, text, size, err));
    pthread_mutex_unlock(&store->mutex);
    return ok;
}

bool srv_store_remove(struct srv_store *store, enum srv_kind kind, const char *id) {
    pthread_mutex_lock(&store->mutex);
    bool was_there = srv_table_remove(store->table, kind, id, store->database != NULL);
    pthread_cond_signal(&store->wake);
    pthread_mutex_unlock(&store->mutex);
    return was_there;
}

static const char *const kind_names[SRV_KINDS] = { "volume", "session",     "saved view",
                                                   "preset", "camera path", "clock" };

/* The caller holds the mutex. */
static bool is_sound(const struct srv_store *store, enum srv_kind kind, const char *id,
                     struct sp_error *err) {
    const char *damage = srv_table_damaged(store->table, kind, id);
    return !damage || sp_fail(err, SP_ERR_IO, NULL,
                              "the record of the %s '%.127s' is damaged: %.160s; delete it, or ask "
                              "the administrator to restore a copy",
                              kind_names[kind], id, damage);
}

bool srv_store_is_sound(struct srv_store *store, enum srv_kind kind, const char *id,
                        struct sp_error *err) {
    pthread_mutex_lock(&store->mutex);
    bool ok = is_sound(store, kind, id, err);
    pthread_mutex_unlock(&store->mutex);
    return ok;
}

void srv_store_damage(struct srv_store *store, enum srv_kind kind, const char *id,
                      const struct sp_error *why) {
    char text[SP_ERROR_PLACE + SP_ERROR_TEXT + 2];
    snprintf(text, sizeof text, "%s%s%s", why->place, why->place[0] ? ": " : "", why->text);
    if (why->code == SP_ERR_MEMORY) {
        sp_log(SP_LOG_ERROR, "cannot restore %s %s: %s", kind_names[kind], id, text);
        return;
    }
    pthread_mutex_lock(&store->mutex);
    srv_table_damage(store->table, kind, id, text);
    pthread_mutex_unlock(&store->mutex);
    sp_log(
        SP_LOG_ERROR,
        "the record of the %s %s is damaged: %s; requests for it get 500. Delete it, or stop the "
        "daemon and restore a copy of " SRV_DATABASE_NAME,
        kind_names[kind], id, text);
}

static char *get(struct srv_store *store, enum srv_kind kind, const char *id, bool even_damaged,
                 size_t *size, struct sp_error *err) {
    char *copy = NULL;
    size_t bytes = 0;
    pthread_mutex_lock(&store->mutex);
    const char *text = srv_table_get(store->table, kind, id, &bytes);
    const bool is_usable = text && (even_damaged || is_sound(store, kind, id, err));
    if (!text)
        sp_fail(err, SP_ERR_NOT_FOUND, NULL, "there is no record '%.127s'", id);
    else if (is_usable && !(copy = malloc(bytes + 1)))
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while copying %zu bytes", bytes);
    else if (is_usable)
        memcpy(copy, text, bytes + 1);
    pthread_mutex_unlock(&store->mutex);
    if (copy && size)
        *size = bytes;
    return copy;
}

char *srv_store_get(struct srv_store *store, enum srv_kind kind, const char *id, size_t *size,
                    struct sp_error *err) {
    return get(store, kind, id, false, size, err);
}

char *srv_store_get_any(struct srv_store *store, enum srv_kind kind, const char *id, size_t *size,
                        struct sp_error *err) {
    return get(store, kind, id, true, size, err);
}

char *srv_store_ids(struct srv_store *store, enum srv_kind kind) {
    const void *at = NULL;
    const char *id, *text;
    size_t size, used = 0;
    pthread_mutex_lock(&store->mutex);
    size_t most = srv_table_count(store->table, kind) * (size_t)(SRV_STORE_ID_MAX + 1) + 1;
    char *ids = malloc(most);
    while (ids && (id = srv_table_next(store->table, kind, &at, &text, &size))) {
        size_t length = strlen(id) + 1;
        memcpy(ids + used, id, length);
        used += length;
    }
    if (ids)
        ids[used] = 0;
    pthread_mutex_unlock(&store->mutex);
    return ids;
}

void srv_store_page(struct srv_store *store, enum srv_kind kind, const char *beginning,
                    struct srv_page *page) {
    const void *at = NULL;
    const char *id, *text;
    size_t size, length = strlen(beginning);
    pthread_mutex_lock(&store->mutex);
    while ((id = srv_table_next(store->table, kind, &at, &text, &size))) {
        char *slot = strncmp(text, beginning, length) == 0 ? srv_page_slot(page, id) : NULL;
        if (slot)
            strcpy(slot, id);
    }
    pthread_mutex_unlock(&store->mutex);
}

void srv_store_nudge(struct srv_store *store) {
    if (atomic_exchange(&store->is_nudged, true))
        return; /* the writer thread is already notified */
    pthread_mutex_lock(&store->mutex);
    pthread_cond_signal(&store->wake);
    pthread_mutex_unlock(&store->mutex);
}

void srv_store_flush(struct srv_store *store, void (*done)(void *user, bool durable), void *user) {
    struct waiter *waiter = malloc(sizeof *waiter);
    pthread_mutex_lock(&store->mutex);
    bool waits = waiter && store->is_running;
    if (waits) {
        *waiter = (struct waiter){ .next = store->waiters, .done = done, .user = user };
        store->waiters = waiter;
        pthread_cond_signal(&store->wake);
    }
    pthread_mutex_unlock(&store->mutex);
    if (waits)
        return;
    free(waiter);
    done(user, false);
}

void srv_store_status(struct srv_store *store, struct srv_store_status *status) {
    pthread_mutex_lock(&store->mutex);
    *status = store->status;
    for (int k = 0; k < SRV_KINDS; k++)
        status->records[k] = srv_table_count(store->table, (enum srv_kind)k);
    status->bytes = srv_table_bytes(store->table);
    status->waiting = srv_table_changes(store->table);
    pthread_mutex_unlock(&store->mutex);
}
