// SPDX-License-Identifier: Apache-2.0
// Damaged state: every damaged record is named at the start, and requests for it get 500 with its id. A database that is gone is noticed.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdtempSync, readdirSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { Daemon } from './harness.mjs';

const TOKEN = 'a-token-for-the-tests-0123456789';
let folder;
before(() => {
  folder = mkdtempSync(path.join(tmpdir(), 'splatd-damaged-'));
  writeFileSync(path.join(folder, 'token'), `${TOKEN}\n`);
});
after(() => rmSync(folder, { recursive: true }));

async function start(state) {
  const daemon = await Daemon.start(['--state', state, '--volume', 'demo:engine?size=8', '--token-file', path.join(folder, 'token')]);
  daemon.token = TOKEN;
  await daemon.loaded('engine');
  return daemon;
}

const send = (daemon, method, target, body, token = TOKEN) => daemon.json(`/api/v1/${target}`, {
  method, body: body && JSON.stringify(body), headers: { 'Content-Type': 'application/json' }, token,
});

/** Replaces the texts of records, each by a function of Python: [kind, id, expression of `body`]. */
function damage(state, records) {
  execFileSync('python3', ['-c', `
import json, sqlite3, sys
db = sqlite3.connect(sys.argv[1])
for kind, id, expression in json.loads(sys.argv[2]):
    body = db.execute('SELECT body FROM record WHERE kind = ? AND id = ?', (kind, id)).fetchone()[0]
    db.execute('UPDATE record SET body = ? WHERE kind = ? AND id = ?', (eval(expression), kind, id))
db.commit()`, path.join(state, 'splatd.db'), JSON.stringify(records)]);
}

test('a damaged record is named at the start, gets 500 with its id, and can be deleted', async () => {
  const state = path.join(folder, 'state');
  const keyframes = [{ frame: 0, view: {} }];
  let daemon = await start(state);
  assert.equal((await send(daemon, 'POST', 'volumes', { uri: 'demo:phantom?size=8', id: 'head' })).status, 202);
  await daemon.loaded('head');
  const [lost, partly, sound] = [await daemon.session(), await daemon.session(), await daemon.session()];
  for (const session of [partly, sound])
    for (const id of ['a', 'b']) assert.equal((await send(daemon, 'PUT', `sessions/${session.id}/measures/${id}`, { kind: 'marker', points: [[1, 1, 1]] })).status, 201);
  const view = (await send(daemon, 'POST', 'views', { background: [1, 0, 0, 1] })).json.id;
  for (const name of ['bones', 'skin']) assert.equal((await send(daemon, 'PUT', `presets/${name}`, { camera: { fov_y: 20 } })).status, 201);
  const made = (await send(daemon, 'POST', 'paths', { view: { volume: 'engine', size: [8, 8] }, frames: 1, keyframes })).json.id;
  while ((await daemon.json(`/api/v1/paths/${made}`)).json.state !== 'done');
  assert.equal(await daemon.stop(), 0);
  const half = 'body[:len(body) // 2]';
  const edit = (code) => `(lambda of: (${code}, json.dumps(of))[1])(json.loads(body))`;
  damage(state, [['volume', 'head', '"{}"'], ['session', lost.id, half], ['session', partly.id, edit('of["view"].update(camera=5)')],
    ['session', sound.id, edit('of["measures"].__setitem__(0, {})')], ['view', view, half], ['preset', 'bones', '"[1]"'],
    ['preset', 'skin', edit('of.update(preset={"no such field": 1})')], ['path', made, half], ['clock', 'daemon', '"{}"']]);

  daemon = await start(state);
  const damaged = [['volume', 'head', 'volumes/head'], ['session', lost.id, `sessions/${lost.id}`], ['session', partly.id, `sessions/${partly.id}`],
    ['saved view', view, `views/${view}`], ['preset', 'bones', 'presets/bones'], ['preset', 'skin', 'presets/skin'], ['camera path', made, `paths/${made}`]];
  for (const [kind, id] of [...damaged, ['clock', 'daemon']]) await daemon.untilLogged(new RegExp(`the record of the ${kind} ${id} is damaged: .+; requests for it get 500`));
  await daemon.untilLogged(new RegExp(`the record of the session ${partly.id} is damaged: /view/camera: `));
  await daemon.untilLogged(new RegExp(`the record of the session ${sound.id} is damaged: /measures/0 is no measurement; it is left out`));
  const isDamaged = ({ status, json }, kind, id) => {
    assert.equal(status, 500, JSON.stringify(json));
    assert.ok(json.detail.startsWith(`the record of the ${kind} '${id}' is damaged: `), json.detail);
  };
  for (const [kind, id, target] of damaged) isDamaged(await send(daemon, 'GET', target), kind, id);
  isDamaged(await send(daemon, 'GET', `render/${view}`), 'saved view', view);
  isDamaged(await send(daemon, 'PATCH', `views/${view}`, { name: 'x' }), 'saved view', view);
  isDamaged(await send(daemon, 'POST', 'sessions', { from: view }), 'saved view', view);
  isDamaged(await send(daemon, 'POST', 'sessions', { from: partly.id }), 'session', partly.id);
  isDamaged(await send(daemon, 'PATCH', `sessions/${partly.id}`, {}), 'session', partly.id);
  isDamaged(await send(daemon, 'GET', `sessions/${partly.id}`, undefined, partly.tokens.view), 'session', partly.id);
  await assert.rejects(daemon.stream({ session: partly }), { status: 500 });
  assert.equal((await send(daemon, 'GET', `sessions/${lost.id}`, undefined, lost.tokens.view)).status, 401); // its token is lost
  isDamaged(await send(daemon, 'GET', 'volumes/head/view'), 'volume', 'head');
  for (const result of ['frames/0', 'archive', 'events']) isDamaged(await send(daemon, 'GET', `paths/${made}/${result}`), 'camera path', made);
  assert.deepEqual((await send(daemon, 'GET', 'views')).json.views, [{ id: view }]);
  assert.deepEqual((await send(daemon, 'GET', `sessions/${sound.id}/measures`)).json.measures.map((m) => m.id), ['b']);

  assert.equal((await send(daemon, 'PUT', `sessions/${sound.id}/measures/c`, { kind: 'marker', points: [[1, 1, 1]] })).status, 201); // writes the record again

  assert.equal((await send(daemon, 'PUT', 'presets/skin', { camera: { fov_y: 30 } })).status, 204);
  assert.deepEqual((await send(daemon, 'GET', 'presets/skin')).json, { camera: { fov_y: 30 } });
  for (const [, , target] of damaged) {
    const { status, headers } = await send(daemon, 'DELETE', target);
    assert.deepEqual([target, status, headers.get('x-durable')], [target, 204, 'yes']);
    assert.equal((await send(daemon, 'GET', target)).status, 404, target);
  }
  assert.equal(await daemon.stop(), 0);
  daemon = await start(state);
  while (readdirSync(path.join(state, 'paths')).length > 0) await daemon.json('/healthz'); // the thread of the paths removes them
  assert.doesNotMatch(daemon.log, /is damaged/);
  assert.equal((await send(daemon, 'GET', `sessions/${sound.id}`)).status, 200);
  assert.equal(await daemon.stop(), 0);
});

test('an empty database where there was one is said at the start', async () => {
  const state = path.join(folder, 'gone');
  const said = /splatd\.db is new and empty, but there was a database before: .*stop the daemon and put a copy of splatd\.db here/;
  const run = async (isSaid) => {
    const daemon = await start(state);
    assert.equal(said.test(daemon.log), isSaid, daemon.log);
    assert.equal(await daemon.stop(), 0);
  };
  await run(false);
  await run(false);
  rmSync(path.join(state, 'splatd.db'));
  await run(true);
  await run(false);
  writeFileSync(path.join(state, 'splatd.db'), ''); // truncated
  await run(true);
});
