/* SPDX-License-Identifier: Apache-2.0
 *
 * Clients are told names of files below the folder that they may load from, not where that lies.
 */
#ifndef SRV_RENDER_REDACT_H
#define SRV_RENDER_REDACT_H

#include <stddef.h>

/* Takes the folder out of a text: "FOLDER/a" becomes "a", and FOLDER alone `as`. Names that only
 * begin with it stay. Cut to fit. `folder` NULL or "/": the text as it is. */
void srv_redact_folder(const char *folder, const char *as, const char *text, char *out,
                       size_t size);
/* What a volume's source is called: below `data` (NULL = none), or the file's name alone. */
void srv_redact_source(const char *data, const char *source, char *out, size_t size);
/* The same for a text in which the source, its folder or `data` may stand; in place. */
void srv_redact_text(const char *data, const char *source, char *text, size_t size);

#endif
