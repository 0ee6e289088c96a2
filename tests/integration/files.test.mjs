// SPDX-License-Identifier: Apache-2.0
// The data folder as clients see it: listings, links, ids, and what happens to sessions when a volume is closed.
import assert from 'node:assert/strict';
import { copyFileSync, mkdirSync, mkdtempSync, rmSync, symlinkSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { Daemon, nrrd, within } from './harness.mjs';

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
      { name: 'bad.nrrd', kind: 'volume', bytes: 67, format: 'NRRD', contents: 'grid', dims: [9, 9, 9], type: 'uint8' },
      { name: 'größe.nrrd', kind: 'volume', bytes: nrrd().length, format: 'NRRD', contents: 'grid', dims: [4, 4, 4], type: 'uint8' },
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
    ['bad.nrrd', /is a file, not a folder/],
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
  // The answer does not tell what exists outside.
  symlinkSync('../outside/none.nrrd', at('nowhere.nrrd'));
  for (const name of ['secret.nrrd', 'nowhere.nrrd', 'circle']) {
    for (const [pointer, answer] of [['/source', await daemon.post('/api/v1/volumes', { source: name })], ['/path', await list(`?path=${name}`)],
      ['/path', await daemon.json(`/api/v1/files/series?path=${name}`)]]) {
      assert.deepEqual([answer.status, answer.json.pointer, answer.json.detail], [404, pointer,
        `'${name}' is a symbolic link that leads out of the data folder or to nothing; only what lies below the data folder can be opened`]);
    }
  }
  for (const name of ['secret.nrrd', 'absent.nrrd']) {
    const answer = await daemon.post('/api/v1/volumes', { path: `out/${name}` });
    assert.equal(answer.json.pointer, '/path');
    assert.match(answer.json.detail, /'out' is a symbolic link/);
  }
});

test('the DICOM series of a folder are listed and opened', async () => {
  const dicom = (name) => path.join(import.meta.dirname, '../unit/data/import/dicom', name);
  mkdirSync(at('study', 'a'), { recursive: true });
  mkdirSync(at('study', 'b'));
  for (let k = 0; k < 4; k++) copyFileSync(dicom(`series${k}.dcm`), at('study', 'a', `IM${k}`)); // without an extension
  copyFileSync(dicom('rle.dcm'), at('study', 'b', '1.2.840.4'));
  writeFileSync(at('study', 'readme.txt'), 'text');
  const uid = '1.2.826.0.1.3680043.8.498.1';
  const { status, json } = await daemon.json('/api/v1/files/series?path=study');
  assert.equal(status, 200);
  const sizes = json.series.map(({ bytes }) => bytes);
  assert.ok(sizes.every((bytes) => bytes > 500));
  assert.deepEqual(json.series, [
    { source: `study?series=${uid}`, uid, modality: 'CT', images: 4, size: [16, 12], bytes: sizes[0] },
    { source: `study?series=${uid}.4`, uid: `${uid}.4`, modality: 'CT', images: 1, size: [16, 12], bytes: sizes[1] },
  ]);
  const { json: opened } = await daemon.post('/api/v1/volumes', { source: json.series[1].source, name: 'the small one' });
  assert.deepEqual((await daemon.loaded(opened.id)).dims, [16, 12, 1]);
  const { json: whole } = await daemon.post('/api/v1/volumes', { source: 'study' });
  const loaded = await daemon.loaded(whole.id);
  assert.deepEqual(loaded.dims, [16, 12, 4]);
  assert.match(loaded.warnings[0], /largest of 2/);
  assert.deepEqual(names(await list('?path=study/a')), ['IM0', 'IM1', 'IM2', 'IM3']);
  assert.deepEqual(names(await list('?path=study/b')), ['1.2.840.4']);
  assert.deepEqual((await daemon.json('/api/v1/files/series?path=scans')).json, { series: [] });
  for (const [where, code] of [['out', 404], ['absent', 404], ['/etc', 422], ['..', 404]])
    assert.equal((await daemon.json(`/api/v1/files/series?path=${encodeURIComponent(where)}`)).status, code, where);
  rmSync(at('study'), { recursive: true });
});

test('a search finds names below a folder, with their folders', async () => {
  const odd = ['a*b.nrrd', 'with space.nrrd', 'why?.nrrd', '100% & #1.nrrd', 'Übung.nrrd', 'x?level=1.nrrd'];
  mkdirSync(at('find', 'deep', 'größe & co'), { recursive: true });
  mkdirSync(at('find', '.hidden'));
  for (const name of odd) writeFileSync(at('find', 'deep', 'größe & co', name), nrrd());
  for (const name of ['.hidden/why?.nrrd', 'deep/.why?.nrrd', 'deep/why?.txt']) writeFileSync(at('find', name), nrrd());
  for (let i = 1; i < 4; i++) writeFileSync(at('find', `step${i}.nrrd`), nrrd());
  symlinkSync('../../../outside', at('find', 'deep', 'way out'));
  symlinkSync('../..', at('find', 'deep', 'way up'));
  const search = (text, more = '') => list(`?path=find&find=${encodeURIComponent(text)}${more}`);
  const place = 'find/deep/größe & co';
  for (const [text, name] of [['A*B', odd[0]], ['H SPACE', odd[1]], ['why?', odd[2]], ['100%', odd[3]], ['#1', odd[3]], ['übung', odd[4]], ['UBUNG', odd[4]], ['?level=1', odd[5]]]) {
    const { status, json } = await search(text);
    assert.equal(status, 200, text);
    assert.deepEqual(json, {
      entries: [{ name, kind: 'volume', bytes: nrrd().length, format: 'NRRD', dims: [4, 4, 4], type: 'uint8', contents: 'grid', folder: place }], unlisted: 0, unread: 0,
    });
    const { json: opened } = await daemon.post('/api/v1/volumes', { source: `${place}/${name}` });
    assert.equal((await daemon.loaded(opened.id)).state, 'ready', name);
    assert.equal((await daemon.fetch(`/api/v1/volumes/${opened.id}`, { method: 'DELETE' })).status, 204);
  }
  assert.deepEqual((await search('GRÖSSE')).json.entries, []);
  assert.deepEqual((await search('größe')).json.entries, [{ name: 'größe & co', kind: 'folder', folder: 'find/deep' }]);
  assert.deepEqual((await search('secret')).json.entries, [], 'outside');
  assert.deepEqual((await search('step')).json.entries, [{ name: 'step*.nrrd', kind: 'volume', bytes: 3 * nrrd().length, format: 'NRRD', folder: 'find', files: 3 }]);
  assert.deepEqual(names(await search('step2')), ['step2.nrrd']);
  const cut = await search('nrrd', '&limit=2');
  assert.deepEqual([cut.json.entries.length, cut.json.cut, cut.json.next], [2, 'limit', undefined]);
  for (const [query, status, detail] of [['find=', 400, /must have 1 to 255 characters/], ['find=%20', 400, /not only spaces/], [`find=${'x'.repeat(256)}`, 400, /1 to 255/],
    ['find=a&after=b', 422, /has one page/], ['find=a&limit=0', 400, /limit/], ['find=a&path=out', 404, /leads out/], ['find=a&path=absent', 404, /no such folder/],
    ['find=a&path=/etc', 422, /must be relative/], ['find=a&path=bad.nrrd', 422, /is a file/]]) {
    const answer = await list(`?${query}`);
    assert.equal(answer.status, status, query);
    assert.match(answer.json.detail, detail, query);
  }
  rmSync(at('find'), { recursive: true });
});

test('listing needs the role control and a data folder', async () => {
  const tokens = path.join(folder, 'tokens');
  writeFileSync(tokens, 'render-token-render-token role=render name=r\ncontrol-token-control role=control name=c\n', { mode: 0o600 });
  const other = await Daemon.start(['--token-file', tokens]);
  for (const query of ['', '?find=a']) assert.equal((await other.json(`/api/v1/files${query}`, { token: 'render-token-render-token' })).status, 403);
  assert.match((await other.json('/api/v1/files?find=a', { token: 'control-token-control' })).json.detail, /--data DIR/);
  const { tokens: joins } = (await other.post('/api/v1/sessions', {}, { token: 'control-token-control' })).json;
  for (const token of Object.values(joins ?? {})) assert.equal((await other.json('/api/v1/files?find=a', { token })).status, 403);
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
  // The last frame may still hold the volume.
  const isFreed = async () => /^splatd_memory_bytes\{kind="voxels"\} 0$/m.test(await (await own.fetch('/metrics')).text());
  await within((async () => { while (!await isFreed()); })(), 'memory that is freed');
  assert.equal(await own.stop(), 0);
});

test('another field of a volume is loaded from its file, wherever that lies', async () => {
  const table = `x,y,z,heat,age\n${Array.from({ length: 50 }, (_, i) => `${i % 5},${Math.floor(i / 5)},0,${i},${100 + i}`).join('\n')}\n`;
  writeFileSync(at('scans', 'größe', 'inside.csv'), table);
  writeFileSync(path.join(folder, 'outside', 'apart.csv'), table);
  const own = await Daemon.start(['--data', at(), '--volume', path.join(folder, 'outside', 'apart.csv'), '--volume', 'demo:engine?size=8', '--state', path.join(folder, 'fields')]);
  assert.equal((await own.post('/api/v1/volumes', { source: 'scans/größe/inside.csv' })).status, 202);
  for (const name of ['apart', 'inside']) {
    assert.deepEqual((await own.loaded(name)).other_fields, ['age'], name);
    const { status, json } = await own.post('/api/v1/volumes', { volume: name, field: 'age' });
    assert.deepEqual([status, json.id, json.name], [202, `${name}-age`, `${name} age`]);
    const volume = await own.loaded(json.id);
    assert.deepEqual([volume.state, volume.range, volume.other_fields, volume.format], ['ready', [100, 149], ['heat'], 'CSV'], volume.reason);
    for (const [field, id] of [['age', json.id], ['heat', name]]) {
      const back = await own.post('/api/v1/volumes', { volume: json.id, field });
      assert.deepEqual([back.status, back.json.id], [201, id]);
    }
    const wrong = await own.post('/api/v1/volumes', { volume: name, field: 'no such' });
    const failed = await own.loaded(wrong.json.id);
    assert.deepEqual([failed.state, failed.reason.includes('no such')], ['failed', true], failed.reason);
  }
  // Vectors: others of the file, their lengths and components.
  writeFileSync(at('scans', 'storm.vtk'), `# vtk DataFile Version 3.0\n\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\nPOINT_DATA 8\nSCALARS heat float\nLOOKUP_TABLE default\n${
    '1 2 3 4 5 6 7 8'}\nVECTORS wind float\n${'1 2 2 '.repeat(8)}\nVECTORS flow float\n${'0 3 4 '.repeat(8)}\n`);
  assert.equal((await own.post('/api/v1/volumes', { source: 'scans/storm.vtk' })).status, 202);
  await own.loaded('storm');
  for (const [body, id, field, names] of [
    [{ volume: 'storm', field: 'wind y' }, 'storm-wind-y', 'wind y', ['flow']],
    [{ volume: 'storm-wind-y', vectors: 'flow' }, 'storm-flow', 'heat', ['wind']], // which has no wind
    [{ volume: 'storm', vectors: 'flow', field: 'magnitude' }, 'storm-magnitude-flow', 'magnitude', ['wind']],
    [{ volume: 'storm-magnitude-flow', field: 'heat' }, 'storm-flow', 'heat', ['wind']],
    [{ volume: 'storm-flow', vectors: 'wind' }, 'storm', 'heat', ['flow']]]) {
    const answer = await own.post('/api/v1/volumes', body);
    assert.equal(answer.json.id, id, JSON.stringify([body, answer.json]));
    const volume = await own.loaded(id);
    assert.deepEqual([volume.state, volume.fields[0].name, volume.other_vectors], ['ready', field, names], volume.reason);
  }
  // Clients get a warning where the volume differs from the file; the log has it once.
  writeFileSync(at('scans', 'half.csv'), 'x,y,z,heat\n0,0,0,1\n1,0,0,\n');
  assert.equal((await own.post('/api/v1/volumes', { source: 'scans/half.csv' })).status, 202);
  const sentence = '1 of the 2 points are not drawn, because their position, value or size is not a finite number.';
  assert.deepEqual((await own.loaded('half')).warnings, [sentence]);
  const listed = (await own.json('/api/v1/volumes')).json.volumes;
  assert.deepEqual(listed.map(({ id, warnings }) => [id, warnings?.length]).filter(([, count]) => count), [['half', 1]]);
  assert.equal(own.log.split(`volume half: ${sentence}`).length, 2, own.log);
  // Requests that need a grid of samples are refused, not ignored.
  const slice = await own.json('/api/v1/volumes/half/slice?axis=2&index=0');
  assert.deepEqual([slice.status, slice.json.detail], [422, 'slices need a grid of samples, and this volume has points']);
  for (const [kind, points] of [['profile', [[0, 0, 0], [1, 1, 1]]], ['rectangle', [[0, 0, 0], [1, 0, 0], [0, 1, 0]]], ['part', [[0, 0, 0]]]]) {
    const answer = await own.post('/api/v1/measure', { volume: 'half', kind, points, ...(kind === 'part' ? { range: [0, 1] } : {}) });
    assert.deepEqual([answer.status, answer.json.pointer], [422, '/kind'], kind);
  }
  assert.equal((await own.post('/api/v1/measure', { volume: 'half', kind: 'distance', points: [[0, 0, 0], [1, 1, 1]] })).status, 200);
  for (const [change, pointer] of [[{ layers: [{ type: 'surface', value: 1 }] }, '/layers/0/type'], [{ layers: [{ type: 'points' }, { type: 'shell', low: 0.1, high: 0.9 }] }, '/layers/1/type'],
    [{ edits: [{ type: 'sphere', center: [0, 0, 0], radius: 1 }] }, '/edits'], [{ slices: { in_3d: true } }, '/slices/in_3d']]) {
    const answer = await own.post('/api/v1/render', { volume: 'half', ...change });
    assert.deepEqual([answer.status, answer.json.pointer], [422, pointer], JSON.stringify(change));
  }
  // An upload, whose file stays while one of the volumes needs it.
  const upload = await own.post('/api/v1/uploads', { name: 'sent.csv', bytes: table.length });
  await own.fetch(`/api/v1/uploads/${upload.json.id}`, { method: 'PATCH', body: table, headers: { 'Content-Type': 'application/offset+octet-stream', 'Upload-Offset': '0', 'Tus-Resumable': '1.0.0' } });
  const first = await own.post('/api/v1/volumes', { upload: upload.json.id });
  assert.equal((await own.loaded(first.json.id)).state, 'ready');
  const second = await own.post('/api/v1/volumes', { volume: first.json.id, field: 'age' });
  assert.equal(second.status, 202, JSON.stringify(second.json));
  assert.deepEqual((await own.loaded(second.json.id)).range, [100, 149]);
  const uploaded = async () => (await own.json(`/api/v1/uploads/${upload.json.id}`)).status;
  await own.fetch(`/api/v1/volumes/${first.json.id}`, { method: 'DELETE' });
  assert.equal(await uploaded(), 200);
  await own.fetch(`/api/v1/volumes/${second.json.id}`, { method: 'DELETE' });
  assert.equal(await uploaded(), 404);
  for (const [body, status, pointer] of [[{ volume: 'engine', field: 'x' }, 422, '/volume'], [{ volume: 'none', field: 'x' }, 404, '/volume'], [{ volume: 'inside' }, 422, '/field'],
    [{ field: 'age' }, 422, '/field'], [{ vectors: 'age' }, 422, '/vectors'], [{ volume: 'inside', vectors: '' }, 422, '/vectors'], [{ volume: 'inside', field: 'age', source: 'größe.nrrd' }, 422, '/source']]) {
    const refused = await own.post('/api/v1/volumes', body);
    assert.deepEqual([refused.status, refused.json.pointer], [status, pointer], JSON.stringify(body));
  }
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
