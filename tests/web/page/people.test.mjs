// SPDX-License-Identifier: Apache-2.0
// Several pages in one session of the real daemon: participants, control, links, forks and saved views.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { camera, firstFrame, openPage, rest, share, shot, unfold, until, visit } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';

const { browser, daemon } = await share(() => startDaemon(['--volume', 'demo:phantom?size=48', '--backend', 'cpu', '--control-time', '600']));
const open = (context, address, options) => visit(context, browser, address, options);

/** Creates a link and reads it from its field. */
async function link(page, kind) {
  if (!(await page.locator('#people-fold').evaluate((fold) => fold.open))) await page.click('#people-fold summary');
  await page.locator('#link-text').evaluate((field) => { field.value = ''; });
  await page.click(`#link-${kind}`);
  const end = performance.now() + 20000;
  while (performance.now() < end) {
    const address = await page.locator('#link-text').inputValue();
    if (address) return address;
  }
  throw new Error(`no link to ${kind}`);
}

const orbit = async (page) => {
  await page.focus('#screen');
  await page.keyboard.press('ArrowLeft');
};
const names = (page) => page.locator('#people li .name').allTextContents();
const isSame = (a, b) => a.position.every((x, i) => Math.abs(x - b.position[i]) < 1e-6);

test('a participant without a typed name keeps its number over a reload; a copy of its tab gets another', async (context) => {
  const host = await open(context, daemon.url);
  const guest = await open(context, await link(host.page, 'control'));
  await until(guest.page, 'the first name', (s) => s.people.some((p) => p.isYou && p.name === 'Guest 2'));
  await guest.page.reload();
  await firstFrame(guest.page);
  await until(host.page, 'the same name', (s) => s.people.length === 2 && s.people.some((p) => !p.isYou && p.name === 'Guest 2'));
  await until(guest.page, 'the same name here', (s) => s.people.some((p) => p.isYou && p.name === 'Guest 2'));
  // A copy of the tab has the same session storage.
  const [copy] = await Promise.all([guest.context.waitForEvent('page'), guest.page.evaluate(() => { window.open(location.href); })]);
  await firstFrame(copy);
  assert.ok(await copy.evaluate(() => Object.keys(sessionStorage).some((key) => key.includes('guest:'))), 'the storage is copied');
  const named = await until(copy, 'a name of its own', (s) => s.people.length === 3 && s.people.find((p) => p.isYou && p.name !== 'Guest 2')?.name);
  await until(guest.page, 'three names', (s) => new Set(s.people.map((p) => p.name)).size === 3);
  await until(guest.page, 'its own number', (s) => s.people.some((p) => p.isYou && p.name === 'Guest 2'));
  await copy.reload();
  await firstFrame(copy);
  await until(guest.page, 'the name of the copy', `(s) => s.people.length === 3 && s.people.some((p) => !p.isYou && p.name === '${named}')`);
});

test('links, names and transfer of control work between participants', async (context) => {
  const host = await open(context, daemon.url);
  const guest = await open(context, await link(host.page, 'control'));
  const watcher = await open(context, await link(host.page, 'watch'));
  assert.equal(new URL(guest.page.url()).hash.includes('token'), false, 'the token is removed from the address');
  await until(host.page, 'three participants', (s) => s.people.length === 3);
  await guest.page.click('#people-fold summary');
  await guest.page.fill('#person-name', 'Grace');
  await guest.page.press('#person-name', 'Enter');
  await until(host.page, 'her name', (s) => s.people.some((p) => p.name === 'Grace' && !p.isYou));
  assert.deepEqual((await names(host.page)).filter((name) => name === 'Grace').length, 1);
  assert.equal(new Set((await host.page.evaluate(() => window.splatd.people)).map((p) => p.color)).size, 3);

  // The first participant to move the view has control; the others follow and cannot change it.
  const start = await camera(host.page);
  await orbit(host.page);
  await until(guest.page, 'the host to have control', (s) => !s.canControl && s.people.some((p) => p.isHolder && !p.isYou));
  await guest.page.locator('#status', { hasText: 'Guest 1 controls' }).waitFor();
  await rest(host.page);
  const moved = await camera(host.page);
  assert.ok(!isSame(moved, start));
  const followed = () => guest.page.evaluate(() => window.splatd.camera);
  while (!isSame(await followed(), moved));
  await orbit(guest.page);
  assert.ok(isSame(await followed(), moved));

  // Request control, see the request, grant it.
  await guest.page.click('#control-ask');
  await host.page.locator('#people li', { hasText: 'asks' }).waitFor();
  await shot(host.page, 'people-asked');
  await host.page.click('#people li button:text("Grant")');
  await until(guest.page, 'control', (s) => s.canControl && s.people.some((p) => p.isYou && p.isHolder));
  await until(host.page, 'control to be lost', (s) => !s.canControl);
  await guest.page.locator('.prompt', { hasText: 'You have control now.' }).waitFor();
  assert.equal(await host.page.locator('.prompt').count(), 0, 'the host granted it: no message');
  await orbit(guest.page);
  await rest(guest.page);
  assert.ok(!isSame(await followed(), moved));
  await shot(guest.page, 'people-guest');

  // Refuse the next request, then release control.
  await watcher.page.click('#people-fold summary');
  assert.ok(await watcher.page.locator('#fork').isHidden());
  assert.ok(await watcher.page.locator('#link-control').isHidden());
  await watcher.page.click('#control-ask');
  await guest.page.click('#people li button:text("Refuse")');
  await watcher.page.locator('#control-ask').waitFor();
  await watcher.page.locator('.prompt', { hasText: 'Grace keeps control.' }).waitFor();
  await guest.page.click('#control-release');
  await until(host.page, 'control to be free', (s) => s.canControl);
  assert.equal(await watcher.page.evaluate(() => window.splatd.canControl), false);
  for (const { said } of [host, guest, watcher]) assert.deepEqual(said, []);
});

test('a fork changes independently and keeps the panel of the page that created it', async (context) => {
  const host = await open(context, daemon.url);
  const guest = await open(context, await link(host.page, 'control'));
  await orbit(host.page);
  await rest(host.page);
  const session = await host.page.evaluate(() => window.splatd.session);
  const start = await camera(host.page);
  for (const { page } of [host, guest]) {
    if (page === guest.page) await page.click('#people-fold summary');
    const [before_] = await Promise.all([page.evaluate(() => window.splatd.session), page.waitForEvent('load'), page.click('#fork')]);
    assert.equal(before_, session);
    await firstFrame(page);
    const now = await page.evaluate(() => window.splatd.session);
    assert.notEqual(now, session);
    assert.ok(isSame(await camera(page), start), 'the fork starts with the view of its origin');
    await until(page, 'no other participant', (s) => s.people.length === 1 && s.canControl);
    await page.reload();
    await firstFrame(page);
    assert.equal(await page.evaluate(() => window.splatd.session), now, 'a reload returns to the fork');
  }
  await host.page.locator('#volumes button').first().waitFor();
  assert.deepEqual([...host.said, ...guest.said], []);
});

test('a link to a view opens it in a new session, also in a page that is already open', async (context) => {
  const host = await open(context, daemon.url);
  await orbit(host.page);
  await rest(host.page);
  const kept = await camera(host.page);
  const address = await link(host.page, 'view');
  assert.match(address, /#view=[0-9a-f]{32}$/);
  await orbit(host.page);
  await rest(host.page);
  const other = await open(context, daemon.url);
  const session = await other.page.evaluate(() => window.splatd.session);
  await Promise.all([other.page.waitForEvent('load'), other.page.evaluate((to) => { location.href = to; }, address)]);
  await firstFrame(other.page);
  assert.ok(isSame(await camera(other.page), kept));
  assert.notEqual(await other.page.evaluate(() => window.splatd.session), session);
  assert.equal(new URL(other.page.url()).hash, '');
  const own = await other.page.evaluate(() => window.splatd.session);
  await other.page.reload();
  await firstFrame(other.page);
  assert.equal(await other.page.evaluate(() => window.splatd.session), own);

  const lost = await openPage(browser);
  context.after(() => lost.context.close());
  await lost.page.goto(`${daemon.url}#view=${'0'.repeat(32)}`);
  await lost.page.locator('#notice', { hasText: 'could not show the view of the link' }).waitFor();
});

test('a preset is saved, listed, applied for all participants, and deleted', async (context) => {
  const host = await open(context, daemon.url);
  await unfold(host.page);
  const paint = (color) => host.page.click(`.swatches button[data-color="${color}"]`);
  assert.equal(await host.page.isVisible('#preset-row'), false, 'there is no preset yet');
  await paint('#ffffff');
  await host.page.selectOption('#compositing', 'splat');
  await rest(host.page);
  await host.page.fill('#preset-name', 'no blanks');
  await host.page.press('#preset-name', 'Enter');
  assert.equal(await host.page.isVisible('#preset-row'), false, 'the name is invalid');
  await host.page.fill('#preset-name', 'white.splats');
  await host.page.press('#preset-name', 'Enter');
  await host.page.locator('#preset-row').waitFor();
  assert.equal(await host.page.inputValue('#preset'), 'white.splats');
  await paint('#000000');
  await host.page.selectOption('#compositing', 'sheet');
  await rest(host.page);
  assert.equal(await host.page.inputValue('#background'), '#000000');

  const other = await open(context, daemon.url); // a session of another page
  await other.page.selectOption('#preset', 'white.splats');
  await until(other.page, 'the preset', () => document.getElementById('background').value === '#ffffff');
  await rest(other.page);
  assert.equal(await other.page.inputValue('#compositing'), 'splat');
  await shot(other.page, 'preset');
  await other.page.click('#preset-delete');
  await other.page.locator('#preset-row').waitFor({ state: 'hidden' });

  const guest = await open(context, await link(host.page, 'control'));
  assert.equal(await guest.page.isVisible('#preset-form'), false, 'presets need a daemon token');
  for (const { said } of [host, other, guest]) assert.deepEqual(said, []);
});
