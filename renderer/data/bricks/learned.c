/* SPDX-License-Identifier: Apache-2.0 */
#include "data/bricks/learned.h"

#include <math.h>
#include <stdlib.h>

enum { RANGES = 7 };

/* float: half of the memory. Rounded outwards. */
struct known {
    float low[RANGES], high[RANGES];
};

struct sp_brick_learned {
    struct known *bricks;
    uint8_t *is_known;
};

struct sp_brick_learned *sp_brick_learned_create(const struct sp_brick_level *level) {
    struct sp_brick_learned *l = calloc(1, sizeof *l);
    if (!l)
        return NULL;
    l->bricks = calloc(sp_brick_count(level), sizeof *l->bricks);
    l->is_known = calloc(sp_brick_count(level), 1);
    if (!l->bricks || !l->is_known)
        sp_brick_learned_destroy(&l);
    return l;
}

void sp_brick_learned_destroy(struct sp_brick_learned **learned) {
    if (!*learned)
        return;
    free((*learned)->bricks);
    free((*learned)->is_known);
    free(*learned);
    *learned = NULL;
}

uint64_t sp_brick_learned_bytes(const struct sp_brick_level *level) {
    return sp_brick_count(level) * (sizeof(struct known) + 1);
}

static float round_down(double value) {
    const float narrow = (float)value;
    return (double)narrow > value ? nextafterf(narrow, -INFINITY) : narrow;
}

void sp_brick_ranges_measure(const struct sp_brick_view *view, struct sp_brick_ranges *ranges) {
    for (int i = 0; i < RANGES; i++) {
        struct sp_brick_view part = *view;
        const int axis = (i - 1) / 2;
        if (i > 0 && part.size[axis] > BRICK_MARGIN) {
            if (i % 2 == 0)
                part.first[axis] += part.size[axis] - BRICK_MARGIN;
            part.size[axis] = BRICK_MARGIN;
        }
        const struct sp_brick_range range = sp_brick_measure_range(&part);
        ranges->low[i] = range.least;
        ranges->high[i] = range.most;
    }
}

/* A place in the grid of bricks. */
struct place {
    int64_t at[3];
};

static struct place place_of(const struct sp_brick_level *level, uint64_t number) {
    return (struct place){ { (int64_t)(number % level->bricks[0]),
                             (int64_t)(number / level->bricks[0] % level->bricks[1]),
                             (int64_t)(number / level->bricks[0] / level->bricks[1]) } };
}

/* The number of the neighbour in a direction of −1, 0 or 1 per axis, which n in [0, 27) gives.
 * False if the level ends there. */
static bool find_neighbour(const struct sp_brick_level *level, struct place place, int n,
                           int direction[3], uint64_t *number) {
    *number = 0;
    for (int a = 0, rest = n; a < 3; a++, rest /= 3)
        direction[a] = rest % 3 - 1;
    for (int a = 2; a >= 0; a--) {
        const int64_t at = place.at[a] + direction[a];
        if (at < 0 || at >= (int64_t)level->bricks[a])
            return false;
        *number = *number * level->bricks[a] + (uint64_t)at;
    }
    return true;
}

/* Writes the range of an entry if all that it depends on is known. */
static void publish(const struct sp_brick_learned *l, const struct sp_brick_level *level,
                    uint64_t number, struct sp_brick_entry *entry) {
    const struct place place = place_of(level, number);
    double low = INFINITY, high = -INFINITY;
    int direction[3];
    uint64_t other;
    for (int n = 0; n < 27; n++) {
        if (!find_neighbour(level, place, n, direction, &other))
            continue;
        if (!l->is_known[other])
            return;
        /* What lies towards this brick is in each of these faces. */
        const struct known *known = &l->bricks[other];
        double least = (double)known->low[0], most = (double)known->high[0];
        for (int a = 0; a < 3; a++)
            if (direction[a]) {
                const int face = 1 + 2 * a + (direction[a] < 0);
                least = fmax(least, (double)known->low[face]);
                most = fmin(most, (double)known->high[face]);
            }
        if (least <= most) {
            low = fmin(low, least);
            high = fmax(high, most);
        }
    }
    entry->range[0] = low;
    entry->range[1] = high;
}

void sp_brick_learned_add(struct sp_brick_learned *l, const struct sp_brick_level *level,
                          uint64_t number, const struct sp_brick_ranges *ranges,
                          struct sp_brick_entry *entries) {
    const struct place place = place_of(level, number);
    struct known *known = &l->bricks[number];
    int direction[3];
    uint64_t other;
    for (int i = 0; i < RANGES; i++) {
        known->low[i] = round_down(ranges->low[i]);
        known->high[i] = -round_down(-ranges->high[i]);
    }
    l->is_known[number] = 1;
    for (int n = 0; n < 27; n++)
        if (find_neighbour(level, place, n, direction, &other))
            publish(l, level, other, &entries[other]);
}
