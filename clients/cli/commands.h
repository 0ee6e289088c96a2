/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_COMMANDS_H
#define CLI_COMMANDS_H

#include "cli/http.h"
#include "cli/options.h"
#include "sp/encode.h"
#include "sp/volume.h"

/* A command returns the exit status: 0 on success, 1 with *err set, or 2 after it printed an error
 * of the command line. */
typedef int command_fn(const struct options *options, struct sp_error *err);

command_fn command_volumes, command_load, command_unload, command_view; /* commands.c */
command_fn command_render, command_slice;                               /* render.c, slice.c */
command_fn command_presets, command_preset, command_views, command_saved, command_save,
    command_sessions, command_session, command_share, command_paths; /* collections.c */
command_fn command_path;                                             /* path.c */
command_fn command_upload;                                           /* upload.c */
command_fn command_measures;                                         /* measures.c */
command_fn command_info;                                             /* info.c */
command_fn command_convert;                                          /* convert.c */

struct http *connect_to_daemon(const struct options *options, struct sp_error *err);
/* Seconds on a clock that never goes back. */
double now_s(void);
/* Returns the text of a member; "" if it has none. */
const char *text_of(const proto_json *object, const char *key);
/* Ends a command that opened a volume or saved a view: prints its id and warnings, or with --json
 * the answer of the daemon. Takes ownership of `http` and `made`; made NULL = the request failed.
 * Returns the exit status. */
int print_id(const struct options *options, struct http *http, proto_json *made,
             struct sp_error *err);
/* Prints a JSON document: on one line for programs with --json, else indented. */
bool print_json(const struct options *options, const proto_json *json, struct sp_error *err);
/* Prints a JSON document on one line. json NULL = memory ran out, which is also an error. */
bool print_line(const proto_json *json, struct sp_error *err);
/* Returns "/COLLECTION/NAME", allocated; NULL with *err set on failure. */
char *collection_path(struct http *http, const char *collection, const char *name,
                      struct sp_error *err);
/* Adds the layers of the options to the layers of the view (layers.c). False with *err set on
 * failure.
 */
bool layers_apply(const struct options *options, struct http *http, proto_json **view,
                  struct sp_error *err);
/* Parse a finite number, a colour (RRGGBB or #RRGGBB), or a comma, and move *text behind it
 * (layers.c). */
bool parse_finite(const char **text, double *out);
bool parse_color(const char **text, double color[3]);
bool parse_comma(const char **text);
/* Appends the channels of the options to the layers of the view, `list`; their volumes are loaded
 * if necessary (channels.c). False with *err set on failure. */
bool channels_append(const struct options *options, struct http *http, proto_json **view,
                     proto_json **list, struct sp_error *err);
/* Sets a member of the object `name` of the view. Replaces `name` if it is not an object
 * (patch.c). */
void set_member(proto_json **view, const char *name, const char *member, proto_json *value);
/* Returns the view of the options: --preset, --view over it, then --size and the options of the
 * camera, the projection and the layers (patch.c). `http` is used for --preset alone. NULL with
 * *err set on failure. */
proto_json *read_view(const struct options *options, struct http *http, struct sp_error *err);

/* An image to write, and the statistics of its rendering. */
struct image {
    const void *bytes;
    size_t size;
    char backend[64], render_time[32], splats[32];
    bool is_incomplete; /* the image shows coarser samples of the volume than its pixels need */
    /* For a volume that is larger than memory: the level of the samples, the level that the pixels
     * need, and the number of bricks that cannot be read. level NULL = any other volume. */
    const char *level, *asked, *lost;
};
/* Writes the image to options->out. With --json, prints its statistics. */
bool write_image(const struct options *options, const struct image *image, const char *format,
                 struct sp_error *err);

/* Returns the id of the volume that `source` names: the id of a volume of the daemon, or a source
 * to load (a file of its data folder, "demo:NAME"). Waits until it is ready if `wait`. `must_load`
 * refuses ids. Allocated; NULL with *err set on failure. */
char *resolve_volume(struct http *http, const struct options *options, const char *source,
                     bool must_load, bool wait, struct sp_error *err);

/* Waits until a volume is ready. `volume` is its description by the daemon. Takes ownership, and
 * returns the last description; NULL with *err set on failure. */
proto_json *await_volume(struct http *http, const struct options *options, proto_json *volume,
                         struct sp_error *err);

/* Loads a file or "demo:NAME" in this process, with progress on a terminal (local.c). */
struct sp_volume *load_local(const struct options *options, const char *source,
                             struct sp_error *err);

/* Renders in this process. `patch` is the view, `source` is a file or "demo:NAME". */
int render_local(const struct options *options, const char *source, const proto_json *patch,
                 enum sp_image_format format, struct sp_error *err);

#endif
