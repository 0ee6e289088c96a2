// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Api } from '../../../clients/web/core/api.js';
import { eventReader } from '../../../clients/web/core/events.js';
import { webTransport } from '../../../clients/web/core/transport.js';

const apiOf = (base, token, fetch) => new Api({ base, token, transport: webTransport({ base, fetch, WebSocket: null }) });

const STREAM = ':\n\nid: running-1\nevent: progress\ndata: {"done":1}\n\n'
  + 'event: two\r\ndata: first: a\r\ndata:second\r\n\r\ndata\n\nevent: nothing\n\nid: 3\rdata: \u00e9\r\r';
const EVENTS = [['progress', '{"done":1}'], ['two', 'first: a\nsecond'], ['message', ''], ['message', '\u00e9']];

test('events are parsed from chunks of any size', () => {
  for (let size = 1; size <= STREAM.length; size += 1) {
    const told = [];
    const take = eventReader((event, data) => told.push([event, data]));
    for (let at = 0; at < STREAM.length; at += size) take(STREAM.slice(at, at + size));
    take('\n'); // a chunk that ends with \r may continue with \n
    assert.deepEqual(told, EVENTS, `in chunks of ${size}`);
  }
});

test('a path is watched with the token in the header, and a refusal is an error', async () => {
  const heard = [];
  let answer = () => new Response('event: progress\ndata: {"done":3}\n\nevent: done\ndata: {"done":4}\n\n');
  const api = apiOf('http://daemon/below/', 'secret', async (url, { headers }) => {
    heard.push([url.href, headers.Authorization, headers.Accept]);
    return answer();
  });
  const told = [];
  await api.watchPath('a/b', (event, path) => told.push([event, path.done]));
  assert.deepEqual(told, [['progress', 3], ['done', 4]]);
  assert.deepEqual(heard, [['http://daemon/below/api/v1/paths/a%2Fb/events', 'Bearer secret', 'text/event-stream']]);
  answer = () => new Response(JSON.stringify({ detail: 'no such path' }), { status: 404 });
  await assert.rejects(api.watchPath('x', () => {}), { name: 'ApiError', status: 404, message: 'no such path' });
});

test('the list of paths is read page by page', async () => {
  const pages = { '': { paths: [{ id: 'a' }], next: 'a&' }, 'a&': { paths: [{ id: 'b' }] } };
  const api = apiOf('http://daemon/', 't', async (url) => Response.json(pages[url.searchParams.get('after') ?? '']));
  assert.deepEqual(await api.paths(), [{ id: 'a' }, { id: 'b' }]);
  assert.equal(api.pathFile({ id: 'a', format: 'png' }), 'http://daemon/api/v1/paths/a/archive?token=t');
  assert.equal(api.pathFile({ id: 'a', format: 'webm' }), 'http://daemon/api/v1/paths/a/movie?token=t');
});

test('the list of volumes has the whole reason of a failed load, which it reads once', async () => {
  const asked = [];
  let whole = { reason: 'bad.nrrd: byte 57: space units: needs the field space' };
  const answers = {
    volumes: () => ({ volumes: [{ id: 'good', state: 'ready' }, { id: 'bad', state: 'failed', reason: 'needs the field space' }] }),
    'volumes/bad': () => whole,
  };
  const make = () => apiOf('http://daemon/', 't', async (url) => {
    const path = url.pathname.replace('/api/v1/', '');
    asked.push(path);
    const answer = answers[path]();
    return answer ? Response.json(answer) : Response.json({ detail: 'gone' }, { status: 404 });
  });
  const api = make();
  for (let i = 0; i < 2; i += 1) assert.deepEqual((await api.volumes()).map(({ reason }) => reason), [undefined, whole.reason]);
  assert.deepEqual(asked, ['volumes', 'volumes/bad', 'volumes']);
  whole = null; // it was removed in between
  assert.equal((await make().volumes())[1].reason, 'needs the field space');
});
