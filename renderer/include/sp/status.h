/* SPDX-License-Identifier: Apache-2.0
 *
 * Errors. Every fallible function of the renderer returns bool or a pointer and takes a
 * `struct sp_error *err` last. It may be NULL; it is written on failure only, so that a caller can
 * chain calls and look once. A contract broken by code is an assert; one broken by a file, a peer
 * or a user is an error; running out of memory is an error too, never an abort.
 */
#ifndef SP_STATUS_H
#define SP_STATUS_H

enum sp_code {
    SP_OK = 0,
    SP_ERR_INVALID,     /* an argument, a view field or an option is outside its range */
    SP_ERR_UNSUPPORTED, /* valid, but this build or backend cannot do it */
    SP_ERR_NOT_FOUND,   /* no such file, volume or built-in name */
    SP_ERR_FORMAT,      /* the bytes of a file do not say what they should */
    SP_ERR_IO,          /* the system refused: open, read, fork, map */
    SP_ERR_DENIED,      /* a path outside the folder that it is confined to */
    SP_ERR_MEMORY,      /* allocation failed */
    SP_ERR_BUDGET,      /* over a configured budget; refused before allocating */
    SP_ERR_TIMEOUT,     /* took longer than its limit */
    SP_ERR_CRASHED,     /* a helper process died */
    SP_ERR_CANCELLED,   /* the caller asked to stop */
    SP_ERR_BACKEND      /* the backend failed; the next call may work */
};

enum { SP_ERROR_PLACE = 256, SP_ERROR_TEXT = 384 };

struct sp_error {
    enum sp_code code;
    char place[SP_ERROR_PLACE]; /* where: a JSON pointer ("/camera/up"), "FILE: byte N: FIELD", a
                                   path; "" = nowhere */
    char text[SP_ERROR_TEXT];   /* what and what to do; one sentence without a full stop */
};

/* Fills *err (if not NULL) from printf-style text and returns false, so that a function can say
 * `return sp_fail(err, SP_ERR_INVALID, "/size", "width %d is outside [1, 8192]", w);`.
 * `place` may be NULL (= ""). Long texts are cut. Thread-safe. */
__attribute__((format(printf, 4, 5))) _Bool sp_fail(struct sp_error *err, enum sp_code code,
                                                    const char *place, const char *format, ...);

/* A short constant name of the code: "invalid", "not-found", … Never NULL. */
const char *sp_code_name(enum sp_code code);

#endif
