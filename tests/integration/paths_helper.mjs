// SPDX-License-Identifier: Apache-2.0
// What the tests of camera paths share: path requests, their events and their files.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import os from 'node:os';
import path from 'node:path';
import { after, before } from 'node:test';
import { setImmediate } from 'node:timers/promises';
import { Daemon } from './harness.mjs';

export const VOLUME = ['--volume', 'demo:engine?size=16'];
export const API = '/api/v1/paths';
const TURN = [{ frame: 4, view: { camera: { position: [60, 0, 0] } } }, { frame: 8, view: { camera: { fov_y: 60 } } }];
/** A path request of 9 small frames, with changes. */
export const pathOf = (more = {}) => ({ view: { volume: 'engine' }, size: [24, 16], frames: 9, keyframes: TURN, ...more });
/** A path that takes long to render, although each frame is ready soon: what waits for a frame waits briefly under a sanitizer too. */
export const LONG = { size: [300, 300], frames: 9000 };

const folders = [];
/** Returns a new temporary folder, which is removed after the tests. */
export const newFolder = () => {
  folders.push(fs.mkdtempSync(path.join(os.tmpdir(), 'splatd-paths-')));
  return folders.at(-1);
};
/** The daemon that tests share; most start their own. */
export let daemon;
before(async () => {
  daemon = await Daemon.start(VOLUME, { backend: 'cpu' });
  await daemon.loaded('engine');
});
after(async () => {
  assert.equal(await daemon.stop(), 0);
  for (const folder of folders) fs.rmSync(folder, { recursive: true });
});

/** Creates a path. Resolves to its id. */
export async function make(body, of = daemon) {
  const answer = await of.post(API, body);
  assert.equal(answer.status, 202, JSON.stringify(answer.json));
  assert.equal(answer.headers.get('location'), `paths/${answer.json.id}`);
  return answer.json.id;
}

/** Yields the events of a path until the daemon ends them: {id, event, data}. */
export async function* events(id, { of = daemon, after: last } = {}) {
  const answer = await of.fetch(`${API}/${id}/events`, { headers: last ? { 'Last-Event-ID': last } : {} });
  if (answer.status === 204) return;
  assert.equal(answer.status, 200);
  assert.equal(answer.headers.get('content-type'), 'text/event-stream');
  let text = '';
  for await (const chunk of answer.body.pipeThrough(new TextDecoderStream())) {
    text += chunk;
    for (let end; (end = text.indexOf('\n\n')) >= 0; text = text.slice(end + 2)) {
      const fields = Object.fromEntries(text.slice(0, end).split('\n').map((line) => line.split(/: (.*)/s)));
      if (fields.data) yield { ...fields, data: JSON.parse(fields.data) };
    }
  }
}

/** Resolves to the last event. */
export async function end(id, options) {
  let last;
  for await (const event of events(id, options)) last = event;
  return last;
}

/** Resolves to the first event that fits. */
export async function event(id, fits, options) {
  for await (const one of events(id, options)) if (fits(one)) return one;
  throw new Error('the events ended');
}

/** Waits until the daemon has removed the file. */
export async function gone(file) {
  const limit = AbortSignal.timeout(60000);
  while (fs.existsSync(file)) {
    limit.throwIfAborted();
    await setImmediate();
  }
}

export const bytes = async (answer) => Buffer.from(await answer.arrayBuffer());
export const frame = async (id, n, of = daemon) => bytes(await of.fetch(`${API}/${id}/frames/${n}`));
