// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import test from 'node:test';
import { hidesStreaks } from '../../../clients/web/core/hiding.js';

const volume = { dims: [40, 60, 50], spacing: [1, 2, 1] };
const histogram = { range: [0, 100], counts: Array(100).fill(640) };
const transfer = (opacity, from = 50) => ({
  reference_length: 1, points: [{ value: from - 1, opacity: 0, color: [0, 0, 0] }, { value: from, opacity, color: [1, 1, 1] }],
});
const view = (transfer_function, ...types) => ({ transfer_function, layers: types.map((type) => (typeof type === 'string' ? { type, visible: true } : type)) });

test('streaks are hidden in an opaque volume or among opaque points, and not in a translucent one', () => {
  const cases = [
    [view(transfer(0.5), 'volume', 'vectors'), true],
    [view(transfer(0.5), 'points', 'vectors'), true],
    [view(transfer(0.05), 'volume', 'vectors'), false],
    [view(transfer(0.5, 99.9), 'volume', 'vectors'), false, 'a hundredth of the samples'],
    [view(transfer(0.5), 'volume'), false],
    [view(transfer(0.5), 'vectors'), false],
    [view(transfer(0.5), { type: 'volume', visible: false }, 'vectors'), false],
    [view(transfer(0.5), { type: 'points', id: 'other', visible: true }, 'vectors'), false],
    [view({ ...transfer(0.5), reference_length: 100 }, 'volume', 'vectors'), false],
    [view(transfer(0), 'volume', 'vectors'), false],
    [{}, false],
  ];
  for (const [i, [shown, wanted, why]] of cases.entries()) assert.equal(hidesStreaks(shown, histogram, volume), wanted, why ?? `case ${i}`);
  assert.equal(hidesStreaks(cases[0][0], null, volume), false);
  assert.equal(hidesStreaks(cases[0][0], histogram, null), false);
});
