/* SPDX-License-Identifier: Apache-2.0 */
#include "support/fake_volumes.h"

#include <string.h>

#include "sp/volume.h"

static struct srv_volume *acquire(void *user, const char *id, struct sp_error *err) {
    struct fake_volumes *volumes = user;
    bool is_there = !volumes->only || !id || !*id || strcmp(id, volumes->only) == 0;
    if (volumes->is_loading || !is_there) {
        sp_fail(err, volumes->is_loading ? SP_ERR_NOT_READY : SP_ERR_VOLUME_UNKNOWN, "/volume",
                "the volume %s is not available", id);
        return NULL;
    }
    volumes->uses++;
    return (struct srv_volume *)volumes; /* any pointer but NULL */
}

static struct srv_volume *add_use(void *user, struct srv_volume *volume) {
    ((struct fake_volumes *)user)->uses++;
    return volume;
}

static void release(void *user, struct srv_volume *volume) {
    (void)volume;
    ((struct fake_volumes *)user)->uses--;
}

static void default_view(void *user, struct srv_volume *volume, struct sp_view *view) {
    struct sp_volume_info info = { .type = SP_UINT8, .components = 1, .range = { 0, 255 } };
    (void)user;
    (void)volume;
    for (int i = 0; i < 3; i++) {
        info.grid.dims[i] = 8;
        info.grid.spacing[i] = info.grid.direction[i][i] = 1;
    }
    sp_view_init(view, &info, "v");
}

struct srv_volume_source fake_volume_source(struct fake_volumes *volumes) {
    return (struct srv_volume_source){ .user = volumes,
                                       .acquire = acquire,
                                       .ref = add_use,
                                       .release = release,
                                       .default_view = default_view };
}

void fake_ignore(void *user) {
    (void)user;
}
