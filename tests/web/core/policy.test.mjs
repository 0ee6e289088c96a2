// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { policyText } from '../../../clients/web/core/policy.js';
import '../support/texts.mjs';

const final = { format: 'jpeg', quality: 90, subsampling: '4:4:4', size: [800, 600], coarse: 0 };

test('a policy is described in words', () => {
  const moving = { format: 'jpeg', quality: 60, subsampling: '4:2:0', size: [400, 300], coarse: 1 };
  assert.equal(policyText({ moving, final, why: ['quality', 'time', 'shared_time'], budget_ms: 33.1, sharp_ms: 180.4 }),
    'Moving: JPEG, quality 60, colours 4:2:0, 400 × 300, 2×2×2 voxels as one (lower quality is faster; full detail would take'
    + ' 180 ms of a budget of 33 ms; other sessions are moving, too)\nAt rest: JPEG, quality 90, colours 4:4:4, 800 × 600');
});

test('a slow network asks for video first, then for smaller pictures', () => {
  const of = (format, size) => policyText({ moving: { format, size }, final, why: ['bandwidth'] });
  assert.match(of('vp9', [800, 600]), /too slow for images/);
  assert.match(of('vp9', [400, 300]), /too slow for larger images/);
  assert.match(of('jpeg', [400, 300]), /too slow for larger images/);
});

test('unknown fields and reasons of a later version are omitted', () => {
  assert.equal(policyText({ moving: { format: 'vp9', quality: 60 }, final: { format: 'png' }, why: ['moon', 'constructor'] }),
    'Moving: VP9, quality 60\nAt rest: PNG, lossless');
  assert.equal(policyText({ moving: { format: 'vp9', quality: 60 }, final, why: ['time'] }),
    'Moving: VP9, quality 60 (full detail would take too long)\nAt rest: JPEG, quality 90, colours 4:4:4, 800 × 600');
  for (const nothing of [null, undefined, {}, { moving: {}, final: {} }]) assert.equal(policyText(nothing), '');
});
