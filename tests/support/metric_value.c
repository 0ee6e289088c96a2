/* SPDX-License-Identifier: Apache-2.0 */
#include "support/metric_value.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

unsigned long long metric_value(const struct srv_metrics *metrics, const char *name) {
    char *text = NULL;
    size_t size, length = strlen(name);
    FILE *out = open_memstream(&text, &size);
    assert_non_null(out);
    srv_metrics_print(metrics, out);
    assert_int_equal(fclose(out), 0);
    for (const char *line = text; *line; line = strchr(line, '\n') + 1)
        if (strncmp(line, name, length) == 0 && line[length] == ' ') {
            unsigned long long value = strtoull(line + length, NULL, 10);
            free(text);
            return value;
        }
    free(text);
    fail_msg("the metric %s does not exist", name);
    return 0;
}
