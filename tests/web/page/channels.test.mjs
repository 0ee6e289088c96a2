// SPDX-License-Identifier: Apache-2.0
// The section "Channels" with the real daemon and a file of several fields: all channels in one picture, colours, windows, undo, projections,
// what cannot be mixed, and who may do it.
import assert from 'node:assert/strict';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { NEEDS_AXE, checkAxe, eventually, pixels, rest, settle, share, shot, until, visit } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';

const LARGE = { viewport: { width: 1000, height: 1000 } };
const PHONE = { viewport: { width: 360, height: 700 }, deviceScaleFactor: 2, isMobile: true, hasTouch: true };
const N = 24;

/** A legacy VTK file of three fields of bytes: a ball at the left, one at the right, and a shell around both. */
function cells() {
  const ball = (x, y, z, at) => 200 * Math.max(0, Math.min(1, 5 - Math.hypot(x - at, y - 11.5, z - 11.5)));
  const fields = {
    nuclei: (...at) => ball(...at, 6), spots: (...at) => ball(...at, 17),
    membranes: (x, y, z) => 150 * Math.exp(-((Math.hypot(x - 11.5, y - 11.5, z - 11.5) - 10) ** 2)),
  };
  const header = `# vtk DataFile Version 3.0\ncells\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS ${N} ${N} ${N}\nORIGIN 0 0 0\nSPACING 1 1 1\nPOINT_DATA ${N ** 3}\n`;
  return Buffer.concat([Buffer.from(header), ...Object.entries(fields).flatMap(([name, valueAt]) => [
    Buffer.from(`SCALARS ${name} unsigned_char 1\nLOOKUP_TABLE default\n`),
    Buffer.from([...Array(N ** 3).keys()].map((i) => Math.round(valueAt(i % N, Math.floor(i / N) % N, Math.floor(i / N / N))))), Buffer.from('\n')])]);
}

/** An NRRD file of colours: red grows along x, green along y, blue along z; all is opaque. */
function colors(side = 12) {
  const bytes = Array.from({ length: side ** 3 }, (_, i) => [...[i % side, Math.floor(i / side) % side, Math.floor(i / side / side)].map((at) => at * 20), 255]).flat();
  return Buffer.concat([Buffer.from(`NRRD0004\ntype: uint8\ndimension: 4\nsizes: 4 ${side} ${side} ${side}\nkinds: RGBA-color domain domain domain\nencoding: raw\n\n`), Buffer.from(bytes)]);
}

const folder = mkdtempSync(path.join(tmpdir(), 'splatd-channels-'));
writeFileSync(path.join(folder, 'cells.vtk'), cells());
writeFileSync(path.join(folder, 'colors.nrrd'), colors());
const { browser, daemon } = await share(
  () => startDaemon(['--data', folder, '--volume', path.join(folder, 'cells.vtk'), '--volume', 'demo:noise?size=8', '--backend', 'cpu', '--control-time', '600']),
  () => rmSync(folder, { recursive: true }));

const viewOf = (page) => page.evaluate(() => window.splatd.view);
const channelsIn = async (page) => (await viewOf(page)).layers.filter(({ type }) => type === 'channel');
const rowOf = (page, name) => page.locator('#channel-list li', { has: page.locator('.layer-name', { hasText: name }) });
const colorIn = (row) => row.locator('input[type="color"]');
/** The view that the daemon has for the page's session. */
async function daemonView(page) {
  const { origin, searchParams } = new URL(daemon.url);
  const id = await page.evaluate(() => window.splatd.session);
  const answer = await fetch(`${origin}/api/v1/sessions/${id}`, { headers: { Authorization: `Bearer ${searchParams.get('token')}` } });
  return (await answer.json()).view;
}

function setColor(input, value) {
  return input.evaluate((element, text) => {
    element.value = text;
    element.dispatchEvent(new Event('input', { bubbles: true }));
    element.dispatchEvent(new Event('change', { bubbles: true }));
  }, value);
}

/** Opens the page and mixes all channels. */
async function mixed(context, options = LARGE) {
  const opened = await visit(context, browser, daemon.url, options);
  const { page } = opened;
  if (options.isMobile) await page.tap('#panel-toggle');
  await until(page, 'the histogram', () => document.querySelectorAll('#transfer-curve .handle').length > 0);
  await page.click('#channels-all');
  await until(page, 'all channels', (s) => s.view.layers.length === 3);
  await rest(page);
  return opened;
}

/** How many pixels of the picture have each of the colours: 'rgb' with a capital letter for each bright part, such as 'Rgb'. */
async function countColors(page) {
  const picture = await pixels(page);
  const counts = {};
  for (let y = 0; y < picture.height; y += 1) {
    for (let x = 0; x < picture.width; x += 1) {
      const color = picture.at(x, y);
      const name = [...'rgb'].map((letter, c) => (color[c] > 90 ? letter.toUpperCase() : letter)).join('');
      counts[name] = (counts[name] ?? 0) + 1;
    }
  }
  return counts;
}


const slide = async (page, name, end, keyName) => rowOf(page, name).locator(`> .pair [data-end="${end}"]`).press(keyName);

test('all channels of a file are mixed with one click, and have colours and windows of their own', async (context) => {
  const { page, said } = await mixed(context);
  const names = await page.locator('#channel-list .layer-name').allTextContents();
  assert.deepEqual(names, ['nuclei', 'spots', 'membranes']);
  assert.deepEqual(await Promise.all(names.map((name) => colorIn(rowOf(page, name)).inputValue())), ['#00ff00', '#ff00ff', '#00ffff']);
  const view = await viewOf(page);
  assert.deepEqual(view.layers.map(({ type, visible }) => [type, visible]), [['volume', true], ['channel', true], ['channel', true]]);
  for (const points of [view.transfer_function.points, view.layers[1].points]) assert.deepEqual(points.map(({ opacity }) => opacity), [0, 0.95]);
  for (const [{ value }] of [view.transfer_function.points, view.layers[1].points]) compare(value, '>', 0, 'the window begins above the background');
  assert.ok(await page.locator('#channels-all').isHidden(), 'there is no other field');
  assert.ok(await page.locator('#channels-hint').isVisible(), 'the picture says what cannot be mixed');
  for (const id of ['occlusion', 'shadow']) assert.ok(await page.locator(`#${id}`).isDisabled(), id);
  assert.ok(await page.locator('#compositing option[value="splat"]').evaluate((option) => option.disabled));

  // The shell around both balls becomes faint: the picture shows the colours of both.
  await setColor(colorIn(rowOf(page, 'spots')), '#ff0000');
  await rowOf(page, 'membranes').locator('.eye').click();
  await rest(page);
  const counts = await countColors(page);
  for (const name of ['rGb', 'Rgb']) compare(counts[name] ?? 0, '>', 1000, `pixels of ${name}: ${JSON.stringify(counts)}`);
  assert.equal(counts.rGB ?? 0, 0, 'the shell is hidden');
  await page.click('#channels-maximum');
  await until(page, 'the maximum', (s) => s.view.compositing.mode === 'maximum' && s.view.compositing.colors === 'transfer_function');
  await page.click('#channels-maximum');
  await until(page, 'the mixture', (s) => s.view.compositing.mode === 'sheet');
  await page.click('#layout-four');
  await until(page, 'both channels in a slice', () => {
    const canvas = document.querySelector('#pane-axial canvas');
    if (document.querySelector('#pane-axial .pane-body').dataset.state !== 'newest') return false;
    const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    let [red, green] = [0, 0];
    for (let i = 0; i < data.length; i += 4) {
      if (data[i] > 150 && data[i + 1] < 50) red += 1;
      if (data[i + 1] > 150 && data[i] < 50) green += 1;
    }
    return red > 100 && green > 100;
  });
  // A channel whose slice fails: the old one is not mixed into another place, the pane says so, and the next change asks again.
  const slices = '**/slice?*channel=*';
  let [failures, answers] = [0, 0];
  page.on('response', (response) => { if (response.status() === 503) answers += 1; });
  const fail = (route) => {
    failures += 1;
    return route.fulfill({ status: 503, contentType: 'application/problem+json', body: JSON.stringify({ title: 'no memory', status: 503 }) });
  };
  await page.route(slices, fail);
  await page.focus('#pane-axial canvas');
  await page.keyboard.press('PageUp');
  await until(page, 'the slice of the volume alone', () => {
    const canvas = document.querySelector('#pane-axial canvas');
    const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    let [red, green] = [0, 0];
    for (let i = 0; i < data.length; i += 4) {
      if (data[i] > 50) red += 1;
      if (data[i + 1] > 150) green += 1;
    }
    return !document.querySelector('#pane-axial .slice-problem').hidden && red === 0 && green > 100;
  });
  // A pending request would answer to the next change with its failure.
  await rest(page);
  await eventually('an answer to each request', () => answers === failures);
  await settle(page);
  await page.unroute(slices, fail);
  await page.keyboard.press('+');
  await until(page, 'both channels again', () => document.querySelector('#pane-axial .slice-problem').hidden && document.querySelector('#pane-axial .pane-body').dataset.state === 'newest');
  await page.click('#layout-3d');
  await rest(page);
  said.splice(0); // Chromium tells every failed request
  await slide(page, 'spots', 'low', 'End');
  await slide(page, 'spots', 'low', 'Home');
  await slide(page, 'spots', 'high', 'ArrowLeft');
  const [spots] = await channelsIn(page);
  assert.deepEqual(spots.points.map(({ color }) => color), [[1, 0, 0], [1, 0, 0]]);
  assert.equal(spots.points[0].value, 0);
  compare(spots.points[1].value, '<', 200);
  await rest(page);
  const kept = await daemonView(page);
  assert.deepEqual(kept.layers.map(({ type, visible }) => [type, visible]), [['volume', true], ['channel', true], ['channel', false]]);
  compare(Math.abs(kept.layers[1].points[1].value - spots.points[1].value), '<', 1e-4);
  assert.deepEqual(kept.layers[1].points[1].color, [1, 0, 0]);
  assert.deepEqual(said, []);
});

test('the controls of a channel: numbers, opacity and the curve; undo takes all back', NEEDS_AXE, async (context) => {
  const { page, said } = await mixed(context);
  const before = await viewOf(page);
  await rowOf(page, 'membranes').locator('.layer-pick').click();
  await page.fill('#channel-low', '20');
  await page.press('#channel-low', 'Enter');
  const valuesOf = async (i) => (await channelsIn(page))[i].points.map(({ value }) => value);
  assert.equal((await valuesOf(1))[0], 20);
  await page.fill('#channel-high', '10');
  await page.press('#channel-high', 'Enter');
  const pushed = await valuesOf(1);
  assert.equal(pushed[1], 10);
  compare(pushed[0], '<', 10, 'an end pushes the other one');
  await page.fill('#channel-high', '140');
  await page.press('#channel-high', 'Enter');
  await page.press('#channel-opacity', 'ArrowLeft');
  compare(Math.max(...(await channelsIn(page))[1].points.map(({ opacity }) => opacity)), '<', 0.95);
  await page.locator('.channel-details summary').click();
  await page.locator('.channel-details [data-part="add"]').click();
  assert.equal((await valuesOf(1)).length, 3);
  await checkAxe(page, '#channels');
  await page.locator('#channels').scrollIntoViewIfNeeded();
  await shot(page, 'channels-details');
  // The row of the volume edits the transfer function.
  await setColor(colorIn(rowOf(page, 'nuclei')), '#ffff00');
  assert.deepEqual((await viewOf(page)).transfer_function.points.map(({ color }) => color), [[1, 1, 0], [1, 1, 0]]);
  await rowOf(page, 'nuclei').locator('.eye').click();
  assert.equal((await viewOf(page)).layers[0].visible, false);
  await page.getByRole('button', { name: 'Remove spots' }).click();
  assert.deepEqual((await channelsIn(page)).length, 1);
  assert.deepEqual(await page.locator('#channels-add option').allTextContents(), ['Choose …', 'spots']);
  for (let i = 0; i < 12 && (await viewOf(page)).layers.length !== 1; i += 1) await page.click('#layers-undo');
  const after = await viewOf(page);
  assert.deepEqual(after.layers.map(({ type }) => type), ['volume'], 'as before "Show all channels"');
  assert.notDeepEqual(after.transfer_function.points, before.transfer_function.points);
  await page.click('#layers-redo');
  assert.deepEqual(await channelsIn(page), before.layers.slice(1));
  await rest(page);
  await page.reload();
  await until(page, 'the channels again', (s) => s.state === 'live' && s.view.layers.length === 3 && document.querySelectorAll('#channel-list li').length === 3);
  assert.deepEqual(said, []);
});

test('a file of colours opens in them: each field in its own, with one window', async (context) => {
  const { page, said } = await visit(context, browser, daemon.url, LARGE);
  const openColors = async () => {
    await page.click('#open-button');
    await page.locator('#open-list [data-name="colors.nrrd"]').click();
  };
  // Two of the three colours would be other colours.
  const fail = (route) => (/"blue"/.test(route.request().postData()) ? route.fulfill({ status: 503, body: '{}' }) : route.continue());
  await page.route('**/api/v1/volumes', fail);
  await openColors();
  await page.locator('#notice[data-tone="error"]', { hasText: 'The field blue could not be loaded' }).waitFor();
  await until(page, 'rest', (s) => s.volume === 'colors' && s.isIdle);
  assert.equal((await viewOf(page)).layers.length, 1);
  await page.unroute('**/api/v1/volumes', fail);
  said.splice(0); // Chromium tells every failed request
  await openColors();
  await until(page, 'the channels', (s) => s.view.layers.length === 3);
  await rest(page);
  const { layers, transfer_function: own } = await viewOf(page);
  assert.deepEqual([own, ...layers.slice(1)].map(({ points }) => points.at(-1).color), [[1, 0, 0], [0, 1, 0], [0, 0, 1]]);
  assert.equal(new Set([own, ...layers.slice(1)].map(({ points }) => JSON.stringify(points.map(({ value }) => value)))).size, 1, 'one window');
  assert.deepEqual(await page.locator('#channel-list .layer-name').allTextContents(), ['red', 'green', 'blue'], 'the opacity stays out');
  await shot(page, 'channels-colors');
  // Another view of the volume is left alone.
  await page.locator('#channel-list li', { hasText: 'blue' }).getByRole('button', { name: 'Remove' }).click();
  await until(page, 'one less', (s) => s.view.layers.length === 2);
  await page.click('#open-button');
  await page.locator('#open-list [data-name="cells.vtk"]').click();
  await until(page, 'cells', (s) => s.volume === 'cells' && s.isIdle);
  await rest(page);
  assert.equal((await viewOf(page)).layers.length, 1, 'other fields are not colours');
  assert.deepEqual(said, []);
});

test('one channel is added; a projection shows colours, and layers beside it sheets', async (context) => {
  const { page, said } = await visit(context, browser, daemon.url, LARGE);
  await until(page, 'the histogram', () => document.querySelectorAll('#transfer-curve .handle').length > 0);
  const { points } = (await viewOf(page)).transfer_function;
  await page.selectOption('#compositing', 'maximum');
  await page.selectOption('#channels-add', 'spots');
  await until(page, 'the channel', (s) => s.view.layers.length === 2);
  const view = await viewOf(page);
  assert.deepEqual(view.transfer_function.points, points, 'the volume keeps its transfer function');
  assert.deepEqual([view.compositing.mode, view.compositing.colors], ['maximum', 'transfer_function']);
  assert.deepEqual(view.layers[1].points.map(({ opacity, color }) => [opacity, color]), [[0, [0, 1, 0]], [0.95, [0, 1, 0]]]);
  await rest(page);
  compare((await countColors(page)).rGb ?? 0, '>', 1000);
  await page.selectOption('#compositing', 'sum');
  assert.equal((await viewOf(page)).compositing.colors, 'grey', 'a sum has no colours');
  await page.selectOption('#compositing', 'mean');
  assert.equal((await viewOf(page)).compositing.colors, 'transfer_function');
  assert.equal((await channelsIn(page))[0].visible, true);
  await page.selectOption('#compositing', 'sheet');
  await page.selectOption('#compositing', 'maximum');
  await page.click('#layer-add-surface');
  assert.equal((await viewOf(page)).compositing.mode, 'sheet');
  assert.deepEqual((await viewOf(page)).layers.map(({ type, visible }) => [type, visible]), [['volume', true], ['channel', true], ['surface', true]]);
  await rest(page);
  assert.deepEqual(said, []);
});

test('what cannot be mixed says so: cut-away parts, and a channel whose volume was closed', async (context) => {
  const { page } = await mixed(context);
  // The daemon refuses cut-away parts beside channels.
  await page.evaluate(() => { document.getElementById('edit').open = true; });
  await page.click('#edit-remove');
  await page.mouse.click(430, 450);
  await page.getByText(/a part is cut away by the values of one volume/).waitFor();
  await until(page, 'no edit', (s) => s.view.edits.length === 0 && s.isIdle);
  await shot(page, 'channels-part');
  // A guest gets no list of volumes, and still colours and windows.
  await page.evaluate(() => { document.getElementById('people-fold').open = true; });
  await page.click('#link-control');
  const guest = await visit(context, browser, await page.inputValue('#link-text'), LARGE);
  await until(guest.page, 'the rows', () => document.querySelectorAll('#channel-list li').length === 3);
  assert.ok(await guest.page.locator('#channels-all').isHidden(), 'a guest opens no files');
  await shot(guest.page, 'channels-guest');

  const [{ id }] = await channelsIn(page);
  const { origin, searchParams } = new URL(daemon.url);
  const answer = await fetch(`${origin}/api/v1/volumes/${id}`, { method: 'DELETE', headers: { Authorization: `Bearer ${searchParams.get('token')}` } });
  assert.ok(answer.ok);
  const prompt = page.locator('.prompt[data-id="closed"]');
  await prompt.getByRole('button', { name: 'Hide the layer' }).click();
  assert.deepEqual((await channelsIn(page)).map(({ visible }) => visible), [false, true]);
  await rest(page);
});

test('channels on a phone', NEEDS_AXE, async (context) => {
  const { page } = await mixed(context, PHONE);
  await rowOf(page, 'spots').locator('.layer-pick').tap();
  await page.locator('#channels').scrollIntoViewIfNeeded();
  await checkAxe(page, '#channels');
  await shot(page, 'channels-phone');
  await page.locator('.channel-details summary').tap();
  await page.locator('.channel-details .curve').scrollIntoViewIfNeeded();
  await shot(page, 'channels-phone-curve');
});
