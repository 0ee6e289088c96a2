// SPDX-License-Identifier: Apache-2.0
// The panel "Path": keyframes by mouse and keyboard, turntables, playback, rendering by the daemon and the resulting files.
import assert from 'node:assert/strict';
import { readFileSync, writeFileSync } from 'node:fs';
import { after, before, test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { camera, eventually, firstFrame, openPage, rest, share, shot, until, visit } from '../support/browser.mjs';
import { countFrames, untar } from '../support/containers.mjs';
import { startDaemon, tokenFile } from '../support/daemon.mjs';
import { MockDaemon, volume } from '../support/mock-daemon.mjs';
import { decodePng } from '../support/png.mjs';

const PHONE = { viewport: { width: 360, height: 700 }, deviceScaleFactor: 2, isMobile: true, hasTouch: true };
const { browser, daemon } = await share(() => startDaemon(['--volume', 'demo:phantom?size=32', '--volume', 'demo:engine?size=32', '--backend', 'cpu',
  '--path-frames', '500', '--frame-size', '1M']));

async function open(context, address, options) {
  const opened = await visit(context, browser, address, options);
  const { page } = opened;
  if (options?.hasTouch) await page.tap('#panel-toggle');
  await page.locator('#path > summary').click();
  return {
    ...opened,
    about: (text) => page.locator('#keys-about', { hasText: text }).waitFor(),
    entry: (state) => page.locator(`#paths li[data-state="${state}"]`),
    /** Rotates the view by some key presses, and waits until the page shows it. */
    async press(key, times = 5) {
      await page.focus('#screen');
      for (let i = 0; i < times; i += 1) await page.keyboard.press(key);
      await until(page, 'all frames', (s) => s.isIdle && s.seq === s.sent);
    },
    /** Presses the save button of the first path and returns the file. */
    async save() {
      const [download] = await Promise.all([page.waitForEvent('download'), page.locator('#paths .save').first().click()]);
      return { name: download.suggestedFilename(), bytes: readFileSync(await download.path()) };
    },
    async remove() {
      const count = await page.locator('#paths li').count();
      await page.locator('#paths .delete').first().click();
      await page.click('#ask-act');
      await page.locator('#paths li').nth(count - 1).waitFor({ state: 'detached' });
    },
  };
}

async function fill(page, values) {
  for (const [id, value] of Object.entries(values)) {
    await page.fill(`#${id}`, String(value));
    await page.locator(`#${id}`).blur();
  }
}

test('two views become keyframes; the daemon renders the frames between them, which can be saved', async (context) => {
  const it = await open(context, daemon.url);
  const { page } = it;
  await rest(page);
  await shot(page, 'path-empty');
  assert.ok(await page.locator('#path-way').isHidden());
  await page.click('#key-add');
  await it.about('1 keyframe; a path needs two');
  await it.press('ArrowLeft');
  await page.click('#key-add');
  await it.about('2 keyframes, 2 s, 61 frames');
  await until(page, 'images of the keyframes', () => document.querySelectorAll('#keys img').length === 2);
  const offered = () => page.evaluate(() => ['width', 'height'].map((side) => document.getElementById(`path-${side}`).placeholder));
  assert.deepEqual(await offered(), ['900', '600'], 'the size of the window');
  await fill(page, { 'path-length': 0.5, 'path-fps': 10, 'path-width': 90 });
  assert.equal((await offered())[1], '60', 'the aspect ratio of the window');
  await it.about('2 keyframes, 0.5 s, 6 frames');
  await page.selectOption('#path-format', 'png');
  assert.ok(await page.locator('#path-quality').isDisabled());
  await shot(page, 'path-keys');
  await page.locator('#path-draw', { hasText: 'Render 6 frames' }).click();
  await it.entry('done').waitFor();
  await page.locator('#path-busy', { hasText: 'finished' }).waitFor();
  await shot(page, 'path-done');
  const { name, bytes } = await it.save();
  assert.match(name, /^[0-9a-f]{32}\.tar$/);
  const files = untar(bytes);
  assert.deepEqual(files.map((file) => file.name), [0, 1, 2, 3, 4, 5].map((n) => `00000${n}.png`));
  const images = files.map((file) => decodePng(file.bytes));
  for (const { width, height } of images) assert.deepEqual([width, height], [90, 60]);
  for (let i = 1; i < 6; i += 1) assert.notDeepEqual(files[i].bytes, files[i - 1].bytes);
  await it.remove();
  assert.ok(await page.locator('#paths-title').isHidden());
  assert.deepEqual(it.said, []);
});

test('a turntable takes one press and becomes a movie', async (context) => {
  const it = await open(context, daemon.url);
  const { page } = it;
  const first = await camera(page);
  await page.click('#key-add');
  await page.click('#turn-add'); // begins at that keyframe
  await it.about('4 keyframes, 8 s, 240 frames');
  assert.ok(await page.isChecked('#path-loop'));
  await until(page, 'images of the keyframes', () => document.querySelectorAll('#keys .picture img').length === 4);
  await page.locator('#keys .picture').nth(2).click();
  await until(page, 'the far side', (s) => s.camera.position[0] < 0 && s.isIdle);
  const far = await camera(page);
  far.position.forEach((x, i) => compare(Math.abs(x - (i < 2 ? 2 * first.target[i] - first.position[i] : first.position[i])), '<', 1e-9));
  await fill(page, { 'path-length': 1, 'path-fps': 6, 'path-width': 64, 'path-height': 48 });
  await shot(page, 'path-turn');
  await page.locator('#path-draw', { hasText: 'Render 6 frames' }).click();
  await it.entry('done').waitFor();
  const { name, bytes } = await it.save();
  assert.match(name, /^phantom-[0-9a-f]{8}\.webm$/);
  assert.equal(countFrames(bytes), 6);
  await it.remove();
  // A turntable after other keyframes returns to its start.
  await page.click('#turn-add');
  await page.locator('#keys li').nth(8).waitFor();
  assert.equal(await page.locator('#keys li').count(), 9);
  assert.deepEqual(it.said, []);
});

test('the keyboard replaces, moves, removes and selects keyframes; each volume has its own; a reload keeps them', async (context) => {
  const it = await open(context, daemon.url);
  const { page } = it;
  const focused = () => page.evaluate(() => document.activeElement.getAttribute('aria-label') ?? document.activeElement.id);
  const act = async (label) => {
    await page.getByLabel(label, { exact: true }).focus();
    await page.keyboard.press('Enter');
  };
  const cameras = [];
  for (let i = 0; i < 3; i += 1) {
    cameras.push((await camera(page)).position);
    await page.focus('#key-add');
    await page.keyboard.press('Enter');
    await it.press('ArrowLeft');
  }
  const at = async (i, position) => {
    await act(`Go to keyframe ${i}`);
    await until(page, `keyframe ${i}`, `(s) => s.isIdle && String(s.camera.position) === '${position}'`);
  };
  await at(1, cameras[0]);
  await act('Move keyframe 2 down');
  assert.equal(await focused(), 'Go to keyframe 3', 'the last keyframe cannot move further down');
  await at(3, cameras[1]);
  await at(2, cameras[2]);
  await act('Move keyframe 3 up');
  assert.equal(await focused(), 'Move keyframe 2 up', 'the focus moves with the keyframe');
  await it.press('ArrowUp');
  const { position } = await camera(page);
  await act('Replace keyframe 1 by the current view');
  assert.equal(await focused(), 'Replace keyframe 1 by the current view');
  await it.press('ArrowDown');
  await at(1, position);
  await page.selectOption('#keys li:nth-child(2) select', 'smooth');
  await page.locator('#volumes button', { hasText: 'engine' }).click();
  await it.about('Add views as keyframes');
  assert.equal(await page.locator('#keys li').count(), 0);
  await page.locator('#volumes button', { hasText: 'phantom' }).click();
  await it.about('3 keyframes');
  await page.reload(); // keeps the fold open
  await firstFrame(page);
  await it.about('3 keyframes, 4 s, 121 frames');
  await at(1, position);
  assert.equal(await page.inputValue('#keys li:nth-child(2) select'), 'smooth');
  await act('Remove keyframe 3');
  assert.equal(await focused(), 'Remove keyframe 2');
  await it.about('2 keyframes');
  await page.click('#keys-clear');
  await page.keyboard.press('Escape');
  await it.about('2 keyframes');
  await page.click('#keys-clear');
  await page.click('#ask-act');
  await it.about('Add views as keyframes');
  assert.deepEqual(it.said, []);
});

test('playback follows the path to its end; moving the view stops it', async (context) => {
  const it = await open(context, daemon.url);
  const { page } = it;
  const first = await camera(page);
  await page.click('#key-add');
  await it.press('ArrowLeft', 15); // 60 degrees
  const last = await camera(page);
  await page.click('#key-add');
  const near = (position) => `(s) => s.isIdle && s.camera.position.every((x, i) => Math.abs(x - ${JSON.stringify(position)}[i]) < 1e-6)`;
  // The middle of the path lies on the arc, at the same distance.
  await page.focus('#path-at');
  await page.locator('#path-at').fill('30');
  assert.equal(await page.getAttribute('#path-at', 'aria-valuetext'), '1 s');
  await until(page, 'the middle', (s) => s.isIdle);
  const { position } = await camera(page);
  const away = (a, b) => Math.hypot(...a.map((x, i) => x - b[i]));
  const distance = away(first.position, first.target);
  compare(Math.abs(away(position, first.target) - distance), '<', 1e-6 * distance);
  compare(Math.abs(away(position, first.position) - away(position, last.position)), '<', 1e-6 * distance);
  await fill(page, { 'path-length': 0.5 });
  await page.click('#path-play');
  await until(page, 'the end of the path', () => document.getElementById('path-play').textContent === 'Play'
    && document.getElementById('path-at').value === document.getElementById('path-at').max);
  await until(page, 'the last key', near(last.position));
  await fill(page, { 'path-length': 600 });
  const stood = await page.inputValue('#path-at');
  await page.click('#path-play');
  await until(page, 'playback', `() => document.getElementById('path-play').textContent !== 'Play' && document.getElementById('path-at').value !== '${stood}'`);
  await page.focus('#screen');
  await page.keyboard.press('ArrowRight'); // F would hardly move the camera, which begins where it fits the volume
  await page.locator('#path-play', { hasText: 'Play' }).waitFor();
  compare(Number(await page.inputValue('#path-at')), '<', 17000, 'playback stopped before the end');
  assert.deepEqual(it.said, []);
});

test('a refusal of the daemon is shown beside the control that caused it', async (context) => {
  const it = await open(context, daemon.url);
  const { page } = it;
  await page.click('#turn-add');
  const complaint = (pointer, text) => page.locator(`[data-pointer="${pointer}"] + .complaint`, { hasText: text }).waitFor();
  await fill(page, { 'path-width': 2000, 'path-height': 2000 });
  await page.click('#path-draw');
  await complaint('/path/size', '1048576');
  assert.equal(await page.getAttribute('#path-width', 'aria-invalid'), 'true');
  await shot(page, 'path-refused');
  await fill(page, { 'path-width': 64, 'path-height': 64, 'path-fps': 240 });
  assert.equal(await page.locator('.complaint').count(), 0);
  await page.click('#path-draw');
  await complaint('/path/frames', '1920 is outside [1, 500]');
  // The page does not send values that it knows to be invalid.
  await fill(page, { 'path-fps': 0.5 });
  await page.click('#path-draw');
  assert.equal(await page.evaluate(() => document.getElementById('path-form').checkValidity()), false);
  assert.equal(await page.locator('#paths li').count(), 0);
  assert.deepEqual(it.said.filter((line) => !line.includes('422')), []);
});

test('a reload finds unfinished paths again with the reason for waiting; cancelling needs a confirmation', async (context) => {
  const small = await startDaemon(['--volume', 'demo:phantom?size=32', '--backend', 'cpu', '--path-bytes', '1K']);
  context.after(() => small.stop());
  const it = await open(context, small.url);
  const { page } = it;
  await page.click('#turn-add');
  await page.selectOption('#path-format', 'png');
  await fill(page, { 'path-width': 300, 'path-height': 200 });
  await page.click('#path-draw');
  await it.entry('waiting').locator('.state', { hasText: '--path-bytes' }).waitFor();
  await page.locator('#path-busy', { hasText: '1 under way' }).waitFor();
  await page.reload();
  await firstFrame(page);
  await page.locator('#path-busy', { hasText: '1 under way' }).waitFor();
  await it.entry('waiting').locator('.state', { hasText: '--path-bytes' }).waitFor();
  await shot(page, 'path-waiting');
  const other = await open(context, small.url);
  await other.entry('waiting').waitFor();
  await page.locator('#paths .delete', { hasText: 'Cancel' }).click();
  await shot(page, 'path-ask');
  await page.locator('#ask button', { hasText: 'Leave it' }).click();
  assert.equal(await page.locator('#paths li').count(), 1);
  await it.remove();
  await other.page.locator('#paths li').waitFor({ state: 'detached' });
  assert.equal(await page.evaluate(() => document.activeElement.tagName), 'SUMMARY');
  assert.deepEqual([...it.said, ...other.said], []);
});

test('a client that may not create paths sees the reason', async (context) => {
  const token = tokenFile();
  context.after(token.remove);
  writeFileSync(token.file, `${token.text}\nwatch-${token.text} role=view\n`, { mode: 0o600 });
  const own = await startDaemon(['--volume', 'demo:phantom?size=32', '--backend', 'cpu'], { token });
  context.after(() => own.stop());
  const host = await open(context, own.url);
  const { id, token: join } = await host.page.evaluate(() => JSON.parse(Object.entries(sessionStorage).find(([k]) => k.endsWith('session'))[1]));
  const guest = await open(context, `${new URL(own.url).origin}/#${new URLSearchParams({ session: id, token: join })}`);
  await guest.page.locator('#path-note', { hasText: 'this page joined by a link' }).waitFor();
  assert.ok(await guest.page.locator('#path-making').isHidden());
  // A daemon token whose role has too few permissions.
  const watcher = await openPage(browser);
  context.after(() => watcher.context.close());
  await watcher.page.goto(`${new URL(own.url).origin}/?token=watch-${token.text}`);
  await watcher.page.locator('#banner', { hasText: 'refused' }).waitFor();
  await watcher.page.goto(`${new URL(own.url).origin}/?session=${id}`);
  await firstFrame(watcher.page);
  await watcher.page.locator('#path > summary').click();
  await watcher.page.locator('#path-note', { hasText: 'the role of this token does not include this' }).waitFor();
  await shot(watcher.page, 'path-role');
  assert.ok(await watcher.page.locator('#path-making').isHidden());
});

const made = (id, more = {}) => ({
  id, state: 'waiting', volume: 'phantom', size: [640, 480], format: 'webm', fps: 30, frames: 10, done: 0, bytes: 0, ...more,
});

test('the page opens few event streams, however many paths there are, and reopens one that breaks', async (context) => {
  const mock = await MockDaemon.start({
    paths: [made('a'), made('c'), made('e'), made('b', { state: 'running' }), made('d', { state: 'done', done: 10, bytes: 2345678 })],
  });
  context.after(() => mock.kill().catch(() => {}));
  const it = await open(context, mock.url);
  const { page } = it;
  const state = (id, text) => page.locator(`#paths li[data-id="${id}"] .state`, { hasText: text }).waitFor();
  await state('d', 'done, 2.3 MB');
  await until(page, 'the list', () => document.querySelectorAll('#paths li').length === 5);
  const watched = () => [...mock.watches].map(({ id }) => id).sort().join();
  await eventually('two streams, first of what is drawn', () => watched() === 'a,b');
  mock.follow('b', { done: 4, bytes: 5000 });
  await state('b', '4 of 10, 5.0 kB');
  mock.follow('a', { reason: 'the volume loads' });
  await state('a', 'waiting: the volume loads');
  mock.follow('e', { state: 'running', done: 2 }); // no event stream watches this path
  await state('e', '2 of 10');
  mock.follow('b', { state: 'failed', reason: 'a view that is none' }, 'failed');
  await state('b', 'failed after 4 of 10: a view that is none');
  await page.locator('#path-busy', { hasText: '3 under way' }).waitFor();
  await eventually('running paths before waiting ones', () => watched() === 'a,e');
  mock.follow('e', { done: 3 });
  await state('e', '3 of 10');
  const hide = (isHidden) => page.evaluate((hidden) => {
    Object.defineProperty(document, 'hidden', { value: hidden, configurable: true });
    document.dispatchEvent(new Event('visibilitychange'));
  }, isHidden);
  await hide(true);
  await eventually('a hidden tab to close its streams', () => watched() === '');
  mock.follow('e', { done: 4 });
  await hide(false);
  await state('e', '4 of 10');
  await eventually('a tab that is seen again', () => watched() === 'a,e');
  mock.dropWatches();
  mock.follow('a', { state: 'running', reason: '', done: 9 });
  await state('a', '9 of 10');
  await page.locator('#path > summary').click();
  await eventually('both streams', () => watched() === 'a,e');
  mock.follow('a', { state: 'done', done: 10 }, 'done');
  await page.locator('#notice', { hasText: 'A path of phantom is finished: 10 frames.' }).waitFor();
  assert.deepEqual(it.said.filter((line) => !line.includes('ERR_INCOMPLETE_CHUNKED_ENCODING')), []);
});

test('an error of a keyframe is shown at the keyframe, any other error beside the button', async (context) => {
  const mock = await MockDaemon.start({ volumes: [volume('phantom')] });
  context.after(() => mock.kill().catch(() => {}));
  const it = await open(context, mock.url);
  const { page } = it;
  await page.click('#turn-add');
  mock.refusal = { status: 422, detail: 'too many points', pointer: '/keyframes/1/view/transfer_function/points' };
  await page.click('#path-draw');
  await page.locator('#keys li:nth-child(3) .complaint', { hasText: 'too many points' }).waitFor();
  await shot(page, 'path-keyframe');
  mock.refusal = { status: 507, detail: 'the files are full' };
  await page.click('#path-draw');
  await page.locator('[data-pointer="/path"] + .complaint', { hasText: 'the files are full' }).waitFor();
  assert.equal(await page.locator('.complaint').count(), 1);
  mock.refusal = null;
  await page.click('#path-draw');
  await it.entry('waiting').waitFor();
  assert.equal(await page.locator('.complaint').count(), 0);
});

test('on a phone all controls fit in the panel', async (context) => {
  const it = await open(context, daemon.url, PHONE);
  const { page } = it;
  await page.tap('#turn-add');
  await it.about('4 keyframes');
  await fill(page, { 'path-length': 0.4, 'path-width': 64, 'path-height': 48 });
  await page.tap('#path-draw');
  await it.entry('done').waitFor();
  const outside = await page.evaluate(() => {
    const panel = document.getElementById('panel').getBoundingClientRect();
    return [...document.querySelectorAll('#path select, #path input, #path button, #path output, #path .about')]
      .filter((control) => control.checkVisibility())
      .filter((control) => {
        const box = control.getBoundingClientRect();
        return box.width === 0 || box.left < panel.left || box.right > panel.right;
      }).map((control) => control.id || control.outerHTML);
  });
  assert.deepEqual(outside, []);
  await shot(page, 'phone-path');
  await it.remove();
  assert.deepEqual(it.said, []);
});
