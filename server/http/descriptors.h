/* SPDX-License-Identifier: Apache-2.0
 *
 * How many file descriptors the settings need, and how many connections the process can serve.
 * Without a descriptor a connection would wait in the system's backlog without an answer. The
 * daemon therefore accepts only as many as it can answer and refuses the rest as beyond
 * --connections.
 */
#ifndef SRV_HTTP_DESCRIPTORS_H
#define SRV_HTTP_DESCRIPTORS_H

#include <stdint.h>

#include "config/config.h"

enum {
    SRV_SPARE_CONNECTIONS = 64, /* per HTTP thread beyond --connections, to answer 503 */
    SRV_OTHER_DESCRIPTORS = 128 /* threads, database, volumes being loaded, files of camera paths */
};

/* File descriptors that `connections` connections and the rest of the process need. */
int64_t srv_descriptors_for(const struct srv_config *config, int64_t connections);
/* Raises the limit of the process (RLIMIT_NOFILE) as far as the settings need and the system
 * allows. Returns the number of connections that fit, in [1, --connections]; logs a warning if it
 * is lower than --connections. */
int64_t srv_descriptors_fit(const struct srv_config *config);

#endif
