/* SPDX-License-Identifier: Apache-2.0
 *
 * The three descriptors that a program is started with.
 */
#ifndef SRV_STANDARD_H
#define SRV_STANDARD_H

#include <stdbool.h>

#include "sp/status.h"

/* Takes those that are closed, or a connection would get the number of one, and lines of the log
 * with it. Writing to them fails as it did. Call before anything is opened. */
void srv_standard_hold(void);

/* Was all that was printed on standard output written? SP_ERR_IO. */
bool srv_standard_end(struct sp_error *err);

#endif
