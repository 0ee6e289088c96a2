// SPDX-License-Identifier: Apache-2.0
// Time series with the real daemon: the slider, keys, playing for two windows, slices of the step.
import assert from 'node:assert/strict';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { checkAxe, difference, NEEDS_AXE, pixels, rest, share, shot, until, visit } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';

const SIDE = 24;
const STEPS = 4;
const folder = mkdtempSync(path.join(tmpdir(), 'splatd-time-'));

/** A ball that grows from step to step. */
function ball(step) {
  const bytes = Buffer.alloc(SIDE ** 3);
  for (let i = 0; i < bytes.length; i += 1) {
    const [x, y, z] = [i % SIDE, Math.floor(i / SIDE) % SIDE, Math.floor(i / SIDE / SIDE)].map((c) => c - (SIDE - 1) / 2);
    bytes[i] = Math.max(0, Math.min(255, 128 + 60 * (4 + 2 * step - Math.hypot(x, y, z))));
  }
  return bytes;
}

const { browser, daemon } = await share(() => {
  const header = `ObjectType = Image\nNDims = 4\nDimSize = ${SIDE} ${SIDE} ${SIDE} ${STEPS}\nElementSpacing = 1 1 1 0.5\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n`;
  writeFileSync(path.join(folder, 'balls.mha'), Buffer.concat([Buffer.from(header), ...[...Array(STEPS).keys()].map(ball)]));
  for (const n of [7, 8]) writeFileSync(path.join(folder, `run_${n}.mha`), Buffer.concat([Buffer.from(header.replace('NDims = 4', 'NDims = 3').replace(` ${STEPS}\n`, '\n').replace(' 0.5\n', '\n')), ball(n - 7)]));
  return startDaemon(['--data', folder, '--volume', path.join(folder, 'balls.mha'), '--volume', 'demo:phantom?size=24', '--backend', 'cpu', '--control-time', '600']);
}, () => rmSync(folder, { recursive: true }));

const open = (context, more = '') => visit(context, browser, `${daemon.url}${more}`, { viewport: { width: 1040, height: 640 } });
const stepOf = (page) => page.evaluate(() => window.splatd.view.time.step);
const atStep = (page, step) => until(page, `step ${step}`, `(s) => s.view.time.step === ${step}`);

test('slider, number and keys choose the step, which the picture and the slices show', NEEDS_AXE, async (context) => {
  const { page, said } = await open(context);
  await rest(page);
  const first = await pixels(page);
  await page.focus('#time-step');
  await page.keyboard.press('End');
  await atStep(page, STEPS - 1);
  await rest(page);
  compare(difference(await pixels(page), first), '>', 0.05);
  assert.equal(await page.getAttribute('#time-step', 'aria-valuetext'), '3, at 1.5');
  await page.fill('#time-number', '1');
  await page.press('#time-number', 'Enter');
  await atStep(page, 1);
  await page.focus('#screen');
  await page.keyboard.press('<');
  await page.keyboard.press('<'); // round the end
  await atStep(page, STEPS - 1);
  await page.click('#layout-four');
  const value = () => page.evaluate(() => document.querySelector('#pane-axial .slice-read').textContent);
  await until(page, 'the slices of the step', () => document.querySelector('#pane-axial .pane-body').dataset.state === 'newest');
  assert.match(await value(), /^255 /);
  await checkAxe(page, '#time');
  await shot(page, 'time');
  assert.deepEqual(said, []);
});

test('playing goes on in all windows until it is stopped', async (context) => {
  const { page } = await open(context);
  const id = await page.evaluate(() => window.splatd.session);
  const answer = await fetch(`${new URL(daemon.url).origin}/api/v1/sessions/${id}`, { headers: { Authorization: `Bearer ${new URL(daemon.url).searchParams.get('token')}` } });
  const { tokens } = await answer.json();
  const link = `${new URL(daemon.url).origin}/#session=${id}&token=${tokens.view}`; // of a guest, who gets no list of volumes
  const other = await visit(context, browser, link, { viewport: { width: 900, height: 700 } });
  await page.fill('#time-rate', '20');
  await page.click('#time-play');
  for (const one of [page, other.page]) for (let step = 0; step < STEPS; step += 1) await atStep(one, step);
  assert.equal(await other.page.getAttribute('#time-play', 'data-icon'), 'pause');
  await page.click('#time-play');
  await until(other.page, 'the stop', () => document.getElementById('time-play').dataset.icon === 'play');
  await rest(page);
  await rest(other.page);
  assert.equal(await stepOf(page), await stepOf(other.page));
});

test('the dialog Open offers numbered files as one series', async (context) => {
  const { page } = await open(context, '&volume=phantom');
  await page.keyboard.press('o');
  await page.click('#open-list [data-kind="steps"]');
  await page.locator('#time').waitFor();
  assert.equal(await page.getAttribute('#time-step', 'max'), '1');
});

test('a volume without steps has no section', async (context) => {
  const { page } = await open(context, '&volume=phantom');
  assert.equal(await page.isVisible('#time'), false);
});
