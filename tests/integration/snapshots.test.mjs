// SPDX-License-Identifier: Apache-2.0
// Images of the view of a session for clients with a join token, charged to the owner's quota; names of saved views.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdtemp, rm, writeFile } from 'node:fs/promises';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { Daemon } from './harness.mjs';

const TOKENS = { ann: 'a'.repeat(24), bob: 'b'.repeat(24), root: 'r'.repeat(24) };
let folder;
let daemon;

async function start() {
  const started = await Daemon.start(['--volume', 'demo:engine?size=16', '--token-file', path.join(folder, 'tokens'),
  '--state', path.join(folder, 'state'), '--frame-size', '1024x512'], { backend: 'cpu' });
  started.token = TOKENS.root;
  await started.loaded('engine');
  return started;
}

before(async () => {
  folder = await mkdtemp(path.join(tmpdir(), 'splatd-snapshots-'));
  await writeFile(path.join(folder, 'tokens'), [
    `${TOKENS.ann} role=control name=ann frame-size=512x512 snapshots=1`,
    `${TOKENS.bob} role=control name=bob`,
    `${TOKENS.root} role=admin name=root`, ''].join('\n'), { mode: 0o600 });
  daemon = await start();
});
after(async () => {
  assert.equal(await daemon.stop(), 0);
  await rm(folder, { recursive: true });
});

const send = (token, method, what, body) => daemon.fetch(`/api/v1/${what}`, {
  token, method, headers: body && { 'Content-Type': 'application/json' }, body: body && JSON.stringify(body) });
const json = async (...args) => {
  const answer = await send(...args);
  return { status: answer.status, json: answer.status === 204 ? null : await answer.json() };
};
const bytes = async (answer) => Buffer.from(await answer.arrayBuffer());
const session = async (token, view = { size: [40, 30] }) => (await json(token, 'POST', 'sessions', { view })).json;

test('a snapshot equals POST /render of the view, also for watchers, in the asked size and with the asked background', async () => {
  const { id, tokens, view } = await session(TOKENS.bob);
  const drawn = (changes) => send(TOKENS.bob, 'POST', 'render?format=png', { ...view, ...changes }).then(bytes);
  for (const token of [tokens.view, tokens.control, TOKENS.bob, TOKENS.root]) {
    const snapshot = await send(token, 'GET', `sessions/${id}/snapshot?format=png`);
    assert.equal(snapshot.status, 200);
    assert.ok((await bytes(snapshot)).equals(await drawn({})));
  }
  const other = await bytes(await send(tokens.view, 'GET', `sessions/${id}/snapshot?format=png&size=20,50&background=[0,0,0,0]`));
  assert.ok(other.equals(await drawn({ size: [20, 50], background: [0, 0, 0, 0] })));
  assert.ok(!other.equals(await drawn({ size: [20, 50] })), 'the background counts');
  await json(TOKENS.bob, 'PATCH', `sessions/${id}`, { view: { camera: { fov_y: 12 } } });
  assert.ok((await bytes(await send(tokens.view, 'GET', `sessions/${id}/snapshot?format=png`))).equals(await drawn({ camera: { ...view.camera, fov_y: 12 } })));
});

test('a snapshot needs a token of the session or the daemon', async () => {
  const one = await session(TOKENS.bob);
  const two = await session(TOKENS.bob);
  for (const token of [null, 'x', two.tokens.control]) {
    assert.equal((await send(token, 'GET', `sessions/${one.id}/snapshot`)).status, 401);
  }
  assert.equal((await send(TOKENS.root, 'GET', `sessions/${'0'.repeat(16)}/snapshot`)).status, 404);
});

test('guests have the limits of the owner, and max_pixels tells the size', async () => {
  const ann = await session(TOKENS.ann);
  const bob = await session(TOKENS.bob);
  assert.deepEqual([ann.max_pixels, bob.max_pixels], [512 * 512, 1024 * 512]);
  assert.equal((await json(ann.tokens.view, 'GET', `sessions/${ann.id}`)).json.max_pixels, 512 * 512);
  const sized = async ({ id, tokens }, size) => (await json(tokens.view, 'GET', `sessions/${id}/snapshot?format=png&size=${size}`)).json;
  const over = await sized(ann, '513,512');
  assert.deepEqual([over.status, over.pointer], [422, '/size']);
  assert.equal((await sized(bob, '1024,513')).status, 422);
  const snapshot = (guest) => send(guest.tokens.view, 'GET', `sessions/${guest.id}/snapshot?format=png&size=64,64`).then(async (answer) => {
    await bytes(answer);
    return answer.status;
  });
  const many = await Promise.all(Array.from({ length: 12 }, () => snapshot(ann)));
  assert.deepEqual([...new Set(many)].sort(), [200, 429], `ann has one snapshot at a time: ${many}`);
  assert.deepEqual(await Promise.all(Array.from({ length: 4 }, () => snapshot(bob))), [200, 200, 200, 200]);
});

test('a saved view can be named by the token that saved it; name and time survive a restart', async () => {
  const { id } = (await json(TOKENS.ann, 'POST', 'views', { size: [24, 16] })).json;
  const before_ = (await json(TOKENS.ann, 'GET', `views/${id}`)).json;
  assert.equal((await json(TOKENS.bob, 'PATCH', `views/${id}`, { name: 'mine' })).status, 403);
  assert.equal((await json(TOKENS.ann, 'PATCH', `views/${id}`, { name: 'Front "left", größer' })).status, 204);
  const listed = async (token) => (await json(token, 'GET', 'views')).json.views.find((view) => view.id === id);
  const first = await listed(TOKENS.ann);
  assert.deepEqual({ ...first, saved: 0 }, { id, owner: 'ann', name: 'Front "left", größer', saved: 0, volume: 'engine', size: [24, 16] });
  assert.ok(Math.abs(first.saved - Date.now() / 1000) < 3600);
  assert.equal(await listed(TOKENS.bob), undefined);
  assert.deepEqual((await json(TOKENS.ann, 'GET', `views/${id}`)).json, before_, 'the view does not change');
  assert.equal((await json(TOKENS.ann, 'POST', 'views', { size: [24, 16] })).json.id, id);
  assert.deepEqual(await listed(TOKENS.ann), first, 'saving it again keeps the name');

  assert.equal(await daemon.stop(), 0);
  daemon = await start();
  assert.deepEqual(await listed(TOKENS.ann), first);
  assert.equal((await json(TOKENS.root, 'PATCH', `views/${id}`, { name: null })).status, 204);
  const { name, ...nameless } = first;
  assert.ok(name);
  assert.deepEqual(await listed(TOKENS.ann), nameless);
  assert.equal((await json(TOKENS.ann, 'DELETE', `views/${id}`)).status, 204, 'it still belongs to ann');
});

test('a view that an earlier version saved, whose id is the hash of the view alone, keeps its id', async () => {
  const save = async (token) => (await json(token, 'POST', 'views', { size: [26, 16] })).json.id;
  await save(TOKENS.ann);
  assert.equal(await daemon.stop(), 0);
  const old = execFileSync('python3', ['-c', `
import hashlib, json, sqlite3, sys
db = sqlite3.connect(sys.argv[1])
body = db.execute("SELECT body FROM record WHERE kind = 'view' AND body LIKE '%[26,16]%'").fetchone()[0]
old = hashlib.sha256(body[body.index('"view":') + 7:-1].encode()).hexdigest()[:32]
db.execute("UPDATE record SET id = ? WHERE kind = 'view' AND body = ?", (old, body))
db.commit()
print(old, end='')`, path.join(folder, 'state', 'splatd.db')]).toString();
  daemon = await start();
  const [ann, bob] = [await save(TOKENS.ann), await save(TOKENS.bob)];
  assert.equal(ann, old);
  assert.notEqual(bob, old);
  for (const [token, id] of [[TOKENS.ann, ann], [TOKENS.bob, bob]]) {
    assert.deepEqual((await json(token, 'GET', 'views')).json.views.map((view) => view.id), [id]);
    assert.equal((await json(token, 'DELETE', `views/${id}`)).status, 204);
  }
});
