// SPDX-License-Identifier: Apache-2.0
// Saved pictures, copied commands and saved views, with the real daemon.
import assert from 'node:assert/strict';
import { execFile } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { promisify } from 'node:util';
import { test } from 'node:test';
import { boxOf, camera, difference, eventually, rest, share, shot, until, visit } from '../support/browser.mjs';
import { startDaemon, tokenFile } from '../support/daemon.mjs';
import { decodePng } from '../support/png.mjs';

const BIN = process.env.SPLATD_BIN_DIR;
const folder = mkdtempSync(path.join(tmpdir(), 'splatd-capture-'));
const token = tokenFile();
const start = () => startDaemon(['--volume', 'demo:engine?size=32', '--volume', 'demo:phantom?size=32', '--backend', 'cpu', '--state', path.join(folder, 'state'),
  '--frame-size', '1M'], { token });
const shared = await share(start, () => {
  rmSync(folder, { recursive: true });
  token.remove();
});
const { browser } = shared;

async function open(context, address = shared.daemon.url, options = { viewport: { width: 700, height: 500 } }) {
  const opened = await visit(context, browser, address, options);
  await rest(opened.page);
  await opened.page.locator('#capture').evaluate((fold) => { fold.open = true; });
  return opened;
}

async function choose(page, { size, format, alpha }) {
  if (size) {
    await page.selectOption('#capture-size', 'custom');
    await page.fill('#capture-width', String(size[0]));
    await page.fill('#capture-height', String(size[1]));
  }
  if (format) await page.selectOption('#capture-format', format);
  if (alpha !== undefined) await page.setChecked('#capture-alpha', alpha);
}

/** Presses "Save picture" and returns {name, bytes}. */
async function save(page) {
  const [saved] = await Promise.all([page.waitForEvent('download'), page.click('#capture-save')]);
  return { name: saved.suggestedFilename(), bytes: readFileSync(await saved.path()) };
}

/** The alpha of a PNG with an alpha channel, at (x, y). */
function alphaAt(bytes, x, y) {
  assert.equal(bytes[25], 6, 'an RGBA PNG');
  return decodePng(bytes).alpha(x, y);
}

test('a saved picture has the asked size, format and alpha', async (context) => {
  const { page } = await open(context);
  await choose(page, { size: [200, 120], format: 'png', alpha: true });
  const png = await save(page);
  assert.equal(png.name, 'engine.png');
  assert.deepEqual([png.bytes.readUInt32BE(16), png.bytes.readUInt32BE(20)], [200, 120]);
  assert.equal(alphaAt(png.bytes, 0, 0), 0);
  assert.ok(alphaAt(png.bytes, 100, 60) > 128);
  await page.locator('#capture-state', { hasText: '200 × 120' }).waitFor();

  await choose(page, { alpha: false });
  const opaque = await save(page);
  assert.equal(opaque.bytes[25], 2, 'an opaque PNG has no alpha');

  await choose(page, { format: 'jpeg' });
  assert.ok(await page.isDisabled('#capture-alpha'));
  const jpeg = await save(page);
  assert.deepEqual([jpeg.name, jpeg.bytes.readUInt16BE(0)], ['engine.jpeg', 0xffd8]);

  await choose(page, { format: 'exr' });
  const exr = await save(page);
  assert.equal(exr.bytes.readUInt32LE(0), 20000630);
  const at = exr.bytes.indexOf('dataWindow\0box2i\0') + 'dataWindow\0box2i\0'.length + 4;
  assert.deepEqual([8, 12].map((offset) => exr.bytes.readInt32LE(at + offset)), [199, 119]);
  for (const channel of ['A', 'B', 'G', 'R']) assert.ok(exr.bytes.subarray(0, 400).includes(`${channel}\0`), `channel ${channel}`);
});

test('a size over the limit of the daemon is said and not asked for', async (context) => {
  const { page } = await open(context);
  assert.ok(await page.locator('#capture-size option[value="uhd"]').evaluate((option) => option.disabled));
  await choose(page, { size: [2000, 1000] });
  await page.locator('#capture-state', { hasText: 'at most 1448 × 724' }).waitFor();
  await page.route('**/api/v1/render*', () => assert.fail('the picture was requested'));
  await page.click('#capture-save');
  await choose(page, { size: [9000, 10] });
  await page.locator('#capture-state', { hasText: 'from 1 to 8192' }).waitFor();
});

test('a picture under way can be cancelled, and a busy daemon is said', async (context) => {
  const { page } = await open(context);
  let answer = null;
  await page.route('**/api/v1/render*', (route) => { answer = route; });
  await page.click('#capture-save');
  await eventually('the request', () => answer);
  await page.locator('#capture-busy').waitFor();
  await page.click('#capture-cancel');
  await page.locator('#capture-state', { hasText: 'Cancelled' }).waitFor();
  assert.ok(await page.isHidden('#capture-busy'));
  await page.unroute('**/api/v1/render*');
  await page.route('**/api/v1/render*', (route) => route.fulfill({
    status: 503, headers: { 'Retry-After': '1', 'Content-Type': 'application/problem+json' }, body: '{"title":"x","status":503,"detail":"100 images wait"}' }));
  await page.click('#capture-save');
  await page.locator('#capture-state', { hasText: 'busy: 100 images wait' }).waitFor();
});

test('the copied commands make the same picture as the page', async (context) => {
  const { page } = await open(context);
  await page.focus('#screen');
  await page.keyboard.press('ArrowLeft');
  await page.click('#layer-add-surface');
  await rest(page);
  await choose(page, { size: [64, 48], format: 'png', alpha: true });
  const { bytes } = await save(page);
  for (const name of ['curl', 'splatctl']) {
    await page.click(`#copy-${name}`);
    const command = await page.inputValue('#capture-text');
    assert.ok(!command.includes(token.text), 'the token is left out');
    await promisify(execFile)('/bin/sh', ['-c', command], { cwd: folder, env: { PATH: `${BIN}:${process.env.PATH}`, SPLATD_TOKEN: token.text } });
    assert.ok(readFileSync(path.join(folder, 'engine.png')).equals(bytes), `the picture of ${name}`);
    rmSync(path.join(folder, 'engine.png'));
  }
  await page.setChecked('#capture-token', true);
  await page.click('#copy-curl');
  assert.ok((await page.inputValue('#capture-text')).includes(token.text));
  await page.click('#copy-json');
  const view = JSON.parse(await page.inputValue('#capture-text'));
  assert.deepEqual([view.volume, view.size, view.camera], ['engine', [64, 48], await camera(page)]);
  assert.deepEqual(view.layers.map(({ type, visible }) => [type, visible]), [['volume', false], ['surface', true]]);
});

test('beside slices, all panes are saved as the layout shows them, or the picture alone', async (context) => {
  const { page } = await open(context, shared.daemon.url, { viewport: { width: 1200, height: 800 } });
  await page.click('#layout-four');
  await rest(page);
  await until(page, 'the slices', () => ['axial', 'coronal', 'sagittal'].every((id) => document.querySelector(`#pane-${id} .pane-body`).dataset.state === 'newest'));
  const box = await boxOf(page.locator('main'));
  const all = decodePng((await save(page)).bytes);
  assert.deepEqual([all.width, all.height], [box.width, box.height].map(Math.round));
  // The saved picture has the slice of the pane.
  const { url, place } = await page.evaluate(() => {
    const canvas = document.querySelector('#pane-coronal canvas');
    const { left, top } = canvas.getBoundingClientRect();
    const main = document.querySelector('main').getBoundingClientRect();
    return { url: canvas.toDataURL('image/png'), place: [left - main.left, top - main.top].map(Math.round) };
  });
  const slice = decodePng(Buffer.from(url.slice(url.indexOf(',') + 1), 'base64'));
  let [same, lit] = [0, 0];
  for (let y = 40; y < slice.height - 40; y += 7) {
    for (let x = 10; x < slice.width - 40; x += 7) {
      if (slice.at(x, y)[0] < 40) continue;
      lit += 1;
      same += Math.abs(slice.at(x, y)[0] - all.at(place[0] + x, place[1] + y)[0]) < 12;
    }
  }
  assert.ok(lit > 100 && same > 0.9 * lit, `${same} of ${lit}`);
  await page.selectOption('#capture-what', 'picture');
  await choose(page, { size: [64, 48], format: 'png' });
  assert.deepEqual((({ width, height }) => [width, height])(decodePng((await save(page)).bytes)), [64, 48]);
  await page.click('#layout-slices');
  await page.selectOption('#capture-what', 'panes');
  assert.ok((await save(page)).bytes.length > 1000);
  await page.locator('#capture').evaluate((fold) => { fold.open = false; });
  await page.click('#tool-capture');
  await page.locator('#notice[data-tone="success"]').waitFor();
});

test('annotations are drawn into the picture on request', async (context) => {
  const { page } = await open(context);
  await page.evaluate(() => {
    const line = document.createElementNS('http://www.w3.org/2000/svg', 'rect');
    for (const [name, value] of Object.entries({ x: 0, y: 0, width: 4000, height: 20, fill: 'rgb(255, 0, 0)' })) line.setAttribute(name, value);
    document.getElementById('overlay').append(line);
  });
  await choose(page, { size: [350, 250], format: 'png', alpha: false });
  const plain = decodePng((await save(page)).bytes);
  await page.setChecked('#capture-burn', true);
  const burnt = decodePng((await save(page)).bytes);
  assert.deepEqual(burnt.at(175, 4).slice(0, 3), [255, 0, 0]);
  assert.notDeepEqual(plain.at(175, 4).slice(0, 3), [255, 0, 0]);
  assert.deepEqual(burnt.at(175, 125).slice(0, 3), plain.at(175, 125).slice(0, 3));
  const part = ({ at }, left, top, width, height) => ({ width, height, at: (x, y) => at(left + x, top + y) });
  for (const [name, ...box] of [['the scale bar', 250, 220, 100, 30], ['the colour bar', 310, 130, 40, 80], ['the cube', 270, 24, 80, 60]]) {
    assert.ok(difference(part(burnt, ...box), part(plain, ...box)) > 0.02, name);
  }
});

test('saved views are a gallery that survives reload and restart, and goes to views of other volumes', async (context) => {
  const { page } = await open(context);
  await page.focus('#screen');
  await page.keyboard.press('ArrowLeft');
  await rest(page);
  const home = await camera(page);
  await page.fill('#saved-name', 'Left "side"');
  await page.press('#saved-name', 'Enter');
  await page.locator('#saved li').first().waitFor();
  await page.locator('#saved li').first().scrollIntoViewIfNeeded();
  await page.locator('#saved img[src]').first().waitFor();
  assert.ok(await page.locator('#saved img').first().evaluate((image) => image.decode().then(() => image.naturalWidth === 240)));

  await page.reload();
  await rest(page);
  assert.equal(await page.locator('#saved .name').first().inputValue(), 'Left "side"');
  await page.click('#volumes button:has-text("phantom")');
  await until(page, 'the other volume', (s) => s.volume === 'phantom' && s.isIdle);
  await rest(page);
  await page.click('#saved .picture');
  await until(page, 'the volume of the view', (s) => s.volume === 'engine' && s.isIdle);
  await rest(page);
  const back = await camera(page);
  assert.ok(back.position.every((x, i) => Math.abs(x - home.position[i]) < 1e-4), 'the camera of the view');
  await shot(page, 'saved-views');

  const { port } = shared.daemon;
  await shared.daemon.stop();
  shared.daemon = await startDaemon(['--volume', 'demo:engine?size=32', '--volume', 'demo:phantom?size=32', '--backend', 'cpu', '--state', path.join(folder, 'state')], { token, port });
  await page.reload();
  await rest(page);
  await page.locator('#saved li').first().waitFor();
  await page.locator('#saved .name').first().fill('Renamed');
  await page.locator('#saved .name').first().press('Enter');
  await page.locator('#saved .picture[aria-label="Go to Renamed"]').waitFor();
  await page.click('#saved .delete');
  await page.click('#ask-act');
  await page.locator('#saved-note', { hasText: 'appear here' }).waitFor();
  assert.equal(await page.locator('#saved li').count(), 0);
});

test('a guest saves the picture of the session, and the gallery explains itself', async (context) => {
  const host = await open(context);
  await choose(host.page, { size: [64, 48], format: 'png' });
  const { bytes } = await save(host.page);
  await host.page.locator('#people-fold').evaluate((fold) => { fold.open = true; });
  await host.page.click('#link-watch');
  await host.page.locator('#link-row').waitFor();
  const guest = await open(context, await host.page.locator('#link-text').inputValue());
  await choose(guest.page, { size: [64, 48], format: 'png' });
  assert.ok((await save(guest.page)).bytes.equals(bytes));
  await guest.page.locator('#saved-note', { hasText: 'joined by a link' }).waitFor();
  assert.ok(await guest.page.isHidden('#saved-form'));
});

test('the clipboard takes the picture as PNG, and the link; a browser that refuses leaves the link in its field', async (context) => {
  const { page, context: own } = await open(context);
  await own.grantPermissions(['clipboard-read', 'clipboard-write']);
  await choose(page, { size: [120, 80] });
  await page.click('#capture-copy');
  await page.locator('#capture-state', { hasText: 'in the clipboard' }).waitFor();
  const copied = Buffer.from(await page.evaluate(async () => {
    const [item] = await navigator.clipboard.read();
    const bytes = new Uint8Array(await (await item.getType('image/png')).arrayBuffer());
    return String.fromCharCode(...bytes);
  }), 'latin1');
  const image = decodePng(copied);
  assert.deepEqual([image.width, image.height], [120, 80]);
  const saved = decodePng((await save(page)).bytes);
  assert.equal(difference(image, saved), 0, 'it is the picture that is saved');

  await page.click('#copy-link');
  await page.locator('#capture', { hasText: 'copied' }).waitFor();
  const link = await page.locator('#capture-text').inputValue();
  assert.match(link, /#view=[0-9a-f]{32}$/);
  assert.equal(await page.evaluate(() => navigator.clipboard.readText()), link);
  const guest = await visit(context, browser, `${shared.daemon.url}#${new URL(link).hash.slice(1)}`);
  assert.equal(await guest.page.evaluate(() => window.splatd.volume), 'engine', 'the link opens the view');

  await page.evaluate(() => {
    navigator.clipboard.write = navigator.clipboard.writeText = () => Promise.reject(new Error('not allowed'));
  });
  await page.click('#copy-link');
  await page.locator('#capture', { hasText: 'copy it from here' }).waitFor();
  assert.match(await page.evaluate(() => window.getSelection().toString() || document.activeElement.value), /#view=[0-9a-f]{32}$/);
  await page.click('#capture-copy');
  await page.locator('#capture-state', { hasText: 'not allowed' }).waitFor();
});
