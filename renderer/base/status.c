/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/status.h"

#include <stdarg.h>
#include <stdio.h>

_Bool sp_fail(struct sp_error *err, enum sp_code code, const char *place, const char *format, ...) {
    if (!err)
        return 0;
    err->code = code;
    snprintf(err->place, sizeof err->place, "%s", place ? place : "");
    va_list args;
    va_start(args, format);
    vsnprintf(err->text, sizeof err->text, format, args);
    va_end(args);
    return 0;
}

const char *sp_code_name(enum sp_code code) {
    switch (code) {
    case SP_OK:
        return "ok";
    case SP_ERR_INVALID:
        return "invalid";
    case SP_ERR_UNSUPPORTED:
        return "unsupported";
    case SP_ERR_NOT_FOUND:
        return "not-found";
    case SP_ERR_FORMAT:
        return "format";
    case SP_ERR_IO:
        return "io";
    case SP_ERR_DENIED:
        return "denied";
    case SP_ERR_MEMORY:
        return "out-of-memory";
    case SP_ERR_BUDGET:
        return "over-budget";
    case SP_ERR_TIMEOUT:
        return "timeout";
    case SP_ERR_CRASHED:
        return "crashed";
    case SP_ERR_CANCELLED:
        return "cancelled";
    case SP_ERR_BACKEND:
        return "backend";
    case SP_ERR_FRAME_BUDGET:
        return "over-frame-budget";
    case SP_ERR_QUOTA:
        return "over-quota";
    case SP_ERR_NOT_READY:
        return "not-ready";
    case SP_ERR_VOLUME_UNKNOWN:
        return "volume-unknown";
    case SP_ERR_VOLUME_FAILED:
        return "volume-failed";
    case SP_ERR_TOO_LARGE:
        return "too-large";
    }
    return "unknown";
}
