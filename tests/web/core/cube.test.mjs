// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { INNER, PARTS, faceMatrix, neighbour, outlines, placeOf } from '../../../clients/web/core/cube.js';
import { VIEWS, frameOf, orientationFrom, viewDirection } from '../../../clients/web/core/orientation.js';
import { compare } from '../../support/compare.mjs';
import { close, random, unitQuaternion } from '../support/numbers.mjs';

const frame = frameOf(null);
const seen = (name) => orientationFrom(frame, viewDirection(frame, name));
const area = (points) => Math.abs(points.reduce((sum, [x, y], i) => {
  const [u, v] = points[(i + 1) % points.length];
  return sum + x * v - u * y;
}, 0)) / 2;

test('the cube has 6 faces, 12 edges and 8 corners', () => {
  const counts = [1, 2, 3].map((n) => PARTS.filter((part) => part.filter(Boolean).length === n).length);
  assert.deepEqual(counts, [6, 12, 8]);
});

test('seen from the front, one face and the strips of its edges and corners are visible, and cover it', () => {
  const q = seen('front');
  const visible = PARTS.filter((part) => outlines(part, q).length > 0);
  assert.equal(visible.length, 9);
  assert.ok(visible.every((part) => part[1] === -1));
  const total = visible.flatMap((part) => outlines(part, q)).reduce((sum, points) => sum + area(points), 0);
  close([total], [4], 1e-9);
  close([area(outlines([0, -1, 0], q)[0])], [(2 * INNER) ** 2], 1e-9);
  assert.deepEqual(outlines([0, 1, 0], q), []);
});

test('in every view the visible parts cover the silhouette once', () => {
  const next = random(2);
  for (let i = 0; i < 40; i += 1) {
    const q = unitQuaternion(next);
    const total = PARTS.flatMap((part) => outlines(part, q)).reduce((sum, points) => sum + area(points), 0);
    const silhouette = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].reduce((sum, axis) => {
      const [x, y] = placeOf(axis, q);
      return sum + 4 * Math.sqrt(Math.max(0, 1 - x * x - y * y));
    }, 0);
    close([total], [silhouette], 1e-9);
  }
});

test('the text on a face is upright and reads from left to right', () => {
  close(faceMatrix([0, -1, 0], seen('front'), frame), [1, 0, 0, 1, 0, 0]);
  close(faceMatrix([0, 0, 1], seen('top'), frame), [1, 0, 0, 1, 0, 0]);
  close(faceMatrix([0, 0, -1], seen('bottom'), frame), [1, 0, 0, 1, 0, 0]);
  assert.equal(faceMatrix([0, 1, 0], seen('front'), frame), null);
  for (const name of VIEWS) {
    for (const part of PARTS.filter((p) => p.filter(Boolean).length === 1)) {
      const m = faceMatrix(part, seen(name), frame);
      if (m) compare(m[0] * m[3] - m[1] * m[2], '>', 0, 'not mirrored');
    }
  }
});

test('for a finger, the cube has faces alone, which cover its silhouette', () => {
  const next = random(3);
  for (let i = 0; i < 20; i += 1) {
    const q = unitQuaternion(next);
    const visible = PARTS.filter((part) => outlines(part, q, 1).length > 0);
    assert.ok(visible.every((part) => part.filter(Boolean).length === 1));
    const area_ = (inner) => PARTS.flatMap((part) => outlines(part, q, inner)).reduce((sum, points) => sum + area(points), 0);
    close([area_(1)], [area_(INNER)], 1e-9);
  }
  assert.deepEqual(neighbour([0, -1, 0], [1, 0], orientationFrom(frame, [0.3, -1, 0.3]), 1), [1, 0, 0]);
});

test('arrow keys go from a part to the next one', () => {
  const q = seen('front');
  assert.deepEqual(neighbour([0, -1, 0], [1, 0], q), [1, -1, 0]);
  assert.deepEqual(neighbour([0, -1, 0], [0, -1], q), [0, -1, 1]);
  assert.deepEqual(neighbour([1, -1, 0], [0, 1], q), [1, -1, -1]);
  assert.deepEqual(neighbour([1, -1, 0], [1, 0], q), [1, -1, 0], 'nothing further');
  // From the face, every visible part can be reached.
  const all = seen('isometric');
  const reached = new Set(['0,-1,0']);
  for (const name of reached) {
    for (const way of [[1, 0], [-1, 0], [0, 1], [0, -1]]) reached.add(String(neighbour(name.split(',').map(Number), way, all)));
  }
  assert.equal(reached.size, PARTS.filter((part) => outlines(part, all).length > 0).length);
});
