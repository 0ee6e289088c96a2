// SPDX-License-Identifier: Apache-2.0
// Every pool of the daemon with a greedy owner: a modest owner and an admin still get their part (server/config/README.md, "Pools").
import assert from 'node:assert/strict';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { Daemon } from './harness.mjs';

const TOKENS = { greedy: 'greedy-greedy-greedy', modest: 'modest-modest-modest', root: 'root-root-root-root' };
const MADE = /^20[12]$/;
const LIMIT = 8;
const GREEDY_MAX = LIMIT - LIMIT / 4;
const folder = mkdtempSync(path.join(tmpdir(), 'splatd-pools-test-'));
let daemon;
const as = (name) => {
  const options = { token: TOKENS[name], headers: { 'Content-Type': 'application/json' } };
  return {
    ask: (method, at, body) => daemon.json(`/api/v1/${at}`, { ...options, method, body: body && JSON.stringify(body) }),
    get: (at) => daemon.json(`/api/v1/${at}`, options),
  };
};
const [greedy, modest, root] = Object.keys(TOKENS).map(as);

before(async () => {
  writeFileSync(path.join(folder, 'tokens'), `${TOKENS.root} name=root\n${TOKENS.greedy} name=greedy role=control\n${TOKENS.modest} name=modest role=control\n`, { mode: 0o600 });
  daemon = await Daemon.start(['--token-file', path.join(folder, 'tokens'), '--volume', 'demo:engine?size=8', '--state', path.join(folder, 'state'),
    ...['sessions', 'hibernated-sessions', 'views', 'presets', 'paths', 'uploads', 'participants'].flatMap((name) => [`--${name}`, String(LIMIT)]),
    '--upload-bytes', '8K', '--memory', '1M']);
  while ((await root.get('volumes/engine')).json.state === 'loading');
});
after(async () => {
  assert.equal(await daemon.stop(), 0);
  rmSync(folder, { recursive: true });
});

/** make(who, number): resolves to the answer of a request that takes one place. */
async function share(make, { status = 429, detail }) {
  for (let i = 0; i < GREEDY_MAX; i += 1) assert.match(String((await make(greedy, `g${i}`)).status), MADE, `place ${i}`);
  const over = await make(greedy, 'more');
  assert.equal(over.status, status);
  assert.match(over.json.detail, detail);
  assert.match(String((await make(modest, 'm')).status), MADE, 'the modest owner gets a place');
  assert.match(String((await make(root, 'r')).status), MADE, 'the last place is kept for admins');
}

test('camera paths', () => share((who) => who.ask('POST', 'paths', { view: { volume: 'engine' }, size: [8, 8], frames: 1, keyframes: [{ frame: 0, view: {} }] }),
  { detail: /has 6 camera paths and all tokens 6 of the 8 that --paths allows/ }));

test('saved views', () => share((who, name) => who.ask('POST', 'views', { background: [(name.codePointAt(1) ?? 9) / 200, name.length / 9, 0, 1] }),
  { detail: /greedy has 6 views and all tokens 6 of the 8 that --views allows/ }));

test('presets, which only their owner and admins change', async () => {
  await share((who, name) => who.ask('PUT', `presets/${name}`, { background: [0, 0, 0, 1] }), { detail: /greedy has 6 presets and all tokens 6 of the 8 that --presets allows/ });
  for (const method of ['PUT', 'DELETE']) {
    const answer = await modest.ask(method, 'presets/g0', {});
    assert.equal(answer.status, 403);
    assert.match(answer.json.detail, /another token saved the preset 'g0'; that token or an admin may change it/);
  }
  assert.equal((await greedy.ask('PUT', 'presets/g0', { background: [1, 0, 0, 1] })).status, 204);
  assert.equal((await root.ask('PUT', 'presets/g0', { background: [0, 1, 0, 1] })).status, 204);
  assert.deepEqual((await modest.get('presets/g0')).json, { background: [0, 1, 0, 1] });
  assert.equal((await greedy.ask('DELETE', 'presets/g0')).status, 204, 'an admin\'s change leaves the owner');
  assert.equal((await root.ask('DELETE', 'presets/m')).status, 204);
});

test('uploads: places and bytes', async () => {
  const upload = (bytes) => (who, name) => who.ask('POST', 'uploads', { name: `${name}.nrrd`, bytes });
  await share(upload(1), { status: 507, detail: /greedy has 6 uploads and may have 6 \(its share of --uploads\)/ });
  const { json } = await root.get('uploads');
  for (const { id } of json.uploads) assert.equal((await root.ask('DELETE', `uploads/${id}`)).status, 204);
  assert.equal((await upload(6144)(greedy, 'g')).status, 201);
  assert.equal((await upload(1)(greedy, 'h')).status, 507);
  assert.equal((await upload(1536)(modest, 'm')).status, 201);
  assert.equal((await upload(512)(root, 'r')).status, 201);
});

/** Sessions with a participant each, which cannot hibernate. */
const hold = async (who) => {
  const made = await who.ask('POST', 'sessions', {});
  if (made.status !== 201) return made;
  made.stream = await daemon.stream({ session: made.json, token: made.json.tokens.control });
  await made.stream.note('session.participants', (p) => p.you > 0); // from now on it has a participant
  return made;
};

test('active sessions, and forks of guests', async () => {
  const made = [];
  await share(async (who) => {
    const answer = await hold(who);
    made.push(answer);
    return answer;
  }, { detail: /greedy has 6 active sessions and all owners 6 of the 8 that --sessions allows/ });
  for (const { json, stream } of made) {
    await stream?.end();
    if (json.id) assert.equal((await root.ask('DELETE', `sessions/${json.id}`)).status, 204);
  }
  const { json: host } = await modest.ask('POST', 'sessions', {});
  const fork = () => daemon.post('/api/v1/sessions', { from: host.id }, { token: host.tokens.control });
  const forks = [];
  for (;;) {
    const answer = await fork();
    if (answer.status !== 201) {
      assert.equal(answer.status, 429);
      assert.match(answer.json.detail, /the guests of this session's owner have \d active sessions/);
      break;
    }
    forks.push(answer.json.id);
  }
  assert.ok(forks.length > 0 && forks.length < GREEDY_MAX);
  assert.equal((await modest.ask('POST', 'sessions', {})).status, 201, 'the owner still has a place');
  assert.equal((await greedy.ask('POST', 'sessions', {})).status, 201, 'so has another one');
  for (const { id } of (await root.get('sessions')).json.sessions) await root.ask('DELETE', `sessions/${id}`);
});

test('hibernated sessions: those of the owner with the most end first', async () => {
  const { json: kept } = await modest.ask('POST', 'sessions', {});
  for (let i = 0; i < 3 * LIMIT; i += 1) assert.equal((await greedy.ask('POST', 'sessions', {})).status, 201, `session ${i}`);
  assert.equal((await modest.get(`sessions/${kept.id}`)).status, 200);
  const { json } = await root.get('sessions?limit=100');
  assert.ok(json.sessions.length <= 2 * LIMIT, 'active and hibernated');
  assert.equal((await root.ask('POST', 'sessions', {})).status, 201);
  for (const { id } of json.sessions) await root.ask('DELETE', `sessions/${id}`);
});

test('participants: guests leave a place to the owner', async () => {
  let { json: session } = await modest.ask('POST', 'sessions', {});
  const guests = [];
  const join = async (token) => {
    const guest = await daemon.stream({ session, token });
    guests.push(guest);
    await guest.note('session.participants', (p) => p.you > 0); // from now on the guest has its place
  };
  for (let i = 0; i < LIMIT - 1; i += 1) await join(session.tokens.view);
  await assert.rejects(daemon.stream({ session, token: session.tokens.view }), { status: 503 });
  await join(TOKENS.modest);
  await assert.rejects(daemon.stream({ session, token: TOKENS.root }), { status: 503 });
  ({ json: session } = await modest.ask('POST', 'sessions', {}));
  for (let i = 0; i < GREEDY_MAX; i += 1) await join(TOKENS.greedy);
  await assert.rejects(daemon.stream({ session, token: TOKENS.greedy }), { status: 503 });
  for (const token of [session.tokens.view, TOKENS.root]) await join(token);
  for (const guest of guests) await guest.end();
});

test('volumes: memory', async () => {
  const open = (size) => async (who) => {
    const made = await who.ask('POST', 'volumes', { uri: `demo:phantom?size=${size}` });
    for (;;) {
      const { json } = await who.get(`volumes/${made.json.id}`);
      if (json.state !== 'loading') return json;
    }
  };
  const first = await open(52)(greedy);
  assert.equal(first.state, 'ready');
  const over = await open(41)(greedy);
  assert.equal(over.state, 'failed');
  assert.match(over.reason, /the volumes of greedy have \d+ and may have \d+ \(its share of --memory\)/);
  assert.equal((await open(28)(modest)).state, 'ready');
});

test('connections: streams of an owner leave a part to others, and its requests are answered', async () => {
  const most = 16;
  const own = await Daemon.start(['--token-file', path.join(folder, 'tokens'), '--volume', 'demo:engine?size=8', '--connections', String(most)]);
  const ask = (name, method, at) => own.json(`/api/v1/${at}`, { token: TOKENS[name], headers: { 'Content-Type': 'application/json' }, method, ...(method === 'POST' ? { body: '{}' } : {}) });
  while ((await ask('root', 'GET', 'volumes/engine')).json.state === 'loading');
  const { json: session } = await ask('greedy', 'POST', 'sessions');
  const streams = [];
  const join = async (token) => streams.push(await own.stream({ session, token }));
  await assert.rejects(async () => { for (;;) await join(TOKENS.greedy); }, { status: 429 });
  assert.ok(streams.length > most / 2 && streams.length <= most - most / 4, `${streams.length} streams`);
  assert.equal((await ask('greedy', 'GET', 'sessions')).status, 200);
  assert.equal((await own.json('/healthz')).status, 200);
  await join(TOKENS.modest);
  await join(TOKENS.root);
  await join(session.tokens.view);
  for (const stream of streams) await stream.end();
  assert.equal(await own.stop(), 0);
});

test('slices, regions and what a view leaves visible are computed in turn, off the threads of HTTP and of streams', async () => {
  const { json: session } = await greedy.ask('POST', 'sessions', {});
  const stream = await daemon.stream({ session, token: session.tokens.control });
  const region = { kind: 'rectangle', points: [[0, 0, 4], [7, 0, 4], [0, 7, 4]] };
  const put = await stream.call('measure.put', { id: 'r', ...region });
  assert.equal(put.kind, 'rectangle');
  const answers = await Promise.all([greedy.ask('POST', 'measure', { volume: 'engine', ...region }), modest.ask('POST', 'measure', { volume: 'engine', ...region }),
    daemon.json(`/api/v1/sessions/${session.id}/visible`, { token: session.tokens.view }), greedy.ask('GET', 'volumes/engine/slice?axis=0&index=3&format=png').catch(() => null)]);
  assert.deepEqual(answers.slice(0, 3).map(({ status }) => status), [200, 200, 200]);
  await stream.end();
  await root.ask('DELETE', `sessions/${session.id}`);
});
