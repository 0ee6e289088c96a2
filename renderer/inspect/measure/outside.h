/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SP_MEASURE_OUTSIDE_H
#define SP_MEASURE_OUTSIDE_H

#include "sp/measure.h"

/* Returns sp_measure_result.outside of a measurement that passes sp_measure_check(). */
double sp_measure_outside(const struct sp_volume *volume, const struct sp_measure *measure);

#endif
