/* SPDX-License-Identifier: Apache-2.0 */
#include "schedule/fair_queue.h"

#include <math.h>

#define PATIENCE 20.0
#define PATIENCE_UNKNOWN_MS 1000.0

double srv_fair_start(const struct srv_fair_account *share, double clock_ms) {
    return fmax(share->end_ms, clock_ms);
}

void srv_fair_charge(struct srv_fair_account *share, double clock_ms, double ms) {
    share->end_ms = srv_fair_start(share, clock_ms) + ms;
}

void srv_fair_correct(struct srv_fair_account *share, double more_ms) {
    share->end_ms += more_ms;
}

double srv_fair_protected_ms(double waited_ms, double expected_ms) {
    double patience_ms = expected_ms > 0 ? PATIENCE * expected_ms : PATIENCE_UNKNOWN_MS;
    return waited_ms < patience_ms ? 0 : waited_ms * 2 / PATIENCE;
}
