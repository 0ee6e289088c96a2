// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { ownFrom, placeOf, roundedAlong, sizesOf, unitAlong, worldFrom } from '../../../clients/web/core/vertical.js';

const plain = { unit: 'um' };
const pressure = { unit: 'degrees', vertical: { per_unit: -0.125, unit: 'hPa' } };

test('an axis z that was scaled has the numbers and the unit of the file', () => {
  assert.equal(ownFrom(pressure, 2, -62.5), 500);
  assert.equal(worldFrom(pressure, 2, 500), -62.5);
  assert.equal(unitAlong(pressure, 2), 'hPa');
  for (const axis of [-1, 0, 1]) {
    assert.equal(ownFrom(pressure, axis, 7), 7);
    assert.equal(worldFrom(pressure, axis, 7), 7);
    assert.equal(unitAlong(pressure, axis), 'degrees');
  }
  assert.equal(ownFrom(plain, 2, 7), 7);
  assert.equal(ownFrom(null, 2, 7), 7);
  assert.equal(unitAlong(plain, 2), 'µm');
});

test('its numbers are rounded to a thousandth of their own extent', () => {
  assert.equal(roundedAlong(pressure, 2, -62.5001, 12.5), 500);
  assert.equal(roundedAlong(pressure, 0, 62.5001, 12.5), 62.5);
  assert.equal(roundedAlong({ vertical: { per_unit: 1000, unit: '' } }, 2, 12.5, 100), 0.0125);
});

test('a position tells both units', () => {
  assert.deepEqual(placeOf(plain, [1, -2, 3], 10), { place: '1, −2, 3', unit: 'µm' });
  assert.deepEqual(placeOf(pressure, [1, -2, -62.5], 10), { place: '1, −2 degrees, 500', unit: 'hPa' });
  assert.deepEqual(placeOf({ unit: '', vertical: { per_unit: 2, unit: '' } }, [1, 2, 3], 10), { place: '1, 2, 1.5', unit: '' });
});

test('so do sizes, which have no sign', () => {
  assert.deepEqual(sizesOf(plain, [1, 2, 3], String), { numbers: '1 × 2 × 3', unit: 'µm' });
  assert.deepEqual(sizesOf(pressure, [1, 2, 3], String), { numbers: '1 × 2 degrees × 24', unit: 'hPa' });
});
