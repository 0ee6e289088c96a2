// SPDX-License-Identifier: Apache-2.0
// The words of measurements: each number has its name and unit, and what is missing or outside is said.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { labelLines, lacksUnit, namedValue, numbersOf, outsideText, tableText } from '../../../clients/web/core/measure_text.js';
import '../support/texts.mjs';

const STATISTICS = { count: 12, nonfinite: 0, mean: 100.26, deviation: 5.5, min: 3, max: 200 };
const region = { id: 'a', kind: 'rectangle', text: '', value: 123.45, unit: 'mm^2', data_unit: 'HU', outside: 0, statistics: STATISTICS };

test('a label names each number', () => {
  assert.deepEqual(labelLines(region), ['Area 123.5 mm²', 'Mean ± SD 100.3 ± 5.5 HU']);
  assert.deepEqual(labelLines({ kind: 'distance', text: '', value: 5, unit: 'mm', outside: 0 }), ['Length 5 mm']);
  assert.deepEqual(labelLines({ kind: 'angle', text: 'Hip', value: 90, unit: 'deg', outside: 0 }), ['Hip', 'Angle 90°']);
  assert.deepEqual(labelLines({ kind: 'profile', text: '', value: 5, unit: 'mm', outside: 0, statistics: STATISTICS }), ['Length 5 mm', 'Mean ± SD 100.3 ± 5.5']);
  assert.deepEqual(labelLines({ kind: 'marker', text: 'Nose', value: 7, unit: 'HU', outside: 0 }), ['Nose', 'Value 7 HU']);
  assert.deepEqual(labelLines({ kind: 'marker', text: '', value: null, unit: '', outside: 1 }), ['No value', 'Outside of the volume']);
});

test('a length or an area without a unit says so; an angle and a value have none to name', () => {
  assert.equal(namedValue({ kind: 'distance', value: 5, unit: '' }), 'Length 5 (no unit)');
  assert.equal(namedValue({ kind: 'ellipse', value: 5, unit: '' }), 'Area 5 (no unit)');
  assert.equal(namedValue({ kind: 'angle', value: 5, unit: 'deg' }), 'Angle 5°');
  assert.equal(namedValue({ kind: 'marker', value: 5, unit: '' }), 'Value 5');
  assert.deepEqual([region, { ...region, unit: '' }, { ...region, unit: '', value: null }].map(lacksUnit), [false, true, false]);
});

test('the part outside of the volume is named, and no part is rounded away', () => {
  const texts = [0, undefined, 1e-9, 0.031, 0.9999, 1].map((outside) => outsideText({ outside }));
  assert.deepEqual(texts, ['', '', '< 1 % outside of the volume', '3 % outside of the volume', '> 99 % outside of the volume', 'Outside of the volume']);
  assert.equal(labelLines({ ...region, outside: 0.03 }).at(-1), '3 % outside of the volume');
  assert.deepEqual(labelLines({ ...region, outside: 1, statistics: { ...STATISTICS, count: 0, mean: null } }), ['Area 123.5 mm²', 'Outside of the volume']);
});

test('the panel has all numbers with names', () => {
  assert.deepEqual(numbersOf({ ...region, unit: '' }), [['Area', '123.45 (no unit)'], ['Mean', '100.26 HU'], ['SD', '5.5 HU'], ['Minimum', '3 HU'], ['Maximum', '200 HU'], ['Samples', '12']]);
  assert.deepEqual(numbersOf({ ...region, data_unit: '' })[1], ['Mean', '100.26']);
  assert.deepEqual(numbersOf({ kind: 'path', value: 2, unit: 'mm', data_unit: 'HU', straight: 1, range: [1, 5] }).at(-1), ['Values', '1 – 5 HU']);
  assert.deepEqual(numbersOf({ kind: 'angle', value: 33.3333333, unit: 'deg' }), [['Angle', '33.333°']]);
  assert.deepEqual(numbersOf({ ...region, statistics: { ...STATISTICS, nonfinite: 2 } }).at(-1), ['Not finite', '2']);
});

test('the table for the clipboard has headings and no formulas', () => {
  const names = { a: '=1\t+1', b: '\ufeff -1', c: '\uff1d1', d: 'a-1' };
  const items = [{ ...region, statistics: { count: 3, mean: 1.5, deviation: null, min: 1, max: 2 } },
    ...['b', 'c', 'd'].map((id) => ({ id, kind: 'marker', value: null, unit: '' }))];
  assert.deepEqual(tableText(items, ({ id }) => names[id]).split('\n'), [
    'Name\tKind\tValue\tUnit\tSamples\tMean\tSD\tMinimum\tMaximum\tUnit of the values\tOutside\tSurface\tStraight',
    "'=1 +1\tRectangle\t123.45\tmm²\t3\t1.5\t\t1\t2\tHU\t0\t\t", "'\ufeff -1\tMarker\t\t\t\t\t\t\t\t\t\t\t", "'\uff1d1\tMarker\t\t\t\t\t\t\t\t\t\t\t", 'a-1\tMarker\t\t\t\t\t\t\t\t\t\t\t',
  ]);
});
