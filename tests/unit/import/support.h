/* SPDX-License-Identifier: Apache-2.0
 *
 * Files for the import tests: a temporary folder, written and taken away again.
 */
#ifndef TESTS_UNIT_IMPORT_SUPPORT_H
#define TESTS_UNIT_IMPORT_SUPPORT_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "sp/volume.h"

/* cmocka group set-up and tear-down: makes the folder, removes it with all in it. */
int folder_create(void **state);
int folder_remove(void **state);
const char *folder_path(void);

/* "FOLDER/NAME", in one of eight buffers that take turns. */
const char *in_folder(const char *name);

void write_file(const char *name, const void *bytes, size_t size);
__attribute__((format(printf, 2, 3))) void write_text(const char *name, const char *format, ...);

/* gzip's form of the bytes; the caller frees. */
void *gzip(const void *bytes, size_t size, size_t *packed);

/* A header followed by samples, in one file. */
void write_both(const char *name, const char *header, const void *bytes, size_t size);

/* Loads a file of the folder with this build's splat-import. `load` fails the test with the error;
 * `load_error` fails the test when the file loads, or when code, place or text differ (the latter
 * two are fragments). */
struct sp_volume *load(const char *name);
void load_error(const char *name, enum sp_code code, const char *place, const char *text);

/* Options that name this build's splat-import. */
struct sp_load_options importer_options(void);

/* Native samples of a ramp with a sign, of `count`; sample i of every type is known again by
 * ramp_value(). */
void make_ramp(enum sp_type type, size_t count, void *out);
double ramp_value(enum sp_type type, size_t i);
void assert_is_ramp(const struct sp_volume *volume, size_t count);

#endif
