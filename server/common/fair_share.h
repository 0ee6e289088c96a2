/* SPDX-License-Identifier: Apache-2.0
 *
 * How much of a pool one owner may take. An owner with a limit may hold at most three times what it
 * leaves free: the first one may take three quarters of the pool, the next one three quarters of
 * the rest, and so on; n owners that come and go get 3 / (3n + 1) each (dynamic thresholds:
 * Choudhury and Hahne 1998, with a factor of 3). An owner that holds nothing may take the last one.
 * Owners without a limit, such as admins, may take all that is free. In a pool of fewer than
 * SRV_FAIR_LEAST all owners may. Pure.
 */
#ifndef SRV_COMMON_FAIR_SHARE_H
#define SRV_COMMON_FAIR_SHARE_H

#include <stdbool.h>
#include <stdint.h>

enum { SRV_FAIR_LEAST = 4 };

struct srv_pool {
    uint64_t most; /* of all owners together: objects, or bytes */
    uint64_t used; /* by all owners */
    uint64_t own;  /* by this owner, a part of `used` */
};

/* Returns how much more the owner may take. */
uint64_t srv_fair_left(const struct srv_pool *pool, bool is_limited);

#endif
