/* SPDX-License-Identifier: Apache-2.0 */
#ifndef PROTO_TEXT_H
#define PROTO_TEXT_H

#include <stdbool.h>

/* True if the UTF-8 text has no control character and none that changes how its surroundings are
 * displayed: no C0 or C1 control, line or paragraph separator, or Bidi_Control (Unicode, PropList).
 */
bool proto_text_is_plain(const char *text);

#endif
