// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { detailPercent, shortageOf } from '../../../clients/web/core/detail.js';

const frame = (width, height, isFinal = false) => ({ width, height, isFinal });

test('detail is the remaining resolution along a side, of the image and of the voxels', () => {
  assert.equal(detailPercent(frame(800, 600), [800, 600]), 100);
  assert.equal(detailPercent(frame(400, 300), [800, 600]), 50);
  assert.equal(detailPercent(frame(800, 600), [800, 600], 1), 50);
  assert.equal(detailPercent(frame(400, 300), [800, 600], 2), 13);
  assert.equal(detailPercent(frame(1, 1), [8192, 8192], 2), 1, 'at least 1 %');
});

test('a final frame has full detail, whatever earlier values were', () => {
  assert.equal(detailPercent(frame(800, 600, true), [800, 600], 2), 100);
  assert.equal(detailPercent(frame(700, 500, true), [800, 600]), 100, 'the window has grown since that frame');
});

test('a frame larger than the current request has at most 100 %', () => {
  assert.equal(detailPercent(frame(800, 600), [400, 300]), 100);
});

test('a screen with more pixels than the page requests never has full detail', () => {
  assert.equal(detailPercent(frame(2048, 1152, true), [2048, 1152], 0, [3840, 2160]), 53);
  assert.equal(detailPercent(frame(1024, 576), [2048, 1152], 1, [3840, 2160]), 13);
});

test('a frame of coarse bricks has less detail, and says why', () => {
  const bricks = { level: 3, asked: 1, lost: 0 };
  const coarse = { ...frame(800, 600, true), isIncomplete: true };
  assert.equal(detailPercent(coarse, [800, 600], 0, [800, 600], bricks), 25);
  assert.equal(detailPercent(frame(800, 600, true), [800, 600], 0, [800, 600], bricks), 100, 'the numbers are of an older frame');
  assert.equal(shortageOf(coarse, bricks), 'memory');
  assert.equal(shortageOf({ ...coarse, isFinal: false }, bricks), 'reading');
  assert.equal(shortageOf(coarse, { ...bricks, lost: 2 }), 'holes');
  assert.equal(shortageOf(frame(800, 600, true), bricks), null);
  assert.equal(shortageOf(coarse, undefined), null);
});
