/* SPDX-License-Identifier: Apache-2.0
 *
 * Redacted paths: clients see the names of files below the data folder, but not where that folder
 * is.
 */
#ifndef SRV_RENDER_REDACT_H
#define SRV_RENDER_REDACT_H

#include <stddef.h>

/* Removes a folder from a text: "FOLDER/a" becomes "a", and FOLDER alone becomes `as`. A name that
 * merely begins with FOLDER does not change. The result is cut to `size` bytes. folder NULL or "/":
 * copies the text. */
void srv_redact_folder(const char *folder, const char *as, const char *text, char *out,
                       size_t size);
/* Writes the source of a volume relative to `data` (NULL = none), or the file's name alone if it
 * lies elsewhere. */
void srv_redact_source(const char *data, const char *source, char *out, size_t size);
/* Removes `data` and the source's own folder from a text, in place. */
void srv_redact_text(const char *data, const char *source, char *text, size_t size);

#endif
