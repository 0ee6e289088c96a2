// SPDX-License-Identifier: Apache-2.0
// A sharper frame of the same view replaces a coarser one gradually; the canvas has it at once.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { frameMessage } from '../support/mock-daemon.mjs';
import { pixels, share, until, visitMock } from '../support/browser.mjs';

const { browser } = await share();
const [COARSE, SHARP] = [[200, 120, 40], [40, 120, 200]];
const FINAL = 3; // flags: a key frame, final

/** A page that shows a coarse frame of its newest view; send(frame) sends another frame of this view. */
async function setUp(context, options = {}) {
  const it = await visitMock(context, browser, { options });
  const { daemon, page } = it;
  await it.idle();
  // The animation of a frame that fades out stays where it begins, until the test lets it go on.
  await page.evaluate(() => {
    const { animate } = Element.prototype;
    window.fades = [];
    Element.prototype.animate = function held(...rest) {
      const animation = animate.apply(this, rest);
      animation.pause();
      window.fades.push(animation);
      return animation;
    };
  });
  const [stream] = daemon.streams;
  daemon.script = () => [];
  const send = async (frame) => {
    stream.frame += 1;
    const count = await page.evaluate(() => window.splatd.count);
    stream.socket.send(frameMessage({ frame: stream.frame, seq: stream.seq, width: stream.size[0], height: stream.size[1], ...frame }));
    await until(page, 'the frame', `(s) => s.count > ${count}`);
  };
  const middle = async () => {
    const image = await pixels(page);
    return image.at(image.width >> 1, image.height >> 1);
  };
  const fading = () => page.evaluate(() => document.querySelectorAll('#screen + canvas').length);
  await send({ width: 40, height: 30, color: COARSE, flags: 1 });
  assert.equal(await fading(), 0, 'a frame as coarse as the last one, or coarser, does not fade');
  return { ...it, send, middle, fading };
}

test('a sharper frame of the same view fades in, and the canvas has it at once', async (context) => {
  const { page, send, middle, fading, said } = await setUp(context);
  await send({ color: SHARP, flags: FINAL });
  assert.deepEqual(await middle(), SHARP);
  assert.equal(await fading(), 1);
  assert.equal(await page.evaluate(() => window.splatd.isDrawn), false, 'not at rest yet');
  await page.evaluate(() => window.fades.forEach((animation) => animation.finish()));
  await until(page, 'the end', (s) => s.isDrawn);
  assert.equal(await fading(), 0);
  assert.deepEqual(said, []);
});

test('a frame of another view ends the fade', async (context) => {
  const { daemon, page, send, middle, fading, idle } = await setUp(context);
  await send({ color: SHARP, flags: FINAL });
  assert.equal(await fading(), 1);
  await page.focus('#screen');
  await page.keyboard.press('ArrowLeft');
  await idle();
  assert.ok(daemon.heard.some(({ method }) => method === 'view.update'));
  await send({ width: 40, height: 30, color: COARSE, flags: 1 });
  assert.equal(await fading(), 0);
  assert.deepEqual(await middle(), COARSE);
  await send({ color: SHARP, flags: FINAL });
  assert.equal(await fading(), 1, 'the next one fades again');
});

test('no frame fades if the user prefers reduced motion', async (context) => {
  const { send, middle, fading } = await setUp(context, { reducedMotion: 'reduce' });
  await send({ color: SHARP, flags: FINAL });
  assert.deepEqual(await middle(), SHARP);
  assert.equal(await fading(), 0);
});
