// SPDX-License-Identifier: Apache-2.0
// While frames are late, the page shows the last picture as the newest camera would see it.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { difference, eventually, firstFrame, pixels, share, shot, until, visitMock } from '../support/browser.mjs';

const { browser } = await share();

/** Opens the page in a browser whose animation frames seem to come every `frameMs`. */
async function setUp(context, frameMs = 16, change = {}, prepareMore = async () => {}) {
  const prepare = (page) => prepareMore(page).then(() => page.addInitScript(`(() => {
    const real = window.requestAnimationFrame.bind(window);
    let time = 0;
    let last = 0; // all callbacks of a frame get the same time
    window.requestAnimationFrame = (then) => real((now) => {
      if (now !== last) time += ${frameMs};
      last = now;
      then(time);
    });
  })()`));
  return visitMock(context, browser, { prepare, change });
}

/** Begins a drag from x on, of which the daemon draws nothing, until `count` updates are answered. */
async function dragUnseen({ daemon, page }, count, x = 450) {
  const sent = await page.evaluate(() => window.splatd.sent);
  daemon.draws = false;
  await page.mouse.move(x, 300);
  await page.mouse.down();
  for (let i = 1; i <= count; i++) {
    await page.mouse.move(x + 10 * i, 300);
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

/** The canvas of frames that are drawn by their depth: what the layer shows, how large it is, and the px in its middle. */
const byDepth = (page) => page.evaluate(() => {
  const layer = document.getElementById('warp');
  const { width, height } = layer.lastElementChild;
  const copy = new OffscreenCanvas(width, height).getContext('2d', { willReadFrequently: true });
  copy.drawImage(layer.lastElementChild, 0, 0);
  return { kind: layer.dataset.kind, width, height, middle: [...copy.getImageData(width >> 1, height >> 1, 1, 1).data].slice(0, 3) };
});

/** Makes the page believe that a GPU draws WebGL. Drawings stay, so that they can be read. */
const feignGpu = (page) => page.addInitScript(() => {
  const { getParameter } = WebGL2RenderingContext.prototype;
  WebGL2RenderingContext.prototype.getParameter = function feigned(name) {
    return name === 0x9246 || name === this.RENDERER ? 'a GPU' : getParameter.call(this, name);
  };
  for (const type of [HTMLCanvasElement, OffscreenCanvas]) {
    const { getContext } = type.prototype;
    type.prototype.getContext = function kept(kind, options) {
      return getContext.call(this, kind, kind === 'webgl2' ? { ...options, preserveDrawingBuffer: true, failIfMajorPerformanceCaveat: false } : options);
    };
  }
});
const hasGl = (page) => page.evaluate(() => Boolean(document.querySelector('#warp > canvas').getContext('webgl2')));

for (const [name, prepareMore] of [['pixel by pixel', async () => {}], ['with a GPU', feignGpu]]) {
  test(`frames with depth follow the hand from the first update on, drawn ${name}`, async (context) => {
    const it = await setUp(context, 16, { hasDepth: true }, prepareMore);
    const { daemon, page } = it;
    if (prepareMore === feignGpu && !await hasGl(page)) {
      context.skip('this browser has no WebGL 2');
      return;
    }
    await until(page, 'a frame with depth', (s) => s.hasDepth);
    const before_ = await pixels(page);
    await dragUnseen(it, 1);
    await until(page, 'a warp', (s) => s.isIdle && s.isWarped);
    await page.mouse.move(480, 300);
    await until(page, 'the newest camera', (s) => s.isIdle && s.isDrawn && s.warps > 1);
    const { kind, width, height, middle } = await byDepth(page);
    assert.equal(kind, 'depth');
    compare(Math.min(width, height), '>', 1);
    assert.deepEqual(middle, [200, 120, 40], 'the picture turns about what lies behind it');
    assert.equal(difference(await pixels(page), before_), 0, 'the canvas, and so every capture, stays as it is');
    daemon.draws = true;
    await page.mouse.move(570, 300);
    await until(page, 'the frame', (s) => s.isIdle && s.seq === s.sent && !s.isWarped);
    await page.mouse.up();
    assert.deepEqual(it.said.filter((text) => !text.includes('GPU stall due to ReadPixels')), []); // that was this test
  });
}

test('a frame that is ahead of the hand is shown as the hand sees it, until a frame of its own camera comes', async (context) => {
  const it = await setUp(context, 16, { hasDepth: true });
  const { daemon, page } = it;
  await page.locator('#path > summary').click();
  await page.locator('#key-add').waitFor();
  const predicts = () => daemon.heard.filter(({ method, params }) => method === 'stream.configure' && params.predict > 0).length;
  await until(page, 'a frame with depth', (s) => s.hasDepth);
  await eventually('a request for predicted frames', () => predicts() > 0);
  const expect = (way) => (camera) => ({ ...camera, position: camera.position.map((x, i) => x + (i === 0 ? way : 0)) });
  daemon.expect = expect(0.001); // less than any move of the mouse
  await page.mouse.move(450, 300);
  await page.mouse.down();
  await page.mouse.move(480, 300);
  await until(page, 'the warp of the newest frame', (s) => s.isIdle && s.isDrawn && s.seq === s.sent && s.isWarped);
  assert.deepEqual((await byDepth(page)).middle, [200, 120, 40]);
  await page.evaluate(() => document.getElementById('key-add').click());
  await page.locator('#keys li').waitFor();
  assert.equal(await page.locator('#keys img').count(), 0, 'a keyframe does not get an image of a camera that no view had');
  daemon.expect = expect(500); // it overshoots a hand that has stopped
  const { count, warps } = await page.evaluate(() => ({ count: window.splatd.count, warps: window.splatd.warps }));
  await page.mouse.move(490, 300);
  await until(page, 'the old frame, as the hand sees it', `(s) => s.isIdle && s.count === ${count} && s.warps > ${warps} && s.seq < s.sent`);
  daemon.expect = (camera) => camera;
  await page.mouse.move(500, 300);
  await until(page, 'a frame of the hand', (s) => s.isIdle && s.seq === s.sent && !s.isWarped);
  await page.mouse.up();
  assert.deepEqual(it.said.filter((text) => !text.includes('404')), []); // this daemon draws no image for the keyframe
});

test('without a GPU, the px of a frame are read when motion begins', async (context) => {
  const it = await setUp(context, 16, { hasDepth: true }, (page) => page.addInitScript(() => {
    window.reads = 0;
    const { getImageData } = OffscreenCanvasRenderingContext2D.prototype;
    OffscreenCanvasRenderingContext2D.prototype.getImageData = function counted(...rest) {
      window.reads += 1;
      return getImageData.apply(this, rest);
    };
  }));
  const { daemon, page } = it;
  const reads = () => page.evaluate(() => window.reads);
  await until(page, 'a frame with depth', (s) => s.hasDepth && s.isDrawn);
  assert.equal(await reads(), 0);
  await dragUnseen(it, 3);
  await until(page, 'a warp', (s) => s.isIdle && s.isDrawn && s.warps > 1);
  assert.equal(await reads(), 2, 'the frame and its depth, once');
  daemon.draws = true;
  await page.mouse.up();
});

test('after the GPU is lost, the canvas is shown, and the next frames are drawn again', async (context) => {
  const it = await setUp(context, 16, { hasDepth: true }, feignGpu);
  const { daemon, page } = it;
  if (!await hasGl(page)) {
    context.skip('this browser has no WebGL 2');
    return;
  }
  await until(page, 'a frame with depth', (s) => s.hasDepth);
  await dragUnseen(it, 1);
  await until(page, 'a warp', (s) => s.isIdle && s.isWarped);
  await page.evaluate(() => {
    window.lost = document.querySelector('#warp > canvas').getContext('webgl2').getExtension('WEBGL_lose_context');
    window.lost.loseContext();
  });
  await until(page, 'the canvas', (s) => !s.isWarped);
  await page.evaluate(() => new Promise((resolve) => {
    document.querySelector('#warp > canvas').addEventListener('webglcontextrestored', resolve);
    window.setTimeout(() => window.lost.restoreContext());
  }));
  daemon.draws = true;
  await page.mouse.move(480, 300);
  await until(page, 'a frame', (s) => s.isIdle && s.seq === s.sent && !s.isWarped);
  daemon.draws = false;
  await page.mouse.move(520, 300);
  await until(page, 'a warp', (s) => s.isIdle && s.isWarped);
  assert.deepEqual((await byDepth(page)).middle, [200, 120, 40]);
  await page.mouse.up();
});

test('both pictures of a comparison follow the hand', async (context) => {
  const it = await setUp(context, 16, { hasDepth: true });
  const { daemon, page } = it;
  await until(page, 'a frame with depth', (s) => s.hasDepth);
  await page.locator('#compare').evaluate((fold) => { fold.open = true; });
  await page.click('#compare-start');
  const asked = (id) => daemon.heard.filter(({ method, params }) => method === 'stream.configure' && params.depth).length >= id;
  await eventually('depth for both', () => asked(2) && [...daemon.streams].filter(({ wantsDepth }) => wantsDepth).length === 2);
  await until(page, 'the second picture at rest', (s) => s.compared?.isAtRest);
  await dragUnseen(it, 3, 520); // beside the panel and the divider
  await until(page, 'two warped pictures', (s) => s.isDrawn && s.isWarped && s.warps > 0 && s.compared.warps > 0);
  const { hidden, middle } = await page.evaluate(() => {
    const layer = document.getElementById('warp-b');
    const copy = new OffscreenCanvas(1, 1).getContext('2d');
    copy.drawImage(layer.lastElementChild, -(layer.lastElementChild.width >> 1), -(layer.lastElementChild.height >> 1));
    return { hidden: layer.hidden, middle: [...copy.getImageData(0, 0, 1, 1).data].slice(0, 3) };
  });
  assert.equal(hidden, false);
  assert.deepEqual(middle, [200, 120, 40]);
  daemon.draws = true;
  await page.mouse.move(570, 300);
  await until(page, 'the frames', (s) => s.isIdle && s.seq === s.sent && !s.isWarped && s.compared.isAtRest);
  assert.equal(await page.evaluate(() => document.getElementById('warp-b').hidden), true);
  await page.mouse.up();
  assert.deepEqual(it.said, []);
});

test('depth is asked for only where the prediction is on', async (context) => {
  const it = await setUp(context, 16, { hasDepth: true });
  const asked = () => it.daemon.heard.filter(({ method, params }) => method === 'stream.configure' && 'depth' in params).map(({ params }) => params.depth);
  await until(it.page, 'a frame with depth', (s) => s.hasDepth);
  const before_ = asked().length;
  const flip = () => it.page.evaluate(() => document.getElementById('warping').click());
  await flip();
  await eventually('the setting', () => asked().length === before_ + 1);
  await dragUnseen(it, 2);
  assert.equal(await it.page.evaluate(() => window.splatd.isWarped), false);
  await it.page.mouse.up();
  await flip();
  await eventually('the setting', () => asked().length === before_ + 2);
  assert.deepEqual(asked().slice(-3), [true, false, true]);
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
