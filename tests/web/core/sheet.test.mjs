// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { settle } from '../../../clients/web/core/sheet.js';

const HEIGHTS = [60, 400, 760];

test('a short swipe goes to the next height', () => {
  assert.equal(settle(HEIGHTS, 0, 90), 1);
  assert.equal(settle(HEIGHTS, 1, 430), 2);
  assert.equal(settle(HEIGHTS, 1, 370), 0);
  assert.equal(settle(HEIGHTS, 2, 730), 1);
});

test('a long drag goes to the nearest height in its direction', () => {
  assert.equal(settle(HEIGHTS, 0, 700), 2);
  assert.equal(settle(HEIGHTS, 0, 500), 1);
  assert.equal(settle(HEIGHTS, 2, 100), 0);
  assert.equal(settle(HEIGHTS, 2, 300), 1);
});

test('a tremor changes nothing, and neither does a drag beyond the ends', () => {
  assert.equal(settle(HEIGHTS, 1, 410), 1);
  assert.equal(settle(HEIGHTS, 1, 390), 1);
  assert.equal(settle(HEIGHTS, 2, 900), 2);
  assert.equal(settle(HEIGHTS, 0, 10), 0);
});
