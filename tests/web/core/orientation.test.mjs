// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import {
  VIEWS, anatomyOf, anglesOf, frameOf, letterOf, orientationFrom, orientationOf, turnBetween, turnUpright, viewDirection,
} from '../../../clients/web/core/orientation.js';
import { cross, dot, rotate } from '../../../clients/web/core/vector.js';
import { compare } from '../../support/compare.mjs';
import { close, random, unitQuaternion } from '../support/numbers.mjs';

const LPS = ['L', 'P', 'S'];
const backOf = (q) => rotate(q, [0, 0, 1]);
const upOf = (q) => rotate(q, [0, 1, 0]);
const rightOf = (q) => rotate(q, [1, 0, 0]);

/** A rotation equals its negative. */
const sameRotation = (a, b, tolerance = 1e-9) => {
  const cosine = Math.abs(a.reduce((sum, part, i) => sum + part * b[i], 0));
  compare(1 - cosine, '<', tolerance);
};

test('anatomy needs three letters of three different pairs', () => {
  assert.deepEqual(anatomyOf({ anatomy: LPS }), LPS);
  for (const anatomy of [undefined, null, [], ['L', 'P'], ['L', 'R', 'S'], ['L', 'P', 'X'], 'LPS!']) assert.equal(anatomyOf({ anatomy }), null);
  assert.equal(anatomyOf(null), null);
  assert.equal(letterOf(LPS, 0, 1), 'L');
  assert.equal(letterOf(LPS, 0, -1), 'R');
  assert.equal(letterOf(LPS, 1, -1), 'A');
  assert.equal(letterOf(LPS, 2, -1), 'I');
});

test('a vector keeps its anatomical direction from world to world', () => {
  assert.deepEqual(turnBetween(LPS, ['R', 'A', 'S'])([1, 2, 3]), [-1, -2, 3]);
  assert.deepEqual(turnBetween(LPS, ['S', 'L', 'P'])([1, 2, 3]), [3, 1, 2]);
  assert.deepEqual(turnBetween(['S', 'R', 'P'], LPS)(turnBetween(LPS, ['S', 'R', 'P'])([1, 2, 3])), [1, 2, 3]);
  assert.deepEqual(turnBetween(LPS, ['R', 'A', 'S'])([0, 0, 0]), [0, 0, 0], 'no -0');
  assert.deepEqual([turnBetween(null, LPS)([1, 2, 3]), turnBetween(LPS, null)([1, 2, 3])], [[1, 2, 3], [1, 2, 3]]);
});

test('the front view of a patient shows the left side to the right, the head up', () => {
  const frame = frameOf(LPS);
  const front = orientationFrom(frame, viewDirection(frame, 'front'));
  close(backOf(front), [0, -1, 0]);
  close(upOf(front), [0, 0, 1]);
  close(rightOf(front), [1, 0, 0]);
  assert.deepEqual(viewDirection(frame, 'left'), [1, 0, 0]);
  // Seen from above and from below, the front of the patient is up.
  for (const name of ['top', 'bottom']) close(upOf(orientationFrom(frame, viewDirection(frame, name))), [0, -1, 0]);
});

test('the axes of the world may point in any anatomical directions', () => {
  const frame = frameOf(['S', 'R', 'A']);
  assert.deepEqual([frame.up, frame.left, frame.front], [[1, 0, 0], [0, -1, 0], [0, 0, 1]]);
  assert.deepEqual(viewDirection(frame, 'right').map((x) => x + 0), [0, 1, 0]);
});

test('without anatomy the default camera tells top and front; without a camera z is up and -y the front', () => {
  const plain = frameOf(null);
  assert.deepEqual([plain.front, plain.up, plain.side], [[0, -1, 0], [0, 0, 1], [1, 0, 0]]);
  assert.deepEqual(viewDirection(plain, 'right'), [1, 0, 0]);
  const frame = frameOf(null, { position: [40, 20, -90], target: [0, 0, 0], up: [0.1, -1, 0] });
  assert.deepEqual(frame.up.map((x) => x + 0), [0, -1, 0]);
  assert.deepEqual(frame.front.map((x) => x + 0), [0, 0, -1]);
  const above = frameOf(null, { position: [0, 0, 9], target: [0, 0, 0], up: [0, 0, 1] });
  compare(Math.abs(dot(above.front, above.up)), '<', 1e-12);
});

test('every standard view is upright and looks along its direction', () => {
  for (const frame of [frameOf(LPS), frameOf(['R', 'A', 'S']), frameOf(null)]) {
    for (const name of VIEWS) {
      const q = orientationFrom(frame, viewDirection(frame, name));
      close(backOf(q), viewDirection(frame, name), 1e-12);
      compare(dot(upOf(q), frame.up), '>=', -1e-12);
      close(cross(rightOf(q), upOf(q)), backOf(q), 1e-12);
    }
  }
});

test('angles of the standard views', () => {
  const frame = frameOf(null);
  const angles = (name) => anglesOf(frame, orientationFrom(frame, viewDirection(frame, name)));
  const expected = { front: [0, 0], right: [90, 0], back: [180, 0], left: [-90, 0], top: [0, 90], bottom: [0, -90], isometric: [45, 35.26438968] };
  for (const [name, [azimuth, elevation]] of Object.entries(expected)) {
    const found = angles(name);
    close([Math.abs(found.azimuth), found.elevation, found.roll], [Math.abs(azimuth), elevation, 0], 1e-6);
    if (azimuth !== 180) close([found.azimuth], [azimuth], 1e-6);
  }
});

test('angles give the same orientation back', () => {
  const next = random(11);
  for (const frame of [frameOf(LPS), frameOf(null)]) {
    for (let i = 0; i < 100; i += 1) {
      const q = unitQuaternion(next);
      const angles = anglesOf(frame, q);
      compare(Math.abs(angles.roll), '<=', 180);
      sameRotation(orientationOf(frame, angles), q);
    }
    for (const elevation of [-90, 90]) {
      const q = orientationOf(frame, { azimuth: 37, elevation, roll: 20 });
      sameRotation(orientationOf(frame, anglesOf(frame, q)), q, 1e-8);
    }
  }
});

test('a turntable keeps the up axis upright for any turn and stops at the poles', () => {
  const frame = frameOf(null);
  const next = random(5);
  let q = orientationOf(frame, { azimuth: 20, elevation: 10, roll: 30 });
  for (let i = 0; i < 200; i += 1) {
    q = turnUpright(frame, q, next() * 2, next());
    compare(Math.abs(dot(rightOf(q), frame.up)), '<', 1e-6, 'the horizon is level');
    compare(dot(upOf(q), frame.up), '>=', -1e-6, 'never upside down');
  }
  const top = turnUpright(frame, q, 0, -9);
  close(backOf(top), frame.up, 1e-9);
  const azimuth = anglesOf(frame, q).azimuth;
  compare(Math.abs(anglesOf(frame, turnUpright(frame, top, 0, 0.5)).azimuth - azimuth), '<', 1e-6, 'the pole keeps the azimuth');
});
