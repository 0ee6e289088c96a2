/* SPDX-License-Identifier: Apache-2.0
 *
 * The text of --token-file: a token a line, with what it is for.
 *
 *   TOKEN [role=admin|control|render|view|metrics] [name=NAME] [sessions=N] [stills=N] [fps=N]
 *         [views=N] [paths=N] [path-bytes=SIZE] [frame-size=PX|WxH]
 *
 * Empty lines and those that begin with # are skipped. TOKEN is 16 to 128 characters of
 * [A-Za-z0-9._~-]; without a role it may do everything, without a name it is called token-LINE.
 */
#ifndef SRV_TOKEN_FILE_H
#define SRV_TOKEN_FILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "config/secret.h"
#include "sp/status.h"

enum srv_right {
    SRV_RIGHT_NONE = 0,
    SRV_RIGHT_METRICS = 1, /* read /metrics */
    SRV_RIGHT_VIEW = 2,    /* read volumes, views, presets; watch sessions */
    SRV_RIGHT_RENDER = 4,  /* draw pictures, keep views */
    SRV_RIGHT_CONTROL = 8, /* make, change and end sessions; change presets */
    SRV_RIGHT_ADMIN = 16,  /* load and unload volumes, and whatever comes without a right */
    SRV_RIGHT_SESSION = 32 /* nobody has it: a session's tokens count as well (routes_sessions.c) */
};

enum { SRV_TOKENS_MAX = 1000, SRV_TOKEN_NAME_BYTES = 33, SRV_TOKEN_FILE_BYTES = 256 * 1024 };

/* 0 = no limit but the daemon's. */
struct srv_quota {
    unsigned sessions;   /* that it made, awake or asleep */
    unsigned snapshots;  /* pictures by HTTP under way */
    unsigned views;      /* that it keeps */
    unsigned paths;      /* camera paths, drawn or not */
    unsigned fps;        /* pictures by HTTP, and frames to each participant of its sessions */
    uint64_t path_bytes; /* files of its camera paths */
    uint64_t frame_px;   /* of a picture, also in its sessions */
};

struct srv_token {
    char text[SRV_TOKEN_BYTES];
    char name[SRV_TOKEN_NAME_BYTES];
    bool has_name;   /* else it is called after its line */
    unsigned rights; /* a set of srv_right */
    struct srv_quota quota;
};

/* Parses `size` bytes. *list is malloc'ed, in the order of the lines, at least one long; names and
 * tokens are unique. False: SP_ERR_INVALID at "line N" (err->place is constant text, it fits), or
 * SP_ERR_MEMORY. Never tells a token. */
bool srv_token_file_parse(const char *text, size_t size, struct srv_token **list, size_t *count,
                          struct sp_error *err);

/* Reads a file of at most SRV_TOKEN_FILE_BYTES; SP_ERR_IO, SP_ERR_DENIED if others may write to it
 * (the log says so if they may read it), or SP_ERR_INVALID at "PATH: line N". The log says so, too,
 * if what somebody makes belongs to a line for want of a name. */
bool srv_token_file_read(const char *path, struct srv_token **list, size_t *count,
                         struct sp_error *err);

#endif
