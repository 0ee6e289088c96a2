// SPDX-License-Identifier: Apache-2.0
// Kinds of volumes: their names and numbers, and what has a meaning for their pictures.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { contentsText, countText, elementRows, kindOf, kindOfView, layerTypeOf, offersOf } from '../../../clients/web/core/kinds.js';

const gaussians = { kind: 'gaussians', elements: { count: 1234567, spacing: 0.01, degree: 3 }, dims: [1, 1, 1], spacing: [2.5, 2, 0.8], type: 'float32', unit: 'm' };
const mesh = { kind: 'mesh', elements: { count: 2, spacing: 0.5, vertices: 4 }, dims: [1, 1, 1], spacing: [1, 1, 0] };

test('a volume without a kind has a grid; an unknown volume too', () => {
  assert.equal(kindOf({ dims: [4, 4, 4] }), 'grid');
  assert.equal(kindOf(null), 'grid');
  assert.deepEqual(['grid', 'points', 'gaussians', 'mesh'].map(layerTypeOf), ['volume', 'points', 'gaussians', 'geometry']);
});

test('a guest learns the kind from the layer of the volume itself', () => {
  const other = { type: 'geometry', id: 'probe' };
  assert.equal(kindOfView({ layers: [other, { type: 'gaussians', id: '' }] }, null), 'gaussians');
  assert.equal(kindOfView({ layers: [{ type: 'geometry', id: '' }] }, null), 'mesh');
  assert.equal(kindOfView({ layers: [{ type: 'volume' }, other] }, null), 'grid');
  assert.equal(kindOfView(null, null), 'grid');
  assert.equal(kindOfView({ layers: [{ type: 'points', id: '' }] }, { kind: 'mesh' }), 'mesh', 'the list of volumes knows better');
});

test('the page offers what the layers use', () => {
  const view = (...types) => ({ layers: types.map((type) => ({ type })) });
  assert.deepEqual(offersOf('grid', view('volume')), ['grid', 'values', 'footprint', 'lit']);
  assert.deepEqual(offersOf('points', view('points')), ['values', 'footprint']);
  assert.deepEqual(offersOf('gaussians', view('gaussians')), []);
  assert.deepEqual(offersOf('mesh', view('geometry')), ['lit']);
  assert.deepEqual(offersOf('gaussians', view('gaussians', 'points', 'geometry')), ['values', 'footprint', 'lit']);
});

test('texts name the elements and group their number', () => {
  assert.equal(contentsText(gaussians), '1 234 567 Gaussians');
  assert.equal(contentsText(mesh), '2 triangles');
  assert.equal(contentsText({ kind: 'points', elements: { count: 999, spacing: 1 } }), '999 points');
  assert.equal(contentsText({ kind: 'grid', dims: [64, 64, 32], type: 'uint8' }), '64 × 64 × 32 · uint8');
  assert.equal(contentsText({ state: 'loading' }), '');
  assert.equal(countText(gaussians), '1 234 567');
  assert.equal(countText(null), '');
  assert.equal(countText({ kind: 'grid', dims: [1, 1, 1] }), '');
});

test('the rows about elements have no voxels and no undefined values', () => {
  const told = (volume) => Object.fromEntries(elementRows(volume).filter(([, value]) => value));
  assert.deepEqual(told(gaussians), {
    Gaussians: '1 234 567', Harmonics: 'degree 3', Size: '2.5 × 2 × 0.8 m, the box around all', 'Typical size': '0.01 m',
  });
  assert.deepEqual(told(mesh), { Triangles: '2', Vertices: '4', Size: '1 × 1 × 0, the box around all', 'Typical size': '0.5' });
});
