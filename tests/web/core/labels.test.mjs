// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { placeLabels } from '../../../clients/web/core/labels.js';
import { compare } from '../../support/compare.mjs';

const label = (x, y, [width, height] = [120, 20]) => ({ wanted: { x, y }, size: [width, height], anchors: [{ x, y: y + 18 }] });

/** Pairs of placed labels that cover each other. */
const overlaps = (places, labels) => places.flatMap((a, i) => places.slice(i + 1).flatMap((b, j) => {
  if (!a || !b) return [];
  const [first, second] = [labels[i].size, labels[i + 1 + j].size];
  const isOver = Math.abs(a.x - b.x) < (first[0] + second[0]) / 2 && Math.abs(a.y - b.y) < (first[1] + second[1]) / 2;
  return isOver ? [[i, i + 1 + j]] : [];
}));

test('a label alone stays where it is wanted, but inside the picture', () => {
  assert.deepEqual(placeLabels([label(200, 100)], [400, 300]), [{ x: 200, y: 100, leader: null }]);
  const [{ x, y }] = placeLabels([label(395, 4)], [400, 300]);
  assert.deepEqual([x, y], [338, 12]);
});

test('labels at one place move apart, nearest first, with a line from what they name to their border', () => {
  const labels = Array.from({ length: 20 }, () => label(300, 200));
  const places = placeLabels(labels, [600, 400]);
  assert.equal(places.filter(Boolean).length, 20);
  assert.deepEqual(overlaps(places, labels), []);
  for (const { x, y } of places) {
    compare(x, '>=', 62);
    compare(y, '>=', 12);
  }
  const far = places.map(({ x, y }) => Math.hypot((x - 300) * 0.8, y - 200));
  for (let i = 1; i < far.length; i += 1) compare(far[i], '>=', far[i - 1] - 0.31);
  for (const { x, y, leader } of places.slice(1)) {
    assert.deepEqual(leader.from, { x: 300, y: 218 });
    const touches = Math.max(Math.abs(leader.to.x - x) / 60, Math.abs(leader.to.y - y) / 10);
    compare(touches, '<=', 1 + 1e-9);
  }
});

test('a label moves off the lines if there is space, and else covers them', () => {
  const line = Array.from({ length: 13 }, (_, i) => ({ x: 140 + 10 * i, y: 100 }));
  const [place] = placeLabels([label(200, 100)], [400, 300], line);
  compare(Math.abs(place.y - 100), '>=', 10 + 3 + 2);
  compare(Math.abs(place.y - 100), '<=', 27);
  const all = Array.from({ length: 41 * 31 }, (_, i) => ({ x: 10 * (i % 41), y: 10 * Math.floor(i / 41) }));
  assert.deepEqual(placeLabels([label(200, 100)], [400, 300], all), [{ x: 200, y: 100, leader: null }]);
});

test('a label leaves what lies above the picture, with a line to what it names, and has no place deep below it', () => {
  const panel = { x: 150, y: 150, width: 300, height: 300 };
  const [beside, below, free] = placeLabels([label(280, 100), label(20, 200), label(450, 150)], [600, 300], [], [panel]);
  compare(beside.x - 60, '>=', 300);
  assert.deepEqual(beside.leader.from, { x: 280, y: 118 });
  assert.equal(below, null);
  assert.deepEqual(free, { x: 450, y: 150, leader: null });
});

test('a label without a free place near enough is left out, and the others stay', () => {
  const labels = Array.from({ length: 30 }, () => label(100, 60, [180, 24]));
  const places = placeLabels(labels, [200, 120]);
  assert.equal(places.filter(Boolean).length, 3);
  assert.deepEqual(overlaps(places, labels), []);
});
