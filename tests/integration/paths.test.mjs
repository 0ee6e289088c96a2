// SPDX-License-Identifier: Apache-2.0
// Camera paths: jobs that draw frames, their progress, results and limits, and what a restart leaves of them.
import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import fs from 'node:fs';
import os from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { setImmediate } from 'node:timers/promises';
import { Daemon, nrrd, Raw, within } from './harness.mjs';

const VOLUME = ['--volume', 'demo:engine?size=16'];
const API = '/api/v1/paths';
const TURN = [{ frame: 4, view: { camera: { position: [60, 0, 0] } } }, { frame: 8, view: { camera: { fov_y: 60 } } }];
const pathOf = (more = {}) => ({ view: { volume: 'engine' }, size: [24, 16], frames: 9, keyframes: TURN, ...more });
const folders = [];
const newFolder = () => {
  folders.push(fs.mkdtempSync(path.join(os.tmpdir(), 'splatd-paths-')));
  return folders.at(-1);
};
let daemon;

before(async () => {
  daemon = await Daemon.start(VOLUME, { backend: 'cpu' });
  await daemon.loaded('engine');
});
after(async () => {
  assert.equal(await daemon.stop(), 0);
  for (const folder of folders) fs.rmSync(folder, { recursive: true });
});

async function make(body, of = daemon) {
  const answer = await of.post(API, body);
  assert.equal(answer.status, 202, JSON.stringify(answer.json));
  assert.equal(answer.headers.get('location'), `paths/${answer.json.id}`);
  return answer.json.id;
}

/** Events of a path one by one, until the daemon ends them: {id, event, data}. */
async function* events(id, { of = daemon, after: last } = {}) {
  const answer = await of.fetch(`${API}/${id}/events`, { headers: last ? { 'Last-Event-ID': last } : {} });
  if (answer.status === 204) return;
  assert.equal(answer.status, 200);
  assert.equal(answer.headers.get('content-type'), 'text/event-stream');
  let text = '';
  for await (const chunk of answer.body.pipeThrough(new TextDecoderStream())) {
    text += chunk;
    for (let end; (end = text.indexOf('\n\n')) >= 0; text = text.slice(end + 2)) {
      const fields = Object.fromEntries(text.slice(0, end).split('\n').map((line) => line.split(/: (.*)/s)));
      if (fields.data) yield { ...fields, data: JSON.parse(fields.data) };
    }
  }
}

/** The last event. */
async function end(id, options) {
  let last;
  for await (const event of events(id, options)) last = event;
  return last;
}

/** The first event that fits. */
async function event(id, fits, options) {
  for await (const one of events(id, options)) if (fits(one)) return one;
  throw new Error('the events ended');
}

/** Until the daemon has removed it. */
async function gone(file) {
  const limit = AbortSignal.timeout(60000);
  while (fs.existsSync(file)) {
    limit.throwIfAborted();
    await setImmediate();
  }
}

const bytes = async (answer) => Buffer.from(await answer.arrayBuffer());
const frame = async (id, n, of = daemon) => bytes(await of.fetch(`${API}/${id}/frames/${n}`));
const tar = (data, ...args) => {
  const run = spawnSync('tar', ['-xf', '-', ...args], { input: data });
  assert.equal(run.status, 0, String(run.stderr));
};

test('a path is drawn frame by frame; each is the still of its view, and the archive has them all', async () => {
  const id = await make(pathOf());
  const seen = [];
  let last;
  for await (const one of events(id)) {
    seen.push(one.data.done);
    last = one;
  }
  assert.deepEqual([last.event, last.data.state, last.data.done], ['done', 'done', 9]);
  assert.deepEqual(seen, [...seen].sort((a, b) => a - b), 'progress only rises');
  const view = (await daemon.json('/api/v1/volumes/engine/view')).json;
  const still = async (camera) => bytes(await daemon.fetch('/api/v1/render?format=png', {
    method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify({ volume: 'engine', size: [24, 16], camera }) }));
  assert.ok((await frame(id, 0)).equals(await still(view.camera)));
  assert.ok((await frame(id, 4)).equals(await still({ ...view.camera, position: [60, 0, 0] })));
  assert.ok((await frame(id, 8)).equals(await still({ ...view.camera, position: [60, 0, 0], fov_y: 60 })));
  assert.ok(!(await frame(id, 2)).equals(await frame(id, 4)));

  const folder = newFolder();
  tar(await bytes(await daemon.fetch(`${API}/${id}/archive`)), '-C', folder);
  assert.deepEqual(fs.readdirSync(folder).sort(), Array.from({ length: 9 }, (_, i) => `00000${i}.png`));
  for (let n = 0; n < 9; n++) assert.ok(fs.readFileSync(path.join(folder, `00000${n}.png`)).equals(await frame(id, n)));
});

test('a frame never changes: ETag, immutable, 304', async () => {
  const id = await make(pathOf({ frames: 1, keyframes: [{ time: 0, view: {} }], format: 'jpeg' }));
  await end(id);
  const first = await daemon.fetch(`${API}/${id}/frames/0`);
  assert.match(first.headers.get('cache-control'), /immutable/);
  assert.equal(first.headers.get('content-type'), 'image/jpeg');
  assert.equal(Number(first.headers.get('content-length')), (await bytes(first)).length);
  const again = await daemon.fetch(`${API}/${id}/frames/0`, { headers: { 'If-None-Match': first.headers.get('etag') } });
  assert.deepEqual([again.status, (await bytes(again)).length], [304, 0]);
});

test('a part of a movie is sent alone, for players that seek', async () => {
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

test('who watches again with the last id is told what is newer, or that there is nothing', async () => {
  const id = await make(pathOf());
  const last = await end(id);
  assert.equal((await end(id, { after: 'running-3' })).id, last.id);
  const over = await daemon.fetch(`${API}/${id}/events`, { headers: { 'Last-Event-ID': last.id } });
  assert.equal(over.status, 204);
});

test('everything needs the token', async () => {
  const id = await make(pathOf());
  for (const [method, target] of [['GET', ''], ['POST', ''], ['GET', `/${id}`], ['DELETE', `/${id}`], ['GET', `/${id}/events`],
    ['GET', `/${id}/frames/0`], ['GET', `/${id}/archive`], ['GET', `/${id}/movie`]])
    assert.equal((await daemon.fetch(API + target, { method, token: null })).status, 401, `${method} ${target}`);
});

const TOKENS = { admin: 'token-of-admin-0123456789', bob: 'token-of-bob-0123456789', eve: 'token-of-eve-0123456789' };

/** A daemon for several: {own, as(name) = the daemon with that one's token, allow(quota) = another one for bob}. */
async function shared(args = [], quota = 'paths=2') {
  const file = path.join(newFolder(), 'tokens');
  const write = (what) => fs.writeFileSync(file,
    `${TOKENS.admin} name=root\n${TOKENS.bob} role=render name=bob ${what}\n${TOKENS.eve} role=render name=eve\n`);
  write(quota);
  const own = await Daemon.start([...VOLUME, '--token-file', file, ...args], { backend: 'cpu' });
  const as = (name) => Object.assign(Object.create(own), { token: TOKENS[name] });
  own.token = TOKENS.admin;
  await own.loaded('engine');
  const allow = (what) => {
    const before = own.log.length;
    write(what);
    own.kill('SIGHUP');
    return own.until(() => own.log.slice(before).includes('reloaded'), 'the file to be read');
  };
  return { own, as, allow };
}
const ENDLESS = { size: [400, 400], frames: 9999 };

test('each token has its frames in turn, its quota, and sees its own paths', async () => {
  const { own, as } = await shared();
  const [bob, eve] = [as('bob'), as('eve')];
  const first = await make(pathOf(ENDLESS), bob);
  const second = await make(pathOf(ENDLESS), bob);
  await event(first, ({ data }) => data.done >= 1, { of: bob });
  const third = await bob.post(API, pathOf());
  assert.equal(third.status, 429);
  assert.ok(third.headers.get('retry-after'));
  assert.match(third.json.detail, /bob has 2 camera paths and its token allows 2/);
  const quick = await make(pathOf(), eve);
  assert.equal((await end(quick, { of: eve })).event, 'done', 'it does not wait for all of bob\'s frames');
  const state = async (id) => (await own.json(`${API}/${id}`)).json;
  assert.equal((await state(first)).state, 'running');
  assert.deepEqual([(await state(second)).state, (await state(second)).done], ['waiting', 0], 'bob\'s oldest goes first');
  assert.equal((await state(first)).owner, 'bob');
  const list = async (of, query = '') => (await of.json(API + query)).json;
  const ids = async (of) => (await list(of)).paths.map(({ id, owner }) => `${owner} ${id}`);
  assert.deepEqual(await ids(bob), [first, second].sort().map((id) => `bob ${id}`));
  assert.deepEqual(await ids(eve), [`eve ${quick}`]);
  assert.deepEqual((await ids(own)).sort(), [`bob ${first}`, `bob ${second}`, `eve ${quick}`].sort());
  const page = await list(own, '?limit=2');
  assert.equal(page.paths.length, 2);
  const rest = await list(own, `?limit=2&after=${page.next}`);
  assert.deepEqual([...page.paths, ...rest.paths].map(({ id }) => id), [first, second, quick].sort());
  assert.equal(rest.next, undefined);
  assert.equal((await bob.fetch(`${API}/${second}`, { method: 'DELETE' })).status, 204);
  assert.equal((await bob.post(API, pathOf())).status, 202, 'there is room again');
  assert.equal(await own.stop(), 0);
});

test('the files of a token\'s paths have a quota: its own paths wait, and go on when there is room again', async () => {
  const { own, as, allow } = await shared([], 'path-bytes=3K');
  const [bob, eve] = [as('bob'), as('eve')];
  const waits = async (id) => (await event(id, ({ data }) => data.reason, { of: own })).data;
  const first = await make(pathOf({ frames: 50 }), bob);
  const { state, reason, done } = await waits(first);
  assert.equal(state, 'waiting');
  assert.match(reason, /the camera paths of bob use \d+ bytes, frame \d+ has \d+, and its token allows 3072/);
  const second = await make(pathOf({ frames: 50 }), bob);
  await waits(second);
  const bytes = (await bob.json(API)).json.paths.reduce((sum, one) => sum + one.bytes, 0);
  assert.ok(bytes > 2048 && bytes <= 3072, `${bytes}`);
  const { data } = await end(await make(pathOf({ frames: 50 }), eve), { of: eve });
  assert.equal(data.state, 'done', 'others do not wait');
  assert.ok(data.bytes > 3072);
  await bob.fetch(`${API}/${first}`, { method: 'DELETE' });
  await event(second, (e) => e.data.done >= done, { of: bob });
  await allow('path-bytes=1K');
  const over = await bob.post(API, pathOf());
  assert.equal(over.status, 429);
  assert.ok(over.headers.get('retry-after'));
  assert.match(over.json.detail, /the camera paths of bob use \d+ bytes and its token allows 1024; delete finished ones/);
  assert.equal((await eve.post(API, pathOf())).status, 202);
  await allow('path-bytes=1M');
  assert.equal((await end(second, { of: bob })).event, 'done', 'a quota that grows is room');
  assert.equal(await own.stop(), 0);
});

test('a movie\'s bytes count beside its packets\' while it is put together', async () => {
  const body = pathOf({ format: 'webm', size: [64, 48], frames: 9 });
  const whole = (await end(await make(body))).data.bytes;
  const { own, as, allow } = await shared([], `path-bytes=${Math.floor(1.5 * whole)}`);
  const bob = as('bob');
  const id = await make(body, bob);
  const { data } = await event(id, (e) => e.data.reason, { of: bob });
  assert.deepEqual([data.state, data.done], ['waiting', 9], 'all its packets are there');
  assert.match(data.reason, /the camera paths of bob use \d+ bytes, the movie up to \d+, and its token allows \d+/);
  const [has, needs] = /use (\d+) bytes, the movie up to (\d+)/.exec(data.reason).slice(1).map(Number);
  assert.equal(has, data.bytes);
  assert.ok(needs >= whole);
  assert.equal((await bob.fetch(`${API}/${id}/movie`)).status, 409);
  await allow(`path-bytes=${has + needs}`);
  const last = await end(id, { of: bob });
  assert.deepEqual([last.event, last.data.bytes], ['done', whole], 'the packets are gone');
  assert.equal((await make(pathOf({ frames: 1, keyframes: [{ time: 0, view: {} }] }), bob)).length, 32, 'what was kept free is given back');
  assert.equal(await own.stop(), 0);
});

test('a movie that is drawn in turns is the one that is drawn at a stretch', async () => {
  const { own, as } = await shared();
  const other = await make(pathOf(ENDLESS), as('bob'));
  const body = pathOf({ format: 'webm', frames: 20, size: [64, 48] });
  const movie = async (id) => bytes(await own.fetch(`${API}/${id}/movie`));
  const inTurns = await make(body, as('eve'));
  assert.equal((await end(inTurns, { of: own })).event, 'done');
  assert.ok((await own.json(`${API}/${other}`)).json.done >= 19, 'a frame of the other between two of it');
  await own.fetch(`${API}/${other}`, { method: 'DELETE' });
  const alone = await make(body, as('eve'));
  assert.equal((await end(alone, { of: own })).event, 'done');
  assert.equal((await movie(inTurns)).length, (await movie(alone)).length);
  assert.equal(await own.stop(), 0);
});

test('who made a path is known after a restart', async () => {
  const folder = newFolder();
  const one = await shared(['--state', folder]);
  const id = await make(pathOf(ENDLESS), one.as('bob'));
  assert.equal(await one.own.stop(), 0);
  const two = await shared(['--state', folder]);
  assert.deepEqual((await two.as('bob').json(API)).json.paths.map((p) => [p.id, p.owner]), [[id, 'bob']]);
  assert.deepEqual((await two.as('eve').json(API)).json.paths, []);
  await make(pathOf(), two.as('bob'));
  assert.equal((await two.as('bob').post(API, pathOf())).status, 429);
  assert.equal(await two.own.stop(), 0);
});

test('a movie whose encoder would be over --video-pixels is refused; what a crash left half made goes', async () => {
  const folder = newFolder();
  const args = [...VOLUME, '--state', folder, '--video-pixels', '512x512'];
  let own = await Daemon.start(args, { backend: 'cpu' });
  await own.loaded('engine');
  const { status, json } = await own.post(API, pathOf({ format: 'webm', size: [513, 512] }));
  assert.deepEqual([status, json.pointer], [422, '/size']);
  assert.match(json.detail, /513 x 512 has 262656 px and --video-pixels allows 262144/);
  const [movie, pictures] = [await make(pathOf({ format: 'webm', size: [512, 512] }), own), await make(pathOf(), own)];
  for (const id of [movie, pictures]) assert.equal((await end(id, { of: own })).event, 'done');
  assert.equal(await own.stop(), 0);
  for (const file of [`${movie}/000003.vp9`, `${movie}/000004.vp9.part`, `${pictures}/000003.png.part`, `${pictures}/movie.part`])
    fs.writeFileSync(path.join(folder, 'paths', file), 'x');
  own = await Daemon.start(args, { backend: 'cpu' });
  assert.deepEqual(fs.readdirSync(path.join(folder, 'paths', movie)), ['movie.webm']);
  assert.deepEqual(fs.readdirSync(path.join(folder, 'paths', pictures)).sort(), Array.from({ length: 9 }, (_, i) => `00000${i}.png`));
  fs.rmSync(path.join(folder, 'paths', pictures, '000008.png'));
  assert.equal((await own.fetch(`${API}/${pictures}/frames/8`)).status, 404);
  assert.equal(await own.stop(), 0);
});

test('what is wrong is told with its place', async () => {
  for (const [more, pointer] of [
    [{ frames: 0 }, '/frames'], [{ frames: 1e6 }, '/frames'], [{ fps: 0 }, '/fps'], [{ format: 'mp4' }, '/format'], [{ size: [0, 1] }, '/size/0'],
    [{ view: { camera: { fov: 1 } } }, '/view/camera/fov'], [{ view: { volume: 'none' } }, '/view/volume'], [{ view: 3 }, '/view'], [{ x: 1 }, '/x'],
    [{ keyframes: [{ frame: 1, view: { primitive: { type: 'vector' } } }] }, '/keyframes/0/view/primitive'],
    [{ keyframes: [{ frame: 99, view: {} }] }, '/keyframes/0/frame'],
  ]) {
    const { status, json } = await daemon.post(API, pathOf(more));
    assert.equal(status, 422, JSON.stringify(json));
    assert.ok(json.pointer.startsWith(pointer), `${json.pointer} for ${pointer}`);
  }
});

/** A path that takes long. */
const LONG = { size: [1500, 1500], frames: 900 };

test('deleting one that is drawn gives it up and removes its files; its watchers are told', async () => {
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
  assert.equal((await end(next, { of: own })).event, 'done', 'the one behind it is drawn');
  await gone(path.join(folder, 'paths', id));
  assert.equal(await own.stop(), 0);
});

test('a watcher that leaves is let go, and shutting down ends the events of one that stays', async () => {
  const own = await Daemon.start([...VOLUME, '--drain-time', '60'], { backend: 'cpu' });
  await own.loaded('engine');
  const id = await make(pathOf(LONG), own);
  const raw = await Raw.connect(own.port);
  raw.write(`GET ${API}/${id}/events HTTP/1.1\r\nHost: a\r\nAuthorization: Bearer ${own.token}\r\n\r\n`);
  await raw.until(() => raw.text().includes('event: progress'), 'an event');
  raw.destroy();
  const stays = events(id, { of: own });
  await stays.next();
  await event(id, (e) => e.data.done >= 1, { of: own });
  own.kill('SIGTERM');
  for await (const one of stays) assert.equal(one.event, 'progress'); // and it ends as it should
  assert.equal(await within(own.ended, 'the end'), 0);
});

test('after kill -9 it goes on behind the frames that are there', async () => {
  const folder = newFolder();
  const args = [...VOLUME, '--state', folder];
  let own = await Daemon.start(args, { backend: 'cpu' });
  await own.loaded('engine');
  const whole = await make(pathOf({ frames: 40 }), own);
  await end(whole, { of: own });
  const id = await make(pathOf({ frames: 40, view: { volume: 'engine', shading: { mode: 'none' } }, size: [500, 350] }), own);
  const movie = await make(pathOf({ format: 'webm' }), own);
  const { data } = await event(id, (e) => e.data.done >= 3, { of: own });
  own.kill('SIGKILL');
  await own.ended;
  const drawn = fs.readdirSync(path.join(folder, 'paths', id)).filter((name) => name.endsWith('.png'));
  assert.ok(drawn.length >= data.done && drawn.length < 40, `${drawn.length} frames`);
  const before = fs.statSync(path.join(folder, 'paths', id, '000001.png')).mtimeMs;
  own = await Daemon.start(args, { backend: 'cpu' });
  const first = await event(id, () => true, { of: own });
  assert.ok(first.data.done >= drawn.length, 'what is there is not drawn again');
  assert.equal((await end(id, { of: own })).data.done, 40);
  assert.equal(fs.statSync(path.join(folder, 'paths', id, '000001.png')).mtimeMs, before);
  assert.equal((await own.json(`${API}/${whole}`)).json.state, 'done');
  assert.equal((await end(movie, { of: own })).event, 'done');
  assert.equal((await own.fetch(`${API}/${movie}/movie`)).status, 200);
  assert.equal(await own.stop(), 0);
});

test('a database that is not there costs no frame', async () => {
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
  const now = found();
  for (const name of Object.keys(before)) assert.equal(now[name], before[name], name);
  assert.equal(await own.stop(), 0);
});

test('after a restart a path goes on with the volume that it was made for, and with no other', async () => {
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
  const body = pathOf({ view: { volume: 'cube' }, size: [600, 400], frames: 40 });
  const [id, other] = [await make(body, own), await make(body, own)];
  await event(id, ({ data }) => data.done >= 2, { of: own });
  await kill(own);

  fs.rmSync(file); // it is not there: it may come back
  own = await start();
  const waits = await event(id, ({ data }) => data.reason, { of: own });
  assert.equal(waits.data.state, 'waiting');
  assert.match(waits.data.reason, /failed to load: .*no such file/);
  assert.ok(waits.data.done >= 2);
  const first = await frame(id, 0, own);
  fs.writeFileSync(file, nrrd());
  assert.equal((await own.post('/api/v1/volumes', { path: 'cube.nrrd' })).status, 202);
  assert.equal((await end(id, { of: own })).event, 'done');
  assert.ok((await frame(id, 0, own)).equals(first));
  await kill(own);

  fs.writeFileSync(file, nrrd(Buffer.alloc(64, 7)));
  fs.rmSync(path.join(folder, 'state', 'paths', other), { recursive: true, force: true }); // none of its frames is there
  fs.rmSync(path.join(folder, 'state', 'paths', id, '000039.png')); // and the last one of this
  own = await start();
  for (const [one, done] of [[id, 39], [other, 0]]) {
    const last = await end(one, { of: own });
    assert.deepEqual([last.event, last.data.done], ['failed', done]);
    assert.match(last.data.reason, /the volume 'cube' is not the one that the path was created for/);
  }
  assert.ok((await frame(id, 0, own)).equals(first), 'it keeps its frames');
  assert.equal(await own.stop(), 0);
});

test('limits: paths, frames and bytes are refused with both numbers', async () => {
  const own = await Daemon.start([...VOLUME, '--paths', '2', '--path-frames', '50', '--path-bytes', '3K'], { backend: 'cpu' });
  await own.loaded('engine');
  assert.equal((await own.post(API, pathOf({ frames: 51 }))).json.pointer, '/frames');
  const id = await make(pathOf({ frames: 50 }), own);
  const { data } = await event(id, (e) => e.data.reason, { of: own });
  assert.equal(data.state, 'waiting');
  assert.match(data.reason, /use \d+ bytes, frame \d+ has \d+, and --path-bytes allows 3072/);
  assert.ok(data.bytes <= 3072 && data.done > 0);
  assert.equal((await own.fetch(`${API}/${id}/frames/0`)).status, 200, 'what was drawn stays');
  assert.equal((await own.fetch(`${API}/${id}/archive`)).status, 409);
  const other = await make(pathOf({ frames: 1, keyframes: [{ frame: 0, view: {} }] }), own);
  const third = await own.post(API, pathOf());
  assert.equal(third.status, 503);
  assert.match(third.json.detail, /there are 2 camera paths and --paths allows 2/);
  await own.fetch(`${API}/${other}`, { method: 'DELETE' });
  await own.fetch(`${API}/${id}`, { method: 'DELETE' });
  assert.equal(await own.stop(), 0);
});

test('a path that lacks room goes on when others are deleted', async () => {
  const own = await Daemon.start([...VOLUME, '--path-bytes', '3K'], { backend: 'cpu' });
  await own.loaded('engine');
  const small = pathOf({ format: 'webm' });
  const id = await make(pathOf({ frames: 50 }), own);
  await event(id, (e) => e.data.reason, { of: own });
  const movies = [await own.post(API, small)].filter(({ status }) => status === 202); // or there is not a byte left
  for (const { json } of movies) await event(json.id, (e) => e.data.reason || e.data.state === 'done', { of: own });
  assert.equal((await own.fetch(`${API}/${id}`, { method: 'DELETE' })).status, 204);
  for (const { json } of movies) assert.equal((await end(json.id, { of: own })).event, 'done');
  assert.equal(await own.stop(), 0);
});

test('a disk that takes no frame is waited for', async () => {
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

test('a full disk is waited for, by frames and by a movie whose packets are there', async (t) => {
  if (spawnSync('unshare', ['-rm', 'true']).status !== 0) return t.skip('no disk of its own: unshare -rm');
  const [folder, disk, page] = [newFolder(), 1 << 20, 4096];
  const prefix = ['env', `TMPDIR=${folder}`, 'unshare', '-rm', 'sh', '-c', `mount -t tmpfs -o size=${disk} none ${folder} && exec "$0" "$@"`];
  const own = await Daemon.start(VOLUME, { backend: 'cpu', prefix });
  await own.loaded('engine');
  const seen = path.join('/proc', String(own.child.pid), 'root', folder); // by the daemon, not by us
  const filler = path.join(seen, 'filler');
  const [name] = fs.readdirSync(seen);
  const files = (id) => fs.readdirSync(path.join(seen, name, id)).sort();
  for (const [body, drawn] of [[pathOf(), 3], [pathOf({ format: 'webm' }), 3], [pathOf({ format: 'webm' }), 9]]) {
    const { bavail, bsize } = fs.statfsSync(seen); // a sanitizer has a file there, too
    fs.writeFileSync(filler, Buffer.alloc(bavail * bsize - drawn * page)); // a file, a page
    const id = await make(body, own);
    const { data } = await event(id, (e) => e.data.reason, { of: own });
    assert.deepEqual([data.state, data.done], ['waiting', drawn]);
    assert.match(data.reason, /No space left on device/);
    assert.deepEqual(files(id), Array.from({ length: drawn }, (_, i) => `00000${i}.${body.format ? 'vp9' : 'png'}`), 'nothing is there by halves');
    fs.rmSync(filler);
    const last = await end(id, { of: own });
    assert.equal(last.event, 'done');
    const what = body.format ? 'movie' : 'frames/8';
    const result = await bytes(await own.fetch(`${API}/${id}/${what}`));
    assert.ok(result.length > 200);
    const whole = await make(body);
    const { data: { bytes: size } } = await end(whole);
    if (!body.format) assert.ok(result.equals(await frame(whole, 8)));
    if (body.format && drawn === 3) assert.ok(last.data.bytes > size, 'it went on with a key frame');
    else assert.equal(last.data.bytes, size);
    assert.equal((await own.fetch(`${API}/${id}`, { method: 'DELETE' })).status, 204);
    await gone(path.join(seen, name, id));
  }
  assert.equal(await own.stop(), 0);
});

test('a full store of frames takes no further path until one is deleted', async () => {
  const args = [...VOLUME, '--state', newFolder()];
  let own = await Daemon.start(args, { backend: 'cpu' });
  await own.loaded('engine');
  const id = await make(pathOf(), own);
  const { data } = await end(id, { of: own });
  assert.equal(await own.stop(), 0);
  assert.ok(data.bytes > 1024);
  own = await Daemon.start([...args, '--path-bytes', '1K'], { backend: 'cpu' });
  await own.loaded('engine');
  const full = await own.post(API, pathOf());
  assert.equal(full.status, 507);
  assert.match(full.json.detail, new RegExp(`use ${data.bytes} bytes and --path-bytes allows 1024`));
  await own.fetch(`${API}/${id}`, { method: 'DELETE' });
  for (let status = 507; status !== 202;) status = (await own.post(API, pathOf())).status; // once its files are gone
  assert.equal(await own.stop(), 0);
});

test('a volume that is unloaded ends its path with a reason', async () => {
  const own = await Daemon.start(VOLUME, { backend: 'cpu' });
  await own.loaded('engine');
  await own.post('/api/v1/volumes', { uri: 'demo:phantom?size=16', id: 'passing' });
  await own.loaded('passing');
  const id = await make(pathOf({ ...LONG, view: { volume: 'passing' } }), own);
  await event(id, (e) => e.data.done >= 1, { of: own });
  for (;;) { // between two frames nobody uses it
    const { status } = await own.fetch('/api/v1/volumes/passing', { method: 'DELETE' });
    if (status === 204) break;
    assert.equal(status, 409);
  }
  const last = await end(id, { of: own });
  assert.equal(last.event, 'failed');
  assert.match(last.data.reason, /passing/);
  assert.equal(await own.stop(), 0);
});

test('stills do not wait for a path, and it does not end for them', async () => {
  const id = await make(pathOf(LONG));
  await event(id, (e) => e.data.done >= 1);
  for (let n = 0; n < 5; n++) {
    const answer = await daemon.fetch(`/api/v1/render?format=png`, {
      method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify({ volume: 'engine', size: [16, 16 + n] }) });
    assert.equal(answer.status, 200);
    await bytes(answer);
  }
  const { json } = await daemon.json(`${API}/${id}`);
  assert.equal(json.state, 'running', 'five stills were drawn before the path was');
  await daemon.fetch(`${API}/${id}`, { method: 'DELETE' });
});

test('without --state frames lie in a folder of their own that ends with the daemon', async () => {
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

test('what a daemon without --state leaves when it is killed is removed by the next one, and nothing else', async () => {
  const folder = newFolder();
  const start = async () => {
    const own = await Daemon.start(VOLUME, { backend: 'cpu', prefix: ['env', `TMPDIR=${folder}`] });
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
  const others = ['splatd-frames-notours', 'splatd-else'];
  for (const other of others) fs.mkdirSync(path.join(folder, other, 'keep'), { recursive: true });
  const next = await start();
  const names = fs.readdirSync(folder);
  assert.ok(!names.includes(left), `${left} of ${names}`);
  assert.equal(names.length, 4);
  for (const other of others) assert.ok(fs.existsSync(path.join(folder, other, 'keep')));
  assert.equal((await lives.fetch(`${API}/${there}/frames/8`)).status, 200);
  assert.equal(await next.stop(), 0);
  assert.equal(await lives.stop(), 0);
  assert.deepEqual(fs.readdirSync(folder).sort(), others.sort());
});
