/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_COMMANDS_H
#define CLI_COMMANDS_H

#include "cli/http.h"
#include "cli/options.h"
#include "sp/encode.h"

/* A command returns the exit status: 0; 1 with *err set; 2 after it printed what was wrong with the
 * command line. */
typedef int command_fn(const struct options *options, struct sp_error *err);

command_fn command_volumes, command_load, command_view, command_render; /* commands.c, render.c */
command_fn command_presets, command_preset, command_views, command_kept, command_keep,
    command_sessions, command_session, command_share, command_paths; /* kept.c */
command_fn command_path;                                             /* path.c */

struct http *connect_to_daemon(const struct options *options, struct sp_error *err);
/* The text of a member; "" if it is none. */
const char *text_of(const proto_json *object, const char *key);
/* Prints a document and a newline. */
bool print_json(const proto_json *json, struct sp_error *err);
/* The view of the command line: that of --view, or an empty one, with --size. NULL with *err set.
 */
proto_json *read_view(const struct options *options, struct sp_error *err);

/* An image to be written, and what is known of how it came to be. */
struct picture {
    const void *bytes;
    size_t size;
    char backend[64], render_time[32], splats[32];
};
/* Writes it to options->out and, with --json, reports it on standard output. */
bool write_picture(const struct options *options, const struct picture *picture, const char *format,
                   struct sp_error *err);

/* The id of what `source` names: a volume that the daemon has, or one that it is told to load
 * (a file of its data folder, "demo:NAME"), waiting until it is ready unless `wait` is false.
 * Allocated; NULL with *err set. `must_load`: an id alone will not do. */
char *resolve_volume(struct http *http, const struct options *options, const char *source,
                     bool must_load, bool wait, struct sp_error *err);

/* Renders in this process. `patch` is the view, `source` a file or "demo:NAME". */
int render_local(const struct options *options, const char *source, const proto_json *patch,
                 enum sp_image_format format, struct sp_error *err);

#endif
