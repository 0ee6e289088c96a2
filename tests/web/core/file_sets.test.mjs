// SPDX-License-Identifier: Apache-2.0
// Which files belong together: headers and the files with their samples.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { namesIn, seriesIn, sortedIntoSets } from '../../../clients/web/core/file_sets.js';

const NRRD = 'NRRD0004\ntype: uint8\nsizes: 2 2 2\n';
const file = (name, text = 'x') => new File([text], name, { lastModified: 1 });

test('the names that a header gives', () => {
  for (const [name, text, names] of [
    ['a.nhdr', `${NRRD}data file: ct 1.raw\n`, ['ct 1.raw']],
    ['a.nhdr', `${NRRD}datafile: ct.raw\r\nencoding: raw\r\n`, ['ct.raw']],
    ['a.nhdr', `${NRRD}Data File: LIST\na.raw\nb.raw\n`, ['a.raw', 'b.raw']],
    ['a.nhdr', `${NRRD}data file: s%03d.raw 8 12 2\n`, ['s008.raw', 's010.raw', 's012.raw']],
    ['a.nhdr', `${NRRD}data file: s%d.raw 1 9 0\n`, []],
    ['a.nrrd', `${NRRD}encoding: raw\n\ndata file: samples that look like a header`, []],
    ['a.nhdr', 'noise', []],
    ['a.mhd', 'NDims = 3\nElementDataFile = LOCAL\n', []], ['a.mhd', 'NDims = 3\nelementdatafile = ct.zraw\n', ['ct.zraw']],
    ['a.mhd', 'ElementDataFile = LIST\na.raw\n\nb.raw', ['a.raw', 'b.raw']], ['a.mhd', 'ElementDataFile = s%02d.raw 1 2 1', ['s01.raw', 's02.raw']],
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

test('headers of NIfTI and VGStudio name their samples', async () => {
  assert.deepEqual(namesIn('a.hdr', `${' '.repeat(344)}ni1\0`), ['a.img']);
  assert.deepEqual(namesIn('a.hdr', `${' '.repeat(344)}n+1\0`), []);
  assert.deepEqual(namesIn('a.vgi', '[file1]\r\nSize = 1 1 1\r\nName = C:\\data\\scan.vol\r\n'), ['scan.vol']);
  assert.deepEqual(namesIn('a.vgi', '[other]'), []);
  const [header, packed] = [file('a.hdr'), file('a.img.gz')];
  assert.deepEqual(await sortedIntoSets([packed, header]), [{ file: header, companions: [packed], missing: [] }]);
});

/** A TIFF with a directory without fields; a second one follows if it has `more` pages. */
function tiff(name, more) {
  const bytes = new Uint8Array([0x49, 0x49, 42, 0, 8, 0, 0, 0, 0, 0, more ? 14 : 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
  return new File([bytes], name, { lastModified: 1 });
}

test('numbered images are the slices of one stack', async () => {
  const [b, a, other, alone] = [file('s10.png'), file('S9.PNG'), file('t1.jpg'), file('map.png')];
  const [first, second, volume] = [tiff('z1.tif', false), tiff('z2.tif', false), tiff('z3.tif', true)];
  const sets = await sortedIntoSets([b, a, other, alone, second, first, volume]);
  assert.deepEqual(sets.map(({ file: head, companions }) => [head.name, ...companions.map(({ name }) => name)]),
    [['S9.PNG', 's10.png'], ['t1.jpg'], ['z1.tif', 'z2.tif'], ['map.png'], ['z3.tif']]);
});

/** Returns a DICOM file of this series, with or without the type of the element. The bytes of its tag also occur in another place. */
function dicom(uid, hasType) {
  const bytes = new Uint8Array(400);
  const put = (at, text) => bytes.set([...text].map((c) => c.charCodeAt(0)), at);
  put(128, 'DICM\x02\0');
  put(200, ' \0\x0e\0XX'); // no such element
  put(250, hasType ? ` \0\x0e\0UI${String.fromCharCode(uid.length)}\0` : ` \0\x0e\0${String.fromCharCode(uid.length)}\0\0\0`);
  put(258, uid);
  return bytes;
}

test('files of one DICOM series become one volume', async () => {
  assert.equal(seriesIn(dicom('1.2.3\0', true)), '1.2.3');
  assert.equal(seriesIn(dicom('1.2.34', false)), '1.2.34');
  assert.equal(seriesIn(new Uint8Array(10)), '');
  assert.equal(seriesIn(dicom('1.2.3x', true)), '', 'an id has numbers only');
  const of = (name, uid) => new File([dicom(uid, true)], name, { lastModified: 1 });
  const [b, a, other, raw] = [of('b.dcm', '1.2'), of('IM1', '1.2'), of('c.DCM', '1.3'), file('notes')];
  const sets = await sortedIntoSets([b, a, other, raw]);
  assert.deepEqual(sets.map(({ file: first, companions }) => [first.name, ...companions.map(({ name }) => name)]), [['IM1.dcm', 'b.dcm'], ['c.DCM'], ['notes']]);
});
