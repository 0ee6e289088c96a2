// SPDX-License-Identifier: Apache-2.0
// Moves, turns and scales of layers, and the matrices that the daemon gets.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { IDENTITY, UNMOVED, fitPlacement, isSameMatrix, matrixOf, placementOf } from '../../../clients/web/core/placement.js';

const apply = (m, p) => [0, 4, 8].map((at) => m[at] * p[0] + m[at + 1] * p[1] + m[at + 2] * p[2] + m[at + 3]);
const near = (a, b, tolerance = 1e-9) => a.forEach((part, i) => compare(Math.abs(part - b[i]), '<=', tolerance, `${a} is not ${b}`));
const place = (change) => ({ ...UNMOVED, ...change });

test('without a change the matrix is the identity, whatever the centre', () => {
  assert.deepEqual(matrixOf(UNMOVED), [...IDENTITY]);
  near(matrixOf(UNMOVED, [100, -3, 7]), IDENTITY);
});

test('a turn about z takes x to y and keeps the centre; a scale keeps it, too', () => {
  const center = [10, 20, 30];
  const turned = matrixOf(place({ turn: [0, 0, 90] }), center);
  near(apply(turned, center), center);
  near(apply(turned, [11, 20, 30]), [10, 21, 30]);
  const larger = matrixOf(place({ scale: 3 }), center);
  near(apply(larger, center), center);
  near(apply(larger, [11, 20, 30]), [13, 20, 30]);
  near(apply(matrixOf(place({ move: [1, 2, 3] }), center), center), [11, 22, 33]);
});

test('turns apply about x, then y, then z', () => {
  near(apply(matrixOf(place({ turn: [90, 90, 0] })), [0, 1, 0]), [1, 0, 0], 1e-9); // y → z by x, then z → x by y
  near(apply(matrixOf(place({ turn: [90, 0, 90] })), [1, 0, 0]), [0, 1, 0]);
});

test('the placement of a matrix is what made it', () => {
  for (const placement of [
    UNMOVED, place({ move: [1e6, -2.5, 1e-6] }), place({ turn: [12, -34, 156], scale: 0.02 }), place({ move: [3, 4, 5], turn: [-170, 60, -90], scale: 50 }),
  ]) {
    const center = [5, -6, 7];
    const found = placementOf(matrixOf(placement, center), center);
    near(found.move, placement.move, 1e-3);
    near(found.turn, placement.turn, 1e-6);
    near([found.scale], [placement.scale], 1e-7 * placement.scale);
  }
});

test('where x and z turn about one axis, the placement gives the same matrix', () => {
  for (const y of [90, -90]) {
    const matrix = matrixOf(place({ turn: [20, y, 50] }));
    assert.ok(isSameMatrix(matrixOf(placementOf(matrix)), matrix));
  }
});

test('mirrored, sheared and unevenly scaled matrices have no placement', () => {
  const scaled = (x, y, z) => [x, 0, 0, 0, 0, y, 0, 0, 0, 0, z, 0, 0, 0, 0, 1];
  assert.equal(placementOf(scaled(-1, 1, 1)), null);
  assert.equal(placementOf(scaled(1, 2, 1)), null);
  assert.equal(placementOf([1, 0.5, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]), null);
  assert.equal(placementOf(scaled(0, 0, 0)), null);
});

test('matrices are the same but for rounding, and moves by the size of the elements', () => {
  const moved = (x) => matrixOf(place({ move: [x, 0, 0] }));
  assert.ok(isSameMatrix(moved(0), moved(1e-5), 100));
  assert.ok(!isSameMatrix(moved(0), moved(1e-5), 1));
  assert.ok(!isSameMatrix(matrixOf(place({ turn: [0.01, 0, 0] })), IDENTITY, 100));
});

test('a fitted layer lies in the other sphere', () => {
  const [from, into] = [{ center: [1, 2, 3], radius: 4 }, { center: [-10, 0, 50], radius: 100 }];
  const matrix = matrixOf(fitPlacement(from, into), from.center);
  near(apply(matrix, from.center), into.center);
  near(apply(matrix, [5, 2, 3]), [90, 0, 50], 1e-6);
  assert.equal(fitPlacement({ center: [0, 0, 0], radius: 0 }, into).scale, 1, 'a single point');
});
