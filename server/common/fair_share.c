/* SPDX-License-Identifier: Apache-2.0 */
#include "common/fair_share.h"

uint64_t srv_fair_left(const struct srv_pool *pool, bool is_limited) {
    const uint64_t free = pool->most > pool->used ? pool->most - pool->used : 0;
    const uint64_t quarters = 3 * free; /* own + x = 3 (free - x) */
    if (!is_limited || pool->most < SRV_FAIR_LEAST)
        return free;
    const uint64_t share = quarters > pool->own ? (quarters - pool->own) / 4 : 0;
    return share == 0 && free > 0 && pool->own == 0 ? 1 : share;
}
