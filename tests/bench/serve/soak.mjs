// SPDX-License-Identifier: Apache-2.0
// Clients connect and disconnect and use the rest of the interface, long enough to detect leaks.
import fs from 'node:fs';
import os from 'node:os';
import path from 'node:path';
import { Client, pause } from './peers.mjs';

const PEOPLE = 12;
const FORMATS = ['jpeg', 'jpeg', 'webp', 'png', 'vp8', 'vp9'];
const SNAPSHOT_FORMATS = ['jpeg', 'png', 'webp', 'exr'];
const GUEST = 'demo:sparse?size=32'; // a volume that is loaded and unloaded
const any = (list) => list[Math.floor(Math.random() * list.length)];

/** A user with a session, which a second client may also watch. */
class Person {
  static async come(daemon) {
    const person = new Person();
    const session = await daemon.session(256);
    person.id = session.id;
    person.clients = [await Client.open(daemon, session)];
    if (Math.random() < 0.3) person.clients.push(await Client.open(daemon, session, { role: 'view' }));
    for (const client of person.clients) client.configure({ format: any(FORMATS), lossless: Math.random() < 0.2 });
    person.clients[0].drive(50 + Math.random() * 200);
    person.until = performance.now() + 2000 + Math.random() * 15000;
    return person;
  }

  /** Leaves; one user in five does not delete the session. */
  async go(daemon) {
    this.clients.forEach((client) => client.end());
    if (Math.random() < 0.8) await daemon.ask('DELETE', `sessions/${this.id}`);
  }
}

async function until(daemon, target, ...states) {
  let what = { state: '' };
  while (!states.includes(what.state)) {
    await pause(50);
    what = await daemon.ask('GET', target);
  }
}

/** Creates, fetches and deletes a saved view and its image, a volume and its image, a camera path and its movie. */
async function errand(daemon) {
  const view = { ...daemon.views[0], size: [96 + Math.floor(Math.random() * 64), 96] };
  const saved = await daemon.ask('POST', 'views', view);
  await daemon.ask('GET', `render/${saved.id}?format=${any(SNAPSHOT_FORMATS)}`);
  await daemon.ask('DELETE', `views/${saved.id}`);
  const guest = await daemon.ask('POST', 'volumes', { uri: GUEST, id: 'guest' });
  await until(daemon, `volumes/${guest.id}`, 'ready', 'failed');
  await daemon.ask('POST', 'render?format=png', { volume: guest.id, size: [64, 64] });
  await daemon.ask('DELETE', `volumes/${guest.id}`);
  const made = await daemon.ask('POST', 'paths', { view, frames: 12, fps: 30, format: 'webm', keyframes: [{ frame: 11, view: { camera: { ...view.camera, fov_y: 20 } } }] });
  await until(daemon, `paths/${made.id}`, 'done', 'failed');
  await daemon.ask('GET', `paths/${made.id}/movie`);
  await daemon.ask('DELETE', `paths/${made.id}`);
}

/** Runs the soak test; calls note() at the end of each minute. start(args) starts the daemon. */
export async function soak(start, minutes, note) {
  const state = fs.mkdtempSync(path.join(os.tmpdir(), 'splatd-soak-'));
  const daemon = await start(['--state', state, '--session-time', '60']);
  const people = new Set();
  const begin = performance.now();
  const done = { clients: 0, errands: 0, failed: 0 };
  const attempt = (work) => work.catch((problem) => {
    process.stderr.write(`${problem.message}\n`);
    done.failed++;
  });
  let ending = false;
  const errands = (async () => {
    for (; !ending; done.errands++) {
      await attempt(errand(daemon));
      await pause(1000);
    }
  })();
  for (let minute = 0; minute < minutes;) {
    if (people.size < PEOPLE) {
      const person = await Person.come(daemon);
      people.add(person);
      done.clients += person.clients.length;
    }
    for (const person of people)
      if (performance.now() > person.until && people.delete(person)) await person.go(daemon);
    await attempt(daemon.ask('POST', 'render?format=jpeg', { ...daemon.views[0], size: [128, 128] }));
    await pause(100);
    if (performance.now() > begin + 60000 * (minute + 1))
      note({ minute: ++minute, ...done, sessions: await daemon.gauge('splatd_sessions'), rss: daemon.rssMib(), descriptors: daemon.files() });
  }
  ending = true;
  await errands;
  for (const person of people) person.clients.forEach((client) => client.end());
  await daemon.stop();
  fs.rmSync(state, { recursive: true });
}
