// SPDX-License-Identifier: Apache-2.0
// Names of volumes that share the name of their files.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { fullNameOf, grouped, nameOf, placeOf } from '../../../clients/web/core/volume_names.js';

const volume = (id, name, source) => ({ id, name, source });

test('a name of its own needs nothing more', () => {
  const volumes = [volume('a', 'head', 'x/head.nrrd'), volume('b', 'foot', 'x/foot.nrrd')];
  assert.deepEqual(volumes.map((v) => fullNameOf(v, volumes)), ['head', 'foot']);
  assert.equal(nameOf({ id: 'c', name: '' }), 'c');
});

test('equal names are told apart by the folder, or else by the id', () => {
  const volumes = [volume('head', 'head', '2024/head.nrrd'), volume('head-2', 'head', '2025/jan/head.nrrd'), volume('head-3', 'head', 'head.nrrd')];
  assert.deepEqual(volumes.map((v) => placeOf(v, volumes)), ['2024', '2025/jan', 'head-3']);
  const twins = [volume('a', 'head', 'x/head.nrrd'), volume('b', 'head', 'x/head.vti'), volume('c', 'head', undefined)];
  assert.deepEqual(twins.map((v) => fullNameOf(v, twins)), ['head (a)', 'head (b)', 'head (c)']);
});

test('one file that is read in several ways is told apart by these', () => {
  const volumes = [volume('s', 'sphere', 'a/sphere.nrrd'), volume('s-2', 'sphere', 'a/sphere.nrrd?unit=mm'), volume('s-3', 'sphere', 'a/sphere.nrrd?as=time&unit=m/s')];
  assert.deepEqual(volumes.map((v) => placeOf(v, volumes)), ['s', 'unit=mm', 'as=time, unit=m/s']);
  const others = [volume('a', 'x', 'a/x.h5?field=/one/x'), volume('b', 'x', 'b/x.h5?field=/one/x')];
  assert.deepEqual(others.map((v) => placeOf(v, others)), ['a', 'b'], 'the path in a file is no folder');
});

test('a filter finds words in names, ids and sources; failed loads are a group of their own, and open volumes come first', () => {
  const volumes = [
    { ...volume('a', 'head', '2024/head.nrrd'), state: 'failed' }, { ...volume('b', 'Foot', 'x/foot.nrrd'), state: 'loading' },
    { ...volume('c', 'Übung *1*', 'x/u.nrrd'), state: 'ready' }, { ...volume('d', 'head', '2025/head.nrrd'), state: 'ready' },
  ];
  const ids = (filter) => Object.values(grouped(volumes, filter)).map((group) => group.map(({ id }) => id).join(''));
  assert.deepEqual(ids(''), ['cdb', 'a']);
  assert.deepEqual(ids('HEAD 2025'), ['d', '']);
  assert.deepEqual(ids('head'), ['d', 'a']);
  assert.deepEqual(ids('übung *'), ['c', '']);
  assert.deepEqual(ids('nothing'), ['', '']);
});
