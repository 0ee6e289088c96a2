/* SPDX-License-Identifier: Apache-2.0
 *
 * Limits how much of a pool one owner may take. A limited owner may hold at most three times the
 * free amount. So the first owner may take three quarters of the pool, the next owner three
 * quarters of the rest, and so on; in the long run, each of n owners gets 3 / (3n + 1) (dynamic
 * thresholds: Choudhury and Hahne 1998, with a factor of 3). An owner that holds nothing may take
 * the last free object. An owner without a limit, such as an admin, may take everything that is
 * free. In a pool of fewer than SRV_FAIR_LEAST objects, every owner may. Pure.
 */
#ifndef SRV_COMMON_FAIR_SHARE_H
#define SRV_COMMON_FAIR_SHARE_H

#include <stdbool.h>
#include <stdint.h>

enum { SRV_FAIR_LEAST = 4 };

struct srv_pool {
    uint64_t most; /* capacity for all owners together: objects or bytes */
    uint64_t used; /* by all owners */
    uint64_t own;  /* used by this owner; a part of `used` */
};

/* Returns how much more the owner may take. */
uint64_t srv_fair_left(const struct srv_pool *pool, bool is_limited);

#endif
