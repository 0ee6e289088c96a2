// SPDX-License-Identifier: Apache-2.0
// Saved views: equal views of one token have one id, their image equals the image of POST /render and can be cached, and sessions can start from them.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { Daemon } from './harness.mjs';

let daemon;
const VIEW = { volume: 'engine', size: [24, 16], background: [0, 0, 0.5, 1] };
const query = (values) => `?${new URLSearchParams(values)}`;

before(async () => {
  daemon = await Daemon.start(['--volume', 'demo:engine?size=16', '--volume', 'demo:phantom?size=16', '--views', '8'], { backend: 'cpu' });
  await daemon.loaded('engine');
  await daemon.loaded('phantom');
});
after(async () => assert.equal(await daemon.stop(), 0));

const save = async (view) => {
  const answer = await daemon.post('/api/v1/views', view);
  assert.equal(answer.status, 201, JSON.stringify(answer.json));
  assert.equal(answer.headers.get('location'), `views/${answer.json.id}`);
  return answer.json.id;
};

const bytes = async (answer) => Buffer.from(await answer.arrayBuffer());
const drawn = async (view) => bytes(await daemon.fetch('/api/v1/render?format=png', {
  method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(view),
}));

test('equal views have the same id in every notation, different views have different ids', async () => {
  const id = await save(VIEW);
  assert.match(id, /^[0-9a-f]{32}$/);
  assert.equal(await save({ background: [0.0, 0, 0.5, 1], size: [24, 16] }), id);
  const whole = (await daemon.json(`/api/v1/views/${id}`)).json;
  assert.deepEqual(whole.background, VIEW.background);
  assert.equal(await save(whole), id);
  assert.notEqual(await save({ ...VIEW, size: [24, 17] }), id);
});

test('a saved view never changes: it has an ETag, is immutable and gives 304', async () => {
  const id = await save(VIEW);
  const first = await daemon.json(`/api/v1/views/${id}`);
  assert.match(first.headers.get('cache-control'), /immutable/);
  const again = await daemon.fetch(`/api/v1/views/${id}`, { headers: { 'If-None-Match': first.headers.get('etag') } });
  assert.deepEqual([again.status, await again.text()], [304, '']);
});

test('the image of a saved view equals that of POST /render; camera, size and format can be changed', async () => {
  const id = await save(VIEW);
  const get = (values = {}) => daemon.fetch(`/api/v1/render/${id}${query({ format: 'png', ...values })}`);
  assert.ok((await bytes(await get())).equals(await drawn(VIEW)));
  const turned = await bytes(await get({ camera: '{"fov_y":50}', size: '40,30' }));
  assert.ok(turned.equals(await drawn({ ...VIEW, camera: { fov_y: 50 }, size: [40, 30] })));
  assert.ok(!turned.equals(await drawn({ ...VIEW, size: [40, 30] })), 'the camera changes the image');
  assert.equal((await get({ format: 'jpeg' })).headers.get('content-type'), 'image/jpeg');
});

test('caches may store the image and revalidate it; an unchanged image is not rendered again', async () => {
  const id = await save(VIEW);
  const url = `/api/v1/render/${id}`;
  const first = await daemon.fetch(url);
  await bytes(first);
  assert.equal(first.headers.get('cache-control'), 'public, no-cache');
  const etag = first.headers.get('etag');
  assert.match(etag, /^"[0-9a-f]+"$/);
  const again = await daemon.fetch(url, { headers: { 'If-None-Match': etag } });
  assert.deepEqual([again.status, again.headers.get('etag'), (await bytes(again)).length], [304, etag, 0]);
  assert.equal((await daemon.fetch(`${url}?size=8,8`, { headers: { 'If-None-Match': etag } })).status, 200);
  const stranger = await daemon.fetch(url, { token: null, headers: { 'If-None-Match': etag } });
  assert.equal(stranger.status, 401, 'a cache without a token gets no image');
});

test('an invalid request is refused with a JSON pointer', async () => {
  const id = await save(VIEW);
  for (const [values, status, pointer] of [
    [{ camera: '{' }, 400], [{ size: '8' }, 400], [{ size: '8,8,8' }, 400], [{ size: '+8,8' }, 400], [{ size: '' }, 400],
    [{ quality: '101' }, 400], [{ size: '0,8' }, 422, '/size/0'], [{ camera: '{"fov_y":999}' }, 422, '/camera/fov_y'],
    [{ camera: '{"fov":9}' }, 422, '/camera/fov'], [{ camera: '7' }, 422, '/camera'], [{ format: 'bmp' }, 406],
  ]) {
    const answer = await daemon.json(`/api/v1/render/${id}${query(values)}`);
    assert.deepEqual([answer.status, answer.json.pointer], [status, pointer], JSON.stringify(values));
  }
  for (const target of ['render', 'views']) {
    assert.equal((await daemon.json(`/api/v1/${target}/${'0'.repeat(32)}`)).status, 404);
  }
});

test('a session can start from a saved view or from the view of another session, and then changes independently', async () => {
  const id = await save(VIEW);
  const one = (await daemon.post('/api/v1/sessions', { from: id })).json;
  assert.deepEqual(one.view, (await daemon.json(`/api/v1/views/${id}`)).json);
  const two = (await daemon.post('/api/v1/sessions', { from: one.id })).json;
  assert.deepEqual(two.view, one.view);
  await daemon.json(`/api/v1/sessions/${one.id}`, {
    method: 'PATCH', headers: { 'Content-Type': 'application/json' }, body: '{"view":{"size":[9,9]}}',
  });
  assert.deepEqual((await daemon.json(`/api/v1/sessions/${two.id}`)).json.view, one.view);
  const none = await daemon.post('/api/v1/sessions', { from: 'f'.repeat(32) });
  assert.deepEqual([none.status, none.json.pointer], [422, '/from']);
});

test('a saved view whose volume is unloaded works again when the volume is loaded', async () => {
  const id = await save({ volume: 'phantom', size: [8, 8] });
  const before_ = await bytes(await daemon.fetch(`/api/v1/render/${id}?format=png`));
  assert.equal((await daemon.fetch('/api/v1/volumes/phantom', { method: 'DELETE' })).status, 204);
  assert.equal((await daemon.json(`/api/v1/render/${id}`)).status, 409);
  assert.equal((await daemon.json(`/api/v1/views/${id}`)).status, 200);
  await daemon.post('/api/v1/volumes', { uri: 'demo:phantom?size=16' });
  await daemon.loaded('phantom');
  assert.ok((await bytes(await daemon.fetch(`/api/v1/render/${id}?format=png`))).equals(before_));
});

test('saving more than --views views gets 503, and saved views stay', async () => {
  const id = await save(VIEW);
  let answer;
  for (let i = 1; i <= 8; i++) answer = await daemon.post('/api/v1/views', { ...VIEW, size: [i, 1] });
  assert.equal(answer.status, 503);
  assert.match(answer.json.detail, /--views allows 8/);
  await daemon.untilLogged(/level=warn peer="127\.0\.0\.1:\d+" msg="[0-9.:]+ POST \/api\/v1\/views refused: 503, .*--views allows 8/);
  assert.equal(await save(VIEW), id, 'a view that is already saved is accepted');
});
