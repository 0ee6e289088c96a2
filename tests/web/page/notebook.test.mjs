// SPDX-License-Identifier: Apache-2.0
// The notebook widget in a page that plays anywidget and the kernel: the bundle that the Python package contains, with the real daemon.
// tests/notebook runs it in JupyterLab.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { createServer } from 'node:http';
import { test } from 'node:test';
import { gzipSync } from 'node:zlib';
import { compare } from '../../support/compare.mjs';
import { DEADLINE_MS, drag, openPage, share, shot } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';

const BUNDLE = readFileSync(new URL('../../../clients/python/src/splatd/static/widget.js', import.meta.url));
const BYTES_MAX = 300000;
const CHANGES = 120; // of the view, in as many animation frames
const UNSEEN_MAX = 20; // the daemon stops when an acknowledgement is late, which it knows within 0.1 s (server/session/congestion.h)

const server = createServer((request, response) => {
  const isScript = request.url === '/widget.js';
  response.setHeader('Content-Type', isScript ? 'text/javascript' : 'text/html');
  response.end(isScript ? BUNDLE : '<!doctype html><title>Host</title><link rel="icon" href="data:,"><div id="cell"></div>');
});
await new Promise((resolve) => { server.listen(0, '127.0.0.1', resolve); });
const origin = `http://127.0.0.1:${server.address().port}`;
const { browser, daemon } = await share(() => startDaemon(['--volume', 'demo:engine?size=32', '--allow-origin', origin]), () => server.close());
const { origin: address, searchParams } = new URL(daemon.url);
const token = searchParams.get('token');
const base = `${address}/`;

for (let state = ''; state !== 'ready';) {
  const answer = await fetch(`${base}api/v1/volumes/engine`, { headers: { Authorization: `Bearer ${token}` } });
  ({ state } = await answer.json());
}

async function createSession() {
  const answer = await fetch(`${base}api/v1/sessions`, {
    method: 'POST', headers: { Authorization: `Bearer ${token}`, 'Content-Type': 'application/json' }, body: JSON.stringify({ view: { volume: 'engine', size: [320, 240] } }),
  });
  return answer.json();
}

/**
 * Runs in the page: shows the widget. `answers` is the welcome of the kernel, or null: there is no kernel. The kernel of this host passes streams
 * and requests on to the daemon, and holds each frame back until window.pass() while window.isHolding is true.
 */
function host({ answers, base: daemonBase, traits, join }) {
  const listeners = new Map();
  const emit = (name, ...values) => { for (const act of listeners.get(name) ?? []) act(...values); };
  const state = { width: '320px', height: '', controls: true, _aspect: '320 / 240', _build: 'test', _picture: null, ...traits };
  const streams = new Map();
  const held = [];
  window.told = [];
  window.frames = 0;
  window.acknowledged = 0;
  window.isHolding = false;
  window.pass = () => {
    window.isHolding = false;
    for (const send of held.splice(0)) send();
  };
  const kernel = {
    hello: (reply) => answers && reply({ type: 'welcome', ...answers }),
    async request(reply, { id, method, path, body }) {
      const answer = await fetch(`${daemonBase}${path}`, { method, body, headers: { Authorization: `Bearer ${join}`, 'Content-Type': 'application/json' } });
      const data = await answer.arrayBuffer();
      reply({ type: 'answer', id, status: answer.status, headers: { 'Content-Type': answer.headers.get('Content-Type') } }, [new DataView(data)]);
    },
    open(reply, { id }) {
      const socket = new WebSocket(`${daemonBase.replace('http', 'ws')}api/v1/sessions/${answers.session}/stream?token=${join}`, ['splatd.v1']);
      socket.binaryType = 'arraybuffer';
      socket.onopen = () => reply({ type: 'opened', id });
      socket.onclose = ({ code, reason }) => reply({ type: 'closed', id, code, reason });
      socket.onmessage = ({ data }) => {
        if (typeof data === 'string') {
          reply({ type: 'text', id, text: data });
          return;
        }
        window.frames += 1;
        const shared = new Uint8Array(data.byteLength + 24); // the buffers of a message lie in one
        shared.set(new Uint8Array(data), 16);
        const send = () => reply({ type: 'frame', id }, [new DataView(shared.buffer, 16, data.byteLength)]);
        if (window.isHolding) held.push(send);
        else send();
      };
      streams.set(id, socket);
    },
    send(reply, { id, text }) {
      if (JSON.parse(text).method === 'stream.ack') window.acknowledged += 1;
      streams.get(id).send(text);
    },
    close(reply, { id }) { streams.get(id).close(); },
  };
  window.streams = streams;
  window.model = {
    get: (name) => state[name],
    set: (name, value) => { state[name] = value; },
    save_changes() { window.told.push({ type: 'saved', bytes: state._picture?.byteLength }); },
    on(names, act) { for (const name of names.split(' ')) listeners.set(name, [...listeners.get(name) ?? [], act]); },
    off(names, act) { for (const name of names.split(' ')) listeners.set(name, listeners.get(name).filter((one) => one !== act)); },
    send(content) {
      window.told.push(content);
      kernel[content.type]?.((answer, buffers) => emit('msg:custom', { ...answer, of: content.of }, buffers), content);
    },
  };
  return import('/widget.js').then(async ({ default: widget }) => {
    window.close = await widget.render({ model: window.model, el: document.getElementById('cell') });
  });
}

async function setUp(context, options) {
  const opened = await openPage(browser);
  context.after(() => opened.context.close());
  await opened.page.goto(origin);
  await opened.page.evaluate(host, { base, ...options });
  return opened;
}

const wait = (page, what, condition, value) => page.waitForFunction(condition, value, { timeout: DEADLINE_MS }).catch((error) => {
  throw new Error(`${what}: ${error.message}`);
});
const isLive = () => document.querySelector('#cell > div > :first-child')?.state === 'live';
const isKept = () => window.told.some(({ type, bytes }) => type === 'saved' && bytes > 500);

async function turn(page) {
  const box = await page.locator('#cell > div').boundingBox();
  const position = () => page.evaluate(() => document.querySelector('#cell > div > :first-child').view.camera.position.join());
  const before = await position();
  await drag(page, [box.x + 100, box.y + 100], [box.x + 180, box.y + 120]);
  assert.notEqual(await position(), before);
  await wait(page, 'the kernel hears of the view', () => window.told.some(({ type, view }) => type === 'view' && view.camera));
}

test('the bundle is one file below the limit', () => {
  compare(BUNDLE.length, '<', BYTES_MAX, 'bytes');
  console.log(`widget.js: ${BUNDLE.length} bytes, ${gzipSync(BUNDLE).length} compressed`);
  assert.doesNotMatch(BUNDLE.toString(), /https?:\/\/(?!www\.w3\.org)[a-z0-9.-]+\.[a-z]/, 'nothing comes from elsewhere');
});

test('a WebSocket to the address that the kernel names; the last picture is kept; nothing is left at the end', async (context) => {
  const { id, tokens } = await createSession();
  const { page, said } = await setUp(context, { answers: { session: id, token: tokens.control, url: base, port: null, transport: 'auto' } });
  await wait(page, 'live', isLive);
  await turn(page);
  await wait(page, 'the last picture', isKept);
  const used = await page.evaluate(() => window.told.find(({ type }) => type === 'used').transport);
  assert.equal(used, `websocket: ${new URL(base).host} answers`);
  await shot(page, 'notebook-websocket');
  await page.evaluate(() => window.close());
  assert.equal(await page.evaluate(() => document.getElementById('cell').children.length), 0);
  assert.equal(await page.evaluate(() => window.told.at(-1).type), 'bye');
  assert.deepEqual(said, []);
});

test('the channel of the kernel carries requests and frames, and late acknowledgements hold the daemon back', async (context) => {
  const { id, tokens } = await createSession();
  const { page, said } = await setUp(context, { answers: { session: id, token: '', url: base, port: 1, transport: 'kernel' }, join: tokens.control });
  await wait(page, 'live', isLive);
  await turn(page);
  await wait(page, 'the last picture', isKept);
  await page.evaluate(() => {
    window.isHolding = true;
    window.frames = window.acknowledged = 0;
  });
  await page.evaluate(async (count) => {
    const view = document.querySelector('#cell > div > :first-child');
    for (let i = 0; i < count; i += 1) {
      view.change({ background: [i / count, 0, 0, 1] });
      await new Promise(requestAnimationFrame);
    }
  }, CHANGES);
  await wait(page, 'a frame that waits', () => window.frames > 0);
  compare(await page.evaluate(() => window.frames), '<', UNSEEN_MAX, 'frames without an acknowledgement');
  assert.equal(await page.evaluate(() => window.acknowledged), 0);
  await page.evaluate(() => {
    window.told.length = 0;
    window.pass();
  });
  await wait(page, 'the picture of the end', isKept);
  await shot(page, 'notebook-kernel');
  await page.evaluate(() => window.close());
  await wait(page, 'the stream has ended', () => [...window.streams.values()].every(({ readyState }) => readyState > 1));
  assert.deepEqual(said, []);
});

test('"auto" takes the kernel where no WebSocket reaches the daemon, and says why', async (context) => {
  const { id, tokens } = await createSession();
  const { page } = await setUp(context, { answers: { session: id, token: tokens.control, url: 'http://daemon.invalid/', port: 1, transport: 'auto' }, join: tokens.control });
  await wait(page, 'live', isLive);
  assert.equal(await page.evaluate(() => window.told.find(({ type }) => type === 'used').transport),
    'kernel: daemon.invalid: no answer; no Jupyter server has served the page');
});

test('without a kernel the last picture stays, and a note says so', async (context) => {
  const { page, said } = await setUp(context, { answers: null, traits: { _picture: 'later' } });
  await page.evaluate(() => window.close());
  const picture = await fetch(`${base}api/v1/render?format=png`, {
    method: 'POST', headers: { Authorization: `Bearer ${token}`, 'Content-Type': 'application/json' }, body: JSON.stringify({ volume: 'engine', size: [320, 240] }),
  });
  await page.evaluate(async (bytes) => {
    window.model.set('_picture', new DataView(new Uint8Array(bytes).buffer));
    const { default: widget } = await import('/widget.js');
    await widget.render({ model: window.model, el: document.getElementById('cell') });
  }, [...new Uint8Array(await picture.arrayBuffer())]);
  await page.getByText('The kernel does not answer. This is the last picture.').waitFor();
  assert.deepEqual(await page.evaluate(() => {
    const { naturalWidth, hidden } = document.querySelector('#cell img');
    return [naturalWidth, hidden];
  }), [320, false]);
  await shot(page, 'notebook-without-kernel');
  assert.deepEqual(said, []);
});
