// SPDX-License-Identifier: Apache-2.0
// Which files belong together: headers and the files with their samples.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { namesIn, sortedIntoSets } from '../../../clients/web/core/file_sets.js';

const NRRD = 'NRRD0004\ntype: uint8\nsizes: 2 2 2\n';
const file = (name, text = 'x') => ({ name, size: text.length, slice: (from, to) => ({ text: async () => text.slice(from, to) }) });

test('the names that a header gives', () => {
  for (const [name, text, names] of [
    ['a.nhdr', `${NRRD}data file: ct 1.raw\n`, ['ct 1.raw']],
    ['a.nhdr', `${NRRD}datafile: ct.raw\r\nencoding: raw\r\n`, ['ct.raw']],
    ['a.nhdr', `${NRRD}Data File: LIST\na.raw\nb.raw\n`, ['a.raw', 'b.raw']],
    ['a.nhdr', `${NRRD}data file: s%03d.raw 8 12 2\n`, ['s008.raw', 's010.raw', 's012.raw']],
    ['a.nhdr', `${NRRD}data file: s%d.raw 1 9 0\n`, []],
    ['a.nrrd', `${NRRD}encoding: raw\n\ndata file: samples that look like a header`, []],
    ['a.nhdr', 'noise', []],
    ['a.json', '{"file": "ct.raw", "dims": [1, 1, 1]}', ['ct.raw']],
    ['a.json', '{"file": 3}', []], ['a.json', '[]', []], ['a.json', '{', []],
  ]) assert.deepEqual(namesIn(name, text), names, text);
});

test('files are sorted into volumes; what a header names is none of its own', async () => {
  const header = file('a.nhdr', `${NRRD}data file: a.raw\n`);
  const [raw, other, lost] = [file('a.raw'), file('b.vtk'), file('c.json', '{"file": "../c.raw"}')];
  assert.deepEqual(await sortedIntoSets([raw, header, other, lost]), [
    { file: header, companions: [raw], missing: [] },
    { file: other, companions: [], missing: [] },
    { file: lost, companions: [], missing: ['../c.raw'] },
  ]);
  const own = file('d.nhdr', `${NRRD}data file: d.nhdr\n`); // names itself
  assert.deepEqual((await sortedIntoSets([own]))[0].missing, ['d.nhdr']);
});
