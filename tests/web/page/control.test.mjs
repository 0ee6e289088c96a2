// SPDX-License-Identifier: Apache-2.0
// Who may change the view, and what the page says to other participants; the ways back to the default view; what the status and the
// choices of the page promise. With the real daemon.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import WebSocket from 'ws';
import { camera, drag, rest, share, shot, until, visit } from '../support/browser.mjs';
import { compare } from '../../support/compare.mjs';
import { startDaemon } from '../support/daemon.mjs';

const { browser, daemon } = await share(() => startDaemon(['--volume', 'demo:phantom?size=32', '--volume', 'demo:engine?size=32', '--backend', 'cpu', '--control-time', '600']));
const open = (context, address, options) => visit(context, browser, address, options);

/** Opens a page in a new session, and a second page that joins the session with this role. */
async function openTwo(context, role, options) {
  const host = await open(context, daemon.url);
  const [id, token] = await host.page.evaluate(() => [window.splatd.session, sessionStorage.getItem('splatd:/token')]);
  const { tokens } = await (await fetch(`${new URL(daemon.url).origin}/api/v1/sessions/${id}`, { headers: { Authorization: `Bearer ${token}` } })).json();
  const guest = await open(context, `${new URL(daemon.url).origin}/#session=${id}&token=${tokens[role]}`, options);
  await until(host.page, 'the guest', (s) => s.people.length === 2);
  await host.page.focus('#screen');
  await host.page.keyboard.press('ArrowLeft');
  await until(guest.page, 'the host to have control', (s) => !s.canControl && s.people.some((p) => p.isHolder && !p.isYou));
  await rest(host.page);
  const { position } = await camera(host.page);
  while (Math.abs((await camera(guest.page)).position[0] - position[0]) > 1e-9);
  return { host, guest };
}
const prompts = (page, start = '') => page.locator(`.prompt[data-id^="${start}"]`);
const foldAll = (page) => page.evaluate(() => { for (const fold of document.querySelectorAll('#panel details')) fold.open = false; });

test('a request for control is shown over the picture, and is answered by keyboard', async (context) => {
  const { host, guest } = await openTwo(context, 'control');
  await foldAll(host.page);
  await guest.page.evaluate(() => document.getElementById('control-ask').click());
  const asked = prompts(host.page, 'asked:');
  await asked.waitFor();
  assert.equal(await asked.getAttribute('role'), 'alert');
  assert.match(await asked.locator('p').textContent(), /^Guest \d asks for control, which passes on in \d+ s without an answer\.$/);
  await shot(host.page, 'control-asked');
  await host.page.focus('#screen'); // the message follows the tools in the order of focus
  let pressed = '';
  for (let i = 0; i < 12 && pressed !== 'Grant'; i += 1) {
    await host.page.keyboard.press('Tab');
    pressed = await host.page.evaluate(() => document.activeElement.textContent);
  }
  assert.equal(pressed, 'Grant');
  await host.page.keyboard.press('Enter');
  await until(guest.page, 'control', (s) => s.canControl);
  await asked.waitFor({ state: 'detached' });

  await host.page.click('#people-fold summary');
  await host.page.click('#control-ask');
  await prompts(guest.page, 'asked:').locator('button:text("Refuse")').click();
  await host.page.locator('#control-ask').waitFor();
  assert.equal(await prompts(guest.page, 'asked:').count(), 0);
  assert.deepEqual([...host.said, ...guest.said], []);
});

test('a drag without control says who has it, once per gesture, and offers to ask', async (context) => {
  const { host, guest } = await openTwo(context, 'control');
  const before_ = await camera(guest.page);
  await guest.page.evaluate(() => {
    window.added = 0;
    new MutationObserver((list) => { window.added += list.flatMap((m) => [...m.addedNodes]).length; })
      .observe(document.getElementById('messages'), { childList: true });
  });
  await drag(guest.page, [600, 300], [750, 350]);
  const said = prompts(guest.page, 'denied');
  await said.waitFor();
  assert.equal(await said.locator('p').textContent(), 'Guest 1 controls the view.');
  assert.deepEqual(await camera(guest.page), before_);
  await shot(guest.page, 'control-denied');
  await drag(guest.page, [600, 300], [750, 350]);
  await guest.page.mouse.wheel(0, 240);
  assert.equal(await guest.page.evaluate(() => window.added), 1, 'the same message is not repeated');
  await said.locator('button:text("Ask for control")').click();
  await prompts(host.page, 'asked:').waitFor();
  await guest.page.focus('#screen');
  await guest.page.keyboard.press('ArrowLeft');
  await said.locator('p', { hasText: 'You have asked for it.' }).waitFor();
  await prompts(host.page, 'asked:').locator('button:text("Grant")').click();
  await until(guest.page, 'control', (s) => s.canControl);
  await said.waitFor({ state: 'detached' });
});

test('cube, standard views, clip and slices say the same without control', async (context) => {
  const { guest } = await openTwo(context, 'control');
  const { page } = guest;
  const said = prompts(page, 'denied');
  const before_ = await camera(page);
  const close = () => said.locator('button.close').click();
  const acts = {
    cube: () => page.locator('#cube path:not([hidden])').first().click(),
    'view 3': async () => {
      await page.focus('#screen');
      await page.keyboard.press('3');
    },
    clip: () => page.keyboard.press('c'),
    slices: async () => {
      await page.evaluate(() => document.getElementById('layout-four').click());
      await page.click('#pane-axial canvas');
    },
  };
  for (const [name, act] of Object.entries(acts)) {
    await act();
    await said.waitFor();
    assert.equal(await said.locator('p').textContent(), 'Guest 1 controls the view.', name);
    await said.locator('button:text("Ask for control")').waitFor();
    assert.deepEqual(await camera(page), before_, name);
    await close();
  }
  assert.equal(await page.getAttribute('#clip-tool', 'aria-pressed'), 'false');
});

test('a link to watch says that it cannot change the view', async (context) => {
  const { host, guest } = await openTwo(context, 'view');
  await host.page.click('#people-fold summary');
  await host.page.click('#control-release');
  await until(guest.page, 'no holder of control', (s) => s.people.every((p) => !p.isHolder));
  await drag(guest.page, [600, 300], [700, 300]);
  await prompts(guest.page, 'denied').locator('p', { hasText: 'Your link lets you watch' }).waitFor();
  assert.equal(await prompts(guest.page, 'denied').locator('.buttons').count(), 0);
});

test('the camera or everything returns to the default', async (context) => {
  const { page, said } = await open(context, daemon.url);
  await page.click('#reset'); // the window has its final shape now
  await rest(page);
  const start = { camera: await camera(page), transfer: await page.evaluate(() => window.splatd.transfer), background: await page.evaluate(() => window.splatd.background) };
  const now = () => page.evaluate(() => ({ camera: window.splatd.camera, transfer: window.splatd.transfer, background: window.splatd.background }));
  await page.selectOption('#transfer-kind', { index: 2 });
  await page.evaluate(() => { document.getElementById('picture').open = true; });
  await page.locator('#picture button[data-color], #background button').nth(3).click();
  await page.focus('#screen');
  await page.keyboard.press('ArrowLeft');
  await rest(page);
  const changed = await now();
  for (const name of ['camera', 'transfer', 'background']) assert.notDeepEqual(changed[name], start[name], name);
  await page.click('#reset');
  await rest(page);
  assert.deepEqual(await now(), { ...changed, camera: start.camera }, 'the camera alone');
  await page.keyboard.press('ArrowLeft');
  await page.click('#reset-all');
  await until(page, 'the default picture', (s) => s.isIdle && s.background[0] === 0);
  await rest(page);
  assert.deepEqual(await now(), start, 'everything');
  assert.deepEqual(said, []);
});

test('a value read from the picture disappears with the picture', async (context) => {
  const { page } = await open(context, daemon.url);
  const picks = [];
  page.on('websocket', (socket) => socket.on('framesent', ({ payload }) => {
    const { method, params } = typeof payload === 'string' ? JSON.parse(payload) : {};
    if (method === 'pick') picks.push(params);
  }));
  await page.reload();
  await rest(page);
  const said = page.locator('#notice, .prompt[data-id="pick"]').locator('visible=true').locator('p');
  const read = async () => {
    await page.mouse.move(600, 300);
    await page.keyboard.press('v');
    await said.filter({ hasText: /^(Value|Nothing)/ }).waitFor();
  };
  await page.focus('#screen');
  await read();
  await page.keyboard.press('ArrowLeft');
  await said.waitFor({ state: 'hidden' });
  await rest(page);
  await read();
  // A pick right after a change of the size names the new size, which the daemon may not know yet.
  const wider = { ...page.viewportSize(), width: 1500 };
  const before = await page.evaluate(() => window.splatd.wanted);
  await page.setViewportSize(wider);
  const wanted = await until(page, 'the new size', `(s) => s.wanted[0] > ${before[0] + 100} && s.wanted`);
  await page.mouse.move(wider.width - 5, 300);
  await page.keyboard.press('v');
  await said.filter({ hasText: /^Nothing/ }).waitFor();
  assert.deepEqual(picks.at(-1).size, wanted);
  compare(picks.at(-1).at[0], '>', before[0]);
  await page.click('#volumes button[data-id="engine"]');
  await said.waitFor({ state: 'hidden' });
});

test('only formats that the daemon has are offered', async (context) => {
  const { page } = await open(context, daemon.url);
  const has = await page.evaluate(() => document.getElementById('moving') && [...document.getElementById('moving').options].map((o) => o.value));
  const answer = await new Promise((resolve, reject) => {
    const base = new URL(daemon.url);
    fetch(`${base.origin}/api/v1/sessions`, { method: 'POST', body: '{}', headers: { 'Content-Type': 'application/json', Authorization: `Bearer ${base.searchParams.get('token')}` } })
      .then((r) => r.json()).then(({ id, tokens }) => {
        const socket = new WebSocket(`ws://${base.host}/api/v1/sessions/${id}/stream?token=${tokens.control}`, ['splatd.v1']);
        socket.onopen = () => socket.send('{"jsonrpc":"2.0","id":1,"method":"stream.configure","params":{}}');
        socket.onmessage = ({ data }) => {
          const { id: to, result } = typeof data === 'string' ? JSON.parse(data) : {};
          if (to !== 1) return;
          socket.close();
          resolve(result.formats);
        };
      }, reject);
  });
  assert.deepEqual(has.filter((name) => !['auto', ...answer].includes(name)), []);
  assert.ok(has.includes('jpeg'));
});

test('a screen with more pixels than a picture may have does not get full detail', async (context) => {
  const { page } = await open(context, daemon.url, { viewport: { width: 1500, height: 600 }, deviceScaleFactor: 2 });
  await rest(page);
  const width = await page.locator('#screen').evaluate((canvas) => canvas.clientWidth * 2);
  compare(width, '>', 2100);
  await page.locator('#status [data-key="detail"] dd', { hasText: `${Math.round(100 * 2048 / width)} %` }).waitFor();
});

// Headless Chromium does not zoom a page by a synthetic pinch, so the rule is checked that forbids it.
test('a pinch on the panel or beside the picture does not zoom the page', async (context) => {
  const { page } = await open(context, daemon.url, { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true });
  const allowed = await page.evaluate(() => ['screen', 'panel', 'tools', 'messages', 'status'].map((id) => getComputedStyle(document.getElementById(id)).touchAction));
  // The status line passes drags on to the picture, so it allows no gesture of the page either.
  assert.deepEqual(allowed, ['none', ...Array(3).fill('pan-x pan-y'), 'none']);
});
