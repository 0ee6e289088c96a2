// SPDX-License-Identifier: Apache-2.0
// Real volumes in the page, if the data are present: loaded, drawn and rotated.
import assert from 'node:assert/strict';
import { existsSync } from 'node:fs';
import path from 'node:path';
import { test } from 'node:test';
import { compare } from '../../support/compare.mjs';
import { difference, drag, pixels, rest, share, shot, until, visit } from '../support/browser.mjs';
import { DATA, startDaemon } from '../support/daemon.mjs';

const FILES = ['engine_256x256x128_uint8.nrrd', 'cthead_256x256x113_uint16.nrrd'].map((name) => path.join(DATA, 'volumes', name));
const present = FILES.filter((file) => existsSync(file));
const skip = present.length ? false : `no ${FILES.join(' and no ')}`;

const { browser } = skip ? {} : await share();

for (const file of skip ? FILES : present) {
  const id = path.basename(file, '.nrrd');
  test(`${id} is loaded, drawn and rotated`, { skip }, async (context) => {
    const daemon = await startDaemon(['--volume', file, '--data', path.dirname(file)]);
    context.after(() => daemon.stop());
    const { page, said } = await visit(context, browser, daemon.url);
    await rest(page);
    const first = await pixels(page);
    await shot(page, `${id}-first`);
    await drag(page, [450, 300], [620, 220], { steps: 30 });
    await until(page, 'moved', (s) => s.sent > 0);
    await rest(page);
    compare(difference(first, await pixels(page)), '>', 0.02);
    await shot(page, `${id}-turned`);
    console.log(`${id}: latency ${Math.round(await page.evaluate(() => window.splatd.latencyMs))} ms, `
      + `stats ${JSON.stringify(await page.evaluate(() => window.splatd.stats))}`);
    assert.deepEqual(said, []);
  });
}
