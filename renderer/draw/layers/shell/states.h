/* SPDX-License-Identifier: Apache-2.0
 *
 * Decides for each value whether its opacity reaches the lower threshold of a shell (SP_STATE_IN)
 * and the higher one (SP_STATE_OPAQUE). Thresholds are compared as optical depths.
 */
#ifndef SP_SHELL_STATES_H
#define SP_SHELL_STATES_H

#include "classify/transfer.h"

enum { SP_STATE_IN = 1, SP_STATE_OPAQUE = 2, SP_STATE_MIXED = 4 };

/* The values of a block of samples: [low, high], data units; low > high = no finite value. */
struct sp_shell_range {
    float low, high;
    uint32_t has_nonfinite;
};

struct sp_shell_states {
    const struct sp_transfer *transfer; /* borrowed */
    float low, high;  /* thresholds as optical depths; INFINITY = no value reaches it */
    uint8_t *state;   /* by key, owned; NULL for types without a table */
    uint32_t *before; /* by key: number of keys, up to this one, whose state differs from the
                         previous key's; owned */
};

/* Computes the states. The transfer must live as long as *states. SP_ERR_MEMORY. */
bool sp_shell_states_init(struct sp_shell_states *states, const struct sp_transfer *transfer,
                          double low, double high, struct sp_error *err);
void sp_shell_states_finish(struct sp_shell_states *states);

/* Returns the state of an optical depth over the reference length. */
static inline uint8_t sp_shell_state(const struct sp_shell_states *states, float depth) {
    return (uint8_t)((depth > 0 && depth >= states->low ? SP_STATE_IN : 0) |
                     (depth >= states->high ? SP_STATE_OPAQUE : 0));
}

/* Returns the common state of all values of a range, or SP_STATE_MIXED if their states may
 * differ. */
unsigned sp_shell_states_of(const struct sp_shell_states *states,
                            const struct sp_shell_range *range);

/* True if a voxel with a value of the range may have another state under b than under a. */
bool sp_shell_states_differ(const struct sp_shell_states *a, const struct sp_shell_states *b,
                            const struct sp_shell_range *range);

#endif
