/* SPDX-License-Identifier: Apache-2.0
 *
 * The directories of a TIFF. A file that passes them ends with an error, because the module with
 * libtiff is not beside this program.
 */
#include "fuzz/import_fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    return fuzz_import(&import_tiff, "input.tif", data, size);
}
