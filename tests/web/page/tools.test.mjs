// SPDX-License-Identifier: Apache-2.0
// The foundation for features: toolbar, modes, overlay, panes, sections of the panel, and texts. A feature of this test uses them in
// the page.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { cpSync, mkdtempSync, readdirSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { drag, firstFrame, resize, settle, share, shot, touch, until, visitMock } from '../support/browser.mjs';
import { SOURCES } from '../support/mock-daemon.mjs';

const PROBE = `
import { ORDER } from './shell/panel.js';
import { svg } from './controls/dom.js';
import { layoutButton } from './shell/layout.js';
export function install(app) {
  const said = window.probe = [];
  const note = (name) => (at) => { said.push(at?.map ? name + ' ' + at.map(Math.round) : name); };
  app.modes.add('probe', {
    label: 'Probe', hint: 'Try it', cursor: 'crosshair', down: note('down'), move: note('move'), up: note('up'), cancel: note('cancel'),
    enter: note('enter'), leave: note('leave'), key: ({ key }) => key === 'x' && Boolean(said.push('key')),
  });
  for (let i = 0; i < 14; i += 1) {
    app.toolbar.button({ id: 'probe-' + i, icon: 'contrast', label: 'Probe ' + i, key: i === 0 ? 'q' : null, group: 'group' + (i >> 2), isToggle: i === 0,
      press: () => app.modes.toggle('probe') });
  }
  const body = app.panel.section({ id: 'probe-section', title: 'Probe', order: ORDER.measure + 1, isOpen: true });
  body.textContent = 'inside';
  const dot = svg('circle', { id: 'probe-dot', r: 3, fill: 'red' });
  const layer = app.overlay.layer((project) => {
    const { x, y } = project(app.viewer.rig.target);
    dot.setAttribute('cx', x);
    dot.setAttribute('cy', y);
  });
  layer.group.append(dot);
  app.layout.add('probe4');
  app.layout.add('probe3', { hasPicture: false });
  for (const id of ['a', 'b', 'c']) app.layout.pane('probe-' + id, 'Axis ' + id, { layouts: ['probe4', 'probe3'] }).textContent = id;
  layoutButton(app, { name: 'probe4', icon: 'contrast', label: 'Picture and panes', order: 11 });
  layoutButton(app, { name: 'probe3', icon: 'contrast', label: 'Panes', order: 12 });
}`;

/** Bundles the page with the feature, as the build does: it then loads in half the time. Returns the folder. */
function bundle() {
  const to = mkdtempSync(path.join(tmpdir(), 'splatd-page-'));
  cpSync(SOURCES, to, { recursive: true });
  const main = path.join(to, 'app/main.js');
  writeFileSync(main, readFileSync(main, 'utf8').replace('inspect,\n];', 'inspect, probe,\n];')
    .replace('import { install as colorBar', "import { install as probe } from './probe.js';\nimport { install as colorBar"));
  writeFileSync(path.join(to, 'app/probe.js'), PROBE);
  const listed = (name) => readdirSync(path.join(to, name)).map((file) => `${name}/${file}`);
  execFileSync('esbuild', ['app/main.js', 'app/frames/decode_worker.js', 'element/splat-view.js', ...listed('app/parts'), ...listed('style'), '--bundle', '--splitting',
    '--format=esm', '--chunk-names=app/chunks/[name]-[hash]', '--outbase=.', '--outdir=.', '--allow-overwrite', '--log-level=warning'], { cwd: to });
  return to;
}

const folder = bundle();
const { browser } = await share(null, () => rmSync(folder, { recursive: true }));

async function setUp(context, options) {
  const opened = await visitMock(context, browser, { options, change: { page: folder } });
  return { ...opened, told: () => opened.page.evaluate(() => window.probe.splice(0)) };
}

test('a mode owns the drag, its keys and the bar; Escape leaves it', async (context) => {
  const { page, said, told } = await setUp(context);
  const camera = () => page.evaluate(() => window.splatd.camera);
  const start = await camera();
  await page.keyboard.press('q');
  assert.equal(await page.evaluate(() => window.splatd.mode), 'probe');
  assert.equal(await page.textContent('#mode-text'), 'Probe');
  assert.equal(await page.evaluate(() => document.getElementById('screen').style.cursor), 'crosshair');
  await drag(page, [500, 300], [540, 310], { steps: 1 });
  await page.keyboard.press('x');
  assert.deepEqual(await told(), ['enter', 'down 500,300', 'move 540,310', 'up 540,310', 'key']);
  assert.deepEqual(await camera(), start);
  await drag(page, [500, 300], [540, 310], { button: 'right' });
  assert.notDeepEqual(await camera(), start, 'the right button moves the camera in every mode');
  await page.keyboard.press('Escape');
  assert.deepEqual(await told(), ['leave']);
  assert.equal(await page.isVisible('#mode-bar'), false);
  assert.equal(await page.getAttribute('#tool-navigate', 'aria-pressed'), 'true');
  await page.keyboard.press('q');
  assert.equal(await page.evaluate(() => window.splatd.mode), 'probe');
  await page.keyboard.press('?');
  await page.locator('#shortcuts tr', { hasText: 'Probe 0' }).waitFor();
  assert.deepEqual(said, []);
});

test('a second finger cancels the drag of a mode and zooms', async (context) => {
  const { page, said, told } = await setUp(context, { viewport: { width: 1100, height: 700 }, hasTouch: true });
  await page.keyboard.press('q');
  await told();
  await touch(page, [[[600, 300]], [[610, 300]], [[610, 300], [700, 300]], [[600, 300], [800, 300]]]);
  assert.deepEqual((await told()).filter((name) => !name.startsWith('move')), ['down 276,300', 'cancel']);
  assert.deepEqual(said, []);
});

test('the overlay stays on its place in the picture', async (context) => {
  const { page, said } = await setUp(context);
  const place = () => page.evaluate(() => ['cx', 'cy'].map((name) => Number(document.getElementById('probe-dot').getAttribute(name))));
  assert.deepEqual((await place()).map(Math.round), [450, 300], 'the target is in the middle');
  await page.mouse.move(450, 300);
  await drag(page, [600, 300], [660, 330], { button: 'right' });
  await until(page, 'all frames', (s) => s.isIdle && s.seq === s.sent);
  await until(page, 'the target in the middle again, because it moves with the camera', () => {
    const [x, y] = ['cx', 'cy'].map((name) => Number(document.getElementById('probe-dot').getAttribute(name)));
    return Math.hypot(x - 450, y - 300) < 0.01;
  });
  assert.deepEqual(said, []);
});

test('panes: four, slices only, and back; frames follow the size of the picture', async (context) => {
  const { page, said } = await setUp(context, { viewport: { width: 1300, height: 800 } });
  const size = (condition) => until(page, 'the frame size', `(s) => String(s.size) === String(s.wanted) && (${condition})(s.wanted) && s.wanted`);
  const whole = [1300 - 324, 800]; // the picture stands beside the panel
  const isWhole = `([width, height]) => width === ${whole[0]} && height === ${whole[1]}`;
  await size(isWhole);
  await page.click('#layout-probe4');
  assert.equal(await page.locator('.pane:visible').count(), 4);
  const quarter = await size(([width]) => width < 600);
  compare(quarter[0], '<=', whole[0] / 2);
  compare(quarter[1], '<', whole[1] / 2);
  await shot(page, 'layout-four');
  await page.click('#layout-probe3');
  assert.equal(await page.locator('.pane:visible').count(), 3);
  assert.equal(await page.isVisible('#screen'), false);
  await page.click('#layout-3d');
  await size(isWhole);
  assert.equal(await page.getAttribute('#layout-3d', 'aria-pressed'), 'true');
  assert.deepEqual(said, []);
});

test('beside other panes, neither the bar of a mode nor the cube covers a slice or much of the picture', async (context) => {
  const touch_ = { isMobile: true, hasTouch: true };
  const screens = [
    { viewport: { width: 1440, height: 900 } }, { viewport: { width: 390, height: 844 }, ...touch_ },
    { viewport: { width: 844, height: 390 }, ...touch_ }, { viewport: { width: 820, height: 1180 }, ...touch_ },
  ];
  for (const options of screens) {
    const { page, context: closing } = await setUp(context, options);
    await page.evaluate(() => { for (const id of ['layout-four', 'tool-crosshair']) document.getElementById(id).click(); });
    await settle(page);
    const { bar, tools, panes, cube, picture } = await page.evaluate(() => {
      const box = (element) => (({ left, right, top, bottom, width, height }) => ({ left, right, top, bottom, width, height }))(element.getBoundingClientRect());
      return {
        bar: box(document.getElementById('mode-bar')), tools: box(document.getElementById('toolbar')), cube: box(document.getElementById('cube')),
        picture: box(document.getElementById('pane-3d')), panes: [...document.querySelectorAll('.pane:not([hidden])')].map(box),
      };
    });
    const what = JSON.stringify(options.viewport);
    assert.equal(panes.length, 4);
    for (const pane of panes) {
      for (const over of [bar, tools]) {
        assert.ok(over.right <= pane.left || over.left >= pane.right || over.bottom <= pane.top || over.top >= pane.bottom, `${what}: ${JSON.stringify({ over, pane })}`);
      }
    }
    compare(cube.width * cube.height / (picture.width * picture.height), '<', 0.17, what);
    compare(cube.bottom, '<=', picture.bottom, what);
    await shot(page, `tools-mode-${options.viewport.width}`);
    await closing.close();
  }
});

test('the toolbar is one stop of Tab with arrow keys; groups that do not fit are in a menu, all of them on a phone', async (context) => {
  const { page, said } = await setUp(context);
  const shown = () => page.locator('#toolbar > .tools button:visible').count();
  const all = await page.locator('#toolbar button:not(#toolbar-more)').count();
  compare(await shown(), '<', all);
  compare(await shown(), '>', 4);
  const fits = () => page.evaluate(() => document.getElementById('toolbar').getBoundingClientRect().right <= window.innerWidth);
  assert.ok(await fits());
  assert.equal(await page.locator('#toolbar button[tabindex="0"]').count(), 1);
  await page.focus('#layout-3d');
  await page.keyboard.press('ArrowRight');
  assert.equal(await page.evaluate(() => document.activeElement.id), 'layout-four');
  await page.keyboard.press('ArrowLeft');
  await page.keyboard.press('ArrowLeft');
  assert.equal(await page.evaluate(() => document.activeElement.id), 'toolbar-more');
  await page.keyboard.press('Enter');
  await page.locator('#toolbar-menu').waitFor();
  await shot(page, 'toolbar-menu');
  await page.keyboard.press('Escape');
  await page.locator('#toolbar-menu').waitFor({ state: 'hidden' });
  await resize(page, { width: 1900, height: 800 });
  await page.locator('#toolbar-more').waitFor({ state: 'hidden' });
  assert.equal(await shown(), all);
  await resize(page, { width: 390, height: 844 });
  await page.locator('#toolbar-more').waitFor();
  assert.equal(await shown(), 0);
  await page.click('#panel-toggle');
  await page.click('#toolbar-more');
  await page.locator('#probe-0').waitFor();
  await shot(page, 'phone-toolbar');
  assert.ok(await fits());
  assert.deepEqual(said, []);
});

test('the toolbar leaves the head of the closed panel free, at each size and with a zoom of 200 %', async (context) => {
  for (const options of [{ viewport: { width: 720, height: 450 }, deviceScaleFactor: 2 }, { viewport: { width: 1024, height: 768 }, hasTouch: true, isMobile: true },
    { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true }]) {
    const { page } = await setUp(context, options);
    if (await page.locator('#panel-toggle').getAttribute('aria-expanded') === 'true') await page.click('#panel-toggle');
    await page.locator('#panel-toggle[aria-expanded="false"]').waitFor();
    await settle(page);
    const [panel, toolbar] = await page.evaluate(() => ['panel', 'toolbar'].map((id) => document.getElementById(id).getBoundingClientRect().toJSON()));
    assert.ok(toolbar.left >= panel.right + 4 || toolbar.bottom + 4 <= panel.top, JSON.stringify({ toolbar, panel }));
    compare(toolbar.right, '<=', options.viewport.width);
  }
});

test('sections of the panel stand in their order, and a reload keeps which are open', async (context) => {
  const { page, said } = await setUp(context);
  const order = await page.evaluate(() => [...document.querySelectorAll('#panel-body > [data-order]')].map((e) => Number(e.dataset.order)));
  assert.deepEqual(order, [...order].sort((a, b) => a - b));
  assert.equal(await page.evaluate(() => document.getElementById('probe-section').previousElementSibling.id), 'measure');
  await page.click('#probe-section summary');
  await page.click('#clip summary');
  await until(page, 'the tab to remember both', () => sessionStorage.getItem('splatd:/fold:clip') === 'open' && sessionStorage.getItem('splatd:/fold:probe-section') === 'closed');
  await page.reload();
  await firstFrame(page);
  assert.equal(await page.evaluate(() => document.getElementById('probe-section').open), false);
  assert.equal(await page.evaluate(() => document.getElementById('clip').open), true);
  assert.deepEqual(said, []);
});

test('an unknown language gives English', async (context) => {
  const { page, daemon, said } = await setUp(context);
  await page.goto(daemon.url.replace('?', '?lang=tlh&'));
  await firstFrame(page);
  assert.equal(await page.textContent('#transfer > summary'), 'Transfer function');
  assert.equal(await page.getAttribute('html', 'lang'), 'en');
  assert.deepEqual(said, []);
});
