/* SPDX-License-Identifier: Apache-2.0
 *
 * The OME-XML of a TIFF. The first byte of the input is the number of pages.
 */
#include <stdlib.h>

#include "data/import/tiff_planes.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const struct import_file file = { .fd = -1, .title = "input", .field = "" };
    struct tiff_planes planes = { .slices = 0 };
    struct sp_error err = { .code = SP_OK };
    const uint32_t pages = size > 0 ? data[0] % 64 + 1U : 1;
    if (size < 1)
        return 0;
    const bool ok = tiff_ome_parse(&planes, &file, (const char *)data + 1, size - 1, pages,
                                   data[0] / 64 + 1U, &err);
    if (!ok && err.code == SP_OK)
        abort();
    for (uint64_t i = 0; ok && i < (uint64_t)planes.slices * planes.channels * planes.steps; i++)
        if (planes.pages[i] != TIFF_NO_PAGE && planes.pages[i] >= pages)
            abort();
    tiff_planes_finish(&planes);
    return 0;
}
