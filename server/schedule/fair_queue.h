/* SPDX-License-Identifier: Apache-2.0
 *
 * Equal shares of time (start-time fair queueing: Goyal, Vin and Cheng 1996).
 *
 *   clock   what each of those who always want something has got, ms
 *   start   who wants something starts from the clock, or from where its last one ended, whichever
 *           is later: nobody saves up a share by wanting nothing, and a debt stays until all
 *           rest: then the clock moves on to the last end
 *   next    who starts no later than the mean of those who want something is entitled; of them the
 *           one whose frame is due first (earliest eligible deadline first)
 *
 * Turns instead of shares would give most to who asks for the largest pictures; deadlines alone, to
 * who asks for the most frames.
 *
 * Pure: no lock, no clock of the world.
 */
#ifndef SRV_SESSION_SHARE_H
#define SRV_SESSION_SHARE_H

struct srv_fair_account { /* zero = got nothing yet */
    double end_ms;        /* of what it got last, by the clock of its peers */
};

/* Where it starts. */
double srv_fair_start(const struct srv_fair_account *share, double clock_ms);
/* It gets something that is expected to take ms. */
void srv_fair_charge(struct srv_fair_account *share, double clock_ms, double ms);
/* What it got took so much more than expected; less than 0 = less. */
void srv_fair_correct(struct srv_fair_account *share, double more_ms);

/* What is expected to take expected_ms (0 = not known) gives way to what comes first, again and
 * again, for twenty times as long. Then it does not, for the time that is returned, a tenth of what
 * it waited: so it is done some day, however busy the others are, and costs them about a twentieth
 * of their time. 0 = it still gives way at once. */
double srv_fair_protected_ms(double waited_ms, double expected_ms);

#endif
