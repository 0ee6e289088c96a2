/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SRV_COMMON_BACKGROUND_H
#define SRV_COMMON_BACKGROUND_H

/* Lowers the priority of the calling thread (nice +10), so that it yields to the daemon's other
 * threads. Threads that it creates afterwards inherit the priority. If the system refuses, the
 * function logs a warning with `thread_name` and the thread continues as it was. */
void srv_background_thread_enter(const char *thread_name);

#endif
