/* SPDX-License-Identifier: Apache-2.0 */
#include "fuzz/import_fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
const char *__lsan_default_suppressions(void);

/* teem forgets strings of headers that it refuses; splat-import reads one file and ends. */
__attribute__((visibility("default"))) const char *__lsan_default_suppressions(void) {
    return "leak:libteem\n";
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    return fuzz_import(&import_nrrd, "input.nrrd", data, size);
}
