/* SPDX-License-Identifier: Apache-2.0
 *
 * Equal shares of time: start-time fair queueing (Goyal, Vin and Cheng 1996). Pure functions: no
 * lock, no system clock.
 */
#ifndef SRV_COMMON_FAIR_QUEUE_H
#define SRV_COMMON_FAIR_QUEUE_H

/* The time that a session, a participant or an owner has received, in virtual time.
 *
 *   virtual clock (ms)  0      10      20      30      40      50
 *   account A           [ frame: 30 ms          ]end
 *   account B           [ 10 ms ]end [ 10 ms ]end
 *                                            ▲ clock = 20: B starts at 20, A at 30: B is next
 *
 * The clock shows how much an account has received that is never idle. An account starts at the
 * clock or at its own end, whichever is later. So an idle account saves up nothing, and an account
 * that received too much stays in debt. When all accounts are idle, the clock moves to the last
 * end: time that no other account wanted is no debt.
 *
 * Among the accounts with work, those that start no later than the mean are eligible. The eligible
 * frame with the earliest deadline is drawn first (decide.h). A round robin would give most time to
 * the client with the largest frames, and deadlines alone to the client with the most frames. */
struct srv_fair_account { /* zeroed: received nothing yet */
    double end_ms;        /* virtual time at which its last work ended */
};

/* Returns the virtual time at which the account's next work starts. */
double srv_fair_start(const struct srv_fair_account *account, double clock_ms);
/* Charges work that is expected to take `ms`. */
void srv_fair_charge(struct srv_fair_account *account, double clock_ms, double ms);
/* Adds the difference once the true time is known; negative if the work took less. */
void srv_fair_correct(struct srv_fair_account *account, double more_ms);

/* Time that was used recently. Time that was used half a second ago counts one third. */
struct srv_fair_use { /* zeroed: none */
    double ms;        /* used time, as of at_ms */
    double at_ms;
};

/* Adds time that was used up to now_ms; negative corrects an earlier call. */
void srv_fair_add_use(struct srv_fair_use *use, double ms, double now_ms);
/* Returns the part of the last half second that was used; >= 0, more than 1 if work runs side by
 * side. */
double srv_fair_used_portion(const struct srv_fair_use *use, double now_ms);

/* The starvation limit. More urgent work cancels work of the lowest rank. After a wait of twenty
 * times its expected time (1 s if that is 0), the work is protected: it may run for a tenth of its
 * wait without being cancelled. So it ends even if the others are always busy, and costs them about
 * a twentieth of their time. Returns the protected time in ms; 0 = not protected. */
double srv_fair_protected_ms(double waited_ms, double expected_ms);

#endif
