// SPDX-License-Identifier: Apache-2.0
// Slices beside the picture and in it, with the real daemon.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { boxOf, checkAxe, difference, drag, firstFrame, NEEDS_AXE, pixels, pressPlates, resize, rest, share, shot, until, visit } from '../support/browser.mjs';
import { BIN, startDaemon } from '../support/daemon.mjs';
import { decodePng } from '../support/png.mjs';

const { browser, daemon } = await share(() => startDaemon(['--volume', 'demo:phantom?size=64', '--volume', 'demo:engine?size=64', '--backend', 'cpu', '--control-time', '600']));
const open = (context, address = daemon.url, options = {}) => visit(context, browser, address, { viewport: { width: 1040, height: 640 }, ...options });

const base = () => new URL(daemon.url).origin;
const token = () => new URL(daemon.url).searchParams.get('token');

/** The picture of a pane, without what lies above it. */
async function slice(page, id) {
  const url = await page.evaluate((name) => document.querySelector(`#pane-${name} canvas`).toDataURL('image/png'), id);
  return decodePng(Buffer.from(url.slice(url.indexOf(',') + 1), 'base64'));
}

const settled = (page) => until(page, 'the newest slices', (s) => s.isIdle && s.seq === s.sent && ['axial', 'coronal', 'sagittal']
  .every((id) => document.querySelector(`#pane-${id} .pane-body`).dataset.state === 'newest'));

async function four(page) {
  await page.click('#layout-four');
  await settled(page);
}

const position = (page) => page.evaluate(() => window.splatd.view.slices.position);
const middleOf = async (page, id) => {
  const box = await boxOf(page.locator(`#pane-${id} canvas`));
  return [box.x + box.width / 2, box.y + box.height / 2];
};
const light = (image) => {
  let sum = 0;
  for (let y = 0; y < image.height; y += 3) for (let x = 0; x < image.width; x += 3) sum += image.at(x, y)[0];
  return sum / (image.width * image.height / 9);
};

test('wheel, keys, slider and number go through the slices; the crosshair links the panes', async (context) => {
  const { page, said } = await open(context);
  await four(page);
  await rest(page);
  const frames = await page.evaluate(() => window.splatd.count);
  const first = { axial: await slice(page, 'axial'), coronal: await slice(page, 'coronal') };
  compare(light(first.axial), '>', 5, 'there is a picture');
  assert.equal(await page.inputValue('#slices-mode'), 'orthogonal', 'the panel says what the panes show');
  const start = await position(page);

  await page.mouse.move(...await middleOf(page, 'axial'));
  for (let i = 0; i < 12; i += 1) await page.mouse.wheel(0, 100);
  await until(page, 'other slices', (s) => Math.abs(s.view.slices.position[2] - 31.5) > 5);
  await settled(page);
  compare(difference(await slice(page, 'axial'), first.axial), '>', 0.01);
  assert.equal(difference(await slice(page, 'coronal'), first.coronal), 0, 'the other slices stay');
  assert.deepEqual((await position(page)).slice(0, 2), start.slice(0, 2));

  await page.focus('#pane-axial canvas');
  const before = await position(page);
  await page.keyboard.press('PageUp');
  await until(page, 'the next slice', () => true);
  await settled(page);
  compare(Math.abs((await position(page))[2] - before[2]), '>', 0.4);
  await page.fill('#pane-axial .slice-foot input', '20');
  await page.press('#pane-axial .slice-foot input', 'Enter');
  await settled(page);
  assert.equal((await page.evaluate(() => document.querySelector('#pane-axial .slice-slider').value)), '19');

  const [x, y] = await middleOf(page, 'axial');
  await page.mouse.click(x + 40, y - 30);
  await settled(page);
  const clicked = await position(page);
  assert.equal(clicked[2], (await position(page))[2]);
  compare(Math.abs(clicked[0] - start[0]), '>', 2);
  compare(Math.abs(clicked[1] - start[1]), '>', 2);
  compare(difference(await slice(page, 'coronal'), first.coronal), '>', 0.005);
  assert.equal(await page.evaluate(() => window.splatd.count), frames, 'the picture is not drawn again for slices beside it');
  assert.match(await page.textContent('#pane-axial .slice-read'), /^[-\d.]+ at /);

  const contrasts = await page.evaluate(() => { // with a white slice below the plates of the texts
    const luminance = (rgb) => rgb.reduce((sum, c, i) => sum + [0.2126, 0.7152, 0.0722][i] * (c <= 10.31 ? c / 255 / 12.92 : ((c / 255 + 0.055) / 1.055) ** 2.4), 0);
    const numbers = (color) => color.match(/[\d.]+/g).map(Number);
    return [...document.querySelectorAll('.pane:has(.slice) :is(.pane-title, .slice-read, .slice-letter, .slice-foot span, .slice-foot input)')].filter((element) => element.checkVisibility()
      && (element.value ?? element.textContent)).map((element) => {
      const plate = element.closest('.slice-foot') ?? element;
      const [, , , alpha = 1] = numbers(getComputedStyle(plate).backgroundColor);
      const [text, ground] = [luminance(numbers(getComputedStyle(element).color)), luminance(Array(3).fill(255 * (1 - alpha)))];
      return { name: element.className || element.tagName, contrast: (Math.max(text, ground) + 0.05) / (Math.min(text, ground) + 0.05) };
    });
  });
  compare(contrasts.length, '>', 8);
  assert.deepEqual(contrasts.filter(({ contrast }) => contrast < 4.5), []);
  await shot(page, 'slices-four');
  assert.deepEqual(said, []);
  assert.deepEqual(await page.evaluate(() => window.splatd.errors), []);
});

test('window, zoom and pan change the panes as they should', async (context) => {
  const { page } = await open(context);
  await four(page);
  const first = await slice(page, 'axial');
  await page.evaluate(() => { document.getElementById('slices').open = true; });
  const center = Number(await page.inputValue('#slices-center'));
  await page.fill('#slices-center', String(center * 0.3));
  await page.press('#slices-center', 'Enter');
  await settled(page);
  const brighter = await slice(page, 'axial');
  compare(light(brighter), '>', light(first) + 10, 'a lower centre is brighter');
  await page.click('#slices-reset');
  await settled(page);
  compare(difference(await slice(page, 'axial'), first), '<', 0.002);

  const middle = await middleOf(page, 'axial');
  await page.click('#tool-window');
  await drag(page, middle, [middle[0], middle[1] + 60]);
  await page.keyboard.press('Escape');
  await settled(page);
  compare(light(await slice(page, 'axial')), '>', light(first) + 2, 'dragging down lowers the level');
  await page.click('#slices-reset');
  await settled(page);

  await page.focus('#pane-axial canvas');
  for (let i = 0; i < 6; i += 1) await page.keyboard.press('+');
  await settled(page);
  const larger = await slice(page, 'axial');
  compare(difference(larger, first), '>', 0.05);
  await drag(page, middle, [middle[0] + 80, middle[1]], { button: 'right' });
  await settled(page);
  compare(difference(await slice(page, 'axial'), larger), '>', 0.02);
  await page.focus('#pane-axial canvas');
  await page.keyboard.press('0');
  await settled(page);
  compare(difference(await slice(page, 'axial'), first), '<', 0.002);
});

for (const colorScheme of ['dark', 'light']) {
  test(`axe finds nothing in the panes, ${colorScheme}`, NEEDS_AXE, async (context) => {
    const { page } = await open(context, daemon.url, { colorScheme });
    await four(page);
    await page.evaluate(() => {
      document.getElementById('transfer').open = false;
      document.getElementById('slices').open = true;
    });
    await checkAxe(page, 'main', '#slices', '#toolbar');
  });
}

test('an oblique plane turns by its handles and with the view', async (context) => {
  const { page } = await open(context);
  await four(page);
  const sagittal = await slice(page, 'sagittal');
  await page.evaluate(() => { document.getElementById('slices').open = true; });
  await page.selectOption('#slices-mode', 'oblique');
  await settled(page);
  const grip = page.locator('#pane-axial .slice-handle').first();
  const handle = await boxOf(grip);
  const from = [handle.x + handle.width / 2, handle.y + handle.height / 2];
  await drag(page, from, [from[0] + 60, from[1] + 30]);
  await settled(page);
  const turned = await page.evaluate(() => window.splatd.view.slices.normal);
  assert.ok(turned.filter((part) => Math.abs(part) > 0.1).length >= 2, `the plane is tilted: ${turned}`);
  compare(difference(await slice(page, 'sagittal'), sagittal), '>', 0.01);

  // Slider, number, wheel and keys move it along its normal; the axial slice does not change.
  const along = async () => (await position(page)).reduce((sum, part, i) => sum + part * turned[i], 0) / Math.hypot(...turned);
  const slider = page.locator('#pane-sagittal .slice-slider');
  const [offset, middle, shown, place] = [await along(), await slider.inputValue(), await slice(page, 'sagittal'), await position(page)];
  await slider.focus();
  for (let i = 0; i < 8; i += 1) await page.keyboard.press('ArrowUp');
  await settled(page);
  assert.equal(Number(await slider.inputValue()), Number(middle) + 8);
  compare(Math.abs(await along() - offset - 8), '<', 0.51, 'eight steps of the spacing, from the place nearest to the plane');
  compare(difference(await slice(page, 'sagittal'), shown), '>', 0.01);
  assert.match(await slider.getAttribute('aria-valuetext'), /^offset [-−\d.]+$/);
  await page.keyboard.press('Home');
  await settled(page);
  const low = await along();
  await page.keyboard.press('End');
  await settled(page);
  compare(await along() - low, '>', 64, 'the slider reaches from corner to corner');
  await page.fill('#pane-sagittal .slice-foot input', String(offset));
  await page.press('#pane-sagittal .slice-foot input', 'Enter');
  await settled(page);
  compare(Math.abs(await along() - offset), '<', 1e-4);
  (await position(page)).forEach((part, i) => compare(Math.abs(part - place[i]), '<', 1e-4, 'the crosshair is back where it was'));
  await page.focus('#pane-sagittal canvas');
  await page.keyboard.press('PageUp');
  await settled(page);
  compare(Math.abs(await along() - offset - 1), '<', 1e-4);
  await page.mouse.move(...await middleOf(page, 'sagittal'));
  await page.mouse.wheel(0, 100);
  await settled(page);
  compare(Math.abs(await along() - offset), '<', 1e-4, 'the wheel goes the other way');
  await page.click('#slices-align');
  await settled(page);
  const [normal, camera] = await page.evaluate(() => [window.splatd.view.slices.normal, window.splatd.camera]);
  const away = camera.position.map((part, i) => part - camera.target[i]);
  const cosine = away.reduce((sum, part, i) => sum + part * normal[i], 0) / Math.hypot(...away) / Math.hypot(...normal);
  compare(cosine, '>', 0.999999);
  await shot(page, 'slices-oblique');
});

test('the buttons of the planes stand in the order of the fields of the position, anatomical where the file tells it', async (context) => {
  const { page, said } = await open(context);
  await page.evaluate(() => { document.getElementById('slices').open = true; });
  const names = () => page.evaluate(() => [...document.querySelectorAll('#slices-planes button')].map((button) => button.textContent));
  const fields = () => page.evaluate(() => [...document.querySelectorAll('#slices [data-pointer="/slices/position"] input')].map((input) => input.title));
  await until(page, 'the names of the planes', () => document.querySelector('#slices-planes button')?.textContent);
  assert.deepEqual(await names(), ['Across x', 'Across y', 'Across z']);
  assert.deepEqual(await fields(), ['Position x', 'Position y', 'Position z']);
  // A volume that is stored as sagittal slices.
  const folder = mkdtempSync(path.join(tmpdir(), 'splatd-slices-'));
  const side = 8;
  const voxels = Buffer.from(Array.from({ length: side ** 3 }, (_, i) => i % 251));
  writeFileSync(path.join(folder, 'head.nrrd'), Buffer.concat([Buffer.from(`NRRD0004\ntype: uint8\ndimension: 3\nsizes: ${side} ${side} ${side}\n`
    + 'space: left-posterior-superior\nspace directions: (0,1,0) (0,0,1) (1,0,0)\nspace origin: (0,0,0)\nencoding: raw\n\n'), voxels]));
  const other = await startDaemon(['--volume', path.join(folder, 'head.nrrd'), '--backend', 'cpu']);
  context.after(async () => {
    await other.stop();
    rmSync(folder, { recursive: true });
  });
  await page.goto(other.url);
  await firstFrame(page);
  await page.evaluate(() => { document.getElementById('slices').open = true; });
  await until(page, 'the names of the planes', () => document.querySelector('#slices-planes button')?.textContent);
  assert.deepEqual(await names(), ['Sagittal', 'Coronal', 'Axial']);
  await page.evaluate(() => { document.getElementById('transfer').open = false; });
  assert.deepEqual(await fields(), ['Position x, towards L', 'Position y, towards P', 'Position z, towards S']);
  await shot(page, 'slices-planes');
  // Every letter can be read in panes of every size, in an oblique one too.
  await four(page);
  await page.selectOption('#slices-mode', 'oblique');
  await page.click('#slices-align');
  for (const [width, height] of [[1200, 800], [900, 560], [390, 844], [320, 568], [740, 360]]) {
    await resize(page, { width, height });
    await settled(page);
    const covered = await page.evaluate(() => {
      const shown = (selector) => [...document.querySelectorAll(selector)].filter((element) => element.checkVisibility() && element.getBoundingClientRect().width > 0);
      const letters = shown('.slice-letter').map((element) => ({ text: element.textContent, box: element.getBoundingClientRect() }));
      const others = shown('.pane:has(.slice) .pane-title, .slice-read, .slice-foot, .slice-slider').map((element) => ({ name: element.className, box: element.getBoundingClientRect() }));
      const isAbove = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
      return { letters: letters.map(({ text }) => text), covered: letters.flatMap(({ text, box }) => others.filter((other) => isAbove(box, other.box)).map(({ name }) => `${text}: ${name}`)) };
    });
    assert.equal(covered.letters.length, 12, `${width}×${height}: ${covered.letters}`);
    assert.ok(covered.letters.includes('LP'), `${covered.letters}`);
    await shot(page, 'slices-letters');
    assert.deepEqual(covered.covered, [], `${width}×${height}`);
  }
  const { count, kept } = await pressPlates(page);
  compare(count, '>', 5);
  assert.deepEqual(kept, [], 'what lies above the panes passes drags and wheels on');
  assert.deepEqual(said, []);
});

test('places tell one slice from the next, also far from the origin and in µm', async (context) => {
  const folder = mkdtempSync(path.join(tmpdir(), 'splatd-slices-'));
  const side = 8;
  const values = new Float32Array(Array.from({ length: side ** 3 }, (_, i) => 1000.5 + i));
  writeFileSync(path.join(folder, 'cells.nrrd'), Buffer.concat([Buffer.from(`NRRD0005\ntype: float\ndimension: 3\nsizes: ${side} ${side} ${side}\n`
    + 'space dimension: 3\nspace directions: (0.2,0,0) (0,0.2,0) (0,0,0.5)\nspace origin: (0,-20,50000)\nspace units: "um" "um" "um"\n'
    + 'sample units: mV\nendian: little\nencoding: raw\n\n'), Buffer.from(values.buffer)]));
  const other = await startDaemon(['--volume', path.join(folder, 'cells.nrrd'), '--backend', 'cpu']);
  context.after(async () => {
    await other.stop();
    rmSync(folder, { recursive: true });
  });
  const { page, said } = await open(context, other.url);
  await four(page);
  await page.evaluate(() => { document.getElementById('slices').open = true; });
  const read = () => page.locator('#pane-axial .slice-read').textContent();
  for (const [axis, place] of [['x', '0.6'], ['y', '-19.4']]) {
    await page.fill(`#slices [aria-label="Position ${axis}"]`, place);
    await page.keyboard.press('Enter');
  }
  for (const index of [2, 3, 4]) {
    await page.fill('#pane-axial input[type=number]', String(index));
    await page.keyboard.press('Enter');
    await until(page, 'the slice', `(s) => Math.abs(s.view.slices.position[2] - ${50000 + 0.5 * (index - 1)}) < 0.01`);
    await settled(page);
    const value = 1000.5 + (index - 1) * side * side + 3 * side + 3;
    assert.equal(await read(), `${value} mV at 0.6, −19.4, ${50000 + 0.5 * (index - 1)} µm`);
    assert.equal(await page.inputValue('#slices [aria-label="Position z"]'), String(50000 + 0.5 * (index - 1)));
  }
  assert.equal(await page.textContent('#transfer-axis'), 'value in mV');
  assert.deepEqual(said, []);
});

test('slices in the picture change it, and two windows of one session share the crosshair', async (context) => {
  const small = { viewport: { width: 800, height: 560 } };
  const { page } = await open(context, daemon.url, small);
  await rest(page);
  const plain = await pixels(page);
  await page.evaluate(() => { document.getElementById('slices').open = true; });
  await page.click('#slices-in-3d');
  await rest(page);
  const cut = await pixels(page);
  compare(difference(cut, plain), '>', 0.02);
  const outlines = () => page.locator('#overlay .slice-outline').count();
  assert.equal(await outlines(), 12);
  await page.click('#slices-planes button[data-kind="axial"]');
  await rest(page);
  assert.deepEqual(Object.values(await page.evaluate(() => window.splatd.view.slices.planes)).filter((isOn) => !isOn), [false]);
  compare(difference(await pixels(page), cut), '>', 0.005, 'without the axial plane');
  assert.equal(await outlines(), 8);
  await page.click('#slices-planes button[data-kind="axial"]');
  await rest(page);
  compare(difference(await pixels(page), cut), '<', 0.002, 'the plane is back');
  await page.click('#tool-crosshair');
  const picture = await boxOf(page.locator('#screen'));
  const at = await position(page);
  await page.mouse.click(picture.x + picture.width * 0.53, picture.y + picture.height * 0.46);
  await until(page, 'the crosshair where the picture was clicked', `(s) => JSON.stringify(s.view.slices.position) !== '${JSON.stringify(at)}'`);
  const seen = await position(page);
  await drag(page, [picture.x + picture.width * 0.5, picture.y + picture.height * 0.5], [picture.x + picture.width * 0.5, picture.y - 3]);
  await until(page, 'the crosshair where the drag led', `(s) => JSON.stringify(s.view.slices.position) !== '${JSON.stringify(seen)}'`);
  await rest(page);
  assert.equal(await page.locator('#notice').isVisible(), false, 'a drag may leave the picture');
  await page.keyboard.press('Escape');
  const session = await page.evaluate(() => window.splatd.session);
  const { tokens } = await (await fetch(`${base()}/api/v1/sessions/${session}`, { headers: { Authorization: `Bearer ${token()}` } })).json();
  const guest = await open(context, `${base()}/#session=${session}&token=${tokens.view}`, small);
  await four(guest.page);
  await page.click('#layout-four');
  await settled(page);
  const [x, y] = await middleOf(page, 'coronal');
  await page.mouse.click(x - 30, y + 20);
  await settled(page);
  const wanted = await position(page);
  await until(guest.page, 'the same crosshair', `(s) => JSON.stringify(s.view.slices.position) === '${JSON.stringify(wanted)}'`);
  await settled(guest.page);
  compare(difference(await slice(guest.page, 'coronal'), await slice(page, 'coronal')), '<', 0.02);
  await guest.page.mouse.click(x + 50, y);
  assert.deepEqual(await position(guest.page), wanted, 'a guest without control cannot move it');
  await page.evaluate(() => document.getElementById('slices-in-3d').click());
  await page.click('#layout-3d');
  await rest(page);
  compare(difference(await pixels(page), plain), '<', 0.002);
});

test('slices of a volume that is larger than memory go through all its samples', async (context) => {
  const folder = mkdtempSync(path.join(tmpdir(), 'splatd-slices-'));
  context.after(() => rmSync(folder, { recursive: true }));
  const file = path.join(folder, 'v.bricks');
  execFileSync(path.join(BIN, 'splatctl'), ['convert', 'demo:noise?size=264', file]);
  const own = await startDaemon(['--data', folder, '--volume', file, '--memory', '64M', '--backend', 'cpu']);
  context.after(() => own.stop());
  const { page } = await open(context, own.url);
  await four(page);
  const { dims } = await (await fetch(`${new URL(own.url).origin}/api/v1/volumes/v`, { headers: { Authorization: `Bearer ${new URL(own.url).searchParams.get('token')}` } })).json();
  compare(dims[0], '<', 264, 'samples in memory');
  assert.match(await page.textContent('#pane-axial'), /of 264/);
  compare(light(await slice(page, 'axial')), '>', 1, 'there is a picture');
  await page.mouse.move(...await middleOf(page, 'axial'));
  await page.mouse.wheel(0, 100);
  await settled(page);
  const before = await position(page);
  const asked = page.waitForRequest((request) => request.url().includes('/slice?') && request.url().includes('spacing='));
  await page.mouse.wheel(0, 100);
  await asked;
  await settled(page);
  const moved = (await position(page)).map((part, i) => Math.abs(part - before[i]));
  assert.deepEqual(moved.map((part) => Number(part.toFixed(6))), [0, 0, 1], 'one sample of the finest level');
});
