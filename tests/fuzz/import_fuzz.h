/* SPDX-License-Identifier: Apache-2.0 */
#ifndef TESTS_FUZZ_IMPORT_FUZZ_H
#define TESTS_FUZZ_IMPORT_FUZZ_H

#include "data/import/format.h"

/* Reads the bytes as a file of that format, like splat-import: the header, then the samples or
 * elements if they have at most 1 MiB. Other files that the header names are searched in a folder
 * with one file of 64 bytes, "d.raw". Aborts if an accepted header is not valid. Returns 0. */
int fuzz_import(const struct import_format *format, const char *title, const uint8_t *data,
                size_t size);

#endif
