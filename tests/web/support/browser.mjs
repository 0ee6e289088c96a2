// SPDX-License-Identifier: Apache-2.0
// Debian's Chromium with the page, and helpers for tests of the page. Every wait is for a condition and has a deadline;
// nothing sleeps.
import assert from 'node:assert/strict';
import { mkdirSync } from 'node:fs';
import path from 'node:path';
import { setTimeout } from 'node:timers/promises';
import { chromium } from 'playwright-core';
import { decodePng } from './png.mjs';

export const DEADLINE_MS = 60000;
const POLL_MS = 25;
const EXECUTABLE = process.env.SPLATD_CHROMIUM ?? '/usr/bin/chromium';
const FLAGS = ['--no-sandbox', '--disable-gpu', '--no-first-run', '--disable-background-networking', '--disable-component-update',
  '--disable-sync', '--disable-quic'];

export const launch = () => chromium.launch({ executablePath: EXECUTABLE, headless: true, args: FLAGS, timeout: DEADLINE_MS });

/** Opens a new context with one page and collects its console messages. options: those of the browser context. */
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

/**
 * Waits until `condition`, a function of window.splatd that runs in the page, is true; returns its value. (waitForFunction of
 * the driver evaluates text in the page, which the content security policy forbids.)
 */
export async function until(page, what, condition) {
  const end = performance.now() + DEADLINE_MS;
  for (;;) {
    const value = await page.evaluate(`window.splatd ? (${condition})(window.splatd) : null`);
    if (value) return value;
    if (performance.now() > end || (await page.evaluate('window.splatd?.state')) === 'refused') break;
    await setTimeout(POLL_MS);
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

/** Waits until the page shows the last view, at rest and sharp. */
export const rest = (page) => until(page, 'the last view at rest',
  (s) => s.isIdle && s.count > 0 && s.seq === s.sent && s.isFinal && String(s.size) === String(s.wanted));

/** Waits until a frame of the live stream is drawn. */
export const firstFrame = (page) => until(page, 'a frame', (s) => s.state === 'live' && s.count > 0);

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
      if (p.some((part, i) => Math.abs(part - q[i]) > 24)) count += 1;
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
          const q = b.at(u, v);
          a.at(u, v).slice(0, 3).forEach((part, i) => { sums[i] += part - q[i]; });
        }
      }
      if (sums.some((sum) => Math.abs(sum) > 24 * side * side)) count += 1;
      total += 1;
    }
  }
  return count / total;
}

/** Drags in `steps` moves. options: {button, shift} */
export async function drag(page, [x0, y0], [x1, y1], { button = 'left', steps = 12 } = {}) {
  await page.mouse.move(x0, y0);
  await page.mouse.down({ button });
  await page.mouse.move(x1, y1, { steps });
  await page.mouse.up({ button });
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

/** Writes a screenshot to the build folder, for a person to look at. */
export async function shot(page, name) {
  const folder = process.env.SPLATD_SHOTS_DIR;
  if (!folder) return;
  mkdirSync(folder, { recursive: true });
  await page.screenshot({ path: path.join(folder, `${name}.png`) });
}
