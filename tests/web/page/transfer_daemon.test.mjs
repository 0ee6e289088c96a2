// SPDX-License-Identifier: Apache-2.0
// The transfer function editor with the real daemon: what it does to the picture, and two windows in one session.
import assert from 'node:assert/strict';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { difference, pixels, rest, share, shot, until, visit } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';

const folder = mkdtempSync(path.join(tmpdir(), 'splatd-transfer-'));
const { browser, daemon } = await share(() => {
  const file = path.join(folder, 'dense.nrrd'); // from 0 to 218 HU: soft tissue without air
  writeFileSync(file, Buffer.concat([Buffer.from('NRRD0005\ntype: uint8\ndimension: 3\nsizes: 8 8 8\nsample units: "HU"\nencoding: raw\n\n'),
    Buffer.from(Array.from({ length: 512 }, (_, i) => 2 * (i % 8) + 4 * Math.floor(i / 10)))]));
  return startDaemon(['--volume', 'demo:engine?size=64', '--volume', file, '--backend', 'cpu', '--control-time', '600']);
}, () => rmSync(folder, { recursive: true }));

async function open(context, address) {
  const opened = await visit(context, browser, address, { viewport: { width: 900, height: 900 } });
  await until(opened.page, 'the histogram', () => !document.getElementById('transfer-kind').disabled || !document.getElementById('transfer-why').hidden);
  return opened;
}

function* colors(image) {
  for (let y = 0; y < image.height; y += 4) for (let x = 0; x < image.width; x += 4) yield image.at(x, y);
}

/** The number of pixels, of one in 16, that are not background. */
const covered = (image) => [...colors(image)].filter(([r, g, b]) => Math.max(r, g, b) > 24).length;

/** The sum of red minus blue of these pixels. */
const warmth = (image) => [...colors(image)].reduce((sum, [r, , b]) => sum + r - b, 0);

async function drawn(page) {
  await rest(page);
  return pixels(page);
}

test('each control changes the picture as it should, and undo brings it back', async (context) => {
  const { page, said } = await open(context, daemon.url);
  const first = await drawn(page);
  compare(covered(first), '>', 2500);
  assert.ok(await page.locator('#transfer-undo').isDisabled(), 'there is nothing to undo before the first change');
  // Without opacity there is no picture.
  const count = (await page.evaluate(() => window.splatd.transfer.points)).length;
  for (let i = 0; i < count; i += 1) {
    await page.fill('#transfer-opacity', '0');
    await page.press('#transfer-opacity', 'Enter');
    await page.click('#transfer-curve [data-part="after"]');
  }
  const none = await drawn(page);
  assert.equal(covered(none), 0);
  while (await page.locator('#transfer-undo').isEnabled()) await page.keyboard.press('Control+z');
  compare(difference(await drawn(page), first), '<', 0.001);

  await page.selectOption('#transfer-map', 'blue-red');
  const map = await drawn(page);
  compare(difference(map, first), '>', 0.03);
  await page.click('#transfer-reverse');
  compare(Math.abs(warmth(await drawn(page)) - warmth(map)), '>', 1000);
  await page.click('#transfer-undo');
  compare(difference(await drawn(page), map), '<', 0.001);

  await page.focus('#screen');
  await page.keyboard.press('w');
  for (let i = 0; i < 12; i += 1) await page.keyboard.press('ArrowUp');
  const higher = await drawn(page);
  compare(covered(higher), '<', covered(map), 'a higher level hides more');
  await page.keyboard.press('Escape');

  await page.click('#gradient summary');
  await until(page, 'the joint histogram', () => Number(document.querySelector('#gradient-curve [data-part="high"]').textContent) > 1);
  await shot(page, 'transfer-engine');
  assert.deepEqual(said, []);
  assert.deepEqual(await page.evaluate(() => window.splatd.errors), []);
});

test('a kind of data that shows nothing says so', async (context) => {
  const { page, said } = await open(context, `${daemon.url}&volume=dense`);
  const nothing = page.locator('.prompt', { hasText: 'CT lung leaves nothing visible' });
  await page.selectOption('#transfer-kind', 'ct-lung');
  await nothing.waitFor();
  assert.equal(covered(await drawn(page)), 0);
  await page.selectOption('#transfer-kind', 'ct-soft');
  await nothing.waitFor({ state: 'detached' });
  compare(covered(await drawn(page)), '>', 100);
  assert.equal(await page.locator('.prompt').count(), 0);
  await page.selectOption('#transfer-kind', 'ct-lung');
  await nothing.getByRole('button', { name: 'Undo' }).click();
  compare(covered(await drawn(page)), '>', 100);
  assert.equal(await nothing.count(), 0);
  assert.deepEqual(said, []);
});

test('two windows: the guest sees the histogram and every change, read-only until the host lets go', async (context) => {
  const host = await open(context, daemon.url);
  await host.page.click('#people-fold summary');
  await host.page.click('#link-control');
  await until(host.page, 'the link', () => document.getElementById('link-text').value !== '');
  const guest = await open(context, await host.page.inputValue('#link-text'));
  await guest.page.locator('#transfer').scrollIntoViewIfNeeded();
  await host.page.selectOption('#transfer-kind', 'simulation');
  await guest.page.locator('#transfer-why', { hasText: 'has control' }).waitFor();
  const points = (page) => page.evaluate(() => window.splatd.transfer.points);
  await rest(host.page);
  const set = await points(host.page);
  await until(guest.page, 'the same points', (s) => s.transfer.points.length > 7);
  (await points(guest.page)).forEach((p, i) => compare(Math.abs(p.value - set[i].value) + Math.abs(p.opacity - set[i].opacity), '<', 1e-5));
  assert.ok(await guest.page.locator('#transfer-value').isDisabled());
  await host.page.click('#control-release');
  await until(guest.page, 'the end of control', () => document.getElementById('transfer-why').hidden);
  await guest.page.selectOption('#transfer-kind', 'microscopy');
  await until(host.page, 'the points of the guest', (s) => s.transfer.points.length === 4);
  await host.page.locator('#transfer-why', { hasText: 'has control' }).waitFor();
  assert.deepEqual([...host.said, ...guest.said], []);
});

test('a function of extreme values, from another client, can be drawn and changed', async (context) => {
  const url = new URL(daemon.url);
  const headers = { authorization: `Bearer ${url.searchParams.get('token')}`, 'content-type': 'application/json' };
  for (const extremes of [[-1.7e308, 1.7e308], [10, 1.5e308], [5e-324, 1e-323, 200]]) {
    const points = extremes.map((value, i) => ({ value, opacity: i / 4, color: [1, 1, 1] }));
    const body = JSON.stringify({ view: { volume: 'engine', transfer_function: { points } } });
    const answer = await fetch(new URL('api/v1/sessions', url), { method: 'POST', headers, body });
    assert.equal(answer.status, 201);
    const { id, tokens } = await answer.json();
    const { page, said } = await open(context, new URL(`#session=${id}&token=${tokens.control}`, url.origin).href);
    const handles = page.locator('#transfer-curve .handle');
    await until(page, 'the points', () => document.querySelectorAll('#transfer-curve .handle').length > 1);
    for (const place of await handles.evaluateAll((all) => all.map((handle) => [handle.style.left, handle.style.top]))) {
      for (const part of place) assert.match(part, /^-?[\d.]+(e-\d+)?%$/, `${extremes}: ${place}`);
    }
    await handles.last().press('ArrowUp');
    await until(page, 'the change', (s) => s.isIdle && s.sent > 0);
    const values = await page.evaluate(() => window.splatd.transfer.points.map((p) => p.value));
    assert.deepEqual(values, extremes.map((value) => Math.min(1e300, Math.max(-1e300, value))));
    assert.deepEqual(said, []);
  }
});
