// SPDX-License-Identifier: Apache-2.0
// Numbers for tests: comparing arrays, and random input that is the same in every run.
import assert from 'node:assert/strict';
import { compare } from '../../support/compare.mjs';

/** Asserts that each element of `a` is within `tolerance` of the same element of `b`. */
export function close(a, b, tolerance = 1e-9) {
  assert.equal(a.length, b.length);
  a.forEach((x, i) => compare(Math.abs(x - b[i]), '<=', tolerance, `[${a}] is not [${b}], by ${x - b[i]} at ${i}`));
}

/** Returns a generator of numbers in [-1, 1), linear congruential. */
export function random(seed) {
  let state = seed >>> 0;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 31 - 1;
  };
}

/** Returns a random rotation. */
export function unitQuaternion(next) {
  for (;;) {
    const q = [next(), next(), next(), next()];
    const l = Math.hypot(...q);
    if (l > 0.1 && l <= 1) return q.map((x) => x / l);
  }
}
