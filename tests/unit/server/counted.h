/* SPDX-License-Identifier: Apache-2.0 */
#ifndef TESTS_UNIT_SERVER_COUNTED_H
#define TESTS_UNIT_SERVER_COUNTED_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ops/metrics.h"

/* Returns the value of `name{key="value"}` in /metrics; -1 = it is not there. */
static inline long metric_value(const struct srv_metrics *metrics, const char *name,
                                const char *key, const char *value) {
    char *text = NULL, series[96];
    size_t size;
    FILE *out = open_memstream(&text, &size);
    srv_metrics_print(metrics, out);
    fclose(out);
    snprintf(series, sizeof series, "\n%s{%s=\"%s\"} ", name, key, value);
    const char *at = strstr(text, series);
    long count = at ? strtol(at + strlen(series), NULL, 10) : -1;
    free(text);
    return count;
}

/* Returns how many frames were dropped for this reason. */
static inline long counted_drops(const struct srv_metrics *metrics, const char *reason) {
    return metric_value(metrics, "splatd_drops_total", "reason", reason);
}

/* Returns how often this stage was timed. */
static inline long counted_stages(const struct srv_metrics *metrics, const char *stage) {
    return metric_value(metrics, "splatd_stage_seconds_count", "stage", stage);
}

#endif
