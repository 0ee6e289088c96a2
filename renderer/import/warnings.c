/* SPDX-License-Identifier: Apache-2.0 */
#include "import/warnings.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

void import_warn(struct import_warnings *warnings, const char *format, ...) {
    enum { LAST = SP_WARNINGS_MAX - 1 };
    char text[SP_WARNING_BYTES];
    va_list args;
    if (!warnings)
        return;
    va_start(args, format);
    int n = vsnprintf(text, sizeof text, format, args);
    va_end(args);
    if (n >= (int)sizeof text) { /* not inside of a UTF-8 character */
        for (n = sizeof text - sizeof "…"; n > 0 && ((unsigned char)text[n] & 0xc0) == 0x80;)
            n--;
        memcpy(text + n, "…", sizeof "…");
    }
    for (unsigned i = 0; i < warnings->count && i < SP_WARNINGS_MAX; i++)
        if (strcmp(warnings->texts[i], text) == 0)
            return;
    if (warnings->count < SP_WARNINGS_MAX)
        memcpy(warnings->texts[warnings->count], text, sizeof text);
    else
        snprintf(warnings->texts[LAST], SP_WARNING_BYTES, "%u more warnings are not listed.",
                 warnings->count - LAST + 1);
    warnings->count++;
}
