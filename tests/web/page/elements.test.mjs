// SPDX-License-Identifier: Apache-2.0
// Volumes of points, Gaussians and triangles: what the page offers for them, their layers, and layers of other volumes.
import assert from 'node:assert/strict';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { boxOf, NEEDS_AXE, checkAxe, difference, pixels, rest, share, shot, until, visit } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';

const LARGE = { viewport: { width: 1300, height: 900 } };
const PHONE = { viewport: { width: 360, height: 700 }, deviceScaleFactor: 2, isMobile: true, hasTouch: true };
const data = mkdtempSync(path.join(tmpdir(), 'splatd-elements-'));
// A tetrahedron in the middle of the engine.
writeFileSync(path.join(data, 'tool.obj'), 'v 10 5 5\nv 40 5 5\nv 10 25 5\nv 10 5 25\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n');
const { browser, daemon: real } = await share(() => startDaemon([
  '--volume', 'demo:gaussians?size=16', '--volume', 'demo:points?size=16', '--volume', 'demo:engine?size=48', '--volume', 'demo:torus?size=16', '--data', data,
  '--backend', 'cpu', '--control-time', '600',
]), () => rmSync(data, { recursive: true }));

const at = (volume) => `${real.url}&volume=${volume}`;
const layersIn = (page) => page.evaluate(() => window.splatd.view.layers);
const visible = (page, ...selectors) => Promise.all(selectors.map((selector) => page.locator(selector).isVisible()));
const eye = (page, name) => page.getByRole('button', { name: `Show ${name}`, exact: true });
const rowOf = (page, index) => page.locator(`#layer-list [data-index="${index}"]`);
const placement = (page) => page.locator('.layer-details .fold summary');

/** The picture, after all changes. */
async function picture(page) {
  await rest(page);
  return pixels(page);
}

const type = async (page, field, value) => {
  await page.fill(`[data-field="${field}"]`, String(value));
  await page.press(`[data-field="${field}"]`, 'Enter');
};

test('a page about Gaussians has no slices, transfer function or measurements of values', async (context) => {
  const { page, said } = await visit(context, browser, at('gaussians'), LARGE);
  await rest(page);
  assert.deepEqual(await visible(page, '#layers', '#clip', '#picture', '#tool-distance', '#tool-marker', '#views'), Array(6).fill(true));
  assert.deepEqual(await visible(page, '#transfer', '#slices', '#edit', '#layout-four', '#tool-window', '#tool-crosshair', '#tool-profile', '#tool-part',
    '#layer-add-surface', '#layer-add-shell', '#compositing', '#shading', '#expert'), Array(13).fill(false));
  assert.equal(await page.locator('[data-group="layout"]').isVisible(), false, 'one layout needs no buttons');
  assert.match(await page.locator('#volumes [aria-current="true"] .about').textContent(), /^\d[\d ]* Gaussians$/);
  await page.focus('#screen');
  for (const key of ['l', 'w', 'i', 'n']) await page.keyboard.press(key);
  assert.deepEqual(await page.evaluate(() => [window.splatd.layout, window.splatd.mode]), ['3d', 'navigate'], 'keys of what is not there');
  await page.keyboard.press('d');
  assert.equal(await page.evaluate(() => window.splatd.mode), 'measure-distance');
  await page.keyboard.press('Escape');
  await page.locator('#volume-info summary').click();
  await page.locator('#volume-info dd', { hasText: 'the box around all' }).waitFor();
  assert.doesNotMatch(await page.textContent('#volume-info'), /NaN|undefined|1 × 1 × 1/);
  await shot(page, 'elements-gaussians');

  // The layout and the sections come back with a grid.
  await page.click('#volumes [data-id="engine"]');
  await until(page, 'the engine', (s) => s.isIdle && s.view.layers[0].type === 'volume');
  assert.deepEqual(await visible(page, '#transfer', '#slices', '#edit', '#layout-four', '#tool-part', '#layer-add-surface', '#shading'), Array(7).fill(true));
  await page.click('#layout-four');
  await page.locator('.slice').first().hover(); // the pointer stays on a slice
  // Slices that were asked for are given up at once: the daemon would refuse them for points.
  await page.evaluate(() => {
    const { fetch } = window;
    window.held = { signals: [], end: () => { window.fetch = fetch; } };
    window.fetch = (url, options) => {
      if (!String(url).includes('/slice?')) return fetch(url, options);
      window.held.signals.push(options.signal);
      return new Promise(() => {}); // no answer
    };
  });
  await page.mouse.wheel(0, 40);
  await page.waitForFunction(() => window.held.signals.length > 0);
  assert.ok(await page.locator('#volumes [data-id="points"]').evaluate((button) => {
    button.click();
    window.held.end();
    return window.held.signals.every(({ aborted }) => aborted);
  }), 'no slice is on its way after the click');
  await until(page, 'the points in one pane', (s) => s.isIdle && s.view.layers[0].type === 'points' && s.layout === '3d');
  assert.deepEqual(await visible(page, '#transfer', '#tool-window', '#gradient', '#slices'), [true, true, false, false]);
  await page.click('#volumes [data-id="engine"]');
  await until(page, 'the layout of before', (s) => s.isIdle && s.layout === 'four');
  assert.deepEqual(said, []);
});

test('each control of points and Gaussians changes the picture, by one step for undo', async (context) => {
  const { page, said } = await visit(context, browser, at('points'), LARGE);
  const points = await picture(page);
  await rowOf(page, 0).locator('.layer-pick').click();
  assert.ok(await rowOf(page, 0).locator('.small').isDisabled(), 'the picture of the volume itself');
  await page.press('#points-size', 'End');
  compare(difference(await picture(page), points), '>', 0.02, 'ten times as large');
  assert.equal((await layersIn(page))[0].size, 10);
  await page.click('#layers-undo');
  assert.equal(difference(await picture(page), points), 0);
  await page.click('#volumes [data-id="gaussians"]');
  await until(page, 'the Gaussians', (s) => s.isIdle && s.view.layers[0].type === 'gaussians');
  const gaussians = await picture(page);
  await page.press('#gaussians-opacity', 'Home');
  await page.press('#gaussians-opacity', 'ArrowRight');
  compare(difference(await picture(page), gaussians), '>', 0.1, 'nearly transparent');
  await page.press('#gaussians-opacity', 'End');
  await page.selectOption('#gaussians-convention', 'normalised');
  await until(page, 'the convention', (s) => s.isIdle && s.view.layers[0].convention === 'normalised');
  await page.getByRole('button', { name: 'Show Gaussians' }).click();
  const empty = await picture(page);
  compare(difference(empty, gaussians), '>', 0.1, 'hidden');
  assert.deepEqual(said, []);
});

test('the position of a layer: numbers, sliders by keys, a turn about its middle, reset and undo', async (context) => {
  const { page, said } = await visit(context, browser, at('gaussians'), LARGE);
  const still = await picture(page);
  await rowOf(page, 0).locator('.layer-pick').click();
  await placement(page).click();
  await type(page, 'turn-z', 90);
  const [{ transform }] = await layersIn(page);
  assert.deepEqual(transform.slice(0, 3).map((part) => Math.round(part * 1e9) / 1e9), [0, -1, 0]);
  compare(Math.hypot(transform[3], transform[7], transform[11]), '<', 0.01, 'the middle stays');
  await type(page, 'scale', 0.5);
  await type(page, 'move-x', 0.75);
  assert.equal(await page.inputValue('[data-field="turn-z"]'), '90', 'fields keep what was typed');
  compare(difference(await picture(page), still), '>', 0.1);
  await page.getByRole('slider', { name: 'Turn x' }).press('ArrowRight');
  await until(page, 'a degree', () => document.querySelector('[data-field="turn-x"]').value === '1');
  await type(page, 'scale', -1);
  assert.equal(await page.inputValue('[data-field="scale"]'), '0.5', 'a scale is above 0');
  await page.click('#layers-undo');
  await until(page, 'the turn about x is taken back', (s) => s.isIdle && Math.abs(s.view.layers[0].transform[9]) < 1e-9);
  await until(page, 'the field', () => document.querySelector('[data-field="turn-x"]').value === '0');
  await shot(page, 'elements-position');
  await page.getByRole('button', { name: 'Reset', exact: true }).click();
  assert.equal(difference(await picture(page), still), 0);
  assert.deepEqual(said, []);
});

test('a mesh has shading, and its own colours or one; a mesh of a file is added where its coordinates say', async (context) => {
  const { page, said } = await visit(context, browser, at('torus'), LARGE);
  const own = await picture(page);
  assert.deepEqual(await visible(page, '#shading', '#transfer', '#slices', '#expert', '#occlusion'), [true, false, false, false, false]);
  await rowOf(page, 0).locator('.layer-pick').click();
  await page.selectOption('#geometry-colors', 'layer');
  const plain = await picture(page);
  compare(difference(plain, own), '>', 0.1, 'one colour');
  await page.locator('#geometry-color').evaluate((input) => {
    input.value = '#2040ff';
    input.dispatchEvent(new Event('input', { bubbles: true }));
    input.dispatchEvent(new Event('change', { bubbles: true }));
  });
  compare(difference(await picture(page), plain), '>', 0.1, 'blue');
  await page.press('#geometry-opacity', 'Home');
  assert.equal((await layersIn(page))[0].opacity, 0);
  await page.click('#volumes [data-id="engine"]');
  await until(page, 'the engine', (s) => s.isIdle && s.view.layers[0].type === 'volume');
  const engine = await picture(page);
  await page.click('#layer-add-elements');
  await page.click('#add-layer-open');
  assert.match(await page.locator('#open-list [data-name="tool.obj"] .about').textContent(), /^OBJ · /);
  await page.click('#open-list [data-name="tool.obj"]');
  await until(page, 'the mesh', (s) => s.isIdle && s.view.layers.length === 2);
  const [, layer] = await layersIn(page);
  assert.deepEqual([layer.type, layer.id, layer.transform[3], layer.colors], ['geometry', 'tool', 0, 'own'], 'it stays where its file says');
  assert.equal((await page.evaluate(() => window.splatd.view.volume)), 'engine', 'the volume stays');
  const both = await picture(page);
  compare(difference(both, engine), '>', 0.005);
  await page.click('#volumes .close[data-id="close:tool"]');
  await page.locator('.prompt[data-id="closed"]').getByRole('button', { name: 'Choose a volume …' }).click();
  await page.click('#add-layer-open');
  await page.click('#open-list [data-name="tool.obj"]');
  await page.locator('#layer-list [data-index="1"]:not([data-closed])').waitFor();
  await page.locator('.prompt[data-id="closed"]').waitFor({ state: 'detached' });
  await eye(page, 'tool').click(); // the daemon draws again
  assert.equal(difference(await picture(page), engine), 0);
  await eye(page, 'tool').click();
  assert.equal(difference(await picture(page), both), 0, 'the layer is there again');
  await page.click('#volumes .close[data-id="close:tool"]');
  await page.locator('#volumes [data-id="tool"]').waitFor({ state: 'detached' });
  assert.deepEqual(said, []);
});

test('a guest without a list of volumes gets the page of the kind, and changes layers', async (context) => {
  const host = await visit(context, browser, at('gaussians'), LARGE);
  await host.page.locator('#people-fold').evaluate((fold) => { fold.open = true; });
  await host.page.click('#link-control');
  const guest = await visit(context, browser, await host.page.inputValue('#link-text'), LARGE);
  await rest(guest.page);
  assert.deepEqual(await visible(guest.page, '#layers', '#transfer', '#slices', '#tool-part', '#layer-add-elements'), [true, false, false, false, false]);
  await host.page.click('#control-release');
  await until(guest.page, 'no holder', (s) => !s.people.some((p) => p.isHolder && !p.isYou));
  await guest.page.locator('#people-fold').evaluate((fold) => { fold.open = true; });
  if (!await guest.page.evaluate(() => window.splatd.canControl)) await guest.page.click('#control-ask');
  await until(guest.page, 'control', (s) => s.canControl);
  await rowOf(guest.page, 0).locator('.layer-pick').click();
  await guest.page.press('#gaussians-opacity', 'Home');
  await until(host.page, 'the opacity', (s) => s.view.layers[0].opacity === 0);
  for (const { said } of [host, guest]) assert.deepEqual(said, []);
});

test('V tells the value of a point, and of a Gaussian the place alone; a marker lies on it', async (context) => {
  const { page, said } = await visit(context, browser, at('points'), LARGE);
  await rest(page);
  const ask = async (dx) => {
    const { x, y, width, height } = await boxOf(page.locator('#screen'));
    await page.focus('#screen');
    await page.mouse.move(x + width / 2 + dx, y + height / 2);
    await page.keyboard.press('v');
  };
  await ask(0);
  await page.locator('#notice-text', { hasText: /^Value 0\.\d+ at / }).waitFor();
  assert.equal(await page.locator('.prompt[data-id="pick"]').count(), 0, 'points have no surfaces');
  await page.click('#volumes [data-id="gaussians"]');
  await until(page, 'the Gaussians', (s) => s.isIdle && s.view.layers[0].type === 'gaussians');
  await rest(page);
  await ask(-240); // on the ring
  await page.locator('#notice-text', { hasText: /^Position −?\d/ }).waitFor();
  assert.doesNotMatch(await page.textContent('#notice-text'), /NaN|null/);
  await page.keyboard.press('m');
  const { x, y, width, height } = await boxOf(page.locator('#screen'));
  await page.mouse.click(x + width / 2 - 240, y + height / 2);
  await until(page, 'the marker', (s) => s.measures.length === 1);
  const [{ points: [place] }] = await page.evaluate(() => window.splatd.measures);
  compare(Math.abs(Math.hypot(place[0], place[1]) - 1), '<', 0.5, `in the ring: ${place}`);
  compare(Math.abs(place[2]), '<', 0.5);
  await page.locator('#measure').evaluate((fold) => { fold.open = true; });
  assert.doesNotMatch(await page.textContent('#measure'), /NaN|null|undefined/);
  await shot(page, 'elements-marker');
  assert.deepEqual(said, []);
});

test('the dialog and the controls are accessible, and usable on a phone', NEEDS_AXE, async (context) => {
  const { page, said } = await visit(context, browser, at('points'), PHONE);
  await page.tap('#panel-toggle');
  await rowOf(page, 0).locator('.layer-pick').tap();
  await placement(page).tap();
  await checkAxe(page, '#layers');
  await page.tap('#layer-add-elements');
  await checkAxe(page, '#add-layer');
  await shot(page, 'elements-phone');
  await page.tap('#add-layer-close');
  const { width } = page.viewportSize();
  for (const { x, width: w } of await page.locator('.layer-placement input').evaluateAll((all) => all.map((input) => input.getBoundingClientRect().toJSON()))) {
    compare(x + w, '<=', width);
  }
  assert.deepEqual(said, []);
});

test('a volume gets the elements of another one, which is moved into it; when that closes, the page says what to do', async (context) => {
  const { page, said } = await visit(context, browser, at('engine'), LARGE);
  const engine = await picture(page);
  await page.click('#layer-add-elements');
  assert.deepEqual(await page.locator('#add-layer-list [data-id]').evaluateAll((all) => all.map(({ dataset }) => dataset.id)), ['gaussians', 'points', 'torus']);
  await shot(page, 'elements-add');
  await page.keyboard.press('Escape');
  assert.equal((await layersIn(page)).length, 1);
  await page.click('#layer-add-elements');
  await page.click('#add-layer-list [data-id="gaussians"]');
  await until(page, 'both', (s) => s.isIdle && s.view.layers.length === 2 && s.view.layers[0].visible);
  const [, layer] = await layersIn(page);
  assert.deepEqual([layer.type, layer.id], ['gaussians', 'gaussians']);
  compare(layer.transform[0], '>', 5, 'as large as the engine');
  assert.match(await page.textContent('#notice-text'), /moved and scaled/);
  assert.equal(await rowOf(page, 1).locator('.layer-name').textContent(), 'gaussians');
  const both = await picture(page);
  compare(difference(both, engine), '>', 0.02);
  await shot(page, 'elements-mixed');

  await page.click('#volumes .close[data-id="close:gaussians"]');
  await page.locator('.prompt[data-id="closed"]').waitFor();
  assert.equal(await rowOf(page, 1).locator('.layer-value').textContent(), 'closed');
  assert.ok(await page.locator('.layer-closed').isVisible());
  assert.equal(await page.locator('#gaussians-opacity').isVisible(), false);
  await page.locator('.prompt[data-id="closed"]').getByRole('button', { name: 'Hide the layer' }).click();
  assert.equal(difference(await picture(page), engine), 0, 'pictures without the layer');
  await page.locator('.layer-closed').getByRole('button').click();
  await page.click('#add-layer-list [data-id="points"]');
  await until(page, 'the points in its place', (s) => s.isIdle && s.view.layers.length === 2 && s.view.layers[1].type === 'points');
  assert.equal(await page.locator('.prompt[data-id="closed"]').count(), 0);
  assert.match(await page.textContent('#notice-text'), /hides all points/, 'the transfer function of the engine begins above their values');
  await page.getByRole('button', { name: 'Remove points' }).click();
  assert.equal(difference(await picture(page), engine), 0);
  assert.deepEqual(said, []);
});
