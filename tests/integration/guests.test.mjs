// SPDX-License-Identifier: Apache-2.0
// A join token reads all that the host knows of the volumes that the view names, and nothing of other volumes. A token that may only watch
// changes nothing.
import assert from 'node:assert/strict';
import { mkdirSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { Daemon, nrrd } from './harness.mjs';

let folder;
let daemon;
let session;

before(async () => {
  folder = mkdtempSync(path.join(tmpdir(), 'splatd-guests-'));
  mkdirSync(path.join(folder, 'study'));
  writeFileSync(path.join(folder, 'study', 'scan.nrrd'), nrrd());
  writeFileSync(path.join(folder, 'study', 'secret.nrrd'), nrrd());
  daemon = await Daemon.start(['--volume', path.join(folder, 'study', 'scan.nrrd'), '--volume', path.join(folder, 'study', 'secret.nrrd'), '--volume', 'demo:engine?size=16',
    '--data', path.join(folder, 'study'), '--state', path.join(folder, 'state')], { backend: 'cpu' });
  for (const id of ['scan', 'secret', 'engine']) await daemon.loaded(id);
  session = await daemon.session({ volume: 'scan', size: [32, 32] });
});
after(async () => {
  assert.equal(await daemon.stop(), 0);
  rmSync(folder, { recursive: true });
});

const at = (rest, { id } = session) => `/api/v1/sessions/${id}/${rest}`;
const read = async (rest, token, of) => {
  const { status, json } = await daemon.json(at(rest, of), { token });
  return { status, json };
};
const ids = async (token, of) => (await read('volumes', token, of)).json.volumes.map(({ id }) => id);

test('a join token reads what the daemon tells of the volume, but not who else uses it, nor where it lies', async () => {
  const { json: host } = await daemon.json('/api/v1/volumes/scan');
  const { uses, sessions, may_close: mayClose, memory, ...known } = host;
  assert.deepEqual([mayClose, typeof uses, sessions, typeof memory], [true, 'number', 0, 'object']);
  const { json: view } = await daemon.json('/api/v1/volumes/scan/view');
  for (const token of Object.values(session.tokens)) {
    const { status, json: { memory: now, ...seen } } = await read('volumes/scan', token);
    assert.deepEqual([status, seen], [200, { ...known, may_close: false }]);
    assert.equal(now.voxels, memory.voxels);
    assert.deepEqual((await read('volumes/scan/view', token)).json, view);
    const { json: list } = await read('volumes', token);
    const { json: { volumes: [first] } } = await daemon.json('/api/v1/volumes');
    assert.deepEqual(list, { volumes: [{ ...first, may_close: false }] });
    assert.ok(!JSON.stringify(list).includes(folder));
  }
});

test('it reads no other volume, file or session', async () => {
  const other = await daemon.session({ volume: 'secret', size: [32, 32] });
  for (const token of Object.values(session.tokens)) {
    for (const id of ['secret', 'engine', 'nosuch', 'scan%20', 'x'.repeat(127)]) {
      for (const rest of [`volumes/${id}`, `volumes/${id}/view`]) {
        const { status, json } = await read(rest, token);
        assert.equal(status, 404, rest);
        assert.match(json.detail, /the session's view names no volume/, 'the same, whether or not the daemon has the volume');
      }
    }
    for (const rest of ['', 'volumes', 'volumes/secret', 'volumes/secret/view', 'histogram', 'slice?axis=2&index=0', 'measures']) {
      assert.equal((await read(rest, token, other)).status, 401, rest);
    }
    for (const target of ['volumes', 'volumes/scan', 'volumes/scan/view', 'volumes/scan/histogram', 'volumes/scan/slice?axis=2&index=0', 'files', 'uploads', 'sessions', 'views', 'presets', 'paths']) {
      assert.equal((await daemon.json(`/api/v1/${target}`, { token })).status, 401, target);
    }
  }
  assert.equal((await daemon.json(at('volumes/scan'), { token: null })).status, 401);
  assert.equal((await daemon.json(`/api/v1/sessions/${'0'.repeat(16)}/volumes`, { token: session.tokens.view })).status, 401);
  assert.equal((await daemon.json(at('volumes', { id: '0'.repeat(16) }))).status, 404);
});

test('it learns of a volume as soon as the view or a layer names it, and no longer than that', async () => {
  const of = await daemon.session({ volume: 'scan', size: [32, 32] });
  const { view: token } = of.tokens;
  const host = await daemon.stream({ session: of });
  assert.deepEqual(await ids(token, of), ['scan']);
  await host.update({ layers: [{ type: 'volume' }, { type: 'channel', id: 'secret' }] });
  assert.deepEqual(await ids(token, of), ['scan', 'secret']);
  assert.equal((await read('volumes/secret', token, of)).status, 200);
  await host.update({ volume: 'engine' });
  assert.deepEqual(await ids(token, of), ['engine']);
  assert.equal((await read('volumes/secret', token, of)).status, 404);
  await host.end();
});

test('a stream that may only watch is told of the volumes of its session alone, and changes nothing', async () => {
  const of = await daemon.session({ volume: 'engine', size: [32, 32] });
  const host = await daemon.stream({ session: of });
  const guest = await daemon.stream({ session: of, token: of.tokens.view });
  await guest.final(0);
  const told = (stream) => stream.notes.filter(({ method }) => method === 'volume.progress').map(({ params }) => params.volume);
  writeFileSync(path.join(folder, 'study', 'late.nrrd'), nrrd());
  assert.equal((await daemon.post('/api/v1/volumes', { path: 'late.nrrd' })).status, 202);
  await host.note('volume.progress', ({ volume, state }) => volume === 'late' && state === 'ready');
  await guest.call('ping');
  assert.deepEqual([...new Set(told(guest))], ['engine']);
  await host.update({ volume: 'late' });
  await guest.note('view.changed', ({ view }) => view.volume === 'late');
  await daemon.fetch('/api/v1/volumes/late', { method: 'DELETE' });
  await guest.note('volume.progress', ({ volume, state }) => volume === 'late' && state === 'unloaded');
  const { view } = await host.call('view.get');
  for (const [method, params] of [['view.update', { seq: 1, patch: { background: [1, 1, 1, 1] } }], ['time.stop', {}],
    ['measure.put', { kind: 'marker', points: [[1, 1, 1]] }], ['measure.remove', { id: 'x' }]]) {
    await assert.rejects(guest.call(method, params), { code: -32004 }, method);
  }
  assert.deepEqual((await host.call('view.get')).view, view);
  for (const [method, rest] of [['PATCH', ''], ['DELETE', ''], ['POST', 'measures'], ['PUT', 'measures/a'], ['DELETE', 'measures/a']]) {
    const body = method === 'DELETE' ? undefined : '{}';
    const answer = await daemon.fetch(at(rest, of).replace(/\/$/, ''), { method, token: of.tokens.view, body, headers: { 'Content-Type': 'application/json' } });
    assert.equal(answer.status, 403, `${method} ${rest}`);
  }
  for (const rest of ['volumes', 'volumes/engine', 'volumes/engine/view']) {
    const answer = await daemon.fetch(at(rest, of), { method: 'POST', body: '{}', headers: { 'Content-Type': 'application/json' } });
    assert.equal(answer.status, 405, rest);
  }
  await guest.end();
  await host.end();
});

test('a hibernated session tells guests the same after it resumes', async (context) => {
  const other = await Daemon.start(['--volume', 'demo:engine?size=16', '--volume', 'demo:phantom?size=16', '--sessions', '1', '--state', path.join(folder, 'small')], { backend: 'null' });
  context.after(() => other.stop());
  for (const id of ['engine', 'phantom']) await other.loaded(id);
  const slices = { mode: 'oblique', in_3d: true, planes: { i: true, j: false, k: true }, position: [3, 4, 5], normal: [0, 0.6, 0.8], window: { center: 50, width: 20 }, colors: 'viridis' };
  const { id, tokens: { view: token }, view } = await other.session({ volume: 'phantom', layers: [{ type: 'volume' }, { type: 'surface', value: 0.2 }], slices });
  assert.equal((await other.post(`/api/v1/sessions/${id}/measures`, { kind: 'marker', points: [[1, 2, 3]] })).status, 201);
  const all = async () => Promise.all(['', '/volumes', '/volumes/phantom', '/volumes/phantom/view', '/measures'].map(async (rest) => {
    const { status, json } = await other.json(`/api/v1/sessions/${id}${rest}`, { token });
    return [status, json];
  }));
  const before = await all();
  assert.deepEqual([before.map(([status]) => status), before[0][1].view], [[200, 200, 200, 200, 200], view]);
  for (;;) { // the session is saved soon; then it gives way to another one
    const { status } = await other.post('/api/v1/sessions', { view: { volume: 'engine' } });
    if (status === 201) break;
    assert.equal(status, 503);
  }
  const { json: { sessions } } = await other.json('/api/v1/sessions');
  assert.equal(sessions.find((session_) => session_.id === id).hibernated, true);
  for (;;) { // and the other one has to be saved in turn
    const { status } = await other.json(`/api/v1/sessions/${id}/volumes`, { token });
    if (status === 200) break;
    assert.equal(status, 503);
  }
  const memory = (answers) => JSON.parse(JSON.stringify(answers, (key, value) => (key === 'memory' ? undefined : value)));
  assert.deepEqual(memory(await all()), memory(before));
});
