/* SPDX-License-Identifier: Apache-2.0 */
#include <assert.h>
#include <math.h>
#include <string.h>

#include "sp/volume.h"

const char *sp_meaning_name(enum sp_meaning meaning) {
    static const char *const names[SP_MEANING_COUNT] = { "", "labels", "statistic", "distance" };
    assert(meaning < SP_MEANING_COUNT);
    return names[meaning];
}

/* Fewer slices than this, and half as many as the others, or voxels that are this much thicker than
 * wide, are a stack. A simulation has at least FIELD_SLICES. */
enum { FEW_SLICES = 30, FIELD_SLICES = 8, THICK = 5 };

/* Cubic voxels of real numbers without a patient are a simulation with a short axis. */
static bool is_field(const struct sp_volume_info *info, const double spacing[3]) {
    const double least = fmin(spacing[0], fmin(spacing[1], spacing[2])),
                 most = fmax(spacing[0], fmax(spacing[1], spacing[2]));
    const bool is_real = info->type == SP_FLOAT32 || info->type == SP_FLOAT64;
    return is_real && !info->anatomy[0] && most < 1.5 * least;
}

bool sp_volume_is_thick_stack(const struct sp_volume_info *info) {
    const bool is_whole = info->whole.dims[0] > 0;
    const uint32_t *dims = is_whole ? info->whole.dims : info->grid.dims;
    const double *spacing = is_whole ? info->whole.spacing : info->grid.spacing;
    if (info->elements.kind != SP_KIND_GRID || info->vector_bytes ||
        strncmp(info->source, "demo:", 5) == 0)
        return false;
    for (int a = 0; a < 3; a++) {
        const int b = (a + 1) % 3, c = (a + 2) % 3;
        const double wide = fmax(spacing[b], spacing[c]);
        const uint32_t across = dims[b] < dims[c] ? dims[b] : dims[c];
        if (dims[a] < across && spacing[a] >= THICK * wide)
            return true;
        if (dims[a] < FEW_SLICES && across >= 2 * dims[a] &&
            (dims[a] < FIELD_SLICES || !is_field(info, spacing)))
            return true;
    }
    return false;
}
