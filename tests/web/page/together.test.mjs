// SPDX-License-Identifier: Apache-2.0
// Host and guests side by side: every text and every control is the same, after joining, after each change, after a reload, for a guest who
// joins late, and after a restart of the daemon.
import assert from 'node:assert/strict';
import { mkdirSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { test } from 'node:test';
import { alike } from '../support/alike.mjs';
import { writeBlock } from '../support/block.mjs';
import { difference, firstFrame, openPage, pixels, rest, settle, share, shot, unfold, until } from '../support/browser.mjs';
import { startDaemon, tokenFile } from '../support/daemon.mjs';

const SIDE = 16;
const STEPS = 3;
const VIEWPORT = { viewport: { width: 1040, height: 700 } };
const folder = mkdtempSync(path.join(tmpdir(), 'splatd-together-'));
const block = writeBlock();
const token = tokenFile();

/** A ball that grows, without anatomy: what is up comes from the default camera. */
function writeSeries() {
  const header = `ObjectType = Image\nNDims = 4\nDimSize = ${SIDE} ${SIDE} ${SIDE} ${STEPS}\nElementSpacing = 1 1 2 0.5\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n`;
  const steps = Array.from({ length: STEPS }, (_, step) => Buffer.from(Array.from({ length: SIDE ** 3 }, (__, i) => {
    const [x, y, z] = [i % SIDE, Math.floor(i / SIDE) % SIDE, Math.floor(i / SIDE / SIDE)].map((c) => c - (SIDE - 1) / 2);
    return Math.max(0, Math.min(255, 128 + 60 * (3 + step - Math.hypot(x, y, z))));
  })));
  mkdirSync(path.join(folder, 'data'));
  writeFileSync(path.join(folder, 'data', 'balls.mha'), Buffer.concat([Buffer.from(header), ...steps]));
}

const start = (port = 0) => startDaemon(['--volume', block.file, '--volume', 'demo:engine?size=24', '--data', path.join(folder, 'data'), '--state', path.join(folder, 'state'),
  '--backend', 'cpu', '--control-time', '600'], { port, token });
const { browser } = await share(null, () => {
  for (const remove of [block.remove, token.remove]) remove();
  rmSync(folder, { recursive: true });
});

/** Opens a page with all sections open and slices beside the picture. */
async function join(context, address) {
  const opened = await openPage(browser, VIEWPORT);
  context.after(() => opened.context.close());
  await opened.page.goto(address);
  await firstFrame(opened.page);
  await unfold(opened.page);
  await opened.page.click('#layout-four');
  return opened;
}

async function link(page, kind) {
  await page.locator('#link-text').evaluate((field) => { field.value = ''; });
  await page.locator(`#link-${kind}`).evaluate((button) => button.click());
  await page.locator('#link-text:not([value=""])').waitFor({ state: 'attached' });
  await until(page, 'a link', () => document.getElementById('link-text').value);
  return page.inputValue('#link-text');
}

/** Sets a control as a user does. */
const set = (page, selector, value) => page.locator(selector).first().evaluate((control, to) => {
  if (typeof to === 'boolean') control.checked = to;
  else control.value = to;
  for (const type of ['input', 'change']) control.dispatchEvent(new Event(type, { bubbles: true }));
}, value);
const press = (page, selector) => page.locator(selector).first().evaluate((button) => button.click());

test('guests see what the host sees, whatever changes and whenever they join', async (context) => {
  writeSeries();
  let daemon = await start();
  context.after(() => daemon.stop());
  const ask = (method, rest_, body) => fetch(new URL(`/api/v1/${rest_}`, daemon.url), { method, body: body && JSON.stringify(body), headers: { Authorization: `Bearer ${token.text}`, 'Content-Type': 'application/json' } });
  const host = await join(context, daemon.url);
  const { page } = host;
  const links = { watch: await link(page, 'watch'), control: await link(page, 'control') };
  const watcher = await join(context, links.watch);
  const guest = await join(context, links.control);
  const compareAll = async (what) => {
    await rest(page);
    const { view } = await page.evaluate(() => window.splatd);
    for (const [name, other] of [['watch', watcher], ['control', guest]]) {
      await rest(other.page);
      await alike(`${what}, ${name}`, page, other.page, { isWatching: true });
      assert.deepEqual(await other.page.evaluate(() => window.splatd.view), view, what);
    }
  };

  await compareAll('joined');
  for (const { page: each } of [host, watcher]) assert.ok((await each.locator('#pane-axial').textContent()).includes('R'), 'right and left are named');
  assert.match(await watcher.page.locator('#volume-info').textContent(), /L P S/);
  assert.match(await watcher.page.locator('#volume-info').textContent(), /1 × 1 × 1 mm/);
  for (const [name, { page: each }] of Object.entries({ host, watcher })) await shot(each, `together-${name}`);
  assert.equal(difference(await pixels(page), await pixels(watcher.page)), 0, 'the picture');

  // Slices, their window, the planes in the picture.
  await set(page, '#slices-in-3d', true);
  await press(page, '#slices-planes button:nth-child(2)');
  await set(page, '[data-pointer="/slices/position"] input', '20');
  await set(page, '#slices-width', '80');
  await set(page, '#slices-colors', 'viridis');
  await compareAll('slices');
  for (const { page: each } of [host, watcher]) {
    await until(each, 'a slice in colours', () => {
      const canvas = document.querySelector('#pane-axial canvas');
      const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
      return data.some((part, i) => i % 4 === 0 && Math.abs(part - data[i + 2]) > 60);
    });
  }
  await set(page, '#slices-mode', 'oblique');
  await press(page, '#slices-align');
  await compareAll('an oblique slice');

  // Transfer function, clipping.
  await set(page, '#transfer-map', 'viridis');
  await set(page, '#transfer-steps', '5');
  await set(page, '#transfer-map-high', '180');
  await compareAll('a colour map in steps');
  await press(page, '#transfer-reverse');
  await set(page, '#transfer-steps', '0');
  await compareAll('a reversed colour map');
  await set(page, '#clip-box input[type="number"]', '10');
  await press(page, '#clip-planes button');
  await compareAll('clipping');

  // Layers and measurements.
  await press(page, '#layer-add-surface');
  for (const each of [watcher, guest]) await press(each.page, '#layers li:last-child .layer-pick');
  await compareAll('a surface');
  const { id } = await page.evaluate(() => ({ id: window.splatd.session }));
  assert.equal((await ask('PUT', `sessions/${id}/measures/width`, { kind: 'distance', points: [[10, 30, 20], [89, 30, 20]], text: 'width' })).status, 201);
  await page.locator('#measure li', { hasText: 'width' }).waitFor();
  await compareAll('a measurement');

  // A participant joins late, and the watcher reloads.
  const late = await join(context, links.watch);
  await press(late.page, '#layers li:last-child .layer-pick');
  await rest(late.page);
  await alike('late', page, late.page, { isWatching: true });
  await watcher.page.reload();
  await firstFrame(watcher.page);
  await unfold(watcher.page);
  await press(watcher.page, '#layers li:last-child .layer-pick');
  await compareAll('a reload');

  // Another volume, which is opened now: a time series.
  assert.equal((await ask('POST', 'volumes', { path: 'balls.mha' })).status, 202);
  await press(page, '#volumes button[data-id="balls"]:not(:disabled)');
  for (const each of [host, watcher, guest, late]) await until(each.page, 'the series', (s) => s.volume === 'balls');
  await compareAll('another volume');
  await set(page, '#time-number', '2');
  await until(page, 'the last step', (s) => s.view.time.step === 2);
  await compareAll('a time step');
  await set(page, '#slices-mode', 'orthogonal');

  // A guest with control has the same controls, and the host follows.
  await press(page, '#control-release');
  await until(guest.page, 'control to be free', (s) => s.canControl);
  await rest(guest.page);
  await alike('control is free', page, guest.page);
  await press(guest.page, '#control-ask');
  await until(page, 'the guest to have control', (s) => !s.canControl);
  await set(guest.page, '[data-pointer="/slices/position"] input:nth-child(3)', '6');
  await rest(guest.page);
  await until(page, 'the slice', (s) => s.view.slices.position[2] === 6);
  await settle(page);
  await alike('the guest controls', guest.page, page, { isWatching: true });

  // The daemon restarts; its sessions are hibernated until the pages return.
  const { port } = daemon;
  assert.equal(await daemon.stop(), 0);
  for (const each of [host, watcher, guest]) await each.page.locator('#status-state[data-state="lost"]').waitFor({ state: 'attached' });
  daemon = await start(port);
  for (const each of [host, watcher, guest]) await until(each.page, 'the daemon', (s) => s.state === 'live' && s.volume === 'balls');
  await until(page, 'control to be free', (s) => s.canControl);
  await press(page, '#control-ask');
  await compareAll('after the restart');
  assert.deepEqual(watcher.said.filter((text) => !/WebSocket|ERR_CONNECTION|409|503/.test(text)), []);
});

test('a link of Capture says who can open it; that of a guest joins the session', async (context) => {
  const daemon = await start();
  context.after(() => daemon.stop());
  const host = await join(context, daemon.url);
  await press(host.page, '#copy-link');
  await host.page.locator('#capture-note', { hasText: 'needs a token of this daemon. “Link to watch” and “Link to control” under People carry one' }).waitFor({ state: 'attached' });
  const guest = await join(context, await link(host.page, 'watch'));
  await press(guest.page, '#copy-link');
  await guest.page.locator('#capture-note', { hasText: 'joins this session' }).waitFor({ state: 'attached' });
  const colleague = await join(context, await guest.page.inputValue('#capture-text'));
  await rest(colleague.page);
  assert.equal(await colleague.page.evaluate(() => window.splatd.session), await host.page.evaluate(() => window.splatd.session));
  assert.equal(await colleague.page.evaluate(() => window.splatd.canControl), false);
});

test('a page without a token closes without an error', async (context) => {
  const daemon = await start();
  context.after(() => daemon.stop());
  const { context: opened, page, said } = await openPage(browser);
  context.after(() => opened.close());
  await page.goto(new URL('/', daemon.url).href);
  await page.locator('#token-form').waitFor();
  await page.evaluate(() => window.dispatchEvent(new PageTransitionEvent('pagehide')));
  assert.deepEqual(said.filter((text) => !/401/.test(text)), []);
});
