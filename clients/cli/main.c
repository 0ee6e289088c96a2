/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <string.h>

#include "cli/commands.h"
#include "cli/help.h"
#include "cli/options.h"
#include "sp/log.h"

static const struct {
    const char *name;
    command_fn *run;
    bool deletes; /* accepts --delete */
} commands[] = {
    { "volumes", command_volumes, false }, { "load", command_load, false },
    { "unload", command_unload, false },   { "view", command_view, false },
    { "render", command_render, false },   { "save", command_save, false },
    { "saved", command_saved, true },      { "views", command_views, false },
    { "preset", command_preset, true },    { "presets", command_presets, false },
    { "share", command_share, false },     { "session", command_session, true },
    { "slice", command_slice, false },     { "sessions", command_sessions, false },
    { "upload", command_upload, false },   { "path", command_path, true },
    { "paths", command_paths, false },     { "measures", command_measures, false },
    { "info", command_info, false },       { "convert", command_convert, false },
};

/* Drops the renderer's log: errors reach the user as errors; the rest is for daemons. */
static void drop_line(void *user, enum sp_log_level level, const char *kind,
                      const struct sp_log_field *fields, const char *line) {
    (void)kind;
    (void)fields;
    (void)user;
    (void)level;
    (void)line;
}

static int run(const struct options *options) {
    for (size_t i = 0; i < sizeof commands / sizeof *commands; i++)
        if (strcmp(options->command, commands[i].name) == 0) {
            if (options->delete &&!commands[i].deletes)
                return usage_error(options->command, "does not accept --delete");
            struct sp_error err = { 0 };
            int status = commands[i].run(options, &err);
            if (status == 1)
                fprintf(stderr, "splatctl: %s: %s\n", err.place[0] ? err.place : options->command,
                        err.text);
            return status;
        }
    return usage_error(options->command, "is not a command");
}

int main(int argc, char **argv) {
    struct options options;
    sp_log_init(drop_line, NULL, SP_LOG_ERROR);
    if (!options_parse(&options, argc, argv))
        return 2;
    if (options.help) {
        help_print(options.command);
        return 0;
    }
    if (options.version) {
        puts("splatctl " SPLATD_VERSION);
        return 0;
    }
    if (!options.command)
        return usage_error("command line", "has no command");
    return run(&options);
}
