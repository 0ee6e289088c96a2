// SPDX-License-Identifier: Apache-2.0
// The files of camera paths: restarts, crashes, full disks, quotas and cleanup.
import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import fs from 'node:fs';
import path from 'node:path';
import { test } from 'node:test';
import { compare } from '../support/compare.mjs';
import { Daemon, nrrd } from './harness.mjs';
import { API, bytes, end, event, frame, gone, LONG, make, newFolder, pathOf, VOLUME } from './paths_helper.mjs';

/** So many frames that a daemon dies before the last frame. */
const MANY = 100;

test('a movie over --video-pixels is refused, and partial files of a crash are removed', async () => {
  const folder = newFolder();
  const args = [...VOLUME, '--state', folder, '--video-pixels', '512x512'];
  let own = await Daemon.start(args, { backend: 'cpu' });
  await own.loaded('engine');
  const { status, json } = await own.post(API, pathOf({ format: 'webm', size: [513, 512] }));
  assert.deepEqual([status, json.pointer], [422, '/size']);
  assert.match(json.detail, /513 x 512 has 262656 px and --video-pixels allows 262144/);
  const largest = pathOf({ format: 'webm', size: [512, 512], frames: 5, keyframes: [{ frame: 0, view: {} }] });
  const [movie, images] = [await make(largest, own), await make(pathOf(), own)];
  for (const id of [movie, images]) assert.equal((await end(id, { of: own })).event, 'done');
  assert.equal(await own.stop(), 0);
  for (const file of [`${movie}/000003.vp9`, `${movie}/000004.vp9.part`, `${images}/000003.png.part`, `${images}/movie.part`])
    fs.writeFileSync(path.join(folder, 'paths', file), 'x');
  own = await Daemon.start(args, { backend: 'cpu' });
  assert.deepEqual(fs.readdirSync(path.join(folder, 'paths', movie)), ['movie.webm']);
  assert.deepEqual(fs.readdirSync(path.join(folder, 'paths', images)).sort(), Array.from({ length: 9 }, (_, i) => `00000${i}.png`));
  fs.rmSync(path.join(folder, 'paths', images, '000008.png'));
  assert.equal((await own.fetch(`${API}/${images}/frames/8`)).status, 500);
  assert.equal(await own.stop(), 0);
});

test('a frame or a movie that was cut off is never served; it is named, and can be rendered again', async () => {
  const folder = newFolder();
  const args = [...VOLUME, '--state', folder];
  let own = await Daemon.start(args, { backend: 'cpu' });
  await own.loaded('engine');
  const [images, movie] = [await make(pathOf(), own), await make(pathOf({ format: 'webm' }), own)];
  for (const id of [images, movie]) await end(id, { of: own });
  const file = path.join(folder, 'paths', images, '000003.png');
  const image = await frame(images, 3, own);
  const size = fs.statSync(file).size;
  const isDamaged = async (target, name, id) => {
    const { status, json } = await own.json(`${API}/${target}`);
    assert.equal(status, 500, target);
    assert.equal(json.detail, `${name} of camera path '${id}' is damaged; to render it again, delete the camera path and create it again`);
  };
  for (const left of [size - 1, size - 16, 100, 0]) { // without its last byte, without its seal, half, empty
    fs.truncateSync(file, left);
    await isDamaged(`${images}/frames/3`, 'frame 3', images);
    await isDamaged(`${images}/archive`, 'frame 3', images);
  }
  await own.untilLogged(/frame 3 of camera path .* is damaged: .*000003\.png: .*to render it again, delete the file and restart the daemon/);
  assert.equal((await own.fetch(`${API}/${images}/frames/4`)).status, 200);
  fs.truncateSync(path.join(folder, 'paths', movie, 'movie.webm'), 200);
  await isDamaged(`${movie}/movie`, 'the movie', movie);
  assert.equal(await own.stop(), 0);
  own = await Daemon.start(args, { backend: 'cpu' });
  await isDamaged(`${images}/frames/3`, 'frame 3', images);
  assert.equal(await own.stop(), 0);
  fs.rmSync(file);
  own = await Daemon.start(args, { backend: 'cpu' });
  await end(images, { of: own });
  assert.ok((await frame(images, 3, own)).equals(image));
  assert.equal((await own.fetch(`${API}/${images}/archive`)).status, 200);
  assert.equal(await own.stop(), 0);
});

test('after kill -9 a path resumes after the frames that exist', async () => {
  const folder = newFolder();
  const args = [...VOLUME, '--state', folder];
  let own = await Daemon.start(args, { backend: 'cpu' });
  await own.loaded('engine');
  const whole = await make(pathOf(), own);
  await end(whole, { of: own });
  const id = await make(pathOf({ frames: MANY, view: { volume: 'engine', shading: { mode: 'none' } }, size: [200, 150] }), own);
  const movie = await make(pathOf({ format: 'webm' }), own);
  const { data } = await event(id, (e) => e.data.done >= 3, { of: own });
  own.kill('SIGKILL');
  await own.ended;
  const drawn = fs.readdirSync(path.join(folder, 'paths', id)).filter((name) => name.endsWith('.png'));
  compare(drawn.length, '>=', data.done, `${drawn.length} frames`);
  compare(drawn.length, '<', MANY, `${drawn.length} frames`);
  const before = fs.statSync(path.join(folder, 'paths', id, '000001.png')).mtimeMs;
  own = await Daemon.start(args, { backend: 'cpu' });
  const first = await event(id, () => true, { of: own });
  compare(first.data.done, '>=', drawn.length, 'existing frames are not rendered again');
  assert.equal((await end(id, { of: own })).data.done, MANY);
  assert.equal(fs.statSync(path.join(folder, 'paths', id, '000001.png')).mtimeMs, before);
  assert.equal((await own.json(`${API}/${whole}`)).json.state, 'done');
  assert.equal((await end(movie, { of: own })).event, 'done');
  assert.equal((await own.fetch(`${API}/${movie}/movie`)).status, 200);
  assert.equal(await own.stop(), 0);
});

test('a missing database costs no frame', async () => {
  const folder = newFolder();
  const [frames, away] = [path.join(folder, 'paths'), newFolder()];
  const args = [...VOLUME, '--state', folder];
  const list = async (of) => (await of.json(API)).json.paths.map(({ id }) => id);
  let own = await Daemon.start(args, { backend: 'cpu' });
  await own.loaded('engine');
  const [whole, deleted] = [await make(pathOf(), own), await make(pathOf(), own)];
  for (const one of [whole, deleted]) await end(one, { of: own });
  const half = await make(pathOf(LONG), own);
  await event(half, ({ data }) => data.done >= 2, { of: own });
  assert.equal((await own.fetch(`${API}/${deleted}`, { method: 'DELETE' })).status, 204);
  await gone(path.join(frames, deleted));
  assert.equal(await own.stop(), 0);
  const found = () => Object.fromEntries([whole, half].flatMap((id) => fs.readdirSync(path.join(frames, id)).map((name) => {
    const file = path.join(frames, id, name);
    return [`${id}/${name}`, `${fs.statSync(file).mtimeMs} ${fs.readFileSync(file, 'base64')}`];
  })));
  const before = found();
  const size = Object.keys(before).reduce((sum, name) => sum + fs.statSync(path.join(frames, name)).size, 0);

  const moved = fs.readdirSync(folder).filter((name) => name.startsWith('splatd.db'));
  for (const name of moved) fs.renameSync(path.join(folder, name), path.join(away, name));
  for (let run = 0; run < 2; run++) {
    own = await Daemon.start([...args, '--path-bytes', '1K'], { backend: 'cpu' });
    await own.untilLogged('belong to no known camera path');
    assert.deepEqual(own.log.match(/\d+ folders in[^"]*/g), [`2 folders in ${frames} (${size} bytes) belong to no known camera path; `
      + 'they are kept and count towards --path-bytes: delete them, or restore the database that knows them']);
    assert.deepEqual(await list(own), []);
    await own.loaded('engine');
    assert.equal((await own.post(API, pathOf())).status, 507);
    assert.equal(await own.stop(), 0);
    assert.deepEqual(found(), before);
  }
  for (const name of fs.readdirSync(folder)) if (name.startsWith('splatd.db')) fs.rmSync(path.join(folder, name));
  for (const name of moved) fs.renameSync(path.join(away, name), path.join(folder, name));

  own = await Daemon.start(args, { backend: 'cpu' });
  assert.doesNotMatch(own.log, /folders in/);
  assert.deepEqual(await list(own), [whole, half].sort());
  assert.equal((await own.json(`${API}/${whole}`)).json.state, 'done');
  const drawn = Object.keys(before).length - 9;
  await event(half, ({ data }) => data.done > drawn, { of: own });
  assert.equal(await own.stop(), 0); // it still draws, and renames files
  const now = found();
  for (const name of Object.keys(before)) assert.equal(now[name], before[name], name);
});

test('after a restart a path resumes only with the volume for which it was created', async () => {
  const folder = newFolder();
  const file = path.join(folder, 'cube.nrrd');
  const start = async () => {
    const own = await Daemon.start(['--data', folder, '--state', path.join(folder, 'state')], { backend: 'cpu' });
    const { status } = await own.fetch('/api/v1/volumes/cube');
    if (status === 200) await own.loaded('cube');
    return own;
  };
  const kill = async (own) => {
    own.kill('SIGKILL');
    await own.ended;
  };
  fs.writeFileSync(file, nrrd());
  let own = await start();
  await own.post('/api/v1/volumes', { path: 'cube.nrrd' });
  await own.loaded('cube');
  const body = pathOf({ view: { volume: 'cube' }, size: [200, 150], frames: MANY });
  const [id, other] = [await make(body, own), await make(body, own)];
  await event(id, ({ data }) => data.done >= 2, { of: own });
  await kill(own);

  fs.rmSync(file); // the file is missing for now and may return
  own = await start();
  const waits = await event(id, ({ data }) => data.reason, { of: own });
  assert.equal(waits.data.state, 'waiting');
  assert.match(waits.data.reason, /failed to load: .*no such file/);
  compare(waits.data.done, '>=', 2);
  const first = await frame(id, 0, own);
  fs.writeFileSync(file, nrrd());
  assert.equal((await own.post('/api/v1/volumes', { path: 'cube.nrrd' })).status, 202);
  assert.equal((await end(id, { of: own })).event, 'done');
  assert.ok((await frame(id, 0, own)).equals(first));
  await kill(own);

  fs.writeFileSync(file, nrrd(Buffer.alloc(64, 7)));
  fs.rmSync(path.join(folder, 'state', 'paths', other), { recursive: true, force: true }); // delete all its frames
  fs.rmSync(path.join(folder, 'state', 'paths', id, `0000${MANY - 1}.png`)); // and the last frame of the first path
  own = await start();
  for (const [one, done] of [[id, MANY - 1], [other, 0]]) {
    const last = await end(one, { of: own });
    assert.deepEqual([last.event, last.data.done], ['failed', done]);
    assert.match(last.data.reason, /the volume 'cube' is not the one that the path was created for/);
  }
  assert.ok((await frame(id, 0, own)).equals(first), 'the path keeps its frames');
  assert.equal(await own.stop(), 0);
});

test('a path over --path-bytes resumes when others are deleted', async () => {
  const own = await Daemon.start([...VOLUME, '--path-bytes', '4K'], { backend: 'cpu' });
  await own.loaded('engine');
  const small = pathOf({ format: 'webm' });
  const id = await make(pathOf({ frames: 50 }), own);
  await event(id, (e) => e.data.reason, { of: own });
  const movies = [await own.post(API, small)].filter(({ status }) => status === 202); // refused when no byte is left
  for (const { json } of movies) await event(json.id, (e) => e.data.reason || e.data.state === 'done', { of: own });
  assert.equal((await own.fetch(`${API}/${id}`, { method: 'DELETE' })).status, 204);
  for (const { json } of movies) assert.equal((await end(json.id, { of: own })).event, 'done');
  assert.equal(await own.stop(), 0);
});

test('a path waits while the disk refuses its frames', async () => {
  const folder = newFolder();
  const own = await Daemon.start([...VOLUME, '--state', folder], { backend: 'cpu' });
  await own.loaded('engine');
  const [at, away] = [path.join(folder, 'paths'), path.join(folder, 'away')];
  fs.renameSync(at, away);
  fs.writeFileSync(at, '');
  const id = await make(pathOf(), own);
  const movie = await make(pathOf({ format: 'webm' }), own);
  for (const one of [id, movie]) {
    const { data } = await event(one, (e) => e.data.reason, { of: own });
    assert.deepEqual([data.state, data.done], ['waiting', 0]);
    assert.match(data.reason, /Not a directory/);
  }
  fs.rmSync(at);
  fs.renameSync(away, at);
  for (const one of [id, movie]) assert.equal((await end(one, { of: own })).event, 'done');
  assert.equal((await own.json(`${API}/${id}`)).json.reason, undefined);
  assert.equal(await own.stop(), 0);
});

test('paths wait for a full disk, both with frames to write and with a movie to assemble', async (t) => {
  if (spawnSync('unshare', ['-rm', 'true']).status !== 0) return t.skip('no disk of its own: unshare -rm');
  const [folder, disk, page] = [newFolder(), 1 << 20, 4096];
  const prefix = ['env', `TMPDIR=${folder}`, 'unshare', '-rm', 'sh', '-c', `mount -t tmpfs -o size=${disk} none ${folder} && exec "$0" "$@"`];
  const own = await Daemon.start(VOLUME, { backend: 'cpu', prefix });
  await own.loaded('engine');
  const seen = path.join('/proc', String(own.child.pid), 'root', folder); // as the daemon sees the folder, not this process
  const filler = path.join(seen, 'filler');
  const [name] = fs.readdirSync(seen);
  const files = (id) => fs.readdirSync(path.join(seen, name, id)).sort();
  for (const [body, drawn] of [[pathOf(), 3], [pathOf({ format: 'webm' }), 3], [pathOf({ format: 'webm' }), 9]]) {
    const { bavail, bsize } = fs.statfsSync(seen); // a sanitizer also writes a file there
    fs.writeFileSync(filler, Buffer.alloc(bavail * bsize - drawn * page)); // each file takes a page
    const id = await make(body, own);
    const { data } = await event(id, (e) => e.data.reason, { of: own });
    assert.deepEqual([data.state, data.done], ['waiting', drawn]);
    assert.match(data.reason, /No space left on device/);
    assert.deepEqual(files(id), Array.from({ length: drawn }, (_, i) => `00000${i}.${body.format ? 'vp9' : 'png'}`), 'there are no partial files');
    fs.rmSync(filler);
    const last = await end(id, { of: own });
    assert.equal(last.event, 'done');
    const what = body.format ? 'movie' : 'frames/8';
    const result = await bytes(await own.fetch(`${API}/${id}/${what}`));
    compare(result.length, '>', 200);
    const whole = await make(body);
    const { data: { bytes: size } } = await end(whole);
    if (!body.format) assert.ok(result.equals(await frame(whole, 8)));
    if (body.format && drawn === 3) compare(last.data.bytes, '>', size, 'the movie resumed with a key frame');
    else assert.equal(last.data.bytes, size);
    assert.equal((await own.fetch(`${API}/${id}`, { method: 'DELETE' })).status, 204);
    await gone(path.join(seen, name, id));
  }
  assert.equal(await own.stop(), 0);
});

test('when the frame store is full, new paths are refused until one is deleted', async () => {
  const args = [...VOLUME, '--state', newFolder()];
  let own = await Daemon.start(args, { backend: 'cpu' });
  await own.loaded('engine');
  const id = await make(pathOf(), own);
  const { data } = await end(id, { of: own });
  assert.equal(await own.stop(), 0);
  compare(data.bytes, '>', 1024);
  own = await Daemon.start([...args, '--path-bytes', '1K'], { backend: 'cpu' });
  await own.loaded('engine');
  const full = await own.post(API, pathOf());
  assert.equal(full.status, 507);
  assert.match(full.json.detail, new RegExp(`use ${data.bytes} bytes and --path-bytes allows 1024`));
  await own.fetch(`${API}/${id}`, { method: 'DELETE' });
  for (let status = 507; status !== 202;) status = (await own.post(API, pathOf())).status; // accepted once the files are deleted
  assert.equal(await own.stop(), 0);
});

test('without --state frames are stored in a private folder that is removed at exit', async () => {
  const folder = newFolder();
  const own = await Daemon.start(VOLUME, { backend: 'cpu', prefix: ['env', `TMPDIR=${folder}`] });
  await own.loaded('engine');
  const id = await make(pathOf(), own);
  await end(id, { of: own });
  const [name] = fs.readdirSync(folder);
  assert.equal(fs.statSync(path.join(folder, name)).mode & 0o777, 0o700);
  assert.ok(fs.existsSync(path.join(folder, name, id, '000008.png')));
  assert.equal(await own.stop(), 0);
  assert.deepEqual(fs.readdirSync(folder), []);
});

test('the next daemon removes the files of a killed daemon without --state, and nothing else', async () => {
  const folder = newFolder();
  const start = async () => {
    // Uploads would have a folder of their own there.
    const own = await Daemon.start([...VOLUME, '--upload-bytes', '0'], { backend: 'cpu', prefix: ['env', `TMPDIR=${folder}`] });
    await own.loaded('engine');
    return own;
  };
  const lives = await start();
  const there = await make(pathOf(), lives);
  await end(there, { of: lives });
  const [living] = fs.readdirSync(folder);
  const killed = await start();
  await end(await make(pathOf(), killed), { of: killed });
  killed.kill('SIGKILL');
  await killed.ended;
  const [left] = fs.readdirSync(folder).filter((name) => name !== living);
  const others = ['splatd-frames-theirs', 'splatd-frames-notours', 'splatd-else'];
  for (const other of others) fs.mkdirSync(path.join(folder, other));
  fs.mkdirSync(path.join(folder, 'splatd-frames-theirs', 'keep'));
  const next = await start();
  const names = fs.readdirSync(folder);
  assert.ok(!names.includes(left), `${left} of ${names}`);
  assert.equal(names.length, 5);
  assert.ok(fs.existsSync(path.join(folder, 'splatd-frames-theirs', 'keep')));
  assert.equal((await lives.fetch(`${API}/${there}/frames/8`)).status, 200);
  assert.equal(await next.stop(), 0);
  assert.equal(await lives.stop(), 0);
  assert.deepEqual(fs.readdirSync(folder).sort(), others.sort());
});
