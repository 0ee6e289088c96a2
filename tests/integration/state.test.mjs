// SPDX-License-Identifier: Apache-2.0
// What persists across restarts: --state, kill -9 at any moment, and a disk that cannot be written.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdirSync, mkdtempSync, readdirSync, rmSync, statSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { compare } from '../support/compare.mjs';
import { Daemon, nrrd, runToEnd, turned, within } from './harness.mjs';

const TOKEN = 'a-token-for-the-tests-0123456789';
let folder;
let count = 0;
before(() => {
  folder = mkdtempSync(path.join(tmpdir(), 'splatd-state-'));
  writeFileSync(path.join(folder, 'token'), `${TOKEN}\n`);
});
after(() => rmSync(folder, { recursive: true }));

const fresh = () => path.join(folder, `state-${count += 1}`);

async function start(state, args = [], options = {}) {
  const daemon = await Daemon.start(['--state', state, '--token-file', path.join(folder, 'token'), ...args], options);
  daemon.token = TOKEN;
  return daemon;
}

async function killed(daemon) {
  daemon.kill('SIGKILL');
  assert.equal(await within(daemon.ended, 'the end of the daemon'), 'SIGKILL');
  assert.doesNotMatch(daemon.log, /Sanitizer|runtime error/);
}

const render = async (daemon, view) => {
  const answer = await daemon.fetch('/api/v1/render?format=png', {
    method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(view),
  });
  assert.equal(answer.status, 200);
  return Buffer.from(await answer.arrayBuffer());
};

/** Polls for a session from before a restart: it is available once its volume is loaded. */
async function sessionOf(daemon, id, token = TOKEN) {
  for (;;) {
    const answer = await daemon.json(`/api/v1/sessions/${id}`, { token });
    if (answer.status !== 409) return answer;
    assert.ok(answer.headers.get('retry-after'));
    assert.match(answer.json.detail, /waits for its volume/);
  }
}

test('after kill -9 the same links show the same images', async () => {
  const state = fresh();
  const first = await start(state, ['--volume', 'demo:engine?size=24'], { backend: 'cpu' });
  await first.loaded('engine');
  const loaded = await first.post('/api/v1/volumes', { uri: 'demo:phantom?size=16', id: 'head', name: 'a head' });
  assert.equal(loaded.status, 202);
  assert.equal(loaded.headers.get('x-durable'), 'yes');
  await first.loaded('head');
  const session = await first.session({ volume: 'head', size: [40, 30] });
  const other = await first.session({ volume: 'engine' });
  const saved = await first.post('/api/v1/views', { volume: 'engine', size: [20, 20], background: [1, 0, 0, 1] });
  assert.equal(saved.headers.get('x-durable'), 'yes');
  const preset = (daemon, method, body) => daemon.fetch('/api/v1/presets/bones', { method, body, headers: { 'Content-Type': 'application/json' } });
  assert.equal((await preset(first, 'PUT', '{"camera": {"fov_y": 11}}')).headers.get('x-durable'), 'yes');
  assert.equal((await preset(first, 'PUT', '{"camera": {"fov_y": 12}}')).status, 204);
  const savedImage = Buffer.from(await (await first.fetch(`/api/v1/render/${saved.json.id}?format=png`)).arrayBuffer());
  // A change over a stream is written after a delay: a later durable request is written together with it.
  const stream = await first.stream({ session });
  await stream.update(turned(session.view, 500));
  const view = (await first.json(`/api/v1/sessions/${session.id}`)).json.view;
  const shown = await render(first, view);
  assert.equal((await first.fetch(`/api/v1/sessions/${other.id}`, { method: 'DELETE' })).headers.get('x-durable'), 'yes');
  await killed(first);

  const second = await start(state, [], { backend: 'cpu' });
  const back = await sessionOf(second, session.id, session.tokens.view);
  assert.deepEqual(back.json.view, view);
  assert.deepEqual(await render(second, back.json.view), shown);
  assert.deepEqual((await sessionOf(second, session.id)).json.tokens, session.tokens);
  assert.equal((await second.json(`/api/v1/sessions/${session.id}`, { token: 'x'.repeat(32) })).status, 401);
  assert.equal((await second.json(`/api/v1/sessions/${other.id}`)).status, 404, 'a deleted session stays deleted');
  assert.deepEqual(await (await preset(second, 'GET')).json(), { camera: { fov_y: 12 } });
  assert.equal((await preset(second, 'DELETE')).status, 204);
  await second.loaded('engine');
  const again = await second.fetch(`/api/v1/render/${saved.json.id}?format=png`);
  assert.deepEqual(Buffer.from(await again.arrayBuffer()), savedImage);
  const { volumes } = (await second.json('/api/v1/volumes')).json;
  assert.deepEqual(volumes.map((v) => [v.id, v.name, v.state]), [['engine', 'engine', 'ready'], ['head', 'a head', 'ready']]);
  const joined = await second.stream({ session });
  await joined.final();
  await joined.end();
  assert.equal(await second.stop(), 0);

  const third = await start(state, ['--volume', 'demo:engine?size=24']); // the same source does not create a second volume
  assert.equal((await third.json('/api/v1/volumes')).json.volumes.length, 2);
  await third.loaded('head');
  await sessionOf(third, session.id);
  assert.equal((await third.fetch(`/api/v1/sessions/${session.id}`, { method: 'DELETE' })).status, 204);
  assert.equal((await third.fetch('/api/v1/volumes/head', { method: 'DELETE' })).status, 204);
  await killed(third);
  const fourth = await start(state);
  assert.deepEqual((await fourth.json('/api/v1/presets')).json, { presets: [] });
  assert.deepEqual((await fourth.json('/api/v1/volumes')).json.volumes.map((v) => v.id), ['engine']);
  assert.equal((await fourth.json(`/api/v1/sessions/${session.id}`)).status, 404);
  assert.equal(await fourth.stop(), 0);
});

test('after a restart an image that a client has cached gives 304, unless the volume changed', async () => {
  const state = fresh();
  const file = path.join(folder, 'seen.nrrd');
  const other = Buffer.from([...Array(64).keys()]);
  other[63] = 200; // only one voxel differs
  let [id, etag, image] = [];
  const ask = async (daemon) => {
    await daemon.loaded('seen');
    const answer = await daemon.fetch(`/api/v1/render/${id}?format=png`, { headers: { 'If-None-Match': etag ?? '""' } });
    return { status: answer.status, etag: answer.headers.get('etag'), bytes: Buffer.from(await answer.arrayBuffer()) };
  };
  const run = async (voxels, use, options = {}) => {
    writeFileSync(file, nrrd(voxels));
    const daemon = await start(state, ['--volume', file, '--data', folder], { backend: 'cpu', ...options });
    await use(daemon);
    await killed(daemon);
  };
  await run(undefined, async (daemon) => {
    await daemon.loaded('seen');
    id = (await daemon.post('/api/v1/views', { volume: 'seen', size: [24, 16] })).json.id;
    ({ etag, bytes: image } = await ask(daemon));
    assert.equal((await ask(daemon)).status, 304);
  });
  await run(undefined, async (daemon) => assert.deepEqual(await ask(daemon), { status: 304, etag, bytes: Buffer.alloc(0) }));
  await run(other, async (daemon) => {
    const changed = await ask(daemon);
    assert.equal(changed.status, 200);
    assert.notEqual(changed.etag, etag);
    assert.ok(!changed.bytes.equals(image));
  });
  await run(undefined, async (daemon) => { // and when it is reloaded while the daemon runs
    for (const [voxels, status] of [[other, 200], [undefined, 304]]) {
      await daemon.loaded('seen');
      assert.equal((await daemon.fetch('/api/v1/volumes/seen', { method: 'DELETE' })).status, 204);
      writeFileSync(file, nrrd(voxels));
      assert.equal((await daemon.post('/api/v1/volumes', { path: 'seen.nrrd' })).status, 202);
      assert.equal((await ask(daemon)).status, status);
    }
  });
  await run(undefined, async (daemon) => assert.equal((await ask(daemon)).status, 200, 'another backend gives other bytes'), { backend: 'null' });
});

test('changes of a view are written automatically, soon, and combined', async () => {
  const state = fresh();
  const daemon = await start(state, ['--volume', 'demo:engine?size=8']);
  await daemon.loaded('engine');
  const stream = await daemon.stream();
  const writes = async () => Number(/^splatd_state_writes_total (\d+)$/m.exec(await (await daemon.fetch('/metrics')).text())[1]);
  const before_ = await writes();
  for (let i = 1; i <= 100; i += 1) await stream.update({ background: [i / 100, 0, 0, 1] }, i);
  const during = await writes() - before_;
  compare(during, '<', 50, `${during} writes of 100 changes`);
  // Wait until a second program reads the last change from a copy of the database.
  const read = () => execFileSync('python3', ['-c', `
import json, sqlite3, sys
row = sqlite3.connect('file:' + sys.argv[1] + '?mode=ro', uri=True).execute("SELECT body FROM record WHERE kind = 'session'").fetchone()
print(json.loads(row[0])['view']['background'][0])`, path.join(state, 'splatd.db')], { encoding: 'utf8' });
  for (const end = Date.now() + 30000; Number(read()) !== 1;) compare(Date.now(), '<', end, `still ${read()}`);
  await killed(daemon);
  const again = await start(state);
  await again.loaded('engine');
  assert.deepEqual((await sessionOf(again, stream.session.id)).json.view.background, [1, 0, 0, 1]);
  assert.equal(await again.stop(), 0);
});

/** Sends requests until the daemon dies, and records confirmed changes in `confirmed`. */
async function work(daemon, confirmed, round) {
  try {
    const session = await daemon.session({ size: [16, 16] });
    confirmed.sessions.set(session.id, { tokens: session.tokens, x: [] });
    const stream = await daemon.stream({ session });
    for (let i = 1; ; i += 1) {
      const x = round * 1000 + i;
      confirmed.sessions.get(session.id).x.push(x); // this change may persist or not
      await stream.update({ background: [x / 1e6, 0, 0, 1] }, i);
      const saved = await daemon.post('/api/v1/views', { background: [0, x / 1e6, 0, 1] });
      if (saved.status === 201) confirmed.views.set(saved.json.id, x);
      // A durable request is written together with all earlier changes.
      if (saved.status === 201) confirmed.sessions.get(session.id).least = x;
      if (i % 3 === 0) {
        const short = await daemon.session();
        confirmed.ending.add(short.id);
        if ((await daemon.fetch(`/api/v1/sessions/${short.id}`, { method: 'DELETE' })).status === 204) confirmed.deleted.add(short.id);
      }
    }
  } catch { /* the daemon died */ }
}

test('after repeated kill -9 during writes every change confirmed as durable is present', { timeout: 500000 }, async () => {
  const state = fresh();
  const confirmed = { sessions: new Map(), views: new Map(), deleted: new Set(), ending: new Set() };
  const rounds = process.env.SPLATD_SANITIZE ? 5 : 12;
  for (let round = 1; round <= rounds; round += 1) {
    const daemon = await start(state, ['--volume', 'demo:engine?size=8', '--sessions', '2000']);
    await daemon.loaded('engine');
    for (const [id, { tokens, x, least = 0 }] of confirmed.sessions) {
      const { status, json } = await sessionOf(daemon, id);
      assert.equal(status, 200, `session ${id} of ${confirmed.sessions.size}`);
      assert.deepEqual(json.tokens, tokens);
      const shown = Math.round(json.view.background[0] * 1e6);
      compare(shown, '>=', least, `${shown} is not one of ${x}, at least ${least}`);
      assert.ok(shown === 0 || x.includes(shown), `${shown} is not one of ${x}, at least ${least}`);
    }
    for (const [id, x] of confirmed.views) {
      const { status, json } = await daemon.json(`/api/v1/views/${id}`);
      assert.equal(status, 200);
      assert.equal(Math.round(json.background[1] * 1e6), x);
    }
    for (const id of confirmed.deleted) assert.equal((await daemon.json(`/api/v1/sessions/${id}`)).status, 404);
    const writes = confirmed.views.size;
    const workers = [work(daemon, confirmed, round), work(daemon, confirmed, round + 500)];
    // Kill at a different moment each time: after a varying number of answers, while more requests are running.
    while (confirmed.views.size < writes + round * 2) await daemon.json('/healthz', { token: null });
    await killed(daemon);
    await Promise.all(workers);
  }
  compare(confirmed.views.size, '>', rounds);
  compare(confirmed.deleted.size, '>', 0);
  compare(confirmed.sessions.size, '>=', rounds);
});

test('a session whose volume is missing works again when the volume is loaded', async () => {
  const state = fresh();
  const file = path.join(folder, 'cube.nrrd');
  const write = () => writeFileSync(file, nrrd(Buffer.alloc(64, 9)));
  write();
  const first = await start(state, ['--volume', 'demo:engine?size=8', '--data', folder]);
  assert.equal((await first.post('/api/v1/volumes', { path: 'cube.nrrd' })).status, 202);
  await first.loaded('cube');
  const session = await first.session({ volume: 'cube' });
  await killed(first);
  rmSync(file);
  const second = await start(state, ['--data', folder]);
  await second.loaded('engine');
  const volume = (await second.json('/api/v1/volumes/cube')).json;
  assert.equal(volume.state, 'failed');
  const waits = await second.json(`/api/v1/sessions/${session.id}`);
  assert.equal(waits.status, 409);
  assert.match(waits.json.detail, /waits for its volume.*no such file/);
  assert.equal((await second.json(`/api/v1/sessions/${session.id}`, { token: session.tokens.view })).status, 409);
  assert.equal((await second.json(`/api/v1/sessions/${session.id}`, { token: 'x'.repeat(32) })).status, 401);
  await assert.rejects(second.stream({ session }), { status: 409 });
  assert.equal((await second.post('/api/v1/sessions', { from: session.id })).status, 409);
  write(); // restore the file
  assert.equal((await second.post('/api/v1/volumes', { path: 'cube.nrrd' })).status, 202);
  assert.equal((await sessionOf(second, session.id)).status, 200);
  assert.equal(await second.stop(), 0);
  // Without --data the volume is not loaded.
  const third = await start(state);
  assert.match((await third.json('/api/v1/volumes/cube')).json.reason, /--data DIR/);
  assert.equal(await third.stop(), 0);
});

const isHibernated = async (daemon, id) => (await daemon.json('/api/v1/sessions')).json.sessions.find((s) => s.id === id)?.hibernated;

test('an idle session hibernates, uses no volume, and its link shows the same view again', async () => {
  const state = fresh();
  const daemon = await start(state, ['--volume', 'demo:engine?size=8', '--volume', 'demo:phantom?size=8', '--session-time', '0.1']);
  await daemon.loaded('engine');
  await daemon.loaded('phantom');
  const session = await daemon.session({ volume: 'phantom', size: [40, 30] });
  const first = await daemon.stream({ session });
  await first.update(turned(session.view, 100));
  await first.end();
  const hibernates = new RegExp(`session ${session.id} hibernates(?![^]*session ${session.id} is active)`);
  await daemon.untilLogged(hibernates); // on a slow machine it also hibernated before it was joined
  assert.equal(await isHibernated(daemon, session.id), true);
  assert.equal((await daemon.fetch('/api/v1/volumes/phantom', { method: 'DELETE' })).status, 204);
  const gone = await daemon.json(`/api/v1/sessions/${session.id}`, { token: session.tokens.view });
  assert.equal(gone.status, 409);
  assert.equal((await daemon.post('/api/v1/volumes', { uri: 'demo:phantom?size=8' })).status, 202);
  await daemon.loaded('phantom');
  const again = await daemon.stream({ session });
  assert.equal((await again.final()).width, 40);
  assert.equal(await isHibernated(daemon, session.id), false);
  assert.deepEqual((await daemon.json(`/api/v1/sessions/${session.id}`)).json.view.camera.position, turned(session.view, 100).camera.position);
  await again.end();
  await daemon.untilLogged(hibernates);
  const fork = await daemon.post('/api/v1/sessions', { from: session.id }, { token: session.tokens.control });
  assert.equal(fork.status, 201);
  assert.equal((await daemon.fetch(`/api/v1/sessions/${session.id}`, { method: 'DELETE' })).status, 204);
  assert.equal((await daemon.json(`/api/v1/sessions/${session.id}`)).status, 404);
  await killed(daemon);
  const next = await start(state, ['--hibernation-time', '0.1']);
  await next.untilLogged(`session ${fork.json.id} ended: unused`);
  assert.equal((await next.json(`/api/v1/sessions/${fork.json.id}`)).status, 404);
  assert.deepEqual((await next.json('/api/v1/sessions')).json, { sessions: [] });
  assert.equal(await next.stop(), 0);
});

test('hibernation time is counted across restarts by a clock that only runs while a daemon runs', async () => {
  const state = fresh();
  const database = (code) => execFileSync('python3', ['-c', `
import json, sqlite3, sys
db = sqlite3.connect(sys.argv[1])
def body(kind, id): return json.loads(db.execute('SELECT body FROM record WHERE kind = ? AND id = ?', (kind, id)).fetchone()[0])
def put(kind, id, of): db.execute('UPDATE record SET body = ? WHERE kind = ? AND id = ?', (json.dumps(of), kind, id))
${code}
db.commit()`, path.join(state, 'splatd.db')], { encoding: 'utf8' });
  const daemon = await start(state, ['--volume', 'demo:engine?size=8']);
  await daemon.loaded('engine');
  const [session, old] = [await daemon.session(), await daemon.session()];
  assert.equal(await daemon.stop(), 0);
  const ran = () => Number(database("print(body('clock', 'daemon')['ran'])"));
  compare(ran(), '>=', 0, `${ran()} s`);
  compare(ran(), '<', 600, `${ran()} s`);
  // Simulate 30 more days of running daemons, and a record of an older daemon without the time of last use.
  database(`clock, old = body('clock', 'daemon'), body('session', '${old.id}')
assert body('session', '${session.id}')['used'] <= clock['ran'] + 1
clock['ran'] += 2592001
del old['used']
put('clock', 'daemon', clock)
put('session', '${old.id}', old)`);
  const next = await start(state);
  await next.untilLogged(`session ${session.id} ended: unused for 2592000 s`);
  await next.loaded('engine');
  assert.equal((await sessionOf(next, old.id)).status, 200);
  assert.deepEqual((await next.json('/api/v1/sessions')).json.sessions.map((s) => s.id), [old.id]);
  assert.equal(await next.stop(), 0);
  compare(ran(), '>=', 2592001, `${ran()} s`);
});

test('an unusable state folder is refused with the reason and the remedy', async () => {
  const state = fresh();
  const daemon = await start(state);
  assert.equal(statSync(state).mode & 0o777, 0o700);
  for (const name of readdirSync(state)) assert.equal(statSync(path.join(state, name)).mode & 0o077, 0, name);
  const refused = async (of, text) => {
    const { status, err } = await runToEnd(['--listen', '127.0.0.1:0', '--backend', 'null', '--state', of]);
    assert.equal(status, 1);
    assert.match(err.trim().split('\n').at(-1), text);
  };
  await refused(state, /^splatd: .*another splatd uses this folder; give each daemon its own --state/);
  assert.equal(await daemon.stop(), 0);
  writeFileSync(path.join(state, 'splatd.db'), 'no database at all, but long enough to have a header of one hundred bytes, which it has not'.repeat(9));
  await refused(state, /splatd\.db: the database is damaged .*; restore a copy, or move the file away/);
  await refused('/dev/null', /folder/);
});

test('without --state nothing is written, and responses say so', async () => {
  const daemon = await Daemon.start();
  await daemon.loaded('engine');
  const session = await daemon.post('/api/v1/sessions', {});
  assert.equal(session.status, 201);
  assert.equal(session.headers.get('x-durable'), 'no');
  assert.deepEqual((await daemon.json('/readyz', { token: null })).json.state, { status: 'memory', waiting: 0 });
  await daemon.untilLogged(/no --state/);
  assert.equal(await daemon.stop(), 0);
});

test('a volume in a folder whose name is not UTF-8 cannot be stored and is reported as not durable', async () => {
  const data = Buffer.concat([Buffer.from(`${folder}/odd-`), Buffer.from([0xff])]);
  mkdirSync(data);
  const header = 'NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nspacings: 1 1 1\nencoding: raw\n\n';
  writeFileSync(Buffer.concat([data, Buffer.from('/cube.nrrd')]), Buffer.concat([Buffer.from(header), Buffer.alloc(64, 9)]));
  const state = fresh();
  // Node can pass arguments only as UTF-8.
  const daemon = await start(state, [], { prefix: ['bash', '-c', `exec "$@" --data "${folder}/odd-"$'\\xff'`, 'bash'] });
  for (let i = 0; i < 2; i += 1) { // a repeated request gives the same answer
    const answer = await daemon.post('/api/v1/volumes', { path: 'cube.nrrd' });
    assert.equal(answer.status, i ? 201 : 202, JSON.stringify(answer.json));
    assert.equal(answer.headers.get('x-durable'), 'no');
  }
  assert.equal((await daemon.loaded('cube')).state, 'ready');
  assert.equal((await daemon.post('/api/v1/volumes', { uri: 'demo:engine?size=8' })).headers.get('x-durable'), 'yes');
  await daemon.untilLogged(/volume cube will not be loaded again after a restart/);
  assert.equal(await daemon.stop(), 0);
});

test('with a full disk the daemon continues, reports it, and writes the changes later', async () => {
  const state = fresh();
  // Limit the size of files, in blocks of 1 KiB; the limit is lifted later.
  const daemon = await start(state, ['--volume', 'demo:engine?size=8'], { prefix: ['bash', '-c', 'ulimit -S -f 96; exec "$@"', 'bash'] });
  await daemon.loaded('engine');
  const confirmed = [];
  let durable = 'yes';
  for (let i = 0; durable === 'yes'; i += 1) {
    compare(i, '<', 200, 'the disk is never full');
    const answer = await daemon.post('/api/v1/views', { background: [i / 1000, 0, 0, 1] });
    assert.equal(answer.status, 201);
    durable = answer.headers.get('x-durable');
    confirmed.push(answer.json.id);
  }
  const session = await daemon.post('/api/v1/sessions', {});
  assert.equal(session.status, 201);
  assert.equal(session.headers.get('x-durable'), 'no');
  assert.equal((await daemon.json(`/api/v1/views/${confirmed.at(-1)}`)).status, 200);
  const ready = await daemon.json('/readyz', { token: null });
  assert.equal(ready.status, 200);
  assert.equal(ready.json.state.status, 'failing');
  assert.ok(ready.json.state.reason);
  compare(ready.json.state.waiting, '>', 0);
  await daemon.untilLogged('cannot write the state; keeping it in memory');
  execFileSync('prlimit', ['--pid', String(daemon.child.pid), '--fsize=unlimited:']);
  await daemon.untilLogged('state is being written again'); // without a request
  assert.equal((await daemon.json('/readyz', { token: null })).json.state.status, 'written');
  await killed(daemon);
  const again = await start(state);
  await again.loaded('engine');
  for (const id of confirmed) assert.equal((await again.json(`/api/v1/views/${id}`)).status, 200);
  assert.equal((await sessionOf(again, session.json.id)).status, 200);
  assert.equal(await again.stop(), 0);
});

test('when the time of day jumps by years, nothing ends and all state persists', async (t) => {
  const shim = process.env.SPLATD_CLOCK_JUMP;
  if (!shim) return t.skip('SPLATD_CLOCK_JUMP names no library');
  if (process.env.SPLATD_SANITIZE) return t.skip('a sanitizer must be loaded first');
  const state = fresh();
  const args = ['--volume', 'demo:engine?size=8', '--session-time', '60', '--stall-time', '20', '--ping-time', '20'];
  const daemon = await start(state, args, { prefix: ['env', `LD_PRELOAD=${shim}`] });
  await daemon.loaded('engine');
  const session = await daemon.session();
  const stream = await daemon.stream({ session });
  await stream.final();
  for (let i = 1; i <= 5; i += 1) await stream.update(turned(session.view, i), i);
  await stream.final(5);
  const view = (await daemon.json(`/api/v1/sessions/${session.id}`)).json.view;
  assert.equal((await daemon.post('/api/v1/views', {})).headers.get('x-durable'), 'yes');
  const years = new Set([...daemon.log.matchAll(/^time=(\d+)-/gm)].map((match) => Number(match[1])));
  compare(Math.max(...years) - Math.min(...years), '>=', 19, `the clock did not jump: ${[...years]}`);
  assert.equal(stream.closed, null);
  await killed(daemon);
  const again = await start(state, [], { prefix: ['env', `LD_PRELOAD=${shim}`] });
  assert.deepEqual((await sessionOf(again, session.id)).json.view, view);
  assert.equal(await again.stop(), 0);
});
