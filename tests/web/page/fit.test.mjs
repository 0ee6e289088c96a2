// SPDX-License-Identifier: Apache-2.0
// "Fit" frames what is visible: with the transfer function and the clip of the moment, in the free part of the window.
import assert from 'node:assert/strict';
import { writeFileSync } from 'node:fs';
import path from 'node:path';
import { after, test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { lit, writeBlock } from '../support/block.mjs';
import { boxOf, camera, pixels, rest, share, shot, until, visit } from '../support/browser.mjs';
import { startDaemon } from '../support/daemon.mjs';

const SIDE = 96;
/** Two cubes: a dim large one, and a bright one of 8³ voxels far from the centre. */
const LARGE = { low: 40, size: 48, value: 90 };
const SMALL = { low: 8, size: 8, value: 220 };
const CENTER = SMALL.low + (SMALL.size - 1) / 2;

const block = writeBlock(); // for its folder
const { browser, daemon } = await share(() => {
  const samples = Buffer.alloc(SIDE ** 3);
  for (const { low, size, value } of [LARGE, SMALL]) {
    for (let z = low; z < low + size; z += 1) {
      for (let y = low; y < low + size; y += 1) samples.fill(value, (z * SIDE + y) * SIDE + low, (z * SIDE + y) * SIDE + low + size);
    }
  }
  const file = path.join(block.folder, 'cubes.nrrd');
  const head = `NRRD0004\ntype: uint8\ndimension: 3\nsizes: ${SIDE} ${SIDE} ${SIDE}\nspacings: 1 1 1\nencoding: raw\n\n`;
  writeFileSync(file, Buffer.concat([Buffer.from(head), samples]));
  return startDaemon(['--volume', file, '--control-time', '600']);
}, () => block.remove());

/** Changes the view of the page's session from elsewhere. */
async function change(page, patch) {
  await rest(page); // a page that still sends its own changes keeps them
  const { origin } = new URL(daemon.url);
  const [, token] = /token=([^&]+)/.exec(daemon.url);
  const ask = async (what, options) => {
    const answer = await fetch(`${origin}/api/v1/${what}`, { headers: { Authorization: `Bearer ${token}`, 'Content-Type': 'application/json' }, ...options });
    assert.ok(answer.ok, await answer.clone().text());
    return answer.json();
  };
  const { sessions } = await ask('sessions');
  await ask(`sessions/${sessions[0].id}`, { method: 'PATCH', body: JSON.stringify({ view: patch }) });
  await page.waitForFunction((wanted) => JSON.stringify(window.splatd.transfer?.points?.length) === wanted, String(patch.transfer_function.points.length));
  await rest(page);
}

const away = (a, b) => Math.hypot(...a.map((x, i) => x - b[i]));

test('a small visible object fills the free part of the window after Fit, and becomes the centre of the orbit', async (context) => {
  const { page, said } = await visit(context, browser, daemon.url, { viewport: { width: 1280, height: 800 }, reducedMotion: 'reduce' });
  const opaque = (value, opacity) => ({ value, color: [1, 1, 1], opacity });
  await change(page, { transfer_function: { points: [opaque(150, 0), opaque(160, 0.9), opaque(255, 0.9)] }, shading: { mode: 'none' } });
  const small = lit(await pixels(page));
  await page.locator('#screen').focus();
  await page.keyboard.press('f');
  await until(page, 'the small cube', (s) => Math.hypot(...s.camera.target.map((x) => x - 11.5)) < 0.3);
  await rest(page);
  await shot(page, 'fit-small');
  const image = await pixels(page);
  const object = lit(image);
  const canvas = await boxOf(page.locator('#screen'));
  const [panel, status, tools] = await Promise.all(['#panel', '#status', '#toolbar'].map((id) => boxOf(page.locator(id))));
  const scale = canvas.width / image.width;
  const space = canvas.height - 2 * Math.max(canvas.y + canvas.height - status.y, tools.y + tools.height - canvas.y);
  compare(object.height * scale, '<', space + 2);
  compare(object.height * scale, '>', 0.7 * space, 'it fills the height');
  compare(object.height, '>', 3 * small.height, 'it was small');
  compare(object.left * scale, '>', panel.x + panel.width - canvas.x, 'it is clear of the panel');
  compare(Math.abs((object.left + object.width / 2) * scale - canvas.width / 2), '<', 0.05 * canvas.width);
  const first = await camera(page);
  for (let i = 0; i < 3; i += 1) await page.keyboard.press('ArrowLeft');
  await until(page, 'a turn', `(s) => String(s.camera.position) !== '${first.position}'`);
  await rest(page);
  compare(away((await camera(page)).target, [CENTER, CENTER, CENTER]), '<', 0.3, 'it turns about the object');

  // Nothing visible: the whole volume.
  await change(page, { transfer_function: { points: [opaque(0, 0), opaque(255, 0)] } });
  await page.locator('#screen').focus();
  await page.keyboard.press('f');
  await until(page, 'the whole volume', (s) => Math.hypot(...s.camera.target.map((x) => x - 47.5)) < 0.01);

  // Both cubes: the box of the two.
  await change(page, { transfer_function: { points: [opaque(20, 0), opaque(80, 0.5), opaque(200, 0.9), opaque(255, 0.9)] } });
  await page.click('#fit');
  await until(page, 'both', (s) => Math.hypot(...s.camera.target.map((x) => x - 47.5)) < 1);
  assert.deepEqual(said, []);
});
