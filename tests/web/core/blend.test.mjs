// SPDX-License-Identifier: Apache-2.0
// Properties that images do not show; frames.test.mjs compares the rest with the daemon.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { blendViews } from '../../../clients/web/core/blend.js';
import { UNMOVED, matrixOf } from '../../../clients/web/core/placement.js';
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

test('smoothing is blended between two numbers; an automatic one changes only at b', () => {
  const blended = (from, to, u) => blendViews({ ...A, shading: { smoothing: from } }, { ...A, shading: { smoothing: to } }, u).shading.smoothing;
  assert.equal(blended(0, 1, 0.25), 0.25);
  assert.equal(blended(null, 1, 0.75), null);
  assert.equal(blended(0.5, null, 0.75), 0.5);
  assert.equal(blended(null, 1, 1), 1);
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

test('a layer that turns about its middle stays there; a mirrored one waits for b', () => {
  const middle = [40, -3, 8];
  const layer = (change) => ({ type: 'geometry', visible: true, id: '', transform: matrixOf({ ...UNMOVED, ...change }, middle), color: [1, 0, 0], opacity: 1, colors: 'own' });
  const at = (a, b, u) => blendViews({ ...A, layers: [a] }, { ...A, layers: [b] }, u).layers[0];
  const still = layer({});
  for (const [change, half] of [
    [{ turn: [0, 0, 90] }, { turn: [0, 0, 45] }], [{ turn: [-170, 0, 0] }, { turn: [-85, 0, 0] }], [{ scale: 16 }, { scale: 4 }], [{ move: [2, 4, 6] }, { move: [1, 2, 3] }],
    [{ turn: [0, 120, 0], scale: 0.25 }, { turn: [0, 60, 0], scale: 0.5 }],
  ]) close(at(still, layer(change), 0.5).transform, layer(half).transform, 1e-9);
  const mirrored = { ...still, transform: still.transform.map((part, i) => (i === 0 ? -part : part)) };
  assert.deepEqual(at(still, mirrored, 0.9).transform, still.transform);
  assert.deepEqual(at(still, { ...still, opacity: 0.5, color: [0, 0, 1], colors: 'layer' }, 0.5), { ...still, opacity: 0.75, color: [0.5, 0, 0.5] });
});
