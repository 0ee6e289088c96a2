// SPDX-License-Identifier: Apache-2.0
// Video in the browser: each codec that daemon and browser share shows the same image as a snapshot, through drags, size
// changes and a lost stream. A failed decoder requests a key frame; if none ever works, the page falls back to images.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { startProxy } from '../../bench/serve/proxy.mjs';
import { compare } from '../../support/compare.mjs';
import { coarseDifference, drag, firstFrame, openPage, pixels, rest, share, shot, until } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';
import { decodePng } from '../support/png.mjs';

const VOLUMES = ['--volume', 'demo:engine?size=48'];
// Its views never come to rest, so that frames stay video.
const { browser, daemon: moving } = await share(() => startDaemon([...VOLUMES, '--rest-time', '60']));

async function setUp(context, daemon, format, before_ = () => {}) {
  const opened = await openPage(browser, { viewport: { width: 900, height: 600 } });
  context.after(() => opened.context.close());
  await before_(opened.page);
  await opened.page.goto(daemon.url);
  await firstFrame(opened.page);
  await opened.page.waitForSelector(`#moving option[value=${format}]`, { state: 'attached' });
  await opened.page.evaluate(() => { document.getElementById('moving').closest('details').open = true; });
  await opened.page.selectOption('#moving', format);
  return opened;
}

/** Waits until a video frame of the last view is shown; on a busy machine it may be smaller. */
const lastAsVideo = (page) => until(page, 'the last view as video',
  (s) => s.isIdle && s.videos > 2 && s.seq === s.sent && s.isVideo);

/** Resolves to a snapshot of the session's view from the daemon. */
async function snapshot(page, daemon) {
  const token = new URL(daemon.url).searchParams.get('token');
  const ask = async (target, options = {}) => {
    const answer = await fetch(new URL(target, daemon.url), {
      ...options, headers: { Authorization: `Bearer ${token}`, 'Content-Type': 'application/json' } });
    assert.equal(answer.status, 200);
    return answer;
  };
  const { view } = await (await ask(`/api/v1/sessions/${await page.evaluate(() => window.splatd.session)}`)).json();
  const size = await page.evaluate(() => window.splatd.wanted);
  const answer = await ask('/api/v1/render?format=png', { method: 'POST', body: JSON.stringify({ ...view, size }) });
  return decodePng(Buffer.from(await answer.arrayBuffer()));
}

async function showsTheView(page, daemon) {
  const part = coarseDifference(await pixels(page), await snapshot(page, daemon));
  compare(part, '<', 0.01, `${part} of the image differs from the snapshot`);
}

/** On a busy machine frames are small and their voxels coarse, so this only checks that the last view is shown, not the previous one. */
async function turns(page, daemon, from, to, lastFrame) {
  const before_ = await snapshot(page, daemon);
  await drag(page, from, to, { steps: 30 });
  await lastFrame(page);
  const wanted = await snapshot(page, daemon);
  const shown = await pixels(page);
  const part = coarseDifference(shown, wanted);
  const old = coarseDifference(shown, before_);
  compare(coarseDifference(before_, wanted), '>', 0.06, 'the drag changes the image');
  compare(part, '<', old, `${part} of the image differs from the last view, ${old} from the one before`);
}

for (const format of ['vp9', 'vp8']) {
  test(`${format}: the page shows the view after drags and in another size`, async (context) => {
    const { page, said } = await setUp(context, moving, format);
    await turns(page, moving, [400, 420], [700, 180], lastAsVideo);
    await shot(page, `video-${format}`);
    await page.setViewportSize({ width: 801, height: 569 });
    await until(page, 'the page to apply its new size', (s) => s.wanted[0] === 801 && s.wanted[1] === 569);
    await turns(page, moving, [700, 180], [400, 300], lastAsVideo);
    assert.deepEqual(await page.evaluate(() => window.splatd.errors), []);
    assert.deepEqual(said, []);
  });
}

test('a view at rest is a sharp image, and the chosen format survives a lost stream', async (context) => {
  const daemon = await startDaemon(VOLUMES);
  context.after(() => daemon.stop());
  const { page } = await setUp(context, daemon, 'vp9');
  const videos = () => page.evaluate(() => window.splatd.videos);
  await drag(page, [520, 320], [690, 240], { steps: 30 });
  await rest(page);
  const first = await videos();
  compare(first, '>', 0);
  assert.equal(await page.evaluate(() => window.splatd.isVideo), false);
  await showsTheView(page, daemon);
  await page.reload();
  await firstFrame(page);
  await until(page, 'the choice is back', () => document.getElementById('moving').value === 'vp9');
  await drag(page, [520, 320], [620, 340], { steps: 30 });
  await rest(page);
  compare(await videos(), '>', 0);
});

/** Breaks the decoder of the page: `fails(n)` says whether decoding the n-th video frame, from 1, throws. */
const breakDecoder = (fails) => (page) => page.addInitScript(`(() => {
  const Real = window.VideoDecoder;
  const fails = ${fails};
  let n = 0;
  window.VideoDecoder = class extends Real {
    decode(chunk) {
      if (fails(++n)) throw new Error('broken on purpose');
      super.decode(chunk);
    }
  };
})()`);

test('a decoder that fails once gets a key frame and continues', async (context) => {
  const { page } = await setUp(context, moving, 'vp9', breakDecoder('(n) => n === 3'));
  await turns(page, moving, [400, 420], [700, 180], lastAsVideo);
  await until(page, 'video after the failure', (s) => s.videos > 4);
  await turns(page, moving, [700, 180], [400, 300], lastAsVideo);
  assert.deepEqual(await page.evaluate(() => window.splatd.errors), []);
});

test('when no decoder works, the page falls back to images and says so', async (context) => {
  const { page } = await setUp(context, moving, 'vp9', breakDecoder('() => true'));
  await turns(page, moving, [400, 420], [700, 180], () => until(page, 'images',
    (s) => document.getElementById('moving').value === 'jpeg' && s.isIdle && s.seq === s.sent));
  assert.match((await page.evaluate(() => window.splatd.errors)).join(), /cannot decode the video, images are used instead/);
  assert.equal(await page.evaluate(() => window.splatd.videos), 0);
});

test('automatic: video on a slow network', async (context) => {
  const { port } = new URL(moving.url);
  // Too slow for video of this volume (about 1 kB per small frame), also at the few frames per second of a busy machine.
  const proxy = await startProxy(Number(port), { rttMs: 200, mbit: 0.08 });
  context.after(() => proxy.close());
  const { page, context: own } = await openPage(browser, { viewport: { width: 900, height: 600 } });
  context.after(() => own.close());
  await page.goto(moving.url.replace(`:${port}/`, `:${proxy.port}/`));
  await firstFrame(page);
  await until(page, 'the choice of formats', () => document.getElementById('moving').value === 'auto');
  // The reasons are told while the view moves, at most twice per second.
  const about = () => page.evaluate(() => [...document.querySelectorAll('#status [title]')].map(({ title }) => title).join());
  for (let i = 0; i < 20 && !/the network is too slow for larger images/.test(await about()); i++) {
    await drag(page, i % 2 ? [700, 180] : [400, 420], i % 2 ? [400, 420] : [700, 180], { steps: 60 });
    await lastAsVideo(page);
  }
  assert.match(await about(), /the network is too slow for larger images/);
  assert.deepEqual(await page.evaluate(() => window.splatd.errors), []);
});

test('without WebCodecs the only format is JPEG', async (context) => {
  const { page, context: own } = await openPage(browser);
  context.after(() => own.close());
  await page.addInitScript('delete window.VideoDecoder');
  await page.goto(moving.url);
  await firstFrame(page);
  assert.deepEqual(await page.evaluate(() => [...document.getElementById('moving').options].map((o) => o.value)), ['jpeg']);
});

test('lossless at rest: each pixel on the screen equals that of the daemon, also after a drag', async (context) => {
  const daemon = await startDaemon(VOLUMES);
  context.after(() => daemon.stop());
  const { page, said } = await setUp(context, daemon, 'vp8');
  await rest(page);
  assert.equal(await page.evaluate(() => window.splatd.isLossless), false);
  await page.check('#lossless');
  for (const to of [[500, 300], [600, 200]]) {
    await until(page, 'a lossless frame', (s) => s.isIdle && s.isFinal && s.isLossless && s.seq === s.sent && String(s.size) === String(s.wanted));
    const [shown, wanted] = [await pixels(page), await snapshot(page, daemon)];
    assert.deepEqual([shown.width, shown.height], [wanted.width, wanted.height]);
    let different = 0;
    for (let y = 0; y < wanted.height; y += 1) {
      for (let x = 0; x < wanted.width; x += 1) different += shown.at(x, y).slice(0, 3).some((part, i) => part !== wanted.at(x, y)[i]);
    }
    assert.equal(different, 0);
    await drag(page, [400, 400], to);
  }
  assert.deepEqual(said, []);
});
