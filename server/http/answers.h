/* SPDX-License-Identifier: Apache-2.0
 *
 * The memory of images and slices that are sent as HTTP answers, until the clients have read them.
 * It belongs to the memory of frames (render/frame_memory.h), in the half of snapshots. A client
 * that does not read holds the memory until its deadline. Therefore all such answers together may
 * take only a part of this half, and each owner has a share of the part (common/fair_share.h). All
 * functions are thread-safe.
 */
#ifndef SRV_HTTP_ANSWERS_H
#define SRV_HTTP_ANSWERS_H

#include <stdbool.h>
#include <stdint.h>

#include "config/token_file.h"
#include "sp/budget.h"

enum { SRV_ANSWERS_DIVISOR = 2 }; /* answers have 1 / SRV_ANSWERS_DIVISOR of the budget's limit */

struct srv_answers; /* opaque */
struct srv_answer_account;

struct srv_answer_owner {            /* the token that asks */
    char name[SRV_TOKEN_NAME_BYTES]; /* "" = no token, or one without a name */
    bool is_limited; /* true = the owner has a share; false = it may take everything that is free */
};

struct srv_answer { /* zero-initialised = nothing is taken */
    uint64_t bytes;
    struct srv_answer_account *account; /* of its owner */
};

/* The budget outlives it. NULL with *err set: SP_ERR_MEMORY. */
struct srv_answers *srv_answers_create(struct sp_budget *budget, struct sp_error *err);
/* All answers must have been given back. Accepts NULL and nulls *answers. */
void srv_answers_destroy(struct srv_answers **answers);

/* Acquires the bytes of an answer before the answer is made. If `is_made`, the bytes may exceed the
 * limit of the budget. An owner without other answers may have one answer of any size that fits the
 * budget. False with both numbers in the text: SP_ERR_QUOTA (over the owner's share),
 * SP_ERR_FRAME_BUDGET; SP_ERR_MEMORY. */
bool srv_answers_acquire(struct srv_answers *answers, const struct srv_answer_owner *owner,
                         uint64_t bytes, bool is_made, struct srv_answer *answer,
                         struct sp_error *err);
/* Releases the bytes of the answer above `bytes`; 0 = releases all. */
void srv_answers_shrink(struct srv_answers *answers, struct srv_answer *answer, uint64_t bytes);

#endif
