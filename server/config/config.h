/* SPDX-License-Identifier: Apache-2.0
 *
 * The settings of the daemon. One table (config.c) names each of them once: its flag, which is its
 * key in a file too, its default, its range and what it does. The table parses the command line and
 * files, prints --help and --print-config. Command line and files are read in order; later wins,
 * but `volume` adds up.
 */
#ifndef SRV_CONFIG_H
#define SRV_CONFIG_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "sp/status.h"

enum { SRV_CONFIG_VOLUMES = 64 };

struct srv_config {
    /* Owned; NULL = not set. */
    char *listen, *data, *state, *backend, *gpu, *isa, *token_file, *allow_origin, *log_level,
        *log_format, *tls_cert, *tls_key;
    char *volumes[SRV_CONFIG_VOLUMES];
    unsigned volume_count;
    int64_t threads, memory, video_memory;
    int64_t connections, connections_per_address, connection_requests, handshakes, handshake_rate;
    int64_t sessions, participants, views;
    int64_t presets, sleeping_sessions, paths, path_frames, path_bytes;
    int64_t message_size, body_size, header_size, stream_bytes, render_queue, render_bytes;
    int64_t frame_px, video_px;
    int64_t header_time_ms, request_time_ms, idle_time_ms, session_time_ms, sleep_time_ms,
        control_time_ms, stall_time_ms, ping_time_ms, drain_time_ms, rest_time_ms;
    int64_t http_threads, encode_threads;
    bool require_gpu;
    bool probe, help, version, print_config;
};

/* Fills in the defaults. */
bool srv_config_init(struct srv_config *config, struct sp_error *err);
void srv_config_finish(struct srv_config *config);

/* Parses argv[1..]. err->place is the flag, or "FILE:LINE". SP_ERR_INVALID, or SP_ERR_IO for a
 * file that cannot be read. */
bool srv_config_parse(struct srv_config *config, int argc, char **argv, struct sp_error *err);

/* One line of a file: "key = value", a comment or nothing. */
bool srv_config_line(struct srv_config *config, const char *line, const char *place,
                     struct sp_error *err);

/* Calls differs() with the name of each setting that is not the same in both. */
void srv_config_compare(const struct srv_config *a, const struct srv_config *b,
                        void (*differs)(void *user, const char *name), void *user);

void srv_config_print_help(FILE *out);
void srv_config_print(const struct srv_config *config, FILE *out); /* a file that --config reads */

/* The number that `text` is for the setting of that name, which has numbers: "4096x4096" for
 * frame-size. err->place is empty. */
bool srv_config_number(const char *name, const char *text, int64_t *number, struct sp_error *err);

/* Opens a file for reading; a FIFO or a device, which could keep us waiting, is EINVAL. NULL with
 * errno set. */
FILE *srv_open_regular(const char *path);

#endif
