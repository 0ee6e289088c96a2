/* SPDX-License-Identifier: Apache-2.0
 *
 * What is kept of volumes, sessions and the time: between the store, which knows neither, and those
 * who do not know the store.
 */
#ifndef SRV_RENDER_PERSISTENCE_H
#define SRV_RENDER_PERSISTENCE_H

#include "render/catalog.h"
#include "session/hub.h"
#include "store/store.h"

/* Brings back sessions, which sleep until somebody asks for them, and queues the loads. What
 * cannot come back is logged and stays in the store. SP_ERR_MEMORY. */
bool srv_persistence_restore(struct srv_store *store, struct srv_hub *hub,
                             struct srv_catalog *catalog, struct sp_error *err);

/* For how long daemons ran that kept what is in the store: 0 = it is new, or of one that did not
 * count. */
double srv_persistence_ran_ms(struct srv_store *store);
/* Puts that, to the second, and the sessions that changed. False: not all of them. */
bool srv_persistence_save_sessions(struct srv_store *store, struct srv_hub *hub, double ran_ms);

/* Puts a volume's source; request NULL removes it. False: it cannot be put, which is logged, and is
 * not in the store. */
bool srv_persistence_put_volume(struct srv_store *store, const char *id,
                                const struct srv_volume_request *request);

#endif
