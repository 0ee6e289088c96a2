// SPDX-License-Identifier: Apache-2.0
// Camera paths: their frames, progress, results, errors and limits.
import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import fs from 'node:fs';
import path from 'node:path';
import { test } from 'node:test';
import { compare } from '../support/compare.mjs';
import { Daemon, Raw, within } from './harness.mjs';
import { API, bytes, daemon, end, event, events, frame, gone, LONG, make, newFolder, pathOf, VOLUME } from './paths_helper.mjs';

const tar = (data, ...args) => {
  const run = spawnSync('tar', ['-xf', '-', ...args], { input: data });
  assert.equal(run.status, 0, String(run.stderr));
};

test('a path is rendered frame by frame; each frame equals the snapshot of its view, and the archive has all frames', async () => {
  const id = await make(pathOf());
  const seen = [];
  let last;
  for await (const one of events(id)) {
    seen.push(one.data.done);
    last = one;
  }
  assert.deepEqual([last.event, last.data.state, last.data.done], ['done', 'done', 9]);
  assert.deepEqual(seen, [...seen].sort((a, b) => a - b), 'progress never decreases');
  const view = (await daemon.json('/api/v1/volumes/engine/view')).json;
  const snapshot = async (camera) => bytes(await daemon.fetch('/api/v1/render?format=png', {
    method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify({ volume: 'engine', size: [24, 16], camera }) }));
  assert.ok((await frame(id, 0)).equals(await snapshot(view.camera)));
  assert.ok((await frame(id, 4)).equals(await snapshot({ ...view.camera, position: [60, 0, 0] })));
  assert.ok((await frame(id, 8)).equals(await snapshot({ ...view.camera, position: [60, 0, 0], fov_y: 60 })));
  assert.ok(!(await frame(id, 2)).equals(await frame(id, 4)));

  const folder = newFolder();
  tar(await bytes(await daemon.fetch(`${API}/${id}/archive`)), '-C', folder);
  assert.deepEqual(fs.readdirSync(folder).sort(), Array.from({ length: 9 }, (_, i) => `00000${i}.png`));
  for (let n = 0; n < 9; n++) assert.ok(fs.readFileSync(path.join(folder, `00000${n}.png`)).equals(await frame(id, n)));
});

test('a frame never changes: it has an ETag, is immutable and gives 304', async () => {
  const id = await make(pathOf({ frames: 1, keyframes: [{ time: 0, view: {} }], format: 'jpeg' }));
  await end(id);
  const first = await daemon.fetch(`${API}/${id}/frames/0`);
  assert.match(first.headers.get('cache-control'), /immutable/);
  assert.equal(first.headers.get('content-type'), 'image/jpeg');
  assert.equal(Number(first.headers.get('content-length')), (await bytes(first)).length);
  const again = await daemon.fetch(`${API}/${id}/frames/0`, { headers: { 'If-None-Match': first.headers.get('etag') } });
  assert.deepEqual([again.status, (await bytes(again)).length], [304, 0]);
});

test('range requests return a part of a movie, for players that seek', async () => {
  const id = await make(pathOf({ format: 'webm' }));
  await end(id);
  const ask = async (range, more = {}) => {
    const answer = await daemon.fetch(`${API}/${id}/movie`, { headers: { Range: range, ...more } });
    return { status: answer.status, is: answer.headers.get('content-range'), etag: answer.headers.get('etag'), data: await bytes(answer) };
  };
  const all = await ask('none');
  const size = all.data.length;
  assert.equal(all.status, 200);
  for (const [range, from, to] of [['bytes=0-0', 0, 1], ['bytes=5-99', 5, 100], ['bytes=7-', 7, size], ['bytes=-9', size - 9, size],
    [`bytes=3-${size + 9}`, 3, size], [`bytes=-${size + 1}`, 0, size]]) {
    const part = await ask(range);
    assert.deepEqual([part.status, part.is], [206, `bytes ${from}-${to - 1}/${size}`], range);
    assert.ok(part.data.equals(all.data.subarray(from, to)), range);
  }
  for (const range of [`bytes=${size}-`, 'bytes=-0', `bytes=${'9'.repeat(30)}-`]) {
    const none = await ask(range);
    assert.deepEqual([none.status, none.is], [416, `bytes */${size}`], range);
  }
  for (const range of ['bytes=', 'bytes=-', 'bytes=5-4', 'bytes=1-2,4-5', 'bytes=x-', 'lines=1-2', `bytes=${'9'.repeat(30)}-5`])
    assert.deepEqual([(await ask(range)).status, (await ask(range)).data.length], [200, size], range);
  assert.equal((await ask('bytes=1-2', { 'If-Range': all.etag })).status, 206);
  assert.equal((await ask('bytes=1-2', { 'If-Range': '"another"' })).status, 200);
});

test('a client that reconnects with the last event id gets newer events, or 204 if there are none', async () => {
  const id = await make(pathOf());
  const last = await end(id);
  assert.equal((await end(id, { after: 'running-3' })).id, last.id);
  const over = await daemon.fetch(`${API}/${id}/events`, { headers: { 'Last-Event-ID': last.id } });
  assert.equal(over.status, 204);
});

test('every route of camera paths needs the token', async () => {
  const id = await make(pathOf());
  for (const [method, target] of [['GET', ''], ['POST', ''], ['GET', `/${id}`], ['DELETE', `/${id}`], ['GET', `/${id}/events`],
    ['GET', `/${id}/frames/0`], ['GET', `/${id}/archive`], ['GET', `/${id}/movie`]])
    assert.equal((await daemon.fetch(API + target, { method, token: null })).status, 401, `${method} ${target}`);
});

test('an invalid path is refused with a JSON pointer', async () => {
  for (const [more, pointer] of [
    [{ frames: 0 }, '/frames'], [{ frames: 1e6 }, '/frames'], [{ fps: 0 }, '/fps'], [{ format: 'mp4' }, '/format'], [{ size: [0, 1] }, '/size/0'],
    [{ view: { camera: { fov: 1 } } }, '/view/camera/fov'], [{ view: { volume: 'none' } }, '/view/volume'], [{ view: 3 }, '/view'], [{ x: 1 }, '/x'],
    [{ keyframes: [{ frame: 1, view: { primitive: { type: 'vector' } } }] }, '/keyframes/0/view/primitive/type'],
    [{ keyframes: [{ frame: 99, view: {} }] }, '/keyframes/0/frame'],
  ]) {
    const { status, json } = await daemon.post(API, pathOf(more));
    assert.equal(status, 422, JSON.stringify(json));
    assert.ok(json.pointer.startsWith(pointer), `${json.pointer} for ${pointer}`);
  }
});

test('deleting a running path stops it, removes its files and notifies its watchers', async () => {
  const folder = newFolder();
  const own = await Daemon.start([...VOLUME, '--state', folder], { backend: 'cpu' });
  await own.loaded('engine');
  const id = await make(pathOf(LONG), own);
  const next = await make(pathOf(), own);
  await event(id, (e) => e.data.done >= 2, { of: own });
  assert.ok(fs.existsSync(path.join(folder, 'paths', id, '000001.png')));
  const watching = events(id, { of: own });
  await watching.next();
  assert.equal((await own.fetch(`${API}/${id}`, { method: 'DELETE' })).status, 204);
  let told;
  for await (const one of watching) told = one;
  assert.equal(told.event, 'removed');
  assert.equal((await own.fetch(`${API}/${id}`)).status, 404);
  assert.equal((await end(next, { of: own })).event, 'done', 'the next path is rendered');
  await gone(path.join(folder, 'paths', id));
  assert.equal(await own.stop(), 0);
});

test('the daemon releases a watcher that leaves, and shutdown ends the events of one that stays', async () => {
  const own = await Daemon.start([...VOLUME, '--drain-time', '60'], { backend: 'cpu' });
  await own.loaded('engine');
  const id = await make(pathOf(LONG), own);
  const raw = await Raw.connect(own.port);
  raw.write(`GET ${API}/${id}/events HTTP/1.1\r\nHost: a\r\nAuthorization: Bearer ${own.token}\r\n\r\n`);
  await raw.until(() => raw.text().includes('event: progress'), 'the first event');
  raw.destroy();
  const stays = events(id, { of: own });
  await stays.next();
  await event(id, (e) => e.data.done >= 1, { of: own });
  own.kill('SIGTERM');
  for await (const one of stays) assert.equal(one.event, 'progress'); // and the loop ends without an error
  assert.equal(await within(own.ended, 'the end of the daemon'), 0);
});

test('paths over the limits of number, frames and bytes are refused with the value and the limit', async () => {
  const own = await Daemon.start([...VOLUME, '--paths', '2', '--path-frames', '50', '--path-bytes', '3K'], { backend: 'cpu' });
  await own.loaded('engine');
  assert.equal((await own.post(API, pathOf({ frames: 51 }))).json.pointer, '/frames');
  const id = await make(pathOf({ frames: 50 }), own);
  const { data } = await event(id, (e) => e.data.reason, { of: own });
  assert.equal(data.state, 'waiting');
  assert.match(data.reason, /use \d+ bytes, frame \d+ has \d+, and --path-bytes allows 3072/);
  compare(data.bytes, '<=', 3072);
  compare(data.done, '>', 0);
  assert.equal((await own.fetch(`${API}/${id}/frames/0`)).status, 200, 'rendered frames stay');
  assert.equal((await own.fetch(`${API}/${id}/archive`)).status, 409);
  const other = await make(pathOf({ frames: 1, keyframes: [{ frame: 0, view: {} }] }), own);
  const third = await own.post(API, pathOf());
  assert.equal(third.status, 503);
  assert.match(third.json.detail, /there are 2 camera paths and --paths allows 2/);
  await own.fetch(`${API}/${other}`, { method: 'DELETE' });
  await own.fetch(`${API}/${id}`, { method: 'DELETE' });
  assert.equal(await own.stop(), 0);
});

test('unloading a volume ends its path with a reason', async () => {
  const own = await Daemon.start(VOLUME, { backend: 'cpu' });
  await own.loaded('engine');
  await own.post('/api/v1/volumes', { uri: 'demo:phantom?size=16', id: 'passing' });
  await own.loaded('passing');
  const id = await make(pathOf({ ...LONG, view: { volume: 'passing' } }), own);
  await event(id, (e) => e.data.done >= 1, { of: own });
  for (;;) { // the volume is unused between two frames
    const { status } = await own.fetch('/api/v1/volumes/passing', { method: 'DELETE' });
    if (status === 204) break;
    assert.equal(status, 409);
  }
  const last = await end(id, { of: own });
  assert.equal(last.event, 'failed');
  assert.match(last.data.reason, /passing/);
  assert.equal(await own.stop(), 0);
});

test('snapshots do not wait for a path, and do not end it', async () => {
  const id = await make(pathOf(LONG));
  await event(id, (e) => e.data.done >= 1);
  for (let n = 0; n < 5; n++) {
    const answer = await daemon.fetch(`/api/v1/render?format=png`, {
      method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify({ volume: 'engine', size: [16, 16 + n] }) });
    assert.equal(answer.status, 200);
    await bytes(answer);
  }
  const { json } = await daemon.json(`${API}/${id}`);
  assert.equal(json.state, 'running', 'five snapshots were rendered before the path was done');
  await daemon.fetch(`${API}/${id}`, { method: 'DELETE' });
});
