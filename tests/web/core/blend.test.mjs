// SPDX-License-Identifier: Apache-2.0
// Properties that images do not show; frames.test.mjs compares the rest with the daemon.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { blendViews } from '../../../clients/web/core/blend.js';
import { defaultView } from '../support/mock-daemon.mjs';
import { close } from '../support/numbers.mjs';

const A = defaultView('phantom');
const B = {
  ...A, camera: { ...A.camera, position: [331.5, 31.5, 31], near: 10 }, filter: { ...A.filter, c_min: 0.5, c_max: 0.9, mode: 'ewa' },
  background: [1, 1, 1, 1],
};

test('at the ends the blended view equals a and b, with the size of a', () => {
  assert.deepEqual(blendViews(A, B, 0), A);
  assert.deepEqual(blendViews(A, { ...B, size: [9, 9] }, 1), B);
});

test('a name, and a threshold whose counterpart is automatic, change only at b', () => {
  const { filter, background, size } = blendViews(A, B, 0.75);
  assert.deepEqual(filter, A.filter);
  assert.deepEqual([background, size], [[0.75, 0.75, 0.75, 1], A.size]);
  const both = blendViews({ ...A, filter: { ...A.filter, c_max: 0.7 } }, B, 0.5).filter;
  close([both.c_min, both.c_max], [(A.filter.c_min + 0.5) / 2, 0.8], 1e-12);
});

test('the window of a projection is blended within one mode and unit', () => {
  const sum = { mode: 'sum', slab: 1, colors: 'grey', window: { center: 2, width: 8 }, zero: -10, absorption: null };
  const end = { ...sum, window: { center: 4, width: 4 }, zero: 10 };
  const blended = (a, b) => blendViews({ ...A, compositing: a }, { ...A, compositing: b }, 0.25).compositing;
  assert.deepEqual(blended(sum, end), { ...sum, window: { center: 2.5, width: 7 }, zero: -5 });
  assert.deepEqual(blended(sum, { ...end, mode: 'mean', slab: 3 }), { ...sum, slab: 1.5 });
  assert.deepEqual(blended(sum, { ...end, absorption: 2 }), { ...sum, zero: -5 });
  assert.deepEqual(blended({ ...sum, absorption: 1 }, { ...end, absorption: 3 }), { ...sum, window: { center: 2.5, width: 7 }, zero: -5, absorption: 1.5 });
  assert.deepEqual(blended(sum, { ...end, zero: null, window: { center: null, width: 4 } }), { ...sum, window: { center: 2, width: 7 } });
});

test('the camera moves on an arc; near plane and distance change by constant ratios', () => {
  const { camera } = blendViews(A, B, 0.5);
  const [from, to] = [300 - 31, 300];
  const distance = Math.sqrt(from * to);
  close([camera.near], [1], 1e-12);
  close(camera.position, [31.5 + distance * Math.SQRT1_2, 31.5, 31 + distance * Math.SQRT1_2], 1e-9);
  close(camera.up, [0, 1, 0], 1e-12);
});
