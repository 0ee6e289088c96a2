/* SPDX-License-Identifier: Apache-2.0 */
#include "common/timer_heap.h"

#include <math.h>
#include <stddef.h>

/* Of two heaps one; each may be NULL. */
static struct srv_timer *meld(struct srv_timer *a, struct srv_timer *b) {
    if (!a || !b)
        return a ? a : b;
    if (b->at < a->at) {
        struct srv_timer *least = b;
        b = a;
        a = least;
    }
    b->before = a;
    b->next = a->child;
    if (a->child)
        a->child->before = b;
    a->child = b;
    return a;
}

/* Of a row of heaps one: in pairs from the left, and these from the right. */
static struct srv_timer *meld_row(struct srv_timer *row) {
    struct srv_timer *pairs = NULL, *all = NULL;
    while (row) {
        struct srv_timer *a = row, *b = row->next;
        row = b ? b->next : NULL;
        a->next = a->before = NULL;
        if (b)
            b->next = b->before = NULL;
        a = meld(a, b);
        a->next = pairs;
        pairs = a;
    }
    while (pairs) {
        struct srv_timer *pair = pairs;
        pairs = pair->next;
        pair->next = NULL;
        all = meld(all, pair);
    }
    return all;
}

void srv_timer_clear(struct srv_timer_heap *dues, struct srv_timer *due) {
    if (!due->is_set)
        return;
    struct srv_timer *below = meld_row(due->child);
    if (due == dues->first) {
        dues->first = below;
    } else {
        if (due->before->child == due)
            due->before->child = due->next;
        else
            due->before->next = due->next;
        if (due->next)
            due->next->before = due->before;
        dues->first = meld(dues->first, below);
    }
    *due = (struct srv_timer){ .of = due->of };
}

void srv_timer_set(struct srv_timer_heap *dues, struct srv_timer *due, double at) {
    srv_timer_clear(dues, due);
    if (at == INFINITY)
        return;
    due->at = at;
    due->is_set = true;
    dues->first = meld(dues->first, due);
}

void srv_timer_set_by(struct srv_timer_heap *dues, struct srv_timer *due, double at) {
    if (!due->is_set || at < due->at)
        srv_timer_set(dues, due, at);
}

void *srv_timer_take(struct srv_timer_heap *dues, double now) {
    struct srv_timer *due = dues->first;
    if (!due || due->at > now)
        return NULL;
    srv_timer_clear(dues, due);
    return due->of;
}

double srv_timer_next(const struct srv_timer_heap *dues) {
    return dues->first ? dues->first->at : INFINITY;
}
