// SPDX-License-Identifier: Apache-2.0
// Several participants in one session: names, colours, transfer of control, forks and picks.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { compare } from '../support/compare.mjs';
import { Daemon } from './harness.mjs';

let daemon;
before(async () => {
  daemon = await Daemon.start(['--volume', 'demo:engine?size=32', '--control-time', '600', '--stall-time', '300']);
  await daemon.loaded('engine');
});
after(async () => assert.equal(await daemon.stop(), 0));

const HELD = { code: -32007 };
const DENIED = { code: -32004 };
const seq = (n) => ({ background: [n / 100, 0, 0, 1] });

/** Joins one participant per role ('control' or 'view'). Resolves to [{stream, id}] in joining order. */
async function meet(of, ...roles) {
  const session = await of.session();
  const people = [];
  for (const role of roles) {
    const stream = await of.stream({ session, token: session.tokens[role] });
    const { params } = await stream.note('session.participants', (p) => p.you > 0);
    people.push({ stream, id: params.you, session, call: (method, params_) => stream.call(`session.${method}`, params_) });
  }
  return people;
}

const leave = (people) => Promise.all(people.map(({ stream }) => stream.end()));
/** Waits for a session.control notification that fits, skipping the first `from` notifications. */
const notified = ({ stream }, fits, from = 0) => stream.until(
  () => stream.notes.slice(from).find((n) => n.method === 'session.control' && fits(n.params))?.params, 'session.control');

test('every participant receives the list of participants with role, name and colour', async () => {
  const people = await meet(daemon, 'control', 'view', 'control');
  const { params } = await people[0].stream.note('session.participants', (p) => p.participants.length === 3);
  const list = [...params.participants].sort((a, b) => a.id - b.id);
  assert.deepEqual(list.map((p) => p.role), ['control', 'view', 'control']);
  assert.deepEqual(list.map((p) => p.name), ['Guest 1', 'Guest 2', 'Guest 3']);
  assert.equal(new Set(list.map((p) => p.color)).size, 3);
  for (const { color } of list) assert.match(color, /^#[0-9a-f]{6}$/);
  const granted = await people[1].stream.call('stream.configure', { name: 'Zoë 🦊' });
  assert.equal(granted.name, 'Zoë 🦊');
  await people[0].stream.note('session.participants', (p) => p.participants.some((one) => one.id === people[1].id && one.name === 'Zoë 🦊'));
  for (const name of ['', 'x'.repeat(65), 'a\nb', 7, null]) {
    await assert.rejects(people[1].stream.call('stream.configure', { name }), { code: -32602, data: { pointer: '/name' } });
  }
  const { json } = await daemon.json(`/api/v1/sessions/${people[0].session.id}`);
  assert.deepEqual([json.participants.find((p) => p.id === people[1].id).name, json.holder], ['Zoë 🦊', null]);
  await leave(people);
});

test('the first name is one that no other participant has', async () => {
  const people = await meet(daemon, 'control');
  await people[0].stream.call('stream.configure', { name: 'Guest 2' });
  const stream = await daemon.stream({ session: people[0].session, token: people[0].session.tokens.view });
  const { params } = await stream.note('session.participants', (p) => p.you > 0);
  assert.equal(params.participants.find((p) => p.id === params.you).name, 'Guest 3');
  await leave([...people, { stream }]);
});

test('a change of the name alone causes no frame', async () => {
  const [one] = await meet(daemon, 'control');
  await one.stream.final(0);
  await one.stream.call('stream.configure', { name: 'Ada' });
  await one.stream.update(seq(1), 1);
  await one.stream.final(1);
  assert.equal(one.stream.frames.filter((f) => f.seq === 0 && f.flags & 2).length, 1);
  await leave([one]);
});

test('the first participant to change the view holds control; others are refused until it is released', async () => {
  const people = await meet(daemon, 'control', 'control', 'view');
  const [a, b, c] = people;
  await notified(b, (p) => p.holder === null && p.requests.length === 0);
  await a.stream.update(seq(1), 1);
  await notified(b, (p) => p.holder === a.id);
  await assert.rejects(b.stream.update(seq(2), 2), HELD);
  await assert.rejects(c.stream.update(seq(2), 2), DENIED);
  assert.deepEqual(await a.call('release_control'), { holds: false });
  await b.stream.update(seq(3), 3);
  await assert.rejects(a.stream.update(seq(4), 4), HELD);
  assert.equal((await daemon.json(`/api/v1/sessions/${a.session.id}`)).json.holder, b.id);
  await leave(people);
});

test('a request for control can be granted, refused and withdrawn', async () => {
  const people = await meet(daemon, 'control', 'control', 'control');
  const [a, b, c] = people;
  assert.deepEqual(await a.call('request_control'), { holds: true });
  assert.deepEqual(await b.call('request_control'), { holds: false });
  assert.deepEqual(await c.call('request_control'), { holds: false });
  const asked = await notified(a, (p) => p.requests.length === 2);
  assert.deepEqual(asked.requests.map((r) => r.id).sort(), [b.id, c.id].sort());
  for (const { seconds } of asked.requests) {
    compare(seconds, '>', 0);
    compare(seconds, '<=', 600);
  }
  await assert.rejects(b.call('grant_control', { to: b.id }), HELD);
  await assert.rejects(b.call('refuse_control', { to: c.id }), HELD);
  await a.call('refuse_control', { to: b.id });
  await notified(b, (p) => p.holder === a.id && p.requests.length === 1 && p.requests[0].id === c.id);
  assert.deepEqual(await a.call('grant_control', { to: c.id }), { holds: false });
  await notified(b, (p) => p.holder === c.id && p.requests.length === 0);
  await c.stream.update(seq(1), 1);
  const from = c.stream.notes.length;
  await a.call('request_control');
  await notified(c, (p) => p.requests.length === 1, from);
  const later = c.stream.notes.length;
  await a.call('release_control');
  await notified(c, (p) => p.requests.length === 0 && p.holder === c.id, later);
  for (const params of [{}, { to: 0 }, { to: 'b' }, { to: b.id + 1000 }]) {
    await assert.rejects(c.call('grant_control', params), { code: -32602, data: { pointer: '/to' } });
  }
  await leave(people);
});

test('when the holder leaves, control passes to the participant that asked first', async () => {
  const people = await meet(daemon, 'control', 'view', 'control', 'control');
  const [a, b, c, d] = people;
  await a.call('request_control');
  await b.call('request_control');
  await d.call('request_control');
  await c.call('request_control');
  a.stream.socket.terminate();
  const passed = await notified(c, (p) => p.holder === d.id);
  assert.deepEqual(passed.requests.map((r) => r.id).sort(), [b.id, c.id].sort());
  await d.stream.update(seq(1), 1);
  await leave([b, c, d]);
});

test('a participant with the view role gets control only by a grant', async () => {
  const people = await meet(daemon, 'control', 'view');
  const [a, b] = people;
  await assert.rejects(b.call('request_control'), DENIED, 'no participant could grant it');
  await a.call('request_control');
  assert.deepEqual(await b.call('request_control'), { holds: false });
  await notified(a, (p) => p.requests.length === 1 && p.requests[0].id === b.id && p.requests[0].seconds === null);
  await a.call('release_control');
  await notified(b, (p) => p.holder === null && p.requests.length === 1, 0);
  await assert.rejects(b.stream.update(seq(1), 1), DENIED);
  await a.call('request_control');
  await a.call('grant_control', { to: b.id });
  await b.stream.update(seq(2), 2);
  await b.stream.final(2);
  await assert.rejects(a.stream.update(seq(3), 3), HELD);
  await b.call('release_control');
  await assert.rejects(b.stream.update(seq(4), 4), DENIED);
  await leave(people);
});

test('a holder that does not answer a request loses control after --control-time, but not to a view role', async () => {
  const quick = await Daemon.start(['--volume', 'demo:engine?size=16', '--control-time', '0.3', '--stall-time', '300']);
  await quick.loaded('engine');
  const people = await meet(quick, 'control', 'view', 'control');
  const [a, b, c] = people;
  await a.stream.update(seq(1), 1);
  await b.call('request_control');
  await c.call('request_control');
  await notified(b, (p) => p.holder === c.id && p.requests.length === 1);
  await c.stream.update(seq(2), 2);
  await assert.rejects(b.stream.update(seq(3), 3), DENIED);
  await leave(people);
  assert.equal(await quick.stop(), 0);
});

test('the daemon token and a control token may fork a session, a view token may not', async () => {
  const [a] = await meet(daemon, 'control');
  await a.stream.update(seq(42), 1);
  const { id, tokens } = a.session;
  const fork = (token, body) => daemon.post('/api/v1/sessions', body, { token });
  const made = await fork(tokens.control, { from: id });
  assert.equal(made.status, 201);
  assert.notEqual(made.json.id, id);
  assert.deepEqual(made.json.view.background, [0.42, 0, 0, 1]);
  assert.notEqual(made.json.tokens.control, tokens.control);
  assert.equal((await fork(tokens.view, { from: id })).status, 403);
  const other = await daemon.session();
  for (const [token, body] of [[tokens.control, {}], [tokens.control, { view: {} }], [tokens.control, { from: other.id }],
    [tokens.control, { from: 'f'.repeat(32) }], [tokens.control, { from: 7 }], ['nonsense', { from: id }], [null, { from: id }]]) {
    const answer = await fork(token, body);
    assert.equal(answer.status, 401, JSON.stringify(body));
    assert.match(answer.headers.get('www-authenticate'), /^Bearer/);
  }
  // The fork changes independently and has another participant in control.
  const theirs = await daemon.stream({ session: made.json });
  await theirs.update(seq(7), 1);
  assert.deepEqual((await a.stream.call('view.get')).view.background, [0.42, 0, 0, 1]);
  await theirs.end();
  await leave([a]);
});

test('each participant has its own size and codec of the shared view', async () => {
  const people = await meet(daemon, 'control', 'view');
  const [a, b] = people;
  await a.stream.call('stream.configure', { size: [40, 30], format: 'png' });
  await b.stream.call('stream.configure', { size: [64, 20], format: 'webp' });
  await a.stream.frame((f) => f.codec === 2 && f.width === 40 && f.height === 30, 'a PNG of 40 by 30');
  await b.stream.frame((f) => f.codec === 3 && f.width === 64 && f.height === 20, 'a WebP of 64 by 20');
  await leave(people);
});

test('pick returns position, value and opacity, nothing beside the volume, and has a rate limit', async () => {
  const [one] = await meet(daemon, 'view');
  const { view } = await one.stream.call('view.get');
  const volume = (await daemon.json('/api/v1/volumes/engine')).json;
  const [width, height] = view.size;
  const begun = performance.now();
  const hit = await one.stream.call('pick', { at: [width / 2, height / 2] });
  compare(hit.opacity, '>', 0.5, JSON.stringify(hit));
  compare(hit.opacity, '<=', 1, JSON.stringify(hit));
  compare(hit.value, '>=', volume.range[0]);
  compare(hit.value, '<=', volume.range[1]);
  // The ray through the centre of the image meets the target.
  const { position, target } = view.camera;
  const way = target.map((t, i) => t - position[i]);
  const to = hit.position.map((p, i) => p - position[i]);
  const along = (u, v) => u.reduce((sum, x, i) => sum + x * v[i], 0);
  compare(along(way, to) / Math.sqrt(along(way, way) * along(to, to)), '>', 1 - 1e-9);
  assert.deepEqual(await one.stream.call('pick', { at: [0, 0] }), { position: null, value: null, opacity: 0 });
  await one.stream.call('stream.configure', { size: [64, 64] });
  const smaller = await one.stream.call('pick', { at: [32, 32] });
  smaller.position.forEach((p, i) => compare(Math.abs(p - hit.position[i]), '<', 1e-6));
  // A point names the size of its image where the window has just changed.
  const wider = await one.stream.call('pick', { at: [200, 50], size: [400, 100] });
  wider.position.forEach((p, i) => compare(Math.abs(p - hit.position[i]), '<', 1e-6));
  for (const size of [[0, 64], [64], [64, 8193], [64.5, 64], '64', {}]) {
    await assert.rejects(one.stream.call('pick', { at: [1, 1], size }), { code: -32602, data: { pointer: '/size' } });
  }
  for (const at of [[65, 0], [-1, 0], [1], [1, 2, 3], 'x', null, ['1', 2]]) {
    await assert.rejects(one.stream.call('pick', { at }), { code: -32602, data: { pointer: '/at' } });
  }
  await assert.rejects(one.stream.call('pick', { at: [1, 1], x: 1 }), { code: -32602 });
  // 20 picks per second are allowed, and 20 at once. The daemon began to count after `begun`, so on a slow machine it may
  // accept more than 20 of these, but never more than the whole time allows.
  let answered = 0;
  let refused = 0;
  for (let burst = 0; burst < 20 && refused === 0; burst += 1) {
    const answers = await Promise.allSettled(Array.from({ length: 100 }, () => one.stream.call('pick', { at: [1, 1] })));
    answered += answers.filter((answer) => answer.status === 'fulfilled').length;
    refused += answers.filter((answer) => answer.reason?.code === -32005).length;
    assert.equal(answered + refused, 100 * (burst + 1));
  }
  const allowed = 20 + Math.ceil((performance.now() - begun) / 1000 * 20);
  compare(answered, '>', 0, 'no pick was accepted');
  compare(answered, '<=', allowed, `${answered} picks were accepted and ${allowed} are allowed`);
  compare(refused, '>', 0, 'no pick was refused');
  await leave([one]);
});
