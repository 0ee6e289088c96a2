/* SPDX-License-Identifier: Apache-2.0 */
#include "fuzz/import_fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* A list in JSON begins with a brace, one in XML does not. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const char *title = size > 0 && data[0] == '{' ? "input.series" : "input.pvd";
    return fuzz_import(&import_collection, title, data, size);
}
