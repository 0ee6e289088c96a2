/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/working_set/channels.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "data/bricks/store.h"
#include "data/volume/grid.h"

/* True if samples with the same indices lie at the same places, to a hundredth of their spacing. */
static bool is_same_grid(const struct sp_grid *a, const struct sp_grid *b) {
    const double tolerance = 0.01;
    double finest = INFINITY;
    if (memcmp(a->dims, b->dims, sizeof a->dims) != 0)
        return false;
    for (int axis = 0; axis < 3; axis++)
        finest = fmin(finest, a->spacing[axis]);
    for (unsigned axis = 0; axis < 3; axis++) {
        const uint32_t last = a->dims[axis] - 1;
        const double length = sp_grid_distance(a, axis, last);
        if (!(fabs(a->origin[axis] - b->origin[axis]) <= tolerance * finest))
            return false;
        for (int row = 0; row < 3; row++) {
            const double turn = a->direction[row][axis] - b->direction[row][axis];
            if (!(fabs(turn) * length <= tolerance * finest))
                return false;
        }
        for (uint32_t i = 0; i <= last; i++) {
            const double apart = sp_grid_distance(a, axis, i) - sp_grid_distance(b, axis, i);
            if (!(fabs(apart) <= tolerance * finest))
                return false;
        }
    }
    return true;
}

static bool is_visible_channel(const struct sp_view *view, uint32_t i) {
    return view->layers[i].visible && view->layers[i].type == SP_LAYER_CHANNEL;
}

/* What the frame draws of each channel, by layer. */
struct found {
    struct sp_volume *volumes[SP_LAYERS_MAX]; /* references; NULL = the layer is no channel */
    struct sp_frame_bricks bricks[SP_LAYERS_MAX];
};

static void finish(struct found *found) {
    for (int i = 0; i < SP_LAYERS_MAX; i++)
        sp_volume_unref(&found->volumes[i]);
}

/* Chooses what the frame draws of each channel. */
static bool choose_channels(const struct sp_frame_source_job *job,
                            struct sp_volume *const *channels, struct found *found,
                            struct sp_error *err) {
    struct sp_frame_source drawn;
    for (uint32_t i = 0; i < job->view->layer_count; i++) {
        if (!is_visible_channel(job->view, i))
            continue;
        if (!sp_frame_source_choose(channels[i], job, &drawn, err))
            return false;
        found->volumes[i] = drawn.volume;
        found->bricks[i] = drawn.bricks;
    }
    return true;
}

/* True if all volumes that are drawn from bricks have one level. Else *coarsest is the coarsest of
 * theirs. Volumes in memory have all levels. */
static bool is_common(struct sp_volume *volume, struct sp_volume *const *channels,
                      const struct sp_frame_source *drawn, const struct found *found,
                      unsigned *coarsest) {
    const bool is_brick = sp_brick_store_of(volume) != NULL;
    unsigned finest = is_brick ? drawn->bricks.level : UINT_MAX;
    *coarsest = is_brick ? finest : 0;
    for (int i = 0; i < SP_LAYERS_MAX; i++) {
        const unsigned level = found->bricks[i].level;
        if (!found->volumes[i] || !sp_brick_store_of(channels[i]))
            continue;
        finest = level < finest ? level : finest;
        *coarsest = level > *coarsest ? level : *coarsest;
    }
    return finest >= *coarsest;
}

/* Coarsens the drawn volumes until all have one level; each round ends at a coarser one. */
static bool choose_common(struct sp_volume *volume, const struct sp_frame_source_job *job,
                          struct sp_volume *const *channels, struct sp_frame_source *drawn,
                          struct found *found, struct sp_error *err) {
    struct sp_frame_source_job next = *job;
    if (!choose_channels(job, channels, found, err))
        return false;
    while (!is_common(volume, channels, drawn, found, &next.least)) {
        sp_volume_unref(&drawn->volume);
        finish(found);
        if (!sp_frame_source_choose(volume, &next, drawn, err) ||
            !choose_channels(&next, channels, found, err))
            return false;
    }
    return true;
}

/* Adds the bricks of a channel to the bricks of the frame. */
static void add_bricks(const struct sp_frame_bricks *from, struct sp_frame_bricks *to) {
    to->is_incomplete |= from->is_incomplete;
    to->is_being_read |= from->is_being_read;
    to->wanted += from->wanted;
    to->resident += from->resident;
    to->memory_bytes += from->memory_bytes;
    if (from->lost && !to->lost)
        memcpy(to->lost_box, from->lost_box, sizeof to->lost_box);
    to->lost += from->lost;
}

/* The grid of all samples, of which struct sp_volume may have a coarse level. */
static const struct sp_grid *whole_grid(struct sp_volume *volume) {
    const struct sp_brick_store *store = sp_brick_store_of(volume);
    return store ? &sp_brick_file_header(sp_brick_store_file(store))->info.grid
                 : &sp_volume_info(volume)->grid;
}

/* True if the channels can be mixed with the view's volume. */
static bool check_grids(struct sp_volume *volume, const struct sp_view *view,
                        struct sp_volume *const *channels, struct sp_error *err) {
    char place[32];
    for (uint32_t i = 0; i < view->layer_count; i++) {
        snprintf(place, sizeof place, "/layers/%u/id", i);
        if (is_visible_channel(view, i) &&
            !is_same_grid(whole_grid(volume), whole_grid(channels[i])))
            return sp_fail(err, SP_ERR_INVALID, place,
                           "the samples of \"%s\" lie elsewhere than those of the volume: name "
                           "another field of its file, or a volume with the same grid",
                           view->layers[i].id);
    }
    return true;
}

bool sp_channels_choose_sources(struct sp_volume *volume, const struct sp_frame_source_job *job,
                                struct sp_frame_source *drawn,
                                struct sp_volume *channels[SP_LAYERS_MAX], struct sp_error *err) {
    const struct sp_view *view = job->view;
    struct found found = { .volumes = { NULL } };
    if (!sp_view_has_channels(view))
        return true;
    bool ok = check_grids(volume, view, channels, err) &&
              choose_common(volume, job, channels, drawn, &found, err);
    for (uint32_t i = 0; ok && i < view->layer_count; i++) {
        if (!found.volumes[i])
            continue;
        add_bricks(&found.bricks[i], &drawn->bricks);
        sp_volume_unref(&channels[i]);
        channels[i] = sp_volume_ref(found.volumes[i]);
    }
    finish(&found);
    return ok;
}
