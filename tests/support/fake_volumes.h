/* SPDX-License-Identifier: Apache-2.0
 *
 * A catalog for a hub without voxels, renderer or threads: cubes of 8 voxels a side.
 */
#ifndef TESTS_SUPPORT_FAKE_VOLUMES_H
#define TESTS_SUPPORT_FAKE_VOLUMES_H

#include "session/hub.h"

struct fake_volumes {
    const char *only; /* the id that there is; NULL = every id is one */
    bool is_loading;
    int uses; /* that were not given back */
};

/* For struct srv_hub_options; `volumes` lives as long as the hub. */
struct srv_volume_source fake_volume_source(struct fake_volumes *volumes);
/* What else such a hub calls. */
void fake_ignore(void *user);
void fake_ignore_interrupt(void *user, uint64_t session, enum srv_interrupt why);

#endif
