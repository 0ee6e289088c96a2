/* SPDX-License-Identifier: Apache-2.0
 *
 * A connected part: the samples in a range of values that a path through faces of samples in that
 * range connects with a point. With it go the samples beside it that are not in the range: they
 * hold the fading border of the part.
 */
#include "inspect/edit/apply.h"
#include "inspect/part/connect.h"

/* Samples beside a part that go with it: one goes away with a part that is removed, two stay with a
 * part that is kept. */
enum { GONE = 1, KEPT = 2 };

struct part {
    struct sp_edited *edited;
    const struct sp_edit *edit;
    struct sp_mask all;  /* samples in the range */
    struct sp_mask mine; /* of these, the part; then with the samples beside it */
    struct sp_mask before;
};

/* Adds the samples beside the part that are not in the range. */
static void widen(struct part *part) {
    const uint32_t *dims = part->all.dims;
    int count = part->edit->keep == SP_KEEP_INSIDE ? KEPT : GONE;
    for (int i = 0; i < count; i++) {
        sp_mask_grow(&part->mine, &part->before, part->edited->pool);
        for (uint64_t w = 0; w < (uint64_t)dims[2] * dims[1] * part->all.words; w++)
            part->mine.bits[w] = part->before.bits[w] | (part->mine.bits[w] & ~part->all.bits[w]);
    }
}

static void remove_rows(void *user, size_t begin, size_t end, unsigned worker) {
    const struct part *part = user;
    const uint32_t *dims = part->all.dims;
    uint64_t holes = 0;
    (void)worker;
    for (size_t row = begin; row < end; row++) {
        const uint64_t *bits =
            sp_mask_row(&part->mine, (uint32_t)(row % dims[1]), (uint32_t)(row / dims[1]));
        for (uint32_t x = 0; x < dims[0]; x++)
            if ((bits[x / 64] >> x % 64 & 1) != (part->edit->keep == SP_KEEP_INSIDE))
                holes += sp_edited_keep(part->edited, row * dims[0] + x, 0);
    }
    atomic_fetch_add(&part->edited->holes, holes);
}

bool sp_edit_part(struct sp_edited *edited, const struct sp_edit *edit, struct sp_error *err) {
    const uint32_t *dims = edited->info->grid.dims;
    struct part part = { .edited = edited, .edit = edit };
    bool is_found;
    bool ok = sp_part_connect(edited->info, edited->voxels, edit->point, edit->range, edited->pool,
                              &part.all, &part.mine, &is_found, err) &&
              sp_mask_init(&part.before, dims, err);
    if (ok && is_found) {
        widen(&part);
        sp_parallel_for(edited->pool, (size_t)dims[1] * dims[2], 64, remove_rows, &part);
    }
    sp_mask_finish(&part.all);
    sp_mask_finish(&part.mine);
    sp_mask_finish(&part.before);
    return ok;
}
