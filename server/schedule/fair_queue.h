/* SPDX-License-Identifier: Apache-2.0
 *
 * Equal shares of time: start-time fair queueing (Goyal, Vin and Cheng 1996). Pure functions: no
 * lock, no system clock.
 */
#ifndef SRV_SCHEDULE_FAIR_QUEUE_H
#define SRV_SCHEDULE_FAIR_QUEUE_H

/* What a session, a participant or an owner has received, in virtual time.
 *
 *   virtual clock (ms)  0      10      20      30      40      50
 *   account A           [ frame: 30 ms          ]end
 *   account B           [ 10 ms ]end [ 10 ms ]end
 *                                            ▲ clock = 20: B starts at 20, A at 30: B is next
 *
 * The clock is the time that each account has received that always wants something. An account
 * starts at the clock or at its own end, whichever is later. So idle accounts save up nothing, and
 * what an account received too much stays a debt. When all accounts are idle, the clock moves to
 * the last end: time that no other account wanted is no debt.
 *
 * An account that starts no later than the mean of all that want something is eligible. Of the
 * eligible ones the frame with the earliest deadline is drawn first (decide.h). Taking turns
 * instead would give most time to the client with the largest frames; deadlines alone would give it
 * to the client with the most frames. */
struct srv_fair_account { /* zeroed: received nothing yet */
    double end_ms;        /* virtual time at the end of what it received last */
};

/* Returns the virtual time at which the account's next work starts. */
double srv_fair_start(const struct srv_fair_account *account, double clock_ms);
/* Charges work that is expected to take `ms`. */
void srv_fair_charge(struct srv_fair_account *account, double clock_ms, double ms);
/* Adds the difference once the true time is known; negative if the work took less. */
void srv_fair_correct(struct srv_fair_account *account, double more_ms);

/* The starvation limit. Work of the lowest rank is cancelled whenever something more urgent comes.
 * After a wait of twenty times its expected time, or of 1 s if that is 0, it is protected:
 * returns for how many ms it may then run without being cancelled, a tenth of what it waited. So it
 * is done at last, however busy the others are, and costs them about a twentieth of their time.
 * 0 = not protected. */
double srv_fair_protected_ms(double waited_ms, double expected_ms);

#endif
