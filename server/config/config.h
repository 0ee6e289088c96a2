/* SPDX-License-Identifier: Apache-2.0
 *
 * The settings of the daemon. One table (config.c) defines each setting once: its flag, which is
 * also its key in a file, its default, its range and its documentation. The table drives the parser
 * of the command line and of files, --help and --print-config.
 *
 * Arguments and the lines of files are read in order. A later value replaces an earlier one; only
 * `volume` accumulates.
 *
 * Why no getopt_long(): flags and files share one grammar (types, ranges, suffixes), and a library
 * for the command line would leave all of that to us.
 */
#ifndef SRV_CONFIG_CONFIG_H
#define SRV_CONFIG_CONFIG_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "sp/status.h"

enum { SRV_CONFIG_VOLUMES = 64 };

struct srv_config {
    /* Owned by the struct; NULL = not set. The numbers have the units of their names; sizes are in
     * bytes, *_px in pixels. config.c has the ranges, the defaults and the meaning of 0. */
    char *listen, *data, *cache, *state, *backend, *gpu, *isa, *token_file, *allow_origin,
        *allow_host, *log_level, *log_format, *tls_cert, *tls_key;
    char *volumes[SRV_CONFIG_VOLUMES];
    unsigned volume_count;
    int64_t threads, memory, video_memory, cache_size;
    int64_t connections, connections_per_address, connection_requests, handshakes, handshake_rate;
    int64_t sessions, participants, views;
    char *upload_dir;
    int64_t uploads, upload_bytes, upload_time_ms, upload_begin_time_ms;
    int64_t presets, hibernated_sessions, paths, path_frames, path_bytes;
    int64_t message_size, body_size, header_size, stream_bytes, render_queue, render_bytes;
    int64_t frame_px, video_px;
    int64_t header_time_ms, request_time_ms, idle_time_ms, session_time_ms, hibernation_time_ms,
        control_time_ms, stall_time_ms, ping_time_ms, drain_time_ms, rest_time_ms;
    int64_t http_threads, encode_threads;
    bool require_gpu, end_with_input;
    bool probe, help, version, print_config;
};

/* Fills in the defaults. SP_ERR_MEMORY. */
bool srv_config_init(struct srv_config *config, struct sp_error *err);
void srv_config_finish(struct srv_config *config);

/* Parses argv[1..] over the values in `config`. False: SP_ERR_INVALID, SP_ERR_MEMORY, or SP_ERR_IO
 * for a file that cannot be read. err->place is the flag, or "FILE:LINE". */
bool srv_config_parse(struct srv_config *config, int argc, char **argv, struct sp_error *err);

/* Parses one line of a file: "key = value", a comment or an empty line. `place` becomes err->place.
 */
bool srv_config_line(struct srv_config *config, const char *line, const char *place,
                     struct sp_error *err);

/* Calls differs() with the name of each setting whose value differs. */
void srv_config_compare(const struct srv_config *a, const struct srv_config *b,
                        void (*differs)(void *user, const char *name), void *user);

void srv_config_print_help(FILE *out);
/* Prints a file that --config reads. */
void srv_config_print(const struct srv_config *config, FILE *out);

/* Parses `text` as a value of the numeric setting `name`, for example "4096x4096" for frame-size.
 * False: SP_ERR_INVALID with an empty err->place. */
bool srv_config_number(const char *name, const char *text, int64_t *number, struct sp_error *err);

/* Opens a regular file for reading. Refuses FIFOs and devices (EINVAL), since reading them could
 * block for ever. NULL with errno set. */
FILE *srv_open_regular(const char *path);

#endif
