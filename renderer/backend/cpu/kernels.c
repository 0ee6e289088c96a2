/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/cpu/kernels.h"

#include <string.h>

#include "frame/resolve.h"
#include "tile/sheet.h"
#include "tile/slab.h"
#include "tile/splat.h"

bool cpu_kernels_init(struct cpu_kernels *kernels, const char *isa, struct sp_error *err) {
    if (strcmp(isa, "auto") != 0 && strcmp(isa, "scalar") != 0)
        return sp_fail(err, SP_ERR_INVALID, "",
                       "no instruction set is called \"%.64s\"; there are auto, scalar", isa);
    *kernels = (struct cpu_kernels){ .isa = "scalar",
                                     .set_up = sp_ewa_set_up,
                                     .add = { [SP_COMPOSITE_SPLAT] = sp_splat_add,
                                              [SP_COMPOSITE_SHEET] = sp_sheet_add,
                                              [SP_COMPOSITE_SLAB] = sp_slab_add },
                                     .tile_close = sp_tile_close,
                                     .resolve_rgba8 = sp_resolve_rgba8,
                                     .resolve_rgbaf32 = sp_resolve_rgbaf32 };
    return true;
}
