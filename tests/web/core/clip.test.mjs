// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { volumeBox } from '../../../clients/web/core/camera.js';
import { WHOLE, depthOf, moveFace, planeAt, reach, sight } from '../../../clients/web/core/clip.js';
import { add, dot, rotate, scale } from '../../../clients/web/core/vector.js';
import { compare } from '../../support/compare.mjs';
import { close, random, unitQuaternion } from '../support/numbers.mjs';

test('a face moves alone until it meets the opposite face, which it then pushes', () => {
  const box = moveFace(WHOLE, 0, 1, 0.3);
  assert.deepEqual(box, [[0, 0.3, 0], [1, 1, 1]]);
  assert.deepEqual(WHOLE, [[0, 0, 0], [1, 1, 1]], 'the argument is not modified');
  assert.deepEqual(moveFace(box, 1, 1, 0.2), [[0, 0.2, 0], [1, 0.2, 1]]);
  assert.deepEqual(moveFace(moveFace(box, 1, 2, 0.5), 0, 2, 0.75), [[0, 0.3, 0.75], [1, 1, 0.75]]);
});

test('the extent of a box along a normal is that of its corners', () => {
  const next = random(3);
  for (let round = 0; round < 50; round += 1) {
    const q = unitQuaternion(next);
    const columns = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis) => rotate(q, axis));
    const direction = [0, 1, 2].map((row) => columns.map((column) => column[row]));
    const volume = { dims: [4, 7, 3], spacing: [1, 0.5, 3], origin: [next() * 9, next() * 9, next() * 9], direction };
    const normal = [next() * 5, next(), next() * 1e-3];
    const ends = [0, 1, 2, 3, 4, 5, 6, 7].map((corner) => {
      const steps = volume.dims.map((n, i) => ((corner >> i) & 1 ? n - 0.5 : -0.5) * volume.spacing[i]);
      return dot(normal, steps.reduce((p, step, i) => add(p, scale(columns[i], step)), volume.origin));
    });
    close(reach(volumeBox(volume), normal), [Math.min(...ends), Math.max(...ends)], 1e-9);
  }
});

test('a rectilinear volume ends half a sample distance beyond its samples', () => {
  const volume = { dims: [4, 3, 2], spacing: [2, 1, 5], origin: [10, 0, 0], coordinates: [[0, 1, 2, 6], null, [0, 5]] };
  const box = volumeBox(volume);
  close(reach(box, [1, 0, 0]), [9.5, 18]);
  close(reach(box, [0, 1, 0]), [-0.5, 2.5]);
  close(reach(box, [0, 0, 1]), [-2.5, 7.5]);
});

test('the depth of a plane is the fraction of the volume that it cuts away, for any length of the normal', () => {
  const box = volumeBox({ dims: [10, 20, 30], spacing: [1, 1, 2], origin: [0.5, 0.5, 1] });
  assert.deepEqual(planeAt(box, [0, 0, 1], 0.25), { normal: [0, 0, 1], offset: 15 });
  assert.deepEqual(planeAt(box, [0, 0, -10], 0.25), { normal: [0, 0, -10], offset: -450 });
  assert.equal(planeAt(box, [0, 1, 0], 0).offset, 0, 'nothing is cut');
  assert.equal(planeAt(box, [0, 1, 0], 1).offset, 20, 'everything is cut');
  for (const depth of [0, 0.3, 1]) {
    const plane = planeAt(box, [1, -2, 0.5], depth);
    compare(Math.abs(depthOf(box, plane) - depth), '<', 1e-12);
    const doubled = { normal: scale(plane.normal, 2), offset: plane.offset * 2 };
    compare(Math.abs(depthOf(box, doubled) - depth), '<', 1e-12);
  }
  assert.equal(depthOf(box, { normal: [0, 0, 1], offset: -1e308 }), 0);
  assert.equal(depthOf(box, { normal: [0, 0, 1], offset: 1e308 }), 1);
  assert.equal(depthOf(box, { normal: [0, 0, 0], offset: 0 }), 0);
});

test('a plane towards the viewer cuts the nearest part; more depth cuts farther', () => {
  const camera = { position: [5, 10, 130], target: [5, 10, 30] };
  const normal = sight(camera);
  assert.deepEqual(normal.map((x) => x + 0), [0, 0, -1]);
  const box = volumeBox({ dims: [10, 20, 30], spacing: [1, 1, 2], origin: [0.5, 0.5, 1] });
  const { offset } = planeAt(box, normal, 0.25);
  compare(dot(normal, [5, 10, 59]), '<', offset, 'the side of the viewer is cut');
  compare(dot(normal, [5, 10, 1]), '>', offset, 'the far side is not cut');
  assert.throws(() => sight({ position: [1, 1, 1], target: [1, 1, 1] }), RangeError);
});
