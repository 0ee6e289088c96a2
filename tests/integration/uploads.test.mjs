// SPDX-License-Identifier: Apache-2.0
// Uploads (tus 1.0): in parts, interrupted and continued, over limits, with lies and hostile files.
import assert from 'node:assert/strict';
import { createHash } from 'node:crypto';
import { chmodSync, mkdtempSync, readdirSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
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
  assert.deepEqual((await daemon.json('/api/v1/uploads')).json, { uploads: [], bytes: 0, bytes_max: 64 << 20 });
  assert.equal((await daemon.fetch('/api/v1/volumes/groesse', { method: 'DELETE' })).status, 204);
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

test('names of files that cannot be loaded, and sizes that cannot be, are refused at once', async () => {
  for (const [name, detail] of [['x.exe', /must end in/], ['nrrd', /must end in/], ['x.nhdr', /header whose samples/], ['x.json', /header/], ['a/', /name of a file/]]) {
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
  assert.match(full.json.detail, /62914560 bytes, this file has 20971520/);
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
  assert.deepEqual(readFileSync(path.join(uploads(), id, 'data.nrrd')), file);
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
  assert.deepEqual(readFileSync(path.join(uploads(), id, 'data.nrrd')), file);
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
  assert.deepEqual(readFileSync(path.join(uploads(), id, 'data.nrrd')), file);
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
    assert.deepEqual(readFileSync(path.join(uploads(), id, 'data.nrrd')), files[i]);
    await remove(id);
  }
  await settled(0);
});

test('roles and quotas: only an admin uploads, and a token has its own limit', async () => {
  const tokens = path.join(folder, 'tokens');
  writeFileSync(tokens, 'admin-token-admin-token name=a upload-bytes=1M\nother-token-other-token name=b\ncontrol-token-control role=control name=c\n', { mode: 0o600 });
  const other = await Daemon.start(['--token-file', tokens]);
  const as = (token) => ({ token, headers: { 'Content-Type': 'application/json' } });
  assert.equal((await create('x.nrrd', 10, other, as('control-token-control'))).status, 403);
  assert.equal((await create('x.nrrd', 10, other, as('no-token-no-token-no'))).status, 401);
  assert.equal((await create('x.nrrd', 600 << 10, other, as('admin-token-admin-token'))).status, 201);
  const over = await create('x.nrrd', 600 << 10, other, as('admin-token-admin-token'));
  assert.equal(over.status, 429);
  assert.match(over.json.detail, /uploads of a have 614400 bytes.*allows 1048576/);
  assert.equal((await create('x.nrrd', 600 << 10, other, as('other-token-other-token'))).status, 201);
  await other.untilLogged('upload');
  assert.equal(await other.stop(), 0);
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
  const short = await Daemon.start(['--upload-dir', at, '--upload-time', '0.05']);
  await create('x.nrrd', 10, short);
  await short.untilLogged(/upload [0-9a-f]{32} of printed expired: x.nrrd, 0 of 10 bytes/);
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
