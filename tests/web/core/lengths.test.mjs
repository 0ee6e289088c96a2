// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { lengthText, numberText, roundCoordinate, roundLength, dataText, roundValue, scaleBar, unitName, valueUnit } from '../../../clients/web/core/lengths.js';
import { compare } from '../../support/compare.mjs';

test('a round length is the largest of 1, 2, 5 times a power of ten within the limit', () => {
  const cases = [[1, 1], [1.99, 1], [2, 2], [4.9, 2], [5, 5], [9.99, 5], [10, 10], [0.03, 0.02], [0.1, 0.1], [740, 500], [3e-9, 2e-9], [2e12, 2e12]];
  for (const [limit, length] of cases) assert.equal(roundLength(limit), length, String(limit));
});

test('a number as text has a minus sign in place of the first hyphen', () => {
  assert.deepEqual([-164, 12.5, -2e-9, 0].map(numberText), ['−164', '12.5', '−2e-9', '0']);
});

test('lengths use the metric unit with the fewest digits; unknown units stay', () => {
  assert.equal(lengthText(20, 'mm'), '20 mm');
  assert.equal(lengthText(0.5, 'mm'), '500 µm');
  assert.equal(lengthText(2000, 'mm'), '2 m');
  assert.equal(lengthText(100, 'um'), '100 µm');
  assert.equal(lengthText(5e-7, 'm'), '500 nm');
  assert.equal(lengthText(1e-12, 'm'), '0.001 nm');
  assert.equal(lengthText(-20, 'mm'), '-20 mm');
  assert.equal(lengthText(0.2, 'kpc'), '0.2 kpc');
  assert.equal(lengthText(50, ''), '50');
});

test('the scale bar fills between 40 and 100 % of its place', () => {
  for (const worldPerPx of [0.001, 0.37, 1, 123]) {
    const { length, px } = scaleBar(worldPerPx, 120, 'mm');
    compare(px, '<=', 120 + 1e-9);
    compare(px, '>', 48 - 1e-9);
    compare(Math.abs(px * worldPerPx - length), '<', 1e-9 * length);
  }
  assert.equal(scaleBar(0.5, 120, 'mm').text, '50 mm');
});

test('coordinates are rounded to the size of the volume', () => {
  assert.equal(roundCoordinate(12.345678, 200), 12.3);
  assert.equal(roundCoordinate(0.00123456, 0.01), 0.00123);
  assert.equal(roundCoordinate(-0.00001, 200), 0);
  assert.equal(roundCoordinate(123456.7, 1e6), 123457);
  assert.equal(roundCoordinate(1.23456, NaN), 1.235);
  assert.equal(roundCoordinate(1.23456e-20, 2e-19), 1.23e-20);
});

test('values of the data keep what the range resolves', () => {
  assert.equal(roundValue(25.4678, [0, 255]), 25.47);
  assert.equal(roundValue(1043.4678, [-1024, 3071]), 1043.5);
  assert.equal(roundValue(0.912345678, [0, 1]), 0.9123);
  assert.equal(roundValue(65535, [0, 65535]), 65535);
  assert.equal(roundValue(9.87654321e299, [0, 1e300]), 9.87654e299);
  assert.equal(roundValue(9.87654321e-30, [0, 1e-29]), 9.877e-30);
});

test('a value has the unit that the file states', () => {
  const volume = { fields: [{ name: 'density', unit: 'HU' }] };
  assert.equal(dataText(-1043.4678, [-1100, 3071], valueUnit(volume)), '−1043.5 HU');
  assert.equal(dataText(12, [0, 255], valueUnit({ fields: [{ name: '', unit: '' }] })), '12');
  assert.equal(valueUnit(null), '');
});

test('micrometres have their sign; other units stay', () => {
  assert.deepEqual(['um', 'micron', 'mm', 'kpc', '', undefined].map(unitName), ['µm', 'µm', 'mm', 'kpc', '', '']);
});
