// SPDX-License-Identifier: Apache-2.0
// The panel on a phone: a sheet at the bottom with three heights, or at the left. The picture stays visible and framed beside it.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { lit } from '../support/block.mjs';
import { camera, checkAxe, NEEDS_AXE, openPage, pixels, rest, share, shot, touch, unfold, until, visit } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';

const PORTRAIT = { viewport: { width: 390, height: 844 }, deviceScaleFactor: 1, isMobile: true, hasTouch: true, reducedMotion: 'reduce' };
const LANDSCAPE = { ...PORTRAIT, viewport: { width: 844, height: 390 } };
const SMALL = { ...PORTRAIT, viewport: { width: 568, height: 320 } };

const { browser, daemon } = await share(() => startDaemon(['--volume', 'demo:engine?size=48']));

async function open(context, options = PORTRAIT) {
  const opened = await visit(context, browser, daemon.url, options);
  await rest(opened.page);
  return opened;
}

const height = (page) => page.evaluate(() => document.getElementById('panel').dataset.height);
const becomes = (page, wanted) => until(page, wanted, `() => document.getElementById('panel').dataset.height === '${wanted}'`);
const boxes = (page, ...selectors) => page.evaluate((all) => all.map((s) => document.querySelector(s).getBoundingClientRect().toJSON()), selectors);

/** Drags the head of the sheet to a place of the window. */
async function drag(page, to) {
  const [{ top, left, width }] = await boxes(page, '#panel header');
  const at = [left + width / 2, top + 20];
  await touch(page, [[at], [[at[0], (at[1] + to) / 2]], [[at[0], to]]]);
}

/** The box of the object as shares of the picture's sides. */
async function object(page) {
  await rest(page);
  const image = await pixels(page);
  const { left, top, width, height: high } = lit(image);
  return { left: left / image.width, top: top / image.height, width: width / image.width, height: high / image.height };
}

test('a drag of the head closes the sheet, opens it halfway or fully, and the picture takes the rest', async (context) => {
  const { page, said } = await open(context);
  const heights = {};
  for (const [to, wanted] of [[430, 'half'], [390, 'full'], [500, 'half'], [830, 'closed'], [100, 'full'], [835, 'closed'], [760, 'half']]) {
    await drag(page, to);
    await becomes(page, wanted);
    const [panel, picture] = await boxes(page, '#panel', '#screen');
    heights[wanted] = panel.height;
    assert.equal(panel.bottom, 844, wanted);
    assert.equal(panel.width, 390);
    if (wanted !== 'full') assert.equal(picture.bottom, panel.top, `the picture ends where the sheet begins: ${wanted}`);
    assert.equal(await page.locator('#panel-body').isVisible(), wanted !== 'closed');
    assert.equal(await page.getAttribute('#panel-toggle', 'aria-expanded'), String(wanted !== 'closed'));
  }
  compare(heights.closed, '<=', 64);
  compare(heights.half, '<=', 422);
  compare(heights.full, '>', 750);
  const [picture] = await boxes(page, '#screen');
  await drag(page, 100);
  await becomes(page, 'full');
  assert.deepEqual(await boxes(page, '#screen'), [picture], 'the full sheet does not change the picture below it');
  const [panel, toolbar] = await boxes(page, '#panel', '#toolbar');
  compare(toolbar.bottom, '<', panel.top, 'the toolbar stays in reach');
  assert.deepEqual(said, []);
});

test('the object stays whole, in the middle and large in the picture above the sheet, and returns with it', async (context) => {
  const { page, said } = await open(context);
  const [before, first] = [await object(page), await camera(page)];
  await page.click('#panel-toggle');
  await until(page, 'a picture of half the height', (s) => s.size[1] === 422);
  for (const act of [async () => {}, () => page.click('#fit'), () => page.click('#reset')]) {
    await act();
    const shown = await object(page);
    const [status, picture, tools] = await boxes(page, '#status', '#screen', '#toolbar');
    compare(shown.top * picture.height, '>=', tools.bottom - picture.top - 6, 'below the toolbar');
    compare((shown.top + shown.height) * picture.height, '<=', status.top - picture.top + 6, 'above the status line');
    compare(shown.width * picture.width, '>', 0.5 * picture.width);
    compare(Math.abs(shown.left + shown.width / 2 - 0.5), '<', 0.06);
  }
  await shot(page, 'sheet-half');
  await page.click('#panel-toggle');
  await until(page, 'the whole height', (s) => s.size[1] > 700);
  const after = await object(page);
  compare(Math.abs(after.width - before.width), '<', 0.02);
  const last = await camera(page);
  for (const axis of [0, 1, 2]) compare(Math.abs(last.position[axis] - first.position[axis]), '<', 0.01 * Math.abs(first.position[axis]) + 0.01);
  assert.deepEqual(said, []);
});

test('a participant without control keeps the camera of the session beside the sheet', async (context) => {
  const { page, said } = await open(context, { viewport: { width: 900, height: 700 } });
  await page.locator('#screen').focus();
  await page.keyboard.press('ArrowLeft'); // takes control
  await rest(page);
  await page.evaluate(() => { document.getElementById('people-fold').open = true; });
  const guest = await openPage(browser, PORTRAIT);
  context.after(() => guest.context.close());
  const address = await page.evaluate(async () => {
    document.getElementById('link-watch').click();
    while (!document.getElementById('link-text').value) await new Promise(requestAnimationFrame);
    return document.getElementById('link-text').value;
  });
  await guest.page.goto(address);
  await rest(guest.page);
  const shared = await camera(page);
  await guest.page.click('#panel-toggle');
  await until(guest.page, 'a picture of half the height', (s) => s.size[1] === 422);
  await rest(guest.page);
  assert.deepEqual(await camera(guest.page), shared);
  assert.deepEqual(await camera(page), shared);
  assert.deepEqual([...said, ...guest.said], []);
});

test('buttons and keys set each height, and a tap on the head goes on', async (context) => {
  const { page, said } = await open(context);
  assert.ok(await page.locator('#panel-size').isHidden());
  await page.keyboard.press('p');
  await becomes(page, 'half');
  await page.locator('#panel-size').focus();
  assert.equal(await page.getAttribute('#panel-size', 'aria-pressed'), 'false');
  await page.keyboard.press('Enter');
  await becomes(page, 'full');
  assert.equal(await page.getAttribute('#panel-size', 'aria-pressed'), 'true');
  await page.keyboard.press('Space');
  await becomes(page, 'half');
  await page.keyboard.press('p');
  await becomes(page, 'closed');
  assert.equal(await page.evaluate(() => document.activeElement.id), 'panel-toggle');
  for (const wanted of ['half', 'full', 'half']) {
    const [{ top }] = await boxes(page, '#panel header');
    await page.touchscreen.tap(195, top + 20);
    await becomes(page, wanted);
  }
  for (const id of ['panel-size', 'panel-toggle']) {
    const [{ width, height: high }] = await boxes(page, `#${id}`);
    compare(Math.min(width, high), '>=', 44, id);
  }
  assert.deepEqual(said, []);
});

test('a tool needs the picture, so the full sheet makes place', async (context) => {
  const { page, said } = await open(context);
  await drag(page, 100);
  await becomes(page, 'full');
  await page.click('#toolbar-more');
  await page.locator('#toolbar-menu').waitFor();
  const [menu, panel] = await boxes(page, '#toolbar-menu', '#panel');
  compare(menu.bottom, '>', panel.top);
  await page.click('#tool-distance'); // it lies above the sheet
  await becomes(page, 'half');
  const [bar, sheet] = await boxes(page, '#mode-bar', '#panel');
  compare(bar.bottom, '<', sheet.top);
  assert.deepEqual(said, []);
});

test('a section that is opened below the edge of the sheet comes into sight', async (context) => {
  const { page, said } = await open(context);
  await page.click('#panel-toggle');
  await page.locator('#capture > summary').scrollIntoViewIfNeeded();
  await page.click('#capture > summary');
  await until(page, 'the end or the head of the section', () => {
    const [body, fold] = [document.getElementById('panel-body'), document.getElementById('capture')].map((e) => e.getBoundingClientRect());
    return document.getElementById('capture').open && (fold.bottom <= body.bottom + 1 || Math.abs(fold.top - body.top) < 2);
  });
  assert.deepEqual(said, []);
});

test('slices lie above the half sheet and beside the one at the left', async (context) => {
  for (const options of [PORTRAIT, LANDSCAPE]) {
    const { page, said } = await open(context, options);
    await page.click('#panel-toggle');
    for (const layout of ['four', 'slices']) {
      await page.evaluate((name) => document.getElementById(`layout-${name}`).click(), layout);
      await until(page, 'three slices', () => [...document.querySelectorAll('.pane-body canvas.slice')].filter((e) => e.checkVisibility()).length === 3);
      const [panel, status] = await boxes(page, '#panel', '#status');
      const panes = await page.evaluate(() => [...document.querySelectorAll('.pane')].filter((e) => !e.hidden).map((e) => e.getBoundingClientRect().toJSON()));
      for (const pane of panes) {
        compare(Math.min(pane.width, pane.height), '>', 95);
        compare(pane.bottom, '<=', status.top + 0.5);
        if (options === PORTRAIT) compare(pane.bottom, '<=', panel.top);
        else compare(pane.left, '>=', panel.right - 0.5);
      }
      await shot(page, `sheet-${layout}-${options === PORTRAIT ? 'portrait' : 'landscape'}`);
    }
    assert.deepEqual(said, []);
  }
});

test('on its side the phone shows the sheet at the left, at most 45 % wide, and turning it keeps it open', async (context) => {
  const { page, said } = await open(context, LANDSCAPE);
  const closed = await object(page);
  await page.click('#panel-toggle');
  await until(page, 'a narrower picture', (s) => s.size[0] < 600);
  const [panel, picture, toolbar, status] = await boxes(page, '#panel', '#screen', '#toolbar', '#status');
  compare(panel.width, '<=', 0.45 * 844);
  assert.deepEqual([panel.left, panel.top, panel.bottom], [0, 0, 390]);
  assert.equal(picture.left, panel.right);
  for (const part of [toolbar, status]) compare(part.left, '>', panel.right);
  const shown = await object(page);
  compare(Math.abs(shown.height - closed.height), '<', 0.02, 'as large as before');
  compare(Math.abs(shown.left + shown.width / 2 - 0.5), '<', 0.06);
  await shot(page, 'sheet-landscape');
  await page.setViewportSize(PORTRAIT.viewport);
  await until(page, 'portrait', (s) => s.size[0] === 390 && s.size[1] === 422);
  assert.equal(await height(page), 'half');
  const turned = await object(page);
  compare(turned.width, '>', 0.5, 'as large as the shorter side allows');
  assert.deepEqual(said, []);
});

// Colours do not depend on the window: one light sheet is enough.
for (const options of [{ ...PORTRAIT, colorScheme: 'light' }, ...[PORTRAIT, LANDSCAPE, SMALL].map((size) => ({ ...size, colorScheme: 'dark' }))]) {
  test(`axe finds nothing in the sheet, and its controls fit, ${options.colorScheme}, ${options.viewport.width} px wide`, NEEDS_AXE, async (context) => {
    const { page } = await open(context, { ...options, bypassCSP: true });
    await checkAxe(page);
    await page.click('#panel-toggle');
    await unfold(page);
    const outside = await page.evaluate(() => {
      const { left, right } = document.getElementById('panel-body').getBoundingClientRect();
      return [...document.querySelectorAll('#panel-body :is(button, input, select, summary, label, output)')]
        .filter((e) => e.checkVisibility() && !e.matches('.handle, [type="file"]'))
        .filter((e) => e.getBoundingClientRect().left < left || e.getBoundingClientRect().right > right).map((e) => e.id || e.outerHTML.slice(0, 70));
    });
    assert.deepEqual(outside, []);
    const cut = await page.evaluate(() => [...document.querySelectorAll('#panel-body button')]
      .filter((e) => e.checkVisibility() && !e.matches('.handle') && e.scrollWidth > e.clientWidth + 1).map((e) => e.id || e.outerHTML.slice(0, 70)));
    assert.deepEqual(cut, [], 'texts of buttons fit');
    await checkAxe(page);
    await shot(page, `sheet-axe-${options.colorScheme}-${options.viewport.width}`);
  });
}
