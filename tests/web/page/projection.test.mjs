// SPDX-License-Identifier: Apache-2.0
// Projections with the real daemon: what each mode, its window and the options of a sum do to the picture, and undo.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { difference, drag, pixels, rest, share, shot, until, visit } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';

const { browser, daemon } = await share(() => startDaemon(['--volume', 'demo:engine?size=32', '--backend', 'cpu', '--control-time', '600']));

/** The mean of the brightest channel, and the largest difference between red and blue, of one pixel in 16; [0, 255]. */
function measure(image) {
  let [sum, count, color] = [0, 0, 0];
  for (let y = 0; y < image.height; y += 4) {
    for (let x = 0; x < image.width; x += 4) {
      const [r, g, b] = image.at(x, y);
      sum += Math.max(r, g, b);
      count += 1;
      color = Math.max(color, Math.abs(r - b));
    }
  }
  return { light: sum / count, color };
}

async function drawn(page) {
  await rest(page);
  return pixels(page);
}

const light = async (page) => measure(await drawn(page)).light;
const windowOf = (page) => page.evaluate(() => {
  const { mode, window: { center, width } } = window.splatd.compositing;
  return { mode, center: center ?? null, width: width ?? null };
});

async function press(page, key, times) {
  await page.focus('#screen');
  for (let i = 0; i < times; i += 1) await page.keyboard.press(key);
}

async function open(context) {
  const opened = await visit(context, browser, daemon.url, { viewport: { width: 700, height: 600 } });
  await until(opened.page, 'the histogram', () => !document.getElementById('transfer-kind').disabled);
  await opened.page.evaluate(() => { for (const id of ['picture-section', 'expert']) document.getElementById(id).closest('details').open = true; });
  return opened;
}

test('each mode changes the picture as it should', async (context) => {
  const { page, said } = await open(context);
  const sheets = await drawn(page);
  assert.ok(await page.isEnabled('#shading'));
  await page.selectOption('#compositing', 'maximum');
  const maximum = measure(await drawn(page));
  assert.equal(maximum.color, 0, 'it is grey');
  assert.ok(await page.locator('#transfer-idle', { hasText: 'projection in grey' }).isVisible());
  assert.ok(await page.isHidden('#minimum-hint'));
  assert.deepEqual(await page.evaluate(() => ['shading', 'flat', 'filter', 'projection-zero'].map((id) => document.getElementById(id).disabled)), [true, true, true, true]);
  await page.selectOption('#compositing', 'minimum');
  const minimum = measure(await drawn(page));
  assert.ok(await page.isVisible('#minimum-hint'));
  await page.selectOption('#compositing', 'mean');
  const mean = measure(await drawn(page));
  compare(maximum.light, '>', mean.light + 10);
  compare(mean.light, '>', minimum.light + 5);
  await page.selectOption('#projection-colors', 'transfer_function');
  compare(measure(await drawn(page)).color, '>', 20);
  assert.deepEqual(await page.evaluate(() => ['transfer-idle', 'projection-window'].map((id) => document.getElementById(id).hidden)), [true, true]);
  await page.selectOption('#compositing', 'sum');
  const sum = measure(await drawn(page));
  assert.equal(sum.color, 0, 'a sum is grey');
  compare(sum.light, '>', minimum.light + 5);
  await shot(page, 'projection');
  await page.selectOption('#compositing', 'sheet');
  compare(difference(await drawn(page), sheets), '<', 0.001);
  assert.deepEqual(said, []);
});

test('window and level begin with the automatic window, and undo returns to it', async (context) => {
  const { page, said } = await open(context);
  for (const mode of ['mean', 'sum']) {
    await page.selectOption('#compositing', mode);
    const automatic = await drawn(page);
    const before = measure(automatic).light;
    await page.focus('#screen');
    await page.keyboard.press('w');
    await press(page, 'ArrowUp', 1);
    await press(page, 'ArrowDown', 1);
    const { center, width } = await windowOf(page);
    compare(width, '>', 0);
    compare(difference(await drawn(page), automatic), '<', 0.003, `${mode}: there and back is the automatic window`);
    await drag(page, [500, 420], [500, 320]);
    compare(await light(page), '<', before - 1, `${mode}: a higher level is darker`);
    compare((await windowOf(page)).center, '>', center);
    await drag(page, [450, 350], [550, 350]);
    compare((await windowOf(page)).width, '>', width);
    await page.keyboard.press('Escape');
    for (let i = 0; i < 4; i += 1) {
      await page.click('#transfer-undo');
      await drawn(page);
    }
    const [level, wide] = ['center', 'width'].map((_, i) => page.locator('#projection-window input').nth(i));
    const shown = [await level.inputValue(), await wide.inputValue()].map(Number);
    compare(Math.abs(shown[0] / center - 1), '<', 0.01, 'the fields show the automatic window');
    await level.fill(String(shown[0] + shown[1] / 4));
    await level.press('Enter');
    compare(await light(page), '<', before - 1, `${mode}: a typed level`);
    assert.deepEqual(await windowOf(page), { mode, center: shown[0] + shown[1] / 4, width: null });
    await page.click('#transfer-undo');
    assert.deepEqual(await windowOf(page), { mode, center: null, width: null });
    compare(difference(await drawn(page), automatic), '<', 0.001, `${mode}: undo`);
  }
  await page.click('#transfer-undo');
  assert.equal(await page.inputValue('#compositing'), 'mean', 'undo returns to the mode before');
  assert.deepEqual(said, []);
});

test('a projection hides the other layers, and a layer returns to sheets, each in one step', async (context) => {
  const { page, said } = await open(context);
  const state = () => page.evaluate(() => [window.splatd.compositing.mode, ...window.splatd.view.layers.map(({ visible }) => visible)]);
  await page.click('#layer-add-surface');
  await page.selectOption('#compositing', 'maximum');
  await page.locator('#notice', { hasText: 'other layers are hidden' }).waitFor();
  assert.equal(measure(await drawn(page)).color, 0, 'it is grey');
  assert.deepEqual(await state(), ['maximum', true, false]);
  await shot(page, 'projection-alone');
  await page.click('#transfer-undo');
  assert.deepEqual(await state(), ['sheet', false, true]);
  await page.click('#transfer-redo');
  assert.deepEqual(await state(), ['maximum', true, false]);
  await page.click('#layer-add-surface');
  await page.locator('#notice', { hasText: 'shows sheets again' }).waitFor();
  await rest(page);
  assert.deepEqual(await state(), ['sheet', false, false, true]);
  await page.click('#transfer-undo');
  await rest(page);
  assert.deepEqual(await state(), ['maximum', true, false]);
  assert.equal(await page.locator('.complaint').count(), 0);
  assert.deepEqual(said, []);
});

test('a sum has a zero and an absorption, and complains about a wrong one', async (context) => {
  const { page, said } = await open(context);
  await page.selectOption('#compositing', 'sum');
  const enter = async (id, text) => {
    await page.fill(id, text);
    await page.press(id, 'Enter');
  };
  await enter('#absorption', '0.0001');
  const weak = await light(page);
  await enter('#absorption', '0.001');
  const strong = await light(page);
  compare(strong, '>', weak + 5, 'more is absorbed');
  await enter('#projection-zero', '100');
  compare(await light(page), '<', strong - 5, 'less counts');
  await enter('#absorption', '-1');
  await page.locator('#complaint').waitFor();
  await enter('#absorption', '');
  await enter('#projection-zero', '');
  await until(page, 'no complaint', () => !document.getElementById('complaint'));
  assert.deepEqual(said, []);
});
