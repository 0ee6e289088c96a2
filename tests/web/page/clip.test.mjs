// SPDX-License-Identifier: Apache-2.0
// Clipping: the box and the planes in the panel, with the patches that they send, and their handles in pictures of a block.
import assert from 'node:assert/strict';
import { after, test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { lit, writeBlock } from '../support/block.mjs';
import { boxOf, drag, firstFrame, openPage, pixels, rest, share, shot, touch, until, visitMock } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';
import { volume } from '../support/mock-daemon.mjs';
import { close } from '../support/numbers.mjs';

const PHONE = { viewport: { width: 390, height: 700 }, deviceScaleFactor: 1, isMobile: true, hasTouch: true };
const DESK = { viewport: { width: 800, height: 560 }, reducedMotion: 'reduce' };
const block = writeBlock();
const { browser, daemon: real } = await share(() => startDaemon(['--volume', block.file]), () => block.remove());

/** A page with a daemon that only answers: for the patches. Its volume reaches from z = -1 to 63 and is seen along -z. */
async function withMock(context, options) {
  const opened = await visitMock(context, browser, { options });
  const { page, patch } = opened;
  await page.locator('#clip summary').click();
  return {
    ...opened,
    async press(at, key) {
      return patch(async () => {
        await page.focus(at);
        await page.keyboard.press(key);
      });
    },
  };
}

/** The front view of the block from the real daemon, with handles. */
async function withBlock(context, options = DESK) {
  const opened = await openPage(browser, options);
  context.after(() => opened.context.close());
  const { page } = opened;
  await page.goto(real.url);
  await firstFrame(page);
  await page.locator('#screen').focus();
  for (const key of ['t', '1', 'c']) await page.keyboard.press(key);
  await until(page, 'the front', (s) => s.camera.position[0] === s.camera.target[0]);
  await rest(page);
  await page.locator('#clip-handles').waitFor();
  return opened;
}

const slider = (axis, corner) => `#clip .pair input[data-axis="${axis}"][data-end="${corner}"]`;
const number = (axis, corner) => `#clip .range input[data-axis="${axis}"][data-end="${corner}"]`;
const handle = (page, name) => page.locator(`#clip-handles [aria-label="${name}"]`);
const middleOf = async (locator) => {
  const { x, y, width, height } = await boxOf(locator);
  return [x + width / 2, y + height / 2];
};
const view = (page) => page.evaluate(() => window.splatd.view.clip);
const rounded = (normal) => normal.map((part) => Number(part.toFixed(6)) + 0);

test('the box: faces move by keyboard, mouse and numbers, and a face pushes the opposite one', async (context) => {
  const it = await withMock(context);
  const { page } = it;
  assert.deepEqual(await it.press(slider(1, 0), 'ArrowRight'), { clip: { box: [[0, 0.01, 0], [1, 1, 1]] } });
  assert.deepEqual(await it.press(slider(0, 1), 'Home'), { clip: { box: [[0, 0.01, 0], [0, 1, 1]] } });
  assert.deepEqual(await it.press(slider(0, 0), 'End'), { clip: { box: [[1, 0.01, 0], [1, 1, 1]] } }, 'the upper face was pushed');
  // Both thumbs are now at the end; the upper one can still move back.
  const { x, y, width, height } = await boxOf(page.locator(slider(0, 1)));
  const sent = await it.patches(async () => {
    await page.mouse.move(x + width - 7, y + height / 2);
    await page.mouse.down();
    await page.mouse.move(x + width / 2, y + height / 2, { steps: 5 });
    await page.mouse.up();
  });
  const { box } = sent.at(-1).clip;
  compare(Math.abs(box[1][0] - 0.5), '<', 0.05, JSON.stringify(box));
  assert.equal(box[0][0], box[1][0], JSON.stringify(box));
  const typed = await it.patch(async () => {
    await page.fill(number(2, 0), '15');
    await page.keyboard.press('Enter');
  });
  assert.equal(typed.clip.box[0][2], 0.25, 'z = 15 between -1 and 63');
  assert.equal(await page.inputValue(number(2, 1)), '63');
  assert.deepEqual(await it.patch(() => page.locator('#clip-reset').click()), { clip: { box: [[0, 0, 0], [1, 1, 1]], planes: [] } });
  assert.deepEqual(it.said, []);
});

test('planes are added, moved, turned to the viewer, flipped, switched off and on, and removed, up to eight', async (context) => {
  const it = await withMock(context);
  const { page } = it;
  const first = await it.patch(() => page.locator('#plane-sight').click());
  assert.deepEqual(rounded(first.clip.planes[0].normal), [0, 0, -1]);
  close([first.clip.planes[0].offset], [-31], 1e-9);
  const deeper = await it.press('#plane-depth', 'End');
  assert.deepEqual(deeper.clip.planes, [{ normal: first.clip.planes[0].normal, offset: 1 }]);
  const placed = await it.patch(async () => {
    await page.fill('#plane-position', '-20');
    await page.keyboard.press('Enter');
  });
  close([placed.clip.planes[0].offset], [-20], 1e-9);
  const across = await it.patch(() => page.locator('[data-across="0"]').click());
  assert.deepEqual(across.clip.planes[1], { normal: [1, 0, 0], offset: 31.5 });
  assert.equal(await page.locator('#planes .position').nth(1).textContent(), 'x = 31.5 mm');
  const flipped = await it.patch(() => page.locator('[aria-label="Flip Plane 2"]').click());
  assert.deepEqual(flipped.clip.planes[1], { normal: [-1, 0, 0], offset: -31.5 });
  assert.deepEqual((await it.patch(() => page.locator('#planes input[role="switch"]').first().click())).clip.planes.length, 1);
  assert.equal(await page.locator('#planes li').count(), 2, 'a plane that is off stays in the list');
  await page.reload();
  await firstFrame(page);
  assert.equal(await page.locator('#planes li').count(), 2, 'also after a reload');
  assert.deepEqual(await page.locator('#planes input[role="switch"]').evaluateAll((all) => all.map(({ checked }) => checked)), [false, true]);
  assert.equal((await it.patch(() => page.locator('#planes input[role="switch"]').first().click())).clip.planes.length, 2);
  for (let i = 0; i < 6; i += 1) await page.locator('[data-across="2"]').click();
  assert.equal(await page.locator('#planes li').count(), 8);
  assert.ok(await page.locator('[data-across="2"]').isDisabled(), 'the protocol allows eight');
  const fewer = await it.patch(() => page.locator('[aria-label="Remove Plane 1"]').click());
  assert.equal(fewer.clip.planes.length, 7);
  await shot(page, 'clip-planes');
  assert.deepEqual(it.said, []);
});

test('the ranges of the box ascend, also where an axis of the volume descends', async (context) => {
  const flipped = volume('flipped', { direction: [[-1, 0, 0], [0, 1, 0], [0, 0, 1]], origin: [63, 0, 0] });
  const { page, patch } = await visitMock(context, browser, { change: { volumes: [flipped] } });
  await page.locator('#clip summary').click();
  const ends = [await page.inputValue(number(0, 0)), await page.inputValue(number(0, 1))].map(Number);
  compare(ends[0], '<', ends[1]);
  for (const [at, end] of ['Axis x, end −x', 'Axis x, end +x'].entries()) {
    for (const selector of [number(0, at), slider(0, at)]) assert.equal(await page.getAttribute(selector, 'aria-label'), end);
  }
  await page.focus(slider(0, 0));
  assert.deepEqual(await patch(() => page.keyboard.press('ArrowRight')), { clip: { box: [[0, 0, 0], [0.99, 1, 1]] } }, 'the lower end is the far face of the grid');
  compare(Number(await page.inputValue(number(0, 0))), '>', ends[0]);
  await page.click('#clip-tool');
  assert.equal(await handle(page, 'Face +x of the box').getAttribute('aria-valuetext'), `${ends[1] - 0} mm`);
});

test('names and numbers are anatomical and in millimetres', async (context) => {
  const { page } = await withBlock(context);
  assert.deepEqual(await page.locator('.clip-axis .name').allTextContents(), ['R–L', 'A–P', 'I–S']);
  assert.equal(await page.inputValue(number(0, 1)), '99.5');
  assert.equal(await page.getAttribute(slider(0, 1), 'aria-valuetext'), '99.5 mm');
  assert.deepEqual(await page.locator('#plane-add button').allTextContents(), ['sagittal', 'coronal', 'axial', 'view']);
  assert.equal(await handle(page, 'Face left of the box').getAttribute('aria-valuetext'), '99.5 mm');
});

test('a face that is dragged half way removes half of the block, and the picture follows', async (context) => {
  const { page, said } = await withBlock(context);
  const whole = lit(await pixels(page));
  const face = handle(page, 'Face left of the box');
  const [x, y] = await middleOf(face);
  const [right] = await middleOf(handle(page, 'Face right of the box'));
  const count = await page.evaluate(() => window.splatd.count);
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move((x + right) / 2, y, { steps: 12 });
  await until(page, 'a picture during the drag', `(s) => s.count > ${count}`);
  await page.mouse.up();
  await rest(page);
  close([(await view(page)).box[1][0]], [0.5], 0.01);
  const half = lit(await pixels(page));
  compare(Math.abs(half.width / whole.width - 0.5), '<', 0.02);
  compare(Math.abs(half.part / whole.part - 0.5), '<', 0.03);
  close([half.left], [whole.left], 2);
  assert.equal((await page.evaluate(() => window.splatd.camera.position[0] - window.splatd.camera.target[0])), 0, 'the camera did not turn');
  close([(await middleOf(face))[0]], [(x + right) / 2], 2);
  await shot(page, 'clip-face');
  await drag(page, [x + 20, y + 150], [x + 60, y + 150]); // beside the handles
  await rest(page);
  assert.notEqual((await page.evaluate(() => window.splatd.camera.position[0] - window.splatd.camera.target[0])), 0, 'a drag elsewhere turns');
  assert.deepEqual(said, []);
});

test('a plane is shifted and turned by its handles, which hide with the tool', async (context) => {
  const { page, said } = await withBlock(context);
  const whole = lit(await pixels(page));
  await page.evaluate(() => { document.getElementById('clip').open = true; });
  await page.locator('[data-across="0"]').click();
  await rest(page);
  compare(Math.abs(lit(await pixels(page)).part / whole.part - 0.5), '<', 0.03, 'the right half is removed');
  const shift = handle(page, 'Shift Plane 1');
  const [x, y] = await middleOf(shift);
  const perMm = whole.width / 80;
  await drag(page, [x, y], [x + 20 * perMm, y]);
  await rest(page);
  close([(await view(page)).planes[0].offset], [69.5], 0.6);
  compare(Math.abs(lit(await pixels(page)).width / whole.width - 0.25), '<', 0.03);
  const [u, v] = await middleOf(handle(page, 'Turn Plane 1'));
  await drag(page, [u, v], [u + 60, v]);
  await rest(page);
  const [plane] = (await view(page)).planes;
  compare(Math.abs(plane.normal[1]), '>', 0.3, 'turned about the vertical');
  close([plane.normal[2]], [0], 1e-9);
  await shot(page, 'clip-plane');
  await page.locator('#clip-tool').click();
  await page.locator('#clip-handles').waitFor({ state: 'hidden' });
  assert.equal(await page.locator('#overlay .handle-edge').count(), 0);
  assert.equal((await view(page)).planes.length, 1, 'the plane cuts on');
  assert.deepEqual(said, []);
});

test('handles by keyboard: arrows move faces and planes in steps, also finer; Escape hides the handles', async (context) => {
  const { page } = await withBlock(context);
  const face = handle(page, 'Face left of the box');
  await face.focus();
  for (const key of ['ArrowLeft', 'ArrowLeft', 'Shift+ArrowRight']) await page.keyboard.press(key);
  close([(await view(page)).box[1][0]], [0.981], 1e-9);
  await page.keyboard.press('Home');
  assert.equal((await view(page)).box[1][0], 0);
  await page.keyboard.press('End');
  await page.evaluate(() => { document.getElementById('clip').open = true; });
  await page.locator('[data-across="2"]').click();
  await handle(page, 'Shift Plane 1').focus();
  await page.keyboard.press('ArrowUp');
  close([(await view(page)).planes[0].offset], [19.9], 1e-6);
  await handle(page, 'Turn Plane 1').focus();
  await page.keyboard.press('ArrowDown');
  close([Math.acos((await view(page)).planes[0].normal[2]) * 180 / Math.PI], [5], 1e-6);
  const { position, target } = await page.evaluate(() => window.splatd.camera);
  assert.equal(position[0], target[0], 'the arrow keys did not turn the camera');
  await page.keyboard.press('Escape');
  await page.locator('#clip-handles').waitFor({ state: 'hidden' });
  assert.equal(await page.evaluate(() => document.activeElement.id), 'screen');
});

test('handles by touch: large enough, and a finger moves a face', async (context) => {
  const { page, said } = await withBlock(context, PHONE);
  const face = handle(page, 'Face left of the box');
  const { width, height } = await boxOf(face);
  compare(Math.min(width, height), '>=', 44);
  const [x, y] = await middleOf(face);
  const [right] = await middleOf(handle(page, 'Face right of the box'));
  const to = (part) => [x + (right - x) * part, y];
  await touch(page, [[[x, y]], [to(0.1)], [to(0.2)], [to(0.25)]]);
  await rest(page);
  close([(await view(page)).box[1][0]], [0.75], 0.02);
  await shot(page, 'phone-clip-handles');
  assert.deepEqual(said, []);
});
