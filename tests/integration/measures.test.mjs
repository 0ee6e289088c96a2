// SPDX-License-Identifier: Apache-2.0
// Measurements of a session: two participants, rights, limits, a restart, forks, export.
import assert from 'node:assert/strict';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { Daemon, nrrd } from './harness.mjs';

const TOKEN = 'a-token-for-the-tests-0123456789';
// Four slices of the values 0 to 15, 16 to 31, …: a unit of 2 mm along x.
const HEADED = Buffer.concat([Buffer.from('NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nspace dimension: 3\nspace directions: (2,0,0) (0,1,0) (0,0,1)\n'
  + 'space units: "mm" "mm" "mm"\nsample units: HU\nspace origin: (0,0,0)\nencoding: raw\n\n'), nrrd().subarray(-64)]);
const SQUARE = { kind: 'rectangle', points: [[0, 0, 1], [4, 0, 1], [0, 2, 1]] };
let folder;
let daemon;

async function start() {
  const started = await Daemon.start(['--volume', path.join(folder, 'cube.nrrd'), '--volume', 'demo:phantom?size=8',
    '--token-file', path.join(folder, 'token'), '--state', path.join(folder, 'state')]);
  started.token = TOKEN;
  await started.loaded('cube');
  await started.loaded('phantom');
  return started;
}

before(async () => {
  folder = mkdtempSync(path.join(tmpdir(), 'splatd-measures-'));
  writeFileSync(path.join(folder, 'token'), `${TOKEN}\n`);
  writeFileSync(path.join(folder, 'cube.nrrd'), HEADED);
  daemon = await start();
});
after(async () => {
  assert.equal(await daemon.stop(), 0);
  rmSync(folder, { recursive: true });
});

const list = async (id, token = TOKEN) => (await daemon.json(`/api/v1/sessions/${id}/measures`, { token })).json.measures;
const refused = (promise, code, pointer) => assert.rejects(promise, (error) => {
  assert.deepEqual([error.code, error.data?.pointer], [code, pointer], error.message);
  return true;
});

test('a measurement has value, unit and what it was computed from', async () => {
  const { json } = await daemon.post('/api/v1/measure', { volume: 'cube', ...SQUARE });
  assert.deepEqual([json.value, json.unit, json.data_unit, json.note], [8, 'mm^2', 'HU', undefined]);
  const values = [16, 17, 18, 20, 21, 22, 24, 25, 26]; // columns 0 to 2 and rows 0 to 2 of slice 1
  const mean = values.reduce((a, b) => a + b) / 9;
  const deviation = Math.sqrt(values.reduce((sum, v) => sum + (v - mean) ** 2, 0) / 8);
  const { statistics: s } = json;
  assert.deepEqual([s.count, s.nonfinite, s.min, s.max], [9, 0, 16, 26]);
  assert.ok(Math.abs(s.mean - mean) < 1e-12 && Math.abs(s.deviation - deviation) < 1e-12, JSON.stringify(s));
  assert.equal(json.histogram.counts.reduce((a, b) => a + b), 9);
  const profile = await daemon.post('/api/v1/measure', { volume: 'cube', kind: 'profile', points: [[0, 0, 0], [6, 0, 3]], samples: 4 });
  assert.deepEqual(profile.json.profile.values, [0, 17, 34, 51]);
  assert.deepEqual(profile.json.profile.positions[1], [2, 0, 1]);
  const unknown = await daemon.post('/api/v1/measure', { volume: 'phantom', kind: 'distance', points: [[0, 0, 0], [3, 4, 0]] });
  assert.deepEqual([unknown.json.value, unknown.json.unit, unknown.json.data_unit], [5, '', '']);
  assert.match(unknown.json.note, /does not state the unit/);
});

test('two participants see each other\'s measurements', async () => {
  const session = await daemon.session({ volume: 'cube' });
  const [ann, bob] = [await daemon.stream({ session }), await daemon.stream({ session })];
  await ann.call('stream.configure', { name: 'Ann' });
  const made = await ann.call('measure.put', { id: 'square', text: 'a corner', ...SQUARE });
  assert.deepEqual([made.id, made.volume, made.author, made.value, made.unit, made.data_unit, made.hidden], ['square', 'cube', 'Ann', 8, 'mm^2', 'HU', false]);
  const told = await bob.note('session.measures');
  assert.deepEqual(told.params, { ids: ['square'], changed: [made] });
  // Bob renames what Ann made; it stays Ann's, and its value is the same.
  const renamed = await bob.call('measure.put', { id: 'square', text: 'Ecke', hidden: true });
  assert.deepEqual(renamed, { ...made, text: 'Ecke', hidden: true });
  await ann.note('session.measures', (p) => p.changed[0]?.text === 'Ecke');
  const moved = await ann.call('measure.put', { id: 'square', points: [[0, 0, 0], [6, 0, 0], [0, 3, 0]] });
  assert.deepEqual([moved.value, moved.statistics.count, moved.text], [18, 16, 'Ecke']);
  const named = await ann.call('measure.put', { kind: 'marker', points: [[2, 1, 1]] });
  assert.match(named.id, /^[0-9a-f]{16}$/);
  assert.equal(named.value, 21);
  // A participant that joins later gets all measurements; a removed measurement leaves the ids.
  const late = await daemon.stream({ session, token: session.tokens.view });
  assert.deepEqual((await late.note('session.measures')).params, { ids: ['square', named.id], changed: [moved, named] });
  assert.deepEqual(await bob.call('measure.remove', { id: named.id }), { id: named.id });
  await late.note('session.measures', (p) => p.ids.length === 1 && p.changed.length === 0);
  assert.deepEqual((await late.call('measure.list')).measures, [moved]);
  // Another volume: the measurement stays, but its points cannot change.
  await ann.update({ volume: 'phantom' });
  assert.equal((await ann.call('measure.put', { id: 'square', text: 'still here' })).volume, 'cube');
  await refused(ann.call('measure.put', { id: 'square', points: SQUARE.points }), -32602, '/points');
  assert.equal((await ann.call('measure.put', { id: 'other', kind: 'marker', points: [[0, 0, 0]] })).volume, 'phantom');
  assert.deepEqual((await list(session.id)).map((m) => m.volume), ['cube', 'phantom']);
  for (const stream of [ann, bob, late]) await stream.end();
});

test('who only watches may not edit, unless control was granted', async () => {
  const session = await daemon.session({ volume: 'cube' });
  const [host, guest] = [await daemon.stream({ session }), await daemon.stream({ session, token: session.tokens.view })];
  await host.call('measure.put', { id: 'm', ...SQUARE });
  await refused(guest.call('measure.put', { ...SQUARE }), -32004);
  await refused(guest.call('measure.remove', { id: 'm' }), -32004);
  assert.equal((await guest.call('measure.list')).measures.length, 1);
  await host.call('session.request_control');
  const { params } = await guest.note('session.participants');
  await host.call('session.grant_control', { to: params.you });
  assert.deepEqual(await guest.call('measure.remove', { id: 'm' }), { id: 'm' });
  for (const stream of [host, guest]) await stream.end();
});

// The values 21 to 63: in slice 1 the samples of the last rows without their first sample, and slices 2 and 3.
const PART = { kind: 'part', points: [[4, 2, 2]], range: [21, 63] };
const PATH = { kind: 'path', points: [[0, 0, 3], [6, 3, 3]], range: [21, 63] };

test('parts and paths have sizes, over HTTP and the stream', async () => {
  const { json } = await daemon.post('/api/v1/measure', { volume: 'cube', ...PART });
  assert.deepEqual([json.value, json.unit, json.samples, json.range, json.outside], [2 * 43, 'mm^3', 43, [21, 63], 0]);
  assert.ok(json.area > 0, JSON.stringify(json));
  const path_ = (await daemon.post('/api/v1/measure', { volume: 'cube', ...PATH })).json;
  assert.deepEqual([path_.unit, path_.data_unit, path_.path[0].length], ['mm', 'HU', 3]);
  assert.ok(path_.value >= path_.straight && path_.straight > 0, JSON.stringify(path_));
  const none = (await daemon.post('/api/v1/measure', { volume: 'cube', ...PART, range: [100, 200] })).json;
  assert.deepEqual([none.value, none.note], [null, 'no sample near the point has a value in the range']);
  const session = await daemon.session({ volume: 'cube' });
  const [ann, guest] = [await daemon.stream({ session }), await daemon.stream({ session, token: session.tokens.view })];
  const made = await ann.call('measure.put', { id: 'p', ...PART });
  assert.deepEqual([made.value, made.unit, made.samples, made.area], [86, 'mm^3', 43, json.area]);
  assert.deepEqual((await guest.note('session.measures')).params.changed, [made]);
  const line = await ann.call('measure.put', { id: 'l', ...PATH });
  assert.deepEqual([line.value, line.straight], [path_.value, path_.straight]);
  const narrow = await ann.call('measure.put', { id: 'p', range: [60, 63] });
  assert.equal(narrow.samples, 4);
  await refused(guest.call('measure.put', { ...PART }), -32004);
  // Scripts: the same, and CSV with all numbers.
  const url = `/api/v1/sessions/${session.id}/measures`;
  assert.equal((await daemon.post(url, PART, { token: session.tokens.view })).status, 403);
  const added = await daemon.post(url, PART, { token: session.tokens.control });
  assert.deepEqual([added.status, added.json.value], [201, 86]);
  const patched = await daemon.json(`${url}/p`, { method: 'PATCH', body: JSON.stringify({ range: [21, 63] }), token: session.tokens.control, headers: { 'Content-Type': 'application/json' } });
  assert.deepEqual([patched.status, patched.json.value], [200, 86]);
  const rows = (await (await daemon.fetch(`${url}?format=csv`)).text()).split('\r\n');
  assert.match(rows[1], /^p,part,.*,86,mm\^3,.*,21,63,[\d.]+,43,,HU$/);
  assert.match(rows[2], /^l,path,.*,mm,.*,21,63,,,[\d.]+,HU$/);
  for (const stream of [ann, guest]) await stream.end();
});

test('parts of a session are those of its edited volume', async () => {
  const session = await daemon.session({ volume: 'cube' });
  const stream = await daemon.stream({ session });
  const whole = await stream.call('measure.put', { id: 'p', ...PART });
  await stream.update({ edits: [{ type: 'plane', normal: [0, 0, -1], offset: -2.5 }] }); // slice 3 is gone
  const cut = await stream.call('measure.put', { id: 'p', points: PART.points });
  assert.deepEqual([whole.samples, cut.samples], [43, 27]);
  const asked = await daemon.post(`/api/v1/sessions/${session.id}/measure`, PART, { token: session.tokens.view });
  assert.equal(asked.json.samples, 27);
  assert.equal((await daemon.post('/api/v1/measure', { volume: 'cube', ...PART })).json.samples, 43);
  await stream.end();
});

test('bad measurements are refused with a pointer, and over the limits', async () => {
  const session = await daemon.session({ volume: 'cube' });
  const stream = await daemon.stream({ session });
  const cases = [
    [{ kind: 'marker', points: [[0, 0, 0]], id: 'a b' }, '/id'],
    [{ kind: 'marker', points: [[0, 0, 0]], id: 'x'.repeat(33) }, '/id'],
    [{ points: [[0, 0, 0]] }, '/kind'],
    [{ kind: 'angle', points: [[0, 0, 0], [1, 1, 1]] }, '/points'],
    [{ kind: 'marker', points: [[0, 0, null]] }, '/points/0/2'],
    [{ kind: 'ellipse', points: [[0, 0, 0], [1, 0, 0], [1, 1, 0]] }, '/points'],
    [{ kind: 'rectangle', points: [[0, 0, 0], [1e6, 1e6, 1], [-1e6, 1e6, 0]] }, '/points'],
    [{ kind: 'marker', points: [[0, 0, 0]], text: 'ü'.repeat(101) }, '/text'],
    [{ kind: 'marker', points: [[0, 0, 0]], text: 'a\u0007' }, '/text'],
    [{ kind: 'marker', points: [[0, 0, 0]], color: 'red' }, '/color'],
    [{ kind: 'marker', points: [[0, 0, 0]], value: 7 }, '/value'],
    [{ kind: 'part', points: [[0, 0, 0]] }, '/range'],
    [{ kind: 'path', points: [[0, 0, 0], [1, 1, 1]], range: [2, 1] }, '/range'],
    [{ kind: 'marker', points: [[0, 0, 0]], range: [0, 1] }, '/range'],
  ];
  for (const [params, pointer] of cases) await refused(stream.call('measure.put', params), -32602, pointer);
  await refused(stream.call('measure.remove', { id: 'none' }), -32002, '/id');
  assert.deepEqual(await list(session.id), []);
  // First the limit per second applies, then the limit of the session. Each try waits for an answer, so nothing sleeps.
  let made = 0;
  let limited = 0;
  for (let reason = ''; !reason.includes('may have');) {
    try {
      await stream.call('measure.put', { kind: 'marker', points: [[0, 0, 0]] });
      made += 1;
    } catch (error) {
      assert.equal(error.code, -32005);
      reason = error.message;
      limited += reason.includes('per second');
    }
  }
  assert.equal(made, 100);
  assert.ok(limited > 0);
  await stream.end();
});

test('the list is exported as JSON and CSV, without formulas', async () => {
  const session = await daemon.session({ volume: 'cube' });
  const stream = await daemon.stream({ session });
  await stream.call('stream.configure', { name: '+evil' });
  await stream.call('measure.put', { id: 'm1', color: '#FF8000', text: '=1+1, "x"', ...SQUARE });
  const csv = await daemon.fetch(`/api/v1/sessions/${session.id}/measures?format=csv`, { token: session.tokens.view });
  assert.match(csv.headers.get('content-type'), /^text\/csv/);
  assert.match(csv.headers.get('content-disposition'), /measures\.csv/);
  const [header, line, end] = (await csv.text()).split('\r\n');
  assert.equal(header, 'id,kind,volume,text,author,color,hidden,value,unit,count,nonfinite,mean,deviation,min,max,outside,note,x1,y1,z1,x2,y2,z2,x3,y3,z3,low,high,area,samples,straight,data_unit');
  assert.match(line, /^m1,rectangle,cube,"'=1\+1, ""x""","'\+evil",#ff8000,false,8,mm\^2,9,0,21,3\.5\d*,16,26,0,,0,0,1,4,0,1,0,2,1,,,,,,HU$/);
  assert.equal(end, '');
  assert.equal((await list(session.id, session.tokens.view))[0].text, '=1+1, "x"');
  assert.equal((await daemon.fetch(`/api/v1/sessions/${session.id}/measures?format=xml`)).status, 400);
  assert.equal((await daemon.fetch(`/api/v1/sessions/${session.id}/measures`, { token: 'wrong' })).status, 401);
  await stream.end();
});

test('measurements go to forks and survive a restart', async () => {
  const session = await daemon.session({ volume: 'cube' });
  const stream = await daemon.stream({ session });
  await stream.call('measure.put', { id: 'm1', text: 'Ünïcode', ...SQUARE });
  await stream.call('measure.put', { id: 'm2', kind: 'marker', points: [[900, 0, 0]], hidden: true });
  const before_ = await list(session.id);
  assert.equal(before_[1].value, null);
  const fork = await daemon.post('/api/v1/sessions', { from: session.id }, { token: session.tokens.control });
  assert.equal(fork.status, 201);
  assert.deepEqual(await list(fork.json.id), before_);
  await stream.call('measure.remove', { id: 'm2' });
  assert.equal((await list(fork.json.id)).length, 2, 'the fork has its own list');
  await stream.end();
  assert.equal(await daemon.stop(), 0);
  daemon = await start();
  assert.deepEqual(await list(session.id), before_.slice(0, 1));
  assert.deepEqual(await list(fork.json.id), before_);
  const again = await daemon.stream({ session });
  assert.deepEqual((await again.note('session.measures')).params.ids, ['m1']);
  assert.equal((await again.call('measure.put', { id: 'm1', points: [[0, 0, 0], [2, 0, 0], [0, 1, 0]] })).value, 2);
  await again.end();
});
