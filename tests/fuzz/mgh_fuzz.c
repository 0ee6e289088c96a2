/* SPDX-License-Identifier: Apache-2.0 */
#include "fuzz/import_fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    return fuzz_import(&import_mgh, "input.mgh", data, size);
}
