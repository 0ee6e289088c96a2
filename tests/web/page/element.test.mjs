// SPDX-License-Identifier: Apache-2.0
// <splat-view> in a page of another origin and in the example page, with the real daemon.
import assert from 'node:assert/strict';
import { createServer } from 'node:http';
import { test } from 'node:test';
import { DEADLINE_MS, drag, openPage, share, shot, until } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';

// The page around the element: its policy allows the daemon and nothing inline.
const server = createServer((request, response) => {
  if (request.url === '/frame') {
    response.setHeader('Content-Type', 'text/html');
    response.end(`<!doctype html><title>Frame</title><link rel="icon" href="data:,"><iframe src="${daemon.url}" width="900" height="600"></iframe>`);
    return;
  }
  const own = new URL(base).origin;
  response.setHeader('Content-Security-Policy', `default-src 'none'; script-src ${own}; connect-src ${own} ${own.replace('http', 'ws')}; style-src 'self'`);
  response.setHeader('Content-Type', 'text/html');
  response.end(`<!doctype html><title>Host</title><script type="module" src="${base}element/splat-view.js"></script>
    <splat-view id="view" label="A phantom"></splat-view>`);
});
await new Promise((resolve) => { server.listen(0, '127.0.0.1', resolve); });
const origin = `http://127.0.0.1:${server.address().port}`;
const { browser, daemon } = await share(() => startDaemon(['--volume', 'demo:phantom?size=32', '--volume', 'demo:engine?size=32', '--allow-origin', origin]),
  () => server.close());
const url = new URL(daemon.url);
const token = url.searchParams.get('token');
const base = `${url.origin}/`;

/** Waits until `condition`, a function of the element and of the events so far, is true. */
async function wait(page, condition) {
  const end = performance.now() + DEADLINE_MS;
  for (;;) {
    if (await page.evaluate(`(${condition})(document.getElementById('view'), window.told ?? [])`)) return;
    if (performance.now() > end) throw new Error(`not reached: ${condition}; ${JSON.stringify(await page.evaluate(() => window.told))}`);
  }
}

async function setUp(context, attributes) {
  const opened = await openPage(browser);
  context.after(() => opened.context.close());
  const { page } = opened;
  await page.goto(origin);
  await page.evaluate((all) => {
    const view = document.getElementById('view');
    window.told = [];
    for (const name of ['ready', 'viewchange', 'frame', 'error']) {
      view.addEventListener(name, ({ detail }) => window.told.push({ name, ...detail, error: detail.error?.message }));
    }
    for (const [name, value] of Object.entries(all)) view.setAttribute(name, value);
  }, attributes);
  return opened;
}

const kinds = (page) => page.evaluate(() => [...new Set(window.told.map(({ name }) => name))]);

test('a page of another origin shows a volume, is told about it, and changes the view', async (context) => {
  const { page, said } = await setUp(context, { url: base, token });
  await wait(page, (view, told) => told.some(({ name, isFinal }) => name === 'frame' && isFinal));
  assert.deepEqual((await kinds(page)).sort(), ['frame', 'ready', 'viewchange']);
  assert.equal(await page.evaluate(() => document.getElementById('view').state), 'live');
  assert.equal(await page.evaluate(() => document.getElementById('view').view.volume), 'phantom');
  const lit = await page.evaluate(async () => {
    const image = await createImageBitmap(await document.getElementById('view').toBlob());
    const context2d = new OffscreenCanvas(image.width, image.height).getContext('2d');
    context2d.drawImage(image, 0, 0);
    return context2d.getImageData(0, 0, image.width, image.height).data.filter((part, i) => i % 4 !== 3 && part > 60).length;
  });
  assert.ok(lit > 100, `${lit} lit parts`);
  await page.evaluate(() => {
    window.told.length = 0;
    document.getElementById('view').change({ background: [1, 0, 0, 1] });
  });
  await wait(page, (view, told) => told.some(({ name }) => name === 'frame') && view.view.background[0] === 1);
  await page.evaluate(() => { document.getElementById('view').volume = 'engine'; });
  await wait(page, (view, told) => view.view.volume === 'engine' && told.some(({ name, view: shown }) => name === 'viewchange' && shown.volume === 'engine'));
  await shot(page, 'element');
  assert.deepEqual(said, []);
});

test('the user moves the camera only with "controls", by mouse and keyboard', async (context) => {
  const { page, said } = await setUp(context, { url: base, token });
  await wait(page, (view, told) => told.some(({ name }) => name === 'frame'));
  const camera = () => page.evaluate(() => document.getElementById('view').view.camera);
  const start = await camera();
  await drag(page, [300, 200], [400, 230]);
  assert.deepEqual(await camera(), start);
  await page.evaluate(() => { document.getElementById('view').controls = true; });
  await drag(page, [300, 200], [400, 230]);
  const turned = await camera();
  assert.notDeepEqual(turned, start);
  await page.keyboard.press('+');
  assert.notDeepEqual(await camera(), turned);
  assert.deepEqual(said, []);
});

test('an element that moves in the document returns to its session; another one joins it', async (context) => {
  const { page, said } = await setUp(context, { url: base, token });
  await wait(page, (view, told) => told.some(({ name }) => name === 'ready') && view.state === 'live'); // else its stream is not open yet
  const session = () => page.evaluate(() => window.told.filter(({ name }) => name === 'ready').at(-1).session);
  const first = await session();
  await page.evaluate(() => {
    window.told.length = 0;
    const box = document.createElement('div');
    document.body.append(box);
    box.append(document.getElementById('view'));
  });
  await wait(page, (view, told) => told.some(({ name }) => name === 'ready') && view.state === 'live');
  assert.equal(await session(), first);
  await page.evaluate(() => document.getElementById('view').remove());
  assert.deepEqual(said, []);
});

test('a wrong token is an error event and a message in the element', async (context) => {
  const { page } = await setUp(context, { url: base, token: 'wrong' });
  await wait(page, (view, told) => told.some(({ name }) => name === 'error') && view.state === 'refused');
  assert.ok(await page.locator('splat-view p').isVisible());
});

test('the example page', async (context) => {
  const { page, said, context: own } = await openPage(browser);
  context.after(() => own.close());
  await page.goto(`${base}element/example.html?token=${token}`);
  await page.locator('#told', { hasText: /^Frame \d+, \d+ × \d+$/ }).waitFor();
  await page.check('#shading');
  await wait(page, (view) => view.view.shading.mode === 'phong');
  await shot(page, 'element-example');
  assert.deepEqual(said, []);
});

test('a page of an allowed origin frames the page of the daemon, and one of another origin does not', async (context) => {
  const opened = await openPage(browser);
  context.after(() => opened.context.close());
  const { page, said } = opened;
  await page.goto(`${origin}/frame`);
  const framed = page.frames()[1];
  await framed.waitForFunction(() => window.splatd?.isFinal, null, { timeout: DEADLINE_MS });
  await shot(page, 'element-framed');
  assert.deepEqual(said.filter((text) => !/Blocked autofocusing/.test(text)), []); // of the closed help
  await page.goto(`${origin.replace('127.0.0.1', 'localhost')}/frame`);
  assert.match(page.frames()[1].url(), /^chrome-error:/);
  assert.match(said.join(), /frame-ancestors/);
});
