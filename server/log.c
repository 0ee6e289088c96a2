/* SPDX-License-Identifier: Apache-2.0 */
#include "log.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

static const char *const levels[] = { "error", "warn", "info", "debug" };

static void sink(void *user, enum sp_log_level level, const char *line) {
    struct srv_log *log = user;
    char quoted[2200], stamp[32];
    size_t used = 0;
    struct timespec now;
    struct tm utc;
    for (const char *c = line; *c && used + 3 < sizeof quoted; c++) {
        if (*c == '"' || *c == '\\')
            quoted[used++] = '\\';
        quoted[used++] = *c;
    }
    quoted[used] = 0;
    clock_gettime(CLOCK_REALTIME, &now);
    gmtime_r(&now.tv_sec, &utc);
    strftime(stamp, sizeof stamp, "%Y-%m-%dT%H:%M:%S", &utc);
    /* One call, one line: lines of several threads do not mix. */
    fprintf(stderr, "time=%s.%03ldZ level=%s msg=\"%s\"\n", stamp, now.tv_nsec / 1000000,
            levels[level], quoted);
    if (log->capture && level == SP_LOG_WARN && strncmp(line, "backend ", 8) == 0 &&
        log->refusal_count < SRV_LOG_REFUSALS)
        snprintf(log->refusals[log->refusal_count++], SRV_LOG_REFUSAL_BYTES, "%s", line);
}

void srv_log_init(struct srv_log *log, const char *level) {
    memset(log, 0, sizeof *log);
    enum sp_log_level chosen = SP_LOG_INFO;
    for (unsigned i = 0; i < sizeof levels / sizeof *levels; i++)
        if (strcmp(levels[i], level) == 0)
            chosen = (enum sp_log_level)i;
    sp_log_init(sink, log, chosen);
}
