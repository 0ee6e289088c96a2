// SPDX-License-Identifier: Apache-2.0
// Uploads (tus 1.0): in parts, interrupted and continued, over limits, with lies and hostile files.
import assert from 'node:assert/strict';
import { createHash } from 'node:crypto';
import { chmodSync, mkdtempSync, readdirSync, readFileSync, rmSync, symlinkSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { Daemon, nrrd, Raw } from './harness.mjs';

const TYPE = 'application/offset+octet-stream';
let daemon;
let folder;
const uploads = () => path.join(folder, 'uploads');
const left = (at = uploads()) => readdirSync(at);

before(async () => {
  folder = mkdtempSync(path.join(tmpdir(), 'splatd-uploads-test-'));
  daemon = await Daemon.start(['--volume', 'demo:engine?size=8', '--upload-dir', uploads(), '--upload-bytes', '64M', '--uploads', '4']);
  await daemon.loaded('engine');
});
after(async () => {
  assert.equal(await daemon.stop(), 0);
  rmSync(folder, { recursive: true });
});

const create = (name, bytes, to = daemon, options = {}) => to.post('/api/v1/uploads', { name, bytes }, options);
const remove = (id, to = daemon) => to.fetch(`/api/v1/uploads/${id}`, { method: 'DELETE' });
const patch = (id, offset, body, headers = {}, to = daemon) => to.json(`/api/v1/uploads/${id}`,
  { method: 'PATCH', body, headers: { 'Content-Type': TYPE, 'Upload-Offset': String(offset), ...headers } });
const sum = (bytes, kind = 'sha1') => ({ 'Upload-Checksum': `${kind} ${createHash(kind).update(bytes).digest('base64')}` });

/** An NRRD file with side³ voxels of one byte. */
function cube(side) {
  const header = Buffer.from(`NRRD0004\ntype: uint8\ndimension: 3\nsizes: ${side} ${side} ${side}\nencoding: raw\n\n`);
  return Buffer.concat([header, Buffer.alloc(side ** 3, 7)]);
}

/** Resolves when the folder has `count` uploads; the disk thread removes files after the answer. */
async function settled(count, at = uploads(), to = daemon) {
  while (left(at).length > count) await to.json('/healthz');
}

test('OPTIONS says what is supported', async () => {
  const answer = await daemon.fetch('/api/v1/uploads', { method: 'OPTIONS' });
  assert.equal(answer.status, 204);
  assert.equal(answer.headers.get('tus-resumable'), '1.0.0');
  assert.equal(answer.headers.get('tus-version'), '1.0.0');
  assert.equal(answer.headers.get('tus-extension'), 'creation,expiration,checksum,termination');
  assert.match(answer.headers.get('tus-checksum-algorithm'), /sha1/);
  assert.equal(answer.headers.get('tus-max-size'), String(64 << 20));
});

test('a file is uploaded in parts, loaded, and its space is released', async () => {
  const file = cube(100);
  const created = await create('C:\\scans\\größe.nrrd', file.length);
  assert.equal(created.status, 201);
  const { id } = created.json;
  assert.equal(created.headers.get('location'), `uploads/${id}`);
  assert.deepEqual([created.json.name, created.json.offset, created.json.bytes], ['größe.nrrd', 0, file.length]);
  assert.match(created.headers.get('upload-expires'), / GMT$/);
  const early = await daemon.post('/api/v1/volumes', { upload: id });
  assert.equal(early.status, 409);
  assert.match(early.json.detail, /0 of 1000\d\d\d bytes/);
  for (let at = 0; at < file.length; at += 300000) {
    const answer = await patch(id, at, file.subarray(at, at + 300000), { 'Tus-Resumable': '1.0.0' });
    assert.equal(answer.status, 204);
    assert.equal(answer.headers.get('upload-offset'), String(Math.min(at + 300000, file.length)));
  }
  const head = await daemon.fetch(`/api/v1/uploads/${id}`, { method: 'HEAD' });
  assert.deepEqual([head.status, head.headers.get('upload-offset'), head.headers.get('cache-control')], [200, String(file.length), 'no-store']);
  const volume = await daemon.post('/api/v1/volumes', { upload: id });
  assert.equal(volume.status, 202);
  assert.deepEqual([volume.json.id, volume.json.name, volume.json.source], ['groesse', 'größe', 'upload:größe.nrrd']);
  assert.deepEqual((await daemon.loaded('groesse')).dims, [100, 100, 100]);
  await settled(0);
  assert.equal((await daemon.json(`/api/v1/uploads/${id}`)).status, 404);
  assert.deepEqual((await daemon.json('/api/v1/uploads')).json, { uploads: [], bytes: 0, bytes_max: 64 << 20, bytes_free: 64 << 20, uploads_free: 4 });
  assert.equal((await daemon.fetch('/api/v1/volumes/groesse', { method: 'DELETE' })).status, 204);
});

test('the file of a time series stays while its volume is open: a view may ask for each step', async () => {
  const header = Buffer.from('NRRD0004\ntype: uint8\ndimension: 4\nsizes: 4 4 4 3\nkinds: domain domain domain time\nencoding: raw\n\n');
  const file = Buffer.concat([header, ...[10, 20, 30].map((value) => Buffer.alloc(64, value))]);
  const { id } = (await create('series.nrrd', file.length)).json;
  assert.equal((await patch(id, 0, file)).status, 204);
  assert.equal((await daemon.post('/api/v1/volumes', { upload: id })).status, 202);
  assert.equal((await daemon.loaded('series')).steps.count, 3);
  for (const [step, value] of [[2, 30], [1, 20], [0, 10]]) {
    let answer;
    do answer = await daemon.fetch(`/api/v1/volumes/series/slice?axis=2&index=0&format=raw&step=${step}`); while (answer.status === 409 && answer.headers.get('retry-after'));
    assert.deepEqual([answer.status, Buffer.from(await answer.arrayBuffer())[0]], [200, value], `step ${step}`);
  }
  assert.equal((await daemon.fetch('/api/v1/volumes/series', { method: 'DELETE' })).status, 204);
  await settled(0);
});

test('a tus client creates an upload with headers', async () => {
  const metadata = `type dGV4dA==,filename ${Buffer.from('../../x.vti').toString('base64')}`;
  const made = await daemon.json('/api/v1/uploads', { method: 'POST', headers: { 'Tus-Resumable': '1.0.0', 'Upload-Length': '10', 'Upload-Metadata': metadata } });
  assert.equal(made.status, 201);
  assert.equal(made.json.name, 'x.vti');
  assert.equal((await remove(made.json.id)).status, 204);
  await settled(0);
  for (const [headers, status] of [[{ 'Tus-Resumable': '0.2.2', 'Upload-Length': '10' }, 412], [{ 'Upload-Length': '-1' }, 400],
    [{ 'Upload-Length': '10' }, 400], [{ 'Upload-Length': '10', 'Upload-Metadata': 'filename !!' }, 400], [{ 'Upload-Defer-Length': '1' }, 400],
    [{ 'Upload-Length': '0', 'Upload-Metadata': metadata }, 400]]) {
    const answer = await daemon.json('/api/v1/uploads', { method: 'POST', headers });
    assert.equal(answer.status, status, JSON.stringify(headers));
  }
});

test('an upload says when its file was changed, as JSON and tus clients tell it', async () => {
  const post = (body) => daemon.json('/api/v1/uploads', { method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify({ name: 'x.nrrd', bytes: 10, ...body }) });
  const made = await post({ modified: 1764000000123 });
  assert.deepEqual([made.status, made.json.modified], [201, 1764000000123]);
  assert.equal((await daemon.json(`/api/v1/uploads/${made.json.id}`)).json.modified, 1764000000123);
  await remove(made.json.id);
  const word = (text) => Buffer.from(text).toString('base64');
  const tus = (modified) => daemon.json('/api/v1/uploads', { method: 'POST', headers: { 'Upload-Length': '10', 'Upload-Metadata': `filename ${word('x.nrrd')},modified ${word(modified)}` } });
  const other = await tus('77');
  assert.deepEqual([other.status, other.json.modified], [201, 77]);
  await remove(other.json.id);
  await settled(0);
  for (const modified of ['0', '-1', '1.5', 'x', '']) assert.equal((await tus(modified)).status, 400, modified);
  for (const modified of [0, -1, 1.5, '1', null]) {
    const answer = await post({ modified });
    assert.deepEqual([answer.status, answer.json.pointer], [422, '/modified'], String(modified));
  }
});

test('names of files that cannot be loaded, and sizes that cannot be, are refused at once', async () => {
  for (const [name, detail] of [['x.exe', /must end in/], ['nrrd', /must end in/], ['x.raw', /together with it \("header"/], ['a/', /name of a file/], ['\u202e', /name of a file/]]) {
    const answer = await create(name, 10);
    assert.deepEqual([answer.status, answer.json.pointer], [422, '/name'], name);
    assert.match(answer.json.detail, detail);
  }
  for (const bytes of [0, -1, 1.5, '1', null]) assert.equal((await create('x.nrrd', bytes)).json.pointer, '/bytes');
  const large = await create('x.nrrd', (64 << 20) + 1);
  assert.deepEqual([large.status, large.json.pointer], [413, '/bytes']);
  assert.match(large.json.detail, /--upload-bytes allows 67108864/);
});

test('limits of all uploads together: bytes and number', async () => {
  const ids = [];
  for (let i = 0; i < 3; i++) ids.push((await create('x.nrrd', 20 << 20)).json.id);
  const full = await create('x.nrrd', 20 << 20);
  assert.equal(full.status, 507);
  assert.match(full.json.detail, /the uploads of all have 62914560 .*so 4194304 are free; close uploaded volumes, cancel/);
  ids.push((await create('x.nrrd', 1)).json.id);
  const many = await create('x.nrrd', 1);
  assert.equal(many.status, 507);
  assert.match(many.json.detail, /--uploads allows 4/);
  for (const id of ids) assert.equal((await remove(id)).status, 204);
  await settled(0);
});

test('an interrupted upload continues where its bytes end, and a wrong offset is told the right one', async () => {
  const file = cube(100);
  const { id } = (await create('x.nrrd', file.length)).json;
  const raw = await Raw.connect(daemon.port);
  raw.write(`PATCH /api/v1/uploads/${id} HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer ${daemon.token}\r\nContent-Type: ${TYPE}\r\n`
    + `Upload-Offset: 0\r\nContent-Length: ${file.length}\r\n\r\n`);
  raw.write(file.subarray(0, 700000));
  const offset = async () => Number((await daemon.json(`/api/v1/uploads/${id}`)).json.offset);
  while (await offset() < 512 * 1024) ; // two blocks are on the disk
  raw.destroy();
  while (await offset() < 700000) ; // what had arrived counts
  const wrong = await patch(id, 0, file);
  assert.deepEqual([wrong.status, wrong.headers.get('upload-offset')], [409, '700000']);
  assert.equal((await patch(id, 700000, file.subarray(700000))).status, 204);
  assert.deepEqual(readFileSync(path.join(uploads(), id, 'files', 'data.nrrd')), file);
  assert.equal((await remove(id)).status, 204);
  await settled(0);
});

test('a request replaces an older one of the same upload whose connection hangs', async () => {
  const file = cube(100);
  const { id } = (await create('x.nrrd', file.length)).json;
  const raw = await Raw.connect(daemon.port);
  raw.write(`PATCH /api/v1/uploads/${id} HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer ${daemon.token}\r\nContent-Type: ${TYPE}\r\n`
    + `Upload-Offset: 0\r\nContent-Length: ${file.length}\r\n\r\n`);
  raw.write(file.subarray(0, 300000));
  let offset = 0;
  while (offset < 256 * 1024) ({ offset } = (await daemon.json(`/api/v1/uploads/${id}`)).json);
  assert.equal((await patch(id, offset, file.subarray(offset))).status, 204);
  raw.write(Buffer.alloc(file.length - 300000)); // zeros: they must not reach the file
  await raw.until(() => raw.text().includes('\r\n\r\n'), 'the answer');
  assert.match(raw.text(), /^HTTP\/1.1 409 /);
  raw.destroy();
  assert.deepEqual(readFileSync(path.join(uploads(), id, 'files', 'data.nrrd')), file);
  await remove(id);
  await settled(0);
});

test('bytes with a wrong checksum do not count', async () => {
  const file = cube(80);
  const { id } = (await create('x.nrrd', file.length)).json;
  const half = file.subarray(0, 300000);
  const wrong = await patch(id, 0, half, sum(Buffer.from('other')));
  assert.equal(wrong.status, 460);
  assert.equal((await daemon.json(`/api/v1/uploads/${id}`)).json.offset, 0);
  for (const bad of ['crc32 AAAA', 'sha1', 'sha1 AAAA', 'sha1 !']) assert.equal((await patch(id, 0, half, { 'Upload-Checksum': bad })).status, 400, bad);
  assert.equal((await patch(id, 0, half, sum(half))).status, 204);
  assert.equal((await patch(id, half.length, file.subarray(half.length), sum(file.subarray(half.length), 'sha256'))).status, 204);
  assert.deepEqual(readFileSync(path.join(uploads(), id, 'files', 'data.nrrd')), file);
  await remove(id);
  await settled(0);
});

test('a client that lies about the size is stopped', async () => {
  const { id } = (await create('x.nrrd', 1000)).json;
  assert.equal((await patch(id, 0, Buffer.alloc(1001))).status, 413);
  const raw = await Raw.connect(daemon.port); // without Content-Length
  raw.write(`PATCH /api/v1/uploads/${id} HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer ${daemon.token}\r\nContent-Type: ${TYPE}\r\n`
    + 'Upload-Offset: 0\r\nTransfer-Encoding: chunked\r\n\r\n');
  raw.write(`${(300000).toString(16)}\r\n${'x'.repeat(300000)}\r\n0\r\n\r\n`);
  await raw.until(() => raw.text().includes('\r\n\r\n'), 'the answer');
  assert.match(raw.text(), /^HTTP\/1.1 413 /);
  raw.destroy();
  assert.equal((await daemon.json(`/api/v1/uploads/${id}`)).json.offset, 0);
  for (const [headers, status] of [[{ 'Content-Type': 'text/plain' }, 415], [{ 'Upload-Offset': 'x' }, 400], [{ 'Upload-Offset': '99999999999999999999' }, 400],
    [{ 'Tus-Resumable': '2' }, 412]]) assert.equal((await patch(id, 0, Buffer.alloc(1), headers)).status, status);
  assert.equal((await patch('0'.repeat(32), 0, Buffer.alloc(1))).status, 404);
  assert.equal((await daemon.json('/api/v1/uploads/..%2f..%2fetc')).status, 404);
  await remove(id);
  await settled(0);
});

test('hostile and broken files fail with a reason that names the file, and nothing is left', async () => {
  for (const [name, content] of [['bomb.nrrd', `NRRD0004\ntype: double\ndimension: 3\nsizes: 60000 60000 60000\nencoding: raw\n\n`],
    ['detached.nrrd', 'NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\ndata file: /etc/passwd\n\n'],
    ['noise.tif', '\xff\x00II*'], ['entity.vti', '<!DOCTYPE x [<!ENTITY e SYSTEM "/etc/passwd">]><VTKFile>&e;</VTKFile>']]) {
    const bytes = Buffer.from(content, 'latin1');
    const { id } = (await create(name, bytes.length)).json;
    assert.equal((await patch(id, 0, bytes)).status, 204);
    const { json } = await daemon.post('/api/v1/volumes', { upload: id });
    const failed = await daemon.loaded(json.id);
    assert.equal(failed.state, 'failed', name);
    assert.ok(!failed.reason.includes(folder) && !failed.reason.includes(id) && !failed.reason.includes('data.'), failed.reason);
    await settled(0);
    assert.equal((await daemon.json(`/api/v1/uploads/${id}`)).status, 404);
    assert.equal((await daemon.post('/api/v1/volumes', { upload: id })).status, 404);
    assert.equal((await daemon.fetch(`/api/v1/volumes/${json.id}`, { method: 'DELETE' })).status, 204);
  }
});

test('two uploads at once keep their bytes apart, and others are served meanwhile', async () => {
  const files = [cube(150), Buffer.concat([cube(100), Buffer.alloc(0)])];
  const ids = [];
  for (const file of files) ids.push((await create('x.nrrd', file.length)).json.id);
  const sent = ids.map((id, i) => patch(id, 0, files[i]));
  assert.equal((await daemon.json('/healthz')).status, 200);
  for (const answer of await Promise.all(sent)) assert.equal(answer.status, 204);
  for (const [i, id] of ids.entries()) {
    assert.deepEqual(readFileSync(path.join(uploads(), id, 'files', 'data.nrrd')), files[i]);
    await remove(id);
  }
  await settled(0);
});

/** A header in one file and its samples in another. */
function detached(data, side = 4) {
  return [Buffer.from(`NRRD0004\ntype: uint8\ndimension: 3\nsizes: ${side} ${side} ${side}\nencoding: raw\ndata file: ${data}\n\n`), Buffer.alloc(side ** 3, 9)];
}

/** Uploads a whole file; returns its id. */
async function sendAll(name, bytes, more = {}, to = daemon) {
  const { status, json } = await to.post('/api/v1/uploads', { name, bytes: bytes.length, ...more });
  assert.equal(status, 201, json.detail);
  assert.equal((await patch(json.id, 0, bytes, {}, to)).status, 204);
  return json.id;
}

test('a header is uploaded with the file of its samples and opened with it', async () => {
  for (const [name, header, samples] of [['größe.nhdr', ...detached('größe 1.raw')],
    ['größe.json', Buffer.from('{"dims": [4, 4, 4], "type": "uint8", "file": "größe 1.raw"}'), Buffer.alloc(64, 9)]]) {
    const id = await sendAll(name, header);
    const data = (await daemon.post('/api/v1/uploads', { name: 'größe 1.raw', bytes: samples.length, header: id })).json;
    assert.equal(data.header, id);
    const early = await daemon.post('/api/v1/volumes', { upload: id });
    assert.equal(early.status, 409);
    assert.match(early.json.detail, /'größe 1.raw' has 0 of 64 bytes/);
    assert.equal((await patch(data.id, 0, samples)).status, 204);
    const alone = await daemon.post('/api/v1/volumes', { upload: data.id });
    assert.deepEqual([alone.status, alone.json.pointer], [422, '/upload']);
    assert.match(alone.json.detail, /open the upload of the header/);
    assert.equal((await daemon.post('/api/v1/volumes', { upload: id })).json.source, `upload:${name}`);
    const volume = await daemon.loaded('groesse');
    assert.deepEqual([volume.state, volume.dims], ['ready', [4, 4, 4]], volume.reason);
    await settled(0);
    assert.equal((await daemon.fetch('/api/v1/volumes/groesse', { method: 'DELETE' })).status, 204);
  }
});

test('a header reaches only the files of its own set', async () => {
  const other = await sendAll('other.nrrd', nrrd()); // of the same token, in the same folder
  for (const name of ['/etc/passwd', '../../etc/passwd', '../info', '../../../info', 'info', `../../${other}/files/data.nrrd`, 'data.raw', 'link.raw', 'sub/ct.raw']) {
    const [header, samples] = detached(name);
    const id = await sendAll('ct.nhdr', header);
    await sendAll('ct.raw', samples, { header: id });
    if (name === 'link.raw') symlinkSync('/etc/passwd', path.join(uploads(), id, 'files', 'link.raw')); // no client can do this
    assert.equal((await daemon.post('/api/v1/volumes', { upload: id, id: 'ct' })).status, 202);
    const { state, reason } = await daemon.loaded('ct');
    assert.equal(state, 'failed', name);
    assert.match(reason, /outside of|no such file|leads out of|must|relative/, `${name}: ${reason}`);
    assert.ok(!reason.includes(folder) && !reason.includes(id), reason);
    await settled(1);
    assert.equal((await daemon.fetch('/api/v1/volumes/ct', { method: 'DELETE' })).status, 204);
  }
  await remove(other);
  await settled(0);
});

test('a file beside a header has a name of its own and a header of its own', async () => {
  const [header, samples] = detached('ct.raw');
  const id = await sendAll('ct.nhdr', header);
  const add = (name, of = id) => daemon.post('/api/v1/uploads', { name, bytes: samples.length, header: of });
  assert.equal((await add('a/../ct.raw')).json.name, 'ct.raw');
  for (const [answer, status, pointer] of [[await add('ct.raw'), 422, '/name'], [await add('data.nhdr'), 422, '/name'], [await add('..'), 422, '/name'],
    [await add('b.raw', '0'.repeat(32)), 404, '/header'], [await add('b.raw', '../x'), 422, '/header'], [await add('b.raw', 3), 422, '/header']]) {
    assert.deepEqual([answer.status, answer.json.pointer], [status, pointer], answer.json.detail);
  }
  const metadata = ['filename', 'b.raw', 'header', id].reduce((text, word, i) => text + (i % 2 ? ` ${Buffer.from(word).toString('base64')},` : word), '');
  const tus = await daemon.json('/api/v1/uploads', { method: 'POST', headers: { 'Tus-Resumable': '1.0.0', 'Upload-Length': '10', 'Upload-Metadata': metadata } });
  assert.deepEqual([tus.status, tus.json.header], [201, id]);
  assert.equal(left().length, 3);
  assert.equal((await remove(id)).status, 204); // and its files
  await settled(0);
  assert.deepEqual((await daemon.json('/api/v1/uploads')).json.uploads, []);
});

test('hidden characters in names become spaces, or are refused where a person types the name', async () => {
  const { json } = await create('ct\u202edrrn\u200b.nrrd', 10);
  assert.equal(json.name, 'ct drrn .nrrd');
  await remove(json.id);
  const typed = await daemon.post('/api/v1/volumes', { source: 'demo:engine?size=9', name: 'a\u2066b' });
  assert.deepEqual([typed.status, typed.json.pointer], [422, '/name']);
  await settled(0);
});

const TOKENS = 'admin-token-admin-token name=a\nann-token-ann-token-ann role=control name=ann uploads=3\n'
  + 'bob-token-bob-token-bob role=control name=bob upload-bytes=1M\nview-token-view-token role=view name=v\n';
const [ADMIN, ANN, BOB] = ['admin-token-admin-token', 'ann-token-ann-token-ann', 'bob-token-bob-token-bob'];

test('the role control uploads and opens; an upload is its owner\'s, and so is what it opens', async () => {
  const tokens = path.join(folder, 'tokens');
  const state = path.join(folder, 'owners');
  writeFileSync(tokens, TOKENS, { mode: 0o600 });
  const args = ['--token-file', tokens, '--state', state, '--upload-bytes', '4M', '--volume', 'demo:phantom?size=8'];
  let other = await Daemon.start(args);
  const as = (token) => ({ post: (at, body) => other.post(at, body, { token, headers: { 'Content-Type': 'application/json' } }),
    json: (at, options = {}) => other.json(at, { token, ...options }), fetch: (at, options = {}) => other.fetch(at, { token, ...options }) });
  const [admin, ann, bob, viewer] = [as(ADMIN), as(ANN), as(BOB), as('view-token-view-token')];
  assert.equal((await create('x.nrrd', 10, viewer)).status, 403);
  assert.equal((await create('x.nrrd', 10, as('no-token-no-token-no'))).status, 401);
  const file = nrrd();
  const { id } = (await create('mine.nrrd', file.length, ann)).json;
  assert.equal((await patch(id, 0, file.subarray(0, 20), {}, ann)).status, 204);
  assert.equal(await (other.stop()), 0);
  other = await Daemon.start(args); // the owner survives a restart
  for (const answer of [await bob.json(`/api/v1/uploads/${id}`), await patch(id, 20, file.subarray(20), {}, bob), await remove(id, bob),
    await bob.post('/api/v1/volumes', { upload: id }), await bob.post('/api/v1/uploads', { name: 'x.raw', bytes: 1, header: id })]) assert.equal(answer.status, 404);
  assert.deepEqual((await bob.json('/api/v1/uploads')).json.uploads, []);
  assert.deepEqual((await ann.json('/api/v1/uploads')).json.uploads.map((upload) => upload.owner), ['ann']);
  assert.equal((await admin.json('/api/v1/uploads')).json.uploads.length, 1);
  assert.equal((await patch(id, 20, file.subarray(20), {}, ann)).status, 204);
  assert.equal((await bob.post('/api/v1/volumes', { upload: id })).status, 404);
  assert.equal((await ann.post('/api/v1/volumes', { upload: id })).status, 202);
  const closable = async (who) => (await who.json('/api/v1/volumes')).json.volumes.filter((volume) => volume.may_close).map((volume) => volume.id);
  assert.deepEqual([await closable(ann), await closable(bob), await closable(admin), await closable(viewer)], [['mine'], [], ['phantom', 'mine'], []]);
  assert.deepEqual((await ann.json('/api/v1/volumes')).json.may, { open: true, browse: false, upload: true, remote: false });
  const denied = await bob.json('/api/v1/volumes/mine', { method: 'DELETE' });
  assert.equal(denied.status, 403);
  assert.match(denied.json.detail, /that token or an admin may close it/);
  assert.equal((await ann.fetch('/api/v1/volumes/phantom', { method: 'DELETE' })).status, 403); // the operator's
  assert.equal(await other.stop(), 0);
  other = await Daemon.start(args);
  assert.deepEqual([await closable(ann), await closable(bob)], [['mine'], []]);
  assert.equal((await ann.fetch('/api/v1/volumes/mine', { method: 'DELETE' })).status, 204);
  assert.equal(await other.stop(), 0);
});

test('one token cannot take all space or all uploads, and over its quota it hears what is free', async () => {
  const tokens = path.join(folder, 'tokens');
  writeFileSync(tokens, TOKENS, { mode: 0o600 });
  const other = await Daemon.start(['--token-file', tokens, '--upload-bytes', '4M', '--uploads', '4']);
  const as = (token) => ({ post: (at, body) => other.post(at, body, { token, headers: { 'Content-Type': 'application/json' } }),
    json: (at, options = {}) => other.json(at, { token, ...options }), fetch: (at, options = {}) => other.fetch(at, { token, ...options }) });
  const [admin, ann, bob] = [as(ADMIN), as(ANN), as(BOB)];
  const huge = await create('x.nrrd', (3 << 20) + 1, ann);
  assert.deepEqual([huge.status, huge.json.pointer, huge.headers.get('retry-after')], [413, '/bytes', null]);
  assert.match(huge.json.detail, /ann may upload 3145728 in all \(its share of --upload-bytes\)/);
  assert.equal((await create('x.nrrd', 3 << 20, ann)).status, 201);
  assert.equal((await create('x.nrrd', 600 << 10, bob)).status, 201); // its neighbour is not affected
  const over = await create('x.nrrd', 430 << 10, bob);
  assert.deepEqual([over.status, over.headers.get('retry-after')], [507, null]);
  assert.match(over.json.detail, /bob has uploads of 614400 and may have 1048576 \(its quota upload-bytes\), so 434176 are free; close volumes/);
  assert.equal((await bob.fetch('/api/v1/uploads', { method: 'OPTIONS' })).headers.get('tus-max-size'), String(1 << 20));
  const { json } = await bob.json('/api/v1/uploads');
  assert.deepEqual([json.bytes, json.bytes_max, json.bytes_free, json.uploads_free], [600 << 10, 1 << 20, 434176, 1]);
  assert.equal((await create('y.nrrd', 1, bob)).status, 201);
  const many = await create('z.nrrd', 1, bob);
  assert.deepEqual([many.status, many.headers.get('retry-after')], [507, null]);
  assert.match(many.json.detail, /bob has 2 uploads and may have 2 \(its share of --uploads\)/);
  assert.equal((await create('y.nrrd', 1, admin)).status, 201, 'the last one is kept for admins');
  const none = await create('z.nrrd', 1, admin);
  assert.match(none.json.detail, /there are 4 uploads and --uploads allows 4/);
  await other.stop();
});

test('without a folder the uploads lie in a private folder that ends with the daemon', async () => {
  const temporary = path.join(folder, 'tmp');
  const own = await Daemon.start([], { prefix: ['/bin/sh', '-c', `mkdir -p '${temporary}'; TMPDIR='${temporary}' exec "$0" "$@"`] });
  await own.post('/api/v1/uploads', { name: 'x.nrrd', bytes: 5 });
  const [root] = left(temporary).filter((name) => name.startsWith('splatd-uploads-'));
  assert.equal(left(path.join(temporary, root)).length, 1);
  assert.equal(await own.stop(), 0);
  assert.deepEqual(left(temporary).filter((name) => name.startsWith('splatd-uploads-')), []);
});

test('--upload-bytes 0 takes no uploads', async () => {
  const none = await Daemon.start(['--upload-bytes', '0']);
  const answer = await none.post('/api/v1/uploads', { name: 'x.nrrd', bytes: 5 });
  assert.equal(answer.status, 403);
  assert.match(answer.json.detail, /--upload-bytes/);
  assert.equal((await patch('0'.repeat(32), 0, Buffer.alloc(3), {}, none)).status, 403);
  assert.equal(await none.stop(), 0);
});

test('with --state an unfinished upload continues after a restart, and a loaded one is loaded again', async () => {
  const state = path.join(folder, 'state');
  const at = path.join(state, 'uploads');
  const file = cube(90);
  const first = await Daemon.start(['--state', state]);
  const { id } = (await create('half.nrrd', file.length, first)).json;
  const loaded = (await create('whole.nrrd', nrrd().length, first)).json.id;
  assert.equal((await patch(id, 0, file.subarray(0, 400000), {}, first)).status, 204);
  assert.equal((await patch(loaded, 0, nrrd(), {}, first)).status, 204);
  await first.post('/api/v1/volumes', { upload: loaded });
  assert.equal((await first.loaded('whole')).state, 'ready');
  assert.equal((await remove(loaded, first)).status, 409);
  first.kill('SIGKILL');
  await first.ended;
  writeFileSync(path.join(at, 'stranger'), 'stays');
  const second = await Daemon.start(['--state', state]);
  assert.equal((await second.json(`/api/v1/uploads/${id}`)).json.offset, 400000);
  assert.equal((await second.loaded('whole')).state, 'ready');
  assert.equal((await patch(id, 400000, file.subarray(400000), {}, second)).status, 204);
  await second.post('/api/v1/volumes', { upload: id, id: 'half' });
  assert.deepEqual((await second.loaded('half')).dims, [90, 90, 90]);
  for (const name of ['half', 'whole']) assert.equal((await second.fetch(`/api/v1/volumes/${name}`, { method: 'DELETE' })).status, 204);
  await settled(1, at, second);
  assert.deepEqual(left(at), ['stranger']);
  assert.equal(await second.stop(), 0);
});

test('an upload without bytes expires', async () => {
  const at = path.join(folder, 'short');
  const short = await Daemon.start(['--upload-dir', at, '--upload-begin-time', '0.05']);
  await create('x.nrrd', 10, short);
  await short.untilLogged(/upload [0-9a-f]{32} of printed expired: x.nrrd, 0 of 10 bytes.*--upload-begin-time/);
  await settled(0, at, short);
  const text = await (await short.fetch('/metrics')).text();
  assert.match(text, /splatd_uploads_ended_total\{result="expired"\} 1/);
  assert.equal(await short.stop(), 0);
});

test('a folder that cannot be used is refused at the start', async () => {
  const at = path.join(folder, 'readonly');
  const one = await Daemon.start(['--upload-dir', at]);
  await assert.rejects(Daemon.start(['--upload-dir', at]), /another daemon uses this folder for uploads/);
  assert.equal(await one.stop(), 0);
  if (process.getuid() !== 0) {
    chmodSync(at, 0o500);
    await assert.rejects(Daemon.start(['--upload-dir', at]), /cannot write to this folder/);
  }
});
