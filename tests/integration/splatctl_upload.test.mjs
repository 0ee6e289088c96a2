// SPDX-License-Identifier: Apache-2.0
// splatctl upload: progress to the end, lost connections, a killed command that continues, headers with samples, refusals.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { once } from 'node:events';
import { mkdtempSync, readFileSync, rmSync, statSync, utimesSync, writeFileSync } from 'node:fs';
import net from 'node:net';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { BIN, Daemon, nrrd, within } from './harness.mjs';

const SIDE = 180; // 5.8 MB
let daemon;
let folder;
const at = (name) => path.join(folder, name);

before(async () => {
  folder = mkdtempSync(path.join(tmpdir(), 'splatctl-upload-'));
  writeFileSync(at('tokens'), 'admin-token-admin-token\nview-token-view-token role=view\ncontrol-token-control role=control name=c upload-bytes=12M\n', { mode: 0o600 });
  writeFileSync(at('small.nrrd'), nrrd());
  writeFileSync(at('large.nrrd'), Buffer.concat([Buffer.from(`NRRD0004\ntype: uint8\ndimension: 3\nsizes: ${SIDE} ${SIDE} ${SIDE}\nencoding: raw\n\n`), Buffer.alloc(SIDE ** 3, 5)]));
  writeFileSync(at('ct.nhdr'), 'NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\ndata file: ct.raw\n');
  writeFileSync(at('ct.raw'), Buffer.alloc(64, 3));
  writeFileSync(at('empty.nrrd'), '');
  writeFileSync(at('huge.nrrd'), Buffer.alloc(14 << 20));
  daemon = await Daemon.start(['--volume', 'demo:engine?size=8', '--token-file', at('tokens')]);
});
after(async () => {
  assert.equal(await daemon.stop(), 0);
  rmSync(folder, { recursive: true });
});

function start(args, { port = daemon.port, token = 'control-token-control' } = {}) {
  const child = spawn(path.join(BIN, 'splatctl'), ['--url', `http://127.0.0.1:${port}/?token=${token}`, 'upload', ...args], { stdio: ['ignore', 'pipe', 'pipe'] });
  const run = { child, out: '', err: '' };
  child.stdout.on('data', (data) => { run.out += data; });
  child.stderr.on('data', (data) => { run.err += data; });
  run.ended = once(child, 'close').then(([status]) => ({ status, out: run.out, err: run.err }));
  return run;
}
const splatctl = (args, options) => within(start(args, options).ended, args.join(' '));
const volume = async (id) => (await daemon.json(`/api/v1/volumes/${id}`, { token: 'admin-token-admin-token' })).json;
const uploads = async () => (await daemon.json('/api/v1/uploads', { token: 'admin-token-admin-token' })).json.uploads;

/** Waits until the daemon has counted this many bytes of the first upload. */
async function counted(bytes) {
  for (let offset = 0; offset < bytes;) [{ offset } = { offset: 0 }] = await uploads();
}

/** A relay that passes at most `limit` bytes of the first PATCH on, then resets the connection, or stays silent. offsets: of all PATCHes. */
async function relay(limit, isSilent) {
  const r = { offsets: [], sockets: [] };
  let isFirst = true;
  const server = net.createServer((client) => {
    const up = net.connect(daemon.port, '127.0.0.1');
    let passed = 0;
    let isLimited = false;
    r.sockets.push(client, up);
    for (const socket of [client, up]) socket.on('error', () => {});
    up.on('data', (data) => client.write(data));
    client.on('data', (data) => {
      const offset = data.toString('latin1').match(/^PATCH [^]*?Upload-Offset: (\d+)/);
      if (offset) {
        r.offsets.push(Number(offset[1]));
        isLimited = isFirst;
        isFirst = false;
        passed = 0;
      }
      if (isLimited && passed > limit) {
        client.pause();
        if (!isSilent) counted(1).then(() => client.resetAndDestroy());
        return;
      }
      passed += data.length;
      up.write(data);
    });
    client.on('close', () => up.end());
    up.on('close', () => client.destroy());
  });
  server.listen(0, '127.0.0.1');
  await once(server, 'listening');
  r.port = server.address().port;
  r.close = () => { for (const socket of r.sockets) socket.destroy(); server.close(); };
  return r;
}

test('a file of this computer is uploaded, opened, and its id printed', async () => {
  assert.deepEqual(await splatctl([at('small.nrrd')]), { status: 0, out: 'small\n', err: '' });
  assert.deepEqual(await splatctl([at('small.nrrd'), '--id', 'other']), { status: 0, out: 'other\n', err: '' });
  assert.deepEqual([(await volume('small')).state, (await volume('other')).source], ['ready', 'upload:small.nrrd']);
});

test('a lost connection is continued by itself', async () => {
  const lossy = await relay(1 << 20, false);
  assert.deepEqual(await splatctl([at('large.nrrd'), '--id', 'lossy'], lossy), { status: 0, out: 'lossy\n', err: '' });
  lossy.close();
  assert.equal(lossy.offsets.length, 2);
  assert.ok(lossy.offsets[1] > 0, String(lossy.offsets));
  assert.deepEqual((await volume('lossy')).dims, [SIDE, SIDE, SIDE]);
});

test('a killed command continues where its bytes ended', async () => {
  const silent = await relay(2 << 20, true);
  const run = start([at('large.nrrd')], silent);
  await counted(1 << 20);
  run.child.kill('SIGKILL');
  await run.ended;
  silent.close();
  const watched = await relay(Infinity, false);
  assert.deepEqual(await splatctl([at('large.nrrd'), '--id', 'killed'], watched), { status: 0, out: 'killed\n', err: '' });
  watched.close();
  assert.ok(watched.offsets.length >= 1 && watched.offsets.every((offset) => offset >= 1 << 20), String(watched.offsets));
  assert.equal((await volume('killed')).state, 'ready');
});

test('a file of the same name and size that changed meanwhile begins from its first byte', async () => {
  const silent = await relay(2 << 20, true);
  const run = start([at('large.nrrd')], silent);
  for (let offset = 0; offset < 1 << 20;) [{ offset } = { offset: 0 }] = await uploads();
  run.child.kill('SIGKILL');
  await run.ended;
  silent.close();
  const [begun] = await uploads();
  assert.equal(begun.modified, Math.floor(statSync(at('large.nrrd')).mtimeMs));
  const changed = readFileSync(at('large.nrrd'));
  changed.fill(9, changed.length - SIDE ** 3);
  writeFileSync(at('large.nrrd'), changed);
  utimesSync(at('large.nrrd'), new Date(), new Date(begun.modified + 5000));
  const counted = await relay(Infinity, false);
  assert.deepEqual(await splatctl([at('large.nrrd'), '--id', 'changed'], counted), { status: 0, out: 'changed\n', err: '' });
  counted.close();
  assert.equal(counted.offsets[0], 0);
  assert.deepEqual((await volume('changed')).range, [9, 9], 'no byte of the old file');
  assert.deepEqual((await uploads()).map(({ id }) => id), [begun.id], 'the old upload waits for its file');
  await daemon.json(`/api/v1/uploads/${begun.id}`, { method: 'DELETE', token: 'admin-token-admin-token' });
});

test('a header is followed by the files with its samples', async () => {
  assert.deepEqual(await splatctl([at('ct.nhdr'), at('ct.raw')]), { status: 0, out: 'ct\n', err: '' });
  const alone = await splatctl([at('ct.nhdr')]);
  assert.equal(alone.status, 2);
  assert.match(alone.err, /ct.nhdr: is a header; give the files with its samples after it/);
});

test('the files of a DICOM series become one volume', async () => {
  const slices = [0, 1, 2, 3].map((k) => path.join(import.meta.dirname, `../unit/data/import/dicom/series${k}.dcm`));
  assert.deepEqual(await splatctl([...slices.reverse(), '--id', 'series']), { status: 0, out: 'series\n', err: '' });
  const { dims, value_unit: unit, fields } = await volume('series');
  assert.deepEqual(dims, [16, 12, 4]);
  assert.equal(unit ?? fields[0].unit, 'HU');
});

test('refusals name the file and the remedy', async () => {
  for (const [args, why, options] of [
    [[at('none.nrrd')], /none.nrrd: cannot read the file: No such file/], [[at('empty.nrrd')], /empty.nrrd: the file is empty/],
    [[folder], /is not a regular file/], [[at('ct.raw')], /ct.raw: .*its name must end in .nrrd/],
    [[at('huge.nrrd')], /huge.nrrd: the file has 14680064 bytes and the token c may upload 12582912.*HTTP 413/],
    [[at('small.nrrd')], /the role of this token does not include this/, { token: 'view-token-view-token' }],
    [[at('small.nrrd'), '--id', 'engine'], /--id: the id 'engine' belongs to another volume/]]) {
    const { status, out, err } = await splatctl(args, options);
    assert.deepEqual([status, out], [1, ''], err);
    assert.match(err, why);
  }
  assert.deepEqual(await splatctl([at('small.nrrd'), '--id', 'third']), { status: 0, out: 'third\n', err: '' }); // the upload of before is used
  assert.deepEqual(await uploads(), []);
  const none = await splatctl([]);
  assert.deepEqual([none.status, /needs a file/.test(none.err)], [2, true]);
});
