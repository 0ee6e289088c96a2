#!/usr/bin/env node
// SPDX-License-Identifier: Apache-2.0
// Measures the page in Debian's Chromium, with the daemon on the same machine:
//   first    from the start of the navigation to the first picture on the canvas
//   turn     from a pointer event to the picture that shows it, and pictures per second, while a drag turns the volume
//   points   the same, while a point of the transfer function is dragged
//   clip     the same, while a face of the clip box is dragged by its handle
//
//   node tests/bench/browser.mjs [--bin DIR] [--volumes LIST] [--px N] [--seconds N] [--loads N] [--rounds N] [--out FILE.csv]
//
// `allowed_ms` is the goal for p95 of a drag: 60 ms and the time to render and encode (p95 of the same pictures).
import fs from 'node:fs';
import { parseArgs } from 'node:util';
import { launch, openPage, until, WHOLE } from '../web/support/browser.mjs';
import { startDaemon } from '../web/support/daemon.mjs';

const COLUMNS = ['what', 'volume', 'px', 'count', 'fps', 'p50_ms', 'p95_ms', 'render_p50_ms', 'render_p95_ms', 'allowed_ms'];
const { values: options } = parseArgs({
  options: {
    bin: { type: 'string' },
    volumes: { type: 'string', default: 'demo:engine' },
    px: { type: 'string', default: '1024' },
    seconds: { type: 'string', default: '6' },
    loads: { type: 'string', default: '7' },
    rounds: { type: 'string', default: '3' },
    out: { type: 'string' },
    help: { type: 'boolean' },
  },
});
const px = Number(options.px);
const rows = [];
const round = (x) => Math.round(x * 10) / 10;
const quantile = (list, part) => round([...list].sort((a, b) => a - b)[Math.min(list.length - 1, Math.floor(list.length * part))] ?? NaN);

function add(row) {
  rows.push(row);
  process.stdout.write(`${COLUMNS.filter((name) => row[name] !== undefined).map((name) => `${name} ${row[name]}`).join('  ')}\n`);
}

/** Runs in the page: notes the first picture, and each later one with its latency. */
function observe() {
  window.pictures = [];
  let count = 0;
  const look = () => {
    const shown = window.splatd;
    if (shown && shown.count > count) {
      count = shown.count;
      window.firstMs ??= performance.now();
      window.pictures.push({ at: performance.now(), latency: shown.latencyMs, render: shown.renderMs });
    }
    requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
}

async function open(browser, url) {
  const opened = await openPage(browser, { viewport: { width: px, height: px } });
  await opened.page.addInitScript(observe);
  await opened.page.goto(url);
  await until(opened.page, 'the first picture', (s) => s.isFinal && s.isIdle && window.firstMs);
  return opened;
}

async function measureFirst(browser, url, volume) {
  const times = [];
  for (let i = 0; i < Number(options.loads); i += 1) {
    const { page, context } = await open(browser, url);
    times.push(await page.evaluate(() => window.firstMs));
    await context.close();
  }
  add({ what: 'first', volume, px, count: times.length, p50_ms: quantile(times, 0.5), p95_ms: quantile(times, 0.95) });
}

/** Moves the pressed mouse around [x, y] for the measured time; returns the pictures of that time. */
async function drag(page, [x, y], [wide, high]) {
  await page.mouse.move(x, y);
  await page.mouse.down();
  const end = performance.now() + Number(options.seconds) * 1000;
  let step = 0;
  let from = 0;
  for (const start = performance.now(); performance.now() < end; step += 1) {
    if (!from && performance.now() > start + 1000) from = await page.evaluate(() => window.pictures.splice(0) && performance.now());
    await page.mouse.move(x + wide * Math.sin(step / 9), y + high * Math.sin(step / 13));
  }
  const result = await page.evaluate((since) => ({ ms: performance.now() - since, pictures: window.pictures.splice(0) }), from);
  await page.mouse.up();
  await until(page, 'rest', (s) => s.isIdle && s.isFinal);
  return result;
}

async function measureDrags(browser, url, volume) {
  const { page, context } = await open(browser, url);
  const acts = {
    turn: () => drag(page, [px * 0.65, px * 0.5], [px * 0.2, px * 0.2]),
    points: async () => {
      const box = await page.locator('#transfer-curve .handle').nth(1).boundingBox();
      return drag(page, [box.x + box.width / 2, box.y + box.height / 2], [12, 12]);
    },
  };
  acts.clip = async () => {
    const press = (id) => page.evaluate((name) => document.getElementById(name).click(), id);
    await press('clip-tool');
    await page.locator('.knob.face:visible').first().waitFor();
    const box = await page.evaluate(() => { // the handle that is farthest to the right is covered by nothing
      const boxes = [...document.querySelectorAll('.knob.face:not([hidden])')].map((handle) => handle.getBoundingClientRect());
      const { x, y, width, height } = boxes.sort((a, b) => b.x - a.x)[0];
      return { x, y, width, height };
    });
    const result = await drag(page, [box.x + box.width / 2, box.y + box.height / 2], [60, 30]);
    await press('clip-reset');
    await press('clip-tool');
    await until(page, 'rest', (s) => s.isIdle && s.isFinal);
    return result;
  };
  const seen = Object.fromEntries(Object.keys(acts).map((what) => [what, []]));
  const times = Object.fromEntries(Object.keys(acts).map((what) => [what, 0]));
  for (let i = 0; i < Number(options.rounds); i += 1) { // in turn, so that a busy moment hits both
    for (const [what, act] of Object.entries(acts)) {
      const { ms, pictures } = await act();
      seen[what].push(...pictures);
      times[what] += ms;
    }
  }
  for (const what of Object.keys(acts)) {
    const [latencies, renders] = [seen[what].map((p) => p.latency), seen[what].map((p) => p.render)];
    const late = quantile(renders, 0.95);
    add({ what, volume, px, count: seen[what].length, fps: round(seen[what].length / times[what] * 1000), p50_ms: quantile(latencies, 0.5),
      p95_ms: quantile(latencies, 0.95), render_p50_ms: quantile(renders, 0.5), render_p95_ms: late, allowed_ms: round(60 + late) });
  }
  await context.close();
}

if (options.help) {
  const [, , ...head] = fs.readFileSync(new URL(import.meta.url), 'utf8').split('\n', 12);
  process.stdout.write(`${head.map((line) => line.slice(3)).join('\n')}\n`);
} else {
  if (options.bin) process.env.SPLATD_BIN_DIR = options.bin;
  const browser = await launch(WHOLE);
  for (const volume of options.volumes.split(',')) {
    const daemon = await startDaemon(['--volume', volume]);
    const name = volume.split('/').at(-1);
    await measureFirst(browser, daemon.url, name);
    await measureDrags(browser, daemon.url, name);
    await daemon.stop();
  }
  await browser.close();
  if (options.out) fs.writeFileSync(options.out, `${[COLUMNS, ...rows.map((row) => COLUMNS.map((name) => row[name] ?? ''))].map((row) => row.join(',')).join('\n')}\n`);
}
