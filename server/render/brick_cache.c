/* SPDX-License-Identifier: Apache-2.0 */
#include "render/brick_cache.h"

#include <inttypes.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "render/fingerprint.h"
#include "sp/bricks.h"
#include "sp/log.h"

static const double convert_share = 0.9;

struct scaled_progress {
    const struct sp_load_options *options;
    double from, share;
};

static bool report(void *user, double fraction) {
    const struct scaled_progress *p = user;
    return !p->options->progress ||
           p->options->progress(p->options->user, p->from + p->share * fraction);
}

/* The path of the brick file of a source; false if it is too long. */
static bool find_path(const char *folder, const char *source, char path[PATH_MAX]) {
    char file[PATH_MAX];
    struct stat st = { .st_size = 0 };
    snprintf(file, sizeof file, "%.*s", (int)sp_source_split(source).path_bytes, source);
    int64_t state[3] = { 0 };
    if (stat(file, &st) == 0) {
        state[0] = st.st_mtim.tv_sec;
        state[1] = st.st_mtim.tv_nsec;
        state[2] = st.st_size;
    }
    const struct srv_part parts[] = { { source, strlen(source) }, { state, sizeof state } };
    const struct srv_fingerprint key = srv_fingerprint_of(parts, 2);
    return snprintf(path, PATH_MAX, "%s/%016" PRIx64 "%016" PRIx64 SP_BRICKS_SUFFIX, folder,
                    key.high, key.low) < PATH_MAX;
}

static bool fail_at(const char *source, const struct sp_error *why, struct sp_error *err) {
    return sp_fail(err, why->code, source, "in the brick cache: %.300s", why->text);
}

static bool convert(const char *source, const char *path, const struct sp_load_options *options,
                    struct sp_error *err) {
    struct scaled_progress progress = { options, 0, convert_share };
    struct sp_load_options own = *options;
    struct sp_error why;
    own.progress = report;
    own.user = &progress;
    sp_log(SP_LOG_INFO, "%s does not fit into --memory and is converted for the brick cache",
           source);
    return sp_bricks_convert(source, path, &own, &why) || fail_at(source, &why, err);
}

struct sp_volume *srv_brick_cache_load(const char *folder, const char *source,
                                       const struct sp_load_options *options,
                                       struct sp_error *err) {
    char path[PATH_MAX];
    struct sp_error why;
    struct sp_load_options own = *options;
    own.root = NULL; /* the file lies in the cache, not in the data folder */
    own.progress = NULL;
    if (!find_path(folder, source, path)) {
        sp_fail(err, SP_ERR_INVALID, source, "the path of its file in the brick cache is too long");
        return NULL;
    }
    if (access(path, R_OK) != 0 && !convert(source, path, options, err))
        return NULL;
    struct sp_volume *volume = sp_volume_load(path, &own, &why);
    if (!volume)
        fail_at(source, &why, err);
    return volume;
}
