/* SPDX-License-Identifier: Apache-2.0
 *
 * The tokens of the daemon, and what is under way with each. All functions are thread-safe.
 */
#ifndef SRV_TOKENS_H
#define SRV_TOKENS_H

#include "config/token_file.h"

/* err->place of what is over a token's quota: answered with 429. */
#define SRV_PLACE_QUOTA "--token-file"

struct srv_tokens;
struct srv_token_use; /* of one token; outlives it while somebody holds it */

/* What a token may do, as it was when it was looked up. */
struct srv_grant {
    unsigned rights; /* 0 = no such token */
    char name[SRV_TOKEN_NAME_BYTES];
    struct srv_quota quota;
    struct srv_token_use *use; /* held; NULL if there is no such token */
};

struct srv_tokens *srv_tokens_create(struct sp_error *err);
void srv_tokens_destroy(struct srv_tokens **tokens); /* after all grants were given back */

/* Takes over a malloc'ed list in place of the one before. What is under way goes on, and counts for
 * the token of the same name. False: out of memory, nothing has changed. */
bool srv_tokens_set(struct srv_tokens *tokens, struct srv_token *list, size_t count,
                    struct sp_error *err);

/* Compares with every token, in a time that tells nothing but their number and the length of
 * `given` (NULL = none). */
void srv_tokens_find(struct srv_tokens *tokens, const char *given, struct srv_grant *grant);
void srv_tokens_give_back(struct srv_tokens *tokens, struct srv_grant *grant);
/* What the token of this name may do (enum srv_right; NULL = not asked) and is allowed; false, and
 * nothing else: there is none of it. */
bool srv_tokens_of_name(struct srv_tokens *tokens, const char *name, unsigned *rights,
                        struct srv_quota *quota);

/* One more picture by HTTP is under way with this grant. SP_ERR_BUDGET at SRV_PLACE_QUOTA: too many
 * are, or were within the last second. */
bool srv_tokens_begin_snapshot(struct srv_tokens *tokens, const struct srv_grant *grant,
                               double now_ms, struct sp_error *err);
/* It ends before it was begun in earnest: it does not count for the last second either. */
void srv_tokens_cancel_snapshot(struct srv_tokens *tokens, const struct srv_grant *grant);
void srv_tokens_end_snapshot(struct srv_tokens *tokens, const struct srv_grant *grant);

#endif
