// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import test from 'node:test';
import { dragWindow, isProjection, projectionWindow, windowPatch } from '../../../clients/web/core/projection.js';

const view = (compositing) => ({ compositing });

test('the window of a projection is set, or told from the range of the values', () => {
  assert.equal(isProjection(view({ mode: 'sheet' })), false);
  assert.equal(projectionWindow(view({ mode: 'sheet' }), [0, 255]), null);
  assert.deepEqual(projectionWindow(view({ mode: 'maximum', window: { center: null, width: null } }), [0, 200]), { level: 100, width: 200 });
  assert.deepEqual(projectionWindow(view({ mode: 'minimum', window: { center: 5, width: 2 } }), [0, 200]), { level: 5, width: 2 });
  assert.deepEqual(projectionWindow(view({ mode: 'sum', absorption: 2e-5 }), [0, 200]), { level: 0.5, width: 1 });
  assert.equal(projectionWindow(view({ mode: 'sum' }), [0, 200]), null, 'only the daemon knows it');
  assert.equal(projectionWindow(view({ mode: 'mean', colors: 'transfer_function' }), [0, 200]), null);
});

test('a drag widens and raises the window', () => {
  const { level, width } = dragWindow({ level: 10, width: 4 }, Math.log(2), 0.5);
  assert.equal(level, 12);
  assert.ok(Math.abs(width - 8) < 1e-12, `${width}`);
  assert.deepEqual(windowPatch({ level: 1, width: 2 }), { compositing: { window: { center: 1, width: 2 } } });
});
