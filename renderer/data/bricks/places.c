/* SPDX-License-Identifier: Apache-2.0 */
#include "data/bricks/places.h"

#include <math.h>
#include <string.h>

#include "data/volume/grid.h"
#include "data/volume/interpolate.h"

static size_t count_level(const struct sp_brick_header *header, unsigned level) {
    size_t count = 0;
    for (int a = 0; a < 3; a++)
        count += header->rectilinear >> a & 1 ? header->level[level].dims[a] : 0;
    return count;
}

size_t sp_brick_places_first(const struct sp_brick_header *header) {
    return count_level(header, 0);
}

size_t sp_brick_places_count(const struct sp_brick_header *header) {
    size_t count = 0;
    for (unsigned l = 0; l < header->levels; l++)
        count += count_level(header, l);
    return count;
}

/* Fills the places of a level from the places of the finer level. */
static void coarsen(const struct sp_brick_level *finer, int axis, struct sp_brick_level *level,
                    double *places) {
    sp_grid_coarsen(finer->places[axis], finer->dims[axis], places);
    const double first = places[0];
    level->start[axis] = finer->start[axis] + first;
    for (uint32_t i = 0; i < level->dims[axis]; i++)
        places[i] -= first;
}

void sp_brick_places_fill(struct sp_brick_header *header, double *numbers) {
    double *next = numbers;
    for (unsigned l = 0; l < header->levels; l++)
        for (int a = 0; a < 3; a++) {
            struct sp_brick_level *level = &header->level[l];
            if (!(header->rectilinear >> a & 1))
                continue;
            if (l)
                coarsen(&level[-1], a, level, next);
            level->places[a] = next;
            next += level->dims[a];
        }
    memcpy(header->info.grid.coordinates, header->level[0].places,
           sizeof header->info.grid.coordinates);
}

double sp_brick_distance(const struct sp_brick_header *header, unsigned level, int axis,
                         double at) {
    const struct sp_brick_level *own = &header->level[level];
    const double *places = own->places[axis], spacing = header->info.grid.spacing[axis];
    if (!places)
        return (own->offset[axis] + own->step[axis] * at) * spacing;
    if (own->dims[axis] < 2)
        return own->start[axis] + own->step[axis] * at * spacing;
    const double low = fmin(fmax(floor(at), 0), own->dims[axis] - 2.0);
    const double *next = &places[(uint32_t)low];
    return own->start[axis] + next[0] + (at - low) * (next[1] - next[0]);
}

double sp_brick_sample(const struct sp_brick_header *header, unsigned level, int axis,
                       double distance) {
    const struct sp_brick_level *own = &header->level[level];
    const double *places = own->places[axis], spacing = header->info.grid.spacing[axis];
    if (!places)
        return (distance / spacing - own->offset[axis]) / own->step[axis];
    distance -= own->start[axis];
    if (own->dims[axis] < 2)
        return distance / (own->step[axis] * spacing);
    const uint32_t low = sp_interpolate_low(places, own->dims[axis] - 1, distance);
    return low + (distance - places[low]) / (places[low + 1] - places[low]);
}
