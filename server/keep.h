/* SPDX-License-Identifier: Apache-2.0
 *
 * What is kept of volumes and sessions: between the store, which knows neither, and those who do
 * not know the store.
 */
#ifndef SRV_KEEP_H
#define SRV_KEEP_H

#include "render/catalog.h"
#include "session/hub.h"
#include "store/store.h"

/* Brings back sessions, which sleep until somebody asks for them, and queues the loads. What
 * cannot come back is logged and stays in the store. SP_ERR_MEMORY. */
bool srv_keep_restore(struct srv_store *store, struct srv_hub *hub, struct srv_catalog *catalog,
                      struct sp_error *err);

/* Puts the sessions that changed. False: not all of them. */
bool srv_keep_sessions(struct srv_store *store, struct srv_hub *hub);

/* Puts a volume's source; request NULL removes it. What cannot be put is logged, and is not in the
 * store. */
void srv_keep_volume(struct srv_store *store, const char *id,
                     const struct srv_volume_request *request);

#endif
