// SPDX-License-Identifier: Apache-2.0
// Remote OME-Zarr over HTTP: shown from its chunks, from allowed hosts only, with errors that say what is wrong.
import assert from 'node:assert/strict';
import { execFile, execFileSync } from 'node:child_process';
import { createReadStream, existsSync, mkdtempSync, readFileSync, readdirSync, rmSync, statSync } from 'node:fs';
import http from 'node:http';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { promisify } from 'node:util';
import { compare } from '../support/compare.mjs';
import { BIN, Daemon } from './harness.mjs';

const SIDE = 160;
const fetcher = path.join(BIN, 'splat-fetch');
const skip = !existsSync(fetcher) && 'built without libcurl';
let daemon;
let folder;
let server;
let host; // "127.0.0.1:PORT"
const asked = []; // paths of requests
let hangs = false;
const waiting = new Set(); // answers that do not come
let other; // a server of the same host on a port that is not allowed
let otherAsked = 0;

/** Serves files of the folder with ranges, as the hosts of such data do. */
function answer(request, response) {
  const { pathname } = new URL(request.url, 'http://x');
  asked.push(pathname);
  const [, first, ...rest] = pathname.split('/');
  const say = (status, headers = {}) => { response.writeHead(status, headers); response.end(); };
  if (first === 'away.zarr') return say(302, { Location: `http://localhost:${server.address().port}/v.zarr/${rest.join('/')}` });
  if (first === 'port.zarr') return say(302, { Location: `http://127.0.0.1:${other.address().port}/v.zarr/${rest.join('/')}` });
  if (first === 'secure.zarr') return say(302, { Location: `https://${request.headers.host.split(':')[0]}/v.zarr/${rest.join('/')}` });
  if (first === 'file.zarr') return say(302, { Location: `file://${folder}/v.zarr/${rest.join('/')}` });
  if (first === 'moved.zarr') return say(301, { Location: `/v.zarr/${rest.join('/')}` });
  if (first === 'broken.zarr') return say(500);
  if (first === 'closed.zarr') return say(401);
  if (hangs || first === 'hanging.zarr') { waiting.add(response); return undefined; }
  if (first === 'slow.zarr' && /^\d+$/.test(rest.at(-1)?.split('.')[0])) { waiting.add(response); return undefined; }
  const file = path.join(folder, pathname.replace('slow.zarr', 'v.zarr'));
  if (!existsSync(file) || !statSync(file).isFile()) return say(404);
  const { size } = statSync(file);
  const [from, to] = /^bytes=(\d+)-(\d+)$/.exec(request.headers.range).slice(1).map(Number);
  if (from >= size) return say(416, { 'Content-Range': `bytes */${size}` });
  const end = Math.min(to, size - 1);
  response.writeHead(206, { 'Content-Range': `bytes ${from}-${end}/${size}`, 'Content-Length': end - from + 1 });
  createReadStream(file, { start: from, end }).pipe(response);
  return undefined;
}

const load = async (source) => {
  const posted = await daemon.post('/api/v1/volumes', { source });
  const { id } = posted.status === 202 ? posted.json : {};
  return { posted, id, loaded: id ? await daemon.loaded(id) : undefined };
};
const fails = async (name, text) => {
  const { id, loaded } = await load(`http://${host}/${name}`);
  assert.equal(loaded.state, 'failed');
  assert.match(JSON.stringify(loaded), text);
  await daemon.fetch(`/api/v1/volumes/${id}`, { method: 'DELETE' });
};

before(async () => {
  folder = mkdtempSync(path.join(tmpdir(), 'splatd-remote-'));
  execFileSync(path.join(BIN, 'splatctl'), ['convert', `demo:noise?size=${SIDE}`, path.join(folder, 'v.zarr')]);
  server = http.createServer(answer);
  await new Promise((ready) => { server.listen(0, '127.0.0.1', ready); });
  host = `127.0.0.1:${server.address().port}`;
  other = http.createServer((_, response) => { otherAsked += 1; response.end(); });
  await new Promise((ready) => { other.listen(0, '127.0.0.1', ready); });
  daemon = await Daemon.start(['--data', folder, '--memory', '64M',
    '--allow-host', `${host},*.example.org,near.localhost:${server.address().port},*.localhost`], { backend: 'cpu' });
});
after(async () => {
  const status = await daemon?.stop();
  for (const response of waiting) response.destroy();
  server.closeAllConnections(); // also after a failure: an open server would keep this process
  server.close();
  other.close();
  rmSync(folder, { recursive: true });
  assert.equal(status, 0);
});

test('a remote OME-Zarr is shown from its chunks, as the local one', { skip }, async () => {
  const { posted, id, loaded } = await load(`http://${host}/v.zarr`);
  assert.equal(posted.status, 202);
  assert.equal(loaded.state, 'ready');
  assert.equal(id, 'v');
  const { json } = await daemon.json(`/api/v1/volumes/${id}`);
  assert.deepEqual(json.whole.dims, [SIDE, SIDE, SIDE]);
  compare(json.bytes, '<', SIDE ** 3, 'the part in memory');
  assert.equal(asked.filter((name) => /^\/v\.zarr\/0\/\d/.test(name)).length, 0, 'chunks of the finest level at first');
  const view = (await daemon.json(`/api/v1/volumes/${id}/view`)).json;
  const render = (volume) => daemon.fetch('/api/v1/render?format=png', { method: 'POST', headers: { 'Content-Type': 'application/json' },
    body: JSON.stringify({ ...view, volume, size: [160, 160], clip: { box: [[0, 0, 0], [0.5, 0.5, 0.5]] },
      camera: { position: [40, 40, 180], target: [40, 40, 40], up: [0, 1, 0], fov_y: 20 } }) });
  const image = await render(id);
  assert.equal(image.status, 200);
  assert.equal(image.headers.get('x-complete'), 'true');
  assert.equal(image.headers.get('x-level'), '0');
  assert.equal((await daemon.post('/api/v1/volumes', { source: 'v.zarr', id: 'local' })).status, 202);
  assert.equal((await daemon.loaded('local')).state, 'ready');
  const local = await render('local');
  const sizes = [image, local].map(async (one) => (await one.arrayBuffer()).byteLength);
  const [a, b] = await Promise.all(sizes);
  compare(Math.abs(a - b), '<', 0.05 * b, 'bytes of the pictures');
});

test('splatctl reads an address that it is given, without a list of hosts', { skip }, async () => {
  const splatctl = (...args) => promisify(execFile)(path.join(BIN, 'splatctl'), args);
  const [far, near] = ['far.nrrd', 'near.nrrd'].map((name) => path.join(folder, name));
  await splatctl('convert', `http://${host}/v.zarr`, far);
  await splatctl('convert', path.join(folder, 'v.zarr'), near);
  assert.ok(readFileSync(far).equals(readFileSync(near)));
  const { whole } = JSON.parse((await splatctl('info', '--json', `http://${host}/v.zarr`)).stdout);
  assert.deepEqual(whole.dims, [SIDE, SIDE, SIDE]);
  await assert.rejects(splatctl('info', `http://user@${host}/v.zarr`), /user or a password/);
});

test('a redirection within the host is followed', { skip }, async () => {
  const { loaded } = await load(`http://${host}/moved.zarr`);
  assert.equal(loaded.state, 'ready');
});

test('errors say what is wrong', { skip }, async () => {
  await fails('missing.zarr', /no OME-Zarr at this address: the host answered with the status 404/);
  await fails('away.zarr', /redirects to http:\/\/localhost:\d+, another host, which is refused/);
  await fails('broken.zarr', /answered with the status 500/);
  await fails('closed.zarr', /answered with the status 401/);
});

test('each redirection is checked as the first address is', { skip }, async () => {
  await fails('port.zarr', /redirects to http:\/\/127\.0\.0\.1:\d+, a port that --allow-host does not list/);
  await fails('secure.zarr', /redirects to https:\/\/127\.0\.0\.1:443, a port that --allow-host does not list/);
  await fails('file.zarr', /redirects to an address that is not supported/);
  assert.equal(otherAsked, 0);
  // The name and its port are allowed at any IP address, its other ports by *.localhost, at public ones only.
  const near = await load(`http://near.localhost:${server.address().port}/secure.zarr`);
  assert.match(JSON.stringify(near.loaded), /near\.localhost has a private IP address/);
});

/** The processes that a process has started: [{name, status}], with its status as /proc tells it. */
function children(pid) {
  const list = readdirSync(`/proc/${pid}/task`).flatMap((task) => readFileSync(`/proc/${pid}/task/${task}/children`, 'utf8').split(' '));
  return list.filter(Boolean).map((child) => ({ name: readFileSync(`/proc/${child}/comm`, 'utf8').trim(), status: readFileSync(`/proc/${child}/status`, 'utf8') }));
}

test('the process that fetches runs in a sandbox', { skip: skip || (process.env.SPLATD_SANITIZE && 'sanitizer builds have no sandbox') }, async () => {
  const posted = await daemon.post('/api/v1/volumes', { source: `http://${host}/hanging.zarr`, id: 'waits' });
  assert.equal(posted.status, 202);
  while (!waiting.size) await new Promise((next) => { setImmediate(next); });
  const { status } = children(daemon.child.pid).find(({ name }) => name === 'splat-fetch');
  assert.match(status, /NoNewPrivs:\s+1/);
  assert.match(status, /Seccomp:\s+2/);
  await daemon.fetch('/api/v1/volumes/waits', { method: 'DELETE' });
  for (const response of waiting) response.destroy();
  waiting.clear();
});

test('hosts that are not allowed are refused at once', async () => {
  for (const [source, text] of [
    ['http://127.0.0.1/v.zarr', /127\.0\.0\.1, port 80, is not allowed; --allow-host/],
    ['https://example.com/v.zarr', /example\.com, port 443, is not allowed/],
    [`http://user@${host}/v.zarr`, /user or a password/],
    [`http://${host}/../v.zarr`, /must not contain/],
  ]) {
    const before_ = asked.length;
    const { posted } = await load(source);
    compare(posted.status, '>=', 400, source);
    assert.match(JSON.stringify(posted.json), text);
    assert.equal(asked.length, before_);
  }
});

test('a load that hangs is cancelled', { skip }, async () => {
  const posted = await daemon.post('/api/v1/volumes', { source: `http://${host}/hanging.zarr` });
  const { id } = posted.json;
  while (!waiting.size) await new Promise((next) => { setImmediate(next); });
  const [response] = waiting;
  const closed = new Promise((end) => { response.on('close', end); });
  assert.equal((await daemon.fetch(`/api/v1/volumes/${id}`, { method: 'DELETE' })).status, 204);
  await closed; // the connection ends with the process that fetches
});

test('the time limit of splatctl holds for all that an address needs', { skip }, async () => {
  const info = (name) => promisify(execFile)(path.join(BIN, 'splatctl'), ['info', '--timeout', '1', `http://${host}/${name}`]);
  await assert.rejects(info('hanging.zarr'), /reading a chunk took longer than the limit of 1 s/);
  await assert.rejects(info('slow.zarr'), /reading it took longer than the limit of/); // its samples do not come
  for (const response of waiting) response.destroy();
});

test('a list of hosts that is none is refused', async () => {
  await assert.rejects(Daemon.start(['--allow-host', 'http://example.org'], { backend: 'null' }), /no HOST, HOST:PORT or \*\.DOMAIN/);
});
