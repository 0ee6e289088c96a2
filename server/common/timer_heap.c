/* SPDX-License-Identifier: Apache-2.0 */
#include "common/timer_heap.h"

#include <math.h>
#include <stddef.h>

/* Melds two trees into one; each may be NULL. */
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

/* Melds a list of sibling trees: in pairs from the left, then the pairs from the right. */
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

void srv_timer_clear(struct srv_timer_heap *heap, struct srv_timer *timer) {
    if (!timer->is_set)
        return;
    struct srv_timer *below = meld_row(timer->child);
    if (timer == heap->first) {
        heap->first = below;
    } else {
        if (timer->before->child == timer)
            timer->before->child = timer->next;
        else
            timer->before->next = timer->next;
        if (timer->next)
            timer->next->before = timer->before;
        heap->first = meld(heap->first, below);
    }
    *timer = (struct srv_timer){ .of = timer->of };
}

void srv_timer_set(struct srv_timer_heap *heap, struct srv_timer *timer, double at) {
    srv_timer_clear(heap, timer);
    if (at == INFINITY)
        return;
    timer->at = at;
    timer->is_set = true;
    heap->first = meld(heap->first, timer);
}

void srv_timer_set_by(struct srv_timer_heap *heap, struct srv_timer *timer, double at) {
    if (!timer->is_set || at < timer->at)
        srv_timer_set(heap, timer, at);
}

void *srv_timer_pop(struct srv_timer_heap *heap, double now) {
    struct srv_timer *timer = heap->first;
    if (!timer || timer->at > now)
        return NULL;
    srv_timer_clear(heap, timer);
    return timer->of;
}

double srv_timer_next(const struct srv_timer_heap *heap) {
    return heap->first ? heap->first->at : INFINITY;
}
