// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import test from 'node:test';
import { colorBarOf } from '../../../clients/web/core/color_bar.js';

const RED = [1, 0, 0];
const BLUE = [0, 0, 1];
const point = (value, opacity, color = RED) => ({ value, opacity, color });
const volumeOf = (more = {}) => ({ id: 'a', range: [0, 100], fields: [{ name: 'heat', unit: 'K', components: 1 }], ...more });
const viewOf = (points, more = {}) => ({ volume: 'a', transfer_function: { points }, ...more });
const known = { volumes: [volumeOf(), volumeOf({ id: 'b', range: [0, 2], fields: [{ name: 'age', unit: '' }] })] };

test('the bar reaches over what is visible, with the colours of the points', () => {
  const bar = colorBarOf(viewOf([point(20, 0), point(40, 0.5), point(60, 0.5, BLUE), point(80, 0, BLUE)]), known);
  assert.deepEqual([bar.name, bar.unit, bar.low, bar.high, bar.projection], ['heat', 'K', '20', '80', null]);
  assert.deepEqual(bar.ticks.map(({ text }) => text), ['20', '40', '60', '80']);
  assert.deepEqual(bar.ticks.map(({ at }) => Number(at.toFixed(3))), [0, 0.333, 0.667, 1]);
  assert.deepEqual(bar.colors.map(({ color }) => color), [RED, RED, BLUE, BLUE]);
  assert.ok(bar.colors.every(({ isHidden }) => !isHidden));
});

test('points reach to the ends of the values; what is hidden between has no colour', () => {
  const bar = colorBarOf(viewOf([point(10, 0.3), point(20, 0), point(70, 0, BLUE), point(80, 0.9, BLUE)]), known);
  assert.deepEqual([bar.low, bar.high], ['0', '100']);
  assert.deepEqual(bar.colors.map(({ isHidden }) => isHidden), [false, false, true, false, false, false]);
  assert.equal(colorBarOf(viewOf([point(10, 0), point(20, 0)]), known), null, 'nothing is visible');
  assert.equal(colorBarOf(viewOf([point(-30, 0), point(-20, 0.5), point(-10, 0)]), known), null, 'no value is');
});

test('small and large values have few digits', () => {
  const small = { volumes: [volumeOf({ range: [-0.00012345678, 0.0004] })] };
  const bar = colorBarOf(viewOf([point(-1, 0.5), point(1, 0.5)]), small);
  assert.deepEqual(bar.ticks.map(({ text }) => text), ['−0.00012346', '0', '0.0001', '0.0002', '0.0003', '0.0004']);
  const large = { volumes: [volumeOf({ range: [1e6, 1.2345678e9] })] };
  assert.deepEqual([colorBarOf(viewOf([point(0, 0.5)]), large).high], ['1234567800']);
});

test('only layers in the colours of the transfer function have a bar; its name is that of the first one', () => {
  const points = [point(0, 0.5), point(100, 0.5, BLUE)];
  const barOf = (...layers) => colorBarOf(viewOf(points, { layers }), known);
  assert.equal(barOf({ type: 'surface', visible: true, value: 3 }, { type: 'volume', visible: false }), null);
  assert.equal(barOf({ type: 'gaussians', id: '' }, { type: 'geometry', id: 'b' }), null);
  assert.equal(barOf({ type: 'surface' }, { type: 'vectors', style: 'blend' }).name, 'heat');
  const other = barOf({ type: 'volume', visible: false }, { type: 'points', id: 'b' });
  assert.deepEqual([other.name, other.unit, other.high], ['age', '', '2']);
});

test('the bar of a layer with the colours of other numbers has their range, and all colours', () => {
  const points = [point(20, 0), point(40, 0.5, BLUE)];
  const wind = { name: 'wind', unit: 'm/s', components: 3, range: [0, 12] };
  const volumes = [volumeOf({ fields: [...volumeOf().fields, wind] }), volumeOf({ id: 'b', fields: [{ name: 'age', unit: 's', range: [-2, 2] }] })];
  const barOf = (change) => colorBarOf(viewOf(points, { layers: [{ type: 'vectors', color_low: null, color_high: null, ...change }] }), { volumes });
  const bar = barOf({ color_by: 'b' });
  assert.deepEqual([bar.name, bar.unit, bar.low, bar.high], ['age', 's', '−2', '2']);
  assert.deepEqual(bar.colors.map(({ at, color, isHidden }) => [at, color, isHidden]), [[0, RED, false], [1, BLUE, false]]);
  const lengths = barOf({ color_by: 'magnitude', color_high: 6 });
  assert.deepEqual([lengths.name, lengths.unit, lengths.low, lengths.high], ['wind magnitude', 'm/s', '0', '6']);
  assert.equal(barOf({ color_by: 'gone' }), null);
  assert.equal(barOf({ color_by: '' }).name, 'heat');
});

test('a projection in grey shows its window; one in colours shows them', () => {
  const points = [point(20, 0.1), point(40, 0.5, BLUE)];
  const barOf = (compositing, histogram = null) => colorBarOf(viewOf(points, { compositing }), { ...known, histogram });
  const window = barOf({ mode: 'maximum', window: { center: 50, width: 20 } });
  assert.deepEqual([window.low, window.high, window.projection, window.colors.length], ['40', '60', 'maximum', 2]);
  assert.equal(barOf({ mode: 'mean' }), null, 'the automatic window is not known yet');
  assert.equal(barOf({ mode: 'mean' }, { windows: { mean: { center: 1, width: 2 } } }).high, '2');
  assert.deepEqual(barOf({ mode: 'mean', colors: 'transfer_function' }).colors.at(-1).color, BLUE);
});

test('a guest, who has no list of volumes, sees the values alone', () => {
  const bar = colorBarOf(viewOf([point(0, 0.5), point(4, 0.5)]), { histogram: { range: [1, 3] } });
  assert.deepEqual([bar.name, bar.unit, bar.low, bar.high], ['', '', '1', '3']);
  assert.equal(colorBarOf(viewOf([point(0, 0.5), point(4, 0.5)])).high, '4');
  assert.equal(colorBarOf({ volume: 'a' }), null);
});
