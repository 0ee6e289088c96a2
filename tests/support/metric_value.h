/* SPDX-License-Identifier: Apache-2.0 */
#ifndef TESTS_SUPPORT_METRIC_VALUE_H
#define TESTS_SUPPORT_METRIC_VALUE_H

#include "ops/metrics.h"

/* What Prometheus reads under a name, with its labels if it has some. Fails the test if there is
 * none of it. */
unsigned long long metric_value(const struct srv_metrics *metrics, const char *name);

#endif
