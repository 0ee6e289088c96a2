/* SPDX-License-Identifier: Apache-2.0
 *
 * Names and texts that people see. A hidden character is one that cannot be seen or that changes
 * how its surroundings are displayed: a C0 or C1 control, a line or paragraph separator, a
 * Bidi_Control (Unicode, PropList), a zero-width space, a soft hyphen, an invisible operator, an
 * annotation or a tag. The joiners U+200C and U+200D are none: several scripts are written with
 * them.
 *
 * A name that a person types is refused if it has one, because its author can correct it. The name
 * of a file is cleaned, because the user of the file often cannot.
 */
#ifndef PROTO_TEXT_H
#define PROTO_TEXT_H

#include <stdbool.h>

/* True if the UTF-8 text has no hidden character. */
bool proto_text_is_plain(const char *text);
/* Replaces each hidden character by one space, in place: the text never becomes longer. */
void proto_text_clean(char *text);
/* Makes UTF-8 text comparable for a search, in place: small letters, and no accents of Latin
 * letters, however they are encoded ("GRO\u0308SSE" and "grösse" become "grosse"). Bytes that are
 * not UTF-8 stay. The text never becomes longer. */
void proto_text_fold(char *text);

#endif
