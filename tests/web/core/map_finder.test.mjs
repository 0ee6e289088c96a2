// SPDX-License-Identifier: Apache-2.0
// Each participant finds the colour map in the points that the daemon stores.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { MAP_NAMES, stopsOf } from '../../../clients/web/core/color_maps.js';
import { findMap, withoutMap } from '../../../clients/web/core/map_finder.js';
import { leastGap, merge, tidy } from '../../../clients/web/core/transfer.js';
import { compare } from '../../support/compare.mjs';

const GAP = leastGap([0, 255]);
const OWN = [[34.375, 0], [57.344, 0.18], [86.875, 0.3], [100, 0.4], [133.2, 0.5], [166.41, 0.38], [200, 0.259]]
  .map(([value, opacity]) => ({ value, opacity, color: [1, 0, 0] }));
const stored = (map) => tidy(merge(OWN, stopsOf(map), map.range, GAP));

test('every map is found, reversed or in steps, over any range, with the points of the opacity', () => {
  for (const name of MAP_NAMES) {
    for (const isReversed of [false, true]) {
      for (const steps of [0, 2, 8]) {
        for (const range of [[34.375, 200], [0, 255], [60, 90.5], [-1000, 3000]]) {
          const { points, map } = findMap(stored({ name, isReversed, steps, range }), GAP);
          assert.deepEqual([map.name, map.isReversed, map.steps, map.table], [name, isReversed, steps, null]);
          range.forEach((end, i) => compare(Math.abs(map.range[i] - end), '<=', 1e-6 * Math.abs(end)));
          assert.deepEqual(points.map(({ value, opacity }) => [value, opacity]), OWN.map(({ value, opacity }) => [value, opacity]));
        }
      }
    }
  }
});

test('colours of points are no map, even if they were one before', () => {
  const range = [34.375, 200];
  const white = [[0, 0], [255, 1]].map(([value, opacity]) => ({ value, opacity, color: [opacity, opacity, opacity] }));
  assert.equal(findMap(tidy(white), GAP), null, 'a ramp from black to white');
  assert.equal(findMap(tidy(OWN), GAP), null);
  for (const name of MAP_NAMES) {
    const points = stored({ name, range });
    assert.equal(findMap(tidy(withoutMap(points)), GAP), null, name);
    assert.equal(findMap(tidy(points.map((p, i) => (i === 1 ? { ...p, color: [0.5, 0.1, 0.7] } : p))), GAP), null, name);
    assert.equal(findMap(points.slice(1), GAP)?.map.range[0] === range[0], false, name);
  }
});
