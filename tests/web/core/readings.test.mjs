// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import test from 'node:test';

import { cleanUnit, parseReadings, rememberReading, withReading } from '../../../clients/web/core/readings.js';

test('a source names what differs from the file', () => {
  assert.equal(withReading('a/b.nii', {}), 'a/b.nii');
  assert.equal(withReading('a/b.nii', { as: 'vectors', unit: '' }), 'a/b.nii?as=vectors');
  assert.equal(withReading('a/b.nii', { as: '', unit: 'µm' }), 'a/b.nii?unit=µm');
  assert.equal(withReading('a/b.nii', { as: 'rgb', unit: 'mm' }), 'a/b.nii?as=rgb&unit=mm');
});

test('a unit is one short word', () => {
  assert.equal(cleanUnit(' mm '), 'mm');
  assert.equal(cleanUnit('a&field=b'), '');
  assert.equal(cleanUnit('two words'), '');
  assert.equal(cleanUnit('µ'.repeat(16)), ''); // 32 bytes
  assert.equal(cleanUnit('µ'.repeat(15)), 'µ'.repeat(15));
});

test('readings are remembered per file, the newest ones', () => {
  const readings = parseReadings(null);
  let text = rememberReading(readings, 'a', { as: 'time', unit: '' });
  assert.deepEqual([...parseReadings(text)], [['a', { as: 'time', unit: '' }]]);
  text = rememberReading(readings, 'b', { as: '', unit: 'mm' });
  assert.deepEqual([...parseReadings(text).keys()], ['a', 'b']);
  text = rememberReading(readings, 'a', { as: '', unit: '' });
  assert.deepEqual([...parseReadings(text).keys()], ['b']);
  for (let i = 0; i < 150; i++) text = rememberReading(readings, `f${i}`, { as: 'rgb', unit: '' });
  assert.equal(parseReadings(text).size, 100);
  assert.equal(parseReadings('damaged').size, 0);
  assert.equal(parseReadings('[["a",{"as":"other","unit":""}]]').size, 0);
});
