// SPDX-License-Identifier: Apache-2.0
// Comparison with a second picture, and the panel of the status line, with the real daemon.
import assert from 'node:assert/strict';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { test } from 'node:test';
import { boxOf, checkAxe, difference, drag, firstFrame, NEEDS_AXE, openPage, pixels, rest, share, shot, until, visit } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';
import { decodePng } from '../support/png.mjs';

const folder = mkdtempSync(path.join(tmpdir(), 'splatd-compare-'));
const FAR = path.join(folder, 'far.nrrd'); // a volume that a camera of the others does not show
writeFileSync(FAR, Buffer.concat([Buffer.from('NRRD0004\ntype: uint8\ndimension: 3\nspace dimension: 3\nsizes: 8 8 8\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n'
  + 'space origin: (5000,0,0)\nencoding: raw\n\n'), Buffer.from({ length: 512 }, (_, i) => i)]));
// One solid in two anatomical worlds, without symmetry: B would show another side of it under the same camera.
const solid = Buffer.from(Array.from({ length: 4096 }, (_, i) => {
  const [x, y, z] = [i % 16, (i >> 4) % 16, i >> 8];
  return x > 2 && y > 2 && z > 2 && x < 14 && y < 8 + (x >> 1) && z < 6 + (x >> 2) + (y >> 1) ? 250 : 0;
}));
const [LPS, RAS] = [['lps', 1], ['ras', -1]].map(([space, sign]) => {
  const file = path.join(folder, `${space}.nrrd`);
  writeFileSync(file, Buffer.concat([Buffer.from(`NRRD0004\ntype: uint8\ndimension: 3\nspace: ${space.toUpperCase()}\nsizes: 16 16 16\n`
    + `space directions: (${sign},0,0) (0,${sign},0) (0,0,1)\nspace origin: (${40 * sign},0,0)\nencoding: raw\n\n`), solid]));
  return file;
});
const { browser, daemon } = await share(() => startDaemon(['--volume', 'demo:engine?size=32', '--volume', 'demo:phantom?size=32', '--volume', FAR,
  '--volume', LPS, '--volume', RAS,
  '--backend', 'cpu', '--sessions', '24']), () => rmSync(folder, { recursive: true }));

async function open(context, options = { viewport: { width: 700, height: 500 } }, url = daemon.url) {
  const opened = await visit(context, browser, url, options);
  await rest(opened.page);
  return opened;
}

async function other(page) {
  const url = await page.evaluate(() => document.getElementById('screen-b').toDataURL('image/png'));
  return decodePng(Buffer.from(url.slice(url.indexOf(',') + 1), 'base64'));
}

/** True if something is drawn in the middle of a picture. */
const isLit = ({ width, height, at }) => Array.from({ length: height }, (_, y) => at(Math.floor(width / 2), y)).some(([r, g, b]) => r + g + b > 60);

/** Waits until both pictures are at rest; returns the fraction of pixels in which they differ. */
async function compared(page) {
  await rest(page);
  await until(page, 'the second picture at rest', (s) => s.compared?.isAtRest);
  return difference(await pixels(page), await other(page));
}

// The toolbar of a narrow window has the button in its menu; the section always has one.
async function begin(page) {
  await page.locator('#compare').evaluate((fold) => { fold.open = true; });
  await page.click('#compare-start');
}

const sessions = (page) => page.evaluate(async () => {
  const token = sessionStorage.getItem(Object.keys(sessionStorage).find((key) => key.endsWith('/token')));
  return (await (await fetch('api/v1/sessions', { headers: { Authorization: `Bearer ${token}` } })).json()).sessions.map(({ id }) => id);
});

test('B follows the camera of A, and differs by its settings alone', async (context) => {
  const { page, said } = await open(context);
  await begin(page);
  assert.equal(await compared(page), 0, 'a copy of now is the same picture');
  const id = (await page.evaluate(() => window.splatd.compared)).id;
  await drag(page, [450, 200], [560, 260]);
  assert.equal(await compared(page), 0, 'the same camera after a drag');

  await page.locator('#picture').evaluate((fold) => { fold.open = true; });
  await page.click('#picture .swatches button[data-color="#ffffff"]');
  assert.ok(await compared(page) > 0.2, 'only A has the new background');
  await page.locator('#compare').evaluate((fold) => { fold.open = true; });
  await page.click('#compare-swap');
  await until(page, 'the swap', (s) => s.isIdle && s.background[0] === 0 && s.compared.view.background[0] === 1);
  assert.ok(await compared(page) > 0.2);
  await page.click('#compare-copy');
  assert.equal(await compared(page), 0, 'A was copied to B');
  await shot(page, 'compare-divider');

  assert.ok((await sessions(page)).includes(id));
  await page.click('#compare-end');
  await page.locator('#screen-b').waitFor({ state: 'detached' });
  while ((await sessions(page)).includes(id));
  assert.deepEqual(said, []);
});

test('the divider moves by keys and by the pointer', async (context) => {
  const { page } = await open(context, { viewport: { width: 900, height: 600 } });
  await begin(page);
  await until(page, 'the second picture', (s) => s.compared?.isAtRest);
  const divider = page.locator('#compare-divider');
  const value = async () => Number(await divider.getAttribute('aria-valuenow'));
  assert.equal(await value(), 50);
  await divider.focus();
  const press = async (...keys) => {
    for (const [key, wanted] of keys) {
      await page.keyboard.press(key);
      assert.equal(await value(), wanted, key);
    }
  };
  await press(['ArrowLeft', 48], ['ArrowLeft', 46], ['ArrowLeft', 44], ['ArrowLeft', 42]);
  const [panel, name] = await Promise.all(['#panel', '.compare-badge[data-side="a"]'].map((part) => boxOf(page.locator(part))));
  assert.ok(name.x >= panel.x + panel.width, `the name of A at ${name.x} px is covered by the panel`);
  await press(['PageUp', 52], ['Home', 0], ['End', 100], ['ArrowLeft', 98]);
  const clip = () => page.locator('#screen-b').evaluate((canvas) => canvas.style.clipPath);
  assert.match(await clip(), / 98%/);
  const stage = await boxOf(page.locator('#pane-3d'));
  const box = await boxOf(divider);
  await drag(page, [box.x + box.width / 2, 250], [stage.x + stage.width / 4, 250]);
  assert.ok(Math.abs(await value() - 25) <= 1, `${await value()} %`);
});

test('side by side, both panes have the same size and either turns the camera', async (context) => {
  const { page } = await open(context, { viewport: { width: 1201, height: 600 } });
  await page.locator('#compare').evaluate((fold) => { fold.open = true; });
  await page.selectOption('#compare-mode', 'side');
  await page.locator('#compare').evaluate((fold) => { fold.open = false; });
  await page.click('#tool-compare');
  assert.equal(await compared(page), 0);
  await page.locator('#compare-end').waitFor(); // the section opens
  await page.locator('#cube-b').waitFor();
  assert.equal(await page.locator('#cube-b .face:not([hidden])').allTextContents().then(String), await page.locator('#cube .face:not([hidden])').allTextContents().then(String));
  const boxes = await Promise.all(['#screen', '#screen-b'].map((name) => boxOf(page.locator(name))));
  assert.ok(Math.abs(boxes[0].width - boxes[1].width) <= 1 && boxes[0].height === boxes[1].height, JSON.stringify(boxes));
  const before_ = await page.evaluate(() => window.splatd.camera);
  const [, b] = boxes;
  await drag(page, [b.x + b.width / 2, b.y + b.height / 2], [b.x + b.width / 2 + 80, b.y + b.height / 2]);
  assert.equal(await compared(page), 0);
  assert.notDeepEqual(await page.evaluate(() => window.splatd.camera), before_);
  await shot(page, 'compare-side');
  await page.locator('#slices').evaluate((fold) => { fold.open = true; });
  await page.selectOption('#slices-mode', 'orthogonal');
  await rest(page);
  const outlines = () => page.locator('#overlay .slice-outline:visible').count();
  assert.equal(await outlines(), 0, 'outlines would mark A alone');
  await page.click('#compare-end');
  await until(page, 'one pane', (s) => s.layout === '3d');
  await page.locator('#overlay .slice-outline').first().waitFor();
  assert.equal(await outlines(), 12, 'they come back');
});

test('another volume is compared, fitted if it lies elsewhere, and a daemon without a free session says so', async (context) => {
  const { page } = await open(context);
  await page.locator('#compare').evaluate((fold) => { fold.open = true; });
  await page.selectOption('#compare-source', 'volume:phantom');
  await page.click('#compare-start');
  assert.ok(await compared(page) > 0.05);
  assert.equal(await page.evaluate(() => window.splatd.compared.view.volume), 'phantom');
  await page.locator('.compare-badge[data-side="b"]', { hasText: 'phantom' }).waitFor();
  await page.click('#compare-swap');
  await until(page, 'the swap', (s) => s.isIdle && s.volume === 'phantom' && s.compared.view.volume === 'engine');
  assert.equal(await page.locator('#compare-source').inputValue(), 'volume:engine');
  await page.click('#compare-swap');
  await until(page, 'the swap back', (s) => s.isIdle && s.volume === 'engine' && s.compared.view.volume === 'phantom');
  assert.equal(await page.locator('#compare-source').inputValue(), 'volume:phantom');

  // A volume at another place is fitted; without that the page says that B shows nothing.
  assert.ok(!await page.isChecked('#compare-fit'));
  assert.ok(await page.locator('#compare-lost').isHidden());
  await page.selectOption('#compare-source', 'volume:far');
  await until(page, 'the other volume', (s) => s.compared.isAtRest && s.compared.view.volume === 'far');
  assert.ok(await page.isChecked('#compare-fit'));
  const isShown = async () => {
    await until(page, 'the second picture', (s) => s.compared.isAtRest);
    return isLit(await other(page));
  };
  assert.ok(await isShown());
  await page.setChecked('#compare-fit', false);
  await page.locator('#compare-lost', { hasText: 'The camera shows nothing of far' }).waitFor();
  assert.ok(!await isShown());
  await shot(page, 'compare-lost');
  await page.selectOption('#compare-mode', 'side');
  assert.ok(await page.locator('#pane-compare #compare-lost').isVisible());
  await page.selectOption('#compare-mode', 'divider');
  await page.click('#compare-lost-fit');
  await page.locator('#compare-lost').waitFor({ state: 'hidden' });
  assert.ok(await page.isChecked('#compare-fit'));
  assert.ok(await isShown());

  // Swap keeps how each volume is seen, also after the end.
  await compared(page);
  const [a, b] = [await pixels(page), await other(page)];
  await page.click('#compare-swap');
  await until(page, 'the swap', (s) => s.isIdle && s.volume === 'far' && s.compared.view.volume === 'engine');
  await compared(page);
  assert.ok(difference(await pixels(page), b) < 0.01);
  assert.ok(difference(await other(page), a) < 0.01);
  await page.click('#compare-end');
  await rest(page);
  assert.ok(difference(await pixels(page), b) < 0.01);
  await page.route('**/api/v1/sessions', (route) => route.fulfill({
    status: 429, headers: { 'Retry-After': '1', 'Content-Type': 'application/problem+json' }, body: '{"title":"x","status":429,"detail":"4 sessions are open"}' }));
  await page.click('#compare-start');
  await page.locator('#compare-note', { hasText: '4 sessions are open' }).waitFor();
  assert.ok(await page.isVisible('#compare-start'));
});

test('volumes with anatomical letters are seen from the same side', async (context) => {
  const { page } = await open(context, undefined, `${daemon.url}&volume=lps`);
  await page.locator('#compare').evaluate((fold) => { fold.open = true; });
  await page.selectOption('#compare-source', 'volume:ras');
  await page.click('#compare-start');
  await page.locator('#compare-fit').waitFor();
  assert.ok(await compared(page) < 0.01, 'one solid in two worlds');
  await shot(page, 'compare-anatomy');
  assert.ok(!await page.isChecked('#compare-fit'), 'it lies at the same place of both');
  await drag(page, [450, 200], [560, 260]);
  assert.ok(await compared(page) < 0.01, 'turned');
  await page.setChecked('#compare-fit', true);
  assert.ok(await compared(page) < 0.01, 'fitted');
  assert.ok(isLit(await pixels(page)), 'there is a picture');
});

test('B can be any volume but that of A, whose measurements end at the divider', async (context) => {
  const { page } = await open(context, { viewport: { width: 1000, height: 600 } });
  await page.locator('#compare').evaluate((fold) => { fold.open = true; });
  const volumes = () => page.locator('#compare-source option[value^="volume:"]').evaluateAll((options) => options.map(({ value }) => value.slice(7)));
  assert.deepEqual(await volumes(), ['phantom', 'far', 'lps', 'ras']);
  const { x, y, width, height } = await boxOf(page.locator('#screen'));
  await page.keyboard.press('d');
  await drag(page, [x + width * 0.45, y + height / 2], [x + width * 0.6, y + height / 2]);
  await until(page, 'the measurement', (s) => s.measures.length === 1);
  await page.keyboard.press('Escape');
  await page.click('#compare-start');
  await compared(page);
  const isDrawn = (share, wanted) => until(page, `${share}: ${wanted}`,
    `() => Boolean(document.elementFromPoint(${x + width * share}, ${y + height / 2}).closest('.measures')) === ${wanted}`);
  await isDrawn(0.46, true);
  await isDrawn(0.58, true); // B shows the same volume
  await page.selectOption('#compare-source', 'volume:phantom');
  await until(page, 'the other volume', (s) => s.compared.isAtRest && s.compared.view.volume === 'phantom');
  await isDrawn(0.58, false);
  await isDrawn(0.46, true);
  await shot(page, 'compare-measure');
  await page.locator('#compare-divider').press('End');
  await isDrawn(0.58, true);
  await page.selectOption('#compare-mode', 'side');
  await page.selectOption('#compare-mode', 'divider');
  await page.click('#compare-swap');
  await until(page, 'the swap', (s) => s.isIdle && s.volume === 'phantom');
  assert.deepEqual(await volumes(), ['engine', 'far', 'lps', 'ras']);
  await page.locator('#volumes-section').evaluate((fold) => { fold.open = true; });
  await page.click('#volumes button[data-id="far"]');
  assert.deepEqual(await volumes(), ['engine', 'phantom', 'lps', 'ras']);
  assert.equal(await page.locator('#compare-source').inputValue(), 'volume:engine');
  await page.click('#volumes button[data-id="engine"]');
  assert.deepEqual(await volumes(), ['phantom', 'far', 'lps', 'ras']);
  assert.equal(await page.locator('#compare-source').inputValue(), 'copy', 'both show one volume');
});

const api = (path, token, method = 'GET') => fetch(`${new URL(daemon.url).origin}/api/v1/${path}`, { method, headers: { Authorization: `Bearer ${token}` } });

test('a guest ends the session of its comparison, at the end and with the page, and no other', async (context) => {
  const { page } = await open(context);
  const id = await page.evaluate(() => window.splatd.session);
  const token = new URL(daemon.url).searchParams.get('token');
  const { tokens } = await (await api(`sessions/${id}`, token)).json();
  const refused = await api(`sessions/${id}`, tokens.control, 'DELETE');
  assert.equal(refused.status, 403);
  assert.match((await refused.json()).detail, /only the token that created/);
  for (const way of ['end', 'close']) {
    const guest = await openPage(browser, { viewport: { width: 700, height: 500 } });
    context.after(() => guest.context.close());
    await guest.page.goto(`${new URL(daemon.url).origin}/#session=${id}&token=${tokens.control}`);
    await firstFrame(guest.page);
    await begin(guest.page);
    await until(guest.page, 'the second picture', (s) => s.compared?.isAtRest);
    const other = (await guest.page.evaluate(() => window.splatd.compared)).id;
    assert.ok((await sessions(page)).includes(other));
    if (way === 'end') await guest.page.click('#compare-end');
    else await guest.page.close({ runBeforeUnload: false });
    while ((await sessions(page)).includes(other));
    assert.ok((await sessions(page)).includes(id));
  }
});

test('closing the volume of B ends the comparison with a message, and A stays', async (context) => {
  const { page } = await open(context);
  await page.locator('#compare').evaluate((fold) => { fold.open = true; });
  await page.selectOption('#compare-source', 'volume:phantom');
  await page.click('#compare-start');
  await until(page, 'the second picture', (s) => s.compared?.isAtRest);
  const token = new URL(daemon.url).searchParams.get('token');
  assert.equal((await api('volumes/phantom', token, 'DELETE')).status, 204);
  await page.locator('#compare-note', { hasText: /ended|closed|unloaded/ }).waitFor();
  await until(page, 'A alone', (s) => !s.compared && s.volume === 'engine' && s.state === 'live' && s.layout === '3d');
  assert.equal(await page.locator('#screen-b').count(), 0);
});

test('the status panel splits the latency, and offline is said', async (context) => {
  const { page, context: browserContext } = await open(context);
  await page.click('#stats-toggle');
  await page.focus('#screen');
  for (let i = 0; i < 5; i += 1) await page.keyboard.press('ArrowLeft');
  await rest(page);
  const latency = await until(page, 'a latency', (s) => s.latency);
  const parts = ['network', 'queue', 'render', 'encode', 'browser'];
  const sum = parts.reduce((total, name) => total + latency[name], 0);
  assert.ok(Math.abs(sum - latency.total) < 1e-6, JSON.stringify(latency));
  assert.ok(latency.render > 0 && latency.browser > 0, JSON.stringify(latency));
  for (const name of parts) await page.locator(`#stats .parts [data-part="${name}"] dd`, { hasText: 'ms' }).waitFor();
  assert.equal(await page.locator('#stats svg.graph').count(), 4);
  await shot(page, 'status-panel');
  await browserContext.setOffline(true);
  await page.locator('#status-load', { hasText: 'offline' }).waitFor();
  await browserContext.setOffline(false);
  await page.locator('#status-load').waitFor({ state: 'hidden' });
  await page.locator('#stats-close').press('Escape');
  assert.ok(await page.isHidden('#stats'));
  assert.ok(await page.locator('#stats-toggle').evaluate((button) => button === document.activeElement));
});

for (const options of [{ viewport: { width: 1000, height: 700 }, colorScheme: 'light' }, { viewport: { width: 390, height: 844 }, hasTouch: true, colorScheme: 'dark' }]) {
  const name = `${options.viewport.width} × ${options.viewport.height}, ${options.colorScheme}`;
  test(`axe finds nothing in capture, comparison and status, ${name}`, NEEDS_AXE, async (context) => {
    const { page } = await open(context, { ...options, bypassCSP: true });
    await page.evaluate(() => {
      if (document.getElementById('panel').dataset.open !== 'true') document.getElementById('panel-toggle').click();
      for (const fold of document.querySelectorAll('#panel details')) fold.open = ['capture', 'compare'].includes(fold.id);
    });
    await page.click('#compare-start');
    await until(page, 'the second picture', (s) => s.compared?.isAtRest);
    await page.click('#saved-add');
    await page.locator('#saved li').first().waitFor();
    await page.locator('#stats-toggle').press('Enter');
    await shot(page, `capture-${options.viewport.width}`);
    await checkAxe(page);
    const wide = await page.evaluate(() => [...document.querySelectorAll('#capture *, #compare *, #stats *')]
      .filter((element) => element.checkVisibility() && element.getBoundingClientRect().right > window.innerWidth + 1).length);
    assert.equal(wide, 0, 'nothing overflows the window');
  });
}
