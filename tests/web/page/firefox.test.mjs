// SPDX-License-Identifier: Apache-2.0
// The page in Firefox, with the real daemon: the picture, the ways to move the camera, slices, and a comparison.
import assert from 'node:assert/strict';
import { after, test } from 'node:test';
import { startDaemon } from '../support/daemon.mjs';
import { firefox } from '../support/firefox.mjs';

const daemon = await startDaemon(['--volume', 'demo:phantom?size=32', '--backend', 'cpu']);
after(async () => assert.equal(await daemon.stop(), 0));

test('the page works in Firefox, without a message in its console', async (context) => {
  const page = await firefox({ width: 1000, height: 700 });
  context.after(() => page.close());
  await page.open(daemon.url);
  const rest = () => page.until('rest', '((s) => s && s.isIdle && s.count > 0 && s.isFinal && s.seq === s.sent)(window.splatd)');
  const camera = () => page.evaluate('JSON.stringify(window.splatd.camera)');
  await rest();
  let before = await camera();
  for (const [name, act] of Object.entries({
    mouse: () => page.drag([700, 300], [760, 340]), finger: () => page.touch([700, 300], [740, 300]), wheel: () => page.wheel([700, 300], -200),
    key: async () => {
      await page.evaluate('document.getElementById("screen").focus()');
      await page.press('1');
    },
  })) {
    await act();
    await page.until(`a camera moved by ${name}`, `JSON.stringify(window.splatd.camera) !== ${JSON.stringify(before)}`);
    await rest();
    before = await camera();
  }
  await page.press('l');
  await page.until('three slices', 'document.querySelectorAll(".pane-body[data-state=newest]").length === 3');
  await page.evaluate('document.getElementById("compare-start").click()');
  await page.until('the second picture', 'window.splatd.compared?.isAtRest');
  assert.deepEqual(page.said, []);
  assert.deepEqual(await page.evaluate('window.splatd.errors'), []);
});
