// SPDX-License-Identifier: Apache-2.0
// The panel "Picture": the patches that it sends and the values that it shows, by keyboard and on a phone.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { boxOf, firstFrame, settle, share, shot, unfold, until, visitMock } from '../support/browser.mjs';
import { volume } from '../support/mock-daemon.mjs';

const PHONE = { viewport: { width: 360, height: 700 }, deviceScaleFactor: 2, isMobile: true, hasTouch: true };
const { browser } = await share();

async function setUp(context, options) {
  const opened = await visitMock(context, browser, { options });
  const { page, daemon } = opened;
  await unfold(page);
  const [session] = daemon.sessions.values();
  return {
    daemon, session, ...opened,
    /** Another participant applies `change` to the view. */
    share(change) {
      session.view = { ...session.view, ...change };
      daemon.notifyAll('view.changed', { by: 2, view: session.view });
    },
  };
}

const enabled = (page) => page.evaluate(() => Object.fromEntries(['kernel', 'sigma', 'cutoff', 'lowpass', 'slab', 'order']
  .map((id) => [id, !document.getElementById(id).disabled])));

test('each choice sends a patch of one field; single splats and post-classification end each other', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  const choose = (id, value) => it.patch(() => page.selectOption(id, value));
  assert.deepEqual(await choose('#filter', 'swan'), { filter: { mode: 'swan' } });
  assert.deepEqual(await choose('#kernel', 'cubic'), { filter: { kernel: 'cubic' } });
  assert.deepEqual(await choose('#attenuation', 'linear'), { compositing: { attenuation: 'linear' } });
  assert.deepEqual(await choose('#compositing', 'splat'), { compositing: { mode: 'splat' } });
  assert.deepEqual(await choose('#order', 'post'), { transfer_function: { order: 'post' }, compositing: { mode: 'sheet' } });
  assert.equal(await page.inputValue('#compositing'), 'sheet');
  assert.deepEqual(await choose('#compositing', 'splat'), { compositing: { mode: 'splat' }, transfer_function: { order: 'auto' } });
  assert.equal(await page.inputValue('#order'), 'auto');
  assert.deepEqual(it.said, []);
});

test('only controls that apply are enabled', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  const all = { kernel: true, sigma: true, cutoff: true, lowpass: true, slab: false, order: true };
  assert.deepEqual(await enabled(page), all);
  await page.selectOption('#kernel', 'cubic');
  assert.deepEqual(await enabled(page), { ...all, sigma: false, cutoff: false });
  await page.selectOption('#filter', 'none');
  assert.deepEqual(await enabled(page), { ...all, kernel: false, sigma: false, cutoff: false, lowpass: false });
  await page.selectOption('#filter', 'reconstruction');
  await page.selectOption('#kernel', 'gaussian');
  await page.selectOption('#compositing', 'slab');
  assert.deepEqual(await enabled(page), { ...all, lowpass: false, slab: true });
  await shot(page, 'picture');
});

test('sliders by keyboard: each step sends a value, which is shown beside the slider', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  const press = (id, key) => it.patch(async () => {
    await page.focus(id);
    await page.keyboard.press(key);
  });
  const told = (id) => page.locator(`.row:has(${id}) output`).textContent();
  const before_ = await page.evaluate(() => window.splatd.camera);
  assert.deepEqual(await press('#sigma', 'ArrowRight'), { filter: { sigma: 0.75 } });
  assert.equal(await told('#sigma'), '0.75');
  assert.deepEqual(await press('#cutoff', 'End'), { filter: { cutoff: 6 } });
  assert.deepEqual(await press('#lowpass', 'Home'), { filter: { lowpass: 0 } });
  assert.equal(await told('#lowpass'), '0 px');
  assert.equal(await page.getAttribute('#lowpass', 'aria-valuetext'), '0 px');
  await page.selectOption('#compositing', 'slab');
  assert.deepEqual(await press('#slab', 'Home'), { compositing: { slab: 0.05 } });
  assert.deepEqual(await press('#slab', 'End'), { compositing: { slab: 64 } });
  assert.equal(await told('#flat'), 'off');
  assert.deepEqual(await press('#flat', 'End'), { transfer_function: { gradient: [{ magnitude: 0, scale: 0 }, { magnitude: 128, scale: 1 }] } });
  assert.equal(await told('#flat'), '128');
  assert.deepEqual(await press('#flat', 'Home'), { transfer_function: { gradient: [] } });
  assert.deepEqual(await page.evaluate(() => window.splatd.camera), before_, 'the arrow keys did not move the camera');
});

test('smoothing is automatic at the left end of its slider, and has no effect without shading', async (context) => {
  const it = await setUp(context);
  const { page, session: { view } } = it;
  const slider = page.locator('#smoothing');
  const told = () => page.locator('.row:has(#smoothing) output').textContent();
  const press = (key) => it.patch(() => slider.press(key));
  assert.ok(await slider.isDisabled(), 'the view has no shading');
  it.share({ shading: { ...view.shading, mode: 'phong' } });
  await until(page, 'shading', () => !document.getElementById('smoothing').disabled);
  assert.equal(await told(), 'auto');
  assert.equal(await slider.getAttribute('aria-valuetext'), 'auto');
  assert.deepEqual(await press('ArrowRight'), { shading: { smoothing: 0 } });
  assert.equal(await told(), '0');
  assert.deepEqual(await press('ArrowRight'), { shading: { smoothing: 0.05 } });
  assert.deepEqual(await press('End'), { shading: { smoothing: 1 } });
  assert.equal(await told(), '1');
  assert.deepEqual(await press('Home'), { shading: { smoothing: null } });
  assert.equal(await told(), 'auto');
  it.share({ shading: { mode: 'phong', smoothing: 0.3 } });
  await until(page, 'the value of another participant', () => document.getElementById('smoothing').value === '0.3');
  assert.equal(await told(), '0.3');
  assert.deepEqual(it.said, []);
});

test('the controls follow the view when another participant changes it', async (context) => {
  const it = await setUp(context);
  const { page, session: { view } } = it;
  it.share({
    filter: { ...view.filter, mode: 'ewa', kernel: 'cubic', lowpass: 2.5 },
    compositing: { mode: 'slab', attenuation: 'linear', slab: 0.25 },
    transfer_function: { ...view.transfer_function, order: 'post', gradient: [{ magnitude: 1, scale: 0.5 }] },
    clip: { box: [[0.1, 0, 0], [1, 0.75, 1]], planes: [{ normal: [0, 0, 2], offset: 30 }] },
  });
  await until(page, 'the order', () => document.getElementById('order').value === 'post');
  const shown = await page.evaluate(() => {
    const value = (id) => document.getElementById(id).value;
    const output = (id) => document.getElementById(id).closest('.row').querySelector('output').textContent;
    return {
      choices: ['filter', 'kernel', 'compositing', 'attenuation'].map(value), lowpass: output('lowpass'), slab: output('slab'), flat: output('flat'),
      box: [...document.querySelectorAll('.pair input')].map((face) => Number(face.value)),
      plane: document.querySelector('#planes input[role="switch"]').checked, position: document.getElementById('plane-position').value,
      depth: document.getElementById('plane-depth').getAttribute('aria-valuetext'),
    };
  });
  // The plane's normal has length 2, so the plane lies at z = 30 / 2 = 15: a quarter of the volume's extent from -1 to 63.
  assert.deepEqual(shown, {
    choices: ['ewa', 'cubic', 'slab', 'linear'], lowpass: '2.5 px', slab: '0.25', flat: 'other', box: [0.1, 1, 0, 0.75, 0, 1], plane: true, position: '15', depth: '25 % removed',
  });
  assert.deepEqual(await it.patches(async () => {}), [], 'the controls send nothing back');
  it.share({ filter: { ...view.filter, mode: 'splendid' } });
  await until(page, 'a choice that the page does not know', () => document.getElementById('filter').value === 'splendid');
  assert.deepEqual(it.said, []);
});

test('the colour bar follows every change, covers nothing and is switched off', async (context) => {
  const it = await setUp(context);
  const { page } = it;
  const bar = page.getByRole('img', { name: /^Colours of/ });
  const says = (text) => page.getByRole('img', { name: text, exact: true }).waitFor();
  await says('Colours of values: from 60 to 255');
  assert.deepEqual(await page.locator('.color-ticks span').allTextContents(), ['60', '100', '150', '200', '255']);
  const points = [{ value: 10, color: [0, 0, 1], opacity: 0 }, { value: 20, color: [0, 0, 1], opacity: 0.5 }, { value: 30, color: [0, 0, 1], opacity: 0 }];
  it.share({ transfer_function: { ...it.session.view.transfer_function, points } });
  await says('Colours of values: from 10 to 30');
  const middle = await page.evaluate(() => {
    const canvas = document.querySelector('#color-bar canvas');
    return [...canvas.getContext('2d').getImageData(0, canvas.height / 2, 1, 1).data];
  });
  assert.deepEqual(middle, [0, 0, 255, 255]);
  await settle(page);
  const boxes = await Promise.all(['#cube', '#color-bar', '#scale-bar'].map((name) => boxOf(page.locator(name))));
  for (const [i, { y, height }] of boxes.slice(0, 2).entries()) compare(y + height, '<=', boxes[i + 1].y);
  it.share({ compositing: { mode: 'maximum', window: { center: 100, width: 50 } } });
  await says('Colours of largest values: from 75 to 125');
  it.share({ layers: [{ type: 'surface', visible: true, value: 100, color: [1, 0, 0], opacity: 1, flatness: 'inf' }], compositing: { mode: 'sheet' } });
  await bar.waitFor({ state: 'hidden' });
  it.share({ layers: [{ type: 'volume', visible: true }] });
  await bar.waitFor();
  await page.uncheck('#color-bar-on');
  await bar.waitFor({ state: 'hidden' });
  await page.reload();
  await until(page, 'a frame', (s) => s.state === 'live' && s.count > 0);
  assert.equal(await page.isChecked('#color-bar-on'), false);
  assert.ok(await bar.isHidden());
  assert.deepEqual(it.said, []);
});

test('on a phone every control fits in the panel and responds to touch', async (context) => {
  const it = await setUp(context, PHONE);
  const { page } = it;
  await page.tap('#panel-toggle');
  await shot(page, 'phone-picture');
  const outside = await page.evaluate(() => {
    const panel = document.getElementById('panel').getBoundingClientRect();
    return [...document.querySelectorAll('#panel select, #panel input, #panel button, #panel output')]
      .filter((control) => control.checkVisibility())
      .filter((control) => {
        const box = control.getBoundingClientRect();
        return box.width === 0 || box.left < panel.left || box.right > panel.right || box.right > window.innerWidth;
      }).map((control) => control.id || control.outerHTML);
  });
  assert.deepEqual(outside, []);
  assert.equal(await page.evaluate(() => document.scrollingElement.scrollWidth > window.innerWidth), false);
  await page.locator('#sigma').scrollIntoViewIfNeeded();
  const { x, y, width, height } = await boxOf(page.locator('#sigma'));
  const patch = await it.patches(() => page.touchscreen.tap(x + width - 3, y + height / 2));
  compare(patch.at(-1).filter.sigma, '>', 1.8);
  await page.locator('#plane-sight').scrollIntoViewIfNeeded();
  await page.tap('#plane-sight');
  await until(page, 'the plane', () => document.querySelector('#planes input[role="switch"]')?.checked);
  await shot(page, 'phone-clip');
  assert.deepEqual(it.said, []);
});

// This daemon has no slices, so their requests fail.
test('a thick stack begins with slices; the next volume goes back to the picture, also after a reload', async (context) => {
  const { page } = await visitMock(context, browser, { change: { volumes: [volume('stack', { first_layout: 'slices' }), volume('phantom')] } });
  const layout = (name) => page.locator(`#layout-${name}[aria-pressed="true"]`).waitFor();
  await layout('slices');
  await page.reload();
  await firstFrame(page);
  await layout('slices');
  await page.click('#volumes button[data-id="phantom"]');
  await layout('3d');
  await page.click('#volumes button[data-id="stack"]');
  await until(page, 'the stack', (s) => s.isIdle && s.volume === 'stack');
  await layout('3d');
});
