/* SPDX-License-Identifier: Apache-2.0
 *
 * Persistence of volumes, sessions and the clock. It connects the store, which does not know their
 * types, with the catalog and the hub, which do not know the store. It stands beside the catalog
 * because no folder further left may include all three.
 */
#ifndef SRV_RENDER_PERSISTENCE_H
#define SRV_RENDER_PERSISTENCE_H

#include "render/catalog.h"
#include "session/hub.h"
#include "store/store.h"

/* Restores the sessions, hibernated, and queues the loads of volumes. A record that cannot be
 * restored is logged and stays in the store; so is a damaged one of a saved view or a preset, and
 * requests for it get that as an error. False: SP_ERR_MEMORY. */
bool srv_persistence_restore(struct srv_store *store, struct srv_hub *hub,
                             struct srv_catalog *catalog, struct sp_error *err);

/* Returns for how long daemons have run with this store, ms; 0 = a new store. */
double srv_persistence_ran_ms(struct srv_store *store);
/* Puts that time, to the second, and the sessions that changed. False: not all could be put. */
bool srv_persistence_save_sessions(struct srv_store *store, struct srv_hub *hub, double ran_ms);

/* Puts the source of a volume; request NULL removes it. False: the record cannot be put; this is
 * logged, and the volume is not loaded again after a restart. */
bool srv_persistence_put_volume(struct srv_store *store, const char *id,
                                const struct srv_volume_request *request);

#endif
