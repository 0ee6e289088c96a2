// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import test from 'node:test';
import { meanAbove } from '../../../clients/web/core/histogram.js';
import { dragWindow, isProjection, isShownAlike, projectionWindow, shownAs } from '../../../clients/web/core/projection.js';

const view = (compositing) => ({ compositing });

// One sample at each of 1, 3, 5 and 7.
const histogram = { range: [0, 8], counts: [1, 1, 1, 1], windows: { maximum: { center: 5, width: 6 }, minimum: { center: 5, width: 6 }, sum: { center: 40, width: 80 } } };

test('the window of a projection is set, or the automatic one of the daemon', () => {
  assert.equal(isProjection(view({ mode: 'sheet' })), false);
  assert.equal(projectionWindow(view({ mode: 'sheet' }), histogram), null);
  assert.deepEqual(projectionWindow(view({ mode: 'maximum', window: { center: null, width: null } }), histogram), { level: 5, width: 6 });
  assert.deepEqual(projectionWindow(view({ mode: 'maximum', window: { center: 2, width: null } }), histogram), { level: 2, width: 6 });
  assert.deepEqual(projectionWindow(view({ mode: 'minimum', window: { center: 5, width: 2 } }), null), { level: 5, width: 2 });
  assert.equal(projectionWindow(view({ mode: 'minimum' }), null), null, 'without a histogram nothing tells it');
  assert.deepEqual(projectionWindow(view({ mode: 'sum' }), histogram), { level: 40, width: 80 });
  assert.deepEqual(projectionWindow(view({ mode: 'sum', absorption: 2e-5 }), null), { level: 0.5, width: 1 });
  assert.equal(projectionWindow(view({ mode: 'mean', colors: 'transfer_function' }), histogram), null);
});

test('the automatic window of a sum follows its zero', () => {
  assert.equal(meanAbove(histogram, 4), Math.sqrt((1 + 9) / 4));
  assert.equal(meanAbove(histogram, 0), Math.sqrt((9 + 25 + 49) / 4), 'samples of the smallest value are zero');
  const { level, width } = projectionWindow(view({ mode: 'sum', zero: 4 }), histogram);
  assert.equal(level * 2, width);
  assert.ok(Math.abs(width - 80 * Math.sqrt(10 / 83)) < 1e-12, `${width}`);
  assert.deepEqual(projectionWindow(view({ mode: 'sum', zero: 9 }), histogram), { level: 0, width: 1 });
});

test('what undo restores: the mode and the window', () => {
  assert.deepEqual(shownAs({}), { mode: 'sheet', center: null, width: null });
  const shown = shownAs(view({ mode: 'mean', window: { center: 1, width: 2 } }));
  assert.deepEqual(shown, { mode: 'mean', center: 1, width: 2 });
  assert.ok(isShownAlike(shown, { ...shown }));
  for (const change of [{ mode: 'sum' }, { center: 2 }, { width: null }]) assert.ok(!isShownAlike(shown, { ...shown, ...change }));
});

test('a drag widens and raises the window', () => {
  const { level, width } = dragWindow({ level: 10, width: 4 }, Math.log(2), 0.5);
  assert.equal(level, 12);
  assert.ok(Math.abs(width - 8) < 1e-12, `${width}`);
});
