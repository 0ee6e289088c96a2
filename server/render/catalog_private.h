/* SPDX-License-Identifier: Apache-2.0
 *
 * The entries of the catalog, for catalog.c (adding, loading, removing) and catalog_use.c (status
 * and uses).
 */
#ifndef SRV_RENDER_CATALOG_PRIVATE_H
#define SRV_RENDER_CATALOG_PRIVATE_H

#include <pthread.h>

#include "render/catalog.h"

struct srv_volume {
    struct srv_volume *next;
    char id[SP_NAME_BYTES], name[SP_NAME_BYTES];
    char owner[SRV_TOKEN_NAME_BYTES]; /* "" = the operator */
    char *source; /* resolved (render/source.h): the key; "upload:ID" for an uploaded file */
    char *file;   /* of an upload: its path; NULL = `source` is loaded */
    char *shown;  /* of an upload: "upload:NAME", which clients see; NULL = the redacted source */
    bool confined, is_limited, is_persisted, is_restored;
    enum srv_volume_state state;
    double progress, notified_ms; /* notified_ms: when progress() was called last */
    struct sp_error error;
    struct sp_volume *volume;           /* NULL unless ready; constant while used */
    struct sp_view view;                /* default; constant while used */
    struct srv_fingerprint fingerprint; /* constant while used */
    uint64_t reserved_bytes, cached_bytes[SRV_RENDERERS];
    struct sp_joint_histogram
        *joint; /* guarded by joint_mutex until it is set; NULL = not counted */
    unsigned uses;
    /* No longer an entry. While it loads, the load thread frees it, or else its last user. */
    bool is_removed;
};

struct srv_catalog {
    struct srv_catalog_options options;
    char *data; /* resolved; NULL = none */
    /* Taken before `mutex`: notifications are sent in the order in which the events happened. */
    pthread_mutex_t notify_mutex;
    pthread_mutex_t joint_mutex; /* taken alone; held while a joint histogram is counted */
    pthread_mutex_t mutex;       /* guards what follows */
    pthread_cond_t changed;      /* there is something to load, or stop */
    pthread_t loader;
    struct srv_volume *entries; /* in the order of adding */
    unsigned count;
    uint64_t used_bytes;
    struct srv_volume *loading; /* by the load thread now */
    bool stop, is_joined;
};

/* Finds an entry. With the mutex held. */
struct srv_volume *srv_catalog_entry(struct srv_catalog *catalog, const char *id);

/* Frees a removed entry that has no use and is not loading. With no lock of the catalog
 * held. */
void srv_catalog_free_removed(struct srv_catalog *catalog, struct srv_volume *volume);

#endif
