/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SRV_NICE_H
#define SRV_NICE_H

/* The calling thread, and those that it starts, go behind the daemon's others from now on. `who`:
 * for the log, where that is not allowed. */
void srv_be_nice(const char *who);

#endif
