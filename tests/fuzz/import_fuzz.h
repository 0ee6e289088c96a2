/* SPDX-License-Identifier: Apache-2.0 */
#ifndef TESTS_FUZZ_IMPORT_FUZZ_H
#define TESTS_FUZZ_IMPORT_FUZZ_H

#include "import/format.h"

/* Reads the bytes as a file of that format, as splat-import would: header, then samples when there
 * are few. Other files that it names are looked for in a folder with one file of 64 bytes, "d.raw".
 * Aborts when a header that was accepted does not hold what it must. Returns 0. */
int fuzz_import(const struct import_format *format, const char *shown, const uint8_t *data,
                size_t size);

#endif
