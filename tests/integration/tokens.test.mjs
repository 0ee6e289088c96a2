// SPDX-License-Identifier: Apache-2.0
// Tokens with roles and quotas: their permissions over HTTP and streams (401, 403), quotas (429), and reloads by SIGHUP.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import os from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { Daemon, Raw, runToEnd } from './harness.mjs';

const folder = fs.mkdtempSync(path.join(os.tmpdir(), 'splatd-tokens-'));
const file = path.join(folder, 'tokens');
const of = (name) => `token-of-${name}-0123456789`;
const LINES = [
  `# who may do what`,
  of('admin'),
  `${of('control')} role=control name=ann sessions=2 fps=12 frame-size=512x512`,
  `${of('render')} role=render name=bob snapshots=1 views=2`,
  `${of('view')} role=view`,
  `${of('other')} role=control name=carl`,
  `${of('metrics')} role=metrics name=prometheus`,
];
let daemon;
before(async () => {
  fs.writeFileSync(file, `${LINES.join('\n')}\n`);
  daemon = await Daemon.start(['--volume', 'demo:engine?size=32', '--token-file', file, '--data', folder]);
  daemon.token = of('admin');
  await daemon.loaded('engine');
});
after(async () => {
  assert.equal(await daemon.stop(), 0);
  for (const line of LINES.slice(1)) assert.ok(!daemon.log.includes(line.split(' ')[0]), 'no token is in the log');
  fs.rmSync(folder, { recursive: true });
});

const post = (target, body, token, method = 'POST') => daemon.post(target, body, { method, token });

test('each role has its permissions and gets 403 for everything else', async () => {
  const session = await daemon.session();
  const { json: own } = await post('/api/v1/sessions', {}, of('control'));
  const { json: { id: saved } } = await post('/api/v1/views', {}, of('admin'));
  const ROLES = ['metrics', 'view', 'render', 'control', 'admin'];
  const preset = { view: { filter: { sigma: 1 } } };
  const onePath = { size: [16, 16], frames: 1, keyframes: [{ frame: 0, view: {} }] };
  const { json: { id: made } } = await post('/api/v1/paths', onePath, of('admin'));
  for (let state; state !== 'done';) ({ json: { state } } = await daemon.json(`/api/v1/paths/${made}`));
  const getPath = (what) => ['render control admin', (t) => daemon.fetch(`/api/v1/paths/${made}${what}`, { token: t })];
  const calls = [
    ['metrics admin', (t) => daemon.fetch('/metrics', { token: t })],
    ['view render control admin', (t) => daemon.json('/api/v1/volumes', { token: t })],
    ['view render control admin', (t) => daemon.json('/api/v1/volumes/engine/view', { token: t })],
    ['view render control admin', (t) => daemon.json('/api/v1/volumes/engine/histogram', { token: t })],
    ['view render control admin', (t) => daemon.json(`/api/v1/sessions/${session.id}/histogram`, { token: t })],
    ['view render control admin', (t) => daemon.fetch('/api/v1/volumes/engine/slice?axis=2&index=0', { token: t })],
    ['view render control admin', (t) => daemon.fetch(`/api/v1/sessions/${session.id}/slice?axis=2&index=0`, { token: t })],
    ['view render control admin', (t) => daemon.post('/api/v1/measure', { volume: 'engine', kind: 'marker', points: [[1, 1, 1]] }, { token: t })],
    ['view render control admin', (t) => daemon.post(`/api/v1/sessions/${session.id}/measure`, { kind: 'marker', points: [[1, 1, 1]] }, { token: t })],
    ['view render control admin', (t) => daemon.json(`/api/v1/sessions/${session.id}/measures`, { token: t })],
    ['view render control admin', (t) => daemon.json(`/api/v1/views/${saved}`, { token: t })],
    ['view render control admin', (t) => daemon.json('/api/v1/presets', { token: t })],
    ['view render control admin', (t) => daemon.json(`/api/v1/sessions/${session.id}`, { token: t })],
    ['render control admin', (t) => post('/api/v1/render', { size: [16, 16] }, t), 'image'],
    ['render control admin', (t) => daemon.fetch(`/api/v1/render/${saved}?size=16,16`, { token: t })],
    ['render control admin', (t) => post('/api/v1/views', { size: [17, 17] }, t)],
    ['render control admin', (t) => daemon.json('/api/v1/paths', { token: t })],
    ['render control admin', (t) => post('/api/v1/paths', onePath, t)],
    ...['', '/events', '/frames/0', '/archive', '/movie'].map(getPath),
    ['render control admin', (t) => daemon.fetch('/api/v1/paths/none', { method: 'DELETE', token: t })],
    ['admin', (t) => post(`/api/v1/sessions/${session.id}`, { view: { background: [1, 0, 0, 1] } }, t, 'PATCH')],
    ['control admin', (t) => post(`/api/v1/sessions/${own.id}`, { view: { background: [1, 0, 0, 1] } }, t, 'PATCH')],
    ['control admin', (t) => post('/api/v1/presets/one', preset, t, 'PUT'), 'put'],
    ['control admin', (t) => post('/api/v1/sessions', { from: saved }, t), 'session'],
    ['control admin', (t) => post('/api/v1/volumes', { path: 'none.vti' }, t), 'load'],
    ['control admin', (t) => daemon.fetch('/api/v1/volumes/none', { method: 'DELETE', token: t })],
  ];
  for (const [allowed, call, what] of calls) {
    for (const role of ROLES) {
      const answer = what === 'image'
        ? await daemon.fetch('/api/v1/render', { method: 'POST', body: '{"size":[16,16]}', token: of(role), headers: { 'Content-Type': 'application/json' } })
        : await call(of(role));
      const may = allowed.split(' ').includes(role);
      assert.equal(answer.status === 403, !may, `${role}: ${call}: ${answer.status}`);
      assert.notEqual(answer.status, 401, `${role}: ${call}`);
      if (answer.json && !may && typeof answer.json === 'object') assert.equal(answer.json.title, 'Forbidden');
    }
    for (const token of ['token-of-no-user-0123456789', null]) assert.equal((await call(token)).status, 401, `${call}`);
  }
  assert.equal((await daemon.fetch(`/api/v1/sessions/${own.id}`, { method: 'DELETE', token: of('control') })).status, 204);
});

test('only the token that created a session, an admin token and its own join tokens may change, control and end it', async () => {
  const { json: made } = await post('/api/v1/sessions', {}, of('other'));
  const at = `/api/v1/sessions/${made.id}`;
  const change = async (token) => (await post(at, { view: { background: [0, 1, 0, 1] } }, token, 'PATCH')).status;
  const drop = async (token, target = at) => (await daemon.fetch(target, { method: 'DELETE', token })).status;
  const owners = async (name) => (await daemon.json('/api/v1/sessions', { token: of(name) })).json.sessions.filter(({ id }) => id === made.id).map(({ owner }) => owner);
  const roleOf = async (token) => {
    const stream = await daemon.stream({ session: made, token });
    const { params } = await stream.note('session.participants');
    await stream.end();
    return params.participants.find(({ id }) => id === params.you).role;
  };
  const { tokens } = made;
  assert.deepEqual([await change(of('control')), await change(of('other')), await change(of('admin')), await change(tokens.control), await change(tokens.view)], [403, 200, 200, 200, 403]);
  assert.deepEqual([await roleOf(of('control')), await roleOf(of('other')), await roleOf(of('admin')), await roleOf(tokens.control), await roleOf(tokens.view)],
    ['view', 'control', 'control', 'control', 'view']);
  assert.deepEqual([await owners('control'), await owners('other'), await owners('admin')], [[], ['carl'], ['carl']]);
  const refused = await post(at, {}, of('control'), 'PATCH');
  assert.equal(refused.json.detail, 'another token created this session; give its control token');
  assert.equal((await daemon.json(at, { token: of('control') })).json.tokens, undefined);
  assert.deepEqual((await daemon.json(at, { token: of('other') })).json.tokens, tokens);
  const { status, json: fork } = await post('/api/v1/sessions', { from: made.id }, of('control'));
  assert.equal(status, 201, 'a session that may be watched may be copied');
  assert.deepEqual([await drop(of('control'), `/api/v1/sessions/${fork.id}`), await drop(of('control'), '/api/v1/sessions/0123456789abcdef')], [204, 404]);
  assert.deepEqual([await drop(of('control')), await drop(of('view')), await drop(tokens.control), await drop(of('other')), await drop(of('admin'))], [403, 403, 403, 204, 404]);
});

test('join tokens of a session are shown only to the token that created it and to admins; all others may only watch', async () => {
  const session = await daemon.session();
  const told = async (role) => (await daemon.json(`/api/v1/sessions/${session.id}`, { token: of(role) })).json.tokens !== undefined;
  assert.deepEqual([await told('view'), await told('render'), await told('control'), await told('admin')], [false, false, false, true]);
  const roleOf = async (role) => {
    const stream = await daemon.stream({ session, token: of(role) });
    const { params } = await stream.note('session.participants');
    await stream.end();
    return params.participants.find(({ id }) => id === params.you).role;
  };
  assert.deepEqual([await roleOf('view'), await roleOf('render'), await roleOf('control'), await roleOf('admin')], ['view', 'view', 'view', 'control']);
  await assert.rejects(daemon.stream({ session, token: of('metrics') }), (e) => e.status === 403);
});

test('the quotas of sessions, frames per second and sizes are those of the creator of the session, and forks count', async () => {
  const made = [];
  const make = async (body, token = of('control')) => {
    const answer = await post('/api/v1/sessions', body, token);
    if (answer.status === 201) made.push(answer.json);
    return answer;
  };
  // One session exists since the first test.
  const one = await make({ view: { size: [256, 256] } });
  assert.equal(one.status, 201, JSON.stringify(one.json));
  const over = await make({}, one.json.tokens.control);
  assert.equal(over.status, 401, 'a join token can only fork its own session');
  const fork = await make({ from: one.json.id }, one.json.tokens.control);
  assert.equal(fork.status, 429);
  assert.equal(fork.headers.get('Retry-After'), '1');
  assert.match(fork.json.detail, /the owner has 2 sessions, 0 of them by guests, and its token allows 2/);
  assert.equal((await make({})).status, 429);
  assert.equal((await make({}, of('admin'))).status, 201, 'another token has its own quota');
  const listed = async (role) => (await daemon.json('/api/v1/sessions', { token: of(role) })).json.sessions?.length;
  assert.deepEqual([await listed('control'), await listed('admin') > 2, await listed('render')], [2, true, undefined], 'a control token lists its own sessions, an admin token lists all');
  const large = await post(`/api/v1/sessions/${one.json.id}`, { view: { size: [513, 512] } }, of('admin'), 'PATCH');
  assert.deepEqual([large.status, large.json.pointer], [422, '/view/size']);
  assert.match(large.json.detail, /the token of ann allows 262144/);
  const stream = await daemon.stream({ session: one.json });
  assert.equal((await stream.call('stream.configure', {})).max_fps, 12);
  assert.equal((await stream.call('stream.configure', { max_fps: 60 })).max_fps, 12);
  assert.equal((await stream.call('stream.configure', { max_fps: 5 })).max_fps, 5);
  await assert.rejects(stream.call('stream.configure', { size: [513, 512] }), (e) => e.data.pointer === '/size');
  await stream.end();
  const snapshot = await post('/api/v1/render', { size: [513, 512] }, of('control'));
  assert.deepEqual([snapshot.status, snapshot.json.pointer], [422, '/size']);
  for (const { id } of made) await daemon.fetch(`/api/v1/sessions/${id}`, { method: 'DELETE' });
  assert.equal((await make({})).status, 201, 'the quota has capacity again');
});

test('a saved view belongs to the token that saved it, also beside an equal one of another token, and saved views have a quota', async () => {
  const views = async (role) => (await daemon.json('/api/v1/views', { token: of(role) })).json.views ?? [];
  const drop = async (id, role) => (await daemon.fetch(`/api/v1/views/${id}`, { method: 'DELETE', token: of(role) })).status;
  const save = (width, role) => post('/api/v1/views', { size: [width, 9] }, of(role));
  for (const { id } of await views('render')) assert.equal(await drop(id, 'render'), 204);
  const [one, two] = [await save(40, 'render'), await save(41, 'render')];
  assert.deepEqual([one.status, two.status, (await save(40, 'render')).status], [201, 201, 201], 'a view that is already saved does not count again');
  const third = await save(42, 'render');
  assert.deepEqual([third.status, third.headers.get('Retry-After')], [429, '1']);
  assert.match(third.json.detail, /bob has 2 views and its token allows 2/);
  const other = await save(41, 'admin');
  assert.notEqual(other.json.id, two.json.id);
  assert.deepEqual((await views('render')).map(({ id, owner }) => [id, owner]).sort(), [one, two].map(({ json }) => [json.id, 'bob']).sort());
  assert.ok((await views('admin')).some(({ id, owner }) => id === other.json.id && owner !== 'bob'));
  assert.deepEqual((await daemon.json(`/api/v1/views/${one.json.id}`)).json.size, [40, 9]);
  assert.deepEqual([await drop(other.json.id, 'render'), await drop('0'.repeat(32), 'render')], [403, 404]);
  assert.deepEqual([await drop(one.json.id, 'render'), await drop(other.json.id, 'admin')], [204, 204]);
  assert.deepEqual((await daemon.json(`/api/v1/views/${two.json.id}`)).json.size, [41, 9], 'an equal view of another token was deleted');
  assert.equal(await drop(two.json.id, 'admin'), 204);
  assert.equal((await save(43, 'render')).status, 201, 'the quota has capacity again');
});

test('concurrent snapshots have a quota', async () => {
  const draw = async (i) => {
    const answer = await daemon.fetch(`/api/v1/render?format=png&quality=${i}`, {
      method: 'POST', body: '{"size":[1024,1024]}', token: of('render'), headers: { 'Content-Type': 'application/json' },
    });
    await answer.arrayBuffer();
    return answer.status;
  };
  let statuses = [];
  for (let round = 0; !statuses.includes(429) && round < 100; round++) {
    statuses = await Promise.all([1, 2, 3, 4].map(draw));
    assert.ok(statuses.includes(200));
  }
  assert.deepEqual([...new Set(statuses)].sort(), [200, 429]);
  assert.equal(await draw(1), 200);
});

test('SIGHUP reloads the token file; an invalid file changes nothing', async () => {
  const status = async (role) => (await daemon.fetch('/metrics', { token: of(role) })).status;
  fs.writeFileSync(file, `${LINES.join('\n')}\n${of('more')} role=king\n`);
  daemon.kill('SIGHUP');
  await daemon.untilLogged(/reload failed; keeping the old configuration.*line 8/);
  assert.deepEqual([await status('metrics'), await status('more')], [200, 401]);
  const { sessions } = (await daemon.json('/api/v1/sessions', { token: of('control') })).json;
  const { json: session } = await daemon.json(`/api/v1/sessions/${sessions[0].id}`);
  const stream = await daemon.stream({ session });
  assert.equal((await stream.call('stream.configure', { max_fps: 60 })).max_fps, 12);
  const { json: gone } = await post('/api/v1/sessions', {}, of('other'));
  const [watching, inside, byAdmin] = [
    await daemon.stream({ session, token: of('other') }), await daemon.stream({ session: gone }), await daemon.stream({ session, token: of('admin') }),
  ];
  // 'open' is the answer to the handshake; only an answer on the stream shows that it has joined, before the reload.
  await Promise.all([watching, inside, byAdmin].map((one) => one.call('ping', {})));
  const slow = await Promise.all(['sessions', 'render'].map(async (what) => {
    const raw = await Raw.connect(daemon.port);
    raw.write(`POST /api/v1/${what} HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer ${of('other')}\r\nContent-Type: application/json\r\n`
      + 'Expect: 100-continue\r\nContent-Length: 2\r\n\r\n');
    await raw.until(() => raw.text().includes('100 Continue'), 'the answer 100 Continue');
    return raw;
  }));
  fs.writeFileSync(file, `# the admin is named by its line\n${of('admin')}\n${of('more')} role=metrics\n${of('fresh')} role=control name=ann fps=40\n`);
  daemon.kill('SIGHUP');
  await daemon.untilLogged(/reloaded(?!,)/);
  assert.deepEqual([await status('metrics'), await status('more'), await status('admin')], [401, 200, 200]);
  for (const raw of slow) {
    raw.write('{}');
    const [, answer] = await raw.until(() => /HTTP\/1\.1 ([2-5]\d\d)/.exec(raw.text()), 'an answer');
    assert.equal(answer, '401', 'the token is no longer valid when the body has arrived');
    raw.destroy();
  }
  const forked = async (one) => (await post('/api/v1/sessions', { from: one.id }, one.tokens.control)).status;
  assert.equal(await forked(gone), 403, 'a client whose token was removed cannot create sessions');
  assert.equal((await stream.call('stream.configure', {})).max_fps, 40, 'a session of ann uses the new quota of her token');
  assert.deepEqual(await watching.until(() => watching.closed, 'the close'), { code: 1008, reason: 'the token is no longer valid' });
  assert.deepEqual(await inside.until(() => inside.closed, 'the close'), { code: 1008, reason: 'the token that created the session is no longer valid' });
  assert.ok(await byAdmin.call('view.get', {}), 'the token of the admin did not change');
  const again = await daemon.stream({ session: gone });
  assert.ok(await again.call('view.get', {}), 'a join token stays valid until the session is deleted');
  await Promise.all([byAdmin.end(), again.end()]);
  await stream.end();
});

test('after SIGHUP a token with a lower role loses its streams with more permissions', async () => {
  const { json: session } = await post('/api/v1/sessions', {}, of('fresh'));
  const streams = [await daemon.stream({ session, token: of('fresh') }), await daemon.stream({ session })];
  await Promise.all(streams.map((one) => one.call('ping', {}))); // both have joined before the reload
  fs.writeFileSync(file, `# the admin is named by its line\n${of('admin')}\n${of('fresh')} role=view name=ann\n`);
  daemon.kill('SIGHUP');
  assert.deepEqual(await streams[0].until(() => streams[0].closed, 'the close'), { code: 1008, reason: 'the role of the token is lower now' });
  const watching = await daemon.stream({ session, token: of('fresh') });
  await assert.rejects(watching.call('view.update', { seq: 1, patch: { camera: { fov_y: 33 } } }), (e) => e.code === -32004);
  assert.ok(await streams[1].call('view.update', { seq: 1, patch: { camera: { fov_y: 33 } } }), 'a join token stays valid');
  await Promise.all([streams[1].end(), watching.end()]);
});

test('an invalid token file prevents the start', async () => {
  fs.writeFileSync(file, `${of('admin')} role=view\n${of('admin')}\n`);
  const { status, err } = await runToEnd(['--listen', '127.0.0.1:0', '--backend', 'null', '--token-file', file]);
  assert.equal(status, 2);
  assert.match(err, /tokens: line 2: an earlier line has the same token/);
  assert.ok(!err.includes(of('admin')));
});
