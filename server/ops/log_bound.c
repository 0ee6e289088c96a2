/* SPDX-License-Identifier: Apache-2.0 */
#include "ops/log_bound.h"

#include <math.h>
#include <string.h>

#define LINE_MS 1000.0 /* after which there may be one line more */

void srv_log_bound_init(struct srv_log_bound *bound) {
    memset(bound, 0, sizeof *bound);
    pthread_mutex_init(&bound->mutex, NULL);
}

static struct srv_log_kind *kind_of(struct srv_log_bound *bound, const char *name) {
    unsigned i = 0;
    while (i < bound->count && strcmp(bound->kinds[i].name, name) != 0)
        i++;
    if (i == SRV_LOG_KINDS)
        return &bound->kinds[i - 1];
    if (i == bound->count)
        bound->kinds[bound->count++] = (struct srv_log_kind){ .name = name };
    return &bound->kinds[i];
}

static bool take(struct srv_log_kind *kind, double now_ms, unsigned *left_out) {
    if (kind->full_ms - now_ms > (SRV_LOG_AT_ONCE - 1) * LINE_MS)
        return false;
    kind->full_ms = fmax(kind->full_ms, now_ms) + LINE_MS;
    *left_out = kind->left_out;
    kind->left_out = 0;
    return true;
}

bool srv_log_bound_take(struct srv_log_bound *bound, const char *name, double now_ms,
                        unsigned *left_out) {
    *left_out = 0;
    pthread_mutex_lock(&bound->mutex);
    struct srv_log_kind *kind = kind_of(bound, name);
    bool may = take(kind, now_ms, left_out);
    kind->left_out += !may;
    pthread_mutex_unlock(&bound->mutex);
    return may;
}

const char *srv_log_bound_next(struct srv_log_bound *bound, double now_ms, unsigned *left_out) {
    const char *name = NULL;
    pthread_mutex_lock(&bound->mutex);
    for (unsigned i = 0; i < bound->count && !name; i++)
        if (bound->kinds[i].left_out > 0 && take(&bound->kinds[i], now_ms, left_out))
            name = bound->kinds[i].name;
    pthread_mutex_unlock(&bound->mutex);
    return name;
}
