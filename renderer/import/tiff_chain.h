/* SPDX-License-Identifier: Apache-2.0
 *
 * The directories of a TIFF, read without any library and before any is asked: how many pages there
 * are, and whether the bytes that a page says it has can be there. Libraries repair what a
 * directory says wrong and then deliver pages that the file does not hold.
 */
#ifndef SP_IMPORT_TIFF_CHAIN_H
#define SP_IMPORT_TIFF_CHAIN_H

#include "import/format.h"

/* Follows the chain of directories of a TIFF or BigTIFF. Every strip or tile must lie in the file,
 * and hold the samples of its rows: all of them when they are stored as they are, and no fewer than
 * the codec needs at its best when they are packed. Together they are not longer than the file.
 * Places name file, page, byte and field. */
bool tiff_chain_check(const struct import_file *file, uint32_t *pages, struct sp_error *err);

#endif
