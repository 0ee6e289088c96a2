/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SP_BASE_CLOCK_H
#define SP_BASE_CLOCK_H

/* Milliseconds of a monotonic clock, and of CPU time of all threads of this process. Thread-safe.
 */
double sp_clock_ms(void);
double sp_clock_cpu_ms(void);

#endif
