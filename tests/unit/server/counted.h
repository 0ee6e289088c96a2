/* SPDX-License-Identifier: Apache-2.0 */
#ifndef TESTS_UNIT_SERVER_COUNTED_H
#define TESTS_UNIT_SERVER_COUNTED_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "metrics.h"

/* Frames that were dropped for this reason, as /metrics tells; -1 = it tells nothing of that. */
static inline long counted_drops(const struct srv_metrics *metrics, const char *reason) {
    char *text = NULL, series[64];
    size_t size;
    FILE *out = open_memstream(&text, &size);
    srv_metrics_print(metrics, out);
    fclose(out);
    snprintf(series, sizeof series, "\nsplatd_drops_total{reason=\"%s\"} ", reason);
    const char *at = strstr(text, series);
    long count = at ? strtol(at + strlen(series), NULL, 10) : -1;
    free(text);
    return count;
}

#endif
