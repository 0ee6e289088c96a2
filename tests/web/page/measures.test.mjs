// SPDX-License-Identifier: Apache-2.0
// Measuring in the page: each tool gives the right value on volumes whose truth is known; two windows; the keyboard alone; export.
import assert from 'node:assert/strict';
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { before, test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { boxOf, checkAxe, drag, NEEDS_AXE, resize, rest, settle, share, shot, until, visit } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';

const SIDE = 20;
const SPACING = [2, 1, 1]; // mm
const folder = mkdtempSync(path.join(tmpdir(), 'splatd-measures-'));
const { browser, daemon } = await share(() => {
  // The value is the column's index plus ten times the slice's index: 0 to 209.
  const voxels = Buffer.from(Array.from({ length: SIDE ** 3 }, (_, i) => (i % SIDE) + 10 * Math.floor(i / SIDE / SIDE)));
  writeFileSync(path.join(folder, 'ramp.nrrd'), Buffer.concat([Buffer.from(`NRRD0004\ntype: uint8\ndimension: 3\nsizes: ${SIDE} ${SIDE} ${SIDE}\nspace dimension: 3\n`
    + 'space directions: (2,0,0) (0,1,0) (0,0,1)\nspace units: "mm" "mm" "mm"\nsample units: HU\nspace origin: (0,0,0)\nencoding: raw\n\n'), voxels]));
  return startDaemon(['--volume', path.join(folder, 'ramp.nrrd'), '--volume', 'demo:phantom?size=8', '--backend', 'cpu']);
}, () => rmSync(folder, { recursive: true }));

async function open(context, { url = daemon.url, layout = 'four', viewport = { width: 1300, height: 860 }, colorScheme = 'dark' } = {}) {
  const opened = await visit(context, browser, url, { viewport, colorScheme, acceptDownloads: true });
  const { page } = opened;
  if (layout !== '3d') {
    await page.click(`#layout-${layout}`);
    await page.locator('.pane-body[data-state="newest"]').nth(2).waitFor();
  }
  return { ...opened, measured: (count, ready = '() => true') => measured(page, count, ready) };
}

/** The measurements once there are `count`, all with the daemon's answer: only it knows what lies outside of the volume. */
async function measured(page, count, ready) {
  return until(page, `${count} measurements`, `(s) => s.measures.length === ${count} && s.measures.every((m) => m.outside !== undefined) && (${ready})(s.measures) && s.measures`);
}

/** Page coordinates of a place in a pane: u and v from 0 to 1. */
async function spot(page, pane, u, v) {
  const box = await boxOf(page.locator(`#pane-${pane} canvas.slice`));
  return [box.x + box.width * u, box.y + box.height * v];
}

const length = (a, b) => Math.hypot(...a.map((part, i) => part - b[i]));
const near = (value, expected, slack = 1e-6) => assert.ok(Math.abs(value - expected) <= slack * Math.max(1, Math.abs(expected)), `${value} is not ${expected}`);

/** The mean of the value in the columns that a rectangle in a slice across z covers. */
function meanOf({ points, statistics }) {
  const xs = points.map(([x]) => x);
  const columns = Array.from({ length: SIDE }, (_, i) => i).filter((i) => i * SPACING[0] >= Math.min(...xs) && i * SPACING[0] <= Math.max(...xs));
  assert.equal(statistics.count % columns.length, 0);
  return columns.reduce((a, b) => a + b) / columns.length;
}

test('tools in slices: each gives the value that is true', async (context) => {
  const { page, said, measured: all } = await open(context);
  await page.keyboard.press('d');
  await drag(page, await spot(page, 'axial', 0.35, 0.4), await spot(page, 'axial', 0.6, 0.6));
  await all(1);
  await page.keyboard.press('a');
  for (const [u, v] of [[0.4, 0.6], [0.5, 0.4], [0.65, 0.6]]) await page.mouse.click(...await spot(page, 'axial', u, v));
  await all(2);
  await page.keyboard.press('r');
  await drag(page, await spot(page, 'axial', 0.4, 0.35), await spot(page, 'axial', 0.55, 0.55));
  await all(3, '(m) => m[2].statistics');
  await page.keyboard.press('e');
  await drag(page, await spot(page, 'coronal', 0.4, 0.4), await spot(page, 'coronal', 0.6, 0.6));
  await all(4, '(m) => m[3].statistics');
  await page.keyboard.press('i');
  await page.mouse.click(...await spot(page, 'axial', 0.4, 0.5));
  await page.mouse.click(...await spot(page, 'axial', 0.6, 0.5));
  const items = await all(5, '(m) => m[4].statistics');
  const [distance, angle, rectangle, ellipse, profile] = items;
  near(distance.value, length(...distance.points));
  assert.equal(distance.unit, 'mm');
  const arms = [0, 2].map((i) => angle.points[i].map((part, axis) => part - angle.points[1][axis]));
  near(angle.value, Math.acos(arms[0].reduce((sum, part, i) => sum + part * arms[1][i], 0) / (Math.hypot(...arms[0]) * Math.hypot(...arms[1]))) * 180 / Math.PI);
  near(rectangle.value, length(rectangle.points[0], rectangle.points[1]) * length(rectangle.points[0], rectangle.points[2]));
  assert.equal(rectangle.unit, 'mm^2');
  near(rectangle.statistics.mean, meanOf(rectangle) + 10 * rectangle.points[0][2]);
  near(ellipse.value, Math.PI * length(ellipse.points[0], ellipse.points[1]) * length(ellipse.points[0], ellipse.points[2]));
  near(profile.value, length(...profile.points));
  near(profile.statistics.mean, (profile.points[0][0] + profile.points[1][0]) / 2 / SPACING[0] + 10 * profile.points[0][2], 1e-3);
  // The list, the plot, and the lines in the right panes.
  await page.evaluate(() => { document.getElementById('measure').open = true; });
  assert.equal(await page.locator('#measures li').count(), 5);
  await page.locator('#measure-plot svg .measure-curve').waitFor({ state: 'attached' });
  assert.match(await page.textContent('#measure-plot'), /Value \(HU\)/);
  assert.match(await page.textContent('#measures li:nth-child(3) .measure-value'), /^Area [\d.]+ mm²$/);
  const words = await page.locator('#pane-axial .measure-label').allTextContents();
  for (const word of [/^Length [\d.]+ mm$/, /^Angle [\d.]+°$/, /^Area [\d.]+ mm²$/, /^Mean ± SD [\d.]+ ± [\d.]+ HU$/]) assert.ok(words.some((text) => word.test(text)), `${word} is not in ${words}`);
  assert.equal(await page.locator(`#pane-axial [data-item="${rectangle.id}"].measure-hit`).count(), 1);
  assert.equal(await page.locator(`#overlay [data-item="${distance.id}"].measure-hit`).count(), 1);
  await shot(page, 'measures');
  // Another slice hides what lies in this one.
  await page.focus('#pane-axial canvas.slice');
  await page.keyboard.press('PageUp');
  await page.keyboard.press('PageUp');
  await page.locator(`#pane-axial [data-item="${rectangle.id}"]`).first().waitFor({ state: 'detached' });
  await page.click(`#measures li:nth-child(3) [data-act="go"]`);
  await page.locator(`#pane-axial [data-item="${rectangle.id}"].measure-hit`).waitFor({ state: 'attached' });
  assert.deepEqual(said, []);
});

test('handles are dragged, undo returns, hide and delete work', async (context) => {
  const { page, said, measured: all } = await open(context);
  await page.keyboard.press('d');
  await drag(page, await spot(page, 'axial', 0.35, 0.5), await spot(page, 'axial', 0.5, 0.5));
  const [before_] = await all(1);
  await drag(page, await spot(page, 'axial', 0.5, 0.5), await spot(page, 'axial', 0.65, 0.5));
  const [moved] = await all(1, `(m) => Math.abs(m[0].value - ${2 * before_.value}) < ${0.04 * before_.value}`);
  await page.keyboard.press('Control+z');
  near((await all(1, `(m) => m[0].value < ${moved.value} * 0.7`))[0].value, before_.value);
  await page.keyboard.press('Control+Shift+z');
  const [again] = await all(1, `(m) => m[0].value > ${before_.value} * 1.5`);
  await page.selectOption('#compositing', 'maximum'); // Ctrl+Z takes back the newest change, although the measurement is still selected
  await until(page, 'a projection', () => !document.getElementById('projection-window').hidden);
  await page.locator('#pane-axial canvas.slice').focus();
  await page.keyboard.press('Control+z');
  await until(page, 'no projection', () => document.getElementById('projection-window').hidden);
  assert.equal((await all(1))[0].value, again.value);
  await page.evaluate(() => { document.getElementById('measure').open = true; });
  await page.click('#measures [data-act="hide"]');
  await page.locator('#pane-axial .measure-line').waitFor({ state: 'detached' });
  await page.click('#measures [data-act="remove"]');
  await all(0);
  await page.click('#measure-undo');
  assert.equal((await all(1))[0].hidden, true);
  assert.deepEqual(said, []);
});

test('what another window measures appears at once; a watcher cannot edit; files are exported', async (context) => {
  const first = await open(context);
  await first.page.keyboard.press('m');
  await first.page.mouse.click(...await spot(first.page, 'axial', 0.5, 0.5));
  await until(first.page, 'the name field', () => document.activeElement.id === 'measure-text');
  await first.page.keyboard.type('=Ünï "1"');
  await first.page.keyboard.press('Enter');
  const [marker] = await first.measured(1, '(m) => m[0].text && m[0].value !== null');
  near(marker.value, marker.points[0][0] / SPACING[0] + 10 * marker.points[0][2]);
  await first.page.evaluate(() => {
    document.getElementById('people-fold').open = true;
    document.getElementById('link-watch').click();
  });
  const link = await until(first.page, 'the link', () => document.getElementById('link-text').value);
  const second = await open(context, { url: link, layout: '3d' });
  const [seen] = await second.measured(1);
  assert.deepEqual(seen, marker);
  assert.equal(await second.page.isDisabled('#tool-distance'), true);
  const download = first.page.waitForEvent('download');
  await first.page.click('#measure-csv');
  const csv = readFileSync(await (await download).path(), 'utf8');
  assert.match(csv.split('\r\n')[1], /^\w+,marker,ramp,"'=Ünï ""1""",Guest 1,/);
  await first.page.click('#measures [data-act="remove"]');
  await second.measured(0);
  assert.deepEqual(first.said, []);
  // A guest may not read everything that other parts of the page ask for.
  assert.deepEqual(second.said.filter((text) => !text.includes('401')), []);
});

test('with the keyboard alone: a distance on the surface, its points moved, its text', async (context) => {
  const { page, said, measured: all } = await open(context, { layout: '3d', viewport: { width: 900, height: 600 } });
  await page.focus('#screen');
  await page.keyboard.press('d');
  await page.keyboard.press('Enter');
  await until(page, 'the first point', () => document.querySelector('.measure-draft-dot'));
  for (let i = 0; i < 3; i += 1) await page.keyboard.press('ArrowLeft');
  await until(page, 'the turned picture', (s) => s.isIdle && s.seq === s.sent);
  await page.keyboard.press('Enter');
  const [made] = await all(1);
  near(made.value, length(...made.points));
  await page.evaluate(() => { document.getElementById('measure').open = true; });
  await page.focus('#measure-detail .steps button');
  await page.keyboard.press('ArrowRight');
  const [moved] = await all(1, `(m) => m[0].value !== ${made.value}`);
  near(length(made.points[0], moved.points[0]), 1, 1e-3); // one voxel of the smallest spacing
  near((await all(1, `(m) => Math.abs(m[0].value - ${made.value}) > 1e-9`))[0].value, length(...moved.points), 1e-6);
  await page.keyboard.press('Delete');
  await all(0);
  assert.deepEqual(said, []);
});

test('with the keyboard alone: a rectangle in a slice, its corners set at a cursor that the arrow keys move', async (context) => {
  const { page, said, measured: all } = await open(context, { layout: '3d' });
  await page.keyboard.press('l');
  await page.locator('.pane-body[data-state="newest"]').nth(2).waitFor();
  await page.focus('#pane-coronal canvas.slice');
  const position = () => page.evaluate(() => window.splatd.view.slices.position);
  const before = await position();
  await page.keyboard.press('r');
  assert.equal(await page.evaluate(() => document.activeElement.closest('.pane')?.id), 'pane-coronal', 'the pane keeps the focus');
  for (const key of ['arrows', 'Shift', 'Enter', 'PageUp', 'Esc']) assert.ok((await page.textContent('#mode-hint')).includes(key), key);
  await page.keyboard.press('Enter');
  await page.locator('#pane-coronal .measure-draft-dot').waitFor();
  for (const key of ['ArrowRight', 'ArrowRight', 'Shift+ArrowRight', 'ArrowDown']) await page.keyboard.press(key);
  await page.locator('#pane-coronal .measure-key-cursor').waitFor({ state: 'attached' });
  assert.deepEqual(await position(), before, 'the arrow keys go through no slices');
  await shot(page, 'measure-keys');
  await page.keyboard.press('Enter');
  const [made] = await all(1, '(m) => m[0].statistics');
  const sides = [1, 2].map((i) => length(made.points[0], made.points[i]));
  near(sides[0] / sides[1], 17 / 8, 1e-6);
  assert.ok(made.points[0].some((part, i) => Math.abs(part - before[i]) < 1e-6), 'it lies in the slice');
  await page.keyboard.press('e');
  await page.keyboard.press('PageUp');
  await until(page, 'another slice', `(s) => Math.abs(s.view.slices.position[1] - ${before[1]}) > 0.5`);
  await page.keyboard.press('Escape');
  assert.equal(await page.evaluate(() => window.splatd.mode), 'navigate');
  await page.locator('.measure-key-cursor').waitFor({ state: 'detached' });
  assert.deepEqual(said, []);
});

test('a tool chosen by its key takes the focus to the picture and gives it back', async (context) => {
  const { page, said, measured: all } = await open(context, { layout: '3d', viewport: { width: 900, height: 600 } });
  const focused = () => page.evaluate(() => document.activeElement.id || document.activeElement.getAttribute('aria-label'));
  await page.evaluate(() => { document.getElementById('transfer').open = true; });
  await page.locator('#transfer [role="slider"]').first().focus();
  const point = await focused();
  await page.keyboard.press('d');
  assert.equal(await focused(), 'screen');
  for (const word of ['Click', 'arrows', 'Enter', 'Esc']) assert.ok((await page.textContent('#mode-hint')).includes(word), word);
  await page.keyboard.press('Enter');
  await page.locator('#overlay .measure-draft-dot').waitFor();
  await page.keyboard.press('Escape');
  assert.equal(await focused(), point);
  await page.keyboard.press('r');
  assert.equal(await page.evaluate(() => document.activeElement.closest('.pane')?.id), 'pane-axial', 'rectangles are drawn in slices');
  await page.locator('.pane-body[data-state="newest"]').nth(2).waitFor();
  await drag(page, await spot(page, 'axial', 0.4, 0.35), await spot(page, 'axial', 0.55, 0.55));
  await all(1);
  assert.equal(await page.evaluate(() => document.activeElement.closest('.pane')?.id), 'pane-axial', 'the focus stays where the pointer was used');
  assert.deepEqual(said, []);
});

test('twelve measurements in one place: no label covers another, and what has no place shows under the pointer', async (context) => {
  const { page, said, measured: all } = await open(context, { layout: '3d' });
  const session = await page.evaluate(() => window.splatd.session);
  const { origin, searchParams } = new URL(daemon.url);
  const kinds = ['distance', 'rectangle', 'angle', 'marker', 'profile', 'ellipse'];
  const points = { 1: [[0, 0, 0]], 2: [[0, 0, 0], [6, 2, 0]], 3: [[0, 0, 0], [6, 0, 0], [0, 4, 0]] };
  for (let i = 0; i < 12; i += 1) {
    const kind = kinds[i % 6];
    const place = [16 + (i % 4), 8 + Math.floor(i / 4), 9];
    const response = await fetch(`${origin}/api/v1/sessions/${session}/measures`, {
      method: 'POST', headers: { Authorization: `Bearer ${searchParams.get('token')}`, 'Content-Type': 'application/json' },
      body: JSON.stringify({
        kind, points: points[{ marker: 1, distance: 2, profile: 2 }[kind] ?? 3].map((point) => point.map((part, axis) => part + place[axis])),
        text: `${kind} ${i}`, color: ['#56b4e9', '#e69f00', '#009e73', '#cc79a7'][i % 4],
      }),
    });
    assert.equal(response.status, 201, await response.text());
  }
  await all(12);
  /** The labels, and what lies above the picture, when both have their places. */
  const places = async () => {
    await rest(page);
    await settle(page);
    return page.evaluate(() => {
      const boxOf_ = (element) => (({ left, right, top, bottom }) => ({ left, right, top, bottom }))(element.getBoundingClientRect());
      return {
        labels: [...document.querySelectorAll('#overlay .measure-box')].map(boxOf_),
        above: ['panel', 'toolbar', 'status', 'cube', 'scale-bar'].map((id) => boxOf_(document.getElementById(id))),
      };
    });
  };
  const overlaps = (list) => list.flatMap((a, i) => list.slice(i + 1)
    .filter((b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom).map((b) => [a, b]));
  await page.locator('#overlay .measure-box').nth(11).waitFor();
  const covered = ({ labels, above }) => labels.filter((box) => overlaps([box, ...above]).some(([first]) => first === box));
  const dense = await places();
  assert.deepEqual(overlaps(dense.labels), []);
  assert.deepEqual(covered(dense), [], 'below the panel and others');
  compare(await page.locator('#overlay .measure-leader').count(), '>', 4, 'lines lead to labels that moved');
  await shot(page, 'measures-labels');
  await resize(page, { width: 520, height: 380 });
  await until(page, 'labels are left out', () => document.querySelectorAll('#overlay .measure-box').length < 12);
  const some = await places();
  assert.deepEqual(overlaps(some.labels), []);
  assert.deepEqual(covered(some), [], 'below the panel and others');
  await shot(page, 'measures-labels-small');
  // A text without a place shows while the pointer is on its measurement.
  const hidden = await page.evaluate(() => {
    const shown = [...document.querySelectorAll('#overlay .measure-label')].map((label) => label.textContent);
    return window.splatd.measures.find(({ text: name }) => !shown.includes(name));
  });
  const text = page.locator('#overlay .measure-label', { hasText: hidden.text });
  const dot = page.locator(`#overlay [data-item="${hidden.id}"]`).first();
  await dot.dispatchEvent('pointerover');
  await text.waitFor();
  assert.equal(await page.locator('#overlay .measure-box').count(), some.labels.length + 1);
  await page.locator('#overlay .measures').dispatchEvent('pointerleave');
  await text.waitFor({ state: 'detached' });
  assert.deepEqual(said, []);
});

test('a draft ends with the volume', async (context) => {
  const { page, said } = await open(context);
  await page.focus('#pane-axial canvas.slice');
  await page.keyboard.press('r');
  await page.keyboard.press('Enter');
  await page.locator('#pane-axial .measure-draft-dot').waitFor();
  const volume = await page.evaluate(() => window.splatd.volume);
  await page.locator('#volumes .pick:not([aria-current="true"])').first().click();
  await until(page, 'the other volume', `(s) => s.volume !== '${volume}'`);
  await page.locator('.pane-body[data-state="newest"]').nth(2).waitFor();
  assert.equal(await page.locator('.measure-draft-dot').count(), 0);
  assert.deepEqual(said, []);
});

for (const colorScheme of ['dark', 'light']) {
  test(`axe finds nothing in the section, ${colorScheme}`, NEEDS_AXE, async (context) => {
    const { page, measured: all } = await open(context, { colorScheme });
    await page.keyboard.press('r');
    await drag(page, await spot(page, 'axial', 0.4, 0.35), await spot(page, 'axial', 0.55, 0.55));
    await all(1, '(m) => m[0].statistics');
    await page.evaluate(() => {
      document.getElementById('transfer').open = false;
      document.getElementById('measure').open = true;
    });
    await page.locator('#measure-plot .measure-bar').first().waitFor({ state: 'attached' });
    await shot(page, `measure-${colorScheme}`);
    await checkAxe(page, '#measure', '#toolbar', 'main');
  });
}
