// SPDX-License-Identifier: Apache-2.0
// Edits: what a clip removes as cuts, and the range of values of the part at a place.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { boxEdit, canAddEdits, changeEdit, editsOfClip, isSameEdits, planeEdit, rangeAround, rangeOfPart, removeEdit } from '../../../clients/web/core/edits.js';

const color = [1, 1, 1];
// Transparent below 50, a peak at 100, transparent at 150, opaque from 200.
const POINTS = [[0, 0], [50, 0], [100, 0.4], [150, 0], [200, 0.8], [255, 0.8]].map(([value, opacity]) => ({ value, opacity, color }));
const RANGE = [0, 255];

test('the range around a value ends where the opacity does', () => {
  assert.deepEqual(rangeAround(POINTS, 100, 0.1, RANGE), [62.5, 137.5]);
  assert.deepEqual(rangeAround(POINTS, 210, 0.4, RANGE), [175, 255]);
  assert.deepEqual(rangeAround(POINTS, 55, 0.1, RANGE), [52.5, 147.5], 'fainter than that: half as opaque');
  assert.deepEqual(rangeAround(POINTS, 20, 0.05, RANGE), [20, 255], 'without opacity: all above');
  assert.deepEqual(rangeAround([{ value: 80, opacity: 0.5, color }], 10, 0.05, RANGE), RANGE);
});

test('a part on a surface has all values above; else the shell or the volume tells', () => {
  const view = (layers) => ({ transfer_function: { points: POINTS }, layers });
  const surface = { type: 'surface', visible: true, value: 90 };
  assert.deepEqual(rangeOfPart(view([{ type: 'volume', visible: false }, surface]), 90.1, RANGE), [90, 255]);
  assert.deepEqual(rangeOfPart(view([{ type: 'volume', visible: true }, surface]), 210, RANGE), rangeAround(POINTS, 210, 0.05, RANGE));
  assert.deepEqual(rangeOfPart(view([{ type: 'shell', visible: true, low: 0.2, high: 0.9 }]), 100, RANGE), [75, 125]);
  assert.deepEqual(rangeOfPart(view(undefined), 100, RANGE), rangeAround(POINTS, 100, 0.05, RANGE));
});

test('a clip becomes cuts', () => {
  const plane = { normal: [0, 0, 2], offset: 4 };
  assert.deepEqual(editsOfClip({ box: [[0, 0, 0], [1, 1, 1]], planes: [] }), []);
  assert.deepEqual(editsOfClip(undefined), []);
  const box = [[0, 0.5, 0], [1, 1, 1]];
  assert.deepEqual(editsOfClip({ box, planes: [plane] }), [{ type: 'plane', ...plane }, { type: 'box', keep: 'inside', box }]);
  assert.deepEqual(planeEdit([1, 2, 3], [0, 0, 2]), { type: 'plane', normal: [0, 0, 1], offset: 3 });
});

test('lists are the same but for rounding and defaults', () => {
  const box = boxEdit();
  assert.ok(isSameEdits([box], [{ type: 'box', box: box.box }]));
  assert.ok(!isSameEdits([box], [{ ...box, keep: 'inside' }]));
  assert.ok(!isSameEdits([box], []));
  assert.ok(isSameEdits(changeEdit([box], 0, { keep: 'outside' }), [box]));
  assert.deepEqual(removeEdit([box, 7], 0), [7]);
  assert.deepEqual([canAddEdits(Array(32).fill(box)), canAddEdits(Array(30).fill(box), 2)], [false, true]);
});
