/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/shell/states.h"

#include <stdlib.h>
#include <string.h>

static float depth_of(double opacity) {
    return opacity < 1 ? (float)-log1p(-opacity) : INFINITY;
}

bool sp_shell_states_init(struct sp_shell_states *states, const struct sp_transfer *transfer,
                          double low, double high, struct sp_error *err) {
    *states = (struct sp_shell_states){ .transfer = transfer,
                                        .low = depth_of(low),
                                        .high = depth_of(high) };
    if (!transfer->table)
        return true;
    states->state = malloc(transfer->count);
    states->before = malloc(transfer->count * sizeof *states->before);
    if (!states->state || !states->before) {
        sp_shell_states_finish(states);
        return sp_fail(err, SP_ERR_MEMORY, "/layers", "out of memory for the thresholds' table");
    }
    uint32_t sum = 0;
    for (uint32_t k = 0; k < transfer->count; k++) {
        states->state[k] = sp_shell_state(states, transfer->table[k].depth);
        sum += k > 0 && states->state[k] != states->state[k - 1];
        states->before[k] = sum;
    }
    return true;
}

void sp_shell_states_finish(struct sp_shell_states *states) {
    free(states->state);
    free(states->before);
    *states = (struct sp_shell_states){ 0 };
}

/* The smallest and the largest depth of the values in a range. */
static void compute_depths(const struct sp_transfer_function *tf,
                           const struct sp_shell_range *range, float depths[2]) {
    struct sp_class c;
    depths[0] = INFINITY;
    depths[1] = 0;
    for (int end = 0; end < 2; end++) {
        double value = (double)(end ? range->high : range->low);
        sp_transfer_function_eval(tf, value, &c);
        depths[0] = fminf(depths[0], c.depth);
        depths[1] = fmaxf(depths[1], c.depth);
    }
    for (uint32_t i = 0; i < tf->point_count; i++) {
        double value = tf->points[i].value;
        if (value <= (double)range->low || value >= (double)range->high)
            continue;
        sp_transfer_function_eval(tf, value, &c);
        depths[0] = fminf(depths[0], c.depth);
        depths[1] = fmaxf(depths[1], c.depth);
    }
}

/* The state that the depths of values have, before the gradient axis scales them. */
static unsigned state_of_values(const struct sp_shell_states *s,
                                const struct sp_shell_range *range) {
    if (s->state) {
        uint32_t low = (uint32_t)((int32_t)range->low - s->transfer->first);
        uint32_t high = (uint32_t)((int32_t)range->high - s->transfer->first);
        return s->before[low] == s->before[high] ? s->state[low] : SP_STATE_MIXED;
    }
    float depths[2];
    compute_depths(&s->transfer->tf, range, depths);
    unsigned least = sp_shell_state(s, depths[0]), most = sp_shell_state(s, depths[1]);
    return least == most ? least : SP_STATE_MIXED;
}

unsigned sp_shell_states_of(const struct sp_shell_states *s, const struct sp_shell_range *range) {
    if (!(range->low <= range->high))
        return 0;
    unsigned state = state_of_values(s, range);
    if (state && (range->has_nonfinite || s->transfer->scale))
        return SP_STATE_MIXED;
    return state;
}

static bool is_same_opacity(const struct sp_tf_point *a, const struct sp_tf_point *b) {
    return a->value == b->value && a->opacity == b->opacity;
}

/* True if both functions have the same opacity over the range: the points on it and the nearest one
 * on each side are equal. */
static bool is_same_over(const struct sp_transfer_function *a, const struct sp_transfer_function *b,
                         const struct sp_shell_range *range) {
    const struct sp_transfer_function *tf[2] = { a, b };
    uint32_t begin[2], end[2];
    for (int f = 0; f < 2; f++) {
        uint32_t n = tf[f]->point_count, i = 0, j = n;
        while (i + 1 < n && tf[f]->points[i + 1].value <= (double)range->low)
            i++;
        while (j > i + 1 && tf[f]->points[j - 2].value >= (double)range->high)
            j--;
        begin[f] = i;
        end[f] = j;
    }
    if (end[0] - begin[0] != end[1] - begin[1])
        return false;
    for (uint32_t i = 0; i < end[0] - begin[0]; i++)
        if (!is_same_opacity(&a->points[begin[0] + i], &b->points[begin[1] + i]))
            return false;
    return true;
}

bool sp_shell_states_differ(const struct sp_shell_states *a, const struct sp_shell_states *b,
                            const struct sp_shell_range *range) {
    unsigned before = sp_shell_states_of(a, range), after = sp_shell_states_of(b, range);
    if (before != after)
        return true;
    if (before != SP_STATE_MIXED)
        return false;
    if (a->state && !a->transfer->scale && !b->transfer->scale) {
        uint32_t low = (uint32_t)((int32_t)range->low - a->transfer->first);
        uint32_t high = (uint32_t)((int32_t)range->high - a->transfer->first);
        return memcmp(a->state + low, b->state + low, high - low + 1) != 0;
    }
    return a->low != b->low || a->high != b->high ||
           !sp_transfer_function_equal_scale(&a->transfer->tf, &b->transfer->tf) ||
           !is_same_over(&a->transfer->tf, &b->transfer->tf, range);
}
