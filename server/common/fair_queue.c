/* SPDX-License-Identifier: Apache-2.0 */
#include "common/fair_queue.h"

#include <math.h>

#define STARVATION_FACTOR 20.0       /* times the expected time */
#define STARVATION_UNKNOWN_MS 1000.0 /* if that is not known */
#define USE_MS 500.0                 /* after this time a third of what was used still counts */

double srv_fair_start(const struct srv_fair_account *account, double clock_ms) {
    return fmax(account->end_ms, clock_ms);
}

void srv_fair_charge(struct srv_fair_account *account, double clock_ms, double ms) {
    account->end_ms = srv_fair_start(account, clock_ms) + ms;
}

void srv_fair_correct(struct srv_fair_account *account, double more_ms) {
    account->end_ms += more_ms;
}

void srv_fair_add_use(struct srv_fair_use *use, double ms, double now_ms) {
    use->ms = fmax(srv_fair_used_portion(use, now_ms) * USE_MS + ms, 0);
    use->at_ms = now_ms;
}

double srv_fair_used_portion(const struct srv_fair_use *use, double now_ms) {
    return use->ms * exp(fmin(use->at_ms - now_ms, 0) / USE_MS) / USE_MS;
}

double srv_fair_protected_ms(double waited_ms, double expected_ms) {
    double limit_ms = expected_ms > 0 ? STARVATION_FACTOR * expected_ms : STARVATION_UNKNOWN_MS;
    return waited_ms < limit_ms ? 0 : waited_ms * 2 / STARVATION_FACTOR;
}
