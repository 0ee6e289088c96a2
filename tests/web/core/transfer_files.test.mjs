// SPDX-License-Identifier: Apache-2.0
// Files with transfer functions: ours and ParaView's, valid ones and bad ones.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { MIXES, labFromRgb, rgbFromLab } from '../../../clients/web/core/color_space.js';
import { colorAt, opacityAt } from '../../../clients/web/core/transfer.js';
import { readTransferFile, stretch, writeOwn, writeParaview } from '../../../clients/web/core/transfer_files.js';
import { compare } from '../../support/compare.mjs';
import '../support/texts.mjs';

const points = [{ value: -100, opacity: 0, color: [0, 0.25, 1] }, { value: 50.5, opacity: 0.3, color: [1, 1, 0] }, { value: 900, opacity: 0.999, color: [1, 0, 0] }];
const gradient = [{ magnitude: 0, scale: 0 }, { magnitude: 20, scale: 1 }];
const read = (json) => readTransferFile(JSON.stringify(json));

test('our files are read as they were written', () => {
  assert.deepEqual(readTransferFile(writeOwn('head', points, gradient)), { kind: 'whole', name: 'head', points, gradient });
  assert.deepEqual(read({ transfer_function: { points } }), { kind: 'whole', name: '', points, gradient: null });
  assert.deepEqual(read({ view: { volume: 'x', transfer_function: { points, gradient: [] } } }).gradient, []);
});

test('what is written for ParaView is read back', () => {
  const json = JSON.parse(writeParaview('head', points));
  assert.equal(json[0].Name, 'head');
  assert.equal(json[0].RGBPoints.length, 12);
  assert.equal(json[0].Points.length, 12);
  const back = read(json);
  assert.deepEqual([back.kind, back.gradient], ['whole', null]);
  assert.deepEqual(back.points, points);
});

test('a map of ParaView without opacities gives colours alone', () => {
  const map = read([{ Name: 'Cool', ColorSpace: 'RGB', RGBPoints: [10, 0, 0, 1, 15, 1, 1, 1, 30, 1, 0, 0] }]);
  assert.deepEqual(map, { kind: 'map', name: 'Cool', table: [[0, [0, 0, 1]], [0.25, [1, 1, 1]], [1, [1, 0, 0]]] });
});

test('the colour spaces of ParaView', () => {
  for (const rgb of [[0, 0, 0], [1, 1, 1], [0.23, 0.3, 0.75], [0.9, 0.1, 0.4]]) {
    rgbFromLab(labFromRgb(rgb)).forEach((part, k) => compare(Math.abs(part - rgb[k]), '<', 2e-3));
    for (const [name, mix] of Object.entries(MIXES)) {
      mix(rgb, [0.7, 0.02, 0.15], 0).forEach((part, k) => compare(Math.abs(part - rgb[k]), '<', 4e-3, name));
    }
  }
  // The middle of "Cool to Warm" is a light grey (Moreland 2009).
  MIXES.Diverging([0.23137254902, 0.298039215686, 0.752941176471], [0.705882352941, 0.0156862745098, 0.149019607843], 0.5)
    .forEach((part) => compare(Math.abs(part - 0.865), '<', 0.005));
  assert.deepEqual(MIXES.HSV([1, 0, 0], [0, 1, 0], 0.5).map((part) => Math.round(part * 1000) / 1000), [1, 1, 0]);
  // The short way round the circle of hues leads over red.
  compare(MIXES.HSV([1, 0, 0.5], [1, 0.5, 0], 0.5)[0], '>', 0.99);
  compare(MIXES.HSVNoWrap([1, 0, 0.5], [1, 0.5, 0], 0.5)[0], '<', 0.5);
  const step = read([{ ColorSpace: 'Step', RGBPoints: [0, 1, 0, 0, 1, 0, 1, 0] }]);
  assert.deepEqual(colorAt(step.table.map(([value, color]) => ({ value, color })), 0.9), [1, 0, 0]);
});

test('midpoint and sharpness of opacities, as in VTK', () => {
  const of = (midpoint, sharpness) => read([{ RGBPoints: [0, 0, 0, 0, 1, 1, 1, 1], Points: [0, 0, midpoint, sharpness, 1, 0.8, 0.5, 0] }]).points;
  compare(Math.abs(opacityAt(of(0.25, 0), 0.25) - 0.4), '<', 1e-3);
  const sharp = of(0.5, 1);
  assert.deepEqual([opacityAt(sharp, 0.4), opacityAt(sharp, 0.6)], [0, 0.8]);
  const smooth = of(0.5, 0.5);
  compare(opacityAt(smooth, 0.25), '<', 0.1);
  compare(opacityAt(smooth, 0.75), '>', 0.7);
});

test('a preset of ParaView from 0 to 1 is stretched over the values of the volume', () => {
  const preset = (high) => read([{ RGBPoints: [0, 0, 0, 0, high, 1, 1, 1], Points: [0, 0, 0.5, 0, high, 0.5, 0.5, 0] }]);
  assert.deepEqual(stretch(preset(1), [-100, 300]).map(({ value, opacity }) => [value, opacity]), [[-100, 0], [300, 0.5]]);
  assert.equal(stretch(preset(1), [0, 0.8]), null, 'the values of the volume may be the same');
  assert.equal(stretch(preset(40), [-100, 300]), null);
  assert.equal(stretch(preset(1), [7, 7]), null);
  assert.equal(stretch(readTransferFile(writeOwn('head', points, gradient)), [0, 255]), null);
});

test('equal values, which ParaView uses for steps, move apart', () => {
  const { table } = read([{ RGBPoints: [0, 1, 0, 0, 5, 1, 0, 0, 5, 0, 1, 0, 10, 0, 1, 0] }]);
  table.forEach(([t], i) => compare(t, '>', i ? table[i - 1][0] : -1));
});

test('three equal values rise, too', () => {
  const colors = [0, 0, 0, 0, 1, 1, 0, 0, 1, 0, 1, 0, 1, 0, 0, 1, 2, 1, 1, 1];
  const { table } = read([{ RGBPoints: colors }]);
  table.slice(1).forEach(([t], i) => assert.ok(t > table[i][0]));
});

test('maps with very many colours, or values too far apart, are refused', () => {
  const many = Array.from({ length: 20000 }, (_, i) => [i, i % 2, 0, 0]).flat();
  assert.throws(() => read([{ RGBPoints: many }]), /has 20000 groups; at most 512/);
  assert.throws(() => read([{ RGBPoints: [-1.7e308, 0, 0, 0, 1.7e308, 1, 1, 1] }]), /entry 1 is -1.7e\+308, not a number within ±1e300/);
});

test('bad files are refused with the place and the reason', () => {
  const whole = (change) => ({ transfer_function: { points, ...change } });
  const cases = [
    ['', /not JSON/], ['{', /not JSON/], ['[]', /neither/], ['null', /neither/], ['3', /neither/], [{}, /neither/], [{ transfer_function: 3 }, /neither/],
    [whole({ points: [] }), /at least one point/], [whole({ points: 'x' }), /must be a list/],
    [whole({ points: [{ value: 'a', opacity: 0, color: [0, 0, 0] }] }), /Point 1: "value" is "a"/],
    [whole({ points: [points[1], points[0]] }), /Point 2: its value -100 is not above/],
    [whole({ points: [{ value: 1, opacity: 1.5, color: [0, 0, 0] }] }), /"opacity" is 1.5/],
    [whole({ points: [{ value: 1, opacity: 1, color: [0, 0, 2] }] }), /"color" is \[0,0,2\]/],
    [whole({ points: [{ value: 1, opacity: 1 }] }), /"color" is undefined/], [whole({ points: [null] }), /Point 1/],
    [whole({ points: Array.from({ length: 257 }, (_, value) => ({ value, opacity: 0, color: [0, 0, 0] })) }), /257 points; at most 256/],
    [whole({ gradient: [{ magnitude: -1, scale: 0 }] }), /Gradient point 1: "magnitude" is -1/],
    [whole({ gradient: [{ magnitude: 1, scale: 3 }] }), /"scale" is 3/], [whole({ gradient: {} }), /"gradient" must be a list/],
    [{ version: 9, ...whole({}) }, /version 9/],
    [[{ RGBPoints: [0, 1, 0] }], /groups of 4/], [[{ RGBPoints: [] }], /groups of 4/], [[{ RGBPoints: [0, 1, 0, 'x'] }], /entry 4 is "x"/],
    [[{ RGBPoints: [0, 0, 0, 255] }], /outside \[0, 1\]/], [[{ RGBPoints: [5, 0, 0, 0, 1, 0, 0, 0] }], /the value 1 is not above/],
    [[{ IndexedColors: [1, 0, 0] }], /categories/], [[{ ColorSpace: 'Cyan', RGBPoints: [0, 0, 0, 0] }], /"Cyan" is not known/],
    [[{ ColorSpace: 'constructor', RGBPoints: [0, 0, 0, 0] }], /not known/],
    [[{ RGBPoints: [0, 0, 0, 0], Points: [0, 7, 0.5, 0] }], /opacity 7/],
    ['x'.repeat((1 << 20) + 1), /characters/],
  ];
  for (const [file, error] of cases) assert.throws(() => readTransferFile(typeof file === 'string' ? file : JSON.stringify(file)), error, JSON.stringify(file).slice(0, 90));
});
