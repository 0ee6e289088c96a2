// SPDX-License-Identifier: Apache-2.0
// The panel "Transfer function": every control and the patches that it sends, by mouse, keyboard and touch; files, undo, colour
// maps, presets, window and level, the gradient axis, and who may edit.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { after, before, test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { boxOf, checkAxe, eventually, firstFrame, NEEDS_AXE, share, shot, until, visitMock } from '../support/browser.mjs';
import { histogram, volume } from '../support/mock-daemon.mjs';

const PHONE = { viewport: { width: 360, height: 700 }, deviceScaleFactor: 2, isMobile: true, hasTouch: true };
const LARGE = { viewport: { width: 720, height: 1000 } };
const { browser } = await share();

async function setUp(context, options = LARGE, change = {}) {
  const opened = await visitMock(context, browser, { options, change });
  const { page, daemon } = opened;
  if (options.isMobile) await page.tap('#panel-toggle');
  const drawn = () => page.evaluate(() => new Promise((then) => { requestAnimationFrame(() => requestAnimationFrame(() => then())); }));
  await until(page, 'the points', () => document.querySelectorAll('#transfer-curve .handle').length > 0);
  const plot = page.locator('#transfer-curve .plot');
  await plot.scrollIntoViewIfNeeded();
  const [session] = daemon.sessions.values();
  const it = {
    ...opened, session, plot, drawn,
    handle: (i) => page.locator('#transfer-curve .handle').nth(i),
    points: () => page.evaluate(() => window.splatd.transfer.points),
    /** A place of the plot on the screen, by shares of its width and height, from the lower left corner. */
    async place(x, y) {
      const box = await boxOf(plot);
      return [box.x + 1 + (box.width - 2) * x, box.y + 1 + (box.height - 2) * (1 - y)];
    },
    patches: async (act) => (await opened.patches(async () => {
      await act();
      await drawn();
    })).map((patch) => patch.transfer_function),
    async patch(act) {
      const all = await it.patches(act);
      assert.equal(all.length, 1, JSON.stringify(all));
      return all[0];
    },
    share(transfer) {
      session.view = { ...session.view, transfer_function: { ...session.view.transfer_function, ...transfer } };
      daemon.notifyAll('view.changed', { by: 2, view: session.view });
    },
    fill: (id, value) => it.patches(async () => {
      await page.fill(id, String(value));
      await page.press(id, 'Enter');
    }),
  };
  return it;
}

const values = (points) => points.map((p) => p.value);
const near = (a, b, least, what) => compare(Math.abs(a - b), '<', least, what ?? `${a} and ${b}`);

test('the histogram of the daemon lies behind the points of the view', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  assert.ok(it.daemon.requests.some((r) => r.endsWith('/histogram')));
  await until(page, 'the presets', () => !document.getElementById('transfer-kind').disabled);
  assert.equal(await page.locator('#transfer-curve .handle').count(), 2);
  assert.equal(await it.handle(1).getAttribute('aria-valuetext'), 'value 200, opacity 0.5');
  assert.equal(await it.handle(1).getAttribute('aria-label'), 'Point 2 of 2');
  await it.drawn();
  // The peak of matter at 120 reaches the top of the plot; beside it, at 60, there is next to nothing.
  const ink = await page.evaluate(() => {
    const shown = document.querySelector('#transfer-curve canvas');
    const canvas = new OffscreenCanvas(shown.width, shown.height);
    const context = canvas.getContext('2d', { willReadFrequently: true });
    context.drawImage(shown, 0, 0);
    const at = (x, y) => context.getImageData(Math.round(canvas.width * x), Math.round(canvas.height * y), 1, 1).data[3];
    return [at(120 / 255, 0.1), at(60 / 255, 0.1)];
  });
  compare(ink[0], '>', 20);
  assert.equal(ink[1], 0);
  await shot(page, 'transfer');
  assert.deepEqual(it.said, []);
});

test('a point is dragged: at most one patch per animation frame, one step for undo', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  const start = await it.points();
  await page.evaluate(() => {
    window.frames_ = 0;
    const count = () => { window.frames_ += 1; requestAnimationFrame(count); };
    requestAnimationFrame(count);
  });
  const sent = await it.patches(async () => {
    await page.mouse.move(...await it.place(200 / 255, 0.5));
    await page.mouse.down();
    for (let i = 1; i <= 40; i += 1) await page.mouse.move(...await it.place((200 - i) / 255, 0.5 + i / 200));
    await page.mouse.up();
  });
  compare(sent.length, '>', 1);
  compare(sent.length, '<=', 1 + await page.evaluate(() => window.frames_));
  const { points } = sent.at(-1);
  assert.deepEqual(Object.keys(sent.at(-1)), ['points']);
  near(points[1].value, 160, 2);
  near(points[1].opacity, 0.7, 0.02);
  assert.deepEqual(points[0], start[0]);
  assert.deepEqual((await it.patch(() => page.click('#transfer-undo'))).points, start);
  assert.ok(await page.locator('#transfer-undo').isDisabled());
  assert.deepEqual((await it.patch(() => page.keyboard.press('Control+Shift+Z'))).points, points);
  assert.deepEqual((await it.patch(() => page.keyboard.press('Control+z'))).points, start);
  assert.deepEqual((await it.patch(() => page.click('#transfer-redo'))).points, points);
  // A point stops at its neighbour.
  await it.patches(async () => {
    await page.mouse.move(...await it.place(points[1].value / 255, points[1].opacity));
    await page.mouse.down();
    await page.mouse.move(...await it.place(0, 0.2), { steps: 4 });
    await page.mouse.up();
  });
  const [first, second] = await it.points();
  compare(second.value, '>', first.value);
  assert.deepEqual(it.said, []);
});

test('points are added by a click, typed as numbers and removed', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  const added = await it.patch(async () => page.mouse.click(...await it.place(130 / 255, 0.8)));
  assert.equal(added.points.length, 3);
  near(added.points[1].value, 130, 1.5);
  near(added.points[1].opacity, 0.8, 0.02);
  near(added.points[1].color[1], 0.95, 0.01, 'the colour of the curve there');
  assert.equal(await page.locator('#transfer-curve [data-part="count"]').textContent(), '2 of 3');
  assert.equal((await it.fill('#transfer-value', 140))[0].points[1].value, 140);
  assert.equal((await it.fill('#transfer-opacity', 0.025))[0].points[1].opacity, 0.025);
  // A typed value may pass other points; the point stays selected.
  const passed = (await it.fill('#transfer-value', 230))[0].points;
  assert.deepEqual(values(passed), [60, 200, 230]);
  assert.equal(await page.locator('#transfer-curve [data-part="count"]').textContent(), '3 of 3');
  assert.equal((await it.fill('#transfer-opacity', 5))[0].points[2].opacity, 0.999);
  assert.deepEqual(await it.fill('#transfer-value', ''), [], 'an empty field changes nothing');
  assert.equal(await page.inputValue('#transfer-value'), '230');
  // Undo also works in a number field of this panel.
  await page.focus('#transfer-value');
  assert.equal((await it.patch(() => page.keyboard.press('Control+z'))).points[2].opacity, 0.025);
  assert.deepEqual(values((await it.patch(() => page.click('#transfer-curve [data-part="remove"]'))).points), [60, 200]);
  assert.deepEqual(values((await it.patch(() => page.click('#transfer-curve [data-part="add"]'))).points), [60, 200, 227.5]);
  await page.mouse.click(...await it.place(60 / 255, 0), { button: 'right' });
  await until(page, 'two points', (s) => s.transfer.points.length === 2);
  await page.click('#transfer-curve [data-part="remove"]');
  await until(page, 'one point', (s) => s.transfer.points.length === 1);
  await it.drawn();
  assert.ok(await page.locator('#transfer-curve [data-part="remove"]').isDisabled(), 'the last point stays');
  assert.deepEqual(it.said, []);
});

test('by keyboard: every point is reached by Tab, moves by arrows and is removed by Delete', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  const camera = await page.evaluate(() => window.splatd.camera);
  await page.focus('#transfer-wide');
  const label = () => page.evaluate(() => document.activeElement.getAttribute('aria-label'));
  await page.keyboard.press('Tab');
  assert.equal(await label(), 'Point 1 of 2');
  await page.keyboard.press('Tab');
  assert.equal(await label(), 'Point 2 of 2');
  near((await it.patch(() => page.keyboard.press('ArrowRight'))).points[1].value, 202.55, 1e-6);
  near((await it.patch(() => page.keyboard.press('Shift+ArrowLeft'))).points[1].value, 202.295, 1e-6);
  near((await it.patch(() => page.keyboard.press('ArrowUp'))).points[1].opacity, 0.51, 1e-6);
  near((await it.patch(() => page.keyboard.press('PageDown'))).points[1].opacity, 0.41, 1e-6);
  assert.equal(await page.evaluate(() => getComputedStyle(document.activeElement).outlineStyle), 'solid', 'the focus is visible');
  assert.equal((await it.patch(() => page.keyboard.press('Delete'))).points.length, 1);
  assert.equal(await label(), 'Point 1 of 1', 'the focus stays in the plot');
  assert.deepEqual(await page.evaluate(() => window.splatd.camera), camera);
  const nameless = await page.evaluate(() => [...document.querySelectorAll('#transfer button, #transfer input:not([type="file"]), #transfer select')]
    .filter((control) => !(control.getAttribute('aria-label') || control.labels?.length || control.textContent.trim())).map((control) => control.outerHTML));
  assert.deepEqual(nameless, []);
  assert.deepEqual(it.said, []);
});

test('zoom: small opacities and narrow ranges of values become easy to edit', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  await page.selectOption('#transfer-top', '0.03');
  await it.drawn();
  assert.ok(await it.handle(1).evaluate((handle) => handle.hasAttribute('data-above')), 'a point above the plot is marked');
  const added = await it.patch(async () => page.mouse.click(...await it.place(0.5, 0.5)));
  near(added.points[1].opacity, 0.015, 0.001);
  for (let i = 0; i < 3; i += 1) await page.click('#transfer-curve [data-part="closer"]');
  await it.drawn();
  const seen = async () => (await page.locator('#transfer-curve .axis').textContent()).split('value').map(Number);
  const [low, high] = await seen();
  near(high - low, 255 / 1.6 ** 3, 2);
  const fine = await it.patch(async () => page.mouse.click(...await it.place(0.25, 0.9)));
  near(fine.points[1].value, low + (high - low) / 4, 1);
  await page.click('#transfer-curve [data-part="all"]');
  await it.drawn();
  assert.deepEqual(await seen(), [0, 255]);
  await page.mouse.move(...await it.place(0.5, 0.5));
  await page.keyboard.down('Shift');
  await page.mouse.wheel(0, -300);
  await page.keyboard.up('Shift');
  await until(page, 'a zoom by the wheel', () => Number(document.querySelector('#transfer-curve [data-part="high"]').textContent) < 255);
});

test('the colour of a point: a picker and numbers', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  await it.handle(1).focus();
  assert.equal(await page.inputValue('#transfer-color'), '#ffffff');
  const picked = await it.patches(() => page.locator('#transfer-color').evaluate((input) => {
    for (const value of ['#102030', '#336699']) {
      input.value = value;
      input.dispatchEvent(new Event('input', { bubbles: true }));
    }
    input.dispatchEvent(new Event('change', { bubbles: true }));
  }));
  assert.deepEqual(picked.at(-1).points[1].color, [0.2, 0.4, 0.6]);
  assert.deepEqual(await page.locator('#transfer-rgb input').evaluateAll((all) => all.map((field) => field.value)), ['51', '102', '153']);
  const red = page.locator('#transfer-rgb input').first();
  assert.deepEqual((await it.patch(async () => {
    await red.fill('999');
    await red.press('Enter');
  })).points[1].color, [1, 0.4, 0.6]);
  await it.patch(() => page.keyboard.press('Control+z'));
  assert.deepEqual((await it.patch(() => page.keyboard.press('Control+z'))).points[1].color, [1, 1, 1], 'one pick is one step');
});

test('colour maps: chosen, reversed, in steps, over a range; a reload keeps them; the colour of a point ends them', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  const viridis = (await it.patch(() => page.selectOption('#transfer-map', 'viridis'))).points;
  compare(viridis.length, '>', 4);
  assert.equal(await page.locator('#transfer-curve .handle').count(), 2, 'the colours of the map are no points');
  viridis[0].color.forEach((part, k) => near(part, [0x44, 1, 0x54][k] / 255, 1e-3));
  assert.deepEqual([viridis[0].opacity, viridis.at(-1).opacity], [0, 0.5]);
  const back = (await it.patch(() => page.click('#transfer-reverse'))).points;
  assert.deepEqual(back[0].color, viridis.at(-1).color);
  const steps = (await it.fill('#transfer-steps', 3))[0].points;
  assert.equal(new Set(steps.map((p) => String(p.color))).size, 3);
  await shot(page, 'transfer-map');
  const wider = (await it.fill('#transfer-map-high', 340))[0].points;
  assert.equal(wider.at(-1).value, 340);
  // Dragging a point moves the opacity and leaves the colours.
  const dragged = await it.patches(async () => {
    await it.handle(0).focus();
    await page.keyboard.press('ArrowUp');
  });
  assert.deepEqual(dragged.at(-1).points.map((p) => p.color), wider.map((p) => p.color));
  await page.reload();
  await firstFrame(page);
  await until(page, 'the map', () => document.getElementById('transfer-map').value === 'viridis');
  assert.equal(await page.locator('#transfer-curve .handle').count(), 2);
  assert.equal(await page.inputValue('#transfer-steps'), '3');
  const own = await it.patch(async () => {
    await it.handle(1).focus();
    const green = page.locator('#transfer-rgb input').nth(1);
    await green.fill('7');
    await green.press('Enter');
  });
  assert.equal(own.points.length, wider.length);
  assert.equal(await page.inputValue('#transfer-map'), '');
  assert.equal(await page.locator('#transfer-curve .handle').count(), wider.length);
  assert.deepEqual(it.said, []);
});

test('presets by kind of data are placed by the histogram and say how', async (context) => {
  const scan = { histogramOf: (id) => histogram(id, { range: [-1024, 3071], type: 'int16' }) };
  const it = await setUp(context, LARGE, scan);
  const { page } = it;
  await until(page, 'the presets', () => !document.getElementById('transfer-kind').disabled);
  const start = await it.points();
  const kinds = (await page.locator('#transfer-kind option').evaluateAll((all) => all.map(({ value }) => value))).filter((kind) => kind && kind !== 'default');
  assert.equal(kinds.length, 7);
  for (const kind of kinds) {
    const sent = await it.patches(() => page.selectOption('#transfer-kind', kind));
    assert.equal(sent.length, 1, kind);
    compare(Math.max(...sent[0].points.map((p) => p.opacity)), '>', 0.05, kind);
  }
  const bone = await it.patch(() => page.selectOption('#transfer-kind', 'ct-bone'));
  assert.equal(bone.points[0].value, 150);
  assert.equal(await page.locator('#transfer-note').textContent(), 'The file states no unit, but the values look like Hounsfield units.');
  const chosen = () => page.locator('#transfer-kind').inputValue();
  assert.equal(await chosen(), 'ct-bone');
  await page.selectOption('#transfer-map', 'inferno'); // other colours of the same kind
  await it.drawn();
  assert.equal(await chosen(), 'ct-bone');
  await page.click('#transfer-undo');
  await it.patch(async () => {
    await page.fill('#transfer-value', '140');
    await page.press('#transfer-value', 'Enter');
  });
  await until(page, 'it is no longer the kind', () => document.getElementById('transfer-kind').value === '' && document.getElementById('transfer-note').hidden);
  await page.click('#transfer-undo');
  await page.selectOption('#transfer-kind', 'default');
  await until(page, 'the default of the daemon', (s) => s.transfer.points.length === 2);
  await it.drawn();
  assert.equal(await chosen(), 'default');
  assert.deepEqual(await it.points(), start);
  await page.click('#transfer-undo');
  await page.click('#transfer-undo');
  await until(page, 'the preset before', () => document.getElementById('transfer-map').value === 'viridis');
});

test('another volume starts again: its histogram, its points, nothing to undo', async (context) => {
  const it = await setUp(context, LARGE, {
    volumes: [volume('phantom'), volume('head', { range: [-1000, 3000], fields: [{ name: '', components: 1, type: 'int16', range: [-1000, 3000], unit: 'HU' }] })],
    histogramOf: (id, isJoint) => histogram(id, { isJoint, range: id === 'head' ? [-1000, 3000] : [0, 255] }),
  });
  const { page } = it;
  await it.patch(async () => page.mouse.click(...await it.place(0.5, 0.5)));
  await page.click('#volumes button[data-id="head"]');
  await until(page, 'the range of the head', () => document.querySelector('#transfer-curve [data-part="high"]').textContent === '3000');
  assert.equal(await page.locator('#transfer-curve .handle').count(), 2);
  assert.ok(await page.locator('#transfer-undo').isDisabled());
  await page.selectOption('#transfer-kind', 'ct-soft');
  await until(page, 'the preset', (s) => s.transfer.points[0].value === -180);
  assert.deepEqual(it.said, []);
});

test('without a histogram the editor works and says what is missing', async (context) => {
  const it = await setUp(context, LARGE, { histogramOf: () => null });
  const { page } = it;
  await page.locator('#transfer-note', { hasText: 'There is no histogram: this daemon has no histograms' }).waitFor();
  assert.ok(await page.locator('#transfer-kind').isDisabled());
  assert.equal((await it.patch(async () => page.mouse.click(...await it.place(0.5, 0.5)))).points.length, 3);
});

const json = (name, content) => ({ name, mimeType: 'application/json', buffer: Buffer.from(typeof content === 'string' ? content : JSON.stringify(content)) });

test('files: export and import of both formats; a bad file is explained beside the button and changes nothing', async (context) => {
  const it = await setUp(context, { ...LARGE, acceptDownloads: true });
  const { page } = it;
  const save = async (id) => {
    const [download] = await Promise.all([page.waitForEvent('download'), page.click(id)]);
    return [download.suggestedFilename(), readFileSync(await download.path(), 'utf8')];
  };
  const start = await it.points();
  const [name, own] = await save('#transfer-export');
  assert.equal(name, 'phantom-transfer-function.json');
  const [, paraview] = await save('#transfer-paraview');
  const take = (file) => it.patches(async () => {
    await page.setInputFiles('#transfer-file', file);
    await page.locator('#transfer-file-said', { hasText: file.name }).waitFor();
  });
  await page.selectOption('#transfer-map', 'turbo');
  assert.deepEqual((await take(json('own.json', own)))[0].points, start);
  await page.selectOption('#transfer-map', 'inferno');
  assert.deepEqual((await take(json('paraview.json', paraview)))[0].points, start);
  assert.equal(await page.locator('#transfer-file-said').getAttribute('class'), 'about');
  const map = [{ Name: 'Cool to Warm', ColorSpace: 'Diverging', RGBPoints: [0, 0.23, 0.3, 0.75, 1, 0.7, 0.02, 0.15] }];
  const colored = (await take(json('map.json', map)))[0].points;
  compare(colored.length, '>', 3);
  assert.equal(await page.locator('#transfer-map option:checked').textContent(), 'Cool to Warm');
  assert.equal(await page.locator('#transfer-curve .handle').count(), 2);
  for (const [file, error] of [[json('broken.json', '{'), /broken\.json: The file is not JSON/], [json('other.json', { a: 1 }), /neither a transfer function/],
    [json('wrong.json', { transfer_function: { points: [{ value: 1, opacity: 2, color: [0, 0, 0] }] } }), /Point 1: "opacity" is 2, outside/],
    [json('huge.json', 'x'.repeat(2 << 20)), /at most 1048576/]]) {
    assert.deepEqual(await take(file), [], file.name);
    assert.match(await page.locator('#transfer-file-said').textContent(), error);
    assert.equal(await page.locator('#transfer-file-said').getAttribute('class'), 'complaint');
    assert.ok(await page.locator('#transfer-file-said').isVisible());
  }
  await shot(page, 'transfer-bad-file');
  assert.deepEqual(it.said, []);
});

test('window and level by dragging in the picture: visible while it is on, left by Escape', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  const start = await it.points();
  await page.click('#transfer-window');
  assert.ok(await page.locator('#mode-bar').isVisible());
  assert.equal(await page.getAttribute('#transfer-window', 'aria-pressed'), 'true');
  const camera = await page.evaluate(() => window.splatd.camera);
  const drag = (dx, dy) => it.patches(async () => {
    await page.mouse.move(600, 500);
    await page.mouse.down();
    await page.mouse.move(600 + dx, 500 + dy, { steps: 6 });
    await page.mouse.up();
  });
  const wider = (await drag(180, 0)).at(-1).points;
  near(wider[1].value - wider[0].value, 140 * Math.E, 0.01);
  near(wider[1].value + wider[0].value, 260, 0.01, 'the level stays');
  assert.match(await page.locator('#mode-text').textContent(), /Window 380\.56 · Level 130/);
  await shot(page, 'transfer-window');
  assert.deepEqual((await it.patch(() => page.click('#transfer-undo'))).points, start, 'a drag is one step');
  const higher = (await drag(0, -60)).at(-1).points;
  near(higher[0].value - start[0].value, 25.5, 0.01);
  await page.focus('#screen');
  compare((await it.patch(() => page.keyboard.press('ArrowDown'))).points[0].value, '<', higher[0].value);
  assert.deepEqual(await page.evaluate(() => window.splatd.camera), camera);
  await page.keyboard.press('Escape');
  assert.ok(!(await page.locator('#mode-bar').isVisible()));
  await page.keyboard.press('w');
  assert.ok(await page.locator('#mode-bar').isVisible());
  await page.click('#mode-done');
  await page.mouse.move(600, 500);
  await page.mouse.down();
  await page.mouse.move(650, 520, { steps: 3 });
  await page.mouse.up();
  assert.notDeepEqual(await page.evaluate(() => window.splatd.camera), camera, 'the drag turns again');
  assert.deepEqual(it.said, []);
});

test('the gradient axis: its histogram is read when the panel opens, points work as in the curve above', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  const asked = () => it.daemon.requests.filter((r) => r.endsWith('/histogram')).length;
  const first = asked();
  await page.click('#gradient summary');
  await eventually('the joint histogram', () => asked() === first + 1);
  await until(page, 'its range', () => document.querySelector('#gradient-curve [data-part="high"]').textContent === '80');
  const added = await it.patch(async () => {
    const plot = page.locator('#gradient-curve .plot');
    await plot.scrollIntoViewIfNeeded();
    const box = await boxOf(plot);
    await page.mouse.click(box.x + 1 + (box.width - 2) / 4, box.y + 2);
  });
  assert.equal(added.gradient.length, 2);
  assert.deepEqual(added.gradient[0], { magnitude: 0, scale: 0 });
  near(added.gradient[1].magnitude, 20, 1);
  near(added.gradient[1].scale, 1, 0.02);
  await it.drawn();
  await shot(page, 'transfer-gradient');
  assert.equal((await it.fill('#gradient-factor', 0.5))[0].gradient.some((p) => p.scale === 0.5), true);
  assert.deepEqual(await it.patch(() => page.click('#gradient-off')), { gradient: [] });
  assert.equal(await page.locator('#gradient-curve .handle').count(), 0);
  assert.equal((await it.patch(() => page.click('#transfer-undo'))).gradient.length, 2);
  assert.deepEqual(it.said, []);
});

test('changes of others are shown, and undo returns to what was before', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  const start = await it.points();
  it.share({ points: [{ value: 10, opacity: 0, color: [0, 0, 1] }, { value: 20, opacity: 0.2, color: [0, 1, 1] }, { value: 30, opacity: 0.9, color: [1, 1, 1] }] });
  await until(page, 'three points', () => document.querySelectorAll('#transfer-curve .handle').length === 3);
  assert.deepEqual(await it.patches(async () => {}), [], 'the editor sends nothing back');
  assert.deepEqual((await it.patch(() => page.click('#transfer-undo'))).points, start);
});

test('without control the editor is read-only, says why, and follows', async (context) => {
  const it = await setUp(context);
  const { page, daemon } = it;
  await page.click('#transfer-window');
  daemon.notifyAll('session.participants', { you: 1, participants: [{ id: 1, role: 'control' }, { id: 2, role: 'control', name: 'Grace' }] });
  daemon.notifyAll('session.control', { holder: 2, requests: [] });
  await page.locator('#transfer-why', { hasText: 'Grace has control. Ask for it under People' }).waitFor();
  await it.drawn();
  assert.ok(!(await page.locator('#mode-bar').isVisible()), 'the mode ends with control');
  for (const id of ['#transfer-undo', '#transfer-window', '#transfer-kind', '#transfer-map', '#transfer-import', '#transfer-value', '#transfer-color']) {
    assert.ok(await page.locator(id).isDisabled(), id);
  }
  assert.ok(await page.locator('#transfer-export').isEnabled(), 'everybody may export');
  await page.click('#transfer-curve [data-part="closer"]');
  await page.click('#transfer-curve [data-part="all"]');
  await page.click('#transfer-curve [data-part="after"]');
  assert.equal(await page.locator('#transfer-curve [data-part="count"]').textContent(), '2 of 2', 'everybody may look');
  const sent = await it.patches(async () => {
    await page.mouse.click(...await it.place(0.5, 0.5));
    await page.mouse.move(...await it.place(200 / 255, 0.5));
    await page.mouse.down();
    await page.mouse.move(...await it.place(0.3, 0.9), { steps: 4 });
    await page.mouse.up();
    await page.keyboard.press('Control+z');
  });
  assert.deepEqual(sent, []);
  await shot(page, 'transfer-locked');
  it.share({ points: [{ value: 10, opacity: 0.5, color: [0, 0, 1] }] });
  await until(page, 'one point', () => document.querySelectorAll('#transfer-curve .handle').length === 1);
  daemon.notifyAll('session.control', { holder: null, requests: [] });
  await until(page, 'control', () => document.getElementById('transfer-why').hidden);
  assert.deepEqual(it.said, []);
});

for (const colorScheme of ['dark', 'light']) {
  test(`on a phone, ${colorScheme}: points move by touch, all controls fit, and texts have contrast`, async (context) => {
    const it = await setUp(context, { ...PHONE, colorScheme });
    const { page } = it;
    const box = await boxOf(it.plot);
    const touch = await it.context.newCDPSession(page);
    const at = (x, y) => [{ x: box.x + 1 + (box.width - 2) * x, y: box.y + 1 + (box.height - 2) * (1 - y) }];
    const dragged = await it.patches(async () => {
      await touch.send('Input.dispatchTouchEvent', { type: 'touchStart', touchPoints: at(200 / 255, 0.5) });
      for (let i = 1; i <= 8; i += 1) await touch.send('Input.dispatchTouchEvent', { type: 'touchMove', touchPoints: at((200 - 5 * i) / 255, 0.5 + i / 40) });
      await touch.send('Input.dispatchTouchEvent', { type: 'touchEnd', touchPoints: [] });
    });
    near(dragged.at(-1).points[1].value, 160, 4);
    near(dragged.at(-1).points[1].opacity, 0.7, 0.04);
    const [{ x, y }] = at(0.9, 0.2);
    assert.equal((await it.patch(() => page.touchscreen.tap(x, y))).points.length, 3, 'a tap adds a point');
    const selected = () => page.evaluate(() => [...document.querySelectorAll('#transfer .handle')].findIndex((handle) => handle.hasAttribute('data-selected')));
    const [{ x: left, y: above }] = at(160 / 255, 0.7);
    await page.fill('#transfer-value', '175');
    await page.fill('#transfer-opacity', '0.7');
    await page.press('#transfer-opacity', 'Enter');
    await it.drawn();
    assert.equal(await selected(), 2);
    await page.touchscreen.tap(left - 8, above);
    assert.equal(await selected(), 1, 'of two points below a finger, the nearer one');
    await page.tap('#gradient summary');
    await page.selectOption('#transfer-map', 'turbo');
    await it.drawn();
    const outside = await page.evaluate(() => {
      const panel = document.getElementById('panel').getBoundingClientRect();
      return [...document.querySelectorAll('#transfer select, #transfer input, #transfer button:not(.handle), #transfer output, #transfer .plot')]
        .filter((control) => control.checkVisibility()).filter((control) => {
          const { left, right, width } = control.getBoundingClientRect();
          return width === 0 || left < panel.left || right > panel.right;
        }).map((control) => control.id || control.outerHTML);
    });
    assert.deepEqual(outside, []);
    const contrast = await page.evaluate(() => {
      const context_ = new OffscreenCanvas(1, 1).getContext('2d', { willReadFrequently: true });
      const rgb = (color) => {
        context_.clearRect(0, 0, 1, 1);
        context_.fillStyle = color;
        context_.fillRect(0, 0, 1, 1);
        return [...context_.getImageData(0, 0, 1, 1).data.slice(0, 3)];
      };
      const light = (color) => rgb(color).map((c) => c / 255).map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4))
        .reduce((sum, c, k) => sum + c * [0.2126, 0.7152, 0.0722][k], 0);
      const style = getComputedStyle(document.documentElement);
      const glass = light(style.getPropertyValue('--glass').replace(/\/.*\)/, ')'));
      return ['--text', '--soft', '--bad'].map((name) => light(style.getPropertyValue(name))).map((ink) => (Math.max(ink, glass) + 0.05) / (Math.min(ink, glass) + 0.05));
    });
    for (const ratio of contrast) compare(ratio, '>=', 4.5);
    await shot(page, `phone-transfer-${colorScheme}`);
    assert.deepEqual(it.said, []);
  });
}

for (const colorScheme of ['dark', 'light']) {
  test(`axe finds nothing in the open panel, ${colorScheme}`, NEEDS_AXE, async (context) => {
    const it = await setUp(context, { viewport: { width: 1000, height: 1800 }, colorScheme, bypassCSP: true });
    const { page } = it;
    await page.click('#gradient summary');
    await page.selectOption('#transfer-map', 'turbo');
    await page.click('#transfer-window');
    await it.drawn();
    await checkAxe(page);
  });
}
