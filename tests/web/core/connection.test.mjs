// SPDX-License-Identifier: Apache-2.0
// The connection with a daemon that fails in every possible way.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { setTimeout as pause } from 'node:timers/promises';
import WebSocket from 'ws';
import { Connection } from '../../../clients/web/core/connection.js';
import { compare } from '../../support/compare.mjs';
import { MockDaemon, frameMessage, volume } from '../support/mock-daemon.mjs';

const DEADLINE_MS = 20000;

/** Timers that a test fires by hand; changed() is called when a timer is set. */
function handTimers() {
  const timers = new Map();
  let id = 0;
  return {
    changed: () => {},
    setTimeout(then, ms) {
      id += 1;
      timers.set(id, { then, ms });
      this.changed();
      return id;
    },
    clearTimeout: (key) => timers.delete(key),
    has: (ms) => [...timers.values()].some((timer) => timer.ms === ms),
    /** Fires the timer that was set with this delay. */
    fire(ms) {
      const [key, timer] = [...timers].find(([, t]) => t.ms === ms);
      timers.delete(key);
      timer.then();
    },
  };
}

async function setUp(context, { daemon: options = {}, client = {}, timers = null } = {}) {
  const daemon = await MockDaemon.start(options);
  const it = { daemon, states: [], events: [], last: null };
  const clock = timers ?? { setTimeout, clearTimeout };
  it.connection = new Connection({
    base: daemon.base, token: daemon.token, lastView: () => it.last, size: () => [320, 240], ...client,
    env: {
      fetch, WebSocket, now: () => performance.now(), setTimeout: (f, ms) => clock.setTimeout(f, ms),
      clearTimeout: (id) => clock.clearTimeout(id),
    },
  });
  const waiting = new Set();
  const checkAll = () => [...waiting].forEach((check) => check());
  if (timers) timers.changed = checkAll;
  const record = (name) => (payload) => {
    it.events.push({ name, ...(name === 'fault' ? { message: payload.message } : payload) });
    if (name === 'state') it.states.push(payload.state);
    checkAll();
  };
  for (const name of ['state', 'session', 'frame', 'notification', 'fault', 'volumes']) it.connection.on(name, record(name));
  it.until = (what, condition) => new Promise((resolve, reject) => {
    const late = setTimeout(() => {
      waiting.delete(check);
      reject(new Error(`${what}: not within ${DEADLINE_MS} ms; states: ${it.states}`));
    }, DEADLINE_MS);
    const check = () => {
      const value = condition();
      if (!value) return;
      clearTimeout(late);
      waiting.delete(check);
      resolve(value);
    };
    waiting.add(check);
    check();
  });
  it.state = (name) => it.until(name, () => it.connection.state === name);
  it.event = (name, filter = () => true) => it.until(name, () => it.events.find((e) => e.name === name && filter(e)));
  context.after(async () => {
    if (it.connection.state !== 'stopped') it.connection.stop();
    await it.daemon.kill().catch(() => {});
  });
  return it;
}

test('the connection leads from an address to the first frame', async (context) => {
  const it = await setUp(context);
  it.connection.start();
  const frame = await it.event('frame');
  assert.deepEqual([frame.frame, frame.seq, frame.width, frame.height, frame.type], [1, 0, 320, 240, 'image/png']);
  assert.deepEqual(it.states, ['seeking', 'joining', 'live']);
  const session = await it.event('session');
  assert.ok(session.isNew);
  assert.deepEqual([...it.daemon.sessions.values()][0].created, { volume: 'phantom', size: [320, 240] });
  it.connection.notify('stream.ack', { frame: 1 });
  assert.deepEqual(await it.connection.call('view.update', { seq: 1, patch: { background: [1, 1, 1, 1] } }), { seq: 1 });
  assert.equal([...it.daemon.streams][0].acked, 1);
  await it.event('frame', (f) => f.seq === 1);
});

test('the requested volume is used, although another is first in the list', async (context) => {
  const it = await setUp(context, { daemon: { volumes: [volume('a'), volume('b')] }, client: { volume: 'b' } });
  it.connection.start();
  assert.equal((await it.event('session')).view.volume, 'b');
});

test('an old list of volumes does not replace a newer one', async (context) => {
  const it = await setUp(context);
  const answers = [];
  it.connection.api.volumes = () => new Promise((resolve) => { answers.push(resolve); });
  const [old, recent] = [it.connection.refresh(), it.connection.refresh()];
  answers[1]([volume('a'), volume('b')]);
  assert.equal((await recent).length, 2);
  answers[0]([volume('a')]);
  assert.equal((await old).length, 2);
  assert.deepEqual(it.connection.volumes.map(({ id }) => id), ['a', 'b']);
});

test('nor does the list that the start asked for', async (context) => {
  const it = await setUp(context);
  const answers = [];
  it.connection.api.volumes = () => new Promise((resolve) => { answers.push(resolve); });
  it.connection.prepare();
  const recent = it.connection.refresh();
  answers[1]([volume('phantom'), volume('b')]);
  assert.equal((await recent).length, 2);
  it.connection.start();
  answers[0]([volume('phantom')]);
  await it.event('session');
  assert.deepEqual(it.connection.volumes.map(({ id }) => id), ['phantom', 'b']);
});

test('the list of volumes that prepare() requested is the one that start() uses', async (context) => {
  const it = await setUp(context);
  it.connection.prepare();
  assert.deepEqual(it.states, []);
  it.connection.start();
  await it.event('frame');
  assert.equal(it.daemon.requests.filter((request) => /^GET .*\/volumes$/.test(request)).length, 1);
});

test('start() reports a failure of prepare()', async (context) => {
  const it = await setUp(context, { client: { token: 'wrong' } });
  it.connection.prepare();
  it.connection.start();
  assert.equal((await it.event('state', (e) => e.state === 'refused')).error.status, 401);
  it.connection.useToken('secret');
  await it.event('frame');
});

test('a wrong token is refused with 401, and a valid token given later works', async (context) => {
  const it = await setUp(context, { client: { token: 'wrong' } });
  it.connection.start();
  const refused = await it.event('state', (e) => e.state === 'refused');
  assert.equal(refused.error.status, 401);
  it.connection.useToken('secret');
  await it.event('frame');
});

test('the connection waits for a volume that is loading', async (context) => {
  const it = await setUp(context, { daemon: { volumes: [volume('slow', { state: 'loading', progress: 0.4 })] } });
  it.connection.start();
  await it.state('waiting');
  it.daemon.volumes = [volume('slow')];
  await it.event('frame');
  assert.equal((await it.event('session')).view.volume, 'slow');
});

test('without volumes, or with failed ones only, the connection waits and continues when a volume is ready', async (context) => {
  const timers = handTimers();
  const it = await setUp(context, { daemon: { volumes: [volume('bad', { state: 'failed' })] }, timers });
  it.connection.start();
  await it.until('a slow poll', () => timers.has(2000));
  it.daemon.volumes = [];
  timers.fire(2000);
  await it.until('the next poll', () => timers.has(2000));
  it.daemon.volumes = [volume('phantom')];
  timers.fire(2000);
  await it.event('frame');
});

test('after a lost stream the connection rejoins the same session', async (context) => {
  const it = await setUp(context);
  it.connection.start();
  await it.event('frame');
  it.daemon.dropStreams();
  await it.event('state', (e) => e.state === 'lost');
  it.events.length = 0;
  await it.event('frame');
  assert.equal((await it.event('session')).isNew, false);
  assert.equal(it.daemon.sessions.size, 1);
});

test('after a restart of the daemon the connection creates a session with the last view', async (context) => {
  const it = await setUp(context);
  it.connection.start();
  await it.event('frame');
  const { port } = it.daemon;
  it.last = { volume: 'phantom', background: [1, 0, 0, 1], camera: { position: [1, 2, 3] } };
  await it.daemon.kill();
  await it.state('lost');
  it.daemon = await MockDaemon.start({ port });
  it.events.length = 0;
  await it.event('frame');
  assert.ok((await it.event('session')).isNew);
  assert.deepEqual([...it.daemon.sessions.values()][0].created, { ...it.last, size: [320, 240] });
});

test('a session that ended between the check and the stream is replaced', async (context) => {
  const it = await setUp(context);
  let isFirst = true;
  it.connection.on('session', ({ id }) => {
    if (isFirst) it.daemon.sessions.delete(id);
    isFirst = false;
  });
  it.connection.start();
  await it.event('frame');
  assert.deepEqual(it.states.slice(0, 5), ['seeking', 'joining', 'seeking', 'joining', 'live']);
});

test('retry delays grow up to five seconds, and a retry on request is immediate', async (context) => {
  const timers = handTimers();
  const it = await setUp(context, { timers });
  const { port } = it.daemon;
  await it.daemon.kill();
  it.connection.start();
  const expected = [250, 500, 1000, 2000, 4000, 5000, 5000];
  for (const ms of expected) {
    await it.until(`a retry in ${ms} ms`, () => it.connection.state === 'lost' && timers.has(ms));
    timers.fire(ms);
  }
  await it.until('lost again', () => it.states.filter((s) => s === 'lost').length === expected.length + 1);
  it.daemon = await MockDaemon.start({ port });
  it.connection.retryNow();
  await it.event('frame');
  it.events.length = 0;
  it.daemon.dropStreams();
  const lost = await it.event('state', (e) => e.state === 'lost');
  assert.equal(lost.retryMs, 250, 'a received frame resets the retry delay');
});

test('retries are delayed when the daemon repeatedly loses new sessions', async (context) => {
  const it = await setUp(context, { timers: handTimers() });
  it.connection.on('session', () => it.daemon.sessions.clear());
  it.connection.start();
  const lost = await it.event('state', (e) => e.state === 'lost');
  compare(lost.retryMs, '>=', 2000);
  assert.equal(it.daemon.requests.filter((r) => r.startsWith('POST')).length, 4);
});

test('Retry-After is respected', async (context) => {
  const it = await setUp(context, { daemon: { failWith: 503 }, timers: handTimers() });
  it.connection.start();
  const lost = await it.event('state', (e) => e.state === 'lost');
  assert.equal(lost.retryMs, 2000);
  assert.match(lost.reason, /as asked/);
});

test('a draining daemon is reported, and the connection returns to it later', async (context) => {
  const it = await setUp(context);
  it.connection.start();
  await it.event('frame');
  it.daemon.notifyAll('server.draining', { reason: 'shutting down' });
  const draining = await it.event('state', (e) => e.state === 'draining');
  assert.equal(draining.reason, 'shutting down');
  it.daemon.notifyAll('server.draining');
  it.daemon.dropStreams();
  await it.state('lost');
  await it.state('live');
});

test('a daemon that stops answering is left after an unanswered ping', async (context) => {
  const timers = handTimers();
  const it = await setUp(context, { timers });
  it.connection.start();
  await it.event('frame');
  await it.connection.call('ping');
  it.daemon.isSilent = true;
  timers.fire(5000); // the first ping was answered
  assert.equal(it.connection.state, 'live');
  timers.fire(5000); // the second was not
  assert.equal(it.connection.state, 'lost');
  assert.match(it.events.at(-1).reason, /stopped answering/);
});

test('invalid messages on the stream are reported, and the stream continues', { timeout: 60000 }, async (context) => {
  const it = await setUp(context);
  it.daemon.script = (stream) => {
    stream.frame += 1;
    return [Buffer.from('short'), 'no JSON', frameMessage({ frame: stream.frame, seq: 0, codec: 9 }),
      frameMessage({ frame: stream.frame, seq: stream.seq })];
  };
  it.connection.start();
  await it.event('frame');
  const faults = it.events.filter((e) => e.name === 'fault').map((e) => e.message);
  assert.equal(faults.length, 3);
  assert.match(faults[0], /shorter than its header/);
  assert.match(faults[2], /codec 9/);
  assert.equal(it.connection.state, 'live');
  const [stream] = it.daemon.streams;
  while (stream.acked !== 1) await pause(1); // the frame that cannot be read is acknowledged; the test has a deadline
});

test('open calls are rejected when the stream is lost', async (context) => {
  const it = await setUp(context);
  it.connection.start();
  await it.event('frame');
  it.daemon.isSilent = true;
  const call = it.connection.call('view.get');
  it.daemon.dropStreams();
  await assert.rejects(call, Error);
  await assert.rejects(it.connection.call('ping'), /no stream/);
});

test('joining a shared session needs only its join token', async (context) => {
  const it = await setUp(context);
  it.connection.start();
  const { id, tokens } = await it.event('session');
  const guest = new Connection({
    base: it.daemon.base, token: '', session: { id, token: tokens.view, isJoined: true }, lastView: () => null,
    size: () => [64, 64], env: { fetch, WebSocket, setTimeout, clearTimeout, now: () => performance.now() },
  });
  context.after(() => guest.stop());
  const frame = new Promise((resolve) => { guest.on('frame', resolve); });
  guest.start();
  await frame;
  await assert.rejects(guest.call('view.update', { seq: 1, patch: {} }), (e) => e.code === -32004);
});

test('a shared session that has ended is reported, not replaced', async (context) => {
  const it = await setUp(context, { client: { session: { id: 'gone', token: 'secret', isJoined: true } } });
  it.connection.start();
  const refused = await it.event('state', (e) => e.state === 'refused');
  assert.match(refused.reason, /has ended/);
  assert.equal(it.daemon.sessions.size, 0);
});

test('a requested volume that cannot be shown is reported once, with what is shown instead', async (context) => {
  const volumes = [volume('a'), volume('bad', { state: 'failed', reason: 'no voxels' })];
  for (const [wanted, reason] of [['nosuch', undefined], ['bad', 'no voxels']]) {
    const it = await setUp(context, { daemon: { volumes }, client: { volume: wanted } });
    const missing = [];
    it.connection.on('missing', (event) => missing.push(event));
    it.connection.start();
    await it.event('frame');
    assert.equal((await it.event('session')).view.volume, 'a');
    assert.deepEqual(missing.map((m) => [m.wanted, m.shown.id, m.volume?.reason, m.volumes.length]), [[wanted, 'a', reason, 2]]);
  }
});

/** Restarts the daemon on its port with another token; its sessions survive if `isKept`. */
async function restartWithNewToken(it, isKept) {
  const { port, sessions } = it.daemon;
  await it.daemon.kill();
  await it.state('lost');
  it.daemon = await MockDaemon.start({ port, token: 'new' });
  if (isKept) for (const [id, session] of sessions) it.daemon.sessions.set(id, session);
  it.events.length = 0;
}

test('a restarted daemon with a new token lets the host back into its session, first by the join token', async (context) => {
  const it = await setUp(context);
  it.connection.start();
  const { id } = await it.event('session');
  await it.event('frame');
  await restartWithNewToken(it, true);
  await it.event('frame');
  const back = await it.event('session');
  assert.deepEqual([back.id, back.isNew, back.isLocked, back.isJoined, back.replaced], [id, false, true, true, null]);
  assert.deepEqual(await it.connection.call('view.update', { seq: 1, patch: { background: [1, 1, 1, 1] } }), { seq: 1 }, 'with control');
  it.events.length = 0;
  it.connection.useToken('new');
  await it.event('frame');
  const own = await it.event('session');
  assert.deepEqual([own.id, own.isNew, own.isLocked, own.isJoined], [id, false, false, false]);
  assert.equal(it.daemon.sessions.size, 1);
  assert.equal((await it.connection.refresh()).length, 1, 'the daemon accepts the token again');
});

test('a restarted daemon without the session needs the new token; then a new session replaces the old one', async (context) => {
  const it = await setUp(context);
  it.connection.start();
  const { id } = await it.event('session');
  await it.event('frame');
  it.last = { volume: 'phantom', background: [1, 0, 0, 1] };
  await restartWithNewToken(it, false);
  assert.equal((await it.event('state', (e) => e.state === 'refused')).error.status, 401);
  it.connection.useToken('new');
  const made = await it.event('session');
  assert.deepEqual([made.isNew, made.replaced], [true, id]);
  assert.deepEqual(made.view.background, [1, 0, 0, 1], 'with the last view');
});

test('a session that is known by its id alone is joined by the token of the daemon', async (context) => {
  const it = await setUp(context);
  it.connection.start();
  const { id } = await it.event('session');
  const again = new Connection({
    base: it.daemon.base, token: it.daemon.token, session: { id }, lastView: () => null, size: () => [64, 64],
    env: { fetch, WebSocket, setTimeout, clearTimeout, now: () => performance.now() },
  });
  context.after(() => again.stop());
  const session = new Promise((resolve) => { again.on('session', resolve); });
  again.start();
  assert.deepEqual([(await session).id, (await session).isNew], [id, false]);
  assert.equal(it.daemon.sessions.size, 1);
});

test('a new token from a guest leads to a session of their own', async (context) => {
  const it = await setUp(context, { client: { session: { id: 'gone', token: 'secret', isJoined: true } } });
  it.connection.start();
  await it.event('state', (e) => e.state === 'refused');
  it.connection.useToken(it.daemon.token);
  assert.equal((await it.event('session')).isNew, true);
});

test('another transport carries the requests and the stream', async () => {
  const session = { view: { volume: 'v' }, tokens: {} };
  const seen = [];
  let hearer;
  const transport = {
    request: async (method, path) => {
      seen.push(`${method} ${path}`);
      return Response.json(path.endsWith('/volumes') ? { volumes: [] } : session);
    },
    open: (path, token, heard) => {
      seen.push(`${path} ${token}`);
      hearer = heard;
      return { send: (text) => seen.push(JSON.parse(text).method), close: () => seen.push('close') };
    },
  };
  const connection = new Connection({
    base: 'http://nowhere/', token: 't', session: { id: 's', token: 't', isJoined: true }, lastView: () => null, size: () => [64, 64],
    env: { transport, setTimeout: () => 0, clearTimeout() {}, now: () => 0 },
  });
  const found = new Promise((resolve) => { connection.on('session', resolve); });
  connection.start();
  assert.equal((await found).id, 's');
  hearer.opened();
  assert.equal(connection.state, 'live');
  hearer.closed(1001, 'gone');
  assert.equal(connection.state, 'lost');
  assert.deepEqual(seen, ['GET api/v1/sessions/s', 'GET api/v1/sessions/s/volumes', 'api/v1/sessions/s/stream t', 'ping', 'close']);
});
