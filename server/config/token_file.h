/* SPDX-License-Identifier: Apache-2.0
 *
 * Parser of --token-file: one token per line, with its role and quotas.
 *
 *   TOKEN [role=admin|control|render|view|metrics] [name=NAME] [sessions=N] [snapshots=N] [fps=N]
 *         [views=N] [paths=N] [path-bytes=SIZE] [uploads=N] [upload-bytes=SIZE] [volumes=N]
 *         [frame-size=PX|WxH]
 *
 * Empty lines and lines that begin with # are skipped. TOKEN is 16 to 128 characters of
 * [A-Za-z0-9._~-]. Without a role it has the role admin; without a name it is called token-LINE.
 * README.md says what the roles may do and what the quotas limit.
 */
#ifndef SRV_CONFIG_TOKEN_FILE_H
#define SRV_CONFIG_TOKEN_FILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "config/secret.h"
#include "sp/status.h"

enum srv_right {
    SRV_RIGHT_NONE = 0,
    SRV_RIGHT_METRICS = 1, /* read /metrics */
    SRV_RIGHT_VIEW = 2,    /* read volumes, views and presets; watch sessions */
    SRV_RIGHT_RENDER = 4,  /* request snapshots, save views, create camera paths */
    SRV_RIGHT_CONTROL = 8, /* create, change and delete sessions; change presets; upload
                              files, open volumes and close those that it opened */
    SRV_RIGHT_ADMIN = 16,  /* access objects of other tokens and of the operator */
    /* No token has these: they mark routes where a session's own tokens also count, to watch it or
     * to change it (routes_sessions.c). */
    SRV_RIGHT_SESSION = 32,
    SRV_RIGHT_SESSION_CONTROL = 64
};

enum { SRV_TOKENS_MAX = 1000, SRV_TOKEN_NAME_BYTES = 33, SRV_TOKEN_FILE_BYTES = 256 * 1024 };

/* Limits of one token. 0 = only the daemon's own limit holds. */
struct srv_quota {
    unsigned sessions;     /* sessions that it created, active or hibernated */
    unsigned snapshots;    /* snapshots in progress */
    unsigned views;        /* views that it saved */
    unsigned paths;        /* camera paths, finished or not */
    unsigned uploads;      /* uploads, finished or not */
    unsigned volumes;      /* volumes that it opened and that are not closed */
    unsigned fps;          /* snapshots per second; frames per second to each participant of its
                              sessions */
    uint64_t path_bytes;   /* total size of the files of its camera paths, bytes */
    uint64_t upload_bytes; /* total declared size of its uploads, bytes */
    uint64_t frame_px;     /* largest image, pixels; also in its sessions */
    /* The token has a limited share of each pool (common/fair_share.h). Not in the file:
     * srv_tokens_set() sets it for tokens that are not admins, if other tokens also use the
     * daemon. */
    bool is_limited;
};

struct srv_token {
    char text[SRV_TOKEN_BYTES];
    char name[SRV_TOKEN_NAME_BYTES];
    bool has_name;   /* false = `name` is token-LINE */
    unsigned rights; /* bit set of enum srv_right */
    struct srv_quota quota;
};

/* Parses `size` bytes. *list is malloc'ed and the caller's; it has at least one token, in the order
 * of the lines. Names and tokens are unique. False: SP_ERR_INVALID with "line N" in err->place, or
 * SP_ERR_MEMORY. No error text contains a token. */
bool srv_token_file_parse(const char *text, size_t size, struct srv_token **list, size_t *count,
                          struct sp_error *err);

/* Reads a file of at most SRV_TOKEN_FILE_BYTES. False: SP_ERR_IO, SP_ERR_MEMORY, SP_ERR_DENIED if
 * other users may write to it, or SP_ERR_INVALID with the line in err->text. Logs a warning if
 * other users may read the file, and if tokens that own objects have no name. */
bool srv_token_file_read(const char *path, struct srv_token **list, size_t *count,
                         struct sp_error *err);

#endif
