// SPDX-License-Identifier: Apache-2.0
// GET /metrics: Prometheus can parse it, and the values match what happened.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import { spawnSync } from 'node:child_process';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { fileURLToPath } from 'node:url';
import { compare } from '../support/compare.mjs';
import { Daemon, Raw, turned } from './harness.mjs';

const parser = path.join(path.dirname(fileURLToPath(import.meta.url)), 'metrics_parse.py');
let daemon;

before(async () => {
  daemon = await Daemon.start(['--volume', 'demo:engine?size=16', '--connections-per-address', '40', '--stall-time', '0.3'], { backend: 'cpu' });
  await daemon.loaded('engine');
});
after(async () => assert.equal(await daemon.stop(), 0));

async function scrape(of = daemon) {
  const answer = await of.fetch('/metrics');
  assert.equal(answer.status, 200);
  assert.equal(answer.headers.get('content-type'), 'text/plain; version=0.0.4; charset=utf-8');
  const { status, stdout, stderr } = spawnSync('/usr/bin/python3', [parser], { input: await answer.text(), encoding: 'utf8' });
  if (status === 77) return null;
  assert.equal(status, 0, stderr);
  return JSON.parse(stdout);
}

/** Scrapes until `fits(values)` is true. */
async function until(fits, what) {
  for (const end = Date.now() + 30000; Date.now() < end;) {
    const values = await scrape();
    if (fits(values)) return values;
  }
  throw new Error(`${what}: ${JSON.stringify(await scrape())}`);
}

test('a scrape parses and needs the token', async (t) => {
  const values = await scrape();
  if (!values) return t.skip('no python3-prometheus-client');
  assert.equal((await daemon.fetch('/metrics', { token: null })).status, 401);
  const build = Object.keys(values).find((key) => key.startsWith('splatd_build_info'));
  assert.match(build, /backend=cpu.*version=\d/);
  assert.equal(values['splatd_volume_bytes,volume=engine'], Math.ceil((16 * 9 * 9) / 64) * 64); // in lines of 64 bytes
  compare(values.splatd_memory_budget_bytes, '>', 0);
  compare(values.process_resident_memory_bytes, '>', 1e6);
  compare(values.process_open_fds, '>', 3);
  compare(values.process_cpu_seconds_total, '>', 0);
  const limits = fs.readFileSync(`/proc/${daemon.child.pid}/limits`, 'utf8');
  assert.equal(values.process_max_fds, Number(/Max open files\s+(\d+)/.exec(limits)[1]));
  const started = fs.statSync(`/proc/${daemon.child.pid}`).ctimeMs / 1000;
  compare(Math.abs(values.process_start_time_seconds - started), '<', 3600, 'the start time is neither the boot time nor 1970');
  assert.equal(values.splatd_path_bytes_limit, 4 * 2 ** 30);
  assert.equal(values.splatd_state_failing, 0);
  for (const stage of ['queue', 'render', 'readback', 'encode', 'send', 'round_trip']) {
    assert.equal(values[`splatd_stage_seconds_count,stage=${stage}`], 0);
  }
});

test('requests, frames and streams are counted', async (t) => {
  const before_ = await scrape();
  if (!before_) return t.skip('no python3-prometheus-client');
  const rise = (values, key) => values[key] - before_[key];
  for (let i = 0; i < 3; i += 1) await daemon.fetch('/api/v1/render', { method: 'POST', body: '{}', headers: { 'Content-Type': 'application/json' } });
  assert.equal((await daemon.post('/api/v1/render', '{')).status, 400);
  const renders = await scrape();
  assert.equal(rise(renders, 'splatd_pictures_total'), 3);
  assert.equal(rise(renders, 'splatd_http_requests_total,status=4xx'), 1);
  assert.equal(rise(renders, 'splatd_http_requests_total,status=2xx'), 4, 'three images and the first scrape');
  assert.equal(rise(renders, 'splatd_http_bytes_total,direction=in'), 7);
  compare(renders['splatd_derived_bytes,backend=cpu,volume=engine,worker=snapshot'], '>', 0);

  const session = await daemon.session();
  const stream = await daemon.stream({ session });
  const watching = await daemon.stream({ session, token: session.tokens.view });
  await stream.final();
  for (let i = 1; i <= 10; i += 1) await stream.update(turned(session.view, i), i);
  await stream.final(10);
  const got = [...stream.frames, ...watching.frames];
  const bytes = got.reduce((sum, f) => sum + f.headerBytes + f.bytes, 0);
  const during = await until((v) => rise(v, 'splatd_stage_seconds_count,stage=round_trip') >= 4
    && rise(v, 'splatd_stream_bytes_total,direction=out') > bytes, 'round trips and the bytes of all frames');
  assert.equal(during.splatd_sessions, 1);
  assert.equal(during['splatd_participants,role=control'], 1);
  assert.equal(during['splatd_participants,role=view'], 1);
  assert.equal(rise(during, 'splatd_streams_joined_total'), 2);
  assert.equal(rise(during, 'splatd_http_requests_total,status=1xx'), 2);
  for (const stage of ['queue', 'render', 'readback', 'encode', 'send']) {
    compare(rise(during, `splatd_stage_seconds_count,stage=${stage}`), '>=', 3, stage);
    // Sheets per pixel have no readback of their own: each tile writes its pixels.
    if (stage !== 'readback') compare(rise(during, `splatd_stage_seconds_sum,stage=${stage}`), '>', 0, stage);
  }
  compare(rise(during, 'splatd_frames_total'), '>=', got.length);
  compare(rise(during, 'splatd_stream_bytes_total,direction=in'), '>', 0);
  await stream.end();
  await watching.end();
  const ended = await until((v) => rise(v, 'splatd_streams_ended_total,reason=closed') === 2, 'two closes');
  assert.equal(ended['splatd_participants,role=control'], 0);
  compare(ended.splatd_connections, '>=', 1);
});

test('frames of camera paths are counted', async (t) => {
  const before_ = await scrape();
  if (!before_) return t.skip('no python3-prometheus-client');
  const made = await daemon.post('/api/v1/paths', { view: { volume: 'engine' }, size: [16, 16], frames: 2, keyframes: [{ frame: 1, view: {} }] });
  assert.equal(made.status, 202);
  const values = await until((v) => v.splatd_paths === 1 && v.splatd_paths_unfinished === 0, 'the path to finish');
  assert.equal(values.splatd_path_frames_total, before_.splatd_path_frames_total + 2);
  assert.deepEqual([values.splatd_path_failures_total, values.splatd_paths_waiting], [0, 0]);
  assert.equal((await daemon.fetch(`/api/v1/paths/${made.json.id}`, { method: 'DELETE' })).status, 204);
});

test('streams that end with an error are counted by reason', async (t) => {
  const before_ = await scrape();
  if (!before_) return t.skip('no python3-prometheus-client');
  const session = await daemon.session();
  const rising = (reason) => until((v) => v[`splatd_streams_ended_total,reason=${reason}`]
    === before_[`splatd_streams_ended_total,reason=${reason}`] + 1, reason);
  const stalled = await daemon.stream({ session, acks: false });
  await rising('stalled');
  assert.equal((await stalled.until(() => stalled.closed, 'the close')).code, 1008);
  const bad = await Raw.webSocket(daemon, session);
  bad.write(Buffer.from([0xff, 0xff, 0, 0, 0, 0]));
  await rising('protocol');
  bad.destroy();
  const lost = await Raw.webSocket(daemon, session);
  lost.destroy();
  await rising('lost');
});

test('many volumes with unusual names do not create many time series', async (t) => {
  const many = await Daemon.start([...Array(60).keys()].flatMap((i) => ['--volume', `demo:engine?size=${i + 8}`]));
  for (let i = 0; i < 20; i += 1) assert.equal((await many.post('/api/v1/volumes', { uri: `demo:phantom?size=${i + 8}`, id: `x.${i}`, name: '"\\{}' })).status, 202);
  for (let i = 0; i < 20; i += 1) await many.loaded(`x.${i}`);
  const values = await scrape(many);
  assert.equal(await many.stop(), 0);
  if (!values) return t.skip('no python3-prometheus-client');
  const series = Object.keys(values).filter((key) => key.startsWith('splatd_volume_bytes'));
  assert.equal(series.length, 65);
  assert.equal(series.reduce((sum, key) => sum + values[key], 0), values['splatd_memory_bytes,kind=voxels']);
  compare(Object.keys(values).length, '<', 500);
});
