/* SPDX-License-Identifier: Apache-2.0
 *
 * Errors. Every fallible function returns bool or a pointer and takes `struct sp_error *err` last.
 * `err` may be NULL. It is written on failure only, so that a caller can chain calls and look once.
 * A broken contract in code is an assert. A defect in a file, a peer's message or a user's input is
 * an error. Running out of memory is an error, never an abort.
 */
#ifndef SP_STATUS_H
#define SP_STATUS_H

#include <stdbool.h>

#include "sp/api.h"

#ifdef __cplusplus
extern "C" {
#endif

enum sp_code {
    SP_OK = 0,
    SP_ERR_INVALID,      /* an argument, a view field or an option is out of its range */
    SP_ERR_UNSUPPORTED,  /* valid, but this build or backend cannot do it */
    SP_ERR_NOT_FOUND,    /* no such file, volume or built-in name */
    SP_ERR_FORMAT,       /* a file breaks the rules of its format */
    SP_ERR_IO,           /* the system refused: open, read, fork, map */
    SP_ERR_DENIED,       /* a path leads out of the folder that it is confined to */
    SP_ERR_MEMORY,       /* an allocation failed */
    SP_ERR_BUDGET,       /* over a configured budget; refused before allocating */
    SP_ERR_TIMEOUT,      /* it took longer than its limit */
    SP_ERR_CRASHED,      /* a helper process died or broke its protocol */
    SP_ERR_CANCELLED,    /* the caller cancelled it */
    SP_ERR_BACKEND,      /* the backend failed; the next call may work */
    SP_ERR_FRAME_BUDGET, /* over the budget of the memory of frames (sp/budget.h): another frame may
                            have left too little, or this one needs too much */
    /* For programs that serve volumes to several users; the renderer itself never returns them. */
    SP_ERR_QUOTA,          /* over the quota of one user; other users are not affected */
    SP_ERR_NOT_READY,      /* is still being loaded or computed; try again later */
    SP_ERR_VOLUME_UNKNOWN, /* a view names a volume that does not exist */
    SP_ERR_VOLUME_FAILED,  /* a view names a volume that could not be loaded */
    SP_ERR_TOO_LARGE       /* larger than a fixed limit; never accepted, whatever others use */
};

enum { SP_ERROR_PLACE = 256, SP_ERROR_TEXT = 384 }; /* bytes, with the final 0 */

struct sp_error {
    enum sp_code code;
    /* Where: a JSON pointer ("/camera/up"), "FILE: byte N: FIELD", or a path; "" = no place. For
     * people only: programs branch on the code. */
    char place[SP_ERROR_PLACE];
    char text[SP_ERROR_TEXT]; /* what is wrong and what to do; one sentence without a full stop */
};

/* Fills *err and returns false, so that a function can say
 *   return sp_fail(err, SP_ERR_INVALID, "/size", "width %u is outside [1, 8192]", width);
 * `err` may be NULL, and so may `place` (= ""). Long texts are cut. Thread-safe. */
SP_API SP_PRINTF(4, 5) bool sp_fail(struct sp_error *err, enum sp_code code, const char *place,
                                    const char *format, ...);

/* Returns a short constant name of the code: "invalid", "not-found", … Never NULL. Thread-safe. */
SP_API const char *sp_code_name(enum sp_code code);

#ifdef __cplusplus
}
#endif

#endif
