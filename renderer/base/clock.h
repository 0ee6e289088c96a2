/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SP_BASE_CLOCK_H
#define SP_BASE_CLOCK_H

/* Return the time of a monotonic clock, and the CPU time of all threads of this process [ms].
 * Thread-safe. */
double sp_clock_ms(void);
double sp_clock_cpu_ms(void);

#endif
