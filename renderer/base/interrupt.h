/* SPDX-License-Identifier: Apache-2.0
 *
 * Cancels or pauses a long computation from outside. The loops of every stage poll an interrupt a
 * few hundred times per frame.
 */
#ifndef SP_BASE_INTERRUPT_H
#define SP_BASE_INTERRUPT_H

#include <stdatomic.h>
#include <stdbool.h>

#include "base/clock.h"
#include "sp/inflight.h"

/* Both pointers belong to the caller and live as long as the computation. */
struct sp_interrupt {
    const atomic_bool *cancel; /* NULL = never cancelled */
    struct sp_pause *pause;    /* NULL = never paused */
};

/* True if the computation must stop. While the computation is paused, the call waits. */
static inline bool sp_interrupt_is_cancelled(const struct sp_interrupt *interrupt) {
    struct sp_pause *pause = interrupt->pause;
    if (pause && atomic_load_explicit(&pause->requested, memory_order_relaxed))
        pause->wait(pause->user);
    return interrupt->cancel && atomic_load_explicit(interrupt->cancel, memory_order_relaxed);
}

/* Monotonic time without the pauses [ms]. */
static inline double sp_interrupt_clock_ms(const struct sp_interrupt *interrupt) {
    struct sp_pause *pause = interrupt->pause;
    return sp_clock_ms() -
           (pause ? atomic_load_explicit(&pause->paused_ms, memory_order_relaxed) : 0);
}

#endif
