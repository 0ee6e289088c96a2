/* SPDX-License-Identifier: Apache-2.0
 *
 * Samples around points of a volume that is larger than memory, for what draws no frame: slices and
 * measurements.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/bricks/places.h"
#include "data/bricks/store.h"
#include "data/volume/interpolate.h"
#include "sp/bricks.h"

/* The bricks of a level around the points, with a sample more on each side. False without memory.
 */
static bool compute_need(const struct sp_brick_file *file, const double (*points)[3],
                         unsigned count, unsigned l, struct sp_brick_need *need) {
    const struct sp_brick_header *header = sp_brick_file_header(file);
    const struct sp_brick_level *level = &header->level[l];
    struct sp_interpolator to;
    double low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY };
    sp_interpolator_init_grid(&to, &header->info.grid);
    for (unsigned i = 0; i < count; i++) {
        double distances[3];
        sp_interpolator_distances(&to, points[i], distances);
        for (int a = 0; a < 3; a++) {
            const double at = sp_brick_sample(header, l, a, distances[a]);
            low[a] = fmin(low[a], at);
            high[a] = fmax(high[a], at);
        }
    }
    *need = (struct sp_brick_need){ .level = l };
    for (int a = 0; a < 3; a++) {
        const double last = level->dims[a] - 1.0;
        const uint32_t from = (uint32_t)fmin(fmax(floor(low[a]) - 1, 0), last);
        const uint32_t to_ = (uint32_t)fmin(fmax(ceil(high[a]) + 1, 0), last);
        need->first[a] = from / BRICK_SIDE;
        need->count[a] = to_ / BRICK_SIDE - need->first[a] + 1;
    }
    return sp_brick_need_allocate(need, BRICK_WANTED);
}

/* Takes the subvolume of a need; NULL with *err set if it is not complete in time. */
static struct sp_volume *get_subvolume(struct sp_brick_store *store,
                                       const struct sp_brick_need *need, double wait_ms,
                                       struct sp_error *err) {
    struct sp_brick_subvolume subvolume;
    if (!sp_brick_store_get(store, need, wait_ms, false, NULL, NULL, &subvolume, err))
        return NULL;
    if (subvolume.is_wanted && subvolume.lost == 0)
        return subvolume.volume;
    sp_volume_unref(&subvolume.volume);
    if (subvolume.lost)
        sp_fail(err, SP_ERR_IO, "", "%llu bricks of this region cannot be read",
                (unsigned long long)subvolume.lost);
    else
        sp_fail(err, SP_ERR_TIMEOUT, "", "bricks of the volume are still being read; try again");
    return NULL;
}

struct sp_volume *sp_bricks_around(struct sp_volume *volume, const double (*points)[3],
                                   unsigned count, double wait_ms, unsigned *level,
                                   struct sp_error *err) {
    struct sp_brick_store *store = sp_brick_store_of(volume);
    const unsigned base = store ? sp_brick_store_base(store) : 0;
    for (; *level < base; (*level)++) {
        struct sp_brick_need need;
        const struct sp_brick_file *file = sp_brick_store_file(store);
        if (!compute_need(file, points, count, *level, &need)) {
            sp_fail(err, SP_ERR_MEMORY, "", "out of memory for bricks");
            return NULL;
        }
        const bool fits = sp_brick_need_cost(file, &need) <= sp_brick_store_subvolume_max(store);
        struct sp_volume *part = fits ? get_subvolume(store, &need, wait_ms, err) : NULL;
        free(need.wanted);
        if (fits)
            return part;
    }
    *level = base;
    return sp_volume_ref(volume);
}

unsigned sp_bricks_base(const struct sp_volume *volume) {
    const struct sp_brick_store *store = sp_brick_store_of(volume);
    return store ? sp_brick_store_base(store) : 0;
}

bool sp_bricks_describe(const struct sp_volume *volume, unsigned level,
                        struct sp_volume_info *info) {
    const struct sp_brick_store *store = sp_brick_store_of(volume);
    *info = *sp_volume_info(volume);
    if (!store)
        return level == 0;
    const struct sp_brick_header *header = sp_brick_file_header(sp_brick_store_file(store));
    if (level >= header->levels)
        return false;
    const struct sp_brick_level *own = &header->level[level];
    info->grid = header->info.grid;
    for (int a = 0; a < 3; a++) {
        const double first = sp_brick_distance(header, level, a, 0);
        for (int r = 0; r < 3; r++)
            info->grid.origin[r] += info->grid.direction[r][a] * first;
        info->grid.dims[a] = own->dims[a];
        info->grid.spacing[a] *= own->step[a];
        info->grid.coordinates[a] = own->places[a];
    }
    return true;
}

unsigned sp_bricks_level(const struct sp_volume *volume, double spacing) {
    const struct sp_brick_store *store = sp_brick_store_of(volume);
    unsigned level = 0;
    if (!store)
        return 0;
    const struct sp_brick_header *header = sp_brick_file_header(sp_brick_store_file(store));
    const double *own = header->info.grid.spacing;
    const double finest = fmin(own[0], fmin(own[1], own[2]));
    while (level + 1 < header->levels &&
           finest * exp2(sp_brick_level_width(&header->level[level + 1])) <= spacing * (1 + 1e-9))
        level++;
    return level;
}
