/* SPDX-License-Identifier: Apache-2.0 */
#include "ops/log_limit.h"

#include <math.h>
#include <string.h>

#define LINE_MS 1000.0 /* per line, once the burst is used up */

void srv_log_limit_init(struct srv_log_limit *limit) {
    memset(limit, 0, sizeof *limit);
    pthread_mutex_init(&limit->mutex, NULL);
}

static struct srv_log_kind *kind_of(struct srv_log_limit *limit, const char *name) {
    unsigned i = 0;
    while (i < limit->count && strcmp(limit->kinds[i].name, name) != 0)
        i++;
    if (i == SRV_LOG_KINDS)
        return &limit->kinds[i - 1];
    if (i == limit->count)
        limit->kinds[limit->count++] = (struct srv_log_kind){ .name = name };
    return &limit->kinds[i];
}

static bool admit(struct srv_log_kind *kind, double now_ms, unsigned *suppressed) {
    if (kind->full_ms - now_ms > (SRV_LOG_BURST - 1) * LINE_MS)
        return false;
    kind->full_ms = fmax(kind->full_ms, now_ms) + LINE_MS;
    *suppressed = kind->suppressed;
    kind->suppressed = 0;
    return true;
}

bool srv_log_limit_allow(struct srv_log_limit *limit, const char *name, double now_ms,
                         unsigned *suppressed) {
    *suppressed = 0;
    pthread_mutex_lock(&limit->mutex);
    struct srv_log_kind *kind = kind_of(limit, name);
    bool may = admit(kind, now_ms, suppressed);
    kind->suppressed += !may;
    pthread_mutex_unlock(&limit->mutex);
    return may;
}

const char *srv_log_limit_next(struct srv_log_limit *limit, double now_ms, unsigned *suppressed) {
    const char *name = NULL;
    pthread_mutex_lock(&limit->mutex);
    for (unsigned i = 0; i < limit->count && !name; i++)
        if (limit->kinds[i].suppressed > 0 && admit(&limit->kinds[i], now_ms, suppressed))
            name = limit->kinds[i].name;
    pthread_mutex_unlock(&limit->mutex);
    return name;
}
