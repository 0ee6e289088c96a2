/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/change.h"

#include <math.h>
#include <stdlib.h>

bool sp_change_is_possible(const struct sp_transfer *from, const struct sp_transfer *to) {
    if (from->tf.order == SP_TF_POST || to->tf.order == SP_TF_POST || from->type != to->type)
        return false;
    if (from->table)
        return to->table && from->first == to->first && from->count == to->count;
    return from->base == to->base;
}

/* True if point i means the same for visibility in both functions. */
static bool is_same_point(const struct sp_transfer_function *a, uint32_t i,
                          const struct sp_transfer_function *b, uint32_t j) {
    const struct sp_tf_point *p = &a->points[i], *q = &b->points[j];
    return p->value == q->value && (p->opacity > 0) == (q->opacity > 0);
}

/* Computes the values between the last point of the common start and the first point of the common
 * end. */
static void compute_hull(struct sp_change *c, const struct sp_transfer *from,
                         const struct sp_transfer *to) {
    const struct sp_transfer_function *a = &from->tf, *b = &to->tf;
    uint32_t n = a->point_count, m = b->point_count, least = n < m ? n : m, head = 0, tail = 0;
    c->low = INFINITY;
    c->high = -INFINITY;
    while (head < least && is_same_point(a, head, b, head))
        head++;
    while (tail < least && is_same_point(a, n - 1 - tail, b, m - 1 - tail))
        tail++;
    if (head == n && head == m)
        return; /* nothing differs */
    double low = head ? a->points[head - 1].value - from->base : -INFINITY;
    double high = tail ? a->points[n - tail].value - from->base : INFINITY;
    c->low = nextafterf((float)low, -INFINITY);
    c->high = nextafterf((float)high, INFINITY);
}

bool sp_change_init(struct sp_change *change, const struct sp_transfer *from, const uint8_t *has,
                    const struct sp_transfer *to, const uint8_t *wants, struct sp_error *err) {
    *change = (struct sp_change){ 0 };
    if (!from->table) {
        compute_hull(change, from, to);
        return true;
    }
    change->before = malloc((from->count + (size_t)1) * sizeof *change->before);
    if (!change->before)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for %u values", from->count);
    uint32_t sum = 0;
    for (uint32_t i = 0; i < from->count; i++) {
        change->before[i] = sum;
        sum += has[i] != wants[i];
    }
    change->before[from->count] = sum;
    return true;
}

void sp_change_finish(struct sp_change *change) {
    free(change->before);
    *change = (struct sp_change){ 0 };
}

bool sp_change_affects(const struct sp_change *change, const struct sp_range *range) {
    if (!(range->low <= range->high))
        return false;
    if (change->before) /* keys of these types are exact in single precision */
        return change->before[(uint32_t)range->high + 1] > change->before[(uint32_t)range->low];
    return range->low <= change->high && range->high >= change->low;
}
