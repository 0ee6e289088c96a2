// SPDX-License-Identifier: Apache-2.0
// Debian's Chromium with the page, and helpers for tests of the page. Every wait is for a condition and has a deadline;
// nothing sleeps.
import assert from 'node:assert/strict';
import { existsSync, mkdirSync, readFileSync } from 'node:fs';
import path from 'node:path';
import { after } from 'node:test';
import { setTimeout } from 'node:timers/promises';
import { fileURLToPath } from 'node:url';
import { chromium } from 'playwright-core';
import { MockDaemon } from './mock-daemon.mjs';
import { decodePng } from './png.mjs';

export const DEADLINE_MS = 60000;
const POLL_MS = 25;
/** The browser with its windows, as users have it. */
export const WHOLE = '/usr/bin/chromium';
// The same engine without windows takes a quarter less processor time, so most tests run in it where it is installed.
const EXECUTABLE = process.env.SPLATD_CHROMIUM ?? ['/usr/bin/chromium-headless-shell', WHOLE].find(existsSync);
// Chromium takes the last --disable-features, so the list repeats what Playwright disables. The two popups of the address bar are pages of
// their own in each window, although no test sees them: they took a quarter of a second of processor time per test.
const DISABLED = ['AutoDeElevate', 'AvoidUnnecessaryBeforeUnloadCheckSync', 'BoundaryEventDispatchTracksNodeRemoval', 'DestroyProfileOnBrowserClose',
  'DialMediaRouteProvider', 'GlobalMediaControls', 'HttpsUpgrades', 'LensOverlay', 'MediaRouter', 'OptimizationHints', 'PaintHolding', 'RenderDocument',
  'ThirdPartyStoragePartitioning', 'Translate', 'WebUIOmniboxAimPopup', 'WebUIOmniboxPopup'];
const FLAGS = ['--no-sandbox', '--disable-gpu', '--no-first-run', '--disable-background-networking', '--disable-component-update',
  '--disable-sync', '--disable-quic', '--enable-features=NetworkServiceInProcess2', `--disable-features=${DISABLED.join(',')}`];

export const launch = (executablePath = EXECUTABLE) => chromium.launch({ executablePath, headless: true, args: FLAGS, timeout: DEADLINE_MS });

/**
 * What all tests of a file share: Chromium, and the daemon that `start` resolves to. Both end after the tests; remove() runs last.
 * Resolves to {browser, daemon}.
 */
export async function share(start = null, remove = () => {}) {
  const shared = { browser: null, daemon: null };
  const end = async () => {
    await shared.browser?.close();
    const status = await shared.daemon?.stop();
    remove();
    assert.ok(!status, `splatd ended with ${status}`);
  };
  after(end);
  try {
    [shared.browser, shared.daemon] = await Promise.all([launch().then((browser) => (shared.browser = browser)), start?.().then((daemon) => (shared.daemon = daemon))]);
  } catch (error) {
    await end();
    throw error;
  }
  return shared;
}

/** Opens a page at an address until the end of the test, and waits for its first frame. */
export async function visit(test, browser, address, options) {
  const opened = await openPage(browser, options);
  test.after(() => opened.context.close());
  await opened.page.goto(address);
  await firstFrame(opened.page);
  return opened;
}

/**
 * The same with a daemon of its own that only answers (mock-daemon.mjs); `change` are its options, and `prepare(page)` runs before the page
 * loads. Resolves to {context, page, said, daemon, idle(): waits until all updates are answered, patches(act): runs an action and resolves to
 * the patches that it sent, patch(act): the same for exactly one}.
 */
export async function visitMock(test, browser, { options, change, prepare = async () => {} } = {}) {
  const daemon = await MockDaemon.start(change);
  const opened = await openPage(browser, options);
  test.after(async () => {
    await opened.context.close();
    await daemon.kill().catch(() => {});
  });
  await prepare(opened.page);
  await opened.page.goto(daemon.url);
  await firstFrame(opened.page);
  const idle = () => until(opened.page, 'all answered', (s) => s.isIdle);
  const patches = async (act) => {
    await idle();
    const from = daemon.heard.length;
    await act();
    await idle();
    return daemon.heard.slice(from).filter((m) => m.method === 'view.update').map((m) => m.params.patch);
  };
  const patch = async (act) => {
    const all = await patches(act);
    assert.equal(all.length, 1, JSON.stringify(all));
    return all[0];
  };
  return { daemon, ...opened, idle, patches, patch };
}

const AXE = fileURLToPath(new URL('../../node_modules/axe-core/axe.min.js', import.meta.url));
/** Options of a test that calls checkAxe(). */
export const NEEDS_AXE = { skip: !existsSync(AXE) && 'no axe-core: run npm ci in tests/' };

/** Checks that axe finds nothing in parts of the page: a selector, or selectors. */
export async function checkAxe(page, ...parts) {
  await page.evaluate(readFileSync(AXE, 'utf8'));
  const { violations } = await page.evaluate((include) => window.axe.run(include.length ? { include } : document, { resultTypes: ['violations'] }), parts.map((part) => [part]));
  assert.deepEqual(violations.map(({ id, nodes }) => `${id}: ${nodes.map(({ target, html }) => `${target} ${html}`).join(' ')}`), []);
}

/** Opens a new context with one page and collects its console messages. options: options of the browser context. */
export async function openPage(browser, options = {}) {
  const context = await browser.newContext({ viewport: { width: 900, height: 600 }, ...options });
  const page = await context.newPage();
  page.setDefaultTimeout(DEADLINE_MS);
  const said = [];
  page.on('console', (message) => {
    if (['error', 'warning'].includes(message.type())) said.push(`${message.type()}: ${message.text()}`);
  });
  page.on('pageerror', (error) => said.push(`uncaught: ${error.message}`));
  return { context, page, said };
}

/** Runs in the page: resolves to met(window.splatd) once that is true, and to a false value when the time is over or the daemon refuses. */
const waitInPage = ({ ms, pollMs }, met) => new Promise((resolve, reject) => {
  const end = performance.now() + ms;
  const look = () => {
    try {
      const value = window.splatd ? met(window.splatd) : null;
      if (value || performance.now() > end || window.splatd?.state === 'refused') resolve(value);
      else window.setTimeout(look, pollMs);
    } catch (error) {
      reject(error);
    }
  };
  look();
});

/**
 * Waits until `condition`, a function of window.splatd that runs in the page, is true; returns its value. The page looks by itself, because a
 * look from here takes time of three processes. (waitForFunction of the driver evaluates text in the page, which the content security policy
 * forbids.)
 */
export async function until(page, what, condition) {
  const end = performance.now() + DEADLINE_MS;
  for (let ms = DEADLINE_MS; ms > 0; ms = end - performance.now()) {
    const value = await page.evaluate(`(${waitInPage})(${JSON.stringify({ ms, pollMs: POLL_MS })}, ${condition})`).catch(async (error) => {
      if (!/Execution context was destroyed|because of a navigation/.test(error.message)) throw error;
      await setTimeout(POLL_MS); // another page loads: wait in that one
    });
    if (value) return value;
    if ((await page.evaluate('window.splatd?.state')) === 'refused') break;
  }
  const now = await page.evaluate(() => {
    const { state, frame, seq, sent, size, wanted, isFinal, isIdle, errors } = window.splatd ?? {};
    return { state, frame, seq, sent, size, wanted, isFinal, isIdle, errors };
  });
  throw new Error(`${what}: not reached; the page: ${JSON.stringify(now)}`);
}

/** Waits until `condition`, a function that runs in this process, is true. */
export async function eventually(what, condition) {
  for (const end = performance.now() + DEADLINE_MS; !condition();) {
    if (performance.now() > end) throw new Error(`${what}: not reached`);
    await setTimeout(POLL_MS);
  }
}

/** The box of a visible element, px. Tries again when the page replaces the element at that moment: it then has no box. */
export async function boxOf(locator) {
  for (const end = performance.now() + DEADLINE_MS; performance.now() < end;) {
    await locator.waitFor();
    const box = await locator.boundingBox();
    if (box) return box;
  }
  throw new Error('the element has no box');
}

/** Waits until the page shows the last view, at rest and sharp, with what is drawn above it. */
export const rest = (page) => until(page, 'the last view at rest',
  (s) => s.isIdle && s.isDrawn && s.count > 0 && s.seq === s.sent && s.isFinal && String(s.size) === String(s.wanted));

const LAYOUT_FRAMES = 3;

/**
 * Waits until the page has laid out what changed. Observers of sizes run at the end of an animation frame; what they plan (the toolbar, the
 * colour bar, the panes) runs in the next one. A box that is read before may lie where no frame on the screen shows it.
 */
export const settle = (page) => page.evaluate((frames) => new Promise((resolve) => {
  const next = (left) => (left > 0 ? requestAnimationFrame(() => next(left - 1)) : resolve());
  next(frames);
}), LAYOUT_FRAMES);

/** Changes the size of the window and waits for its layout. */
export async function resize(page, size) {
  await page.setViewportSize(size);
  await until(page, `a window of ${size.width} × ${size.height}`, `() => window.innerWidth === ${size.width} && window.innerHeight === ${size.height}`);
  await settle(page);
}

/** Waits until a frame of the live stream is drawn, and the features that come after it are there. */
export const firstFrame = (page) => until(page, 'a frame', (s) => s.state === 'live' && s.count > 0 && s.isComplete);

/** Opens all folds of the panel. */
export const unfold = (page) => page.evaluate(() => {
  for (const fold of document.querySelectorAll('#panel details')) fold.open = true;
});

export const camera = (page) => page.evaluate(() => window.splatd.camera);

/** Returns the pixels of the canvas, without elements above it. */
export async function pixels(page) {
  const url = await page.evaluate(() => document.getElementById('screen').toDataURL('image/png'));
  return decodePng(Buffer.from(url.slice(url.indexOf(',') + 1), 'base64'));
}

/** Returns the fraction of pixels that differ visibly between two images of the same size. */
export function difference(a, b) {
  assert.deepEqual([a.width, a.height], [b.width, b.height]);
  let count = 0;
  let total = 0;
  for (let y = 0; y < a.height; y += 2) {
    for (let x = 0; x < a.width; x += 2) {
      const [p, q] = [a.at(x, y), b.at(x, y)];
      if (Math.abs(p[0] - q[0]) > 24 || Math.abs(p[1] - q[1]) > 24 || Math.abs(p[2] - q[2]) > 24) count += 1;
      total += 1;
    }
  }
  return count / total;
}

/** The same for means of 16×16 pixels, to compare images of different sharpness. */
export function coarseDifference(a, b) {
  assert.deepEqual([a.width, a.height], [b.width, b.height]);
  const side = 16;
  let count = 0;
  let total = 0;
  for (let y = 0; y + side <= a.height; y += side) {
    for (let x = 0; x + side <= a.width; x += side) {
      const sums = [0, 0, 0];
      for (let v = y; v < y + side; v += 1) {
        for (let u = x; u < x + side; u += 1) {
          const [p, q] = [a.at(u, v), b.at(u, v)];
          for (let i = 0; i < 3; i += 1) sums[i] += p[i] - q[i];
        }
      }
      if (sums.some((sum) => Math.abs(sum) > 24 * side * side)) count += 1;
      total += 1;
    }
  }
  return count / total;
}

/** Drags in `steps` moves. options: {button, shift} */
export async function drag(page, [x0, y0], [x1, y1], { button = 'left', steps = 4 } = {}) {
  await page.mouse.move(x0, y0);
  await page.mouse.down({ button });
  await page.mouse.move(x1, y1, { steps });
  await page.mouse.up({ button });
}

/**
 * Presses both buttons and turns the wheel on whatever lies above the pictures: labels, bars and messages. Returns {count: of places, kept:
 * the names of elements that keep a part of it from the picture below, although they are no controls}.
 */
export async function pressPlates(page) {
  const places = await page.evaluate(() => {
    const PICTURES = '#screen, #screen-b, .slice';
    const CONTROLS = 'button, input, select, a, [role="slider"], [role="separator"], [tabindex], .cube path, .knob';
    window.reached = [];
    for (const picture of document.querySelectorAll(PICTURES)) {
      for (const type of ['pointerdown', 'wheel']) picture.addEventListener(type, ({ button }) => window.reached.push(type === 'wheel' ? type : button));
    }
    const found = new Map();
    for (const element of document.querySelectorAll(':is(main, #tools, #messages, #status) *')) {
      const box = element.getBoundingClientRect();
      const [x, y] = [box.left + box.width / 2, box.top + box.height / 2].map(Math.round);
      const top = element.checkVisibility({ checkVisibilityCSS: true }) && box.width > 0 && document.elementFromPoint(x, y);
      const isBesidePanel = top && document.elementsFromPoint(x, y).some((below) => below.matches(PICTURES));
      if (isBesidePanel && !top.matches(PICTURES) && (!top.closest(CONTROLS) || top.closest('main') === top)) found.set(`${x} ${y}`, { x, y, name: top.id || top.className || top.tagName });
    }
    return [...found.values()];
  });
  const kept = [];
  for (const { x, y, name } of places) {
    await page.mouse.move(x, y);
    for (const button of ['left', 'right']) {
      await page.mouse.down({ button });
      await page.mouse.up({ button });
    }
    await page.mouse.wheel(0, 1);
    await settle(page);
    const reached = await page.evaluate(() => window.reached.splice(0));
    if (String([...new Set(reached)].sort()) !== '0,2,wheel') kept.push(`${name}: ${reached}`);
  }
  return { count: places.length, kept };
}

/** Sends touches by the DevTools protocol: a list of moments, each a list of points. */
export async function touch(page, moments) {
  const cdp = await page.context().newCDPSession(page);
  const points = (list) => list.map(([x, y], id) => ({ x, y, id }));
  await cdp.send('Input.dispatchTouchEvent', { type: 'touchStart', touchPoints: points(moments[0]) });
  for (const moment of moments.slice(1)) {
    await cdp.send('Input.dispatchTouchEvent', { type: 'touchMove', touchPoints: points(moment) });
  }
  await cdp.send('Input.dispatchTouchEvent', { type: 'touchEnd', touchPoints: [] });
  await cdp.detach();
}

/** Writes a screenshot to the folder SPLATD_SHOTS_DIR, for a person to look at; nothing without that variable. */
export async function shot(page, name) {
  const folder = process.env.SPLATD_SHOTS_DIR;
  if (!folder) return;
  mkdirSync(folder, { recursive: true });
  await page.screenshot({ path: path.join(folder, `${name}.png`) });
}
