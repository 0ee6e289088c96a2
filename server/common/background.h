/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SRV_COMMON_BACKGROUND_H
#define SRV_COMMON_BACKGROUND_H

/* The calling thread, and those that it starts, go behind the daemon's others from now on. `who`:
 * for the log, where that is not allowed. */
void srv_background_thread_enter(const char *who);

#endif
