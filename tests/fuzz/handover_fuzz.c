/* SPDX-License-Identifier: Apache-2.0 */
#include <stdlib.h>
#include <string.h>

#include "data/import/handover.h"
#include "data/volume/elements.h"
#include "data/volume/volume.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* The parent may use an accepted message without further checks. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct sp_handover m;
    struct sp_error err;
    if (!sp_handover_decode(data, size, &m, "input", &err))
        return 0;
    if (m.kind == SP_HANDOVER_ERROR && (!memchr(m.error.text, 0, sizeof m.error.text) ||
                                        !memchr(m.error.place, 0, sizeof m.error.place)))
        abort();
    if (m.kind == SP_HANDOVER_OPENING && !(m.share >= 0 && m.share <= 1))
        abort();
    if (m.kind == SP_HANDOVER_SERIES &&
        (!memchr(m.series.uid, 0, sizeof m.series.uid) ||
         !memchr(m.series.description, 0, sizeof m.series.description) ||
         !memchr(m.series.modality, 0, sizeof m.series.modality)))
        abort();
    for (int i = 0; m.kind == SP_HANDOVER_DONE && i < SP_WARNINGS_MAX; i++)
        if (!memchr(m.done.warnings[i], 0, SP_WARNING_BYTES) ||
            (i > 0 && m.done.warnings[i][0] && !m.done.warnings[i - 1][0]))
            abort();
    if (m.kind == SP_HANDOVER_HEADER) {
        struct sp_grid grid = { .coordinates = { NULL } };
        uint64_t bytes, end = sp_handover_layout(&m.header).bytes;
        memcpy(grid.dims, m.header.dims, sizeof grid.dims);
        memcpy(grid.spacing, m.header.spacing, sizeof grid.spacing);
        memcpy(grid.origin, m.header.origin, sizeof grid.origin);
        memcpy(grid.direction, m.header.direction, sizeof grid.direction);
        const struct sp_elements_shape shape = sp_handover_shape(&m.header);
        const uint64_t times =
            m.header.has_times ? m.header.steps * sizeof(double) + sizeof(double) - 1 : 0;
        if (shape.kind != SP_KIND_GRID && end - sp_elements_bytes(&shape) > times)
            abort();
        if (!sp_grid_check(&grid, (enum sp_type)m.header.type, "input", &bytes, &err) ||
            bytes != m.header.bytes || end < bytes ||
            (shape.kind == SP_KIND_GRID &&
             end > 13 * bytes + UINT64_C(3) * 8 * SP_DIM_MAX + 2 * 64 + times) ||
            m.header.step >= m.header.steps || m.header.steps > SP_STEPS_MAX ||
            !memchr(m.header.time_unit, 0, sizeof m.header.time_unit) ||
            !memchr(m.header.unit, 0, sizeof m.header.unit) ||
            !memchr(m.header.value_name, 0, sizeof m.header.value_name) ||
            !memchr(m.header.vector_name, 0, sizeof m.header.vector_name))
            abort();
    }
    return 0;
}
