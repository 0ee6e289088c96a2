// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { detailPercent } from '../../../clients/web/core/detail.js';

const frame = (width, height, isFinal = false) => ({ width, height, isFinal });

test('detail is what is left along a side, of the size and of the voxels', () => {
  assert.equal(detailPercent(frame(800, 600), [800, 600]), 100);
  assert.equal(detailPercent(frame(400, 300), [800, 600]), 50);
  assert.equal(detailPercent(frame(800, 600), [800, 600], 1), 50);
  assert.equal(detailPercent(frame(400, 300), [800, 600], 2), 13);
  assert.equal(detailPercent(frame(1, 1), [8192, 8192], 2), 1, 'never nothing');
});

test('a final picture has all of it, whatever older numbers say', () => {
  assert.equal(detailPercent(frame(800, 600, true), [800, 600], 2), 100);
  assert.equal(detailPercent(frame(700, 500, true), [800, 600]), 100, 'the window has grown since');
});

test('a picture larger than what is wanted now has no more than all', () => {
  assert.equal(detailPercent(frame(800, 600), [400, 300]), 100);
});
