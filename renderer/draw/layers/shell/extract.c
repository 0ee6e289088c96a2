/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/shell/extract.h"

#include <stdlib.h>
#include <string.h>

#include "classify/gradient.h"
#include "data/volume/sample.h"

struct work {
    const struct sp_shell_extract *job;
    struct sp_voxel_list *list;
    struct sp_gradient_grid gradient;
    const void *voxels;
    enum sp_type type;
};

/* The opaque neighbours of a word of voxels, by side: x−, x+, y−, y+, z−, z+. */
struct around {
    uint64_t opaque[6];
};

/* The bits of a word that clipping leaves. */
static inline uint64_t clip_word(const struct sp_shell_extract *job, uint32_t w, uint32_t y,
                                 uint32_t z) {
    if (!job->clip)
        return UINT64_MAX;
    const struct sp_voxel_interval *i = &job->clip[(uint64_t)z * job->masks->dims[1] + y];
    uint32_t first = w * SP_SHELL_WORD;
    if (i->begin >= first + SP_SHELL_WORD || i->end <= first)
        return 0;
    uint64_t bits = i->begin > first ? UINT64_MAX << (i->begin - first) : UINT64_MAX;
    uint32_t left = i->end - first;
    return left < SP_SHELL_WORD ? bits & ((UINT64_C(1) << left) - 1) : bits;
}

static uint64_t word_at(const struct sp_shell_extract *job, int which, int64_t w, int64_t y,
                        int64_t z) {
    const struct sp_shell_masks *m = job->masks;
    if (w < 0 || w >= m->words || y < 0 || y >= m->dims[1] || z < 0 || z >= m->dims[2])
        return 0;
    return sp_shell_masks_row(m, which, (uint32_t)y, (uint32_t)z)[w] &
           clip_word(job, (uint32_t)w, (uint32_t)y, (uint32_t)z);
}

static struct around look_around(const struct sp_shell_extract *job, uint32_t w, uint32_t y,
                                 uint32_t z) {
    const int opaque = 1;
    uint64_t own = word_at(job, opaque, w, y, z);
    return (struct around){ {
        own << 1 | word_at(job, opaque, (int64_t)w - 1, y, z) >> 63,
        own >> 1 | word_at(job, opaque, (int64_t)w + 1, y, z) << 63,
        word_at(job, opaque, w, (int64_t)y - 1, z),
        word_at(job, opaque, w, (int64_t)y + 1, z),
        word_at(job, opaque, w, y, (int64_t)z - 1),
        word_at(job, opaque, w, y, (int64_t)z + 1),
    } };
}

static uint64_t shell_word(const struct sp_shell_extract *job, uint32_t w, uint32_t y, uint32_t z,
                           struct around *around) {
    uint64_t in = word_at(job, 0, w, y, z), inner = UINT64_MAX;
    if (!in || !(job->states->high > 0)) /* then even what is beyond the border is opaque */
        return 0;
    *around = look_around(job, w, y, z);
    for (int i = 0; i < 6; i++)
        inner &= around->opaque[i];
    return in & ~inner;
}

/* True if clipping leaves less than all of row (y, z) or of a row beside it. */
static bool is_clipped(const struct sp_shell_extract *job, uint32_t y, uint32_t z) {
    const uint32_t *dims = job->masks->dims;
    const struct sp_voxel_interval *own = &job->clip[(uint64_t)z * dims[1] + y];
    const struct sp_voxel_interval *rows[5] = { own, y > 0 ? own - 1 : own,
                                                y + 1 < dims[1] ? own + 1 : own,
                                                z > 0 ? own - dims[1] : own,
                                                z + 1 < dims[2] ? own + dims[1] : own };
    for (int i = 0; i < 5; i++)
        if (rows[i]->begin > 0 || rows[i]->end < dims[0])
            return true;
    return false;
}

/* True if the masks that row (y, z) depends on may have changed. */
static bool is_changed(const struct sp_shell_extract *job, uint32_t y, uint32_t z) {
    const struct sp_shell_masks *m = job->masks;
    if (!job->from || (job->clip && is_clipped(job, y, z)))
        return true;
    if (!job->changed)
        return false;
    uint32_t last[2] = { y + 1 < m->dims[1] ? y + 1 : y, z + 1 < m->dims[2] ? z + 1 : z };
    uint32_t first[2] = { y ? y - 1 : y, z ? z - 1 : z };
    for (uint32_t k = first[1] / SP_SHELL_SIDE; k <= last[1] / SP_SHELL_SIDE; k++)
        for (uint32_t j = first[0] / SP_SHELL_SIDE; j <= last[0] / SP_SHELL_SIDE; j++)
            if (job->changed[k * m->sides[0] + j])
                return true;
    return false;
}

static void count_rows(void *user, size_t begin, size_t end, unsigned worker) {
    const struct work *work = user;
    const struct sp_shell_masks *m = work->job->masks;
    const struct sp_voxel_list *from = work->job->from;
    (void)worker;
    for (size_t row = begin; row < end; row++) {
        uint32_t y = (uint32_t)(row % m->dims[1]), z = (uint32_t)(row / m->dims[1]), n = 0;
        struct around around;
        if (y % 64 == 0 && sp_interrupt_is_cancelled(work->job->interrupt))
            return;
        if (is_changed(work->job, y, z))
            for (uint32_t w = 0; w < m->words; w++)
                n += (uint32_t)__builtin_popcountll(shell_word(work->job, w, y, z, &around));
        else
            n = from->first[row + 1] - from->first[row];
        work->list->first[row + 1] = n;
    }
}

/* Fills the colour and the depth of a voxel. */
static void classify(const struct work *work, struct sp_voxel *v, uint64_t at) {
    const struct sp_transfer *transfer = work->job->states->transfer;
    struct sp_class c = sp_transfer_value_class(transfer, sp_sample(work->voxels, work->type, at));
    c = sp_transfer_scale_class(transfer, c, v->normal);
    for (int k = 0; k < 3; k++)
        v->color[k] = (uint16_t)(c.color[k] * 65535 + 0.5f);
    v->depth = c.depth;
}

static void write_voxel(const struct work *work, uint32_t x, uint32_t y, uint32_t z, unsigned code,
                        struct sp_voxel *v) {
    const uint32_t *dims = work->list->dims, i[3] = { x, y, z };
    double gradient[3];
    *v = (struct sp_voxel){ .at = { (uint16_t)x, (uint16_t)y, (uint16_t)z },
                            .code = (uint16_t)code };
    sp_gradient_at(&work->gradient, i, gradient);
    v->normal = sp_gradient_pack(&work->gradient, gradient);
    classify(work, v, ((uint64_t)z * dims[1] + y) * dims[0] + x);
}

static void write_row(const struct work *work, uint32_t y, uint32_t z, struct sp_voxel *to) {
    const struct sp_shell_masks *m = work->job->masks;
    struct around around;
    for (uint32_t w = 0; w < m->words; w++) {
        uint64_t opaque = sp_shell_masks_row(m, 1, y, z)[w];
        for (uint64_t left = shell_word(work->job, w, y, z, &around); left; left &= left - 1) {
            int bit = __builtin_ctzll(left);
            unsigned code = opaque >> bit & 1 ? SP_VOXEL_OPAQUE : 0;
            for (int i = 0; i < 6; i++)
                code |= (unsigned)(around.opaque[i] >> bit & 1) << i;
            write_voxel(work, w * SP_SHELL_WORD + (uint32_t)bit, y, z, code, to++);
        }
    }
}

static void copy_row(const struct work *work, uint64_t row, struct sp_voxel *to) {
    const struct sp_voxel_list *from = work->job->from;
    uint32_t first = from->first[row], count = from->first[row + 1] - first;
    if (!count)
        return;
    memcpy(to, from->voxels + first, count * sizeof *to);
    for (uint32_t i = 0; i < count && !work->job->same_classes; i++)
        classify(work, &to[i], row * from->dims[0] + to[i].at[0]);
}

static void write_rows(void *user, size_t begin, size_t end, unsigned worker) {
    const struct work *work = user;
    const uint32_t *dims = work->list->dims;
    (void)worker;
    for (size_t row = begin; row < end; row++) {
        struct sp_voxel *to = work->list->voxels + work->list->first[row];
        uint32_t y = (uint32_t)(row % dims[1]), z = (uint32_t)(row / dims[1]);
        if (y % 16 == 0 && sp_interrupt_is_cancelled(work->job->interrupt))
            return;
        if (work->list->first[row + 1] == work->list->first[row])
            continue;
        if (is_changed(work->job, y, z))
            write_row(work, y, z, to);
        else
            copy_row(work, row, to);
    }
}

static bool extract(struct work *work, struct sp_error *err) {
    const struct sp_shell_extract *job = work->job;
    struct sp_voxel_list *list = work->list;
    uint64_t rows = sp_voxel_list_rows(list);
    if (!sp_voxel_list_start(list, err))
        return false;
    sp_parallel_for(job->pool, rows, 256, count_rows, work);
    if (sp_interrupt_is_cancelled(job->interrupt))
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    if (!sp_voxel_list_sum(list, job->bytes_max, "raise \"low\", or lower \"high\"", err))
        return false;
    sp_parallel_for(job->pool, rows, 128, write_rows, work);
    return !sp_interrupt_is_cancelled(job->interrupt) ||
           sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
}

bool sp_shell_extract(const struct sp_shell_extract *job, struct sp_voxel_list *list,
                      struct sp_error *err) {
    const uint32_t *dims = job->masks->dims;
    struct work work = { .job = job,
                         .list = list,
                         .voxels = sp_volume_voxels(job->volume),
                         .type = sp_volume_info(job->volume)->type };
    *list = (struct sp_voxel_list){ .dims = { dims[0], dims[1], dims[2] } };
    sp_gradient_grid_init(&work.gradient, job->volume);
    if (extract(&work, err))
        return true;
    sp_voxel_list_finish(list);
    return false;
}
