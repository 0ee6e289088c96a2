// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import {
  VEIL, addElements, addShell, addSurface, addVectors, canAdd, changeLayer, hasVectors, isOfElements, isSameLayers, layersOf, moveThreshold, numberOf, removeLayer, showVolume, showsVolume, surfaceValue, withoutPhase,
} from '../../../clients/web/core/layers.js';
import { compare } from '../../support/compare.mjs';

const VOLUME = [{ type: 'volume', visible: true }];
const surfaceOf = (value, more = {}) => ({ type: 'surface', visible: true, value, color: [0.9, 0.85, 0.75], opacity: 1, flatness: 'inf', ...more });

/** A histogram of [0, 256) with a peak of three bins at each of the values, the first one a thousand times as high. */
const histogramOf = (...peaks) => ({
  range: [0, 256], counts: Array.from({ length: 256 }, (_, i) => {
    const at = peaks.findIndex((peak) => Math.abs(peak - i) <= 1);
    return at < 0 ? 0 : at === 0 ? 1e6 : 1000;
  }),
});

test('a view without layers shows the volume', () => {
  assert.deepEqual(layersOf({}), VOLUME);
  assert.deepEqual(layersOf(null), VOLUME);
  assert.equal(showsVolume(VOLUME), true);
  assert.equal(showsVolume([{ type: 'volume' }]), true, 'visible is the default');
  assert.equal(showsVolume([surfaceOf(3)]), false);
});

test('the first layer takes the place of the volume, and removing the last one brings it back', () => {
  const one = addSurface(VOLUME, 100);
  assert.deepEqual(one, [{ type: 'volume', visible: false }, surfaceOf(100)]);
  assert.deepEqual(removeLayer(one, 1), VOLUME);
  const both = showVolume(one, true);
  assert.deepEqual(addSurface(both, 50)[0], { type: 'volume', visible: true }, 'a volume that was shown beside others stays');
  assert.deepEqual(showVolume([surfaceOf(3)], true), [...VOLUME, surfaceOf(3)]);
  assert.deepEqual(showVolume([surfaceOf(3)], false), [surfaceOf(3)]);
  assert.deepEqual(removeLayer([surfaceOf(3)], 0), VOLUME, 'a view has a layer');
  assert.deepEqual(removeLayer([surfaceOf(3), surfaceOf(4)], 0), [surfaceOf(4)]);
});

test('surfaces get colours of their own, and those around become a veil', () => {
  const two = addSurface(addSurface(VOLUME, 100), 200);
  assert.equal(two[1].opacity, VEIL, 'an opaque surface would hide the one inside');
  assert.equal(two[2].opacity, 1);
  assert.notDeepEqual(two[1].color, two[2].color);
  const kept = addSurface(changeLayer(two, 1, { opacity: 0.8 }), 300);
  assert.equal(kept[1].opacity, 0.8, 'what the user chose stays');
  assert.equal(kept[2].opacity, VEIL);
  const around = addSurface(addSurface(VOLUME, 100), 50);
  assert.deepEqual(around.slice(1).map(({ opacity }) => opacity), [1, VEIL]);
  const seven = [1, 2, 3, 4, 5, 6, 7].reduce(addSurface, VOLUME);
  assert.equal(new Set(seven.slice(1).map(({ color }) => String(color))).size, 7);
  assert.equal(canAdd(seven, 'surface'), false, 'eight layers');
  assert.equal(canAdd(removeLayer(seven, 7), 'surface'), true);
  assert.deepEqual([1, 2, 3].map((i) => numberOf(seven, i)), [1, 2, 3]);
});

test('there is one shell, whose thresholds fit the transfer function and keep their order', () => {
  const points = [{ value: 0, opacity: 0 }, { value: 9, opacity: 0.5 }];
  const [volume, shell] = addShell(VOLUME, points);
  assert.equal(volume.visible, false);
  assert.deepEqual(shell, { type: 'shell', visible: true, low: 0.05, high: 0.45, detail: 'high' });
  const faint = addShell(VOLUME, [{ opacity: 0.04 }])[1];
  assert.deepEqual([faint.low, faint.high], [0.01, 0.95], 'a translucent one has no opaque voxels');
  assert.equal(addShell(VOLUME, [{ opacity: 0.999 }])[1].high, 0.9);
  assert.equal(canAdd([volume, shell], 'shell'), false);
  assert.deepEqual(moveThreshold(shell, 'low', 0.2), { low: 0.2, high: 0.45 });
  assert.deepEqual(moveThreshold(shell, 'low', 0.7), { low: 0.7, high: 0.7 });
  assert.deepEqual(moveThreshold(shell, 'high', 0.01), { high: 0.01, low: 0.01 });
  assert.deepEqual(moveThreshold(shell, 'high', 7), { high: 1, low: 0.05 });
});

test('a new surface encloses what is visible, further ones lie above it', () => {
  const histogram = histogramOf(20, 100, 200);
  const range = [0, 256];
  const from = (hidden) => [{ value: hidden, opacity: 0 }, { value: 250, opacity: 1 }];
  const cut = surfaceValue(VOLUME, from(255), histogram, range);
  compare(cut, '>', 22, 'the threshold between background and object');
  compare(cut, '<', 199);
  assert.equal(surfaceValue(VOLUME, from(40), histogram, range), (40 + cut) / 2, 'halfway from where the transfer function begins');
  assert.equal(surfaceValue(VOLUME, [{ value: 9, opacity: 1 }], histogram, range), cut / 2, 'it begins at the lowest value');
  const second = surfaceValue([surfaceOf(60)], from(40), histogram, range);
  compare(second, '>', 100);
  compare(second, '<', 200);
  const third = surfaceValue([surfaceOf(60), surfaceOf(220)], from(40), histogram, range);
  compare(third, '<', 60, 'nothing is left above');
  assert.equal(surfaceValue(VOLUME, from(12), null, [10, 20]), 15, 'without a histogram');
  assert.equal(surfaceValue([surfaceOf(15)], from(12), null, [10, 20]), 17.5);
});

test('lists are the same but for rounding', () => {
  assert.ok(isSameLayers([surfaceOf(1 / 3)], [surfaceOf(0.33333334)]));
  for (const [change, what] of [[{ value: 2 }, 'value'], [{ visible: false }, 'visible'], [{ color: [1, 0, 0] }, 'color'], [{ flatness: 4 }, 'flatness']]) {
    assert.ok(!isSameLayers([surfaceOf(1)], [surfaceOf(1, change)]), what);
  }
  assert.ok(!isSameLayers(VOLUME, [...VOLUME, surfaceOf(1)]));
});

test('there is one layer of vectors, as dense as suits the grid', () => {
  const [volume, vectors] = addVectors(VOLUME, { dims: [64, 100, 32] });
  assert.equal(volume.visible, false);
  assert.deepEqual(vectors, { type: 'vectors', visible: true, style: 'modulate', color: [0.9, 0.85, 0.75], phase: 0, stretch: 4, density: 0.2, color_by: '', color_low: null, color_high: null });
  assert.deepEqual([32, 500].map((n) => addVectors(VOLUME, { dims: [2, n, 8] })[1].density), [0.2, 0.04]);
  const [points, streaks] = addVectors(addElements([], 'points'), { dims: [1, 1, 1], elements: { count: 1e9 } });
  assert.deepEqual([points.visible, streaks.density], [false, 0.02], 'they replace points, too');
  assert.equal(removeLayer([points, streaks], 1, 'points')[0].visible, true);
  assert.equal(canAdd([volume, vectors], 'vectors'), false);
  assert.deepEqual([{ fields: [{ components: 1 }, { components: 3 }] }, { fields: [{ components: 1 }] }, {}, null].map(hasVectors), [true, false, false, false]);
  const moved = changeLayer([volume, vectors], 1, { phase: 0.5 });
  assert.equal(isSameLayers(moved, [volume, vectors]), false);
  assert.ok(isSameLayers(withoutPhase(moved), withoutPhase([volume, vectors])));
});

test('layers of elements stand beside the volume, as many as there is space for', () => {
  const both = addElements(VOLUME, 'geometry', 'probe');
  assert.deepEqual(both.map(({ type, visible }) => [type, visible]), [['volume', true], ['geometry', true]], 'the volume stays visible');
  assert.equal(both[1].id, 'probe');
  assert.deepEqual(both[1].transform, [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
  assert.deepEqual([both[1].colors, both[1].opacity], ['own', 1]);
  const [, points] = addElements(VOLUME, 'points');
  assert.deepEqual([points.id, points.size], ['', 1]);
  assert.equal(addElements(VOLUME, 'gaussians')[1].convention, 'inria');
  assert.ok(canAdd(both, 'geometry'), 'a second mesh');
  assert.ok(!canAdd(Array(8).fill(points), 'points'));
  assert.deepEqual([both[1], points, VOLUME[0], surfaceOf(1)].map(isOfElements), [true, true, false, false]);
  assert.equal(addSurface(both, 100)[0].visible, false, 'the first surface takes the place of the volume all the same');
  const moved = changeLayer(both, 1, { transform: both[1].transform.map((part, i) => (i === 3 ? 2 : part)) });
  assert.ok(!isSameLayers(both, moved));
});

test('a volume without a grid never gets a layer of voxels', () => {
  const own = addElements([], 'gaussians');
  const both = addElements(own, 'geometry', 'probe');
  assert.deepEqual(removeLayer(both, 0, 'gaussians').map(({ id }) => id), ['probe']);
  assert.deepEqual(removeLayer(own, 0, 'gaussians'), own, 'its picture comes back');
});
