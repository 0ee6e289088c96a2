// SPDX-License-Identifier: Apache-2.0
// Orientation cube, standard views, projection, scale bar, walk and turntable, with pictures of a block of known size.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { BLOCK, lit, writeBlock } from '../support/block.mjs';
import { boxOf, camera, drag, pixels, resize, rest, settle, share, shot, touch, until, visit } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';
import { close } from '../support/numbers.mjs';

const SIZE = { width: 700, height: 500 };
const PHONE = { viewport: { width: 390, height: 700 }, deviceScaleFactor: 1, isMobile: true, hasTouch: true };
const block = writeBlock();
const { browser, daemon } = await share(() => startDaemon(['--volume', block.file]), () => block.remove());

async function setUp(context, options = { viewport: SIZE, reducedMotion: 'reduce' }) {
  const opened = await visit(context, browser, daemon.url, options);
  await rest(opened.page);
  return opened;
}

const sight = ({ position, target }) => {
  const from = position.map((part, i) => part - target[i]);
  return from.map((part) => part / Math.hypot(...from));
};
/** Resolves to the direction of the eye, rounded. */
const direction = async (page) => sight(await camera(page)).map((part) => Math.round(part * 1000) / 1000 + 0);
const press = async (page, key) => {
  await page.locator('#screen').focus();
  await page.keyboard.press(key);
};
const bar = (page) => page.evaluate(() => {
  const [, value, unit] = /([\d.]+) (\S+)$/.exec(document.querySelector('.scale-text').textContent);
  const line = document.querySelector('.scale-line');
  return { length: Number(value) * { mm: 1, m: 1000, 'µm': 0.001 }[unit], px: parseFloat(line.style.width), drawn: line.getBoundingClientRect().width };
});
const near = (value, wanted, part, what) => compare(Math.abs(value / wanted - 1), '<', part, `${what}: ${value}, expected ${wanted}`);

/** Views by key: where the eye is, and the sides of the block that lie sideways and upwards. */
const VIEWS = [
  ['1', [0, -1, 0], 0, 2], ['2', [0, 1, 0], 0, 2], ['3', [1, 0, 0], 1, 2], ['4', [-1, 0, 0], 1, 2], ['5', [0, 0, 1], 0, 1], ['6', [0, 0, -1], 0, 1],
];

test('the keys 1 to 7 give the standard views, and the picture shows the sides of the block', async (context) => {
  const { page, said } = await setUp(context);
  await press(page, 't');
  for (const [key, eye, sideways, upwards] of VIEWS) {
    await press(page, key);
    await rest(page);
    assert.deepEqual(await direction(page), eye, `key ${key}`);
    const { width, height } = lit(await pixels(page));
    near(width / height, BLOCK[sideways] / BLOCK[upwards], 0.12, `shape by key ${key}`);
  }
  await press(page, '7');
  const third = Math.round(1000 / Math.sqrt(3)) / 1000;
  assert.deepEqual(await direction(page), [third, -third, third]);
  assert.deepEqual(said, []);
});

test('each face of the cube has its anatomical letter and turns to it; edges and corners turn between', async (context) => {
  const { page, said } = await setUp(context);
  // A face, the keys that turn it into view, and where it is.
  const faces = [
    ['anterior', '3', 'ArrowRight', [0, -1, 0]], ['left', '1', 'ArrowLeft', [1, 0, 0]], ['superior', '1', 'ArrowDown', [0, 0, 1]],
    ['posterior', '3', 'ArrowLeft', [0, 1, 0]], ['right', '1', 'ArrowRight', [-1, 0, 0]], ['inferior', '1', 'ArrowUp', [0, 0, -1]],
  ];
  const click = (name) => page.locator(`#cube path[aria-label="View from: ${name}"]`).click();
  for (const [name, view, arrow, eye] of faces) {
    await press(page, view);
    for (let i = 0; i < 9; i += 1) await press(page, arrow);
    await click(name);
    assert.deepEqual(await direction(page), eye, name);
    const letter = name[0].toUpperCase();
    await until(page, `the letter ${letter} alone`,
      `() => [...document.querySelectorAll('#cube .face:not([hidden])')].map((text) => text.textContent).join() === '${letter}'`);
  }
  await press(page, '7');
  const half = Math.round(1000 * Math.SQRT1_2) / 1000;
  await click('anterior, left');
  assert.deepEqual(await direction(page), [half, -half, 0]);
  await press(page, '7');
  await click('superior, anterior, left');
  const third = Math.round(1000 / Math.sqrt(3)) / 1000;
  assert.deepEqual(await direction(page), [third, -third, third]);
  await shot(page, 'cube');
  assert.deepEqual(said, []);
});

test('the letters of the axes stay inside of the picture', async (context) => {
  const { page } = await setUp(context);
  await page.click('#layout-four');
  const beside = () => page.evaluate(() => {
    const pane = document.getElementById('pane-3d').getBoundingClientRect();
    return [...document.querySelectorAll('#cube text.axis:not([hidden])')].filter((text) => {
      const { left, right, top, bottom } = text.getBoundingClientRect();
      return left < pane.left || right > pane.right || top < pane.top || bottom > pane.bottom;
    }).map((text) => text.textContent);
  });
  for (const view of ['1', '3', '5', '7']) {
    await press(page, view);
    for (const arrow of ['ArrowUp', 'ArrowRight', 'ArrowDown']) {
      for (let i = 0; i < 6; i += 1) {
        await press(page, arrow);
        assert.deepEqual(await beside(), [], `${view}, ${arrow} ${i}`);
      }
    }
  }
});

test('for a finger the cube has faces alone, each of 44 px or more', async (context) => {
  const { page } = await setUp(context, PHONE);
  const visible = () => page.evaluate(() => [...document.querySelectorAll('#cube path:not([hidden])')]
    .map((path) => ({ label: path.getAttribute('aria-label'), width: path.getBoundingClientRect().width, height: path.getBoundingClientRect().height })));
  await press(page, '1');
  await rest(page); // on the way, faces are as narrow as the view is oblique
  await until(page, 'the front alone', () => document.querySelectorAll('#cube path:not([hidden])').length === 1);
  const [face] = await visible();
  compare(Math.min(face.width, face.height), '>=', 44);
  await page.evaluate(() => document.getElementById('layout-four').click());
  await until(page, 'a smaller cube', () => document.getElementById('cube').getBoundingClientRect().width < 100);
  await rest(page);
  compare(Math.min(...(await visible()).flatMap(({ width, height }) => [width, height])), '>=', 44);
});

test('the cube by keyboard: arrows choose a part, Enter turns; a drag turns freely', async (context) => {
  const { page } = await setUp(context);
  await press(page, '1');
  await rest(page);
  assert.equal(await page.locator('#cube [tabindex="0"]').count(), 1, 'one stop of the Tab key');
  await page.locator('#cube [tabindex="0"]').focus();
  const focused = () => page.evaluate(() => document.activeElement.getAttribute('aria-label'));
  await page.keyboard.press('ArrowRight');
  assert.equal(await focused(), 'View from: anterior, left');
  assert.deepEqual(await direction(page), [0, -1, 0], 'the arrow did not turn the camera');
  await page.keyboard.press('Enter');
  assert.notDeepEqual(await direction(page), [0, -1, 0]);
  await until(page, 'the next face', () => !document.querySelector('#cube path[aria-label="View from: left"]').hasAttribute('hidden'));
  await page.keyboard.press('ArrowRight');
  await page.keyboard.press('Enter');
  assert.deepEqual(await direction(page), [1, 0, 0]);
  const { x, y, width, height } = await boxOf(page.locator('#cube'));
  await drag(page, [x + width / 2, y + height / 2], [x + width / 2 + 30, y + height / 2]);
  compare((await direction(page))[0], '<', 0.95);
});

test('a click glides to the view in several steps, ends exactly there, and a drag ends the glide', async (context) => {
  const { page } = await setUp(context, { viewport: SIZE });
  const before_ = await page.evaluate(() => window.splatd.sent);
  await press(page, '3');
  await until(page, 'the left side', (s) => s.isIdle && s.camera.position[1] === s.camera.target[1] && s.camera.position[0] > s.camera.target[0]);
  const { position, target, up } = await camera(page);
  assert.deepEqual([position[1] - target[1], position[2] - target[2]], [0, 0]);
  close(up, [0, 0, 1], 1e-12);
  const sent = await page.evaluate(() => window.splatd.sent) - before_;
  compare(sent, '>=', 2, 'several steps');
  compare(sent, '<=', 40, 'not more than one update per animation frame');
  await page.evaluate(() => { // at once: the movement of the user wins
    for (const key of ['4', 'ArrowUp']) window.dispatchEvent(new KeyboardEvent('keydown', { key }));
  });
  await rest(page);
  compare(sight(await camera(page))[0], '>', -0.99);
});

test('the orthographic switch keeps the size, and back again', async (context) => {
  const { page, said } = await setUp(context);
  await press(page, '5');
  await rest(page);
  const [first, scale] = [lit(await pixels(page)), await bar(page)];
  await press(page, 't');
  await rest(page);
  assert.equal((await camera(page)).projection, 'orthographic');
  const flat = lit(await pixels(page));
  near(flat.width, first.width, 0.1, 'width'); // in perspective the near side is a little larger
  near((await bar(page)).px, scale.px, 0.001, 'the scale at the target');
  await press(page, 't');
  await rest(page);
  const back = lit(await pixels(page));
  close([back.width, back.height], [first.width, first.height], 1);
  assert.deepEqual(said, []);
});

test('the scale bar has a round length that is right for a block of 80 mm, at each zoom', async (context) => {
  const { page } = await setUp(context);
  await press(page, 't');
  await press(page, '1');
  for (let i = 0; i < 3; i += 1) {
    await rest(page);
    const { length, px, drawn } = await bar(page);
    const digit = Number((length / 10 ** Math.floor(Math.log10(length))).toPrecision(3));
    assert.ok([1, 2, 5].includes(digit), `${length} mm is not round`);
    close([drawn], [px], 0.5);
    const { width } = lit(await pixels(page));
    near(width * length / px, BLOCK[0], 0.03, 'the block in mm');
    await press(page, '-');
    await press(page, '-');
  }
  assert.equal(await page.locator('.scale-text').textContent().then((text) => text.startsWith('≈')), false);
  await press(page, 't');
  await until(page, 'a scale of a perspective', () => document.querySelector('.scale-text').textContent.startsWith('≈'));
});

test('keep upright: dragging in any direction keeps the head up and the horizon level', async (context) => {
  const { page } = await setUp(context);
  await press(page, '.');
  await press(page, 'u');
  const check = async () => {
    const { position, target, up } = await camera(page);
    const right = [0, 1, 2].map((i) => (target[(i + 1) % 3] - position[(i + 1) % 3]) * up[(i + 2) % 3] - (target[(i + 2) % 3] - position[(i + 2) % 3]) * up[(i + 1) % 3]);
    compare(Math.abs(right[2]) / Math.hypot(...right), '<', 1e-6);
    compare(up[2], '>=', -1e-9);
  };
  await check();
  await drag(page, [450, 300], [600, 120]);
  await check();
  await drag(page, [450, 100], [350, 470]);
  await check();
  await press(page, '.');
  await check();
  await press(page, 'u');
  for (let i = 0; i < 3; i += 1) await press(page, '.');
  await rest(page);
  compare((await camera(page)).up[2], '<', 0.999, 'free again');
});

test('walk through: keys move, dragging looks around, the wheel sets the speed, Escape ends it', async (context) => {
  const { page, said } = await setUp(context);
  await press(page, '1');
  await press(page, 'g');
  assert.equal(await page.evaluate(() => window.splatd.mode), 'walk');
  const start = await camera(page);
  await page.keyboard.down('w');
  await until(page, 'a step', `(s) => s.camera.position[1] > ${start.position[1]} + 2`);
  await page.keyboard.up('w');
  await rest(page);
  const ahead = await camera(page);
  close([ahead.position[0], ahead.position[2]], [start.position[0], start.position[2]], 1e-6);
  await page.keyboard.down('e');
  await until(page, 'higher', `(s) => s.camera.position[2] > ${start.position[2]} + 1`);
  await page.keyboard.up('e');
  await rest(page);
  const high = await camera(page);
  await drag(page, [450, 300], [550, 300]);
  await rest(page);
  const turned = await camera(page);
  close(turned.position, high.position, 1e-6);
  compare(turned.target[0] - turned.position[0], '>', 1, 'to the right');
  const speed = () => page.locator('#mode-text').textContent();
  const slow = await speed();
  for (const width of [1280, 900]) {
    await resize(page, { width, height: 600 });
    const [bar, cube] = await page.evaluate(() => ['mode-bar', 'cube'].map((id) => document.getElementById(id).getBoundingClientRect().toJSON()));
    assert.ok(bar.right <= cube.left || bar.bottom <= cube.top, `the bar covers the cube of a window of ${width} px`);
  }
  await page.mouse.move(450, 300);
  await page.mouse.wheel(0, -100);
  await until(page, 'another speed', `() => document.getElementById('mode-text').textContent !== ${JSON.stringify(slow)}`);
  await page.keyboard.press('Escape');
  assert.equal(await page.evaluate(() => window.splatd.mode), 'navigate');
  assert.deepEqual(said, []);
});

test('walk through by touch: a held button moves, a finger looks around', async (context) => {
  const { page, said } = await setUp(context, PHONE);
  await press(page, '1');
  await until(page, 'the front', (s) => s.camera.position[0] === s.camera.target[0]);
  await press(page, 'g');
  const start = await camera(page);
  const { x, y, width, height } = await boxOf(page.locator('#walk-pad button').first());
  compare(Math.min(width, height), '>=', 44);
  assert.match(await page.textContent('#mode-hint'), /hold the arrows/);
  await settle(page);
  const [bar, scale] = await page.evaluate(() => ['mode-bar', 'scale-bar'].map((id) => document.getElementById(id).getBoundingClientRect().toJSON()));
  compare(scale.bottom, '<=', bar.top, 'the bar does not cover the scale');
  const cdp = await page.context().newCDPSession(page);
  await cdp.send('Input.dispatchTouchEvent', { type: 'touchStart', touchPoints: [{ x: x + width / 2, y: y + height / 2 }] });
  await until(page, 'a step', `(s) => s.camera.position[1] > ${start.position[1]} + 2`);
  await cdp.send('Input.dispatchTouchEvent', { type: 'touchEnd', touchPoints: [] });
  await rest(page);
  const ahead = await camera(page);
  await shot(page, 'phone-walk');
  await touch(page, [[[200, 300]], [[180, 300]], [[120, 300]]]);
  await rest(page);
  const turned = await camera(page);
  close(turned.position, ahead.position, 1e-6);
  compare(turned.target[0] - turned.position[0], '>', 1, 'the scene follows the finger');
  assert.deepEqual(said, []);
});

test('a rectangle fills the picture; numbers set the camera; the menu shows the state', async (context) => {
  const { page, said } = await setUp(context);
  await press(page, 't');
  await press(page, '1');
  await rest(page);
  const { height } = await camera(page);
  await press(page, 'z');
  const box = await boxOf(page.locator('#screen'));
  const middle = [box.x + box.width * 0.6, box.y + box.height / 2];
  await drag(page, [middle[0] - box.width / 8, middle[1] - box.height / 8], [middle[0] + box.width / 8, middle[1] + box.height / 8]);
  await rest(page);
  near((await camera(page)).height, height / 4, 0.02, 'height');
  assert.equal(await page.evaluate(() => window.splatd.mode), 'navigate');
  await page.locator('#camera summary').click();
  const type = async (name, value) => {
    await page.fill(`#camera-${name}`, String(value));
    await page.keyboard.press('Enter');
  };
  await type('azimuth', 90);
  assert.deepEqual(await direction(page), [1, 0, 0]);
  await type('elevation', 30);
  close(await direction(page), [0.866, 0, 0.5], 2e-3);
  await type('roll', 90);
  await rest(page);
  close((await camera(page)).up.map((part) => Math.round(part * 1e6) / 1e6 + 0), [0, -1, 0], 1e-6);
  await type('height', 50);
  near((await camera(page)).height, 50, 1e-9, 'height');
  assert.equal(await page.locator('#camera-fov').isVisible(), false, 'an orthographic camera has no field of view');
  await press(page, 't');
  await until(page, 'the field of view', () => document.getElementById('camera-fov').checkVisibility());
  await type('fov', 60);
  assert.equal((await camera(page)).fov_y, 60);
  await page.locator('#views').click();
  assert.equal(await page.evaluate(() => document.activeElement.dataset.name), 'front');
  await page.keyboard.press('ArrowDown');
  await page.keyboard.press('Enter');
  assert.deepEqual(await direction(page), [0, 1, 0]);
  assert.equal(await page.locator('#views-menu').isVisible(), false);
  await shot(page, 'camera');
  assert.deepEqual(said, []);
});
