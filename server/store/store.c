/* SPDX-License-Identifier: Apache-2.0 */
#include "store/store.h"

#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { VIEW_ID = 32, BUCKETS = 1024 };

struct view {
    struct view *next;
    char id[VIEW_ID + 1];
    size_t size;
    char text[];
};

struct srv_store {
    struct srv_store_options options;
    pthread_mutex_t mutex;
    struct view *buckets[BUCKETS];
    unsigned view_count;
};

struct srv_store *srv_store_create(const struct srv_store_options *options, struct sp_error *err) {
    struct srv_store *store = calloc(1, sizeof *store);
    if (!store) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for kept views");
        return NULL;
    }
    store->options = *options;
    pthread_mutex_init(&store->mutex, NULL);
    return store;
}

void srv_store_destroy(struct srv_store **store_pointer) {
    struct srv_store *store = *store_pointer;
    *store_pointer = NULL;
    if (!store)
        return;
    for (size_t i = 0; i < BUCKETS; i++)
        while (store->buckets[i]) {
            struct view *view = store->buckets[i];
            store->buckets[i] = view->next;
            free(view);
        }
    pthread_mutex_destroy(&store->mutex);
    free(store);
}

static struct view **bucket_of(struct srv_store *store, const char *id) {
    uint32_t h = 2166136261u; /* FNV-1a */
    for (const char *c = id; *c; c++)
        h = (h ^ (unsigned char)*c) * 16777619u;
    return &store->buckets[h % BUCKETS];
}

static struct view *find(struct srv_store *store, const char *id) {
    struct view *view = *bucket_of(store, id);
    while (view && strcmp(view->id, id) != 0)
        view = view->next;
    return view;
}

static bool add(struct srv_store *store, const char *id, const char *text, size_t size,
                struct sp_error *err) {
    if (find(store, id))
        return true;
    if (store->view_count >= store->options.views_max)
        return sp_fail(err, SP_ERR_BUDGET, NULL, "%u views are kept and --views allows %u",
                       store->view_count, store->options.views_max);
    struct view *view = strlen(id) == VIEW_ID ? malloc(sizeof *view + size) : NULL;
    if (!view)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for a view of %zu bytes", size);
    struct view **bucket = bucket_of(store, id);
    memcpy(view->id, id, sizeof view->id);
    memcpy(view->text, text, size);
    view->size = size;
    view->next = *bucket;
    *bucket = view;
    store->view_count++;
    return true;
}

void srv_store_put_view(struct srv_store *store, const char *id, const char *text, size_t size,
                        srv_store_done *done, void *user) {
    struct sp_error err;
    pthread_mutex_lock(&store->mutex);
    bool ok = add(store, id, text, size, &err);
    pthread_mutex_unlock(&store->mutex);
    done(user, ok ? NULL : &err);
}

char *srv_store_get_view(struct srv_store *store, const char *id, size_t *size,
                         struct sp_error *err) {
    char *text = NULL;
    pthread_mutex_lock(&store->mutex);
    const struct view *view = find(store, id);
    if (!view) {
        sp_fail(err, SP_ERR_NOT_FOUND, NULL, "there is no kept view '%.64s'", id);
    } else if (!(text = malloc(view->size + 1))) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for a view of %zu bytes", view->size);
    } else {
        memcpy(text, view->text, view->size);
        text[view->size] = 0;
        *size = view->size;
    }
    pthread_mutex_unlock(&store->mutex);
    return text;
}
