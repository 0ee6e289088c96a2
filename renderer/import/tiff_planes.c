/* SPDX-License-Identifier: Apache-2.0 */
#include "import/tiff_planes.h"

#include <inttypes.h>
#include <stdlib.h>

bool tiff_planes_allocate(struct tiff_planes *p, const struct import_file *file, uint32_t most,
                          struct sp_error *err) {
    const uint64_t count = (uint64_t)p->slices * p->channels, limit = (uint64_t)most * 100;
    if (p->slices < 1 || p->channels < 1 || p->steps < 1 || count > limit ||
        p->steps > limit / count)
        return sp_fail(err, SP_ERR_FORMAT, file->shown,
                       "%" PRIu32 " slices, %" PRIu32 " channels and %" PRIu32
                       " steps cannot be in the %" PRIu32 " pages of the file",
                       p->slices, p->channels, p->steps, most);
    p->pages = malloc((size_t)(count * p->steps) * sizeof *p->pages);
    for (uint64_t i = 0; p->pages && i < count * p->steps; i++)
        p->pages[i] = TIFF_NO_PAGE;
    return p->pages || sp_fail(err, SP_ERR_MEMORY, file->shown, "out of memory for pages");
}

void tiff_planes_finish(struct tiff_planes *p) {
    free(p->pages);
    free(p->names);
    *p = (struct tiff_planes){ .slices = 0 };
}
