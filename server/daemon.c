/* SPDX-License-Identifier: Apache-2.0 */
#include "server/daemon.h"

#include <ctype.h>
#include <errno.h>
#include <malloc.h>
#include <math.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/background.h"
#include "common/clock.h"
#include "common/timer_thread.h"
#include "common/work_queue.h"
#include "http/address.h"
#include "http/cors.h"
#include "http/listener.h"
#include "http/streams.h"
#include "paths/paths.h"
#include "render/brick_cache.h"
#include "render/catalog.h"
#include "render/frame_memory.h"
#include "render/persistence.h"
#include "render/render_pool.h"
#include "session/hub.h"
#include "store/store.h"
#include "uploads/uploads.h"

enum { REFUSALS_MAX = 8, REFUSAL_BYTES = 512 };

struct srv_daemon {
    const struct srv_config *config;
    struct srv_log *log;
    struct srv_brick_cache *cache; /* NULL = none */
    struct srv_catalog *catalog;
    struct srv_render_pool *render_pool;
    struct srv_frame_memory frame_memory;
    struct srv_tokens *tokens;
    char token[SRV_TOKEN_DIGITS + 1]; /* the only token if there is no --token-file */
    struct srv_hub *hub;
    struct srv_schedule *schedule;
    struct srv_store *store;
    struct srv_metrics *metrics;
    struct srv_streams *streams;
    _Atomic(struct srv_paths *) paths; /* also read by the load and timer threads */
    _Atomic(struct srv_http *) http;   /* read by the timer thread while it is being created */
    _Atomic double alive_ms;           /* time of the last run of `tick` */
    struct srv_timer_thread *timers;
    struct srv_timer_task tick;
    struct srv_work_queue *disk;
    struct srv_work_queue *measuring; /* parts of volumes */
    struct srv_work_queue *sampling;  /* slices, regions, profiles and markers */
    struct srv_work_queue *picking;   /* picks: the object at a point of an image */
    struct srv_work_queue *listing;   /* series of folders */
    struct srv_work_queue *searching; /* the data folder */
    struct srv_uploads *uploads;      /* NULL = --upload-bytes is 0 */
    double
        ran_ms; /* plus srv_clock_ms(): for how long daemons have run with this store; constant */
    struct srv_http_options http_options;
    /* Backends that did not start, for /readyz. Constant once the renderer is created. */
    char refusals[REFUSALS_MAX][REFUSAL_BYTES];
    const char *refusal_list[REFUSALS_MAX];
    unsigned refusal_count;
};

/* Callbacks: which part notifies which. */

static void on_progress(void *user, const char *id, enum srv_volume_state state, double progress,
                        const char *reason) {
    struct srv_daemon *d = user;
    srv_hub_volume_progress(d->hub, id, srv_volume_state_name(state), progress, reason,
                            srv_clock_ms());
    struct srv_paths *paths = atomic_load(&d->paths);
    if (paths && state == SRV_VOLUME_UNLOADED)
        srv_paths_unloaded(paths, id);
    else if (paths && state != SRV_VOLUME_LOADING)
        srv_paths_wake(paths);
}

static bool on_volume(void *user, const char *id, const struct srv_volume_request *request) {
    struct srv_daemon *d = user;
    return srv_persistence_put_volume(d->store, id, request);
}

static bool on_upload_open(void *user, const char *id, char path[PATH_MAX], char name[NAME_MAX + 1],
                           struct sp_error *err) {
    struct srv_daemon *d = user;
    return d->uploads ? srv_upload_open(d->uploads, id, path, name, err)
                      : sp_fail(err, SP_ERR_DENIED, NULL, "this daemon takes no uploads");
}

static void on_upload_close(void *user, const char *id, enum srv_volume_state state) {
    struct srv_daemon *d = user;
    if (d->uploads)
        srv_upload_close(d->uploads, id,
                         state == SRV_VOLUME_READY     ? SRV_UPLOAD_LOADED
                         : state == SRV_VOLUME_LOADING ? SRV_UPLOAD_RETURNED
                                                       : SRV_UPLOAD_UNUSED);
}

static void on_changed(void *user) {
    struct srv_daemon *d = user;
    srv_store_nudge(d->store);
}

static void on_ended(void *user, const char *id) {
    struct srv_daemon *d = user;
    srv_store_remove(d->store, SRV_KIND_SESSION, id);
}

static bool on_collect(void *user) {
    struct srv_daemon *d = user;
    return srv_persistence_save_sessions(d->store, d->hub, d->ran_ms + srv_clock_ms());
}

static char *on_recall(void *user, const char *id, size_t *size, struct sp_error *err) {
    struct srv_daemon *d = user;
    return srv_store_get(d->store, SRV_KIND_SESSION, id, size, err);
}

static void on_step(void *user, const char *id) {
    struct srv_daemon *d = user;
    srv_hub_step_loaded(d->hub, id, srv_clock_ms());
    srv_render_pool_step_loaded(d->render_pool);
}

static void on_unloaded(void *user, struct sp_volume *volume) {
    struct srv_daemon *d = user;
    srv_render_pool_evict(d->render_pool, volume);
}

static bool on_token(void *user, const char *name, unsigned *rights, struct srv_quota *quota) {
    struct srv_daemon *d = user;
    return srv_tokens_of_name(d->tokens, name, rights, quota);
}

static bool on_supports(void *user, const struct sp_view *view, struct sp_error *err) {
    struct srv_daemon *d = user;
    return srv_render_pool_supports(d->render_pool, view, err);
}

static void on_ready(void *user) {
    struct srv_daemon *d = user;
    srv_streams_ready(d->streams);
}

/* Runs the timers of all parts, on the timer thread. Each part has its own timer heap. Streams are
 * checked by the stream thread, which this only wakes. */
static double on_tick(void *user, double now_ms) {
    struct srv_daemon *d = user;
    srv_streams_tick(d->streams);
    srv_hub_tick(d->hub, now_ms);
    struct srv_http *http = atomic_load(&d->http);
    if (http)
        srv_http_tick(http, now_ms);
    struct srv_paths *paths = atomic_load(&d->paths);
    if (paths)
        srv_paths_tick(paths, now_ms);
    if (d->uploads)
        srv_uploads_tick(d->uploads, now_ms);
    srv_render_pool_tick(d->render_pool);
    srv_log_tick(d->log, now_ms);
    atomic_store(&d->alive_ms, now_ms);
    return now_ms + SRV_STREAMS_TICK_MS;
}

/* Start. */

static uint64_t half_of_memory(void) {
    long pages = sysconf(_SC_PHYS_PAGES), page = sysconf(_SC_PAGESIZE);
    return pages > 0 && page > 0 ? (uint64_t)pages * (uint64_t)page / 2 : UINT64_C(1) << 30;
}

/* The renderers of the interactive and the snapshot worker may together cache as much as all
 * volumes take, and at least CACHED_BYTES_MIN each, so that they can work. The renderer of the
 * preemption worker has half of what one of them has. Each of the two has half of the GPU memory.
 */
#define LARGE_BYTES (512 << 10)
#define CACHED_BYTES_MIN (UINT64_C(256) << 20)

#define WRITE_PAUSE_MS 250.0
#define WRITE_RETRY_MS 1000.0
#define CHECK_MS 2000.0

static bool open_store(struct srv_daemon *d, struct sp_error *err) {
    const struct srv_config *c = d->config;
    struct srv_store_options store = {
        .folder = c->state,
        .pause_ms = WRITE_PAUSE_MS,
        .retry_ms = WRITE_RETRY_MS,
        .check_ms = CHECK_MS,
        .max = { [SRV_KIND_VIEW] = (unsigned)c->views, [SRV_KIND_PRESET] = (unsigned)c->presets }
    };
    if (!(d->store = srv_store_create(&store, err)))
        return false;
    d->ran_ms = srv_persistence_ran_ms(d->store) - srv_clock_ms();
    return true;
}

/* With --state the file of a loaded volume is kept, because the next start loads it again. */
static bool start_uploads(struct srv_daemon *d, struct sp_error *err) {
    const struct srv_config *c = d->config;
    char in_state[SRV_FOLDER_BYTES];
    if (c->upload_bytes == 0)
        return true;
    if (c->state && !c->upload_dir &&
        snprintf(in_state, sizeof in_state, "%s/uploads", c->state) >= (int)sizeof in_state)
        return sp_fail(err, SP_ERR_INVALID, c->state, "the path of this folder is too long");
    struct srv_uploads_options options = { .folder = c->upload_dir ? c->upload_dir
                                                     : c->state    ? in_state
                                                                   : NULL,
                                           .keeps_loaded = c->state != NULL,
                                           .bytes_max = (uint64_t)c->upload_bytes,
                                           .count_max = (unsigned)c->uploads,
                                           .expiry_ms = (double)c->upload_time_ms,
                                           .begin_ms = (double)c->upload_begin_time_ms,
                                           .tokens = d->tokens,
                                           .metrics = d->metrics,
                                           .disk = d->disk };
    d->uploads = srv_uploads_create(&options, srv_clock_ms(), err);
    return d->uploads != NULL;
}

static void on_backend_refused(void *user, const char *backend, const struct sp_error *why) {
    struct srv_daemon *d = user;
    if (d->refusal_count == REFUSALS_MAX)
        return;
    char *text = d->refusals[d->refusal_count];
    snprintf(text, REFUSAL_BYTES, "backend %s does not start: %s", backend, why->text);
    d->refusal_list[d->refusal_count++] = text;
}

static bool start_renderer(struct srv_daemon *d, struct sp_error *err) {
    const struct srv_config *c = d->config;
    uint64_t budget = c->memory ? (uint64_t)c->memory : half_of_memory();
    struct sp_renderer_options options = { .backend = c->backend,
                                           .gpu = c->gpu,
                                           .require_gpu = c->require_gpu,
                                           .isa = c->isa,
                                           .threads = (unsigned)c->threads,
                                           .video_bytes = ((uint64_t)c->video_memory + 1) / 2,
                                           .memory_bytes = budget / 2 > CACHED_BYTES_MIN
                                                               ? budget / 2
                                                               : CACHED_BYTES_MIN };
    struct sp_renderer_options first = options;
    first.frame_budget = d->frame_memory.sessions;
    first.refused = on_backend_refused;
    first.user = d;
    struct sp_renderer *renderer = sp_renderer_create(&first, err);
    if (!renderer)
        return false;
    d->http_options.refusals = d->refusal_list;
    d->http_options.refusal_count = d->refusal_count;
    struct srv_render_pool_options pool = { .catalog = d->catalog,
                                            .metrics = d->metrics,
                                            .queue_max = (unsigned)c->render_queue,
                                            .encode_threads = (unsigned)c->encode_threads,
                                            .video_px = (uint64_t)c->video_px,
                                            .frame_memory = d->frame_memory,
                                            .renderer = options };
    d->render_pool = srv_render_pool_create(&pool, &renderer, err);
    if (!d->render_pool)
        sp_renderer_destroy(&renderer);
    return d->render_pool != NULL;
}

static bool start_sessions(struct srv_daemon *d, struct sp_error *err) {
    const struct srv_config *c = d->config;
    struct srv_hub_options hub = {
        .volumes = { .user = d->catalog,
                     .acquire = srv_catalog_acquire,
                     .ref = srv_catalog_ref,
                     .release = srv_catalog_release,
                     .steps = srv_catalog_steps,
                     .step = srv_catalog_step,
                     .step_is_ready = srv_catalog_step_is_ready,
                     .nearest_step = srv_catalog_nearest_step,
                     .other_steps = srv_catalog_other_steps,
                     .default_view = srv_catalog_default_view,
                     .spacing = srv_catalog_spacing,
                     .pick = srv_catalog_pick,
                     .measure = srv_catalog_measure,
                     .fits = srv_catalog_fits },
        .sessions_max = (unsigned)c->sessions,
        .participants_max = (unsigned)c->participants,
        .session_idle_ms = (double)c->session_time_ms,
        .hibernation_ms = (double)c->hibernation_time_ms,
        .past_run_ms = d->ran_ms,
        .hibernated_max = (unsigned)c->hibernated_sessions,
        .control_ms = (double)c->control_time_ms,
        .rest_ms = (double)c->rest_time_ms,
        .stream_bytes = (size_t)c->stream_bytes,
        .frame_px = (uint64_t)c->frame_px,
        .metrics = d->metrics,
        .user = d,
        .ready = on_ready,
        .token = on_token,
        .supports = on_supports,
        .changed = on_changed,
        .ended = on_ended,
        .recall = c->state ? on_recall : NULL,
        .measuring = d->measuring,
        .sampling = d->sampling,
        .picking = d->picking,
    };
    const struct srv_schedule_options schedule = { .user = d->render_pool,
                                                   .wake = srv_render_pool_wake,
                                                   .interrupt = srv_render_pool_interrupt };
    if (!(d->hub = srv_hub_create(&hub, err)) ||
        !(d->schedule = srv_schedule_create(d->hub, &schedule, err)))
        return false;
    struct srv_streams_options streams = { .hub = d->hub,
                                           .metrics = d->metrics,
                                           .message_bytes = (size_t)c->message_size,
                                           .ping_ms = (double)c->ping_time_ms,
                                           .stall_ms = (double)c->stall_time_ms };
    if (!(d->streams = srv_streams_create(&streams, err)) ||
        !(d->timers = srv_timer_thread_create(err)))
        return false;
    d->tick = (struct srv_timer_task){ .user = d, .run = on_tick };
    srv_timer_thread_add(d->timers, &d->tick, srv_clock_ms());
    return srv_render_pool_start(d->render_pool, d->schedule, err);
}

/* Reads the token file, or creates a random token. */
static bool start_tokens(struct srv_daemon *d, struct sp_error *err) {
    static const char name[] = "printed";
    const char *file = d->config->token_file;
    struct srv_token *list;
    size_t count;
    if (!(d->tokens = srv_tokens_create(err)) ||
        !(file ? srv_token_file_read(file, &list, &count, err)
               : srv_secret_hex(d->token, SRV_TOKEN_DIGITS, err) &&
                     srv_token_file_parse(d->token, SRV_TOKEN_DIGITS, &list, &count, err)))
        return false;
    if (!file)
        memcpy(list->name, name, sizeof name);
    return srv_tokens_set(d->tokens, list, count, err);
}

/* Used if the fingerprint of the program cannot be read: the ETags of images are then valid for
 * this run only. */
static bool make_random_fingerprint(struct srv_fingerprint *program, struct sp_error *err) {
    char random[SRV_TOKEN_DIGITS + 1];
    if (!srv_secret_hex(random, SRV_TOKEN_DIGITS, err))
        return false;
    *program = srv_fingerprint_of(&(struct srv_piece){ random, SRV_TOKEN_DIGITS }, 1);
    return true;
}

static bool start_http(struct srv_daemon *d, struct sp_error *err) {
    const struct srv_config *c = d->config;
    struct srv_listen listen;
    struct srv_http_options *o = &d->http_options;
    o->config = c;
    o->hub = d->hub;
    o->catalog = d->catalog;
    o->cache = d->cache;
    o->render_pool = d->render_pool;
    o->streams = d->streams;
    o->frame_memory = &d->frame_memory;
    o->tokens = d->tokens;
    o->store = d->store;
    o->paths = atomic_load(&d->paths);
    o->disk = d->disk;
    o->measuring = d->measuring;
    o->sampling = d->sampling;
    o->listing = d->listing;
    o->searching = d->searching;
    o->uploads = d->uploads;
    o->metrics = d->metrics;
    if (!srv_cors_check_origins(c->allow_origin, err) || !srv_listen_parse(c->listen, &listen, err))
        return false;
    if (listen.has_tcp && !c->token_file && !c->tls_cert &&
        !srv_address_is_loopback((const struct sockaddr *)&listen.tcp.storage))
        return sp_fail(
            err, SP_ERR_INVALID, c->listen,
            "another address than loopback needs TLS (--tls-cert FILE --tls-key FILE) or, "
            "behind a reverse proxy that has it, --token-file FILE; or forward a port by ssh");
    if (!srv_fingerprint_program(&o->program) && !make_random_fingerprint(&o->program, err))
        return false;
    struct srv_http *http = srv_http_create(o, err);
    atomic_store(&d->http, http);
    return http != NULL;
}

static bool start_volumes(struct srv_daemon *d, struct sp_error *err) {
    if (!srv_persistence_restore(d->store, d->hub, d->catalog, err))
        return false;
    for (unsigned i = 0; i < d->config->volume_count; i++) {
        struct srv_volume_request request = { .source = d->config->volumes[i] };
        char id[SP_NAME_BYTES];
        bool existed, conflict;
        if (!srv_catalog_add(d->catalog, &request, id, &existed, &conflict, err))
            return false;
    }
    return srv_store_start(d->store, on_collect, d, err);
}

static bool start_paths(struct srv_daemon *d, struct sp_error *err) {
    const struct srv_config *c = d->config;
    struct srv_paths_options options = { .catalog = d->catalog,
                                         .render_pool = d->render_pool,
                                         .store = d->store,
                                         .metrics = d->metrics,
                                         .tokens = d->tokens,
                                         .state = c->state,
                                         .paths_max = (unsigned)c->paths,
                                         .frames_max = (uint32_t)c->path_frames,
                                         .bytes_max = (uint64_t)c->path_bytes,
                                         .budget = d->frame_memory.sessions,
                                         .video_px = (uint64_t)c->video_px };
    struct srv_paths *paths = srv_paths_create(&options, err);
    atomic_store(&d->paths, paths);
    return paths && srv_paths_start(paths, err);
}

/* Returns large blocks to the system when they are freed, for example those of video encoders. By
 * default the C library raises its threshold and keeps larger and larger blocks, in a pool per
 * thread. */
static void give_back_memory(void) {
#ifdef __GLIBC__
    mallopt(M_MMAP_THRESHOLD, LARGE_BYTES);
#endif
}

struct srv_daemon *srv_daemon_start(const struct srv_config *config, struct srv_log *log,
                                    struct sp_error *err) {
    give_back_memory();
    struct srv_daemon *d = calloc(1, sizeof *d);
    if (!d || !(d->metrics = srv_metrics_create())) {
        free(d);
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while starting");
        return NULL;
    }
    d->config = config;
    d->log = log;
    atomic_init(&d->http, NULL);
    atomic_init(&d->paths, NULL);
    atomic_init(&d->alive_ms, srv_clock_ms());
    if (config->cache &&
        !(d->cache = srv_brick_cache_create(config->cache, (uint64_t)config->cache_size, err))) {
        srv_daemon_stop(&d);
        return NULL;
    }
    struct srv_catalog_options catalog = {
        .memory_bytes = config->memory ? (uint64_t)config->memory : half_of_memory(),
        .data = config->data,
        .cache = d->cache,
        .allowed_hosts = config->allow_host,
        .user = d,
        .progress = on_progress,
        .persist = on_volume,
        .upload_open = on_upload_open,
        .upload_close = on_upload_close,
        .step = on_step,
        .unloaded = on_unloaded,
    };
    if ((d->disk = srv_work_queue_create("the disk thread", 0, err)) &&
        (d->measuring = srv_work_queue_create("the measuring thread", SRV_NICE_BACKGROUND, err)) &&
        (d->sampling = srv_work_queue_create("the sampling thread", SRV_NICE_ANSWERS, err)) &&
        (d->picking = srv_work_queue_create("the picking thread", 0, err)) &&
        (d->listing = srv_work_queue_create("the listing thread", SRV_NICE_BACKGROUND, err)) &&
        (d->searching = srv_work_queue_create("the search thread", SRV_NICE_BACKGROUND, err)) &&
        srv_frame_memory_init(&d->frame_memory, (uint64_t)config->render_bytes, err) &&
        open_store(d, err) && start_tokens(d, err) && start_uploads(d, err) &&
        (d->catalog = srv_catalog_create(&catalog, err)) && start_renderer(d, err) &&
        start_sessions(d, err) && start_volumes(d, err) && start_paths(d, err) &&
        start_http(d, err))
        return d;
    srv_daemon_stop(&d);
    return NULL;
}

/* Writes the path of a Unix socket as the host of an address (RFC 3986, 3.2.2). */
static void encode_path(const char *path, char *host, size_t size) {
    size_t used = 0;
    for (const unsigned char *c = (const unsigned char *)path; *c && used + 4 <= size; c++)
        used += (size_t)snprintf(host + used, size - used,
                                 isalnum(*c) || strchr("-._~", *c) ? "%c" : "%%%02X", *c);
}

bool srv_daemon_url(const struct srv_daemon *d, unsigned i, char *url, size_t size) {
    const struct srv_http *http = atomic_load(&d->http);
    const char *address = srv_http_address(http), *path = srv_http_unix_path(http);
    const bool show = !d->config->token_file, is_unix = i == (*address ? 1 : 0);
    char host[SRV_DAEMON_URL_BYTES] = "";
    if (is_unix && *path)
        encode_path(path, host, sizeof host);
    if (i == 0 && *address)
        snprintf(host, sizeof host, "%s", address);
    snprintf(url, size, "http%s://%s/%s%s",
             is_unix               ? "+unix"
             : d->config->tls_cert ? "s"
                                   : "",
             host, show ? "?token=" : "", show ? d->token : "");
    return host[0] != 0;
}

static void on_difference(void *user, const char *name) {
    (void)user;
    if (strcmp(name, "log-level") != 0)
        sp_log(SP_LOG_WARN, "the setting %s has changed and takes effect at the next start", name);
}

void srv_daemon_reload(struct srv_daemon *d, const struct srv_config *fresh) {
    struct sp_error err = { .code = SP_OK };
    enum sp_log_level level;
    srv_config_compare(d->config, fresh, on_difference, NULL);
    if (srv_log_level_from(fresh->log_level, &level))
        sp_log_set_level(level);
    bool is_whole = srv_http_reload(atomic_load(&d->http), &err);
    srv_hub_renew_tokens(d->hub);
    srv_paths_wake(atomic_load(&d->paths)); /* their quotas may have changed */
    if (is_whole)
        sp_log(SP_LOG_INFO, "configuration reloaded");
    else
        sp_log(SP_LOG_ERROR, "reload failed; keeping the old configuration: %s%s%s", err.place,
               err.place[0] ? ": " : "", err.text);
}

double srv_daemon_last_tick_ms(const struct srv_daemon *d) {
    return fmin(atomic_load(&d->alive_ms), srv_streams_alive_ms(d->streams));
}

/* Stopping, from the outside inwards. */

void srv_daemon_stop(struct srv_daemon **daemon) {
    struct srv_daemon *d = *daemon;
    *daemon = NULL;
    if (!d)
        return;
    struct srv_http *http = atomic_load(&d->http);
    if (http)
        srv_http_close(http); /* before clients are notified */
    struct srv_paths *paths = atomic_load(&d->paths);
    if (paths)
        srv_paths_close(paths); /* ends the event streams */
    if (d->hub)
        srv_hub_drain(d->hub);
    if (http)
        srv_http_drain(http, (double)d->config->drain_time_ms);
    srv_work_queue_stop(d->measuring);
    srv_work_queue_stop(d->sampling);
    srv_work_queue_stop(d->picking);
    srv_work_queue_stop(d->listing);
    srv_work_queue_stop(d->searching);
    if (d->catalog)
        srv_catalog_stop(d->catalog);
    if (d->streams)
        srv_streams_drain(d->streams);
    if (d->render_pool)
        srv_render_pool_stop(d->render_pool);
    if (d->store)
        srv_store_stop(d->store);
    srv_work_queue_stop(d->disk);
    /* The render pool, the store and the disk thread have now woken every request that waited for
     * them. */
    /* The streams give their connections back before the listener ends them. */
    srv_timer_thread_destroy(&d->timers); /* first: it uses all parts that follow */
    atomic_store(&d->http, NULL);
    srv_streams_destroy(&d->streams);
    srv_http_destroy(&http);
    atomic_store(&d->paths, NULL);
    srv_paths_destroy(&paths);
    srv_hub_destroy(&d->hub);
    srv_schedule_destroy(&d->schedule);
    srv_tokens_destroy(&d->tokens);
    srv_render_pool_destroy(&d->render_pool);
    srv_catalog_destroy(&d->catalog);
    srv_brick_cache_destroy(&d->cache);
    srv_store_destroy(&d->store);
    srv_work_queue_destroy(&d->disk);
    srv_work_queue_destroy(&d->measuring);
    srv_work_queue_destroy(&d->sampling);
    srv_work_queue_destroy(&d->picking);
    srv_work_queue_destroy(&d->listing);
    srv_work_queue_destroy(&d->searching);
    srv_uploads_destroy(&d->uploads);
    srv_metrics_destroy(&d->metrics);
    srv_frame_memory_finish(&d->frame_memory);
    free(d);
}
