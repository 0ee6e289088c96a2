// SPDX-License-Identifier: Apache-2.0
// The page for everyone: keyboard, touch, contrast, reduced motion, and the policy that it runs under. All parts of the panel are open.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { get } from 'node:http';
import { after, before, test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { checkAxe, NEEDS_AXE, openPage, rest, settle, share, shot, unfold, until, visit } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';

const { browser, daemon } = await share(() => startDaemon(['--volume', 'demo:phantom?size=32', '--volume', 'demo:engine?size=32']));

async function setUp(context, options) {
  const opened = await visit(context, browser, daemon.url, options);
  await until(opened.page, 'rest', (s) => s.isFinal && s.isIdle);
  await unfold(opened.page);
  return opened;
}

/** Resolves to the size of a body as sent, with its compression [bytes]. */
const sizeOf = (url) => new Promise((resolve, reject) => {
  get(url, { headers: { 'Accept-Encoding': 'gzip' } }, (answer) => {
    assert.equal(answer.statusCode, 200, url.pathname);
    let bytes = 0;
    answer.on('data', (part) => { bytes += part.length; });
    answer.on('end', () => resolve(bytes));
  }).on('error', reject);
});

test('the policy allows what the page needs from the daemon itself, and nothing else', async () => {
  const answer = await fetch(new URL('/', daemon.url));
  const policy = Object.fromEntries(answer.headers.get('Content-Security-Policy').split(';').map((part) => part.trim().split(/\s+/)).map(([name, ...from]) => [name, from.join(' ')]));
  const { 'default-src': others, 'img-src': images, ...rest } = policy;
  assert.equal(others, "'none'");
  assert.equal(images, "'self' blob: data:");
  for (const name of ['script-src', 'style-src', 'connect-src', 'worker-src']) assert.equal(rest[name], "'self'", name);
  for (const name of ['base-uri', 'form-action', 'frame-ancestors']) assert.equal(rest[name], "'none'", name);
  for (const [name, from] of Object.entries(rest)) assert.match(from, /^'(self|none)'$/, name);
  assert.equal(answer.headers.get('X-Content-Type-Options'), 'nosniff');
});

/** The files of sets in CMakeLists.txt. */
function filesOf(...sets) {
  const list = readFileSync(new URL('../../../clients/web/CMakeLists.txt', import.meta.url), 'utf8');
  return sets.flatMap((set) => new RegExp(`^set\\(${set}\\s([^)]*)\\)`, 'm').exec(list)[1].trim().split(/\s+/));
}

const FIRST = filesOf('entries', 'workers', 'chunks', 'styles', 'plain');
const ALL = [...FIRST, ...filesOf('later', 'later_alone', 'later_styles', 'element', 'element_styles', 'element_plain')];
for (const [what, names, limit] of [['what the page loads for the first image', FIRST, 119000], ['the page with all its parts and the element', ALL, 240000]]) {
  test(`${what} has less than ${limit / 1000} kB, as the daemon compresses it`, async () => {
    assert.ok(names.includes('app/main.js') && names.includes('style/page.css') && names.includes('index.html'));
    const sizes = [];
    for (const name of names) sizes.push([await sizeOf(new URL(name, daemon.url)), name]);
    const total = sizes.reduce((sum, [size]) => sum + size, 0);
    const largest = sizes.sort((a, b) => b[0] - a[0]).slice(0, 5).map(([size, name]) => `${name} ${size}`).join(', ');
    compare(total, '<', limit, `${total} bytes; the largest: ${largest}`);
    console.log(`${total} bytes in ${names.length} files`);
  });
}

test('the page loads nothing but these files for the first image, and the other features after it', async (context) => {
  const { context: opened, page } = await openPage(browser);
  context.after(() => opened.close());
  const asked = [];
  let before = null; // what was asked for when the features that come later were
  const base = new URL('.', daemon.url).href;
  page.on('request', (request) => {
    const name = request.url().split(/[?#]/)[0].slice(base.length) || 'index.html';
    if (name.startsWith('app/parts/')) before ??= [...asked];
    asked.push(name);
  });
  await page.goto(daemon.url);
  await until(page, 'all features', (s) => s.count > 0 && s.isComplete);
  assert.ok(before, 'the parts were loaded');
  assert.deepEqual(before.filter((name) => !name.startsWith('api/') && !FIRST.includes(name)), []);
  assert.deepEqual(FIRST.filter((name) => !asked.includes(name)), []);
  assert.match(await page.innerText('#status'), /^\s*live\b/, 'texts that changed since the beginning stay');
});

for (const colorScheme of ['dark', 'light']) {
  test(`axe finds nothing with all parts open, ${colorScheme}`, NEEDS_AXE, async (context) => {
    const { page } = await setUp(context, { viewport: { width: 1300, height: 4000 }, colorScheme, bypassCSP: true });
    await checkAxe(page);
    await shot(page, `everything-${colorScheme}`);
  });

  test(`axe finds nothing in the request for a token, ${colorScheme}`, NEEDS_AXE, async (context) => {
    const { context: opened, page } = await openPage(browser, { colorScheme, bypassCSP: true });
    context.after(() => opened.close());
    await page.goto(new URL('/', daemon.url).href);
    await page.locator('#token-form').waitFor();
    assert.ok(await page.locator('#cube').isHidden(), 'no cube without a picture');
    await checkAxe(page, '#banner');
    await shot(page, `token-${colorScheme}`);
  });
}

test('Tab reaches every control once, in the order of the document, and leaves the page', async (context) => {
  const { page, said } = await setUp(context, { viewport: { width: 1300, height: 900 } });
  const expected = await page.evaluate(() => {
    const all = [...document.querySelectorAll('a[href], button, input, select, textarea, summary, [tabindex]')].filter((element) => element.tabIndex >= 0
      && !element.disabled && !element.matches('fieldset:disabled *, [inert] *') && element.checkVisibility({ visibilityProperty: true })
      && element.getClientRects().length > 0);
    all.forEach((element, i) => { element.dataset.stop = i; });
    return all.length;
  });
  compare(expected, '>', 40);
  await page.evaluate(() => {
    window.stops = [];
    document.activeElement?.blur();
    document.addEventListener('focusin', ({ target }) => window.stops.push(Number(target.dataset.stop)));
  });
  for (let i = 0; i < expected; i += 1) await page.keyboard.press('Tab');
  const stops = await page.evaluate(() => window.stops);
  assert.deepEqual(stops, [...stops].sort((a, b) => a - b), 'in the order of the document');
  const missed = Array.from({ length: expected }, (_, i) => i).filter((i) => !stops.includes(i));
  const names = await page.evaluate((list) => list.map((i) => document.querySelector(`[data-stop="${i}"]`).outerHTML.slice(0, 90)), missed);
  assert.deepEqual(names, []);
  assert.deepEqual(said, []);
});

test('the list of controls opens at its beginning, also where it must scroll', async (context) => {
  const { page, said } = await setUp(context, { viewport: { width: 900, height: 500 } });
  await page.keyboard.press('?');
  const list = await page.evaluate(() => {
    const { open, scrollTop, scrollHeight, clientHeight } = document.getElementById('help');
    return { open, scrollTop, scrolls: scrollHeight > clientHeight };
  });
  assert.deepEqual(list, { open: true, scrollTop: 0, scrolls: true });
  await page.keyboard.press('Escape');
  assert.ok(await page.locator('#help').isHidden());
  await settle(page); // until then the focus is in the closed dialog
  await page.keyboard.press('?');
  await page.locator('#help').waitFor();
  await page.evaluate(() => document.getElementById('help').scrollTo(0, 10000));
  await page.click('#help-close', { trial: true });
  await page.click('#help-close');
  assert.ok(await page.locator('#help').isHidden());
  assert.deepEqual(said, []);
});

test('the focus does not get lost with the panel', async (context) => {
  const { page, said } = await setUp(context, {});
  await page.focus('#transfer > summary');
  await page.keyboard.press('p');
  const focused = () => page.evaluate(() => document.activeElement.id);
  assert.equal(await focused(), 'panel-toggle');
  await page.keyboard.press('Enter');
  assert.ok(await page.locator('#panel-body').isVisible(), 'the same key opens it again');
  assert.deepEqual(said, []);
});

test('the status line does not cover the scale bar of a phone on its side', async (context) => {
  const { page, said } = await setUp(context, { viewport: { width: 844, height: 390 }, hasTouch: true });
  const [bar, status] = await page.evaluate(() => ['scale-bar', 'status'].map((id) => document.getElementById(id).getBoundingClientRect().toJSON()));
  compare(bar.width, '>', 0);
  compare(bar.bottom, '<=', status.top);
  assert.deepEqual(said, []);
});

test('nothing moves by itself with reduced motion', async (context) => {
  const { page, said } = await setUp(context, { reducedMotion: 'reduce' });
  const moving = await page.evaluate(() => [...document.querySelectorAll('*')].flatMap((element) => ['', '::before', '::after'].filter((part) => {
    const { transitionDuration, animationName } = getComputedStyle(element, part || null);
    return animationName !== 'none' || transitionDuration.split(',').some((time) => parseFloat(time) > 0);
  }).map((part) => `${element.id || element.tagName}${part}`)));
  assert.deepEqual(moving, []);
  assert.deepEqual(said, []);
});

test('controls are at least 24 px high and wide for a mouse, and 44 px for a finger', async (context) => {
  const small = (page, least) => page.evaluate((limit) => [...document.querySelectorAll('button, select, summary, input, label:has(input)')]
    .filter((element) => element.checkVisibility() && !element.matches('label *, .handle, [type="file"], .pair input'))
    // A label is part of the target.
    .map((element) => ({ element, boxes: [element, ...(element.labels ?? [])].map((part) => part.getBoundingClientRect()) }))
    .filter(({ boxes }) => boxes[0].width > 1 && !boxes.some(({ width, height }) => Math.min(width, height) >= limit))
    .map(({ element, boxes: [box] }) => `${element.id || element.outerHTML.slice(0, 70)}: ${Math.round(box.width)} × ${Math.round(box.height)}`), least);
  const mouse = await setUp(context);
  assert.deepEqual(await small(mouse.page, 24), [], 'mouse');
  const phone = await setUp(context, { viewport: { width: 390, height: 844 }, deviceScaleFactor: 2, isMobile: true, hasTouch: true });
  await phone.page.click('#panel-toggle');
  assert.deepEqual(await small(phone.page, 44), [], 'finger');
  const points = await phone.page.evaluate(() => [...document.querySelectorAll('#transfer .handle')].map((handle) => {
    const { width, height } = getComputedStyle(handle, '::after');
    return Math.min(parseFloat(width), parseFloat(height));
  }));
  compare(points.length, '>', 1);
  compare(Math.min(...points), '>=', 44, 'points of the transfer function');
  await shot(phone.page, 'phone-everything');
  for (const { said } of [mouse, phone]) assert.deepEqual(said, []);
});

test('the theme of the user wins over that of the system, and a reload keeps it; the status line begins with the volume', async (context) => {
  const { page } = await setUp(context, { colorScheme: 'dark' });
  const ground = () => page.evaluate(() => getComputedStyle(document.getElementById('panel')).backgroundColor);
  const dark = await ground();
  await page.selectOption('#theme', 'light');
  const light = await ground();
  assert.notEqual(light, dark);
  await page.emulateMedia({ colorScheme: 'light' });
  await page.emulateMedia({ colorScheme: 'dark' });
  await page.reload();
  await rest(page);
  assert.equal(await ground(), light);
  await page.selectOption('#theme', 'system');
  assert.equal(await ground(), dark);
  const told = await page.locator('#status dl').innerText();
  assert.match(told, /^file\s+phantom\s+samples\s+32 × 32 × 32\s+spacing\s+1 × 1 × 1 \(no unit\)/);
});
