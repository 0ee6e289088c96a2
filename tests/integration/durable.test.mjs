// SPDX-License-Identifier: Apache-2.0
// Every request that changes something is durable before its answer, and says so: kill -9 right after answers loses none of them.
import assert from 'node:assert/strict';
import { mkdtempSync, readFileSync, renameSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { compare } from '../support/compare.mjs';
import { Daemon, nrrd, within } from './harness.mjs';

const TOKEN = 'a-token-for-the-tests-0123456789';
const MARKER = { kind: 'marker', points: [[1, 1, 1]] };
let folder;
before(() => {
  folder = mkdtempSync(path.join(tmpdir(), 'splatd-durable-'));
  writeFileSync(path.join(folder, 'token'), `${TOKEN}\n`);
});
after(() => rmSync(folder, { recursive: true }));

async function start(args = ['--state', path.join(folder, 'state')]) {
  const daemon = await Daemon.start(['--volume', 'demo:engine?size=8', '--token-file', path.join(folder, 'token'), '--sessions', '500', ...args]);
  daemon.token = TOKEN;
  await daemon.loaded('engine');
  return daemon;
}

const send = (daemon, method, target, body, headers = {}) => daemon.json(`/api/v1/${target}`, {
  method, body: body && !Buffer.isBuffer(body) ? JSON.stringify(body) : body, headers: { 'Content-Type': 'application/json', ...headers },
});

/** The acknowledged facts. A fact has the value that the daemon confirmed, and perhaps a value that a request without an answer gave it. */
class Facts {
  all = new Map();
  acknowledged = 0;
  made = 0; // volumes and saved views: their contents are their identity, so each one is new

  /** From now on `key` may have `value`; `read(daemon)` resolves to the value that a daemon has now. */
  ask(key, value, read) {
    const fact = this.all.get(key) ?? {};
    this.all.set(key, Object.assign(fact, { asked: value, read }));
    return fact;
  }

  /** Asks for a change of `key` to `value`. */
  async change(key, value, request, read) {
    const fact = this.ask(key, value, read);
    const answer = await request;
    assert.ok(answer.status < 300, `${key}: ${answer.status} ${JSON.stringify(answer.json)}`);
    assert.equal(answer.headers.get('x-durable'), 'yes', key);
    Object.assign(fact, { asked: undefined, confirmed: value });
    this.acknowledged += 1;
    return answer.json;
  }

  async check(daemon) {
    const left = [...this.all];
    const checker = async () => {
      while (left.length) {
        const [key, { read, asked, confirmed }] = left.pop();
        const found = await read(daemon);
        assert.ok([asked, confirmed].some((value) => value !== undefined && value === found) || (confirmed === undefined && found === null),
          `${key} is ${found}, confirmed ${confirmed}, asked for ${asked}`);
      }
    };
    await Promise.all(Array.from({ length: 16 }, checker));
  }
}

/** Reads a member of a document, null if there is no such document. */
const reads = (target, member = () => true) => async (daemon) => {
  for (;;) {
    const { status, json } = await daemon.json(`/api/v1/${target}`);
    if (status === 409) continue; // the volume of the session is loading
    assert.ok([200, 404].includes(status), `${target}: ${status} ${JSON.stringify(json)}`);
    return status === 200 ? member(json) : null;
  }
};

const background = ({ view }) => Math.round(view.background[0] * 1e4);

async function work(daemon, facts, name) {
  const change = (key, ...rest) => facts.change(`${name} ${key}`, ...rest);
  const session = await daemon.session({ size: [16, 16] });
  const of = `sessions/${session.id}`;
  const measure = (id) => reads(`${of}/measures`, ({ measures }) => measures.find((m) => m.id === id)?.text ?? null);
  const stream = await daemon.stream({ session });
  for (let i = 1; ; i += 1) {
    const text = `${name}-${i}`;
    if (i === 1) facts.all.set(`${name} session`, { confirmed: background(session) });
    await change('session', i, send(daemon, 'PATCH', of, { view: { background: [i / 1e4, 0, 0, 1] } }), reads(of, background));
    // An answer of a stream promises nothing, but the next durable answer also covers what the stream has answered.
    facts.ask(`${name} measure of the stream`, text, measure('stream'));
    await stream.call('measure.put', { id: 'stream', text, ...MARKER });
    await change('measure of the stream', text, send(daemon, 'PUT', `presets/${name}`, { camera: { fov_y: i % 80 + 1 } }), measure('stream'));
    if (i % 2) await change('measure', text, send(daemon, 'PUT', `${of}/measures/own`, { text, ...MARKER }), measure('own'));
    else await change('measure', null, send(daemon, 'DELETE', `${of}/measures/own`), measure('own'));
    if (i === 1) {
      const made = await change('first measure', 'new', send(daemon, 'POST', `${of}/measures`, { text: 'new', ...MARKER }), async () => 'new');
      facts.all.delete(`${name} first measure`);
      facts.all.set(`${name} new measure`, { confirmed: 'new' });
      for (const again of ['b', 'c']) await change('new measure', again, send(daemon, 'PATCH', `${of}/measures/${made.id}`, { text: again }), measure(made.id));
      await change('volume', true, send(daemon, 'POST', 'volumes', { uri: `demo:phantom?size=${8 + (facts.made += 1)}`, id: name }), reads(`volumes/${name}`));
    }
    const preset = reads(`presets/${name}-own`, ({ camera }) => camera.fov_y);
    await change('preset', i, send(daemon, 'PUT', `presets/${name}-own`, { camera: { fov_y: i } }), preset);
    if (i % 2) await change('preset', null, send(daemon, 'DELETE', `presets/${name}-own`), preset);
    const n = facts.made += 1;
    const { id: view } = await change(`view ${i}`, n, send(daemon, 'POST', 'views', { background: [0, n / 1e4, 0, 1] }), async () => n);
    facts.all.get(`${name} view ${i}`).read = reads(`views/${view}`, ({ background }) => Math.round(background[1] * 1e4));
    await change(`name of view ${i}`, text, send(daemon, 'PATCH', `views/${view}`, { name: text }),
      reads('views?limit=1000', ({ views }) => views.find((v) => v.id === view)?.name ?? null));
    if (i % 3 === 0) {
      facts.all.delete(`${name} name of view ${i}`);
      await change(`view ${i}`, null, send(daemon, 'DELETE', `views/${view}`), reads(`views/${view}`));
    }
    const tail = nrrd();
    const upload = await change(`upload ${i}`, 0, send(daemon, 'POST', 'uploads', { name: `${name}.nrrd`, bytes: tail.length }), async () => 0);
    const offset = reads(`uploads/${upload.id}`, (json) => json.offset);
    facts.all.get(`${name} upload ${i}`).read = offset;
    await change(`upload ${i}`, 50, send(daemon, 'PATCH', `uploads/${upload.id}`, tail.subarray(0, 50), { 'Content-Type': 'application/offset+octet-stream', 'Upload-Offset': '0' }), offset);
    if (i % 2) await change(`upload ${i}`, null, send(daemon, 'DELETE', `uploads/${upload.id}`), offset);
    const keyframes = [{ frame: 0, view: {} }];
    const made = await change(`path ${i}`, true, send(daemon, 'POST', 'paths', { view: { size: [8, 8] }, frames: 1, keyframes }), async () => true);
    facts.all.get(`${name} path ${i}`).read = reads(`paths/${made.id}`);
    if (i % 2) await change(`path ${i}`, null, send(daemon, 'DELETE', `paths/${made.id}`), reads(`paths/${made.id}`));
    if (i % 4 === 0) return change('session', null, send(daemon, 'DELETE', of), reads(of));
  }
}

test('after kill -9 right after answers nothing is lost that was acknowledged as durable', async () => {
  let facts = new Facts();
  let acknowledged = 0;
  const rounds = Number(process.env.SPLATD_KILLS ?? 4); // deploy/endure.sh kills more often
  for (let round = 1; round <= rounds; round += 1) {
    const daemon = await start();
    await facts.check(daemon);
    if (round % 8 === 0) { // begin with an empty folder: what was made would reach the limits of the daemon
      assert.equal(await daemon.stop(), 0);
      rmSync(path.join(folder, 'state'), { recursive: true });
      acknowledged += facts.acknowledged;
      facts = new Facts();
      continue;
    }
    let isKilled = false;
    let isFailed = false;
    const before_ = facts.acknowledged;
    const workers = ['a', 'b', 'c'].map(async (letter) => {
      try {
        for (let i = 0; ; i += 1) await work(daemon, facts, `${letter}${round}-${i}`);
      } catch (error) {
        if (isKilled && !(error instanceof assert.AssertionError)) return; // the daemon died
        isFailed = true;
        throw error;
      }
    });
    // Kill right after the n-th answer, another n each time.
    const reached = (async () => {
      while (!isFailed && facts.acknowledged < before_ + 15 + 5 * (round % 7)) await daemon.json('/healthz', { token: null });
      isKilled = true;
      daemon.kill('SIGKILL');
    })();
    await Promise.all([reached, ...workers]);
    assert.equal(await within(daemon.ended, 'the end of the daemon'), 'SIGKILL');
    assert.doesNotMatch(daemon.log, /Sanitizer|runtime error/);
  }
  const last = await start();
  await facts.check(last);
  compare(acknowledged + facts.acknowledged, '>=', (rounds - Math.floor(rounds / 8)) * 15);
  assert.equal(await last.stop(), 0);
});

test('without a folder every one of these answers says that it is not durable', async () => {
  const daemon = await start([]);
  const session = await daemon.session();
  const of = `sessions/${session.id}`;
  const tail = { 'Content-Type': 'application/offset+octet-stream', 'Upload-Offset': '0' };
  const answered = async (method, target, body, headers) => {
    const answer = await send(daemon, method, target, body, headers);
    assert.ok(answer.status < 300, `${method} ${target}: ${answer.status} ${JSON.stringify(answer.json)}`);
    assert.equal(answer.headers.get('x-durable'), 'no', `${method} ${target}`);
    return answer.json;
  };
  await answered('PATCH', of, {});
  const measure = await answered('POST', `${of}/measures`, MARKER);
  await answered('PUT', `${of}/measures/own`, MARKER);
  await answered('PATCH', `${of}/measures/${measure.id}`, { text: 'x' });
  await answered('PUT', `${of}/measures/part`, { kind: 'part', points: [[3, 3, 3]], range: [0, 255] }); // on the measuring thread
  await answered('DELETE', `${of}/measures/${measure.id}`);
  const upload = await answered('POST', 'uploads', { name: 'a.nrrd', bytes: 4 });
  await answered('PATCH', `uploads/${upload.id}`, Buffer.from('NRRD'), tail);
  await answered('DELETE', `uploads/${upload.id}`);
  await answered('PUT', 'presets/a', {});
  await answered('DELETE', 'presets/a');
  const view = await answered('POST', 'views', {});
  await answered('PATCH', `views/${view.id}`, { name: 'a' });
  await answered('DELETE', `views/${view.id}`);
  const made = await answered('POST', 'paths', { view: { size: [8, 8] }, frames: 1, keyframes: [{ frame: 0, view: {} }] });
  await answered('DELETE', `paths/${made.id}`);
  await answered('POST', 'volumes', { uri: 'demo:phantom?size=8', id: 'other' });
  await answered('DELETE', 'volumes/other');
  await answered('DELETE', of);
  assert.equal(await daemon.stop(), 0);
});

test('a database that was deleted or replaced while the daemon ran is written again before the next answer', async () => {
  const state = path.join(folder, 'lost');
  const database = path.join(state, 'splatd.db');
  const views = [];
  const save = async (daemon) => {
    const answer = await send(daemon, 'POST', 'views', { background: [0, 0, (views.length + 1) / 100, 1] });
    assert.deepEqual([answer.status, answer.headers.get('x-durable')], [201, 'yes']);
    views.push(answer.json.id);
  };
  const restarted = async (daemon) => {
    daemon.kill('SIGKILL');
    await within(daemon.ended, 'the end of the daemon');
    const next = await start(['--state', state]);
    for (const id of views) assert.equal((await next.json(`/api/v1/views/${id}`)).status, 200);
    return next;
  };
  let daemon = await start(['--state', state]);
  await save(daemon);
  rmSync(database);
  rmSync(`${database}-wal`);
  await save(daemon);
  await daemon.untilLogged(/splatd\.db was deleted while the daemon ran; writing all records to a new one/);
  daemon = await restarted(daemon);
  writeFileSync(path.join(state, 'other'), 'another file');
  renameSync(path.join(state, 'other'), database);
  await save(daemon);
  await daemon.untilLogged('splatd.db was replaced by another file while the daemon ran');
  assert.equal(readFileSync(`${database}.found`, 'utf8'), 'another file');
  assert.equal((await daemon.json('/readyz', { token: null })).json.state.status, 'written');
  daemon = await restarted(daemon);
  rmSync(database); // without a request
  await daemon.untilLogged('splatd.db was deleted');
  daemon = await restarted(daemon);
  renameSync(state, `${state}-away`); // as if it was unmounted
  assert.equal((await send(daemon, 'POST', 'views', {})).headers.get('x-durable'), 'no');
  const { state: reported } = (await daemon.json('/readyz', { token: null })).json;
  assert.equal(reported.status, 'failing');
  assert.match(reported.reason, /--state was moved, deleted or unmounted; put it back, or restart/);
  renameSync(`${state}-away`, state);
  await daemon.untilLogged('state is being written again');
  await save(daemon);
  daemon = await restarted(daemon);
  assert.equal(await daemon.stop(), 0);
});
