// SPDX-License-Identifier: Apache-2.0
// The section "Layers": every control and the patches that it sends, by mouse, keyboard and touch, the marks above the histogram, undo, who
// may edit; then pictures of the real daemon.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { boxOf, NEEDS_AXE, checkAxe, difference, pixels, rest, share, shot, until, visit, visitMock } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';
import { volume } from '../support/mock-daemon.mjs';

const PHONE = { viewport: { width: 360, height: 700 }, deviceScaleFactor: 2, isMobile: true, hasTouch: true };
const LARGE = { viewport: { width: 720, height: 1000 } };
const { browser, daemon: real } = await share(() => startDaemon(['--volume', 'demo:engine?size=48', '--volume', 'demo:tornado?size=24', '--backend', 'cpu', '--control-time', '600']));

const rowOf = (page, index) => page.locator(`#layer-list [data-index="${index}"]`);
const eye = (page, name) => page.getByRole('button', { name: `Show ${name}`, exact: true });
const markOf = (page, i) => page.locator('#layer-markers button').nth(i);
const layersIn = (page) => page.evaluate(() => window.splatd.view.layers);
const drawn = (page) => page.evaluate(() => new Promise((then) => { requestAnimationFrame(() => requestAnimationFrame(() => then())); }));

async function setUp(context, options = LARGE, change = {}) {
  const opened = await visitMock(context, browser, { options, change });
  const { page } = opened;
  if (options.isMobile) {
    const framings = () => opened.daemon.heard.filter((m) => m.method === 'view.update' && m.params.patch.camera).length;
    const before = framings();
    await page.tap('#panel-toggle');
    for (let i = 0; framings() === before && i < 600; i += 1) await drawn(page);
    compare(framings(), '>', before, 'the volume is framed again, beside the sheet');
  }
  await until(page, 'the histogram', () => document.querySelectorAll('#transfer-curve .handle').length > 0 && !document.getElementById('transfer-kind').disabled);
  return {
    ...opened,
    /** The layers that an action sends, in one patch. */
    async patch(act) {
      const patch = await opened.patch(async () => {
        await act();
        await drawn(page);
      });
      assert.deepEqual(Object.keys(patch), ['layers']);
      return patch.layers;
    },
    patches: (act) => opened.patches(async () => {
      await act();
      await drawn(page);
    }),
  };
}

test('a surface and a shell are added, hidden and removed', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  const first = await it.patch(() => page.click('#layer-add-surface'));
  assert.deepEqual(first.map(({ type, visible }) => [type, visible]), [['volume', false], ['surface', true]]);
  compare(first[1].value, '>', 16, 'above the peak of air at 10');
  compare(first[1].value, '<', 120, 'below that of matter');
  assert.equal(await rowOf(page, 1).locator('.layer-pick').getAttribute('aria-expanded'), 'true', 'the new one shows its controls');
  const second = await it.patch(() => page.click('#layer-add-surface'));
  compare(second[2].value, '>', first[1].value);
  assert.notDeepEqual(second[2].color, second[1].color);
  const third = await it.patch(() => page.click('#layer-add-shell'));
  assert.deepEqual(third[3], { type: 'shell', visible: true, low: 0.05, high: 0.45, detail: 'high' });
  assert.ok(await page.locator('#layer-add-shell').isDisabled(), 'there is one shell');
  await shot(page, 'layers');

  assert.equal((await it.patch(() => eye(page, 'Volume').click()))[0].visible, true);
  assert.equal(await eye(page, 'Volume').getAttribute('aria-pressed'), 'true');
  assert.equal((await it.patch(() => eye(page, 'Surface 1').click()))[1].visible, false);
  assert.equal(await eye(page, 'Surface 1').getAttribute('aria-pressed'), 'false');
  const left = await it.patch(() => page.getByRole('button', { name: 'Remove Surface 1' }).click());
  assert.deepEqual(left.map(({ type }) => type), ['volume', 'surface', 'shell']);
  assert.equal(await rowOf(page, 1).locator('.layer-name').textContent(), 'Surface 1');
  await it.patch(() => page.getByRole('button', { name: 'Remove Shell' }).click());
  assert.deepEqual(await it.patch(() => page.getByRole('button', { name: 'Remove Surface 1' }).click()), [{ type: 'volume', visible: true }]);
  assert.equal(await page.evaluate(() => document.activeElement.id), 'layer-add-surface');
  for (let i = 0; i < 7; i += 1) await it.patch(() => page.click('#layer-add-surface'));
  assert.ok(await page.locator('#layer-add-surface').isDisabled(), 'eight layers');
  assert.deepEqual(it.said, []);
});

test('the controls of a surface: slider, number, colour, opacity and flatness', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  await it.patch(() => page.click('#layer-add-surface'));
  const key = (id, name) => it.patch(() => page.press(id, name));
  assert.equal((await key('#surface-slider', 'End'))[1].value, 255);
  assert.equal((await key('#surface-slider', 'Home'))[1].value, 0);
  const typed = await it.patch(async () => {
    await page.fill('#surface-value', '100.25');
    await page.keyboard.press('Enter');
  });
  assert.equal(typed[1].value, 100.25);
  assert.equal(await page.getAttribute('#surface-slider', 'aria-valuetext'), '100.25');
  assert.equal(await page.textContent('#layer-list .layer-value'), '100.25', 'the list and the field show the same');
  assert.deepEqual(await it.patches(async () => {
    await page.fill('#surface-value', '');
    await page.keyboard.press('Enter');
  }), [], 'no number');
  const red = await it.patch(() => page.locator('#surface-color').evaluate((input) => {
    input.value = '#ff3300';
    input.dispatchEvent(new Event('input', { bubbles: true }));
    input.dispatchEvent(new Event('change', { bubbles: true }));
  }));
  assert.deepEqual(red[1].color, [1, 0.2, 0]);
  assert.equal((await key('#surface-opacity', 'ArrowLeft'))[1].opacity, 0.99);
  assert.equal(await page.locator('output[for="surface-opacity"]').textContent(), '0.99');
  await page.locator('.layer-details summary').click();
  assert.equal(await page.locator('output[for="surface-flatness"]').textContent(), 'discs');
  const flat = (await key('#surface-flatness', 'Home'))[1].flatness;
  assert.equal(flat, 1);
  assert.equal(await page.locator('output[for="surface-flatness"]').textContent(), '× 1');
  assert.equal((await key('#surface-flatness', 'End'))[1].flatness, 'inf');
  // Each was one step.
  await page.focus('#screen');
  const states = [];
  for (let i = 0; i < 3; i += 1) states.push((await it.patch(() => page.keyboard.press('Control+z')))[1]);
  assert.deepEqual(states.map(({ flatness, opacity }) => [flatness, opacity]), [[1, 0.99], ['inf', 0.99], ['inf', 1]]);
  assert.deepEqual((await it.patch(() => page.keyboard.press('Control+Shift+Z')))[1].opacity, 0.99);
  assert.deepEqual(it.said, []);
});

test('a drag of a slider streams, at most one patch per animation frame, and is one step for undo', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  const [, before] = await it.patch(() => page.click('#layer-add-surface'));
  await page.evaluate(() => {
    window.frames_ = 0;
    const count = () => { window.frames_ += 1; requestAnimationFrame(count); };
    requestAnimationFrame(count);
  });
  await page.locator('#surface-slider').scrollIntoViewIfNeeded();
  const { x, y, width, height } = await boxOf(page.locator('#surface-slider'));
  const sent = await it.patches(async () => {
    await page.mouse.move(x + width * 0.3, y + height / 2);
    await page.mouse.down();
    for (let i = 0; i <= 40; i += 1) await page.mouse.move(x + width * (0.3 + i / 80), y + height / 2);
    await page.mouse.up();
  });
  compare(sent.length, '>', 1);
  compare(sent.length, '<=', 1 + await page.evaluate(() => window.frames_));
  compare(Math.abs(sent.at(-1).layers[1].value - 0.8 * 255), '<', 12);
  const back = await it.patch(() => page.click('#transfer-undo'));
  assert.equal(back[1].value, before.value);
  assert.deepEqual(it.said, []);
});

test('a surface has a mark above the histogram, which moves by mouse and keyboard', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  const [, added] = await it.patch(() => page.click('#layer-add-surface'));
  const mark = markOf(page, 0);
  await mark.scrollIntoViewIfNeeded();
  const plot = await boxOf(page.locator('#transfer-curve .plot'));
  const place = async () => {
    const { x, y, width, height } = await boxOf(mark);
    return [x + width / 2, y + height / 2];
  };
  const from = await place();
  compare(Math.abs(from[0] - (plot.x + plot.width * added.value / 255)), '<', 2);
  compare(from[1], '<', plot.y, 'above the plot, where no point is');
  const sent = await it.patches(async () => {
    await page.mouse.move(...from);
    await page.mouse.down();
    await page.mouse.move(plot.x + plot.width * 0.75, from[1], { steps: 6 });
    await page.mouse.up();
  });
  assert.deepEqual(Object.keys(sent.at(-1)), ['layers'], 'the curve did not get a point');
  compare(Math.abs(sent.at(-1).layers[1].value - 0.75 * 255), '<', 2);
  assert.equal(await page.inputValue('#surface-value'), String(sent.at(-1).layers[1].value));
  const { value } = sent.at(-1).layers[1];
  const step = async (key) => (await it.patch(() => mark.press(key)))[1].value - value;
  compare(Math.abs(await step('ArrowRight') - 2.55), '<', 0.01);
  compare(Math.abs(await step('Shift+ArrowLeft') - 2.55 * 0.9), '<', 0.01);
  assert.equal(await mark.getAttribute('aria-label'), 'Surface 1: value');
  assert.equal(Number(await mark.getAttribute('aria-valuenow')), (await layersIn(page))[1].value);
  // A zoom of the plot also moves the marks. Marks outside of the plot are hidden.
  await page.locator('#transfer-curve [data-part="closer"]').click();
  await page.locator('#transfer-curve [data-part="closer"]').click();
  await page.locator('#transfer-curve [data-part="closer"]').click();
  await drawn(page);
  assert.ok(await mark.isHidden());
  await page.locator('#transfer-curve [data-part="all"]').click();
  assert.ok(await mark.isVisible());
  assert.deepEqual(await it.patch(() => mark.press('Delete')), [{ type: 'volume', visible: true }]);
  assert.equal(await page.locator('#layer-markers button').count(), 0);
  assert.deepEqual(it.said, []);
});

test('the thresholds of a shell keep their order', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  await it.patch(() => page.click('#layer-add-shell'));
  const slider = (end) => `.layer-details .pair [data-end="${end}"]`;
  const number = (end) => `.layer-details .range [data-end="${end}"]`;
  const fill = (end, value) => it.patch(async () => {
    await page.fill(number(end), String(value));
    await page.keyboard.press('Enter');
  });
  const ends = ({ low, high }) => [low, high];
  assert.deepEqual(ends((await fill('low', 0.3))[1]), [0.3, 0.45]);
  assert.deepEqual(ends((await fill('low', 0.6))[1]), [0.6, 0.6], 'pushes the other one');
  assert.deepEqual(ends((await fill('high', 0.2))[1]), [0.2, 0.2]);
  assert.deepEqual(ends((await it.patch(() => page.press(slider('high'), 'End')))[1]), [0.2, 1]);
  assert.deepEqual(ends((await it.patch(() => page.press(slider('low'), 'End')))[1]), [1, 1]);
  assert.deepEqual(ends((await it.patch(() => page.press(slider('low'), 'Home')))[1]), [0, 1]);
  const fast = await it.patch(() => page.selectOption('#shell-detail', 'fast'));
  assert.equal(fast[1].detail, 'fast');
  assert.deepEqual(it.said, []);
});

test('undo takes back changes of layers and of the transfer function in their order', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  const points = () => page.evaluate(() => window.splatd.transfer.points.map(({ value }) => value));
  await it.patch(() => page.click('#layer-add-surface'));
  await it.patches(async () => {
    await page.fill('#transfer-value', '70');
    await page.press('#transfer-value', 'Enter');
  });
  await it.patch(() => page.click('#layer-add-shell'));
  assert.deepEqual((await it.patch(() => page.click('#transfer-undo'))).map(({ type }) => type), ['volume', 'surface']);
  await it.patches(() => page.click('#transfer-undo'));
  assert.deepEqual(await points(), [60, 200]);
  assert.equal((await layersIn(page)).length, 2);
  assert.deepEqual(await it.patch(() => page.click('#transfer-undo')), [{ type: 'volume', visible: true }]);
  await it.patches(() => page.click('#transfer-redo'));
  await it.patches(() => page.click('#transfer-redo'));
  assert.deepEqual([await points(), (await layersIn(page)).length], [[70, 200], 2]);
});

test('changes of others appear, and without control nothing can be changed', async (context) => {
  const it = await setUp(context);
  const { page, daemon } = it;
  const [session] = daemon.sessions.values();
  const layers = [{ type: 'surface', visible: true, value: 40, color: [0, 1, 0], opacity: 0.5, flatness: 4 }, { type: 'shell', visible: false, low: 0.1, high: 0.2, detail: 'fast' }];
  session.view = { ...session.view, layers };
  daemon.notifyAll('view.changed', { by: 2, view: session.view });
  await rowOf(page, 1).waitFor();
  assert.equal(await eye(page, 'Volume').getAttribute('aria-pressed'), 'false', 'a view without the volume');
  assert.equal(await eye(page, 'Shell').getAttribute('aria-pressed'), 'false');
  await rowOf(page, 0).locator('.layer-pick').click();
  assert.equal(await page.inputValue('#surface-value'), '40');
  assert.equal(await page.inputValue('#surface-color'), '#00ff00');
  assert.deepEqual((await it.patch(() => eye(page, 'Volume').click()))[0], { type: 'volume', visible: true });
  daemon.notifyAll('session.participants', { you: 1, participants: [{ id: 1, role: 'control' }, { id: 2, role: 'control', name: 'Grace' }] });
  daemon.notifyAll('session.control', { holder: 2, requests: [] });
  await page.locator('#layers .fold-body[inert]').waitFor();
  assert.deepEqual(await it.patches(() => markOf(page, 0).press('ArrowRight')), []);
});

test('streaks take the place of the volume, and a message says when it hides them', async (context) => {
  const fields = [{ name: 'speed', components: 1 }, { name: 'wind', components: 3 }];
  const it = await setUp(context, LARGE, { volumes: [volume('phantom', { fields })] });
  const { page } = it;
  const added = await it.patch(() => page.locator('.prompt[data-id="vectors"]').getByRole('button', { name: 'Add vectors' }).click());
  assert.deepEqual(added.map(({ type, visible }) => [type, visible]), [['volume', false], ['vectors', true]]);
  assert.equal(await page.locator('.prompt[data-id="streaks"]').count(), 0);
  await it.patch(() => eye(page, 'Volume').click());
  const alone = page.locator('.prompt[data-id="streaks"]').getByRole('button', { name: 'Hide the volume' });
  await alone.waitFor();
  assert.deepEqual((await it.patch(() => alone.click()))[0], { type: 'volume', visible: false });
  await page.locator('.prompt[data-id="streaks"]').waitFor({ state: 'detached' });
});

test('streaks and points may have the colours of other numbers', async (context) => {
  const fields = [{ name: 'speed', components: 1, range: [0, 200] }, { name: 'wind', components: 3, range: [0, 9] }];
  const it = await setUp(context, LARGE, { volumes: [volume('phantom', { fields, other_fields: ['heat', 'magnitude'] })] });
  const { page, daemon } = it;
  await it.patch(() => page.click('#layer-add-vectors'));
  const names = () => page.$$eval('#vectors-color-by option', (options) => options.map(({ textContent }) => textContent));
  assert.deepEqual(await names(), ['speed', 'length of the vectors'], 'without the right to open files');
  const [, streaks] = await it.patch(() => page.selectOption('#vectors-color-by', 'magnitude'));
  assert.deepEqual([streaks.color_by, streaks.color_low, streaks.color_high], ['magnitude', null, null]);
  const [low, high] = ['color_low', 'color_high'].map((end) => page.locator(`.layer-details [data-end="${end}"]`));
  const labels = () => page.locator('#color-bar .color-ticks span').allTextContents().then((all) => [all[0], all.at(-1)]);
  const rangeOf = ([, layer]) => [layer.color_low, layer.color_high];
  assert.deepEqual([await low.getAttribute('placeholder'), await high.getAttribute('placeholder')], ['0', '9'], 'the range of the data');
  assert.deepEqual(await labels(), ['0', '9']);
  await high.focus();
  await page.keyboard.type('4.5');
  assert.deepEqual(rangeOf(await it.patch(() => page.keyboard.press('Enter'))), [null, 4.5]);
  assert.deepEqual(await labels(), ['0', '4.5']);
  await page.keyboard.press('Shift+Tab');
  await page.keyboard.type('2');
  assert.deepEqual(rangeOf(await it.patch(() => page.keyboard.press('Enter'))), [2, 4.5]);
  assert.deepEqual(await labels(), ['2', '4.5']);
  await low.fill('5');
  assert.deepEqual(await it.patches(() => low.press('Enter')), [], 'the ends in the wrong order');
  assert.match(await low.evaluate((input) => input.validationMessage), /must be above/);
  assert.deepEqual(rangeOf(await it.patch(() => page.click('#transfer-undo'))), [null, 4.5]);
  assert.deepEqual([await low.inputValue(), await high.inputValue()], ['', '4.5']);
  assert.deepEqual(rangeOf(await it.patch(() => page.click('#transfer-redo'))), [2, 4.5]);
  await shot(page, 'layers-color-range');
  await high.fill('');
  assert.deepEqual(rangeOf(await it.patch(() => high.press('Enter'))), [2, null]);
  assert.deepEqual(await labels(), ['2', '9']);
  assert.equal((await it.patch(() => page.selectOption('#vectors-color-by', '')))[1].color_by, '');
  await low.waitFor({ state: 'hidden' });
  const session = [...daemon.sessions.values()][0];
  session.view = { ...session.view, layers: [{ ...streaks, color_by: 'gone' }] };
  daemon.notifyAll('view.changed', { by: 2, view: session.view });
  const reset = page.locator('.prompt[data-id="closed"]').getByRole('button', { name: 'Use the own values' });
  await reset.waitFor();
  assert.equal((await it.patch(() => reset.click()))[0].color_by, '');
  assert.deepEqual(it.said, []);
});

test('axe finds nothing in the section and in the marks, dark and light', NEEDS_AXE, async (context) => {
  const fields = [{ name: 'speed', components: 1 }, { name: 'wind', components: 3 }];
  const options = { viewport: { width: 1000, height: 1200 }, colorScheme: 'dark', bypassCSP: true };
  const it = await setUp(context, options, { volumes: [volume('phantom', { fields })] });
  const { page } = it;
  const check = async (name) => {
    await it.idle();
    for (const colorScheme of ['dark', 'light']) {
      await page.emulateMedia({ colorScheme });
      await drawn(page);
      await checkAxe(page, '#panel');
      await shot(page, `layers-${name}-${colorScheme}`);
    }
  };
  await page.locator('.prompt[data-id="vectors"]').getByRole('button', { name: 'Add vectors' }).click();
  await page.selectOption('#vectors-style', 'blend');
  await check('vectors');
  await page.click('#layer-add-shell');
  await check('shell');
  await page.click('#layer-add-surface');
  await page.locator('.layer-details summary').click();
  await eye(page, 'Shell').click();
  await check('surface');
});

test('on a phone: add, move the mark and remove by touch', async (context) => {
  const it = await setUp(context, PHONE);
  const { page } = it;
  await it.patch(() => page.tap('#layer-add-surface'));
  await page.locator('#surface-slider').scrollIntoViewIfNeeded();
  await shot(page, 'layers-phone');
  for (const selector of ['#layer-list .eye', '#layer-list .layer-pick', '#layer-list .small', '#surface-slider', '#surface-value', '#surface-pick']) {
    const { height } = await boxOf(page.locator(selector).first());
    compare(height, '>=', 34, selector);
  }
  const wide = await page.evaluate(() => [document.getElementById('panel-body').scrollWidth, document.getElementById('panel-body').clientWidth]);
  compare(wide[0], '<=', wide[1], 'nothing is cut off');
  await it.patch(() => eye(page, 'Surface 1').tap());
  await it.patch(() => page.getByRole('button', { name: 'Remove Surface 1' }).tap());
  assert.deepEqual(it.said, []);
});

test('another volume has layers of its own', async (context) => {
  const it = await setUp(context, LARGE, { volumes: [volume('phantom'), volume('engine')] });
  const { page } = it;
  await it.patch(() => page.click('#layer-add-surface'));
  await page.click('#volumes button[data-id="engine"]');
  await until(page, 'the other volume', (s) => s.isIdle && s.volume === 'engine' && s.view.layers.length === 1);
  await page.locator('#layer-list [data-index]').waitFor({ state: 'detached' });
  assert.ok(await page.locator('#transfer-undo').isDisabled());
});

// Pictures.

/** The page with the real daemon, seen from its default side, in a session of its own unless the address names one. */
async function withEngine(context, url = real.url, options = { viewport: { width: 700, height: 520 } }) {
  const opened = await visit(context, browser, url, options);
  const { page } = opened;
  await until(page, 'the histogram', () => !document.getElementById('transfer-kind').disabled);
  await rest(page);
  return opened;
}

const picture = async (page) => {
  await rest(page);
  return pixels(page);
};
const background = [0, 0, 0];
const isLit = (pixel) => pixel.slice(0, 3).some((part, i) => Math.abs(part - background[i]) > 24);

/** The share of pixels that are not background, and their mean colour. */
function lit(image) {
  const sum = [0, 0, 0];
  let count = 0;
  for (let y = 0; y < image.height; y += 2) {
    for (let x = 0; x < image.width; x += 2) {
      const pixel = image.at(x, y);
      if (!isLit(pixel)) continue;
      count += 1;
      for (let c = 0; c < 3; c += 1) sum[c] += pixel[c];
    }
  }
  return { share: count / (image.width * image.height / 4), color: sum.map((part) => part / Math.max(1, count)) };
}

/** Types a number into a field of the section. */
const fill = async (page, selector, value) => {
  await page.fill(selector, String(value));
  await page.press(selector, 'Enter');
};

test('each control of a surface changes the picture as it says', async (context) => {
  const { page, said } = await withEngine(context);
  const whole = await picture(page);
  await page.click('#layer-add-surface');
  const surface = await picture(page);
  compare(difference(whole, surface), '>', 0.03, 'the surface in the place of the volume');
  compare(lit(surface).share, '>', 0.5 * lit(whole).share, 'it shows the object');
  await eye(page, 'Surface 1').click();
  assert.equal(lit(await picture(page)).share, 0, 'nothing is visible');
  await eye(page, 'Surface 1').click();
  assert.equal(difference(await picture(page), surface), 0);
  await fill(page, '#surface-value', 230);
  const parts = await picture(page);
  compare(lit(parts).share, '<', 0.8 * lit(surface).share, 'a higher value encloses less');
  await page.locator('#surface-color').evaluate((input) => {
    input.value = '#ff2000';
    input.dispatchEvent(new Event('input', { bubbles: true }));
    input.dispatchEvent(new Event('change', { bubbles: true }));
  });
  const red = lit(await picture(page)).color;
  compare(red[0], '>', 2 * red[2], `red: ${red}`);
  await fill(page, '#surface-value', 90);
  await eye(page, 'Volume').click();
  const both = await picture(page);
  compare(difference(both, whole), '>', 0.02, 'a red surface at the border of the volume');
  compare(lit(both).share, '>', 0.95 * lit(whole).share, 'the volume is there');
  await eye(page, 'Volume').click();
  await page.press('#surface-opacity', 'Home');
  assert.equal(lit(await picture(page)).share, 0, 'opacity 0');
  await page.press('#surface-opacity', 'End');
  await page.locator('.layer-details summary').click();
  const sharp = await picture(page);
  await page.press('#surface-flatness', 'Home');
  compare(difference(await picture(page), sharp), '>', 0, 'kernels of the volume');
  await fill(page, '#surface-value', 1e6);
  assert.equal(lit(await picture(page)).share, 0, 'outside of the range there is no surface');
  await page.click('#reset-all');
  await until(page, 'the default layers', (s) => s.isIdle && s.view.layers.length === 1);
  assert.equal(difference(await picture(page), whole), 0);
  assert.equal(await page.locator('#layer-list [data-index]').count(), 0);
  await shot(page, 'layers-engine');
  assert.deepEqual(said, []);
});

test('each control of a shell changes the picture as it says', async (context) => {
  const { page, said } = await withEngine(context);
  const whole = await picture(page);
  await page.click('#layer-add-shell');
  const shell = await picture(page);
  compare(difference(whole, shell), '>', 0.01);
  compare(lit(shell).share, '>', 0.7 * lit(whole).share);
  await page.selectOption('#shell-detail', 'fast');
  compare(difference(await picture(page), shell), '>', 0.005, 'squares');
  await page.selectOption('#shell-detail', 'high');
  assert.equal(difference(await picture(page), shell), 0);
  await fill(page, '.layer-details .range [data-end="low"]', 0.999);
  compare(lit(await picture(page)).share, '<', 0.3 * lit(whole).share, 'only what is that opaque');
  assert.deepEqual(said, []);
});

test('vectors move for all until they pause, keep their phase, and playing is no step for undo', async (context) => {
  const { page, said } = await withEngine(context, `${real.url}&volume=tornado`);
  const layer = () => page.evaluate(() => window.splatd.view.layers.at(-1));
  const whole = await picture(page);
  await page.click('#layer-add-vectors');
  const streaks = await picture(page);
  compare(difference(whole, streaks), '>', 0.01);
  assert.ok(await page.locator('#layer-add-vectors').isDisabled(), 'there is one layer of vectors');
  await page.press('#vectors-density', 'End');
  await page.press('#vectors-stretch', 'Home');
  compare(difference(await picture(page), streaks), '>', 0.01);
  await page.selectOption('#vectors-style', 'blend');
  await page.locator('#vectors-color').waitFor();
  const { density, stretch, style } = await layer();
  assert.deepEqual([density, stretch, style], [1, 1, 'blend']);
  await fill(page, '#vectors-phase-value', 12.5);
  assert.equal(await page.inputValue('#vectors-phase'), '0.5');
  await page.press('#vectors-speed', 'ArrowRight');
  await page.getByRole('button', { name: 'Play', exact: true }).click();
  await page.getByRole('button', { name: 'Pause', exact: true }).waitFor();
  assert.ok(await page.isDisabled('#vectors-phase'));
  const { count } = await page.evaluate(() => window.splatd);
  await until(page, 'frames without a change of this client', `(s) => s.count > ${count + 3}`);
  await page.selectOption('#vectors-style', 'modulate');
  await until(page, 'the style at the daemon', (s) => s.isIdle && s.view.layers.at(-1).style === 'modulate');
  await page.getByRole('button', { name: 'Pause', exact: true }).click();
  await page.getByRole('button', { name: 'Play', exact: true }).waitFor();
  await until(page, 'the phase of the daemon', (s) => s.view.layers.at(-1).phase < 1);
  const paused = await picture(page);
  await page.click('#transfer-undo');
  await until(page, 'the style before', (s) => s.isIdle && s.view.layers.at(-1).style === 'blend');
  await page.click('#transfer-redo');
  assert.equal(difference(await picture(page), paused), 0);
  await eye(page, 'Vectors').click();
  await page.locator('#vectors-play:disabled').waitFor();
  assert.deepEqual(said, []);
});

test('a preset and a saved view bring the layers back', async (context) => {
  const { page, said } = await withEngine(context);
  await page.click('#layer-add-surface');
  await fill(page, '#surface-value', 100);
  const surface = await picture(page);
  await page.fill('#preset-name', 'layers');
  await page.press('#preset-name', 'Enter');
  await page.locator('#preset option[value="layers"]').waitFor({ state: 'attached' });
  await page.locator('#capture').evaluate((fold) => { fold.open = true; });
  await page.fill('#saved-name', 'layers');
  await page.press('#saved-name', 'Enter');
  await page.locator('#saved li').waitFor();
  const reset = async () => {
    await page.click('#reset-all');
    await until(page, 'the default layers', (s) => s.isIdle && s.view.layers.length === 1);
  };
  await reset();
  await page.selectOption('#preset', ''); // else it is chosen already
  await page.selectOption('#preset', 'layers');
  await until(page, 'the layers of the preset', (s) => s.isIdle && s.view.layers[1]?.value === 100);
  assert.equal(difference(await picture(page), surface), 0);
  await reset();
  await page.locator('#saved .picture').click();
  await until(page, 'the layers of the saved view', (s) => s.isIdle && s.view.layers[1]?.value === 100);
  assert.equal(difference(await picture(page), surface), 0);
  assert.deepEqual(said, []);
});

test('V offers the surface of the value under the cursor, and Fit frames a surface without the volume', async (context) => {
  const { page, said } = await withEngine(context);
  await page.focus('#screen');
  const { width, height } = page.viewportSize();
  await page.mouse.move(width / 2 + 60, height / 2);
  await page.keyboard.press('v');
  await page.getByRole('button', { name: 'Surface of this value' }).click();
  await until(page, 'the surface', (s) => s.view.layers.length === 2);
  const value = Number(await page.inputValue('#surface-value'));
  compare(value, '>', 0);
  await rest(page);
  await page.keyboard.press('v'); // now the cursor is on the surface
  await page.locator('#notice-text', { hasText: /^Value/ }).waitFor();
  assert.equal(await page.locator('.prompt[data-id="pick"]').count(), 0, 'it exists already');
  await fill(page, '#surface-value', 215); // small parts inside
  const before = lit(await picture(page)).share;
  compare(before, '>', 0);
  const from = await page.evaluate(() => JSON.stringify(window.splatd.camera));
  await page.click('#fit');
  await until(page, 'the camera of Fit', `(s) => s.isIdle && JSON.stringify(s.camera) !== ${JSON.stringify(from)}`);
  compare(lit(await picture(page)).share, '>', before);
  assert.deepEqual(said, []);
});

test('a click or a drag in a slice sets the value to the one there, without moving the crosshair', async (context) => {
  const { page, said } = await withEngine(context, real.url, { viewport: { width: 1100, height: 800 } });
  await page.click('#layer-add-surface');
  await page.click('#surface-pick');
  await until(page, 'the newest slices', (s) => s.isIdle && s.layout === 'four' && s.mode === 'surface-value'
    && document.querySelector('#pane-axial .pane-body').dataset.state === 'newest');
  assert.equal(await page.getAttribute('#surface-pick', 'aria-pressed'), 'true');
  const position = await page.evaluate(() => window.splatd.view.slices.position);
  const { x, y, width, height } = await boxOf(page.locator('#pane-axial canvas'));
  const values = () => page.evaluate(() => window.splatd.view.layers[1].value);
  const seen = new Set([await values()]);
  await page.mouse.move(x + width * 0.35, y + height / 2);
  await page.mouse.down();
  for (let i = 0; i <= 10; i += 1) {
    await page.mouse.move(x + width * (0.35 + 0.03 * i), y + height / 2);
    seen.add(await values());
  }
  await page.mouse.up();
  compare(seen.size, '>', 3, [...seen].join(' '));
  assert.deepEqual(await page.evaluate(() => window.splatd.view.slices.position), position);
  await page.click('#transfer-undo'); // the drag was one step
  assert.equal(await values(), [...seen][0]);
  await page.locator('#layer-list [data-index="1"] .small').click();
  await until(page, 'the mode ends with the surface', (s) => s.mode === 'navigate');
  assert.deepEqual(said, []);
});

test('another window sees the layers at once, and changes them when it has control', async (context) => {
  const host = await withEngine(context);
  await host.page.click('#layer-add-surface');
  await rest(host.page);
  await host.page.locator('#people-fold').evaluate((fold) => { fold.open = true; });
  await host.page.click('#link-control');
  const link = await host.page.inputValue('#link-text');
  const guest = await withEngine(context, link);
  await until(guest.page, 'the surface', (s) => s.view.layers.length === 2);
  assert.equal(await rowOf(guest.page, 1).locator('.layer-name').textContent(), 'Surface 1');
  assert.equal(await guest.page.locator('#layers .fold-body[inert]').count(), 1, 'the host has control');
  await fill(host.page, '#surface-value', 200);
  await until(guest.page, 'the value', (s) => s.view.layers[1]?.value === 200);
  compare(difference(await picture(host.page), await picture(guest.page)), '<', 0.001);
  await host.page.click('#control-release');
  await until(guest.page, 'no holder', (s) => !s.people.some((p) => p.isHolder && !p.isYou));
  await guest.page.locator('#people-fold').evaluate((fold) => { fold.open = true; });
  if (!await guest.page.evaluate(() => window.splatd.canControl)) await guest.page.click('#control-ask');
  await until(guest.page, 'control', (s) => s.canControl);
  await eye(guest.page, 'Volume').click();
  await until(host.page, 'the volume', (s) => s.view.layers[0].visible);
  for (const { said } of [host, guest]) assert.deepEqual(said, []);
});
