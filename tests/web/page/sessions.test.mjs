// SPDX-License-Identifier: Apache-2.0
// Which session the page lands in: after a reload, after a restart of the real daemon with another token, and with wrong addresses.
import assert from 'node:assert/strict';
import { mkdtempSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { firstFrame, share, shot, until, visit } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';

const VOLUMES = ['--volume', 'demo:phantom?size=32', '--volume', 'demo:engine?size=32', '--backend', 'cpu'];

const { browser } = await share();
const open = (context, address) => visit(context, browser, address);
const session = (page) => page.evaluate(() => window.splatd.session);
const volume = (page) => page.evaluate(() => window.splatd.volume);
const prompt = (page, id) => page.locator(`.prompt[data-id="${id}"]`);

/** The address of the running session for a guest with control. */
async function invite(page) {
  await page.evaluate(() => { document.getElementById('people-fold').open = true; });
  await page.click('#link-control');
  await page.locator('#link-text:not(:placeholder-shown)').waitFor();
  for (;;) {
    const address = await page.locator('#link-text').inputValue();
    if (address) return address;
  }
}

test('a reload of an address with volume= returns to the session and its guests', async (context) => {
  const daemon = await startDaemon(VOLUMES);
  context.after(() => daemon.stop());
  const { page } = await open(context, `${daemon.url}&volume=engine`);
  assert.equal(await volume(page), 'engine');
  const id = await session(page);
  const guest = await open(context, await invite(page));
  await page.reload();
  await firstFrame(page);
  assert.equal(await session(page), id);
  await until(page, 'the guest', (s) => s.people.length === 2);
  await page.goto(`${new URL(daemon.url).origin}/?volume=phantom`);
  await firstFrame(page);
  assert.equal(await volume(page), 'phantom', 'another volume in the address begins another session');
  assert.notEqual(await session(page), id);
  assert.deepEqual(guest.said, []);
});

test('an unknown volume= is said, with the volumes that exist', async (context) => {
  const daemon = await startDaemon(VOLUMES);
  context.after(() => daemon.stop());
  const { page } = await open(context, `${daemon.url}&volume=nosuch`);
  const said = prompt(page, 'missing');
  await said.waitFor();
  assert.equal(await said.locator('p').textContent(), 'There is no volume “nosuch”. The picture shows phantom. The daemon has these volumes: phantom, engine.');
  await shot(page, 'volume-unknown');
  await said.locator('.close').click();
  assert.equal(await said.count(), 0);
  await page.reload();
  await firstFrame(page);
  assert.equal(await said.count(), 0, 'a reload returns to the session');
});

test('after a restart with a new token, host and guest meet in their session', async (context) => {
  const state = mkdtempSync(path.join(tmpdir(), 'splatd-state-'));
  context.after(() => rmSync(state, { recursive: true }));
  const args = [...VOLUMES, '--state', state];
  let daemon = await startDaemon(args);
  context.after(() => daemon.stop());
  const host = await open(context, daemon.url);
  const id = await session(host.page);
  const guest = await open(context, await invite(host.page));
  await until(host.page, 'the guest', (s) => s.people.length === 2);
  const { port, url } = daemon;
  assert.equal(await daemon.stop(), 0);
  await host.page.locator('#status-state[data-state="lost"]').waitFor();
  daemon = await startDaemon(args, { port });
  assert.notEqual(daemon.url, url, 'the token is another one');

  // Without the new token: the open page returns by its join token, says what it lacks, and takes the token.
  await until(host.page, 'both again', (s) => s.state === 'live' && s.people.length === 2);
  await until(guest.page, 'both again', (s) => s.state === 'live' && s.people.length === 2);
  assert.equal(await session(host.page), id);
  for (const [page, number] of [[host.page, 1], [guest.page, 2]]) {
    await until(page, 'the numbers from before', `(s) => s.people.length === 2 && s.people.every((p) => p.name === 'Guest ' + (p.isYou ? ${number} : ${3 - number}))`);
  }
  await prompt(host.page, 'locked').waitFor();
  await shot(host.page, 'session-locked');
  await prompt(host.page, 'locked').locator('.buttons button').click();
  await host.page.fill('#token-input', daemon.url);
  await host.page.press('#token-input', 'Enter');
  await until(host.page, 'the host with the token', (s) => s.state === 'live' && s.people.length === 2);
  await prompt(host.page, 'locked').waitFor({ state: 'detached' });
  assert.equal(await session(host.page), id);

  // With the printed address, in the same tab after one more restart, and in a new one.
  await host.page.goto('about:blank');
  assert.equal(await daemon.stop(), 0);
  daemon = await startDaemon(args, { port });
  await until(guest.page, 'the guest again', (s) => s.state === 'live' && s.people.length === 1);
  const tab = await host.context.newPage();
  await tab.goto(daemon.url);
  await firstFrame(tab);
  assert.equal(await session(tab), id, 'a new tab with the new token');
  await host.page.goto(daemon.url);
  await firstFrame(host.page);
  assert.equal(await session(host.page), id, 'the old tab with the new token');
  await until(guest.page, 'three participants with names of their own', (s) => new Set(s.people.map((p) => p.name)).size === 3);
  await until(guest.page, 'the number of the guest', (s) => s.people.some((p) => p.isYou && p.name === 'Guest 2'));
  const other = await host.context.newPage();
  await other.goto(daemon.url);
  await firstFrame(other);
  assert.notEqual(await session(other), id, 'without a restart a new tab has a session of its own');
});

test('without --state a restart ends the session: the host learns that the links are dead', async (context) => {
  let daemon = await startDaemon(VOLUMES);
  context.after(() => daemon.stop());
  const { page } = await open(context, daemon.url);
  const id = await session(page);
  const guest = await open(context, await invite(page));
  await until(page, 'the guest', (s) => s.people.length === 2);
  const { port } = daemon;
  assert.equal(await daemon.stop(), 0);
  await page.locator('#status-state[data-state="lost"]').waitFor();
  daemon = await startDaemon(VOLUMES, { port });
  await page.locator('#token-form').waitFor();
  await page.fill('#token-input', daemon.url);
  await page.press('#token-input', 'Enter');
  await prompt(page, 'replaced').waitFor();
  await page.locator('#status-state[data-state="live"]').waitFor();
  assert.notEqual(await session(page), id);
  await guest.page.locator('#banner', { hasText: 'has ended' }).waitFor();
  await prompt(page, 'replaced').locator('.buttons button').click();
  await page.locator('#link-watch').waitFor();
  assert.equal(await prompt(page, 'replaced').count(), 0);
});
