// SPDX-License-Identifier: Apache-2.0
// Camera paths of several tokens: fair rendering, quotas and ownership.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import path from 'node:path';
import { test } from 'node:test';
import { compare } from '../support/compare.mjs';
import { Daemon } from './harness.mjs';
import { API, bytes, end, event, frame, make, newFolder, pathOf, VOLUME } from './paths_helper.mjs';

const TOKENS = { admin: 'token-of-admin-0123456789', bob: 'token-of-bob-0123456789', eve: 'token-of-eve-0123456789' };

/** Starts a daemon with several tokens: {own, as(name): the daemon with the token of `name`, allow(quota): sets the quota of bob}. */
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
    return own.until(() => own.log.slice(before).includes('reloaded'), 'the token file to be reloaded');
  };
  return { own, as, allow };
}
const ENDLESS = { size: [200, 200], frames: 9999 };

test('tokens share the renderer fairly; each has its own quota and sees only its own paths', async () => {
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
  assert.equal((await end(quick, { of: eve })).event, 'done', 'the path of eve does not wait for all frames of bob');
  const state = async (id) => (await own.json(`${API}/${id}`)).json;
  assert.equal((await state(first)).state, 'running');
  assert.deepEqual([(await state(second)).state, (await state(second)).done], ['waiting', 0], 'the oldest path of bob is rendered first');
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
  assert.equal((await bob.post(API, pathOf())).status, 202, 'the quota has capacity again');
  assert.equal(await own.stop(), 0);
});

test('the files of the paths of a token have a quota: over it, its paths wait, and resume when the quota has capacity', async () => {
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
  compare(bytes, '>', 2048);
  compare(bytes, '<=', 3072);
  const { data } = await end(await make(pathOf({ frames: 50 }), eve), { of: eve });
  assert.equal(data.state, 'done', 'paths of other tokens do not wait');
  compare(data.bytes, '>', 3072);
  await bob.fetch(`${API}/${first}`, { method: 'DELETE' });
  await event(second, (e) => e.data.done >= done, { of: bob });
  await allow('path-bytes=1K');
  const over = await bob.post(API, pathOf());
  assert.equal(over.status, 429);
  assert.ok(over.headers.get('retry-after'));
  assert.match(over.json.detail, /the camera paths of bob use \d+ bytes and its token allows 1024; delete finished ones/);
  assert.equal((await eve.post(API, pathOf())).status, 202);
  await allow('path-bytes=1M');
  assert.equal((await end(second, { of: bob })).event, 'done', 'a larger quota resumes the path');
  assert.equal(await own.stop(), 0);
});

test('the quota counts a movie and its packets together while the movie is written', async () => {
  const body = pathOf({ format: 'webm', size: [64, 48], frames: 9 });
  const whole = (await end(await make(body))).data.bytes;
  const { own, as, allow } = await shared([], `path-bytes=${Math.floor(1.5 * whole)}`);
  const bob = as('bob');
  const id = await make(body, bob);
  const { data } = await event(id, (e) => e.data.reason, { of: bob });
  assert.deepEqual([data.state, data.done], ['waiting', 9], 'all packets exist');
  assert.match(data.reason, /the camera paths of bob use \d+ bytes, the movie up to \d+, and its token allows \d+/);
  const [has, needs] = /use (\d+) bytes, the movie up to (\d+)/.exec(data.reason).slice(1).map(Number);
  assert.equal(has, data.bytes);
  compare(needs, '>=', whole);
  assert.equal((await bob.fetch(`${API}/${id}/movie`)).status, 409);
  await allow(`path-bytes=${has + needs}`);
  const last = await end(id, { of: bob });
  assert.deepEqual([last.event, last.data.bytes], ['done', whole], 'the packets are deleted');
  assert.equal((await make(pathOf({ frames: 1, keyframes: [{ time: 0, view: {} }] }), bob)).length, 32, 'the reserved bytes are returned');
  assert.equal(await own.stop(), 0);
});

test('a movie rendered in turns with another path equals one rendered without interruption', async () => {
  const { own, as } = await shared();
  const other = await make(pathOf(ENDLESS), as('bob'));
  const frames = 10;
  const body = pathOf({ format: 'webm', frames, size: [64, 48] });
  const movie = async (id) => bytes(await own.fetch(`${API}/${id}/movie`));
  const inTurns = await make(body, as('eve'));
  assert.equal((await end(inTurns, { of: own })).event, 'done');
  compare((await own.json(`${API}/${other}`)).json.done, '>=', frames - 1, 'frames of the two paths alternate');
  await own.fetch(`${API}/${other}`, { method: 'DELETE' });
  const alone = await make(body, as('eve'));
  assert.equal((await end(alone, { of: own })).event, 'done');
  assert.equal((await movie(inTurns)).length, (await movie(alone)).length);
  assert.equal(await own.stop(), 0);
});

test('the owner of a path is known after a restart', async () => {
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
