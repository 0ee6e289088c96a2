// SPDX-License-Identifier: Apache-2.0
// Maps the position of a slider in [0,1] to a value and back: `at` gives the value of a position, `of` the position of a value.

const hold = (t) => Math.min(1, Math.max(0, t));
/** Rounds to three digits, the precision of a hand. */
const round = (value) => Number(value.toPrecision(3));

/** Equal steps give equal factors; 0 < low < high. */
export const logarithmic = (low, high) => ({
  at: (t) => round(low * (high / low) ** hold(t)),
  of: (value) => hold(Math.log(value / low) / Math.log(high / low)),
});

/** From 0 to high, with finer steps towards 0. */
export const quadratic = (high) => ({
  at: (t) => round(high * hold(t) ** 2),
  of: (value) => (high > 0 ? hold(Math.sqrt(value / high)) : 0),
});
