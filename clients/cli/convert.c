/* SPDX-License-Identifier: Apache-2.0
 *
 * splatctl convert: writes a volume in another format, without a daemon.
 */
#include <signal.h>
#include <stdio.h>
#include <unistd.h>

#include "cli/commands.h"
#include "sp/convert.h"
#include "sp/log.h"

/* True if the user interrupts the conversion, which then removes what it wrote. */
static bool is_interrupted(void) {
    sigset_t pending;
    return sigpending(&pending) == 0 &&
           (sigismember(&pending, SIGINT) || sigismember(&pending, SIGTERM));
}

static bool show_progress(void *user, double fraction) {
    if (isatty(STDERR_FILENO))
        fprintf(stderr, "\rconverting %s %3.0f %%%s", (const char *)user, fraction * 100,
                fraction >= 1 ? "\n" : "");
    return !is_interrupted();
}

/* What the format cannot say exactly. */
static void print_warning(void *user, enum sp_log_level level, const char *kind,
                          const struct sp_log_field *fields, const char *line) {
    (void)user;
    (void)level;
    (void)kind;
    (void)fields;
    fprintf(stderr, "%ssplatctl: %s\n", isatty(STDERR_FILENO) ? "\n" : "", line);
}

static void hold_signals(void) {
    sigset_t set;
    sigemptyset(&set);
    sigaddset(&set, SIGINT);
    sigaddset(&set, SIGTERM);
    sigprocmask(SIG_BLOCK, &set, NULL);
}

int command_convert(const struct options *options, struct sp_error *err) {
    if (options->argument_count != 2)
        return usage_error("convert", "needs a source, and the file to write");
    const char *out = options->arguments[1];
    char host[SP_SOURCE_HOST_BYTES]; /* the user who passes an address allows its host */
    if (!sp_convert_check(out, err))
        return usage_error("convert", "\"%s\" %s", out, err->text);
    const struct sp_load_options how = { .progress = show_progress,
                                         .user = (void *)options->argument, /* only read */
                                         .allowed_hosts = host,
                                         .timeout_ms = (int)options->timeout_s * 1000 };
    sp_log_init(print_warning, NULL, SP_LOG_WARN);
    hold_signals();
    return sp_source_host(options->argument, host, err) &&
                   sp_convert(options->argument, out, &how, err)
               ? 0
               : 1;
}
