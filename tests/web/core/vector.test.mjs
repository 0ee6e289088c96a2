// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import {
  axisAngle, conjugate, cross, dot, fromAxes, IDENTITY, multiply, normalize, normalizeQuaternion, rotate,
} from '../../../clients/web/core/vector.js';
import { compare } from '../../support/compare.mjs';
import { close, random, unitQuaternion } from '../support/numbers.mjs';

test('a quaternion rotates about its axis by its angle, right-handed', () => {
  close(rotate(axisAngle([0, 0, 1], Math.PI / 2), [1, 0, 0]), [0, 1, 0]);
  close(rotate(axisAngle([1, 0, 0], Math.PI / 2), [0, 1, 0]), [0, 0, 1]);
  close(rotate(IDENTITY, [1, 2, 3]), [1, 2, 3]);
});

test('multiply composes rotations and applies the right factor first', () => {
  const next = random(1);
  for (let i = 0; i < 100; i += 1) {
    const [a, b] = [unitQuaternion(next), unitQuaternion(next)];
    const v = [next(), next(), next()];
    close(rotate(multiply(a, b), v), rotate(a, rotate(b, v)));
    close(rotate(conjugate(a), rotate(a, v)), v);
  }
});

test('fromAxes inverts rotate, for every branch of the conversion', () => {
  const turns = [IDENTITY, ...[[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis) => axisAngle(axis, Math.PI * 0.99))];
  const next = random(2);
  for (let i = 0; i < 200; i += 1) turns.push(unitQuaternion(next));
  for (const q of turns) {
    const axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((v) => rotate(q, v));
    const back = fromAxes(...axes);
    compare(Math.abs(Math.abs(dot(q, back) + q[3] * back[3]) - 1), '<', 1e-12);
  }
});

test('vectors without a direction are refused', () => {
  assert.throws(() => normalize([0, 0, 0]), RangeError);
  assert.throws(() => normalize([NaN, 0, 0]), RangeError);
  assert.throws(() => normalize(cross([1, 0, 0], [2, 0, 0])), RangeError);
  assert.throws(() => normalizeQuaternion([0, 0, 0, 0]), RangeError);
});
