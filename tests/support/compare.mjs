// SPDX-License-Identifier: Apache-2.0
// An assertion on numbers that prints both values.
import assert from 'node:assert/strict';

const HOLDS = {
  '<': (a, b) => a < b,
  '<=': (a, b) => a <= b,
  '>': (a, b) => a > b,
  '>=': (a, b) => a >= b,
};

/** Asserts `actual OPERATOR bound`, for example compare(bytes, '<=', 2048). `what` explains the values. NaN always fails. */
export function compare(actual, operator, bound, what = '') {
  if (!HOLDS[operator](actual, bound)) {
    assert.fail(`${what && `${what}: `}${actual} ${operator} ${bound} is false`);
  }
}
