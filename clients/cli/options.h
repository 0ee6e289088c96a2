/* SPDX-License-Identifier: Apache-2.0
 *
 * splatctl: the daemon from a shell. main.c dispatches, commands.c, kept.c and render.c do what is
 * asked, http.c speaks to the daemon, local.c renders without one, output.c writes files whole or
 * not at all. Errors are a struct sp_error up to main(), which prints `splatctl: place: text`.
 */
#ifndef CLI_OPTIONS_H
#define CLI_OPTIONS_H

#include <stdbool.h>
#include <stdint.h>

struct options {
    const char *url, *token; /* NULL = of the environment, or the default */
    const char *command;     /* NULL = none given */
    const char *argument;    /* of the command: a path or an id; NULL = none */
    const char *id;          /* of a path that the daemon has */
    const char *volume, *view, *out, *format, *backend, *gpu, *isa;
    uint32_t size[2]; /* {0,0} = the view's */
    int quality;      /* 0 = the default */
    unsigned threads; /* 0 = one a core */
    unsigned timeout_s;
    bool local, json, no_wait, delete, help, version;
};

/* Reads the command line. False, with a message on standard error, if it cannot be understood (exit
 * status 2). Strings are those of argv. */
bool options_parse(struct options *options, int argc, char **argv);

/* Prints `splatctl: what: why`, and how to get help, to standard error; returns 2. */
__attribute__((format(printf, 2, 3))) int usage_error(const char *what, const char *format, ...);

void print_help(void);

#endif
