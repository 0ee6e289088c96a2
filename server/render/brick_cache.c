/* SPDX-License-Identifier: Apache-2.0 */
#include "render/brick_cache.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <limits.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "render/fingerprint.h"
#include "sp/bricks.h"
#include "sp/log.h"

enum { KEY_DIGITS = 32 };
static const double convert_share = 0.9;

struct srv_brick_cache {
    char *folder;
    pthread_mutex_t mutex; /* guards what follows, and removing files */
    struct srv_brick_cache_stats stats;
};

/* A file of the cache. */
struct cached {
    char name[KEY_DIGITS + sizeof SP_BRICKS_SUFFIX];
    struct timespec used;
    uint64_t bytes; /* on the disk */
};

static bool is_cached(const char *name) {
    return strspn(name, "0123456789abcdef") == KEY_DIGITS &&
           strcmp(name + KEY_DIGITS, SP_BRICKS_SUFFIX) == 0;
}

static int compare_used(const void *left, const void *right) {
    const struct timespec *a = &((const struct cached *)left)->used;
    const struct timespec *b = &((const struct cached *)right)->used;
    if (a->tv_sec != b->tv_sec)
        return a->tv_sec < b->tv_sec ? -1 : 1;
    return (a->tv_nsec > b->tv_nsec) - (a->tv_nsec < b->tv_nsec);
}

/* Lists the files of the folder, those first that were used longest ago; malloc'ed. Without memory
 * or a folder there are none. */
static struct cached *list_files(const char *folder, size_t *count) {
    struct cached *files = NULL;
    size_t capacity = 0;
    DIR *dir = opendir(folder);
    *count = 0;
    for (struct dirent *entry; dir && (entry = readdir(dir));) {
        struct stat st;
        if (!is_cached(entry->d_name) || fstatat(dirfd(dir), entry->d_name, &st, 0) != 0)
            continue;
        if (*count == capacity) {
            struct cached *more = realloc(files, (2 * capacity + 16) * sizeof *files);
            if (!more)
                break;
            files = more;
            capacity = 2 * capacity + 16;
        }
        struct cached *file = &files[(*count)++];
        memcpy(file->name, entry->d_name, sizeof file->name);
        file->used = st.st_mtim;
        file->bytes = (uint64_t)st.st_blocks * 512;
    }
    if (dir)
        closedir(dir);
    if (*count)
        qsort(files, *count, sizeof *files, compare_used);
    return files;
}

/* Removes a file that no daemon has open. */
static bool remove_file(const struct srv_brick_cache *cache, const char *name) {
    char path[PATH_MAX];
    snprintf(path, sizeof path, "%s/%s", cache->folder, name);
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    bool ok = fd >= 0 && flock(fd, LOCK_EX | LOCK_NB) == 0 && unlink(path) == 0;
    if (fd >= 0)
        close(fd);
    return ok;
}

/* Removes files until the rest is within the limit, and counts it. With the mutex held. */
static void trim(struct srv_brick_cache *cache) {
    struct srv_brick_cache_stats *stats = &cache->stats;
    size_t count;
    struct cached *files = list_files(cache->folder, &count);
    stats->files = count;
    stats->bytes = 0;
    for (size_t i = 0; i < count; i++)
        stats->bytes += files[i].bytes;
    for (size_t i = 0; stats->bytes_max && i < count && stats->bytes > stats->bytes_max; i++)
        if (remove_file(cache, files[i].name)) {
            stats->files--;
            stats->bytes -= files[i].bytes;
            stats->removals++;
            sp_log(SP_LOG_INFO, "%s removed from the brick cache: it exceeds --cache-size",
                   files[i].name);
        }
    free(files);
}

struct srv_brick_cache *srv_brick_cache_create(const char *folder, uint64_t bytes_max,
                                               struct sp_error *err) {
    struct srv_brick_cache *cache = calloc(1, sizeof *cache);
    if (!cache || !(cache->folder = strdup(folder))) {
        free(cache);
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the brick cache");
        return NULL;
    }
    if ((mkdir(folder, 0700) != 0 && errno != EEXIST) || access(folder, R_OK | W_OK | X_OK) != 0) {
        sp_fail(err, SP_ERR_IO, "--cache", "cannot use the folder %s: %s", folder, strerror(errno));
        free(cache->folder);
        free(cache);
        return NULL;
    }
    pthread_mutex_init(&cache->mutex, NULL);
    cache->stats.bytes_max = bytes_max;
    trim(cache);
    return cache;
}

void srv_brick_cache_destroy(struct srv_brick_cache **pointer) {
    struct srv_brick_cache *cache = *pointer;
    *pointer = NULL;
    if (!cache)
        return;
    pthread_mutex_destroy(&cache->mutex);
    free(cache->folder);
    free(cache);
}

void srv_brick_cache_stats(struct srv_brick_cache *cache, struct srv_brick_cache_stats *stats) {
    pthread_mutex_lock(&cache->mutex);
    *stats = cache->stats;
    pthread_mutex_unlock(&cache->mutex);
}

struct scaled_progress {
    const struct sp_load_options *options;
    double from, share;
};

static bool report(void *user, double fraction) {
    const struct scaled_progress *p = user;
    return !p->options->progress ||
           p->options->progress(p->options->user, p->from + p->share * fraction);
}

/* What tells that a file has changed. */
static void add_state(const char *name, const struct stat *st, uint64_t state[2]) {
    const int64_t numbers[3] = { st->st_mtim.tv_sec, st->st_mtim.tv_nsec, st->st_size };
    const struct srv_piece pieces[] = { { name, strlen(name) }, { numbers, sizeof numbers } };
    const struct srv_fingerprint one = srv_fingerprint_of(pieces, 2);
    state[0] += one.high; /* in any order of the files */
    state[1] += one.low;
}

/* Reads the state of a file; for a folder, or a pattern of names, the state of all files in the
 * folder. */
static void read_state(const char *source, uint64_t state[2]) {
    char path[PATH_MAX];
    struct stat st;
    snprintf(path, sizeof path, "%.*s", (int)sp_source_split(source).path_bytes, source);
    bool is_there = stat(path, &st) == 0;
    if (is_there && !S_ISDIR(st.st_mode)) {
        add_state("", &st, state);
        return;
    }
    char *slash = strrchr(path, '/');
    if (!is_there && slash)
        *slash = 0;
    DIR *dir = opendir(path);
    for (struct dirent *entry; dir && (entry = readdir(dir));)
        if (fstatat(dirfd(dir), entry->d_name, &st, 0) == 0)
            add_state(entry->d_name, &st, state);
    if (dir)
        closedir(dir);
}

/* The path of the brick file of a source; false if it is too long. */
static bool fill_path(const struct srv_brick_cache *cache, const char *source,
                      const struct sp_load_options *options, char path[PATH_MAX]) {
    uint64_t state[2] = { 0 };
    const uint32_t step = options->has_step ? options->step : UINT32_MAX;
    read_state(source, state);
    const struct srv_piece pieces[] = { { source, strlen(source) },
                                        { state, sizeof state },
                                        { &step, sizeof step } };
    const struct srv_fingerprint key = srv_fingerprint_of(pieces, 3);
    return snprintf(path, PATH_MAX, "%s/%016" PRIx64 "%016" PRIx64 SP_BRICKS_SUFFIX, cache->folder,
                    key.high, key.low) < PATH_MAX;
}

static bool fail_at(const char *source, const struct sp_error *why, struct sp_error *err) {
    return sp_fail(err, why->code, source, "in the brick cache: %.300s", why->text);
}

static bool convert(struct srv_brick_cache *cache, const char *source, const char *path,
                    const struct sp_load_options *options, struct sp_error *err) {
    struct scaled_progress progress = { options, 0, convert_share };
    struct sp_load_options own = *options;
    struct sp_error why;
    own.progress = report;
    own.user = &progress;
    sp_log(SP_LOG_INFO, "%s does not fit into --memory and is converted for the brick cache",
           source);
    if (!sp_bricks_convert(source, path, &own, &why))
        return fail_at(source, &why, err);
    pthread_mutex_lock(&cache->mutex);
    cache->stats.conversions++;
    pthread_mutex_unlock(&cache->mutex);
    return true;
}

/* Opens the brick file and notes that it was used. */
static struct sp_volume *open_file(const char *path, const struct sp_load_options *options,
                                   struct sp_error *err) {
    struct sp_load_options own = *options;
    own.root = NULL; /* the file lies in the cache, not in the data folder */
    own.progress = NULL;
    struct sp_volume *volume = sp_volume_load(path, &own, err);
    if (volume)
        utimensat(AT_FDCWD, path, NULL, 0);
    return volume;
}

struct sp_volume *srv_brick_cache_load(struct srv_brick_cache *cache, const char *source,
                                       const struct sp_load_options *options,
                                       struct sp_error *err) {
    char path[PATH_MAX];
    struct sp_error why;
    if (!fill_path(cache, source, options, path)) {
        sp_fail(err, SP_ERR_INVALID, source, "the path of its file in the brick cache is too long");
        return NULL;
    }
    struct sp_volume *volume = open_file(path, options, &why);
    /* Another daemon may have removed it, or it is damaged. */
    if (!volume && (why.code == SP_ERR_NOT_FOUND || why.code == SP_ERR_FORMAT ||
                    why.code == SP_ERR_UNSUPPORTED)) {
        if (!convert(cache, source, path, options, err))
            return NULL;
        volume = open_file(path, options, &why);
    }
    if (!volume)
        fail_at(source, &why, err);
    pthread_mutex_lock(&cache->mutex);
    trim(cache);
    pthread_mutex_unlock(&cache->mutex);
    return volume;
}
