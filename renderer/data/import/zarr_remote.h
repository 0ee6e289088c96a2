/* SPDX-License-Identifier: Apache-2.0
 *
 * A store of Zarr that another process fetches (remote.h).
 */
#ifndef SP_IMPORT_ZARR_REMOTE_H
#define SP_IMPORT_ZARR_REMOTE_H

#include "data/import/zarr_store.h"

/* Uses the socket and the memory that are open as `socket` and `memory`. NULL with *err set. */
struct zarr_store *zarr_remote_open(int socket, int memory, const char *title,
                                    struct sp_error *err);
void zarr_remote_close(struct zarr_store **store);

/* The status of HTTP of the last object that was missing; 0 = none was. */
unsigned zarr_remote_status(const struct zarr_store *store);

#endif
