// SPDX-License-Identifier: Apache-2.0
// The data folder as clients see it: listings, links, ids, and what happens to sessions when a volume is closed.
import assert from 'node:assert/strict';
import { mkdirSync, mkdtempSync, rmSync, symlinkSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { Daemon, nrrd } from './harness.mjs';

let daemon;
let folder;
const at = (...names) => path.join(folder, 'data', ...names);
const list = (query = '') => daemon.json(`/api/v1/files${query}`);
const names = ({ json }) => json.entries.map((entry) => entry.name);

before(async () => {
  folder = mkdtempSync(path.join(tmpdir(), 'splatd-files-'));
  mkdirSync(at('scans', 'größe'), { recursive: true });
  mkdirSync(path.join(folder, 'outside'));
  writeFileSync(path.join(folder, 'outside', 'secret.nrrd'), nrrd());
  writeFileSync(at('größe.nrrd'), nrrd());
  writeFileSync(at('bad.nrrd'), 'NRRD0004\ntype: uint8\ndimension: 3\nsizes: 9 9 9\nencoding: raw\n\nshort');
  writeFileSync(at('readme.txt'), 'text');
  for (let i = 0; i < 5; i++) writeFileSync(at('scans', `${i}.nrrd`), nrrd());
  writeFileSync(Buffer.concat([Buffer.from(at('scans', 'bad')), Buffer.from([0xff]), Buffer.from('.nrrd')]), nrrd()); // not UTF-8
  symlinkSync('../outside', at('out'));
  symlinkSync('circle', at('circle'));
  symlinkSync('../outside/secret.nrrd', at('secret.nrrd'));
  daemon = await Daemon.start(['--volume', 'demo:engine?size=8', '--data', at()]);
  await daemon.loaded('engine');
});
after(async () => {
  assert.equal(await daemon.stop(), 0);
  rmSync(folder, { recursive: true });
});

test('a folder lists folders first, then loadable files with size, format and dims', async () => {
  const root = await list();
  assert.equal(root.status, 200);
  assert.deepEqual(root.json, {
    entries: [
      { name: 'scans', kind: 'folder' },
      { name: 'bad.nrrd', kind: 'volume', bytes: 67, format: 'NRRD', dims: [9, 9, 9], type: 'uint8' },
      { name: 'größe.nrrd', kind: 'volume', bytes: nrrd().length, format: 'NRRD', dims: [4, 4, 4], type: 'uint8' },
    ],
    unlisted: 0,
  });
  assert.deepEqual(names(await list('?path=scans/gr%C3%B6%C3%9Fe')), []);
});

test('a long folder comes in pages', async () => {
  const seen = [];
  for (let after = ''; after !== undefined;) {
    const page = await list(`?path=scans&limit=2&after=${encodeURIComponent(after)}`);
    assert.equal(page.status, 200);
    assert.ok(page.json.entries.length <= 2);
    assert.equal(page.json.unlisted, 1);
    seen.push(...names(page));
    after = page.json.next;
  }
  assert.deepEqual(seen, ['größe', '0.nrrd', '1.nrrd', '2.nrrd', '3.nrrd', '4.nrrd']);
});

test('what lies outside cannot be listed or loaded, and a link says that it leads out', async () => {
  for (const [where, detail] of [['out', /'out' is a symbolic link that leads out/], ['..', /no such folder/],
    ['../data', /no such folder/], ['absent', /no such folder/], ['scans/../../outside', /no such folder/]]) {
    const answer = await list(`?path=${encodeURIComponent(where)}`);
    assert.equal(answer.status, 404, where);
    assert.match(answer.json.detail, detail, where);
  }
  for (const [where, detail] of [[at(), /must be relative to the data folder/], [at('scans'), /must be relative/], ['/etc', /must be relative/],
    ['circle', /'circle' is a symbolic link that leads in a circle/], ['bad.nrrd', /is a file, not a folder/],
    ['x'.repeat(300), /a name of it more than 255/]]) {
    const answer = await list(`?path=${encodeURIComponent(where)}`);
    assert.deepEqual([answer.status, answer.json.pointer], [422, '/path'], where);
    assert.match(answer.json.detail, detail, where);
  }
  for (const member of ['source', 'path']) {
    const answer = await daemon.post('/api/v1/volumes', { [member]: at('größe.nrrd') });
    assert.deepEqual([answer.status, answer.json.pointer], [422, `/${member}`]);
    assert.match(answer.json.detail, /must be relative to the data folder/);
  }
  assert.match((await daemon.post('/api/v1/volumes', { source: 'x/'.repeat(2500) })).json.detail, /more than 4095 bytes/);
  assert.match((await daemon.post('/api/v1/volumes', { source: 'circle' })).json.detail, /leads in a circle/);
  const link = await daemon.post('/api/v1/volumes', { source: 'secret.nrrd' });
  assert.equal(link.status, 404);
  assert.equal(link.json.pointer, '/source');
  assert.match(link.json.detail, /'secret.nrrd' is a symbolic link that leads out of the data folder/);
  for (const name of ['secret.nrrd', 'absent.nrrd']) { // the answer does not tell what exists outside
    const answer = await daemon.post('/api/v1/volumes', { path: `out/${name}` });
    assert.equal(answer.json.pointer, '/path');
    assert.match(answer.json.detail, /'out' is a symbolic link/);
  }
});

test('listing needs the role control and a data folder', async () => {
  const tokens = path.join(folder, 'tokens');
  writeFileSync(tokens, 'render-token-render-token role=render name=r\ncontrol-token-control role=control name=c\n', { mode: 0o600 });
  const other = await Daemon.start(['--token-file', tokens]);
  assert.equal((await other.json('/api/v1/files', { token: 'render-token-render-token' })).status, 403);
  const none = await other.json('/api/v1/files', { token: 'control-token-control' });
  assert.equal(none.status, 403);
  assert.match(none.json.detail, /--data DIR/);
  assert.equal(await other.stop(), 0);
});

test('ids are plain and readable, names keep their letters', async () => {
  const answer = await daemon.post('/api/v1/volumes', { source: 'größe.nrrd' });
  assert.equal(answer.status, 202);
  assert.deepEqual([answer.json.id, answer.json.name, answer.json.source, answer.json.format], ['groesse', 'größe', 'größe.nrrd', 'NRRD']);
  assert.equal((await daemon.loaded('groesse')).state, 'ready');
  assert.equal((await daemon.post('/api/v1/volumes', { source: answer.json.source })).json.id, 'groesse');
  const demo = await daemon.post('/api/v1/volumes', { source: 'demo:phantom?size=8' });
  assert.equal(demo.status, 202);
  await daemon.loaded('phantom');
  for (const [body, pointer] of [[{ source: 'a', path: 'a' }, undefined], [{ uri: 'a.nrrd' }, '/uri'], [{ path: 'demo:engine' }, '/path'],
    [{ source: 'upload:x' }, '/source'], [{ source: '' }, '/source'], [{ source: 3 }, '/source']]) {
    const refused = await daemon.post('/api/v1/volumes', body);
    assert.equal(refused.status, 422, JSON.stringify(body));
    assert.equal(refused.json.pointer, pointer);
  }
});

test('a failed load has a short reason in the list, the whole one on demand, and can be removed', async () => {
  assert.equal((await daemon.post('/api/v1/volumes', { source: 'bad.nrrd' })).status, 202);
  const whole = await daemon.loaded('bad');
  assert.equal(whole.state, 'failed');
  assert.match(whole.reason, /^bad.nrrd: byte \d+/);
  const { json } = await daemon.json('/api/v1/volumes');
  const short = json.volumes.find((volume) => volume.id === 'bad');
  assert.ok(short.reason.length <= 105 && !short.reason.startsWith('bad.nrrd'), short.reason);
  assert.equal((await daemon.fetch('/api/v1/volumes/bad', { method: 'DELETE' })).status, 204);
  assert.equal((await daemon.json('/api/v1/volumes/bad')).status, 404);
});

test('a closed volume: its participants see another one, and the last one ends the session', async () => {
  const own = await Daemon.start(['--volume', 'demo:engine?size=8', '--volume', 'demo:phantom?size=8']);
  await own.loaded('phantom');
  const stream = await own.stream({ session: await own.session({ volume: 'phantom' }) });
  await stream.frame(() => true, 'a first frame');
  await own.session({ volume: 'phantom' }); // without participants
  const sessionsOf = async (id) => (await own.json(`/api/v1/volumes/${id}`)).json.sessions;
  assert.deepEqual([await sessionsOf('phantom'), await sessionsOf('engine')], [1, 0]);
  assert.equal((await own.fetch('/api/v1/volumes/phantom', { method: 'DELETE' })).status, 204);
  await stream.note('view.changed', ({ view }) => view.volume === 'engine');
  await stream.note('volume.progress', ({ volume, state }) => volume === 'phantom' && state === 'unloaded');
  assert.equal((await own.json('/api/v1/volumes/phantom')).status, 404);
  assert.equal(await sessionsOf('engine'), 1);
  const count = stream.frames.length;
  await stream.frame(() => true, 'a frame of the other volume', count);
  assert.equal((await own.fetch('/api/v1/volumes/engine', { method: 'DELETE' })).status, 204);
  await stream.until(() => stream.closed, 'the close').catch(() => {});
  assert.equal(stream.closed.code, 1000);
  assert.match(stream.closed.reason, /volume was closed/);
  assert.equal((await own.json(`/api/v1/sessions/${stream.session.id}`)).status, 404);
  const { body } = { body: await (await own.fetch('/metrics')).text() };
  assert.match(body, /^splatd_memory_bytes 0$/m);
  assert.equal(await own.stop(), 0);
});

test('a failed load does not survive a restart', async () => {
  const state = path.join(folder, 'state');
  const first = await Daemon.start(['--data', at(), '--state', state]);
  await first.post('/api/v1/volumes', { source: 'bad.nrrd' });
  await first.post('/api/v1/volumes', { source: 'größe.nrrd' });
  assert.equal((await first.loaded('bad')).state, 'failed');
  assert.equal((await first.loaded('groesse')).state, 'ready');
  assert.equal(await first.stop(), 0);
  const second = await Daemon.start(['--data', at(), '--state', state]);
  const { json } = await second.json('/api/v1/volumes');
  assert.deepEqual(json.volumes.map(({ id, name }) => [id, name]), [['groesse', 'größe']]);
  assert.equal(await second.stop(), 0);
});
