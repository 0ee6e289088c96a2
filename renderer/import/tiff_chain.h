/* SPDX-License-Identifier: Apache-2.0
 *
 * Checks the directories of a TIFF before OpenImageIO opens it. This is a parser of our own,
 * because libraries repair wrong directories silently and then return pages that the file does not
 * hold.
 */
#ifndef SP_IMPORT_TIFF_CHAIN_H
#define SP_IMPORT_TIFF_CHAIN_H

#include "import/format.h"

enum { TIFF_SAMPLES_MAX = 4 }; /* channels of a pixel */

/* Follows the chain of directories of a TIFF or BigTIFF and counts the pages. Every strip or tile
 * must lie in the file and be long enough for the samples of its rows: uncompressed samples need
 * all their bytes, compressed samples as many as the codec needs at its best ratio. All strips
 * together are not longer than the file. Errors name file, page, byte and field. */
bool tiff_chain_check(const struct import_file *file, uint32_t *pages, struct sp_error *err);

#endif
