// SPDX-License-Identifier: Apache-2.0
// The page with the real daemon: rotate, move and zoom by mouse, touch and keyboard; change volume, window and background;
// lose the daemon and reconnect. In the end the page always shows the last action.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { boxOf, camera, difference, drag, firstFrame, openPage, pixels, pressPlates, rest, share, shot, touch, unfold, until, visit } from '../support/browser.mjs';
import { startDaemon, tokenFile } from '../support/daemon.mjs';

const VOLUMES = ['--volume', 'demo:phantom?size=64', '--volume', 'demo:engine?size=64'];
const token = tokenFile();
const shared = await share(() => startDaemon(VOLUMES, { token }), () => token.remove());
const { browser } = shared;

async function setUp(context, options) {
  const opened = await visit(context, browser, shared.daemon.url, options);
  await rest(opened.page);
  await unfold(opened.page);
  return opened;
}

const away = (a, b) => Math.hypot(...a.map((x, i) => x - b[i]));
const depth = (c) => away(c.position, c.target);

/** Runs `act`, waits for rest, and checks that the image changed and shows the last view. */
async function changes(page, act) {
  const [before_, cameraBefore] = [await pixels(page), await camera(page)];
  const sent = await page.evaluate(() => window.splatd.sent);
  await act();
  await until(page, 'an update to be sent', `(s) => s.sent !== ${sent}`);
  await rest(page);
  const part = difference(before_, await pixels(page));
  compare(part, '>', 0.005, `only ${part} of the image differs`);
  return [cameraBefore, await camera(page)];
}

test('the page loads with an image that is not empty, is sharp at rest, and logs nothing to the console', async (context) => {
  const { page, said } = await setUp(context);
  const image = await pixels(page);
  assert.deepEqual([image.width, image.height], [900, 600]);
  let lit = 0;
  for (let y = 0; y < image.height; y += 4) for (let x = 0; x < image.width; x += 4) if (Math.max(...image.at(x, y)) > 40) lit += 1;
  compare(lit, '>', 300, `${lit} of ${225 * 150} samples are lit`);
  await until(page, 'the status line', () => /\d+ ?(ms|×)/.test(document.getElementById('status').innerText));
  await page.locator('#status [data-key="detail"]', { hasText: '100 %' }).waitFor();
  await page.locator('#status [data-key="fps"]', { hasText: 'at rest' }).waitFor();
  await page.locator('#volumes button[aria-current]', { hasText: 'phantom' }).waitFor();
  await shot(page, 'page');
  await page.keyboard.press('?');
  await page.locator('#help').waitFor();
  await shot(page, 'help');
  await page.keyboard.press('Escape');
  await page.locator('#help').waitFor({ state: 'hidden' });

  const before_ = await camera(page);
  const { x, y, width } = await boxOf(page.locator('.scale-text'));
  await drag(page, [x + width / 2, y + 5], [x - 150, y - 60]);
  compare(away(before_.position, (await camera(page)).position), '>', 0.1 * depth(before_), 'a drag that begins on the scale turns the picture');
  await page.keyboard.press('v'); // the bar of the mode
  const group = await boxOf(page.locator('#toolbar .tools').nth(1));
  const turned = await camera(page);
  await drag(page, [group.x + 2, group.y + 10], [group.x + 60, group.y + 120]);
  compare(away(turned.position, (await camera(page)).position), '>', 0.1 * depth(turned), 'a drag that begins between two tools turns the picture');
  const { count, kept } = await pressPlates(page);
  compare(count, '>', 5);
  assert.deepEqual(kept, []);
  assert.deepEqual(said, []);
});

test('a drag rotates; the reverse drag restores the first image', async (context) => {
  const { page, said } = await setUp(context);
  const first = await pixels(page);
  const [a, b] = await changes(page, () => drag(page, [520, 300], [700, 220]));
  compare(Math.abs(depth(a) - depth(b)), '<', 1e-6 * depth(a));
  assert.equal(away(a.target, b.target), 0);
  compare(away(a.position, b.position), '>', 0.2 * depth(a));
  await shot(page, 'turned');
  await page.mouse.move(520, 300);
  await page.mouse.down();
  for (const [x, y] of [[700, 220], [720, 420], [430, 500], [520, 300]]) await page.mouse.move(x, y, { steps: 8 });
  await page.mouse.up();
  await rest(page);
  const c = await camera(page);
  compare(away(b.position, c.position), '<', 1e-6 * depth(a), 'a closed path ends at its start');
  compare(away(b.up, c.up), '<', 1e-6, 'a closed path ends at its start');
  await drag(page, [700, 220], [520, 300]);
  await rest(page);
  compare(difference(first, await pixels(page)), '<', 0.002);
  const latency = await page.evaluate(() => window.splatd.latencyMs);
  compare(latency, '>', 0);
  assert.ok(Number.isFinite(latency));
  assert.deepEqual(said, []);
});

test('dragging with the right button or Shift moves the target with the cursor', async (context) => {
  const { page, said } = await setUp(context);
  const [a, b] = await changes(page, () => drag(page, [450, 300], [600, 300], { button: 'right' }));
  const unit = 2 * depth(a) * Math.tan(a.fov_y * Math.PI / 360) / 600;
  compare(Math.abs(away(a.target, b.target) - 150 * unit), '<', 1e-3 * 150 * unit);
  await shot(page, 'moved');
  await page.keyboard.down('Shift');
  await drag(page, [600, 300], [450, 300]);
  await page.keyboard.up('Shift');
  await rest(page);
  compare(away(a.target, (await camera(page)).target), '<', 1e-6 * depth(a));
  assert.deepEqual(said, []);
});

test('the wheel zooms towards the cursor and stops at a limit', async (context) => {
  const { page, said } = await setUp(context);
  await page.mouse.move(600, 200);
  const [a, b] = await changes(page, () => page.mouse.wheel(0, -400));
  await until(page, 'the zoom animation to end', (s) => s.isIdle && s.seq === s.sent);
  compare(depth(b), '<', depth(a));
  compare(away(a.target, b.target), '>', 0);
  await shot(page, 'zoomed');
  for (let i = 0; i < 60; i += 1) await page.mouse.wheel(0, -1000);
  await until(page, 'the nearest distance', (s) => {
    const same = window.lastSeen === s.sent && s.isIdle;
    window.lastSeen = s.sent;
    return same && Math.hypot(...s.camera.position.map((x, i) => x - s.camera.target[i])) < 3;
  });
  compare(depth(await camera(page)), '>', 0.1);
  assert.equal(await page.evaluate(() => window.splatd.state), 'live');
  assert.deepEqual(said, []);
});

test('keys rotate, move, zoom, fit and reset', async (context) => {
  const { page, said } = await setUp(context);
  const first = await camera(page);
  let [a, b] = await changes(page, async () => { for (let i = 0; i < 5; i += 1) await page.keyboard.press('ArrowRight'); });
  compare(Math.abs(away(a.position, b.position) - 2 * depth(a) * Math.sin(Math.PI / 18)), '<', 1e-6 * depth(a), '20 degrees');
  [a, b] = await changes(page, async () => { for (let i = 0; i < 3; i += 1) await page.keyboard.press('Shift+ArrowUp'); });
  compare(away(a.target, b.target), '>', 0);
  [a, b] = await changes(page, async () => { for (let i = 0; i < 3; i += 1) await page.keyboard.press('+'); });
  compare(Math.abs(depth(b) / depth(a) - 1.12 ** -3), '<', 1e-9);
  [a, b] = await changes(page, async () => {
    const moved = String((await camera(page)).position);
    await page.keyboard.press('f'); // asks the daemon what is visible before it moves
    await until(page, 'the fitted camera', `(s) => String(s.camera.position) !== '${moved}'`);
  });
  compare(away(b.target, first.target), '<', 0.02 * depth(first));
  compare(away(a.up, b.up), '<', 1e-12);
  await changes(page, async () => {
    await page.keyboard.press('0');
    await until(page, 'the first camera', `(s) => String(s.camera.position) === '${first.position}'`);
  });
  assert.deepEqual(said, []);
});

test('the default view fills the free part of the window, in its centre, clear of the panel and the status bar', async (context) => {
  const { page, said } = await setUp(context, { viewport: { width: 1280, height: 800 } });
  const canvas = await boxOf(page.locator('#screen'));
  const [panel, status] = [await boxOf(page.locator('#panel')), await boxOf(page.locator('#status'))];
  const image = await pixels(page);
  const scale = canvas.width / image.width;
  const [xs, ys] = [[], []];
  for (let y = 0; y < image.height; y += 2) {
    for (let x = 0; x < image.width; x += 2) if (Math.max(...image.at(x, y)) > 25) { xs.push(x * scale); ys.push(y * scale); }
  }
  const ends = (values) => [values.reduce((a, b) => Math.min(a, b)), values.reduce((a, b) => Math.max(a, b))];
  const [[left, right], [top, bottom]] = [ends(xs), ends(ys)];
  compare(canvas.x + left, '>', panel.x + panel.width, 'the volume begins beside the panel');
  compare(canvas.y + bottom, '<', status.y, 'it ends above the status bar');
  compare(Math.abs((left + right) / 2 - canvas.width / 2), '<', 0.05 * canvas.width, 'it is in the centre');
  compare(Math.max(right - left, bottom - top), '>', 0.6 * Math.min(canvas.width, canvas.height), 'it is large');
  assert.deepEqual(said, []);
});

test('touch: one finger rotates, two fingers move and zoom', async (context) => {
  const { page, said } = await setUp(context, { viewport: { width: 390, height: 700 }, hasTouch: true, isMobile: true, deviceScaleFactor: 2 });
  await shot(page, 'touch');
  const steps = (from, to) => Array.from({ length: 9 }, (_, i) => from.map(([x, y], n) => [
    x + (to[n][0] - x) * i / 8, y + (to[n][1] - y) * i / 8]));
  let [a, b] = await changes(page, () => touch(page, steps([[195, 350]], [[280, 420]])));
  compare(away(a.position, b.position), '>', 0.1 * depth(a));
  assert.equal(away(a.target, b.target), 0);
  [a, b] = await changes(page, () => touch(page, steps([[150, 350], [240, 350]], [[100, 400], [280, 400]])));
  compare(Math.abs(depth(b) / depth(a) - 0.5), '<', 1e-6, 'twice the finger distance halves the camera distance');
  compare(away(a.target, b.target), '>', 0);
  compare(away(a.up, b.up), '<', 1e-9, 'pinching does not rotate');
  assert.deepEqual(said, []);
});

test('the image follows the size of the window and ends at full size', async (context) => {
  const { page, said } = await setUp(context);
  for (const [width, height, besideSheet] of [[500, 700, [500, 350]], [1000, 400, [700, 400]], [900, 640]]) {
    await page.setViewportSize({ width, height });
    const expected = besideSheet ?? [width, height]; // the sheet of a small window takes a part of it
    await until(page, `an image of ${expected}`, `(s) => String(s.wanted) === '${expected}'`);
    await rest(page);
    assert.deepEqual(await page.evaluate(() => window.splatd.size), expected);
  }
  assert.deepEqual(said, []);
});

test('the page switches to another volume with its own camera and back; the address can name a volume', async (context) => {
  const { page, said } = await setUp(context);
  await drag(page, [450, 300], [300, 200]);
  await changes(page, async () => {
    await page.locator('#volumes button', { hasText: 'engine' }).click();
    await until(page, 'the engine', (s) => s.volume === 'engine' && s.isIdle);
  });
  await page.locator('#volumes button[aria-current]', { hasText: 'engine' }).waitFor();
  await shot(page, 'engine');
  await changes(page, () => drag(page, [450, 300], [300, 200]));
  await page.goto(`${shared.daemon.url}&volume=engine`);
  await rest(page);
  assert.equal(await page.evaluate(() => window.splatd.volume), 'engine');
  assert.deepEqual(said, []);
});

test('background, shading and filter change the image', async (context) => {
  const { page, said } = await setUp(context);
  await changes(page, () => page.click('.swatches button[data-color="#ffffff"]'));
  const image = await pixels(page);
  compare(Math.min(...image.at(image.width - 3, 3)), '>', 245, 'a white corner');
  await shot(page, 'white');
  await changes(page, () => page.evaluate(() => {
    const input = document.getElementById('background');
    input.value = '#203080';
    input.dispatchEvent(new Event('input', { bubbles: true }));
  }));
  const before_ = await pixels(page);
  const wasShaded = await page.isChecked('#shading');
  await page.locator('#shading').setChecked(!wasShaded);
  await rest(page);
  compare(difference(before_, await pixels(page)), '>', 0.001, 'shading');
  await page.locator('#shading').setChecked(true);
  await rest(page);
  await page.locator('#volumes button', { hasText: 'engine' }).click(); // it has holes, which light hardly enters
  await until(page, 'the engine', (s) => s.volume === 'engine' && s.isIdle);
  for (const id of ['#occlusion', '#shadow']) {
    const plain = await pixels(page);
    await page.focus(id);
    await page.keyboard.press('End');
    await rest(page);
    assert.equal(await page.inputValue(id), '1');
    compare(difference(plain, await pixels(page)), '>', 0.0005, id);
  }
  await shot(page, 'occlusion');
  assert.equal(await page.inputValue('#order'), 'auto');
  await page.selectOption('#order', 'pre');
  await rest(page);
  assert.equal(await page.inputValue('#shadow'), '0', 'voxels that are classified cast no shadow');
  await page.selectOption('#filter', 'reconstruction');
  await rest(page);
  assert.equal(await page.inputValue('#filter'), 'reconstruction');
  await page.reload();
  await rest(page);
  assert.equal(await page.inputValue('#filter'), 'reconstruction', 'a reload keeps the view');
  assert.deepEqual(said, []);
});

test('every rendering option can be drawn, and parts hidden by a plane, a box or the gradient disappear', async (context) => {
  const { page, said } = await setUp(context, { viewport: { width: 700, height: 500 } });
  const choose = async (id, value) => {
    await page.selectOption(id, value);
    await rest(page);
    assert.equal(await page.locator('.complaint').count(), 0, `${id} ${value}`);
    assert.equal(await page.inputValue(id), value);
  };
  for (const mode of ['ewa', 'reconstruction', 'lowpass', 'swan', 'none', 'adaptive']) await choose('#filter', mode);
  const plain = await pixels(page);
  await choose('#kernel', 'cubic');
  await choose('#kernel', 'gaussian');
  for (const mode of ['splat', 'slab']) await choose('#compositing', mode);
  await choose('#attenuation', 'linear');
  await choose('#attenuation', 'exponential');
  await choose('#compositing', 'sheet');
  compare(difference(plain, await pixels(page)), '<', 0.001, 'the first image again');
  await choose('#order', 'post');
  assert.equal(await page.inputValue('#compositing'), 'sheet');
  await shot(page, 'post');
  await choose('#compositing', 'splat');
  assert.equal(await page.inputValue('#order'), 'auto');
  await choose('#compositing', 'sheet');
  const lit = ({ width, height, at }) => {
    let count = 0;
    for (let y = 0; y < height; y += 4) for (let x = 0; x < width; x += 4) if (Math.max(...at(x, y).slice(0, 3)) > 40) count += 1;
    return count;
  };
  const whole = lit(await pixels(page));
  await changes(page, () => page.locator('#plane-sight').click());
  await shot(page, 'plane');
  await changes(page, async () => {
    await page.focus('#plane-depth');
    await page.keyboard.press('End');
  });
  assert.equal(lit(await pixels(page)), 0, 'a plane behind the volume hides all of it');
  await page.locator('#planes input[role="switch"]').click();
  await rest(page);
  await changes(page, async () => {
    await page.focus('.pair input[data-axis="2"][data-end="1"]');
    for (let i = 0; i < 5; i += 1) await page.keyboard.press('PageDown');
  });
  const half = lit(await pixels(page));
  compare(half, '>', 0.1 * whole, `${half} of ${whole} samples are lit`);
  compare(half, '<', 0.9 * whole, `${half} of ${whole} samples are lit`);
  await shot(page, 'box');
  await page.keyboard.press('End');
  await rest(page);
  await changes(page, async () => {
    await page.focus('#flat');
    for (let i = 0; i < 5; i += 1) await page.keyboard.press('PageUp');
  });
  await shot(page, 'flat');
  assert.deepEqual(said, []);
});

test('two windows of one session show each other\'s changes', async (context) => {
  const { page, said } = await setUp(context);
  const join = await page.evaluate(() => JSON.parse(Object.entries(sessionStorage).find(([k]) => k.endsWith('session'))[1]));
  const other = await openPage(browser);
  context.after(() => other.context.close());
  await other.page.goto(`${new URL(shared.daemon.url).origin}/?session=${join.id}&token=${join.token}`);
  await firstFrame(other.page);
  await drag(page, [450, 300], [600, 250]);
  await rest(page);
  const { position } = await camera(page);
  await until(other.page, 'the same camera', `(s) => Math.hypot(...s.camera.position.map((x, i) => x - ${JSON.stringify(position)}[i])) < 1e-6`);
  assert.deepEqual([...said, ...other.said], []);
});

test('when the daemon stops, a banner says so; when it restarts, the page reconnects with the last view', async (context) => {
  const { page } = await setUp(context);
  await page.click('.swatches button[data-color="#808080"]');
  await drag(page, [450, 300], [600, 250]);
  await rest(page);
  const last = await camera(page);
  const { port } = shared.daemon;
  assert.equal(await shared.daemon.stop(), 0, 'SIGTERM with a connected client drains and exits with status 0');
  await page.locator('#banner', { hasText: 'Connection lost — trying again' }).waitFor();
  await shot(page, 'gone');
  const count = await page.evaluate(() => window.splatd.count);
  shared.daemon = await startDaemon(VOLUMES, { port, token });
  await until(page, 'a new frame', `(s) => s.state === 'live' && s.count > ${count}`);
  await rest(page);
  await page.locator('#banner').waitFor({ state: 'hidden' });
  const back = await camera(page);
  compare(away(back.position, last.position), '<', 1e-6 * depth(last));
  const image = await pixels(page);
  compare(Math.abs(image.at(image.width - 3, 3)[0] - 128), '<', 12, 'the grey background is back');
  await drag(page, [450, 300], [300, 350]);
  await rest(page);
});

test('V shows the value under the cursor', async (context) => {
  const { page, said } = await setUp(context);
  await page.focus('#screen');
  await page.mouse.move(450, 300);
  await page.locator('#status [data-key="value"] dd', { hasText: /\d/ }).waitFor(); // it rests
  await page.evaluate(() => {
    const value = document.querySelector('#status [data-key="value"] dd');
    window.cleared = 0;
    new MutationObserver(() => { window.cleared += value.textContent === ''; }).observe(value, { childList: true, characterData: true, subtree: true });
  });
  await page.keyboard.press('ArrowLeft');
  await until(page, 'the value of the other view', () => window.cleared > 0 && /\d/.test(document.querySelector('#status [data-key="value"] dd').textContent));
  await page.keyboard.press('v');
  await page.locator('.prompt[data-id="pick"] p', { hasText: /^Value -?[\d.]+ at -?[\d.]+, -?[\d.]+, -?[\d.]+/ }).waitFor();
  await page.mouse.move(890, 10);
  await page.keyboard.press('v');
  await page.locator('#notice', { hasText: 'Nothing opaque here: opacity 0 %' }).waitFor();
  await page.locator('.prompt[data-id="pick"]').waitFor({ state: 'detached' });
  assert.deepEqual(said, []);
});
