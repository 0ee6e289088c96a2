/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SRV_COMMON_BACKGROUND_H
#define SRV_COMMON_BACKGROUND_H

enum {
    SRV_NICE_BACKGROUND = 10, /* about a tenth of a core beside threads that render */
    SRV_NICE_ANSWERS = 5      /* about a quarter: a client waits for the answer */
};

/* Raises the niceness of the calling thread by `niceness`, so that it yields to the daemon's other
 * threads. Threads that it creates afterwards inherit it. If the system refuses, the function logs
 * a warning with `thread_name` and the thread continues as it was. */
void srv_background_thread_enter(const char *thread_name, int niceness);

#endif
