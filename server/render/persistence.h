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
 * restored is logged and stays in the store. Damaged records of saved views and presets are logged
 * as well, and requests for them get an error. False: SP_ERR_MEMORY. */
bool srv_persistence_restore(struct srv_store *store, struct srv_hub *hub,
                             struct srv_catalog *catalog, struct sp_error *err);

/* Returns how long daemons have run with this store, ms; 0 = a new store. */
double srv_persistence_ran_ms(struct srv_store *store);
/* Stores the run time `ran_ms`, to the second, and the sessions that changed. False: some could not
 * be stored. */
bool srv_persistence_save_sessions(struct srv_store *store, struct srv_hub *hub, double ran_ms);

/* Stores the source of a volume; request NULL removes it. False: the record cannot be stored. This
 * is logged, and the volume is not loaded again after a restart. */
bool srv_persistence_put_volume(struct srv_store *store, const char *id,
                                const struct srv_volume_request *request);

#endif
