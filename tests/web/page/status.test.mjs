// SPDX-License-Identifier: Apache-2.0
// What the status line says about overload: each text appears when its reason does, and goes with it.
import assert from 'node:assert/strict';
import { after, test } from 'node:test';
import { firstFrame, openPage, share, until, visitMock } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';
import { frameMessage } from '../support/mock-daemon.mjs';

const QUEUE_AT = 32; // of queueUs in the header of a frame (core/frame.js)
const QUEUE_US = 60e6;
const HELD_MS = 300; // longer than what counts as a long queue (core/latency.js)
const { browser, daemon } = await share(() => startDaemon(['--volume', 'demo:engine?size=32', '--rest-time', '60'])); // its views never come to rest

async function open(context, prepare = async () => {}) {
  const { page, context: own } = await openPage(browser, { viewport: { width: 700, height: 500 } });
  context.after(() => own.close());
  await prepare(page);
  await page.goto(daemon.url);
  return page;
}

/** The text about overload, or '' while there is none. */
const load = (page) => page.evaluate(() => {
  const { hidden, textContent } = document.getElementById('status-load');
  return hidden ? '' : textContent;
});

test('"pictures wait" while the daemon renders for others, and the split says how long', async (context) => {
  let isHeld = false;
  let held = [];
  let send = () => {};
  const page = await open(context, (opened) => opened.routeWebSocket(/stream/, (client) => {
    const server = client.connectToServer();
    send = (message) => client.send(message);
    client.onMessage((message) => server.send(message));
    server.onMessage((message) => {
      if (typeof message === 'string' || !isHeld) {
        send(message);
        return;
      }
      const frame = Buffer.from(message);
      frame.writeUInt32LE(QUEUE_US, QUEUE_AT);
      held.push(frame);
    });
  }));
  await firstFrame(page);
  await page.focus('#screen');
  let told = '';
  for (let i = 0; i < 20 && told !== 'pictures wait'; i += 1) {
    isHeld = true;
    const pressed = await page.evaluate(() => performance.now());
    await page.keyboard.press('ArrowLeft');
    await until(page, 'a late picture', `() => performance.now() > ${pressed + HELD_MS}`);
    isHeld = false;
    held.forEach(send);
    held = [];
    await until(page, 'the picture', (s) => s.isIdle && s.seq === s.sent);
    told = await load(page);
  }
  assert.equal(told, 'pictures wait');
  const latency = await page.evaluate(() => window.splatd.latency);
  const others = latency.network + latency.render + latency.encode + latency.browser;
  assert.ok(latency.queue > 0 && Math.abs(latency.total - others - latency.queue) < 1, JSON.stringify(latency)); // all the rest waited
  await until(page, 'the end of the text', () => document.getElementById('status-load').hidden);
});

test('"daemon busy" while the daemon refuses, and the picture after it', async (context) => {
  let isBusy = true;
  const page = await open(context, (opened) => opened.route('**/api/v1/sessions', (route) => (isBusy
    ? route.fulfill({ status: 503, contentType: 'application/problem+json', body: JSON.stringify({ title: 'too many sessions', status: 503 }) })
    : route.continue())));
  await page.locator('#status-load', { hasText: 'daemon busy' }).waitFor();
  await page.locator('#banner-title', { hasText: 'The daemon is busy' }).waitFor(); // between two tries it says so
  isBusy = false;
  await firstFrame(page);
  await page.locator('#status-load').waitFor({ state: 'hidden' });
});

test('a picture that memory makes coarser says so, and a damaged file says where', async (context) => {
  const { page, daemon: mock, said } = await visitMock(context, browser);
  await firstFrame(page);
  const put = (lost) => {
    const bricks = { complete: false, resident: 8, wanted: 8 + lost, level: 2, asked: 1, lost, lost_at: [[0, 64, 128], [64, 128, 192]] };
    mock.notifyAll('stream.stats', { backend: 'mock', memory: 5e7, bricks });
    const [stream] = mock.streams;
    const [width, height] = stream.size;
    stream.frame += 1;
    stream.socket.send(frameMessage({ frame: stream.frame, seq: stream.seq, width, height, flags: 11 }));
  };
  put(0);
  await page.locator('#status-load', { hasText: 'short of memory' }).waitFor();
  await page.locator('#status [data-key="detail"] dd', { hasText: '50 %' }).waitFor();
  put(3);
  await page.locator('#status-load', { hasText: 'parts missing' }).waitFor();
  await page.locator('#stats-toggle').click();
  await page.locator('#stats .about', { hasText: '3 blocks cannot be read: one at voxels 0, 64, 128 to 63, 127, 191' }).waitFor();
  assert.deepEqual(said, []);
});

test('"reduced detail" goes with the moving picture, and never stands beside "detail 100 %"', async (context) => {
  const { page, daemon: mock, said, idle } = await visitMock(context, browser);
  await idle();
  mock.draws = false; // only put() sends frames
  mock.notifyAll('stream.policy', { why: ['time'], moving: { format: 'jpeg', quality: 80 }, final: { format: 'jpeg', quality: 90 } });
  await page.evaluate(() => {
    window.told = [];
    const text = (selector) => { const { hidden, textContent } = document.querySelector(selector); return hidden ? '' : textContent; };
    new MutationObserver(() => window.told.push([text('#status-load'), text('#status [data-key="detail"] dd')].join(', ')))
      .observe(document.getElementById('status'), { subtree: true, childList: true, characterData: true, attributes: true });
  });
  const put = (isFinal) => {
    const [stream] = mock.streams;
    const [width, height] = stream.size.map((side) => (isFinal ? side : Math.ceil(side / 2)));
    stream.frame += 1;
    stream.socket.send(frameMessage({ frame: stream.frame, seq: stream.seq, width, height, flags: isFinal ? 3 : 1 }));
  };
  put(false);
  // The text goes by itself soon after the last picture of a movement, so it may be gone when this process looks. On a machine so busy
  // that pictures wait, the page says that instead.
  await until(page, 'the moving picture', () => window.told.some((text) => ['reduced detail, 50 %', 'pictures wait, 50 %'].includes(text)));
  put(true);
  await page.locator('#status [data-key="detail"] dd', { hasText: '100 %' }).waitFor();
  const told = await page.evaluate(() => window.told);
  assert.ok(told.every((text) => !/(reduced detail|pictures wait), 100 %/.test(text)), told.join('; '));
  assert.deepEqual(said, []);
});
