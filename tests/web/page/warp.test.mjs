// SPDX-License-Identifier: Apache-2.0
// While frames are late, the page shows the last picture as the newest camera would see it.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { difference, firstFrame, pixels, share, shot, until, visitMock } from '../support/browser.mjs';

const { browser } = await share();

/** Opens the page in a browser whose animation frames seem to come every `frameMs`. */
async function setUp(context, frameMs = 16) {
  const prepare = (page) => page.addInitScript(`(() => {
    const real = window.requestAnimationFrame.bind(window);
    let time = 0;
    let last = 0; // all callbacks of a frame get the same time
    window.requestAnimationFrame = (then) => real((now) => {
      if (now !== last) time += ${frameMs};
      last = now;
      then(time);
    });
  })()`);
  return visitMock(context, browser, { prepare });
}

/** Begins a drag of which the daemon draws nothing, until `count` updates are answered. */
async function dragUnseen({ daemon, page }, count) {
  const sent = await page.evaluate(() => window.splatd.sent);
  daemon.draws = false;
  await page.mouse.move(450, 300);
  await page.mouse.down();
  for (let i = 1; i <= count; i++) {
    await page.mouse.move(450 + 10 * i, 300);
    await until(page, 'an answered update', `(s) => s.isIdle && s.sent >= ${sent + i}`);
  }
}

const transform = (page) => page.evaluate(() => getComputedStyle(document.querySelector('#warp > div')).transform);

test('the picture follows a drag whose frames are late, and a frame replaces the warp', async (context) => {
  const it = await setUp(context);
  const { daemon, page } = it;
  const before_ = await pixels(page);
  await dragUnseen(it, 1);
  assert.equal(await page.evaluate(() => window.splatd.isWarped), false, 'one update ahead is normal');
  await page.mouse.move(470, 300);
  await until(page, 'a warp', (s) => s.isIdle && s.isWarped);
  const first = await transform(page);
  assert.match(first, /^matrix3d/);
  await shot(page, 'warp');
  // Where the picture does not reach, it fades into the background.
  const fades = await page.evaluate(() => Object.fromEntries([...document.querySelectorAll('#warp i')]
    .map((strip) => [strip.dataset.side, strip.getBoundingClientRect()]).map(([side, { width, height }]) => [side, Math.min(width, height)])));
  compare(Math.max(...Object.values(fades)), '>', 1, JSON.stringify(fades));
  compare(Math.max(...Object.values(fades)), '<', 150, JSON.stringify(fades));
  await page.mouse.move(500, 300);
  await until(page, 'all answered', (s) => s.isIdle);
  assert.notEqual(await transform(page), first, 'the warp follows the camera');
  assert.equal(difference(await pixels(page), before_), 0, 'the canvas, and so every capture, stays as it is');
  daemon.draws = true;
  await page.mouse.move(510, 300);
  await until(page, 'the frame', (s) => s.isIdle && s.seq === s.sent && !s.isWarped);
  await page.mouse.up();
  assert.deepEqual(it.said, []);
});

test('the prediction can be switched off, and the choice survives a reload', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  const flip = () => page.evaluate(() => document.getElementById('warping').click());
  await flip();
  await dragUnseen(it, 3);
  assert.equal(await page.evaluate(() => window.splatd.isWarped), false);
  await page.mouse.up();
  it.daemon.draws = true;
  await page.reload();
  await firstFrame(page);
  assert.equal(await page.isChecked('#warping'), false);
  await flip();
  await dragUnseen(it, 3);
  await until(page, 'a warp', (s) => s.isWarped);
  await page.mouse.up();
});

test('a browser for which the warp is too much work pauses it', async (context) => {
  const it = await setUp(context, 40);
  await dragUnseen(it, 20);
  await until(it.page, 'the end of the warp', (s) => !s.isWarped);
  await it.page.mouse.move(600, 300);
  await until(it.page, 'the answer', (s) => s.isIdle);
  assert.equal(await it.page.evaluate(() => window.splatd.isWarped), false);
  await it.page.mouse.up();
});
