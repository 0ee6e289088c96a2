/* SPDX-License-Identifier: Apache-2.0
 *
 * Support for the import tests: a temporary folder with input files.
 */
#ifndef TESTS_UNIT_IMPORT_SUPPORT_H
#define TESTS_UNIT_IMPORT_SUPPORT_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "sp/volume.h"
#include "support/compare.h"

/* Group set-up and tear-down for cmocka: create and remove the temporary folder. */
int folder_create(void **state);
int folder_remove(void **state);
const char *folder_path(void);

/* Returns "FOLDER/NAME". The text is valid until this thread has made eight more calls. */
const char *in_folder(const char *name);

void write_file(const char *name, const void *bytes, size_t size);
__attribute__((format(printf, 2, 3))) void write_text(const char *name, const char *format, ...);

/* Returns the bytes compressed by gzip; the caller frees them. */
void *gzip(const void *bytes, size_t size, size_t *packed);

/* Writes one file: a header, then samples. */
void write_both(const char *name, const char *header, const void *bytes, size_t size);

/* Load a file of the folder with the splat-import of this build. `load` fails the test if loading
 * fails. `load_error` fails the test if the file loads or if the error differs: its code must be
 * equal, and its place and text must contain the given ones. */
struct sp_volume *load(const char *name);
struct sp_volume *load_step(const char *name, uint32_t step);
/* Loads a file of the folder and fails the test if no warning contains the text. */
void load_warns(const char *name, const char *text);
void load_error(const char *name, enum sp_code code, const char *place, const char *text);

/* Returns options that name the splat-import of this build. */
struct sp_load_options importer_options(void);

/* Writes `count` test samples in native byte order; sample i has the value ramp_value(type, i),
 * which is negative for some samples of the signed types. */
void make_ramp(enum sp_type type, size_t count, void *out);
double ramp_value(enum sp_type type, size_t i);
void assert_is_ramp(const struct sp_volume *volume, size_t count);
/* Asserts that the vectors of the volume are the ramp, component after component or, if planar, all
 * x first, and that its samples are the lengths of the vectors. */
void assert_are_vectors(const struct sp_volume *volume, enum sp_type type, bool planar);

/* Asserts that the volume consists of the Gaussians that splats_reference.py finds in this file. */
void assert_are_gaussians(const struct sp_volume *volume, const char *path);

#endif
