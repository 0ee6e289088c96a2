// SPDX-License-Identifier: Apache-2.0
// The widget of the Python package in JupyterLab, below a base address as behind a hub: by each way to the daemon, and over its life.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { drag, launch, shot } from '../web/support/browser.mjs';
import { hasLab, Lab, printed, run, type, until } from './lab.mjs';

const SKIP = { skip: !hasLab && 'no JupyterLab in build/notebook: deploy/notebook-test.sh installs it' };
const BEGIN = 'import splatd, threading\nvolume = splatd.start(backend="cpu", threads=2).load("demo:engine")';
const SHOW = (transport, more = '') => `${more}w = volume.view(size=(512, 384)).show(transport="${transport}")\nw`;
const STATE = `print(len(list(volume.daemon.sessions())), sum(t.name.startswith("splatd-widget-") and t.is_alive() and "requests" not in t.name for t in threading.enumerate()))`;

let lab;
let browser;
let page;
const said = [];

before(async () => {
  if (!hasLab) return;
  [lab, browser] = await Promise.all([Lab.start({ base: '/user/someone/' }), launch()]);
  page = await (await browser.newContext({ viewport: { width: 1100, height: 800 } })).newPage();
  page.on('console', (message) => /^\[anywidget\]|splat/i.test(message.text()) && said.push(message.text()));
  page.on('pageerror', (error) => said.push(error.message));
  lab.write('widget.ipynb', [BEGIN, SHOW('auto'), STATE]);
});
after(async () => {
  await browser?.close();
  await lab?.stop();
});

/** A function of the element that the page shows; null without one. */
const ofElement = (act) => page.evaluate(`(() => {
  const element = [...document.querySelectorAll('.jp-OutputArea *')].find((one) => one.localName.startsWith('splat-view-'));
  return element ? (${act})(element) : null;
})()`);

/** Runs the cell of the widget with this code, and waits for a frame of final quality. */
async function show(code) {
  await type(page, 1, code);
  await run(page, 1);
  await until('the widget is live', () => ofElement((element) => element.state === 'live'));
  await ofElement((element) => {
    window.shown = [];
    element.addEventListener('frame', ({ detail }) => window.shown.push(detail));
    element.change({ background: [0, 0, 0.1, 1] });
  });
  await rest('a final frame');
}

const rest = (what) => until(what, () => page.evaluate(() => window.shown.at(-1)?.isFinal));
const azimuthOf = async () => (await ofElement((element) => element.view.camera.position)).join();
const cell = async (code) => {
  await type(page, 2, code);
  return (await printed(await run(page, 2))).trim();
};

/** Turns the picture by the mouse, and checks that frames and the program see it. */
async function turn(name) {
  const box = await ofElement((element) => element.getBoundingClientRect().toJSON());
  const before = await azimuthOf();
  await page.evaluate(() => { window.shown.length = 0; });
  await drag(page, [box.x + 200, box.y + 200], [box.x + 320, box.y + 230]);
  assert.notEqual(await azimuthOf(), before);
  await rest('a sharp frame after the drag');
  const camera = await ofElement((element) => element.view.camera.position);
  assert.deepEqual(JSON.parse(await cell('import json; print(json.dumps(w.view.document["camera"]["position"]))')), camera);
  const last = await page.evaluate(() => window.shown.at(-1));
  assert.deepEqual([last.width, last.height], [512, 384]);
  await shot(page, `notebook-${name}`);
}

test('a WebSocket to the address of the daemon, whose pages of this server are allowed', SKIP, async () => {
  await lab.open(page, 'widget.ipynb');
  await run(page, 0);
  await show(SHOW('auto'));
  await turn('direct');
  assert.match(await cell('print(w.transport_used)'), /^websocket: 127\.0\.0\.1:\d+ answers$/);
});

test('a program changes the view, and hears of changes', SKIP, async () => {
  await cell('seen = []\nw.observe(lambda change: seen.append(change["new"]["background"]), "document")\nw.change(background=[0.25, 0, 0, 1])');
  await until('the change in the browser', () => ofElement((element) => element.view.background[0] === 0.25));
  await ofElement((element) => element.change({ background: [0, 0.25, 0, 1] }));
  await until('the change in the kernel', async () => (await cell('print(seen[-1])')) === '[0, 0.25, 0, 1]');
  assert.equal(await cell('print(w.snapshot(size=(64, 48)).shape)'), '(48, 64, 4)');
});

test('a cell that is run again has one session; a cleared output and close() have none', SKIP, async () => {
  await show(SHOW('kernel'));
  await until('one session, one stream', async () => (await cell(STATE)) === '1 1');
  await type(page, 1, 'None');
  await run(page, 1);
  await until('no session, no stream', async () => (await cell(STATE)) === '0 0');
  await show('w');
  assert.equal(await cell(`w.close(); w.close(); ${STATE}`), '0 0');
  await until('the output is empty', async () => (await ofElement(() => true)) === null);
});

test('the channel of the kernel', SKIP, async () => {
  await show(SHOW('kernel'));
  await turn('kernel');
  assert.equal(await cell('print(w.transport_used)'), 'kernel: as asked');
});

test('frames and changes pass through a kernel that runs a cell', SKIP, async () => {
  await type(page, 2, 'import time\nbefore = w.document["camera"]\nwhile w.document["camera"] == before: time.sleep(0.05)');
  const busy = run(page, 2);
  await until('the cell runs', async () => /\*/.test(await page.locator('.jp-InputPrompt').nth(2).textContent()));
  const box = await ofElement((element) => element.getBoundingClientRect().toJSON());
  await page.evaluate(() => { window.shown.length = 0; });
  await drag(page, [box.x + 200, box.y + 200], [box.x + 320, box.y + 230]);
  await busy; // it ends when the kernel has heard of the view
  await rest('a sharp frame');
});

test('jupyter-server-proxy, for a daemon that allows no page of another address', SKIP, async () => {
  await show(SHOW('auto', 'volume = splatd.start(backend="cpu", threads=2, allow_origin=False).load("demo:engine")\n'));
  await turn('proxy');
  assert.match(await cell('print(w.transport_used)'), /^websocket: 127\.0\.0\.1:\d+: no answer; jupyter-server-proxy answers$/);
});

test('after a restart of the kernel, and without a kernel, the last picture stays', SKIP, async () => {
  const pid = await cell('print(volume.daemon.process.pid)');
  await until('the picture is kept', async () => Number(await cell('print(len(w._picture))')) > 1000);
  await page.keyboard.press('Escape');
  await page.keyboard.press('Control+s');
  const kernels = () => lab.ask('GET', 'api/kernels');
  const [{ id }] = await kernels();
  await lab.ask('POST', `api/kernels/${id}/restart`, {});
  await until('the daemon has ended', async () => {
    try {
      process.kill(Number(pid), 0);
      return false;
    } catch {
      return true;
    }
  });
  const lastPicture = () => page.evaluate(() => {
    const image = [...document.querySelectorAll('.jp-OutputArea img')].find((one) => one.alt === 'The last picture');
    return image && !image.hidden ? [image.naturalWidth, image.naturalHeight, image.parentElement.innerText] : null;
  });
  await until('the last picture', async () => /does not answer/.test((await lastPicture())?.[2]));
  await shot(page, 'notebook-restarted');
  await lab.ask('DELETE', `api/kernels/${id}`);
  await page.goto('about:blank');
  await lab.open(page, 'widget.ipynb');
  await lab.ask('DELETE', `api/kernels/${(await kernels())[0]?.id}`).catch(() => {});
  await until('the last picture of the saved notebook', async () => (await lastPicture())?.[0] === 512);
  await shot(page, 'notebook-saved');
});
