/* SPDX-License-Identifier: Apache-2.0
 *
 * A fake catalog for a hub, without voxels, renderer or threads: each volume has 8 voxels per side.
 */
#ifndef TESTS_SUPPORT_FAKE_VOLUMES_H
#define TESTS_SUPPORT_FAKE_VOLUMES_H

#include "session/hub.h"

struct fake_volumes {
    const char *only; /* the only id that exists; NULL = every id exists */
    bool is_loading;
    int uses; /* acquired and not released */
};

/* For struct srv_hub_options; `volumes` lives as long as the hub. */
struct srv_volume_source fake_volume_source(struct fake_volumes *volumes);
/* For the other callbacks of the hub: does nothing. */
void fake_ignore(void *user);

#endif
