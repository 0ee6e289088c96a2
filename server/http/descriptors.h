/* SPDX-License-Identifier: Apache-2.0
 *
 * How many descriptors the settings can want, and how many connections there is room for. Without
 * room a connection would wait in the system's backlog, with no answer; so there are as many as can
 * be answered, and the rest is refused as beyond --connections.
 */
#ifndef SRV_HTTP_DESCRIPTORS_H
#define SRV_HTTP_DESCRIPTORS_H

#include <stdint.h>

#include "config/config.h"

enum {
    SRV_SPARE_CONNECTIONS = 64, /* of each HTTP thread beyond --connections, to answer 503 */
    SRV_OTHER_DESCRIPTORS = 128 /* of threads, database, volumes that load, files of paths */
};

/* What `connections` of them take, with all the rest. */
int64_t srv_descriptors_for(const struct srv_config *config, int64_t connections);
/* Raises the process's limit (RLIMIT_NOFILE) as far as the settings want and the system lets it.
 * Returns the connections that there is room for, from 1 to --connections; if that is fewer the log
 * says so. */
int64_t srv_descriptors_fit(const struct srv_config *config);

#endif
