// SPDX-License-Identifier: Apache-2.0
// The page with a daemon that misbehaves: it reports every problem, never goes blank, and continues.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { boxOf, firstFrame, openPage, pixels, resize, share, shot, until } from '../support/browser.mjs';
import { MockDaemon, frameMessage, volume } from '../support/mock-daemon.mjs';

const { browser } = await share();

async function setUp(context, options = {}, { address = (d) => d.url, page: pageOptions } = {}) {
  const daemon = await MockDaemon.start(options);
  const opened = await openPage(browser, pageOptions);
  const it = { daemon, ...opened };
  context.after(async () => {
    await opened.context.close();
    await it.daemon.kill().catch(() => {});
  });
  await it.page.goto(address(daemon));
  it.banner = (text) => it.page.locator('#banner', { hasText: text }).waitFor();
  it.notice = (text) => it.page.locator('#notice', { hasText: text }).waitFor();
  return it;
}

const middle = (image) => image.at(image.width >> 1, image.height >> 1);

test('a frame fills the whole window and is acknowledged; the token is removed from the address', async (context) => {
  const it = await setUp(context);
  await firstFrame(it.page);
  await until(it.page, 'full size', (s) => String(s.size) === String(s.wanted));
  assert.deepEqual(middle(await pixels(it.page)), [200, 120, 40]);
  assert.equal(new URL(it.page.url()).search, '');
  assert.ok(it.daemon.heard.some((m) => m.method === 'stream.ack'));
  assert.ok(await it.page.locator('#banner').isHidden());
  await it.page.reload();
  await firstFrame(it.page);
  assert.equal(it.daemon.sessions.size, 1, 'a reload returns to the session');
  assert.deepEqual(it.said, []);
});

test('without a token, and with a wrong one, the page asks for it', async (context) => {
  const it = await setUp(context, {}, { address: (d) => d.base });
  await it.banner('A token is needed');
  await it.page.fill('#token-input', 'wrong');
  await it.page.click('#token-form button');
  await it.banner('The token is not valid');
  await shot(it.page, 'token');
  await it.page.fill('#token-input', it.daemon.url);
  await it.page.click('#token-form button');
  await firstFrame(it.page);
  assert.ok(await it.page.locator('#banner').isHidden());
});

test('the page reports no volume, the progress of a loading volume, and the reason of a failed one', async (context) => {
  const it = await setUp(context, { volumes: [] });
  await it.banner('No volume is loaded');
  it.daemon.volumes = [volume('slow', { state: 'loading', progress: 0.4 })];
  await it.banner('Loading slow');
  await until(it.page, 'progress', () => document.getElementById('banner-progress').value === 0.4);
  await shot(it.page, 'loading');
  it.daemon.volumes = [volume('broken', { state: 'failed', reason: 'broken.nrrd: byte 112: "sizes" says 0' })];
  await it.banner('broken could not be loaded');
  await it.banner('byte 112');
  it.daemon.volumes.push(volume('phantom'));
  await firstFrame(it.page);
  await it.page.locator('#volumes button[data-state="failed"]', { hasText: 'byte 112' }).waitFor();
});

test('frames that decode out of order and frames that cannot be decoded are handled', async (context) => {
  const it = await setUp(context);
  await firstFrame(it.page);
  let isSent = false;
  it.daemon.script = (stream) => {
    if (stream.seq === 0 || isSent) return []; // the page still configures the stream
    isSent = true;
    const first = stream.frame + 1;
    stream.frame += 4;
    return [
      frameMessage({ frame: first, seq: stream.seq, width: 1200, height: 900, color: [1, 2, 3] }),
      frameMessage({ frame: first + 1, seq: stream.seq, payload: Buffer.from('not a PNG at all') }),
      Buffer.from('SPF1 but short'),
      frameMessage({ frame: first + 3, seq: stream.seq, color: [10, 200, 30] }),
    ];
  };
  await it.page.keyboard.press('ArrowLeft');
  await until(it.page, 'the newest frame', (s) => s.sent > 0 && s.seq === s.sent && s.frame >= 4);
  await until(it.page, 'both faults', (s) => s.errors.length === 2);
  await until(it.page, 'all acknowledged', (s) => s.isIdle);
  assert.deepEqual(middle(await pixels(it.page)), [10, 200, 30]);
  const errors = await it.page.evaluate(() => window.splatd.errors);
  assert.ok(errors.some((e) => e.includes('could not be decoded')));
  assert.ok(errors.some((e) => e.includes('shorter than its header')));
  assert.equal(await it.page.evaluate(() => window.splatd.state), 'live');
});

test('a refused change is explained beside its control, and the page returns to the view of the daemon', async (context) => {
  const it = await setUp(context);
  await firstFrame(it.page);
  it.daemon.answer = (method, params) => {
    if (method !== 'view.update' || !params.patch.filter) return null;
    throw Object.assign(new Error('"swan" is not supported by this backend'), { code: -32001, pointer: '/filter/mode' });
  };
  await it.page.evaluate(() => { document.getElementById('expert').open = true; });
  await it.page.selectOption('#filter', 'swan');
  await it.page.locator('[data-pointer="/filter/mode"] + .complaint', { hasText: 'is not supported' }).waitFor();
  await until(it.page, 'the filter as before', () => document.getElementById('filter').value === 'adaptive');
  assert.equal(await it.page.getAttribute('#filter', 'aria-invalid'), 'true');
  assert.ok(await it.page.locator('#notice').isHidden());
  await it.page.locator('#shading').click();
  assert.equal(await it.page.locator('.complaint').count(), 0, 'the next change removes the message');
  assert.equal(await it.page.getAttribute('#filter', 'aria-invalid'), null);
  assert.deepEqual(it.said, []);
});

test('a refused change without a visible control is explained in a notice', async (context) => {
  const it = await setUp(context);
  await firstFrame(it.page);
  it.daemon.answer = (method) => {
    if (method !== 'view.update') return null;
    throw Object.assign(new Error('too near'), { code: -32000, pointer: '/camera/near' });
  };
  await it.page.keyboard.press('ArrowLeft');
  await it.notice('too near (/camera/near)');
  it.daemon.answer = (method) => {
    if (method !== 'view.update') return null;
    throw Object.assign(new Error('no clipping'), { code: -32001, pointer: '/clip/planes/0/normal' });
  };
  await it.page.keyboard.press('ArrowLeft');
  await it.notice('no clipping (/clip/planes/0/normal)'); // its panel is closed
  await it.page.locator('#clip summary').click();
  await it.page.locator('#plane-sight').click();
  await it.page.locator('#clip-planes .complaint', { hasText: 'no clipping' }).waitFor();
  await until(it.page, 'no plane', () => document.querySelectorAll('#planes li').length === 0);
});

test('with a daemon that does not report roles, the first refused change tells the page that it may only watch', async (context) => {
  const it = await setUp(context);
  await firstFrame(it.page);
  it.daemon.answer = (method) => {
    if (method !== 'view.update') return null;
    throw Object.assign(new Error('this token may watch; changing the view needs the control token'), { code: -32004 });
  };
  const [session] = it.daemon.sessions.values();
  await it.page.keyboard.press('ArrowLeft');
  await it.notice('control token');
  await until(it.page, 'the camera as before',
    `(s) => String(s.camera.position) === '${session.view.camera.position}' && s.isIdle`);
});

test('a failed render is reported, and the next frame removes the message', async (context) => {
  const it = await setUp(context);
  await firstFrame(it.page);
  // No frame may be in flight: it would remove the message before the test sees it.
  it.daemon.draws = false;
  const sent = Math.max(...[...it.daemon.streams].map((stream) => stream.frame));
  await until(it.page, 'all frames to be drawn', `(s) => s.frame === ${sent}`);
  it.daemon.notifyAll('render.error', { code: -32006, message: 'out of memory', pointer: '' });
  await it.notice('out of memory');
  it.daemon.draws = true;
  await it.page.keyboard.press('ArrowLeft');
  await it.page.locator('#notice').waitFor({ state: 'hidden' });
});

test('updates wait for a slow daemon, and the last view always arrives', async (context) => {
  const it = await setUp(context);
  await firstFrame(it.page);
  it.daemon.draws = false;
  for (let i = 0; i < 40; i += 1) await it.page.keyboard.press('ArrowLeft');
  await until(it.page, 'all answered', (s) => s.isIdle && s.sent > 0);
  const updates = it.daemon.heard.filter((m) => m.method === 'view.update');
  updates.forEach((m, i) => assert.equal(m.params.seq, i + 1));
  assert.deepEqual(Object.keys(updates.at(-1).params.patch), ['camera']);
  const last = await it.page.evaluate(() => window.splatd.camera);
  assert.deepEqual(updates.at(-1).params.patch.camera.position, last.position);
});

test('the page follows changes of another participant; a watching guest is told that it may not change the view', async (context) => {
  const it = await setUp(context);
  await firstFrame(it.page);
  const [session] = it.daemon.sessions.values();
  it.daemon.notifyAll('view.changed', { view: { ...session.view, background: [1, 1, 1, 1] } });
  await until(it.page, 'the new background', (s) => s.background[0] === 1);
  // Another change comes while an update of the page has no answer yet.
  it.daemon.answer = (method) => {
    if (method !== 'view.update') return;
    it.daemon.answer = null;
    session.view = { ...session.view, background: [0, 1, 0, 1] };
    it.daemon.notifyAll('view.changed', { view: session.view });
  };
  await it.page.keyboard.press('ArrowLeft');
  await until(it.page, 'the background of the other change', (s) => s.background[1] === 1 && s.background[0] === 0);
  const guest = await openPage(browser);
  context.after(() => guest.context.close());
  await guest.page.goto(`${it.daemon.base}?session=${session.id}&token=${session.tokens.view}`);
  await firstFrame(guest.page);
  assert.equal(new URL(guest.page.url()).search, `?session=${session.id}`);
  assert.deepEqual(await guest.page.locator('#volumes button').evaluateAll((all) => all.map(({ dataset }) => dataset.id)), ['phantom'], 'the volume of the session, without its close button');
  await guest.page.locator('#status', { hasText: 'watching' }).waitFor();
  await guest.page.locator('#picture-section[inert]').waitFor();
  const updates = () => it.daemon.heard.filter((m) => m.method === 'view.update').length;
  const before_ = updates(); // the host frames the default view beside its panel
  await guest.page.keyboard.press('ArrowLeft');
  assert.deepEqual((await guest.page.evaluate(() => window.splatd.camera)).position, session.view.camera.position);
  assert.equal(updates(), before_);
  assert.equal(it.daemon.sessions.size, 1);
});

test('the daemon drains, vanishes and comes back', async (context) => {
  const it = await setUp(context);
  await firstFrame(it.page);
  it.daemon.notifyAll('server.draining');
  await it.banner('shutting down');
  const { port } = it.daemon;
  await it.daemon.kill();
  await it.banner('Connection lost — trying again');
  await shot(it.page, 'lost');
  assert.deepEqual(middle(await pixels(it.page)), [200, 120, 40], 'the last frame stays visible');
  it.daemon = await MockDaemon.start({ port, color: () => [20, 30, 220] });
  await until(it.page, 'live again', (s) => s.state === 'live');
  await until(it.page, 'a new frame', (s) => s.frame >= 1 && s.seq === 0);
  await it.page.locator('#banner').waitFor({ state: 'hidden' });
  await until(it.page, 'drawn', () => {
    const canvas = document.getElementById('screen');
    const [r, , b] = canvas.getContext('2d').getImageData(canvas.width >> 1, canvas.height >> 1, 1, 1).data;
    return r === 20 && b === 220;
  });
});

test('the page works below a path of a reverse proxy and on a phone', async (context) => {
  const it = await setUp(context, { prefix: '/lab/volumes' }, {
    page: { viewport: { width: 390, height: 780 }, deviceScaleFactor: 3, isMobile: true, hasTouch: true },
  });
  await firstFrame(it.page);
  assert.equal(new URL(it.page.url()).pathname, '/lab/volumes/');
  const wanted = await it.page.evaluate(() => window.splatd.wanted);
  assert.equal(Math.max(...wanted), 2048, `${wanted}`);
  const panel = await boxOf(it.page.locator('#panel'));
  compare(Math.abs(wanted[0] / wanted[1] - 390 / panel.y), '<', 0.01); // the picture ends where the sheet begins
  assert.equal(await it.page.evaluate(() => document.scrollingElement.scrollWidth > window.innerWidth), false);
  await shot(it.page, 'phone');
  await it.page.tap('#panel-toggle');
  await it.page.locator('#volumes button').first().waitFor();
  await shot(it.page, 'phone-panel');
});

test('a long list of volumes scrolls inside the panel and shows the current one', async (context) => {
  const volumes = [...['x', 'y', 'z'].map((id) => volume(id, { state: 'failed', reason: `no ${id}`, may_close: true })), ...Array.from({ length: 30 }, (_, i) => volume(`v${i}`))];
  const { page, daemon } = await setUp(context, { volumes }, { address: (d) => `${d.url}&volume=v20`, page: { viewport: { width: 1280, height: 800 } } });
  const current = page.locator('#volumes [aria-current][data-id="v20"]');
  await current.waitFor();
  assert.ok(await current.evaluate((button) => {
    const [inner, outer] = [button, document.getElementById('volumes')].map((element) => element.getBoundingClientRect());
    return inner.top >= outer.top && inner.bottom <= outer.bottom;
  }));
  await shot(page, 'volumes-many');
  compare((await boxOf(page.locator('#transfer'))).y, '<', 500);
  const rows = () => page.evaluate(() => {
    const list = document.getElementById('volumes').getBoundingClientRect();
    return [...document.querySelectorAll('#volumes .pick')].filter((pick) => pick.checkVisibility() && pick.getBoundingClientRect().bottom <= list.bottom && pick.getBoundingClientRect().top >= list.top).length;
  });
  const before_ = await rows();
  compare(before_, '>=', 7);
  await page.evaluate(() => { for (const fold of document.querySelectorAll('#panel-body > details')) fold.open = false; });
  await resize(page, { width: 1280, height: 1300 });
  await until(page, 'more rows', `() => document.getElementById('volumes').offsetHeight > 500`);
  compare(await rows(), '>', before_, 'the list takes what the panel leaves');

  assert.equal(await page.locator('#volumes > li').first().innerText().then((text) => text.split('\n')[0]), 'v0', 'open volumes come first');
  assert.ok(await page.locator('#volumes [data-id="x"]').isHidden(), 'failed loads are folded');
  await page.click('#volumes .failures summary');
  await page.locator('#volumes .about', { hasText: 'no y' }).waitFor();
  await page.fill('#volumes-filter', 'V2');
  assert.equal(await page.locator('#volumes .pick').count(), 11);
  await page.fill('#volumes-filter', 'nothing');
  await page.locator('#volumes', { hasText: 'No volume matches' }).waitFor();
  await page.fill('#volumes-filter', '');
  await page.click('#volumes [data-id="failures"]');
  await page.locator('#volumes .failures').waitFor({ state: 'detached' });
  assert.deepEqual(daemon.volumes.map(({ id }) => id).filter((id) => !id.startsWith('v')), []);
});

test('a volume without a finite number says why the picture is empty', async (context) => {
  const volumes = [volume('good', { nonfinite: 131071 }), volume('bad', { name: 'bad.nrrd', nonfinite: 131072 })];
  const it = await setUp(context, { volumes });
  await firstFrame(it.page);
  await it.page.locator('#volumes [aria-current][data-id="good"]').waitFor();
  assert.ok(await it.page.locator('#notice').isHidden(), 'one sample has a value');
  await it.page.click('#volume-info summary');
  const facts = it.page.locator('#volume-info dl');
  await facts.locator(':text("0 to 255")').waitFor();
  await it.page.click('#volumes [data-id="bad"]');
  await it.notice('No value of bad.nrrd is a finite number');
  await facts.locator(':text("131072")').waitFor();
  assert.doesNotMatch(await facts.innerText(), /0 to 255/);
  await it.page.click('#volumes [data-id="good"]');
  await it.page.locator('#notice').waitFor({ state: 'hidden', timeout: 7000 }); // sooner than by itself
});

test('the noise of a volume is told with its unit; not if it is unknown or 0', async (context) => {
  const fields = [{ name: '', components: 1, type: 'int16', range: [-1000, 1560], unit: 'HU' }];
  const volumes = [volume('scan', { range: [-1000, 1560], noise: 33.4, fields }), volume('plain', { noise: 2.04 }), volume('exact', { noise: 0 }), volume('large', { noise: null })];
  const it = await setUp(context, { volumes });
  await firstFrame(it.page);
  await it.page.click('#volume-info summary');
  const facts = it.page.locator('#volume-info dl');
  for (const [id, noise] of [['scan', '33 HU'], ['exact', null], ['plain', '2'], ['large', null]]) {
    await it.page.click(`#volumes [data-id="${id}"]`);
    await facts.locator(`dd:text-is("${id}")`).first().waitFor();
    const rows = facts.locator('div', { has: it.page.locator('dt:text-is("Noise")') });
    assert.deepEqual(await rows.locator('dd').allTextContents(), noise ? [noise] : [], id);
  }
});

test('volumes of the same name are told apart, and long names stay inside of the panel', async (context) => {
  const long = ['x'.repeat(127), '\u0645\u062c\u0645\u0648\u0639\u0629'.repeat(10), '\u4f53\u7d20'.repeat(30)];
  const { page } = await setUp(context, {
    volumes: [volume('head', { source: '2024/head.nrrd' }), volume('head-2', { name: 'head', source: '2025/head.nrrd' }), volume('engine'),
      ...long.map((name, i) => volume(`long-${i}`, { name }))],
  });
  const entries = page.locator('#volumes button.pick');
  await entries.nth(5).waitFor();
  assert.match(await entries.nth(0).innerText(), /2024/);
  assert.match(await entries.nth(1).innerText(), /2025/);
  assert.doesNotMatch(await entries.nth(2).innerText(), /engine.*engine/s);
  assert.equal(await entries.nth(1).locator('.name').getAttribute('title'), 'head (2025)');
  for (const viewport of [{ width: 900, height: 600 }, { width: 390, height: 844 }]) {
    await resize(page, viewport);
    const wide = await page.evaluate(() => [...document.querySelectorAll('#panel *')].filter((element) => element.scrollWidth > element.clientWidth + 1
      && getComputedStyle(element).overflowX === 'visible' && element.clientWidth > 0).map((element) => element.id || element.className));
    assert.deepEqual(wide, []);
  }
});

const PARTS = (name) => `**/app/parts/${name}.js`;

/** A page whose part `name` is answered by `answer`, with a frame and all other parts. */
async function setUpPart(context, name, answer) {
  const daemon = await MockDaemon.start();
  const opened = await openPage(browser, { viewport: { width: 1400, height: 800 } });
  context.after(async () => {
    await opened.context.close();
    await daemon.kill().catch(() => {});
  });
  await opened.page.route(PARTS(name), answer);
  await opened.page.goto(daemon.url);
  await until(opened.page, 'a frame', (s) => s.state === 'live' && s.count > 0);
  return { ...opened, prompt: opened.page.locator('.prompt[data-id^="part-"]'), fold: (id) => opened.page.locator(`#${id}`) };
}

test('a part that cannot be loaded says so where it is missing, and loads when the user tries again', async (context) => {
  const { page, prompt, fold } = await setUpPart(context, 'compare', (route) => route.abort());
  await page.evaluate(() => { document.getElementById('compare').open = true; });
  await fold('compare').locator('.part-note', { hasText: 'A part of the page could not be loaded' }).waitFor();
  assert.equal(await fold('compare').getAttribute('aria-busy'), 'true');
  await shot(page, 'part-missing');
  await page.click('#tool-compare');
  await prompt.filter({ hasText: 'A part of the page could not be loaded' }).waitFor();
  assert.equal(await prompt.getAttribute('role'), 'alert');
  await page.unroute(PARTS('compare'));
  await prompt.getByRole('button', { name: 'Try again' }).click();
  await until(page, 'the comparison', (s) => s.isComplete && s.compared);
  assert.equal(await prompt.count(), 0);
  assert.equal(await fold('compare').locator('.part-note').count(), 0);
  assert.equal(await fold('compare').getAttribute('aria-busy'), null);
});

test('a part that takes long says that it loads; what the user pressed happens when it is there', async (context) => {
  let go;
  const held = new Promise((resolve) => { go = resolve; });
  const { page, prompt, fold, said } = await setUpPart(context, 'compare', async (route) => {
    await held;
    await route.continue();
  });
  await page.evaluate(() => { document.getElementById('compare').open = true; });
  await fold('compare').locator('.part-note[role="status"]', { hasText: 'Loading …' }).waitFor();
  await page.click('#tool-compare');
  await prompt.filter({ hasText: 'Loading …' }).waitFor();
  await shot(page, 'part-loading');
  go();
  await until(page, 'the comparison', (s) => s.isComplete && s.compared);
  assert.equal(await prompt.count(), 0);
  assert.deepEqual(said, []);
});

test('a part of another build is refused, and the page can be loaded again', async (context) => {
  const { page, prompt } = await setUpPart(context, 'compare', (route) => route.fulfill({
    contentType: 'text/javascript', body: "export const texts = {}, features = [], build = 'another';",
  }));
  await page.click('#tool-compare');
  await prompt.filter({ hasText: 'the daemon serves another version of the page now' }).waitFor();
  assert.equal(await prompt.getByRole('button', { name: 'Try again' }).count(), 0);
  await page.unroute(PARTS('compare'));
  await prompt.getByRole('button', { name: 'Load the page again' }).click();
  await firstFrame(page);
});
