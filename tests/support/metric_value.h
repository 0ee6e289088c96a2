/* SPDX-License-Identifier: Apache-2.0 */
#ifndef TESTS_SUPPORT_METRIC_VALUE_H
#define TESTS_SUPPORT_METRIC_VALUE_H

#include "ops/metrics.h"

/* Returns the value of a metric as /metrics prints it; `name` includes the labels. Fails the test
 * if the metric does not exist. */
unsigned long long metric_value(const struct srv_metrics *metrics, const char *name);

#endif
