/* SPDX-License-Identifier: Apache-2.0 */
#include "data/default_view/elements.h"
#include "data/default_view/field.h"
#include "data/default_view/frame.h"
#include "data/default_view/labels.h"
#include "data/default_view/transfer.h"
#include "data/volume/sample.h"

enum { SEEN_MIN = 256 }; /* visible samples below which an object is looked for voxel by voxel */

struct box {
    uint32_t low[3], high[3];
};

/* Extends the box by a sample. */
static void extend(struct box *box, const uint32_t at[3]) {
    for (int a = 0; a < 3; a++) {
        box->low[a] = at[a] < box->low[a] ? at[a] : box->low[a];
        box->high[a] = at[a] > box->high[a] ? at[a] : box->high[a];
    }
}

/* The box of all voxels of the least visible value or more. False if there are none. Of a row that
 * the box contains, only the samples outside of it are looked at. */
static bool bound_visible(const struct sp_volume *volume, double least, struct box *box) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    const uint32_t *dims = info->grid.dims;
    const void *voxels = sp_volume_voxels(volume);
    uint32_t at[3];
    *box = (struct box){ .low = { UINT32_MAX, UINT32_MAX, UINT32_MAX } };
    for (at[2] = 0; at[2] < dims[2]; at[2]++)
        for (at[1] = 0; at[1] < dims[1]; at[1]++) {
            const uint64_t row = ((uint64_t)at[2] * dims[1] + at[1]) * dims[0];
            const bool is_inside = at[2] >= box->low[2] && at[2] <= box->high[2] &&
                                   at[1] >= box->low[1] && at[1] <= box->high[1];
            const uint32_t end = is_inside ? box->low[0] : dims[0];
            at[0] = 0;
            while (at[0] < end && !(sp_sample(voxels, info->type, row + at[0]) >= least))
                at[0]++;
            if (at[0] < end)
                extend(box, at);
            else if (!is_inside)
                continue;
            at[0] = dims[0] - 1;
            while (at[0] > box->high[0] && !(sp_sample(voxels, info->type, row + at[0]) >= least))
                at[0]--;
            extend(box, at);
        }
    return box->low[0] <= box->high[0];
}

static bool is_missed(const struct sp_default_samples *samples, const double extinction[]) {
    const uint32_t *dims = samples->info->grid.dims, *count = samples->count;
    uint64_t seen = 0;
    for (int b = 0; b < SP_FIRST_BINS; b++)
        seen += extinction[b] > 0 ? samples->histogram[b] : 0;
    return seen < SEEN_MIN && (count[0] < dims[0] || count[1] < dims[1] || count[2] < dims[2]);
}

/* Takes samples again, in the box of an object that fell between them, with a margin. */
static bool sample_closer(struct sp_default_samples *samples, const struct sp_volume *volume,
                          double least) {
    const uint32_t *dims = samples->info->grid.dims;
    struct box box;
    if (!bound_visible(volume, least, &box))
        return true;
    for (int a = 0; a < 3; a++) {
        box.low[a] -= box.low[a] > 0;
        box.high[a] += box.high[a] + 1 < dims[a];
        box.high[a] -= box.low[a] - 1; /* now its size */
    }
    sp_default_samples_finish(samples);
    return sp_default_samples_init(samples, volume, box.low, box.high);
}

/* Chooses what is visible. True if values matter more than light. */
static bool show(struct sp_view *view, const struct sp_volume *volume,
                 const struct sp_default_samples *samples) {
    if (sp_default_are_labels(volume) && sp_default_show_labels(volume, view))
        return false;
    const bool values_matter = sp_default_transfer(samples, &view->transfer_function);
    double per_voxel;
    if (!sp_default_is_distance(volume, samples, &per_voxel))
        return values_matter;
    sp_default_show_distance(samples, per_voxel, view);
    return false;
}

void sp_view_choose(struct sp_view *view, const struct sp_volume *volume, const char *id) {
    struct sp_default_samples samples;
    struct sp_transfer_function *tf = &view->transfer_function;
    double extinction[SP_FIRST_BINS];
    sp_view_init(view, sp_volume_info(volume), id);
    if (sp_volume_elements(volume)) {
        sp_default_elements(volume, view);
        return;
    }
    if (!sp_default_samples_init(&samples, volume, NULL, NULL))
        return;
    bool values_matter = show(view, volume, &samples);
    sp_default_extinction(&samples, tf, extinction);
    if (tf->order != SP_TF_PRE && is_missed(&samples, extinction)) {
        if (!sample_closer(&samples, volume, tf->points[0].value))
            return;
        values_matter = show(view, volume, &samples);
        sp_default_extinction(&samples, tf, extinction);
    }
    if (values_matter) {
        view->shading.ambient = 0.5;
        view->shading.diffuse = 0.65;
    }
    struct sp_default_orientation orientation = sp_default_orient(&samples, extinction);
    sp_default_frame(&samples, extinction, &orientation, &view->camera);
    sp_default_samples_finish(&samples);
    if (!sp_view_validate(view, NULL)) /* a grid that is nearly singular */
        sp_view_init(view, sp_volume_info(volume), id);
}
