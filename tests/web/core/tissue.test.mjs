// SPDX-License-Identifier: Apache-2.0
// Histograms, and presets by kind of data that are placed by them.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { backgroundEnd, logHeights, peak, percentile, readHistogram, threshold } from '../../../clients/web/core/histogram.js';
import { KINDS, presetOf, scaleOf } from '../../../clients/web/core/tissue.js';
import { compare } from '../../support/compare.mjs';
import '../support/texts.mjs';

/** A histogram of 256 bins with peaks [[value, count], …] over a flat base. */
function histogramOf(range, peaks, base = 3) {
  const counts = Array(256).fill(base);
  for (const [value, count] of peaks) counts[Math.min(255, Math.floor((value - range[0]) / (range[1] - range[0]) * 256))] += count;
  return { range, counts };
}

test('the answer of the daemon is read: one axis or two', () => {
  const x = { axis: 'value', range: [0, 255], bins: 2 };
  assert.deepEqual(readHistogram({ volume: 'v', type: 'uint8', axes: [x], counts: [1, 2], windows: {} }),
    { volume: 'v', type: 'uint8', range: [0, 255], counts: [1, 2], windows: {} });
  const joint = readHistogram({ volume: 'v', axes: [x, { axis: 'gradient', range: [0, 9], bins: 1 }], counts: [1, 2] });
  assert.deepEqual(readHistogram({ axes: [{ range: [-1.7e308, 1.7e308], bins: 1 }], counts: [1] }).range, [-8e307, 8e307]);
  assert.deepEqual(joint, { volume: 'v', x: { range: [0, 255], bins: 2 }, y: { range: [0, 9], bins: 1 }, counts: [1, 2] });
});

test('heights are logarithmic, and no peak is lost when several bins share a column', () => {
  const histogram = histogramOf([0, 256], [[100.5, 1e6]], 0);
  const wide = logHeights(histogram, 0, 256, 16);
  assert.equal(wide[6], 1);
  assert.equal(wide.filter((h) => h > 0).length, 1);
  assert.deepEqual(logHeights(histogram, 100, 101, 3), [1, 1, 1]);
  assert.deepEqual(logHeights(histogram, 300, 400, 2), [0, 0]);
  const two = logHeights(histogramOf([0, 256], [[10, 100], [20, 10000]], 0), 0, 256, 256);
  compare(two[10], '>', 0.49);
  assert.equal(logHeights({ range: [5, 5], counts: [7, 0] }, 4, 6, 2).length, 2);
});

test('percentile, peak and threshold', () => {
  const flat = { range: [0, 256], counts: Array(256).fill(10) };
  compare(Math.abs(percentile(flat, 0.5) - 128), '<', 1e-9);
  compare(Math.abs(percentile(flat, 0.5, 128) - 192), '<', 1e-9);
  assert.equal(percentile({ range: [0, 1], counts: [0, 0] }, 0.5), 1);
  assert.equal(peak(histogramOf([0, 256], [[40, 90], [200, 50]])), 40.5);
  assert.equal(peak(histogramOf([0, 256], [[40, 90], [200, 50]]), 100), 200.5);
  assert.equal(peak(flat, 500), null);
  const split = threshold({ range: [0, 256], counts: Array.from({ length: 256 }, (_, i) => (i < 60 ? 1e5 : i > 150 && i < 220 ? 1e4 : 0)) });
  compare(split, '>=', 60);
  compare(split, '<=', 151);
});

test('Hounsfield units are found: as the file says, or by the values where it states no unit', () => {
  const scan = histogramOf([-1024, 3071], [[-1000, 1e6], [40, 1e5]]);
  const offset = (tissue) => histogramOf([0, 3926], [[5, 6e4], [tissue, 2e4]]);
  assert.deepEqual([scaleOf(scan).at(300), scaleOf(scan).isCt], [300, true]);
  assert.match(scaleOf(scan).note, /states no unit, but the values look like Hounsfield units$/);
  assert.equal(scaleOf(histogramOf([-32768, 32767], [[-1000, 1e6]])).isCt, true, 'wide bins');
  assert.equal(scaleOf(offset(1050)).at(300), 1324);
  assert.equal(scaleOf(offset(1020)).at(300), 1300);
  assert.match(scaleOf(offset(1020)).note, /look like Hounsfield units \+ 1000/);
  assert.equal(scaleOf(offset(1020), 'HU').at(300), 300, 'the file states the unit');
  assert.equal(scaleOf(histogramOf([-150, 180], [[0, 1e5]]), 'HU').isCt, true);
  const bytes = scaleOf(histogramOf([0, 255], [[20, 1e6], [120, 1e5]]));
  compare(Math.abs(bytes.at(-1000) - 20.4), '<', 1);
  compare(bytes.at(1600), '<=', 255);
  compare(bytes.at(1600), '>', 200);
});

test('other values are not called Hounsfield units, whatever their range', () => {
  const scan = histogramOf([-1024, 3071], [[-1000, 1e6], [40, 1e5]]);
  const bell = Array.from({ length: 40 }, (_, i) => [-1650 + i * 90, Math.round(1e5 * Math.exp(-(((i - 18) / 8) ** 2)))]);
  const pressure = histogramOf([-1700, 1962], bell, 0);
  assert.match(presetOf('ct-bone', pressure, 'hPa').note, /values are in hPa, not in Hounsfield units; placed by the histogram/);
  assert.match(presetOf('ct-bone', scan, 'Pa').note, /values are in Pa/);
  assert.match(presetOf('ct-lung', histogramOf([0, 3926], [[5, 6e4], [1050, 2e4]]), 'counts').note, /values are in counts/);
  for (const [histogram, meaning] of [[pressure, ''], [scan, 'distance'], [scan, 'labels'], [histogramOf([-500, 500], [[0, 1e6]], 0), '']]) {
    const { note, isCt } = scaleOf(histogram, '', meaning);
    assert.deepEqual([note, isCt], ['the file has no Hounsfield units; placed by its histogram', false], `${histogram.range} ${meaning}`);
  }
});

test('every kind gives valid points on every histogram', () => {
  const all = [
    histogramOf([-1024, 3071], [[-1000, 1e6], [40, 1e5]]), histogramOf([0, 255], [[3, 1e6], [80, 1e4]]), histogramOf([0, 1], [[0, 1e6]], 0),
    histogramOf([-3e38, 3e38], [[0, 1e6]]), histogramOf([0, 65535], [[100, 1e7], [900, 1e4]]), { range: [7, 7], counts: [...[5], ...Array(255).fill(0)] },
  ];
  for (const kind of KINDS) {
    for (const histogram of all) {
      const { points, note } = presetOf(kind, histogram);
      const what = `${kind} on ${histogram.range}: ${JSON.stringify(points)}`;
      assert.ok(note.length > 5, what);
      compare(points.length, '>=', 1, what);
      points.forEach((p, i) => {
        assert.ok(Number.isFinite(p.value) && (i === 0 || p.value > points[i - 1].value), what);
        assert.ok(p.opacity >= 0 && p.opacity < 1 && p.color.every((part) => part >= 0 && part <= 1), what);
      });
      if (histogram.range[0] < histogram.range[1]) compare(Math.max(...points.map((p) => p.opacity)), '>', 0.05, what);
    }
  }
});

test('bone is above soft tissue, and the air stays transparent', () => {
  const histogram = histogramOf([-1024, 3071], [[-1000, 1e6], [40, 1e5]]);
  for (const kind of ['ct-bone', 'ct-soft', 'ct-vessels']) {
    const [first] = presetOf(kind, histogram).points;
    assert.equal(first.opacity, 0);
    compare(first.value, '>', -200);
  }
  assert.equal(presetOf('ct-bone', histogram).points[0].value, 150);
  assert.equal(presetOf('simulation', histogram).map, 'viridis');
});

test('a preset says that the volume lacks its tissue, or that its values are Hounsfield units', () => {
  const abdomen = histogramOf([-1024, 3071], [[-1000, 1e6], [40, 1e6]], 0);
  assert.match(presetOf('ct-lung', abdomen, 'HU').note, /hardly any values .* \(-950 to -500 HU\)/);
  assert.match(presetOf('ct-bone', abdomen, 'HU').note, /hardly any/);
  assert.match(presetOf('ct-soft', abdomen, 'HU').note, /are Hounsfield/);
  assert.match(presetOf('ct-lung', histogramOf([-1024, 3071], [[-1000, 1e6], [-800, 1e5]], 0), 'HU').note, /are Hounsfield/);
  assert.match(presetOf('mr', abdomen, 'HU').note, /presets for CT/);
  assert.match(presetOf('mr', abdomen).note, /histogram/);
});

test('a signal begins above the peak of the background and its noise', () => {
  const noise = Array.from({ length: 256 }, (_, i) => Math.round(1e5 * Math.exp(-((i - 20) ** 2) / 32)));
  const low = backgroundEnd({ range: [0, 256], counts: noise.map((count, i) => count + (i > 20 ? 50 : 0)) });
  compare(low, '>', 32);
  compare(low, '<', 45);
  compare(backgroundEnd({ range: [0, 256], counts: [1e6, ...Array(255).fill(10)] }), '<=', 2, 'a background without noise');
  assert.equal(backgroundEnd({ range: [0, 256], counts: Array.from({ length: 256 }, (_, i) => i) }), null, 'the brightest values are no background');
});
