/* SPDX-License-Identifier: Apache-2.0
 *
 * The tokens of the daemon, and the snapshots in progress per token. All functions are thread-safe.
 */
#ifndef SRV_CONFIG_TOKENS_H
#define SRV_CONFIG_TOKENS_H

#include "config/token_file.h"

struct srv_tokens;
struct srv_token_use; /* counters of one token; they live until the last grant is given back */

/* The rights and quotas of a token: a copy from the time of the lookup. */
struct srv_grant {
    unsigned rights; /* 0 = no such token */
    char name[SRV_TOKEN_NAME_BYTES];
    struct srv_quota quota;
    struct srv_token_use *use; /* a reference; NULL = no such token */
};

struct srv_tokens *srv_tokens_create(struct sp_error *err);
void srv_tokens_destroy(struct srv_tokens **tokens); /* after all grants are given back */

/* Replaces the list of tokens; takes ownership of the malloc'ed `list`, also on failure. Snapshots
 * in progress continue and count for the new token of the same name. False: SP_ERR_MEMORY; nothing
 * has changed. */
bool srv_tokens_set(struct srv_tokens *tokens, struct srv_token *list, size_t count,
                    struct sp_error *err);

/* Looks up a token; `given` NULL = none. Compares with every token, so that the time depends only
 * on their number and the length of `given`. Give the grant back afterwards. */
void srv_tokens_acquire(struct srv_tokens *tokens, const char *given, struct srv_grant *grant);
void srv_tokens_release(struct srv_tokens *tokens, struct srv_grant *grant);
/* Reads the rights (bits of enum srv_right; NULL = not needed) and the quota of the token with this
 * name. False: there is none, and nothing is written. */
bool srv_tokens_of_name(struct srv_tokens *tokens, const char *name, unsigned *rights,
                        struct srv_quota *quota);
/* Gets the name, quota and counters of the token with this name, without its rights: for a client
 * whose requests count for that token. False: there is none, and nothing is written. */
bool srv_tokens_charge_to(struct srv_tokens *tokens, const char *name, struct srv_grant *grant);

/* Begins a snapshot with this grant. SP_ERR_QUOTA: too many snapshots of the token are in progress,
 * or began within the last second. */
bool srv_tokens_begin_snapshot(struct srv_tokens *tokens, const struct srv_grant *grant,
                               double now_ms, struct sp_error *err);
/* Ends a snapshot that was not rendered: it does not count towards fps. */
void srv_tokens_cancel_snapshot(struct srv_tokens *tokens, const struct srv_grant *grant);
void srv_tokens_end_snapshot(struct srv_tokens *tokens, const struct srv_grant *grant);

#endif
