// SPDX-License-Identifier: Apache-2.0
// The section "Edit" and the tools for parts and paths, with the real daemon: two balls, of which parts are removed, kept and measured.
import assert from 'node:assert/strict';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { test } from 'node:test';
import { rigFromCamera } from '../../../clients/web/core/camera.js';
import { project } from '../../../clients/web/core/project.js';
import { compare } from '../../support/compare.mjs';
import { boxOf, NEEDS_AXE, checkAxe, difference, drag, firstFrame, pixels, rest, share, shot, until, visit } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';

const DIMS = [48, 24, 24];
const RADIUS = 8;
const CENTERS = [[12, 11.5, 11.5], [35, 11.5, 11.5]];
const WIDE = { viewport: { width: 1200, height: 800 } };
const PHONE = { viewport: { width: 360, height: 700 }, deviceScaleFactor: 2, isMobile: true, hasTouch: true };
const folder = mkdtempSync(path.join(tmpdir(), 'splatd-edits-'));
const { browser, daemon } = await share(() => {
  const value = (x, y, z) => Math.max(...CENTERS.map((c) => Math.min(200, Math.max(0, 100 + 50 * (RADIUS - Math.hypot(x - c[0], y - c[1], z - c[2]))))));
  const voxels = Buffer.from(Array.from({ length: DIMS[0] * DIMS[1] * DIMS[2] }, (_, i) => value(i % DIMS[0], Math.floor(i / DIMS[0]) % DIMS[1], Math.floor(i / DIMS[0] / DIMS[1]))));
  writeFileSync(path.join(folder, 'balls.nrrd'), Buffer.concat([Buffer.from(`NRRD0004\ntype: uint8\ndimension: 3\nsizes: ${DIMS.join(' ')}\nspace dimension: 3\n`
    + 'space directions: (1,0,0) (0,1,0) (0,0,1)\nspace units: "mm" "mm" "mm"\nspace origin: (0,0,0)\nencoding: raw\n\n'), voxels]));
  return startDaemon(['--volume', path.join(folder, 'balls.nrrd'), '--backend', 'cpu', '--control-time', '600']);
}, () => rmSync(folder, { recursive: true }));

/** The page with both balls side by side, left and right in the picture, as an opaque surface. */
async function open(context, options = WIDE, url = daemon.url) {
  const opened = await visit(context, browser, url, options);
  const { page } = opened;
  await firstFrame(page);
  if (options.isMobile) await page.tap('#panel-toggle');
  await until(page, 'the histogram', () => !document.getElementById('transfer-kind').disabled);
  if (url === daemon.url) {
    await page.keyboard.press('1'); // from the front
    await page.click('#layer-add-surface');
    await page.fill('#surface-value', '100');
    await page.keyboard.press('Enter');
  }
  await page.evaluate(() => {
    for (const name of ['transfer', 'layers', 'picture']) document.getElementById(name).open = false;
    for (const name of ['edit', 'measure']) document.getElementById(name).open = true;
  });
  await rest(page);
  return opened;
}

/** The place of a world point in the window. */
async function spot(page, world) {
  const box = await boxOf(page.locator('#screen'));
  const { x, y } = project(rigFromCamera(await page.evaluate(() => window.splatd.camera)), world, box);
  return [box.x + x, box.y + y];
}

async function click(page, world) {
  await page.mouse.click(...await spot(page, world));
}

const edits = (page) => page.evaluate(() => window.splatd.view.edits ?? []);
const settled = (page, count) => until(page, `${count} edits`, `(s) => s.isIdle && (s.view.edits ?? []).length === ${count}`).then(() => rest(page));

/** The share of lit pixels of the picture in the window around each ball. */
async function lit(page) {
  const image = await pixels(page);
  const box = await boxOf(page.locator('#screen'));
  const shares = [];
  for (const center of CENTERS) {
    const [x, y] = await spot(page, center);
    const [sx, sy] = [image.width / box.width, image.height / box.height];
    const reach = 15; // px
    let count = 0;
    for (let dy = -reach; dy <= reach; dy += 1) {
      for (let dx = -reach; dx <= reach; dx += 1) {
        const [r, g, b] = image.at(Math.round((x - box.x) * sx + dx), Math.round((y - box.y) * sy + dy));
        count += r + g + b > 60;
      }
    }
    shares.push(count / (2 * reach + 1) ** 2);
  }
  return shares;
}

test('a part is removed or kept at a picked point, and undo brings it back', async (context) => {
  const { page, said } = await open(context);
  assert.deepEqual(await lit(page), [1, 1]);
  const before = await pixels(page);
  await page.click('#edit-remove');
  assert.equal(await page.getAttribute('#edit-remove', 'aria-pressed'), 'true');
  await click(page, CENTERS[0]);
  await settled(page, 1);
  const [edit] = await edits(page);
  assert.deepEqual([edit.type, edit.keep, edit.range], ['part', 'outside', [100, 200]]);
  assert.deepEqual(await lit(page), [0, 1]);
  await shot(page, 'edits');
  // The ends may be any numbers, in either order.
  const ends = page.locator('.edit-details .range input');
  for (const [at, text, range] of [[1, '1e31', [100, 1e31]], [0, '1e300', [1e31, 1e300]], [0, '-1e300', [-1e300, 1e300]], [1, '200', [-1e300, 200]], [0, '100', [100, 200]]]) {
    await ends.nth(at).fill(text);
    await page.keyboard.press('Enter');
    await until(page, `the range ${range}`, `(s) => s.isIdle && String(s.view.edits[0].range) === '${range}'`);
  }
  await rest(page);
  for (let i = 0; i < 6; i += 1) await page.click('#edit-undo');
  await settled(page, 0);
  compare(difference(await pixels(page), before), '<', 0.001);
  await page.click('#edit-redo');
  await settled(page, 1);
  assert.deepEqual((await edits(page))[0].range, [100, 200]);
  await page.selectOption('.edit-details select', 'inside');
  await until(page, 'the other way round', (s) => s.view.edits[0].keep === 'inside');
  await rest(page);
  assert.deepEqual(await lit(page), [1, 0]);
  await page.getByRole('button', { name: 'Take back edit 1' }).click();
  await settled(page, 0);
  assert.equal(await page.evaluate(() => document.activeElement.id), 'edit-remove');
  // The keyboard alone: Enter takes what is in the middle of the picture.
  await page.click('#edit-keep');
  await page.keyboard.press('Escape');
  assert.equal(await page.getAttribute('#edit-keep', 'aria-pressed'), 'false');
  assert.deepEqual(said, []);
});

test('a sphere, a box, a plane and the clip cut, and each drag is one step for undo', async (context) => {
  const { page, said } = await open(context);
  await page.click('#edit-sphere');
  await click(page, CENTERS[1]);
  await settled(page, 1);
  const [sphere] = await edits(page);
  assert.deepEqual([sphere.type, sphere.keep], ['sphere', 'outside']);
  compare(Math.abs(Math.hypot(...sphere.center.map((part, i) => part - CENTERS[1][i])) - RADIUS), '<', 0.5, 'its centre is on the ball');
  const slider = await boxOf(page.locator('#edit-radius'));
  await page.mouse.move(slider.x + slider.width * 0.5, slider.y + slider.height / 2);
  await page.mouse.down();
  for (let i = 0; i <= 8; i += 1) await page.mouse.move(slider.x + slider.width * (0.5 + 0.05 * i), slider.y + slider.height / 2);
  await page.mouse.up();
  await until(page, 'a larger sphere', (s) => s.view.edits[0].radius > 20);
  await rest(page);
  assert.equal((await lit(page))[1], 0);
  await page.click('#edit-undo');
  await until(page, 'the first radius', `(s) => s.view.edits[0]?.radius === ${sphere.radius}`);
  assert.ok(await page.locator('#edit .about', { hasText: 'remove matter' }).isHidden(), 'it explains the empty list');
  const places = page.locator('.edit-details .range input');
  assert.equal(await places.nth(1).inputValue(), String(Number(sphere.center[1].toFixed(2))), 'fields are rounded');
  await places.nth(0).fill('10');
  await page.keyboard.press('Enter');
  await until(page, 'another centre', (s) => s.view.edits[0].center[0] === 10);
  assert.deepEqual((await edits(page))[0].center.slice(1), sphere.center.slice(1), 'the others keep all digits');
  await page.click('#edit-reset');
  await settled(page, 0);

  await page.click('#edit-box');
  await settled(page, 1);
  await page.locator('#edit-box-rows input[type="number"]').nth(0).fill('-0.5');
  await page.keyboard.press('Enter');
  await until(page, 'a wider box', (s) => s.view.edits[0].box[0][0] === 0);
  await page.selectOption('.edit-details select', 'inside');
  await page.click('#edit-plane');
  await settled(page, 2);
  await page.press('#edit-depth', 'End');
  await until(page, 'all is cut', (s) => s.view.edits[1].offset > 20);
  await rest(page);
  assert.deepEqual(await lit(page), [0, 0]);
  const empty = page.locator('.prompt', { hasText: 'leave nothing visible' });
  await empty.waitFor();
  await shot(page, 'edits-empty');
  await empty.getByRole('button', { name: 'Undo' }).click();
  await until(page, 'less is cut', (s) => s.isIdle && s.view.edits[1].offset < 20);
  assert.ok(await empty.isHidden());
  await page.click('#edit-reset');
  await page.evaluate(() => { document.getElementById('clip').open = true; });
  assert.ok(await page.isDisabled('#edit-clip'));
  await page.locator('#clip-box input[type="range"]').nth(1).press('PageDown');
  await until(page, 'a clip', (s) => s.view.clip.box[1][0] < 1);
  await page.click('#edit-clip');
  await settled(page, 1);
  const [box] = await edits(page);
  assert.deepEqual([box.type, box.keep, box.box], ['box', 'inside', await page.evaluate(() => window.splatd.view.clip.box)]);
  assert.deepEqual(said, []);
});

test('handles in the picture move and resize the selected edit, each drag one step for undo', async (context) => {
  const { page, said } = await open(context);
  const handle = (name) => page.locator(`#edit-handles [aria-label="${name}"]`);
  const middle = async (name) => {
    const { x, y, width, height } = await boxOf(handle(name));
    return [x + width / 2, y + height / 2];
  };
  const near = (a, b, slack) => a.forEach((part, i) => compare(Math.abs(part - b[i]), '<', slack, `${a} and ${b}`));
  await page.click('#edit-sphere');
  await click(page, CENTERS[0]);
  await settled(page, 1);
  const [sphere] = await edits(page);
  near(await middle('Move: Sphere, edit 1'), await spot(page, sphere.center), 1);
  // Across the line of sight, which is y: the other ball at the same depth.
  const target = [CENTERS[1][0], sphere.center[1], CENTERS[1][2]];
  await drag(page, await middle('Move: Sphere, edit 1'), await spot(page, target));
  await rest(page);
  near((await edits(page))[0].center, target, 0.3);
  const [edge, center] = [await middle('Radius: Sphere, edit 1'), await middle('Move: Sphere, edit 1')];
  await drag(page, edge, [center[0] + 4 * (edge[0] - center[0]), edge[1]]);
  await rest(page);
  compare(Math.abs((await edits(page))[0].radius / sphere.radius - 4), '<', 0.1);
  assert.deepEqual(await lit(page), [1, 0]);
  await shot(page, 'edits-handles');
  await page.click('#edit-undo');
  await until(page, 'the first radius', `(s) => s.view.edits[0].radius === ${sphere.radius}`);
  await page.click('#edit-undo');
  await until(page, 'the first centre', `(s) => s.view.edits[0].center[0] === ${sphere.center[0]}`);
  // The keyboard, and a box as a whole and by its faces.
  await handle('Move: Sphere, edit 1').focus();
  await page.keyboard.press('PageDown');
  await until(page, 'nearer', `(s) => s.view.edits[0].center[1] < ${sphere.center[1] - 0.3}`);
  await page.keyboard.press('Escape');
  await page.locator('#edit-handles').waitFor({ state: 'hidden' });
  await page.click('#edit-reset');
  await page.click('#edit-box');
  await settled(page, 1);
  const [x, y] = await middle('Move: Box, edit 1');
  await drag(page, [x, y], [x - 500, y]);
  await rest(page);
  assert.deepEqual((await edits(page))[0].box.map(([at]) => at), [0.5, 1], 'it stops at the end of the volume');
  await handle('Face −x of the box').focus();
  await page.keyboard.press('Home');
  await until(page, 'a longer box', (s) => s.view.edits[0].box[0][0] === 0);
  await page.click('#edit-plane');
  await settled(page, 2);
  const before = (await edits(page))[1].offset;
  await handle('Shift Plane, edit 2').focus();
  await page.keyboard.press('ArrowUp');
  await until(page, 'a plane that moved', `(s) => s.view.edits[1].offset > ${before}`);
  await page.evaluate(() => { document.getElementById('edit').open = false; });
  await page.locator('#edit-handles').waitFor({ state: 'hidden' });
  assert.deepEqual(said, []);
});

test('a part and a path are measured, and the path is drawn along the surface', async (context) => {
  const { page, said } = await open(context);
  await page.click('#tool-part');
  await click(page, CENTERS[0]);
  const [part] = await until(page, 'a part', (s) => s.measures[0]?.samples > 0 && s.measures);
  compare(Math.abs(part.value / (4 / 3 * Math.PI * RADIUS ** 3) - 1), '<', 0.03);
  compare(Math.abs(part.area / (4 * Math.PI * RADIUS ** 2) - 1), '<', 0.03);
  assert.deepEqual([part.unit, part.range], ['mm^3', [100, 200]]);
  await page.locator('.measure-label', { hasText: 'Volume' }).waitFor();
  assert.match(await page.locator('#measures').textContent(), /Volume \d+ mm³/);
  await page.keyboard.press('n');
  await click(page, [CENTERS[0][0] - 5, CENTERS[0][1], CENTERS[0][2]]);
  await until(page, 'one end', (s) => s.measures.length === 1 && document.querySelector('.measure-draft-dot'));
  await click(page, [CENTERS[0][0] + 5, CENTERS[0][1], CENTERS[0][2]]);
  const line = await until(page, 'a path', (s) => s.measures[1]?.straight > 0 && s.measures[1]);
  compare(Math.abs(line.straight - 10), '<', 1);
  compare(Math.abs(line.value - 2 * RADIUS * Math.asin(line.straight / 2 / RADIUS)), '<', 0.2);
  const d = () => page.locator('.measure-line').last().getAttribute('d');
  await until(page, 'the drawn path', () => ([...document.querySelectorAll('.measure-line')].at(-1).getAttribute('d').match(/L/g) ?? []).length > 8);
  assert.match(await d(), /^M/);
  await shot(page, 'path');
  // Two balls are two parts.
  await page.click('#tool-path');
  await click(page, CENTERS[0]);
  await until(page, 'one end', () => document.querySelector('.measure-draft-dot'));
  await click(page, CENTERS[1]);
  await until(page, 'no path', (s) => s.measures[2]?.note);
  assert.match(await page.locator('#measures').textContent(), /The ends are not on one part/);
  assert.deepEqual(said, []);
});

test('a guest who watches sees the edits and cannot change them', async (context) => {
  const host = await open(context);
  await host.page.click('#edit-plane');
  await settled(host.page, 1);
  await host.page.locator('#people-fold').evaluate((fold) => { fold.open = true; });
  await host.page.click('#link-watch');
  const guest = await open(context, WIDE, await host.page.inputValue('#link-text'));
  await until(guest.page, 'the edit', (s) => s.view.edits?.length === 1);
  assert.equal(await guest.page.locator('#edit .fold-body[inert]').count(), 1);
  assert.ok(await guest.page.isDisabled('#tool-part'));
  assert.equal(await guest.page.locator('#edit-handles').isVisible(), false);
  for (const { said } of [host, guest]) assert.deepEqual(said, []);
});

test('the section fits a phone and has names for everything', NEEDS_AXE, async (context) => {
  const { page, said } = await open(context, PHONE);
  await page.locator('#edit-box').scrollIntoViewIfNeeded();
  await page.tap('#edit-box');
  await settled(page, 1);
  const panel = await boxOf(page.locator('#panel'));
  for (const element of await page.locator('#edit :is(button, select, input)').all()) {
    if (!await element.isVisible()) continue;
    const { x, width } = await boxOf(element);
    compare(x + width, '<=', panel.x + panel.width);
  }
  await checkAxe(page, '#edit');
  await shot(page, 'edits-phone');
  assert.deepEqual(said, []);
});
