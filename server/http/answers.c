/* SPDX-License-Identifier: Apache-2.0 */
#include "http/answers.h"

#include <assert.h>
#include <inttypes.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "common/fair_share.h"

struct srv_answer_account {
    struct srv_answer_account *next;
    uint64_t bytes; /* more than 0, except while one is taken */
    char owner[SRV_TOKEN_NAME_BYTES];
};

struct srv_answers {
    struct sp_budget *budget;
    pthread_mutex_t mutex;
    struct srv_answer_account *accounts;
    uint64_t used; /* the sum of the accounts */
};

struct srv_answers *srv_answers_create(struct sp_budget *budget, struct sp_error *err) {
    struct srv_answers *answers = calloc(1, sizeof *answers);
    if (!answers) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the accounts of answers");
        return NULL;
    }
    answers->budget = budget;
    pthread_mutex_init(&answers->mutex, NULL);
    return answers;
}

void srv_answers_destroy(struct srv_answers **answers_pointer) {
    struct srv_answers *answers = *answers_pointer;
    *answers_pointer = NULL;
    if (!answers)
        return;
    assert(!answers->accounts && answers->used == 0);
    pthread_mutex_destroy(&answers->mutex);
    free(answers);
}

/* With the mutex held. NULL: out of memory. */
static struct srv_answer_account *find_or_add(struct srv_answers *answers, const char *owner) {
    struct srv_answer_account *account = answers->accounts;
    while (account && strcmp(account->owner, owner) != 0)
        account = account->next;
    if (account || !(account = calloc(1, sizeof *account)))
        return account;
    memcpy(account->owner, owner, strlen(owner) + 1);
    account->next = answers->accounts;
    answers->accounts = account;
    return account;
}

/* With the mutex held. */
static void remove_if_empty(struct srv_answers *answers, struct srv_answer_account *account) {
    struct srv_answer_account **link = &answers->accounts;
    if (account->bytes > 0)
        return;
    while (*link != account)
        link = &(*link)->next;
    *link = account->next;
    free(account);
}

/* With the mutex held. */
static bool reserve(struct srv_answers *answers, const struct srv_answer_account *account,
                    bool is_limited, uint64_t bytes, bool is_made, struct sp_error *err) {
    struct sp_budget *budget = answers->budget;
    const struct srv_pool pool = { sp_budget_limit(budget) / SRV_ANSWERS_DIVISOR, answers->used,
                                   account->bytes };
    const uint64_t left = srv_fair_left(&pool, true);
    if (is_limited && account->bytes > 0 && bytes > left)
        return sp_fail(err, SP_ERR_QUOTA, NULL,
                       "the answer needs %" PRIu64 " bytes; %s has %" PRIu64
                       " bytes of images and slices that were not read, and may have %" PRIu64
                       "; read them first",
                       bytes, account->owner[0] ? account->owner : "your token", account->bytes,
                       account->bytes + left);
    if (is_made)
        sp_budget_add(budget, SP_BUDGET_ANSWERS, bytes);
    else if (!sp_budget_acquire(budget, SP_BUDGET_ANSWERS, bytes))
        return sp_fail(err, SP_ERR_FRAME_BUDGET, NULL,
                       "the answer needs %" PRIu64 " bytes; images have %" PRIu64 " of the %" PRIu64
                       " bytes that they may have together; try again later",
                       bytes, sp_budget_total(budget), sp_budget_limit(budget));
    return true;
}

bool srv_answers_acquire(struct srv_answers *answers, const struct srv_answer_owner *owner,
                         uint64_t bytes, bool is_made, struct srv_answer *answer,
                         struct sp_error *err) {
    pthread_mutex_lock(&answers->mutex);
    struct srv_answer_account *account = find_or_add(answers, owner->name);
    const bool ok =
        account ? reserve(answers, account, owner->is_limited, bytes, is_made, err)
                : sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the account of an answer");
    if (ok) {
        account->bytes += bytes;
        answers->used += bytes;
        *answer = (struct srv_answer){ bytes, account };
    }
    if (account)
        remove_if_empty(answers, account);
    pthread_mutex_unlock(&answers->mutex);
    return ok;
}

void srv_answers_shrink(struct srv_answers *answers, struct srv_answer *answer, uint64_t bytes) {
    if (answer->bytes <= bytes)
        return;
    const uint64_t excess = answer->bytes - bytes;
    pthread_mutex_lock(&answers->mutex);
    sp_budget_release(answers->budget, SP_BUDGET_ANSWERS, excess);
    answers->used -= excess;
    answer->account->bytes -= excess;
    answer->bytes = bytes;
    remove_if_empty(answers, answer->account);
    pthread_mutex_unlock(&answers->mutex);
}
